"""`run_study`: every study by its name, with what can be set of it."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_origin, get_type_hints

import msgspec

from swashtwin.foundation import InputError
from swashtwin.recordings import load_recordings
from swashtwin_bench.public.bearing_life import bearing_life
from swashtwin_bench.public.study import PublicSettings, public
from swashtwin_bench.questions.alarms import AlarmStudySettings, alarms
from swashtwin_bench.questions.calibration import CalibrationStudySettings, calibration
from swashtwin_bench.questions.detector import DetectorStudySettings, detector
from swashtwin_bench.questions.severity import SeverityStudySettings, severity
from swashtwin_bench.questions.wrong_twin_study import WrongTwinSettings, wrong_twins
from swashtwin_bench.questions.zero_shot import ZeroShotSettings, zero_shot
from swashtwin_bench.results.runs import Work
from swashtwin_bench.results.table import StudyTable
from swashtwin_bench.studies.plan import Plan, PlanSettings
from swashtwin_bench.studies.plans import PLANS, build_plan
from swashtwin_bench.studies.runner import fleets, run_plan


@dataclass(frozen=True)
class NoSettings:
    """Nothing can be set."""


@dataclass(frozen=True)
class Question:
    """A study that is no plan of trainings."""

    run: Callable[..., StudyTable]
    """Takes the `Work`, the settings, and what it reads."""
    settings: Callable[..., Any]
    """Class of its settings."""
    reads: str = "rig"
    """``"rig"``: the virtual rig alone; ``"recordings"``: recordings of a user, or the rig;
    ``"folder"``: a folder of public sets.
    """


QUESTIONS: Mapping[str, Question] = MappingProxyType(
    {
        "alarms": Question(alarms, AlarmStudySettings),
        "calibration": Question(calibration, CalibrationStudySettings),
        "detector": Question(detector, DetectorStudySettings),
        "severity": Question(severity, SeverityStudySettings),
        "wrong-twins": Question(wrong_twins, WrongTwinSettings),
        "zero-shot": Question(zero_shot, ZeroShotSettings, "recordings"),
        "public": Question(public, PublicSettings, "folder"),
        "run-to-failure": Question(
            lambda work, _, folder: bearing_life(work, folder), NoSettings, "folder"
        ),
    }
)
"""Studies that are no plan, by name."""


def run_study(
    name: str,
    source: Path | None = None,
    *,
    work: Work | None = None,
    size: str = "quick",
    settings: Mapping[str, Any] | None = None,
) -> StudyTable:
    """What came out of a study.

    Parameters
    ----------
    name : in `PLANS` or `QUESTIONS`.
    source : index, store or folder of recordings; of ``public`` and ``run-to-failure`` the folder
        of the public sets. None takes the virtual rig, a fleet for each seed, which a plan keeps in
        the folder of `work`.
    work : seeds, processes, and the folder of what is finished.
    size : of a plan.
    settings : what is set of it, by name: values, or texts as on a command line.

    Raises
    ------
    InputError
        There is no such study, size or setting, or what it reads is not given.
    """
    started, work = time.perf_counter(), work or Work()
    if name in QUESTIONS:
        question = QUESTIONS[name]
        chosen = read_settings(question.settings, settings or {}, name)
        if (source is None) is not (question.reads == "rig") and question.reads != "recordings":
            needs = (
                "the folder of the public sets"
                if question.reads == "folder"
                else "no recordings: it builds its own"
            )
            raise InputError(f"{name} takes {needs}.")
        given: tuple[Any, ...] = ()
        if source is not None:
            given = (source,) if question.reads == "folder" else (list(load_recordings(source)),)
        study = question.run(work, chosen, *given)
    else:
        plan = _plan(name, size).with_settings(read_settings(PlanSettings, settings or {}, name))
        if source is not None:
            study = run_plan(plan, list(load_recordings(source)), work)
        elif work.out is None:
            raise InputError(
                f"{name} on the virtual rig needs a folder, which the fleets are built into."
            )
        else:
            study = run_plan(plan, fleets(work.out, plan.fleet, plan.rig, work, plan.sensors), work)
    return replace(
        study, wall_s=time.perf_counter() - started, command=work.command or study.command
    )


def _plan(name: str, size: str) -> Plan:
    if name not in PLANS:
        raise InputError(f"no study {name!r}; there are {', '.join((*PLANS, *QUESTIONS))}.")
    return build_plan(name, size)


def read_settings(kind: Callable[..., Any], given: Mapping[str, Any], study: str) -> Any:
    """Settings of a study from values, or from texts as on a command line; of several values with
    commas between.

    Raises
    ------
    InputError
        The study has no such setting, or it cannot have that value.
    """
    hints = get_type_hints(kind)
    values = {}
    for name, value in given.items():
        if name not in hints:
            there = f"there are {', '.join(hints)}" if hints else "it has none"
            raise InputError(f"{study} has no setting {name!r}; {there}.")
        parts = value
        if isinstance(value, str) and get_origin(hints[name]) is tuple:
            parts = [part.strip() for part in value.split(",") if part.strip()]
        try:
            values[name] = msgspec.convert(parts, hints[name], strict=False)
        except msgspec.ValidationError as cause:
            raise InputError(f"setting {name} of {study} cannot be {value!r}: {cause}.") from cause
    return kind(**values)
