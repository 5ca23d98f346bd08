"""How near calibrated twins come to pumps of the virtual rig, and whether their intervals hold what
they promise.

Each pump of each fleet is calibrated by every method on all but one of its recordings of one class
at one pressure. Errors (RMSE, PE, SVE) are those on the recording that was kept. The six values are
held against those that held in the rig on average over the recordings calibrated on (the rig takes
a pump apart between two recordings, and its films follow oil and pressure). Two rows are no twins
but the rig's own lines without their noise: of the very recording that is tested on, which nothing
can beat, and of another recording of the pump, which is all that can be known without it.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from swashtwin.calibration import (
    IPINN,
    Agreement,
    Calibrator,
    Estimate,
    GaussNewton,
    Nuisances,
    average_agreements,
    build_objective,
    calibrate,
    evaluate_agreement,
    evaluate_line_agreement,
    measure,
)
from swashtwin.foundation import InputError, MPa, mm
from swashtwin.physics import Twin
from swashtwin.pump import SwashPlateDefect, load_pump
from swashtwin.recordings import Recording
from swashtwin_bench.results.runs import Work
from swashtwin_bench.results.table import StudyTable, Trial, describe_origin
from swashtwin_bench.rigs.measuring import Run, sensor_lines, true_values
from swashtwin_bench.rigs.writing import RigSize, rig_recordings


@dataclass(frozen=True)
class Contender:
    """One way to calibrate."""

    method: Calibrator
    """The search."""
    nuisances: Nuisances = field(default_factory=Nuisances)
    """What is searched beside the six values."""
    phases: bool = False
    """Whether the lines' phases are compared too."""


CONTENDERS: dict[str, Contender] = {
    "calibrated": Contender(GaussNewton(), Nuisances.by_axis(), phases=True),
    "gauss_newton_housing_phases": Contender(GaussNewton(), Nuisances.housing(), phases=True),
    "gauss_newton_housing": Contender(GaussNewton(), Nuisances.housing()),
    "gauss_newton": Contender(GaussNewton()),
    "ipinn": Contender(IPINN()),
}
"""Ways to calibrate by name; ``calibrated`` is the one to use, ``ipinn`` the paper's."""

_ERRORS = ("rmse", "pe", "sve")

FAULTS = {
    "normal": None,
    "swash_plate": SwashPlateDefect(depth=mm(0.07), length=mm(30), width=mm(24)),
}
"""What the twin of each class simulates: the recess as it was machined."""

METRICS = {
    "rmse": "RMSE [m/s²]",
    "pe": "PE",
    "sve": "SVE",
    "identified": "values identified of 6",
    "coverage": "coverage of identified",
    "wall_s": "wall time [s]",
    "simulations": "simulations",
}


@dataclass(frozen=True)
class CalibrationStudySettings:
    """What is calibrated on what."""

    label: str = "normal"
    """Class of the recordings; a name in `FAULTS`."""
    pressure: float = MPa(10)
    """Discharge pressure at which is calibrated [Pa]."""
    specimens: int = 6
    """Pumps in each fleet."""
    repeats: int = 3
    """Recordings of each pump at each pressure; the last at `pressure` is tested on."""
    contenders: tuple[str, ...] = tuple(CONTENDERS)
    """Names in `CONTENDERS`."""

    def __post_init__(self) -> None:
        if self.label not in FAULTS:
            raise InputError(
                f"label {self.label!r} has no twin here; choose one of {', '.join(FAULTS)}."
            )
        if self.repeats < 2 or self.specimens < 1:
            raise InputError(
                f"repeats ({self.repeats}) must be at least 2, of which one is tested on, and "
                f"specimens ({self.specimens}) at least 1."
            )
        unknown = [name for name in self.contenders if name not in CONTENDERS]
        if unknown:
            raise InputError(
                f"methods {', '.join(unknown)} are unknown; choose among {', '.join(CONTENDERS)}."
            )


