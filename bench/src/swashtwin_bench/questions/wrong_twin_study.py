"""Calibration of wrong twins and of unusual truths, with the default settings.

Each case of `matrix_cases` is calibrated as a user would (`calibrate` without any setting), on a
healthy recording at 10 MPa. In recordings that the twin simulates, the mistake of the case is the
only one. Pumps of the virtual rig are measured twice.
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
"""Standard deviation of ln(true value / nominal one) in recordings that the twin simulates."""

MAX_ERROR_HALF_WIDTHS = 2.0
"""Largest error of the logarithm of a value, in half widths of its interval, that is tolerated."""

MIN_COVERAGE = 0.8
"""Smallest coverage of identified values at which the answer does not name a family."""


@dataclass(frozen=True)
class WrongTwinSettings:
    """Size of the study."""

    rounds: int = 1
    """Trials of each case, each with another seed."""


def wrong_twins(work: Work, settings: WrongTwinSettings) -> StudyTable:
    """Return coverage and warnings for wrong twins and unusual truths, a row for each family.

    Parameters
    ----------
    work : its seeds are those of the truths, the noise, and the rig's fleets; the cases alternate
        between them.
    """
    cases = matrix_cases()
    arguments = []
    for turn in range(settings.rounds):
        for number, case in enumerate(cases):
            seed = work.seeds[(number + turn) % len(work.seeds)]
            arguments.append((number, case, seed, work.out))

    trials: list[Trial] = work.map("cases", _trial, arguments)
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
        origin=(
            "Simulations of the twin with noise 30 dB below, in which all but the stated mistake "
            "is right; in the families named so, recordings of the virtual rig, a stand-in for a "
            "machine."
        ),
        notes=_NOTES,
        details={
            "families": family_counts(trials),
            "cases": [{**trial.factors, "seed": trial.seed, **trial.values} for trial in trials],
        },
    )


_NOTES = (
    "Means over a family's trials. Identified and covered count values of six: those called "
    "identified, and those of them whose 90 % interval holds the truth.",
    f"Errs: a value is off by more than {MAX_ERROR_HALF_WIDTHS:g} half widths of its interval. "
    "Warned: a refusal, or any note but those of values not identified and of bounds that were "
    "widened. Named: a warning holds the words for the mistake; counted if there was a "
    "warning and such words exist.",
    "Intervals are Wilson's, of 95 %, as if the values of one trial were one draw.",
)


def study_twin() -> Twin:
    """Return the twin before any mistake: healthy, at 10 MPa."""
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(10))
    return Twin(load_pump("25scy14-1b"), condition, bandwidth=2600)


def _trial(number: int, case: MatrixCase, seed: int, out: Path | None) -> Trial:
    """Return the trial of one case.

    ``named`` states whether a warning names the mistake, if there is a warning and it could.
    """
    factors = {"family": case.family, "case": case.name}
    settings = {"spread": SPREAD, "reach": MAX_ERROR_HALF_WIDTHS, "version": VERSION}
    data = f"virtual rig {RIG_VERSION}" if case.on_rig else "own"
    task = Task(STUDY, seed, factors, settings, data)

    values = task.run(out, lambda: {"values": _values(number, case, seed)})["values"]
    if case.expected_warning and values["warned"]:
        values = {
            **values,
            "named": float(any(case.expected_warning in note for note in values["notes"])),
        }

    return Trial(factors, seed, values)


def _values(number: int, case: MatrixCase, seed: int) -> dict[str, Any]:
    """Return the metrics of one case and its notes.

    A refusal of the recordings counts as a warning.
    """
    if case.on_rig:
        recordings, truth = _rig_pump(seed)
    else:
        recordings, truth = _simulated_pump(seed, number)

    twin = case.twin(study_twin())
    recordings = [case.recording(recording) for recording in recordings]
    try:
        calibration = calibrate(twin, recordings)
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
    """Return the metrics of a calibration whose true values are known."""
    identified_count = 0
    covered_count = 0
    errs = False
    values = {}
    for estimate, true_value in zip(calibration.estimates, truth, strict=True):
        log_value = math.log(estimate.value)
        log_truth = math.log(true_value)
        low, high = np.log(estimate.interval)

        # Intervals may be skewed, so the half width is that on the side of the truth.
        half_width = high - log_value if true_value > estimate.value else log_value - low
        error = abs(math.log(estimate.value / true_value))
        errs = errs or bool(error > MAX_ERROR_HALF_WIDTHS * half_width)
        if estimate.verdict == "identified":
            identified_count += 1
            covered_count += bool(low <= log_truth <= high)

        ratio = float(estimate.value / true_value)
        values[estimate.symbol] = [ratio, estimate.log_std, estimate.verdict]

    warnings = [note for note in calibration.notes if is_warning(note)]
    history = calibration.history

    return {
        "identified": identified_count,
        "covered": covered_count,
        "errs": float(errs),
        "warned": float(bool(warnings)),
        "silent": float(errs and not warnings),
        "misfit": float(history.spectrum_loss[history.best_step]),
        "values": values,
        "notes": list(calibration.notes),
    }


def _simulated_pump(seed: int, number: int) -> tuple[list[Recording], np.ndarray]:
    """Return a simulated recording with noise 30 dB below it, and its true values."""
    rng = random_stream(seed, STUDY, number)
    twin = study_twin()
    truth = twin.values.numpy() * np.exp(SPREAD * rng.standard_normal(6))
    true_twin = twin.with_interfaces(Interfaces.from_values(truth))

    phase = rng.uniform(0, 2 * math.pi)
    recording = true_twin.simulate(2.0, 6400.0, phase=phase, recording_id=f"own_{seed}_{number}")
    signal = add_noise(recording.signal, 30.0, int(rng.integers(2**31)))

    return [recording.replace(signal=signal)], truth


def _rig_pump(seed: int) -> tuple[list[Recording], np.ndarray]:
    """Return two recordings of the first pump of a fleet, and the mean of their true values."""
    recordings = []
    log_truths = []
    size = RigSize(specimens=1, repeats=2)
    for recording, run in rig_recordings(seed, size, labels=("normal",)):
        condition = recording.condition
        if condition is not None and condition.discharge_pressure == MPa(10):
            recordings.append(recording)
            log_truths.append(np.log(true_values(run)))

    return recordings, np.exp(np.mean(log_truths, axis=0))


def family_counts(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Return the counts of each family, and the coverage of its identified values."""
    families = dict.fromkeys(trial.factors["family"] for trial in trials)
    return [
        {"family": name, **_counts([trial for trial in trials if trial.factors["family"] == name])}
        for name in families
    ]


