"""The paper's identification: loss curves, RMSE, PE and SVE of the IPINN at each learning rate.

Each pump of a fleet is calibrated on its recordings of the swash plate fault at one pressure except
the last, on which the errors are measured. Two Gauss-Newton searches that differ only in the phases
of the lines show how the RMSE of the waveform depends on whether phases are compared.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.calibration import IPINN, PAPER_RATES, calibrate
from swashtwin.foundation import DataError, InputError, MPa
from swashtwin.physics import RK4, Twin
from swashtwin.plot import create_panels, figure_style, format_label, label_log_axis, series_colors
from swashtwin.pump import PARAMETERS, PRESSURE_TOLERANCE, load_pump, values_match
from swashtwin.recordings import Recording
from swashtwin.report import Cell, Drawing, Table, format_number, render_drawing, tabulate
from swashtwin_bench.questions.calibration import CONTENDERS, FAULTS, Contender, errors_on
from swashtwin_bench.results.reported import PAPER_STUDY
from swashtwin_bench.results.runs import Task, Work, fingerprint_recordings
from swashtwin_bench.results.table import StudyTable, Trial, describe_origin, paired_interval
from swashtwin_bench.rigs.fleet import DISPERSION, FLEET_FACTORS

STUDY = f"{PAPER_STUDY}identification"
LABEL = "swash_plate"
PRESSURE = MPa(15)
"""Discharge pressure of the recordings of the study [Pa]."""
NOMINAL = "nominal"
LOWEST_RATE = f"ipinn_{min(PAPER_RATES):g}"
"""The search at the rate that the paper selects: the lowest of its grid."""

METRICS = {
    "rmse": "RMSE [m/s²]",
    "pe": "PE",
    "sve": "SVE",
    "loss": "least loss [m/s²]",
    "first_loss": "loss of epoch 1 [m/s²]",
    "best_epoch": "best epoch",
    "wall_s": "time of one search [s]",
}

# Values that the paper prints, empirical to identified.
_PRINTED = {
    "slipper_swash.damping": "1.86·10⁶ to 0.778·10⁶ N·s/m",
    "piston_bore.damping": "3.40·10⁴ to 15.3·10⁴ N·s/m",
}

# Symbol of each value in the paper.
_SYMBOLS = dict(zip(PARAMETERS, ("C_sw", "K_sw", "C_v", "K_v", "C_hz", "K_hz"), strict=True))

# Top of the figure, as a multiple of the median loss of epoch 1: single epochs of a high rate lie
# far above.
_MAX_DRAWN_LOSS = 2


@dataclass(frozen=True, eq=False)
class _Pump:
    """One pump's recordings by role."""

    seed: int
    name: str
    train: tuple[Recording, ...]
    held_out: Recording


def methods(size: str) -> dict[str, Contender | None]:
    """Return the ways to identify the six values, by name; `None` for the nominal ones.

    At the paper's size there is also an IPINN with the steady state of RK4 inside the loss, which
    is solved by lines and not step by step.
    """
    ways: dict[str, Contender | None] = {NOMINAL: None}
    for rate in PAPER_RATES:
        ways[f"ipinn_{rate:g}"] = Contender(IPINN(learning_rate=rate))
    if size == "paper":
        ways["ipinn_rk4"] = Contender(IPINN(solver=RK4()))

    # These two differ only in the phases.
    for name in ("gauss_newton_housing", "gauss_newton_housing_phases"):
        ways[name] = CONTENDERS[name]

    # The paper compares spectra, which have more than the lines of the pistons.
    lowest_rate = Contender(IPINN(learning_rate=min(PAPER_RATES)))
    ways[f"{LOWEST_RATE}_spectrum"] = replace(lowest_rate, lines="spectrum")
    housing = CONTENDERS["gauss_newton_housing"]
    ways["gauss_newton_housing_spectrum"] = replace(housing, lines="spectrum")

    return ways