@dataclass(frozen=True, eq=False)
class _Pump:
    """One pump's recordings by role, with the truth behind them."""

    seed: int
    name: str
    train: list[tuple[Recording, Run]]
    held_out: tuple[Recording, Run]


def calibration(work: Work, settings: CalibrationStudySettings) -> StudyTable:
    """Errors, coverage and cost of the nominal twin and of every way to calibrate, a trial for each
    pump.

    Parameters
    ----------
    work : its seeds are fleets of the rig.
    settings : what is calibrated on what.
    """
    pumps = [pump for seed in work.seeds for pump in _fleet(seed, settings, work.jobs)]
    by_pump = work.map("pumps", _of_pump, [(pump, settings) for pump in pumps])
    names = [trial.factors["twin"] for trial in by_pump[0][0]]
    trials = [trial for trials, _ in by_pump for trial in trials]
    table = StudyTable(
        study="calibration",
        title="How near do calibrated twins come, and do their intervals hold the truth?",
        metrics=METRICS,
        trials=tuple(sorted(trials, key=lambda trial: names.index(trial.factors["twin"]))),
        answer=(),
        settings={
            **asdict(settings),
            "contenders": {
                name: {
                    "method": type(CONTENDERS[name].method).__name__,
                    "nuisances": asdict(CONTENDERS[name].nuisances),
                    "phases": CONTENDERS[name].phases,
                }
                for name in settings.contenders
            },
        },
        origin=describe_origin([pumps[0].held_out[0]]),
        notes=(
            f"Calibrated at {settings.pressure / 1e6:g} MPa on {settings.repeats - 1} recordings "
            "of each pump.",
            "Coverage of identified: the share of 90 % intervals of values called identified that "
            "hold the truth.",
            "RMSE and PE contain the recording's noise and the reassembly of the pump between two "
            "recordings: the rows of the rig's truth say how much no twin can explain.",
        ),
        details={
            "intervals": _intervals(
                settings.contenders, [row for _, rows in by_pump for row in rows]
            )
        },
    )
    return replace(table, answer=_answer(table, names))


def _fleet(seed: int, settings: CalibrationStudySettings, jobs: int) -> list[_Pump]:
    size = RigSize(specimens=settings.specimens, repeats=settings.repeats)
    pairs = rig_recordings(
        seed, size, labels=(settings.label,), pressures=(settings.pressure,), jobs=jobs
    )
    of_pump: dict[str, list[tuple[Recording, Run]]] = {}
    for pair in pairs:
        of_pump.setdefault(str(pair[0].specimen), []).append(pair)
    return [_Pump(seed, name, train, held_out) for name, (*train, held_out) in of_pump.items()]


def _of_pump(
    pump: _Pump, settings: CalibrationStudySettings
) -> tuple[list[Trial], list[dict[str, Any]]]:
    """(A trial for each twin of a pump, a row for each value of each calibration.)"""
    train, held_out = [recording for recording, _ in pump.train], pump.held_out[0]
    assert train[0].condition is not None
    nominal = Twin(load_pump("25scy14-1b"), train[0].condition, FAULTS[settings.label])
    truth = np.mean([np.log(true_values(run)) for _, run in pump.train], axis=0)
    trials = [Trial({"twin": "nominal"}, pump.seed, errors_on(held_out, nominal))]
    rows: list[dict[str, Any]] = []
    for name in settings.contenders:
        contender = CONTENDERS[name]
        calibration = calibrate(
            nominal,
            train,
            method=contender.method,
            nuisances=contender.nuisances,
            phases=contender.phases,
            explain_misfit=False,
            seed=pump.seed,
        )
        own = [
            _interval(pump, name, estimate, true)
            for estimate, true in zip(calibration.estimates, truth, strict=True)
        ]
        sure = [row["held"] for row in own if row["verdict"] == "identified"]
        values = {
            **errors_on(held_out, calibration.twin),
            "wall_s": calibration.wall_s,
            "simulations": float(calibration.simulations),
            "identified": float(len(sure)),
            "coverage": float(np.mean(sure)) if sure else float("nan"),
        }
        trials.append(Trial({"twin": name}, pump.seed, values))
        rows += own
    for name, run in (
        ("rig_truth_of_another_recording", pump.train[0][1]),
        ("rig_truth", pump.held_out[1]),
    ):
        trials.append(Trial({"twin": name}, pump.seed, _errors_of_truth(held_out, nominal, run)))
    return trials, rows


