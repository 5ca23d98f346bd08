"""Whether a calibration knows its limits: a matrix of wrong twins and odd truths, with the default
settings.

Each case of `matrix_cases` is calibrated as a user would (`calibrate` without any setting), on a
healthy recording at 10 MPa. On the twin's own recordings all is right but the stated mistake; on
the virtual rig a pump is measured twice.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.calibration import Calibration, calibrate, is_warning
from swashtwin.foundation import VERSION, MPa, SwashTwinError, random_stream, rpm
from swashtwin.learning import wilson_interval
from swashtwin.physics import Twin
from swashtwin.pump import Interfaces, OperatingCondition, load_pump
from swashtwin.recordings import Recording
from swashtwin.signals import add_noise
from swashtwin_bench.questions.twin_matrix import RIGHT, MatrixCase, matrix_cases
from swashtwin_bench.results.runs import Task, Work
from swashtwin_bench.results.table import StudyTable, Trial
from swashtwin_bench.rigs.measuring import true_values
from swashtwin_bench.rigs.writing import RIG_VERSION, RigSize, rig_recordings

STUDY = "wrong-twins"
METRICS = {
    "identified": "values identified",
    "covered": "of these, covered",
    "errs": "errs by two half widths",
    "warned": "warned",
    "silent": "errs without a warning",
    "named": "mistake named where warned",
}
SPREAD = 0.3
"""Standard deviation of the logarithm of the true values about the nominal ones, on the twin's own
recordings.
"""
REACH = 2.0
"""A value errs whose logarithm is off by more than so many half widths of its interval."""
LEAST_SHARE = 0.8
"""A family is named where a smaller share of its identified values holds."""


@dataclass(frozen=True)
class WrongTwinSettings:
    """How much is tried."""

    rounds: int = 1
    """How often each case is tried, with another seed each time."""


def wrong_twins(work: Work, settings: WrongTwinSettings) -> StudyTable:
    """What calibrations of wrong twins and odd truths came to, a row for each family.

    Parameters
    ----------
    work : its seeds are of the truths, the noise, and the rig's fleets; the cases take turns among
        them.
    """
    cases = matrix_cases()
    tries = [
        (number, case, work.seeds[(number + turn) % len(work.seeds)], work.out)
        for turn in range(settings.rounds)
        for number, case in enumerate(cases)
    ]
    trials: list[Trial] = work.map("cases", _trial, tries)
    families = list(dict.fromkeys(case.family for case in cases))
    trials.sort(key=lambda trial: families.index(trial.factors["family"]))
    return StudyTable(
        study=STUDY,
        title="Does a calibration know its limits? Wrong twins and odd truths",
        metrics=METRICS,
        trials=tuple(
            Trial({"family": trial.factors["family"]}, trial.seed, trial.values) for trial in trials
        ),
        answer=_answer(trials),
        settings={
            "cases": len(cases),
            "rounds": settings.rounds,
            "spread": SPREAD,
            "pressure_mpa": 10,
        },
        origin="Simulations of the twin with noise 30 dB below, in which all but the stated mistake is right; in the "
        "families named so, recordings of the virtual rig, a stand-in for a machine.",
        notes=_NOTES,
        details={
            "families": family_counts(trials),
            "cases": [{**trial.factors, "seed": trial.seed, **trial.values} for trial in trials],
        },
    )


_NOTES = (
    "Means over a family's trials. Identified and covered count values of six: those called "
    "identified, and those of them whose 90 % interval holds the truth.",
    f"Errs: a value is off by more than {REACH:g} half widths of its interval. Warned: a refusal, "
    "or any note but those of values not identified and of bounds that were widened. Named: a "
    "warning holds the words for the mistake; counted where one was given and such words exist.",
    "Intervals are Wilson's, of 95 %, as if the values of one trial were one draw.",
)


def study_twin() -> Twin:
    """The twin before any mistake: healthy, at 10 MPa."""
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(10))
    return Twin(load_pump("25scy14-1b"), condition, bandwidth=2600)


def _trial(number: int, case: MatrixCase, seed: int, out: Path | None) -> Trial:
    """One case; ``named`` is whether a warning names the mistake, where there are a warning and
    words for it.
    """
    factors = {"family": case.family, "case": case.name}
    settings = {"spread": SPREAD, "reach": REACH, "version": VERSION}
    task = Task(
        STUDY, seed, factors, settings, f"virtual rig {RIG_VERSION}" if case.on_rig else "own"
    )
    values = task.run(out, lambda: {"values": _values(number, case, seed)})["values"]
    if case.clue and values["warned"]:
        values = {**values, "named": float(any(case.clue in note for note in values["notes"]))}
    return Trial(factors, seed, values)


def _values(number: int, case: MatrixCase, seed: int) -> dict[str, Any]:
    """Metrics of one case, and its notes; where the recordings are refused, the warning alone."""
    recordings, truth = _rig_pump(seed) if case.on_rig else _simulated_pump(seed, number)
    try:
        calibration = calibrate(
            case.twin(study_twin()), [case.recording(recording) for recording in recordings]
        )
    except SwashTwinError as refusal:
        return {
            "identified": 0,
            "covered": 0,
            "errs": 0.0,
            "warned": 1.0,
            "silent": 0.0,
            "notes": [str(refusal)],
        }
    return figures(calibration, truth)


def figures(calibration: Calibration, truth: np.ndarray) -> dict[str, Any]:
    """Metrics of a calibration whose true values are known."""
    rows = []
    for estimate, true in zip(calibration.estimates, truth, strict=True):
        low, high = np.log(estimate.interval)
        off = abs(math.log(estimate.value / true))
        half = (
            high - math.log(estimate.value)
            if true > estimate.value
            else math.log(estimate.value) - low
        )
        rows.append(
            (
                estimate.verdict == "identified",
                bool(low <= math.log(true) <= high),
                bool(off > REACH * half),
            )
        )
    errs = any(row[2] for row in rows)
    warnings = [note for note in calibration.notes if is_warning(note)]
    history = calibration.history
    return {
        "identified": sum(row[0] for row in rows),
        "covered": sum(row[0] and row[1] for row in rows),
        "errs": float(errs),
        "warned": float(bool(warnings)),
        "silent": float(errs and not warnings),
        "misfit": float(history.spectrum_loss[history.best_step]),
        "values": {
            each.symbol: [float(each.value / true), each.log_std, each.verdict]
            for each, true in zip(calibration.estimates, truth, strict=True)
        },
        "notes": list(calibration.notes),
    }


def _simulated_pump(seed: int, number: int) -> tuple[list[Recording], np.ndarray]:
    rng = random_stream(seed, STUDY, number)
    twin = study_twin()
    truth = twin.values.numpy() * np.exp(SPREAD * rng.standard_normal(6))
    true = twin.with_interfaces(Interfaces.from_values(truth))
    recording = true.simulate(
        2.0, 6400.0, phase=rng.uniform(0, 2 * math.pi), recording_id=f"own_{seed}_{number}"
    )
    return [
        recording.replace(signal=add_noise(recording.signal, 30.0, int(rng.integers(2**31))))
    ], truth


def _rig_pump(seed: int) -> tuple[list[Recording], np.ndarray]:
    """Two recordings of the first pump of a fleet, and the mean of the values that held in them."""
    pairs = [
        (recording, np.log(true_values(run)))
        for recording, run in rig_recordings(
            seed, RigSize(specimens=1, repeats=2), labels=("normal",)
        )
        if recording.condition is not None and recording.condition.discharge_pressure == MPa(10)
    ]
    return [recording for recording, _ in pairs], np.exp(
        np.mean([truth for _, truth in pairs], axis=0)
    )


def family_counts(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Counts of each family, and the share of identified values that hold with its interval."""
    families = dict.fromkeys(trial.factors["family"] for trial in trials)
    return [
        {"family": name, **_counts([trial for trial in trials if trial.factors["family"] == name])}
        for name in families
    ]


