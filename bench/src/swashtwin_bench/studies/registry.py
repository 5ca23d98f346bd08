"""All studies by name, with their settings."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_origin, get_type_hints

import msgspec

from swashtwin.foundation import InputError
from swashtwin.recordings import load_recordings
from swashtwin_bench.public.bearing_life import bearing_life
from swashtwin_bench.public.study import PublicSettings, public
from swashtwin_bench.questions.alarms import AlarmStudySettings, alarms
from swashtwin_bench.questions.calibration import CalibrationStudySettings, calibration
from swashtwin_bench.questions.detector import DetectorStudySettings, detector
from swashtwin_bench.questions.library import LibrarySettings, library
from swashtwin_bench.questions.life import LifeStudySettings, life
from swashtwin_bench.questions.severity import SeverityStudySettings, severity
from swashtwin_bench.questions.wrong_twin_study import WrongTwinSettings, wrong_twins
from swashtwin_bench.questions.zero_shot import ZeroShotSettings, zero_shot
from swashtwin_bench.results.runs import Work
from swashtwin_bench.results.table import StudyTable
from swashtwin_bench.studies.plan import Plan, PlanSettings
from swashtwin_bench.studies.plans import PLANS, build_plan
from swashtwin_bench.studies.runner import find_fleets, run_plan


@dataclass(frozen=True)
class NoSettings:
    """Settings of a study that has none."""


@dataclass(frozen=True)
class Question:
    """A study that is not a plan of trainings."""

    run: Callable[..., StudyTable]
    """Function of `Work`, settings, and the recordings or the folder, if it reads any."""
    settings: Callable[..., Any]
    """Class of its settings."""
    reads: Literal["rig", "recordings", "folder"] = "rig"
    """``"rig"``: only the virtual rig; ``"recordings"``: recordings of the user, or the rig;
    ``"folder"``: the folder of the public data sets.
    """


def _run_to_failure(work: Work, _: NoSettings, folder: Path) -> StudyTable:
    return bearing_life(work, folder)


QUESTIONS: Mapping[str, Question] = MappingProxyType(
    {
        "alarms": Question(alarms, AlarmStudySettings),
        "calibration": Question(calibration, CalibrationStudySettings),
        "detector": Question(detector, DetectorStudySettings),
        "life": Question(life, LifeStudySettings),
        "severity": Question(severity, SeverityStudySettings),
        "wrong-twins": Question(wrong_twins, WrongTwinSettings),
        "zero-shot": Question(zero_shot, ZeroShotSettings, "recordings"),
        "library": Question(library, LibrarySettings),
        "public": Question(public, PublicSettings, "folder"),
        "run-to-failure": Question(_run_to_failure, NoSettings, "folder"),
    }
)
"""Studies that are not a plan, by name."""


def run_study(
    name: str,
    source: Path | None = None,
    *,
    work: Work | None = None,
    size: str = "quick",
    settings: Mapping[str, Any] | None = None,
) -> StudyTable:
    """Run a study, and return its table.

    Parameters
    ----------
    name : name in `PLANS` or `QUESTIONS`.
    source : index, store or folder of recordings; for ``public`` and ``run-to-failure`` the folder
        of the public data sets. By default the virtual rig, with a fleet for each seed, which a
        plan keeps in the folder of `work`.
    work : seeds, processes, and the folder of finished tasks.
    size : size of a plan.
    settings : settings by name, as values or as texts of a command line.

    Raises
    ------
    InputError
        The study, its size or a setting does not exist, or what the study reads is missing.
    """
    started = time.perf_counter()
    work = work or Work()

    if name in QUESTIONS:
        study = _run_question(name, source, work, settings or {})
    else:
        plan_settings = read_settings(PlanSettings, settings or {}, name)
        plan = _build_plan(name, size).with_settings(plan_settings)
        study = _run_plan(plan, name, source, work)

    return replace(
        study, wall_s=time.perf_counter() - started, command=work.command or study.command
    )


def _run_question(
    name: str, source: Path | None, work: Work, settings: Mapping[str, Any]
) -> StudyTable:
    question = QUESTIONS[name]
    question_settings = read_settings(question.settings, settings, name)
    if question.reads == "folder" and source is None:
        raise InputError(f"{name} needs the folder of the public data sets.")
    if question.reads == "rig" and source is not None:
        raise InputError(f"{name} reads no recordings: it builds its own on the virtual rig.")

    if source is None:
        return question.run(work, question_settings)
    if question.reads == "folder":
        return question.run(work, question_settings, source)
    return question.run(work, question_settings, list(load_recordings(source)))


def _run_plan(plan: Plan, name: str, source: Path | None, work: Work) -> StudyTable:
    if source is not None:
        return run_plan(plan, list(load_recordings(source)), work)

    if work.out is None:
        raise InputError(
            f"{name} on the virtual rig needs a folder for its fleets.",
            field="out",
            remedy="Set {out}.",
        )
    fleets = find_fleets(work.out, plan.fleet, plan.rig, work, plan.sensors)
    return run_plan(plan, fleets, work)


def _build_plan(name: str, size: str) -> Plan:
    if name not in PLANS:
        names = (*PLANS, *QUESTIONS)
        raise InputError(f"Unknown study {name!r}: must be one of {', '.join(names)}.")
    return build_plan(name, size)


def read_settings(kind: Callable[..., Any], settings: Mapping[str, Any], study: str) -> Any:
    """Return the settings of a study from values or from texts as on a command line.

    In a text, several values are separated by commas.

    Raises
    ------
    InputError
        The study does not have a setting, or its value is invalid.
    """
    types = get_type_hints(kind)

    values = {}
    for name, value in settings.items():
        if name not in types:
            remedy = f"its settings are {', '.join(types)}" if types else "it has none"
            raise InputError(f"{study} has no setting {name!r}; {remedy}.")

        parts = value
        if isinstance(value, str) and get_origin(types[name]) is tuple:
            parts = [part.strip() for part in value.split(",") if part.strip()]
        try:
            values[name] = msgspec.convert(parts, types[name], strict=False)
        except msgspec.ValidationError as cause:
            raise InputError(f"Invalid {name} {value!r} of {study}: {cause}.") from cause

    return kind(**values)
