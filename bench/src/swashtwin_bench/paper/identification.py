"""The paper's identification: IPINN at each learning rate of its grid, its loss curves, and RMSE, PE and SVE.

Each pump of a fleet is calibrated on its recordings of the swash plate fault at one pressure but the last, which the
errors are measured on. Two Gauss-Newton searches, alike but for the phases of the lines, show what becomes of the
waveform's RMSE where phases are compared and where they are not.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from joblib import delayed

from swashtwin.calibration import IPINN, PAPER_RATES, agreement, calibrate, measure, objective_of
from swashtwin.foundation import VERSION, DataError, InputError, MPa, parallel
from swashtwin.physics import RK4, Twin
from swashtwin.pump import PARAMETERS, PRESSURE_TOLERANCE, load_pump, values_match
from swashtwin.recordings import Recording
from swashtwin_bench.questions.calibration import FAULTS
from swashtwin_bench.questions.contenders import CONTENDERS, Contender
from swashtwin_bench.results.finished import finished_values
from swashtwin_bench.results.reported import PAPER_STUDY
from swashtwin_bench.results.runs import Task, fingerprint_of
from swashtwin_bench.results.table import StudyTable, Trial, origin_of
from swashtwin_bench.studies.sources import Source

STUDY = f"{PAPER_STUDY}identification"
LABEL = "swash_plate"
PRESSURE = MPa(10)
"""Discharge pressure of the recordings that are calibrated on [Pa]."""
NOMINAL = "nominal"
CHOSEN = f"ipinn_{min(PAPER_RATES):g}"
"""The paper's choice: the least rate of its grid."""
SOLVED_BY_RK4 = "ipinn_rk4"
"""The same with the settled answer of RK4 inside the loss, which is solved by lines and not step by step."""

PHASES_APART = ("gauss_newton_housing", "gauss_newton_housing_phases")
"""Two searches that differ only in whether the phases of the lines are compared."""

METRICS = {
    "rmse": "RMSE [m/s²]",
    "pe": "PE",
    "sve": "SVE",
    "loss": "least loss [m/s²]",
    "first_loss": "loss of epoch 1 [m/s²]",
    "best_epoch": "best epoch",
    "wall_s": "time of one search [s]",
}


@dataclass(frozen=True, eq=False)
class _Pump:
    """One pump's recordings by role."""

    seed: int
    name: str
    train: tuple[Recording, ...]
    held_out: Recording


def methods(size: str) -> dict[str, Contender | None]:
    """Ways to identify the six values, by name; None for the nominal ones. At the paper's size IPINN with the settled
    answer of RK4 inside the loss too."""
    searches = {f"ipinn_{rate:g}": Contender(IPINN(learning_rate=rate)) for rate in PAPER_RATES}
    if size == "paper":
        searches[SOLVED_BY_RK4] = Contender(IPINN(solver=RK4()))
    return {NOMINAL: None, **searches, **{name: CONTENDERS[name] for name in PHASES_APART}}