def _counts(trials: Sequence[Trial]) -> dict[str, Any]:
    identified, covered = (
        round(sum(trial.values[name] for trial in trials)) for name in ("identified", "covered")
    )
    telling = sum(trial.values["identified"] > 0 for trial in trials)
    erring = [trial for trial in trials if trial.values["errs"]]
    return {
        "trials": len(trials),
        "identified": identified,
        "covered": covered,
        "share": covered / identified if identified else None,
        "interval": list(wilson_interval(covered / identified, telling)) if identified else None,
        "warned": round(sum(trial.values["warned"] for trial in trials)),
        "errs": len(erring),
        "errs_warned": round(sum(trial.values["warned"] for trial in erring)),
        "named": round(sum(trial.values.get("named", 0.0) for trial in trials)),
        "nameable": sum("named" in trial.values for trial in trials),
    }


def _answer(trials: Sequence[Trial]) -> tuple[str, ...]:
    right = [trial for trial in trials if RIGHT in trial.factors["family"]]
    wrong = _counts([trial for trial in trials if RIGHT not in trial.factors["family"]])
    total = _counts(trials)
    shares = {
        row["family"]: row["share"] for row in family_counts(trials) if row["share"] is not None
    }
    low = [f"{name} ({share:.0%})" for name, share in shares.items() if share < LEAST_SHARE]
    sentences = [
        f"{_rate(wrong['errs_warned'], wrong['errs'])} of the wrong twins that err by more than "
        f"{REACH:g} half widths of an interval are warned of, and "
        f"{_rate(sum(trial.values['warned'] for trial in right), len(right))} of "
        "the right ones.",
        f"{_rate(wrong['named'], wrong['nameable'])} of the warnings for which words exist name "
        "the mistake.",
    ]
    if total["identified"]:
        low_words = (
            f"below {LEAST_SHARE:.0%}: {', '.join(low)}"
            if low
            else f"in each family {LEAST_SHARE:.0%} or more"
        )
        limits = " to ".join(f"{limit:.0%}" for limit in total["interval"])
        sentences.insert(
            0,
            f"{_rate(total['covered'], total['identified'])} of the values called identified hold "
            f"({limits}), in {total['trials']} trials; {low_words}.",
        )
    return tuple(sentences)


def _rate(count: float, total: int) -> str:
    return f"{count:g} of {total} ({count / total:.0%})" if total else "none"
