"""The paper's identification: loss curves, RMSE, PE and SVE of the IPINN at each learning rate.

Each pump of a fleet is calibrated on its recordings of the swash plate fault at one pressure except
the last, on which the errors are measured. Two Gauss-Newton searches that differ only in the phases
of the lines show how the RMSE of the waveform depends on whether phases are compared.
"""

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
"""Discharge pressure of the recordings that are calibrated on [Pa]."""
NOMINAL = "nominal"
LOWEST_RATE = f"ipinn_{min(PAPER_RATES):g}"
"""The paper's choice: the least rate of its grid."""

METRICS = {
    "rmse": "RMSE [m/s²]",
    "pe": "PE",
    "sve": "SVE",
    "loss": "least loss [m/s²]",
    "first_loss": "loss of epoch 1 [m/s²]",
    "best_epoch": "best epoch",
    "wall_s": "time of one search [s]",
}

_PRINTED = {
    "slipper_swash.damping": "1.86·10⁶ to 0.778·10⁶ N·s/m",
    "piston_bore.damping": "3.40·10⁴ to 15.3·10⁴ N·s/m",
}

# Letter of each value in the paper.
_LETTERS = dict(zip(PARAMETERS, ("C_sw", "K_sw", "C_v", "K_v", "C_hz", "K_hz"), strict=True))

# The figure ends at so many times the median loss of epoch 1: single epochs of a high rate are far
# above.
_CUT = 2


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
    pumps = [pump for seed in work.seeds for pump in _pumps(fleet(seed), seed)]
    cases = [
        (name, contender, pump, work.out)
        for name, contender in methods(size).items()
        for pump in pumps
    ]
    runs = work.map("searches", _run, cases)
    results = [(name, pump, run) for (name, _, pump, _), run in zip(cases, runs, strict=True)]
    refusals = dict.fromkeys(
        f"{name}: {run['refusal']}" for name, _, run in results if "refusal" in run
    )

    def named(key: str) -> list[tuple[dict[str, Any], Any]]:
        return [
            ({"twin": n, "seed": p.seed, "specimen": p.name}, run[key])
            for n, p, run in results
            if run.get(key)
        ]

    study = StudyTable(
        study=STUDY,
        title="The paper's identification: learning rates of the IPINN, and errors of the twin",
        metrics=METRICS,
        trials=tuple(
            Trial(
                {"twin": name},
                pump.seed,
                {metric: run[metric] for metric in METRICS if metric in run},
            )
            for name, pump, run in results
        ),
        answer=(),
        settings={
            "label": LABEL,
            "pressure_Pa": PRESSURE,
            "methods": {n: repr(c) for n, c in methods(size).items()},
        },
        origin=describe_origin([pumps[0].held_out]),
        command=work.command,
        notes=(
            "RMSE, PE and SVE are those on a recording that was held out, of the same pump, fault "
            "and pressure; the paper measures them on the recordings that it identifies from. The "
            "loss is that of the recordings calibrated on. The RMSE of the waveform need not fall: "
            "the spectrum loss drops the phase.",
            *refusals,
        ),
        details={
            "curves": [{**names, "loss": loss} for names, loss in named("curve")],
            "parameters": [
                {**names, **dict(zip(PARAMETERS, six, strict=True))}
                for names, six in named("parameters")
            ],
        },
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
        before, after = (
            np.array(study.values(metric, twin=twin)) for twin in (NOMINAL, LOWEST_RATE)
        )
        pairs = (after - before)[np.isfinite(after - before)]
        low, high = paired_interval(pairs.tolist())
        interval = f" ({low:+.3f} to {high:+.3f})" if low == low else ""
        change = f"change {pairs.mean():+.3f}{interval}" if pairs.size else "no search ended"
        changes.append(
            f"{metric.upper()} {format_number(float(np.nanmean(before)))} in the nominal twin, "
            f"{change}"
        )
    failed = len(study.select(twin=LOWEST_RATE)) - pairs.size
    return (
        f"IPINN at the paper's rate, errors on recordings held out: {'; '.join(changes)}; n = "
        f"{pairs.size} pumps{f', {failed} failed' if failed else ''}. The paper: all three fall; "
        "best epoch 453 of 500."
    )


def values_table(study: StudyTable) -> Table:
    """Return the six values: nominal, true and identified."""

    def logarithms(twin: str, name: str) -> np.ndarray:
        return np.log([row[name] for row in study.details["parameters"] if row["twin"] == twin])

    rows = []
    for name, moved in zip(PARAMETERS, FLEET_FACTORS, strict=True):
        before, found = (
            float(np.exp(logarithms(NOMINAL, name).mean())),
            logarithms(LOWEST_RATE, name),
        )
        identified = "every search failed"
        if found.size:
            spread = (
                f" (× or ÷ {format_number(float(np.exp(found.std(ddof=1))))})"
                if found.size > 1
                else ""
            )
            identified = f"{format_number(float(np.exp(found.mean())) / before)}{spread}"
        printed = _PRINTED.get(name, "not printed")
        rows.append(
            tuple(
                map(
                    Cell,
                    (
                        f"{_LETTERS[name]}, {format_label(name)}",
                        printed,
                        format_number(before),
                        f"{moved:g}",
                        identified,
                    ),
                )
            )
        )
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
    cut = 0.0
    rises = []

    for name in names:
        # Curves may have different lengths: the rest is NaN, which percentiles skip.
        pump_losses = [curve["loss"] for curve in curves if curve["twin"] == name]
        losses = np.full((len(pump_losses), max(map(len, pump_losses))), np.nan)
        for row, loss in zip(losses, pump_losses, strict=True):
            row[: len(loss)] = loss

        epoch = np.arange(1, losses.shape[1] + 1)
        low, middle, high = np.nanpercentile(losses, (25, 50, 75), axis=0)
        panel.fill_between(epoch, low, high, color=colors[name], alpha=0.12, linewidth=0)
        panel.plot(epoch, middle, color=colors[name], linewidth=1.5, label=format_label(name))

        cut = max(cut, _CUT * float(middle[0]))
        rise = max(max(loss) / loss[0] for loss in pump_losses)
        rises.append(f"{format_number(rise)} ({format_label(name)})")

    panel.set(xlabel="epoch", ylabel="loss [m/s²]", yscale="log")
    if 0 < cut < panel.get_ylim()[1]:
        panel.set_ylim(top=cut)
    label_log_axis(panel.yaxis)
    if names:
        figure.legend(loc="outside upper center", ncols=3)

    rows = []
    for curve in curves:
        factors = {name: curve[name] for name in ("twin", "seed", "specimen")}
        for number, loss in enumerate(curve["loss"], 1):
            rows.append({**factors, "epoch": number, "loss": loss})

    return render_drawing(
        f"{study.study.replace('-', '_')}_rates",
        figure,
        tabulate(rows),
        title="Loss of the IPINN by learning rate",
        caption="Spectrum loss and boundary loss together: the median over pumps, and the 25th to "
        f"75th percentile. Cut at {_CUT} times the median loss of epoch 1; single epochs reach at most so many "
        f"times the first loss of their pump: {', '.join(rises) or 'none'}.",
    )