def run_identification(
    work: Work, size: str, fleet: Callable[[int], Sequence[Recording]]
) -> StudyTable:
    """Return the errors of every way to identify the six values, and the loss of each epoch.

    Each pump is a trial.

    Parameters
    ----------
    work : its seeds are fleets.
    size : name of a size of the paper's plans.
    fleet : recordings of a seed.

    Raises
    ------
    DataError
        No pump has two recordings of the fault at the pressure.
    """
    pumps: list[_Pump] = []
    for seed in work.seeds:
        pumps.extend(_pumps(fleet(seed), seed))

    searches = methods(size)
    cases: list[tuple[str, Contender | None, _Pump, Path | None]] = []
    for name, contender in searches.items():
        cases.extend((name, contender, pump, work.out) for pump in pumps)

    trials = []
    refusals = []
    curves = []
    parameters = []
    runs = work.map("searches", _run, cases)
    for (name, _, pump, _), run in zip(cases, runs, strict=True):
        values = {metric: run[metric] for metric in METRICS if metric in run}
        trials.append(Trial({"twin": name}, pump.seed, values))

        factors = {"twin": name, "seed": pump.seed, "specimen": pump.name}
        if "refusal" in run:
            refusals.append(f"{name}: {run['refusal']}")
        if run.get("curve"):
            curves.append({**factors, "loss": run["curve"]})
        if run.get("parameters"):
            estimates = dict(zip(PARAMETERS, run["parameters"], strict=True))
            parameters.append({**factors, **estimates})

    study = StudyTable(
        study=STUDY,
        title="The paper's identification: learning rates of the IPINN, and errors of the twin",
        metrics=METRICS,
        trials=tuple(trials),
        answer=(),
        settings={
            "label": LABEL,
            "pressure_Pa": PRESSURE,
            "methods": {name: repr(contender) for name, contender in searches.items()},
        },
        origin=describe_origin([pumps[0].held_out]),
        command=work.command,
        notes=(
            "RMSE, PE and SVE are those on a recording that was held out, of the same pump, fault "
            "and pressure; the paper measures them on the recordings that it identifies from. The "
            "loss is that of the recordings calibrated on. The RMSE of the waveform need not fall: "
            "the spectrum loss drops the phase.",
            # Searches of several pumps can fail for the same reason.
            *dict.fromkeys(refusals),
        ),
        details={"curves": curves, "parameters": parameters},
    )
    return replace(study, answer=(_sentence(study),))


def _pumps(recordings: Sequence[Recording], seed: int) -> list[_Pump]:
    """Return the pumps that have at least two recordings of the fault at the pressure."""
    by_pump: dict[str, list[Recording]] = {}
    for recording in sorted(recordings, key=lambda recording: recording.recording_id):
        condition = recording.condition
        if recording.label != LABEL or condition is None:
            continue
        if values_match(condition.discharge_pressure, PRESSURE, PRESSURE_TOLERANCE):
            by_pump.setdefault(str(recording.specimen), []).append(recording)

    pumps = []
    for name, (*train, held_out) in by_pump.items():
        if train:
            pumps.append(_Pump(seed, name, tuple(train), held_out))
    if not pumps:
        raise DataError(
            f"no pump has two recordings of {LABEL} at {PRESSURE / 1e6:g} MPa, one to calibrate on "
            "and one to test on."
        )
    return pumps


def _run(name: str, contender: Contender | None, pump: _Pump, out: Path | None) -> dict[str, Any]:
    factors = {"twin": name, "specimen": pump.name}
    data = fingerprint_recordings([*pump.train, pump.held_out])
    task = Task(STUDY, pump.seed, factors, {"contender": repr(contender)}, data)
    return task.run(out, lambda: _values(contender, pump))


def _values(contender: Contender | None, pump: _Pump) -> dict[str, Any]:
    """Return errors, losses and values of one search, or only the reason if it failed."""
    condition = pump.held_out.condition
    assert condition is not None  # by which the recording was selected

    nominal = Twin(load_pump("25scy14-1b"), condition, FAULTS[LABEL])
    if contender is None:
        return {**errors_on(pump.held_out, nominal), "parameters": nominal.values.tolist()}

    try:
        calibration = calibrate(
            nominal,
            list(pump.train),
            method=contender.method,
            nuisances=contender.nuisances,
            phases=contender.phases,
            lines=contender.lines,
            explain_misfit=False,
            seed=pump.seed,
        )
    except InputError as cause:
        return {"refusal": str(cause)}

    values = {
        **errors_on(pump.held_out, calibration.twin),
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
        "best_epoch": float(calibration.history.best_step + 1),
        "curve": np.asarray(loss).tolist(),
    }


def _sentence(study: StudyTable) -> str:
    """Return the change of each error at the paper's rate, next to its claim that all fall."""
    changes = []
    for metric in ("rmse", "pe", "sve"):
        nominal_errors = np.array(study.values(metric, twin=NOMINAL))
        calibrated_errors = np.array(study.values(metric, twin=LOWEST_RATE))
        differences = calibrated_errors - nominal_errors

        # A search that failed has no error.
        differences = differences[np.isfinite(differences)]
        nominal_mean = format_number(float(np.nanmean(nominal_errors)))
        changes.append(
            f"{metric.upper()} {nominal_mean} in the nominal twin, {_describe_change(differences)}"
        )

    failed = len(study.select(twin=LOWEST_RATE)) - differences.size
    failures = f", {failed} failed" if failed else ""
    return (
        f"IPINN at the paper's rate, errors on recordings held out: {'; '.join(changes)}; n = "
        f"{differences.size} pumps{failures}. The paper: all three fall; best epoch 453 of 500."
    )