def _interval(pump: _Pump, method: str, estimate: Estimate, truth: float) -> dict[str, Any]:
    low, high = estimate.interval
    return {
        "seed": pump.seed,
        "specimen": pump.name,
        "twin": method,
        "symbol": estimate.symbol,
        "value": estimate.value,
        "interval": [low, high],
        "truth": float(np.exp(truth)),
        "held": bool(low <= np.exp(truth) <= high),
        "verdict": estimate.verdict,
        "off": float((np.log(estimate.value) - truth) / estimate.log_std),
    }


def errors_on(recording: Recording, twin: Twin) -> dict[str, float]:
    """RMSE, PE and SVE of a twin on a recording at its operating point."""
    (comparison,) = build_objective(twin, measure(twin, [recording])).comparisons
    return _errors(
        evaluate_agreement(comparison.measurement, twin, comparison.amplitude_of(twin))[0]
    )


def _errors_of_truth(recording: Recording, nominal: Twin, run: Run) -> dict[str, float]:
    """Those of the rig's own lines without noise, in place of a twin's."""
    measurement, lines = measure(nominal, [recording]), sensor_lines(run)
    orders = np.arange(1, lines.shape[1] + 1)
    amplitude = np.abs(lines[:, measurement.orders - 1])
    return _errors(
        average_agreements([evaluate_line_agreement(measurement, lines, orders, amplitude)[0]])
    )


def _errors(near: Agreement) -> dict[str, float]:
    return {"rmse": near.rmse, "pe": near.peak_error, "sve": near.spectrum_value_error}


def _intervals(names: Sequence[str], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """For each way to calibrate: how often intervals held, of all pumps together, and every single
    one.
    """
    table: dict[str, Any] = {}
    for name in names:
        own = [row for row in rows if row["twin"] == name]
        sure = [row for row in own if row["verdict"] == "identified"]
        by_symbol: dict[str, list[bool]] = {}
        for row in own:
            by_symbol.setdefault(row["symbol"], []).append(row["verdict"] == "identified")
        table[name] = {
            "values": len(own),
            "identified": len(sure),
            "held_of_identified": _share([row["held"] for row in sure]),
            "beyond_three_of_identified": _share([abs(row["off"]) > 3 for row in sure]),
            "held_of_all": _share([row["held"] for row in own]),
            "identified_by_symbol": {letter: _share(hits) for letter, hits in by_symbol.items()},
            "single": own,
        }
    return table


def _share(hits: Sequence[bool]) -> float | None:
    return float(np.mean(hits)) if hits else None


def _answer(table: StudyTable, names: Sequence[str]) -> tuple[str, ...]:
    def over_nominal(name: str) -> str:
        """Mean errors over those of the nominal twin."""
        means = [
            [np.mean(table.values(metric, twin=twin)) for metric in _ERRORS]
            for twin in (name, "nominal")
        ]
        return ", ".join(
            f"{metric.upper()} {own / of:.2f}"
            for metric, own, of in zip(_ERRORS, *means, strict=True)
        )

    sentences = []
    for name in names[1:-2]:
        sentences.append(f"{name} over nominal on recordings held out: {over_nominal(name)}.")
        pooled = table.details["intervals"][name]
        if pooled["identified"]:
            sentences[-1] += (
                f" {pooled['identified']} of {pooled['values']} values are called identified, and "
                f"{pooled['held_of_identified']:.0%} of their intervals hold the truth."
            )
    floor = over_nominal("rig_truth_of_another_recording")
    return (
        *sentences,
        f"The rig's own truth of another recording of the same pump over nominal: {floor}.",
    )