def _counts(trials: Sequence[Trial]) -> dict[str, Any]:
    identified = round(sum(trial.values["identified"] for trial in trials))
    covered = round(sum(trial.values["covered"] for trial in trials))
    erring = [trial for trial in trials if trial.values["errs"]]

    share = None
    interval = None
    if identified:
        # Values of one trial are not independent, so each trial counts once.
        trials_with_identified = sum(trial.values["identified"] > 0 for trial in trials)
        share = covered / identified
        interval = list(wilson_interval(share, trials_with_identified))

    return {
        "trials": len(trials),
        "identified": identified,
        "covered": covered,
        "share": share,
        "interval": interval,
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
    low = [f"{name} ({share:.0%})" for name, share in shares.items() if share < MIN_COVERAGE]
    sentences = [
        f"{_rate(wrong['errs_warned'], wrong['errs'])} of the wrong twins that err by more than "
        f"{MAX_ERROR_HALF_WIDTHS:g} half widths of an interval are warned of, and "
        f"{_rate(sum(trial.values['warned'] for trial in right), len(right))} of "
        "the right ones.",
        f"{_rate(wrong['named'], wrong['nameable'])} of the warnings for which words exist name "
        "the mistake.",
    ]
    if total["identified"]:
        low_families = (
            f"below {MIN_COVERAGE:.0%}: {', '.join(low)}"
            if low
            else f"in each family {MIN_COVERAGE:.0%} or more"
        )
        limits = " to ".join(f"{limit:.0%}" for limit in total["interval"])
        sentences.insert(
            0,
            f"{_rate(total['covered'], total['identified'])} of the values called identified hold "
            f"({limits}), in {total['trials']} trials; {low_families}.",
        )
    return tuple(sentences)


def _rate(count: float, total: int) -> str:
    return f"{count:g} of {total} ({count / total:.0%})" if total else "none"