def _describe_change(differences: np.ndarray) -> str:
    """Return the mean of paired differences, with its interval if there are two or more."""
    if not differences.size:
        return "no search ended"

    change = f"change {differences.mean():+.3f}"
    low, high = paired_interval(differences.tolist())
    if math.isnan(low):
        return change
    return f"{change} ({low:+.3f} to {high:+.3f})"


def values_table(study: StudyTable) -> Table:
    """Return the six values: nominal, true and identified."""
    rows = []
    for name, true_factor in zip(PARAMETERS, FLEET_FACTORS, strict=True):
        nominal = float(np.exp(_log_values(study, NOMINAL, name).mean()))
        cells = (
            f"{_SYMBOLS[name]}, {format_label(name)}",
            _PRINTED.get(name, "not printed"),
            format_number(nominal),
            f"{true_factor:g}",
            _describe_identified(_log_values(study, LOWEST_RATE, name), nominal),
        )
        rows.append(tuple(Cell(text) for text in cells))

    return Table(
        "The six values [N·s/m, N/m]. True and identified ones are shares of the nominal one: the "
        "rig's mean, and the geometric mean over the pumps with the factor of one standard "
        f"deviation. The rig's own factor is {format_number(float(np.exp(DISPERSION)))}. The rig "
        "was built so that C_sw and C_hz move as the paper found: to agree with the paper proves "
        "nothing.",
        (
            "value",
            "the paper, empirical to identified",
            "nominal",
            "true / nominal",
            "identified / nominal",
        ),
        tuple(rows),
    )


def _log_values(study: StudyTable, twin: str, name: str) -> np.ndarray:
    """Return the logarithms of a value in each pump's twin."""
    return np.log([row[name] for row in study.details["parameters"] if row["twin"] == twin])


def _describe_identified(log_values: np.ndarray, nominal: float) -> str:
    """Return the geometric mean as a share of the nominal value, and the spread as a factor."""
    if not log_values.size:
        return "every search failed"

    share = format_number(float(np.exp(log_values.mean())) / nominal)
    if log_values.size == 1:
        return share
    return f"{share} (× or ÷ {format_number(float(np.exp(log_values.std(ddof=1))))})"


@figure_style()
def rates_drawing(study: StudyTable) -> Drawing:
    """Return the loss of each epoch by learning rate.

    A curve is the median over the pumps, its band the middle half.
    """
    curves = study.details["curves"]
    names = list(dict.fromkeys(curve["twin"] for curve in curves))
    colors = series_colors(names)
    figure, axes = create_panels(1, 1, 3.6)
    panel = axes[0, 0]
    top = 0.0
    rises = []

    for name in names:
        pump_losses = [curve["loss"] for curve in curves if curve["twin"] == name]
        low, middle, high = _loss_quartiles(pump_losses)
        epochs = np.arange(1, len(middle) + 1)
        panel.fill_between(epochs, low, high, color=colors[name], alpha=0.12, linewidth=0)
        panel.plot(epochs, middle, color=colors[name], linewidth=1.5, label=format_label(name))

        top = max(top, _MAX_DRAWN_LOSS * float(middle[0]))
        rise = max(max(loss) / loss[0] for loss in pump_losses)
        rises.append(f"{format_number(rise)} ({format_label(name)})")

    panel.set(xlabel="epoch", ylabel="loss [m/s²]", yscale="log")
    if 0 < top < panel.get_ylim()[1]:
        panel.set_ylim(top=top)
    label_log_axis(panel.yaxis)
    if names:
        figure.legend(loc="outside upper center", ncols=3)

    rows = []
    for curve in curves:
        factors = {name: curve[name] for name in ("twin", "seed", "specimen")}
        for epoch, loss in enumerate(curve["loss"], 1):
            rows.append({**factors, "epoch": epoch, "loss": loss})

    return render_drawing(
        f"{study.study.replace('-', '_')}_rates",
        figure,
        tabulate(rows),
        title="Loss of the IPINN by learning rate",
        caption=(
            "Spectrum loss and boundary loss together: the median over pumps, and the 25th to 75th "
            f"percentile. Cut at {_MAX_DRAWN_LOSS} times the median loss of epoch 1. Highest loss "
            "of a single epoch, as a multiple of the first loss of its pump: "
            f"{', '.join(rises) or 'none'}."
        ),
    )


def _loss_quartiles(pump_losses: Sequence[Sequence[float]]) -> np.ndarray:
    """Return the 25th, 50th and 75th percentile of the loss over the pumps, by epoch."""
    # Curves may have different lengths: the rest is NaN, which the percentiles skip.
    losses = np.full((len(pump_losses), max(map(len, pump_losses))), np.nan)
    for row, loss in zip(losses, pump_losses, strict=True):
        row[: len(loss)] = loss
    return np.nanpercentile(losses, (25, 50, 75), axis=0)
