"""Errors of calibrated twins on pumps of the virtual rig, and coverage of their intervals.

Each pump of each fleet is calibrated by every method on all but one of its recordings of one class
at one pressure, or on those at three pressures. Errors (RMSE, PE, SVE) are those on the held-out
recording. The six values are compared with the mean of the true ones over the recordings calibrated
on (the rig takes a pump apart between two recordings, and its films follow oil and pressure).

Two rows are not twins but the rig's true lines without noise: those of the held-out recording,
which nothing can beat, and those of another recording of the pump, which is all that can be known
without the held-out one.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

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
    is_warning,
    measure,
)
from swashtwin.foundation import InputError, MPa, mm
from swashtwin.physics import Twin
from swashtwin.pump import SwashPlateDefect, load_pump
from swashtwin.recordings import Recording
from swashtwin_bench.results.runs import Work
from swashtwin_bench.results.table import StudyTable, Trial, describe_origin
from swashtwin_bench.rigs.measuring import Run, sensor_lines, true_values
from swashtwin_bench.rigs.writing import PRESSURES, RigSize, rig_recordings


@dataclass(frozen=True)
class Contender:
    """One way to calibrate."""

    method: Calibrator
    """The search."""
    nuisances: Nuisances = field(default_factory=Nuisances)
    """What is searched besides the six values."""
    phases: bool = False
    """Whether the phases of the lines are compared too."""
    lines: Literal["piston", "spectrum"] = "piston"
    """Lines that are compared: multiples of the piston count, or the whole spectrum (`measure`)."""
    explain_misfit: bool = False
    """Whether mistakes are searched that would explain a misfit."""
    every_pressure: bool = False
    """Whether the recordings at all pressures of the rig are fitted together."""


CONTENDERS: dict[str, Contender] = {
    "calibrated": Contender(GaussNewton(), Nuisances.by_axis(), phases=True, explain_misfit=True),
    "calibrated_at_three_pressures": Contender(
        GaussNewton(),
        Nuisances.by_axis(),
        phases=True,
        explain_misfit=True,
        every_pressure=True,
    ),
    "gauss_newton_housing_phases": Contender(GaussNewton(), Nuisances.housing(), phases=True),
    "gauss_newton_housing": Contender(GaussNewton(), Nuisances.housing()),
    "gauss_newton": Contender(GaussNewton()),
    "ipinn": Contender(IPINN()),
}
"""Ways to calibrate by name; the first two are `calibrate` with its defaults, ``ipinn`` is the
paper's.
"""

_ERRORS = ("rmse", "pe", "sve")

FAULTS = {
    "normal": None,
    "swash_plate": SwashPlateDefect(depth=mm(0.07), length=mm(30), width=mm(24)),
}
"""Fault of the twin of each class: the recess as machined."""

METRICS = {
    "rmse": "RMSE [m/s²]",
    "pe": "PE",
    "sve": "SVE",
    "identified": "values identified of 6",
    "coverage": "coverage of identified",
    "interval_factor": "median factor of the 90 % intervals",
    "misfit": "misfit",
    "warned": "warned",
    "wall_s": "wall time [s]",
    "simulations": "simulations",
}


@dataclass(frozen=True)
class CalibrationStudySettings:
    """Recordings and methods of the study."""

    label: str = "normal"
    """Class of the recordings; a name in `FAULTS`."""
    pressure: float = MPa(10)
    """Discharge pressure of the held-out recording [Pa], and of the others unless a method takes
    all pressures (`Contender.every_pressure`).
    """
    specimens: int = 6
    """Pumps in each fleet."""
    repeats: int = 3
    """Recordings of each pump; the last one is held out."""
    contenders: tuple[str, ...] = tuple(CONTENDERS)
    """Names in `CONTENDERS`."""

    def __post_init__(self) -> None:
        if self.label not in FAULTS:
            raise InputError(f"Invalid label {self.label!r}: must be one of {', '.join(FAULTS)}.")
        if self.repeats < 2 or self.specimens < 1:
            raise InputError(
                f"repeats ({self.repeats}) must be at least 2, of which one is tested on, and "
                f"specimens ({self.specimens}) at least 1."
            )
        unknown = [name for name in self.contenders if name not in CONTENDERS]
        if unknown:
            raise InputError(
                f"Invalid methods {', '.join(unknown)}: must be among {', '.join(CONTENDERS)}."
            )


@dataclass(frozen=True, eq=False)
class _Pump:
    """Recordings of one pump by role, each with its run in the rig."""

    seed: int
    name: str
    train: list[tuple[Recording, Run]]
    """Recordings at the pressure of the held-out one."""
    other_pressures: list[tuple[Recording, Run]]
    """Recordings at the other pressures of the rig; empty if no method needs them."""
    held_out: tuple[Recording, Run]


def calibration(work: Work, settings: CalibrationStudySettings) -> StudyTable:
    """Return errors, coverage and cost of the nominal twin and of every way to calibrate.

    Each pump is a trial.

    Parameters
    ----------
    work : its seeds are fleets of the rig.
    settings : recordings and methods.
    """
    pumps: list[_Pump] = []
    for seed in work.seeds:
        pumps += _record_fleet(seed, settings, work.jobs)

    trials: list[Trial] = []
    intervals: list[dict[str, Any]] = []
    for pump_trials, pump_intervals in work.map(
        "pumps", _calibrate_pump, [(pump, settings) for pump in pumps]
    ):
        trials += pump_trials
        intervals += pump_intervals

    # The first pump has a trial of every twin, in the order of the table.
    names = list(dict.fromkeys(trial.factors["twin"] for trial in trials))
    trials.sort(key=lambda trial: names.index(trial.factors["twin"]))

    table = StudyTable(
        study="calibration",
        title="How near do calibrated twins come, and do their intervals hold the truth?",
        metrics=METRICS,
        trials=tuple(trials),
        answer=(),
        settings={
            **asdict(settings),
            "contenders": {
                name: {
                    "method": type(CONTENDERS[name].method).__name__,
                    "nuisances": asdict(CONTENDERS[name].nuisances),
                    "phases": CONTENDERS[name].phases,
                    "every_pressure": CONTENDERS[name].every_pressure,
                }
                for name in settings.contenders
            },
        },
        origin=describe_origin([pumps[0].held_out[0]]),
        notes=(
            f"Calibrated at {settings.pressure / 1e6:g} MPa on {settings.repeats - 1} recordings "
            "of each pump; at three pressures on as many at each.",
            "Factor of an interval: the root of its upper over its lower end. Warned: the share of "
            "pumps with a note that something may be wrong.",
            "Coverage of identified: the share of 90 % intervals of values called identified that "
            "hold the truth.",
            "RMSE and PE contain the recording's noise and the reassembly of the pump between two "
            "recordings: the rows of the rig's truth say how much no twin can explain.",
        ),
        details={"intervals": _summarize_intervals(settings.contenders, intervals)},
    )

    return replace(table, answer=_answer(table, names))


def _record_fleet(seed: int, settings: CalibrationStudySettings, jobs: int) -> list[_Pump]:
    size = RigSize(specimens=settings.specimens, repeats=settings.repeats)
    pairs = _record(seed, size, settings, (settings.pressure,), jobs)

    other_pairs: dict[str, list[tuple[Recording, Run]]] = {}
    if any(CONTENDERS[name].every_pressure for name in settings.contenders):
        others = tuple(pressure for pressure in PRESSURES if pressure != settings.pressure)
        fewer = replace(size, repeats=settings.repeats - 1)
        other_pairs = _record(seed, fewer, settings, others, jobs)

    return [
        _Pump(seed, name, train[:-1], other_pairs.get(name, []), train[-1])
        for name, train in pairs.items()
    ]


def _record(
    seed: int,
    size: RigSize,
    settings: CalibrationStudySettings,
    pressures: tuple[float, ...],
    jobs: int,
) -> dict[str, list[tuple[Recording, Run]]]:
    """Return recordings of each pump of a fleet at some pressures."""
    pairs = rig_recordings(seed, size, labels=(settings.label,), pressures=pressures, jobs=jobs)
    pairs_by_pump: dict[str, list[tuple[Recording, Run]]] = {}
    for recording, run in pairs:
        pairs_by_pump.setdefault(str(recording.specimen), []).append((recording, run))
    return pairs_by_pump


def _calibrate_pump(
    pump: _Pump, settings: CalibrationStudySettings
) -> tuple[list[Trial], list[dict[str, Any]]]:
    """Return a trial for each twin of a pump, and a row for each value of each calibration."""
    held_out, held_out_run = pump.held_out
    assert held_out.condition is not None
    fault = FAULTS[settings.label]
    nominal = Twin(load_pump("25scy14-1b"), held_out.condition, fault)

    trials = [Trial({"twin": "nominal"}, pump.seed, errors_on(held_out, nominal))]
    rows: list[dict[str, Any]] = []
    for name in settings.contenders:
        contender = CONTENDERS[name]
        pairs = pump.train
        if contender.every_pressure:
            pairs = [*pump.train, *pump.other_pressures]
        log_truth = np.mean([np.log(true_values(run)) for _, run in pairs], axis=0)

        calibration = calibrate(
            nominal.pump,
            [recording for recording, _ in pairs],
            fault=fault,
            method=contender.method,
            nuisances=contender.nuisances,
            phases=contender.phases,
            lines=contender.lines,
            explain_misfit=contender.explain_misfit,
            seed=pump.seed,
        )
        estimates = [
            _describe_estimate(pump, name, estimate, value)
            for estimate, value in zip(calibration.estimates, log_truth, strict=True)
        ]
        covered = [row["held"] for row in estimates if row["verdict"] == "identified"]
        values = {
            **errors_on(held_out, calibration.twin.at(held_out.condition)),
            "wall_s": calibration.wall_s,
            "simulations": float(calibration.simulations),
            "identified": float(len(covered)),
            "coverage": float(np.mean(covered)) if covered else float("nan"),
            "interval_factor": float(np.median([row["factor"] for row in estimates])),
            "misfit": calibration.misfit,
            "warned": float(any(is_warning(note) for note in calibration.notes)),
        }
        trials.append(Trial({"twin": name}, pump.seed, values))
        rows += estimates

    for name, run in (
        ("rig_truth_of_another_recording", pump.train[0][1]),
        ("rig_truth", held_out_run),
    ):
        trials.append(Trial({"twin": name}, pump.seed, _errors_of_truth(held_out, nominal, run)))

    return trials, rows


def _describe_estimate(
    pump: _Pump, method: str, estimate: Estimate, log_truth: float
) -> dict[str, Any]:
    low, high = estimate.interval
    truth = float(np.exp(log_truth))

    return {
        "seed": pump.seed,
        "specimen": pump.name,
        "twin": method,
        "symbol": estimate.symbol,
        "value": estimate.value,
        "interval": [low, high],
        "factor": float(np.sqrt(high / low)),
        "truth": truth,
        "held": bool(low <= truth <= high),
        "verdict": estimate.verdict,
        "off": float((np.log(estimate.value) - log_truth) / estimate.log_std),
    }


def errors_on(recording: Recording, twin: Twin) -> dict[str, float]:
    """Return RMSE, PE and SVE of a twin on a recording at its operating point."""
    (comparison,) = build_objective(twin, measure(twin, [recording])).comparisons
    amplitude = comparison.amplitude_of(twin)
    agreement, *_ = evaluate_agreement(comparison.measurement, twin, amplitude)

    return _errors(agreement)


def _errors_of_truth(recording: Recording, nominal: Twin, run: Run) -> dict[str, float]:
    """Return the errors of the rig's lines without noise, in place of a twin's."""
    measurement = measure(nominal, [recording])
    lines = sensor_lines(run)
    orders = np.arange(1, lines.shape[1] + 1)
    amplitude = np.abs(lines[:, measurement.orders - 1])
    agreement, *_ = evaluate_line_agreement(measurement, lines, orders, amplitude)

    return _errors(average_agreements([agreement]))


def _errors(agreement: Agreement) -> dict[str, float]:
    return {
        "rmse": agreement.rmse,
        "pe": agreement.peak_error,
        "sve": agreement.spectrum_value_error,
    }


def _summarize_intervals(names: Sequence[str], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the coverage of each way to calibrate over all pumps, and every single interval."""
    table: dict[str, Any] = {}
    for name in names:
        estimates = [row for row in rows if row["twin"] == name]
        identified = [row for row in estimates if row["verdict"] == "identified"]

        is_identified: dict[str, list[bool]] = {}
        for row in estimates:
            is_identified.setdefault(row["symbol"], []).append(row["verdict"] == "identified")
        by_symbol = {symbol: _share(hits) for symbol, hits in is_identified.items()}

        table[name] = {
            "values": len(estimates),
            "identified": len(identified),
            "held_of_identified": _share([row["held"] for row in identified]),
            "beyond_three_of_identified": _share([abs(row["off"]) > 3 for row in identified]),
            "held_of_all": _share([row["held"] for row in estimates]),
            "median_factor": _median_factor(estimates),
            "median_factor_of_identified": _median_factor(identified),
            "identified_by_symbol": by_symbol,
            "single": estimates,
        }

    return table


def _share(hits: Sequence[bool]) -> float | None:
    return float(np.mean(hits)) if hits else None


def _median_factor(rows: Sequence[dict[str, Any]]) -> float | None:
    return float(np.median([row["factor"] for row in rows])) if rows else None


def _answer(table: StudyTable, names: Sequence[str]) -> tuple[str, ...]:
    def over_nominal(name: str) -> str:
        """Return the mean errors over those of the nominal twin."""
        ratios = []
        for metric in _ERRORS:
            error = np.mean(table.values(metric, twin=name))
            nominal_error = np.mean(table.values(metric, twin="nominal"))
            ratios.append(f"{metric.upper()} {error / nominal_error:.2f}")

        return ", ".join(ratios)

    # The first row is the nominal twin, the last two are the rig's truth.
    sentences = []
    for name in names[1:-2]:
        sentences.append(f"{name} over nominal on recordings held out: {over_nominal(name)}.")
        pooled = table.details["intervals"][name]
        sentences[-1] += (
            f" {pooled['held_of_all']:.0%} of all {pooled['values']} intervals hold the truth; "
            f"their median factor is {pooled['median_factor']:.2g}."
        )
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