def run_identification(
    source: Source,
    *,
    size: str,
    seeds: Sequence[int],
    jobs: int = 1,
    out: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Errors of every way to identify the six values, a trial for each pump, and the loss of each epoch.

    Parameters
    ----------
    source : fleets by seed.
    size : ``"small"``, ``"medium"`` or ``"paper"``.
    seeds : fleets.
    out : folder that keeps finished searches.
    progress : called with searches done and in all.
    command : command line that repeats it.

    Raises
    ------
    DataError
        No pump has two recordings of the fault at the pressure.
    """
    started = time.perf_counter()
    pumps = [pump for seed in seeds for pump in _pumps(source.recordings_for(seed)[0], seed)]
    work = [(name, contender, pump) for name, contender in methods(size).items() for pump in pumps]
    results: list[dict[str, Any]] = []
    for values in parallel(jobs, return_as="generator")(delayed(_finished)(*case, size, out) for case in work):
        results.append(values)
        if progress is not None:
            progress(len(results), len(work))
    cases = [(name, pump, values) for (name, _, pump), values in zip(work, results, strict=True)]
    return StudyTable(
        study=STUDY,
        title="The paper's identification: learning rates of the IPINN, and errors of the twin",
        metrics=METRICS,
        trials=tuple(
            Trial({"twin": name}, pump.seed, {metric: values[metric] for metric in METRICS if metric in values})
            for name, pump, values in cases
        ),
        answer=(),
        settings={"label": LABEL, "pressure_Pa": PRESSURE, "methods": {n: repr(c) for n, c in methods(size).items()}},
        origin=origin_of([pumps[0].held_out]),
        wall_s=time.perf_counter() - started,
        version=VERSION,
        command=command,
        notes=(
            "RMSE, PE and SVE are those on a recording that was held out, of the same pump, fault and pressure; mean "
            "over pumps. The loss is that of the recordings calibrated on.",
            *dict.fromkeys(f"{name}: {values['refusal']}" for name, _, values in cases if "refusal" in values),
        ),
        details={
            "curves": [
                {"twin": name, "seed": pump.seed, "specimen": pump.name, "loss": values["curve"]}
                for name, pump, values in cases
                if "curve" in values
            ],
            "parameters": [
                {"twin": name, "seed": pump.seed, "specimen": pump.name, **dict(zip(PARAMETERS, six, strict=True))}
                for name, pump, values in cases
                for six in [values["parameters"]]
                if six
            ],
        },
    )


def _pumps(recordings: Sequence[Recording], seed: int) -> list[_Pump]:
    by_pump: dict[str, list[Recording]] = {}
    for recording in sorted(recordings, key=lambda each: each.recording_id):
        condition = recording.condition
        if (
            recording.label == LABEL
            and condition is not None
            and values_match(condition.discharge_pressure, PRESSURE, PRESSURE_TOLERANCE)
        ):
            by_pump.setdefault(str(recording.specimen), []).append(recording)
    pumps = [_Pump(seed, name, tuple(of[:-1]), of[-1]) for name, of in by_pump.items() if len(of) > 1]
    if not pumps:
        raise DataError(
            f"no pump has two recordings of {LABEL} at {PRESSURE / 1e6:g} MPa, one to calibrate on and one to test on."
        )
    return pumps


def _finished(name: str, contender: Contender | None, pump: _Pump, size: str, out: Path | None) -> dict[str, Any]:
    torch.set_num_threads(1)
    task = Task(
        STUDY,
        size,
        pump.seed,
        {"twin": name, "specimen": pump.name},
        {"contender": repr(contender)},
        fingerprint_of([*pump.train, pump.held_out]),
    )
    return finished_values(out, task, lambda: _values(contender, pump))


def _values(contender: Contender | None, pump: _Pump) -> dict[str, Any]:
    """Errors, losses and values of one search; of one that failed its reason alone."""
    condition = pump.held_out.condition
    assert condition is not None  # by which it was chosen
    nominal = Twin(load_pump("25scy14-1b"), condition, FAULTS[LABEL])
    if contender is None:
        return {**_errors(nominal, pump.held_out), "parameters": nominal.values.tolist()}
    try:
        calibration = calibrate(
            nominal,
            list(pump.train),
            method=contender.method,
            nuisances=contender.nuisances,
            phases=contender.phases,
            explain_misfit=False,
            seed=pump.seed,
        )
    except InputError as cause:
        return {"refusal": str(cause), "parameters": []}
    values = {
        **_errors(calibration.twin, pump.held_out),
        "wall_s": calibration.wall_s,
        "parameters": [estimate.value for estimate in calibration.estimates],
    }
    if not isinstance(contender.method, IPINN):
        return values
    loss = calibration.history.loss
    return {
        **values,
        "loss": float(loss.min()),
        "first_loss": float(loss[0]),
        "best_epoch": float(calibration.history.best + 1),
        "curve": np.asarray(loss).tolist(),
    }


def _errors(twin: Twin, recording: Recording) -> dict[str, float]:
    (comparison,) = objective_of(twin, measure(twin, [recording])).comparisons
    near = agreement(comparison.measurement, twin, comparison.amplitude_of(twin))[0]
    return {"rmse": near.rmse, "pe": near.peak_error, "sve": near.spectrum_value_error}


def mean_parameters(study: StudyTable, twin: str) -> Mapping[str, tuple[float, float]]:
    """Over the pumps, (geometric mean, factor of one standard deviation) of each of the six values of a twin; empty
    where every search failed, and NaN is the factor of one pump."""
    rows = [row for row in study.details["parameters"] if row["twin"] == twin]
    logarithms = {name: np.log([row[name] for row in rows]) for name in PARAMETERS if rows}
    return {
        name: (float(np.exp(each.mean())), float(np.exp(each.std(ddof=1))) if len(rows) > 1 else math.nan)
        for name, each in logarithms.items()
    }
