"""The paper's identification on the page: errors, learning rates, values, and the loss of each epoch."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swashtwin.plot import figure_style, name_decades, panels, series_colors, words
from swashtwin.pump import PARAMETERS
from swashtwin.report import (
    Cell,
    Drawing,
    Picture,
    Table,
    number,
    render_drawing,
    tabulate,
)
from swashtwin_bench.paper.identification import CHOSEN, NOMINAL, PHASES_APART, SOLVED_BY_RK4, mean_parameters
from swashtwin_bench.results.contrasts import paired_interval
from swashtwin_bench.results.table import StudyTable
from swashtwin_bench.rigs.fleet import DISPERSION, FLEET_FACTORS

ERRORS = ("rmse", "pe", "sve")

_PRINTED_RATES = {CHOSEN: "chosen; best epoch 453 of 500"}
_PRINTED_VALUES = {
    "slipper_swash.damping": "1.86·10⁶ to 0.778·10⁶ N·s/m",
    "piston_bore.damping": "3.40·10⁴ to 15.3·10⁴ N·s/m",
}
_LETTERS = dict(zip(PARAMETERS, ("C_sw", "K_sw", "C_v", "K_v", "C_hz", "K_hz"), strict=True))
"""Letter of each value in the paper."""

_CUT = 2
"""The figure ends at so many times the median loss of epoch 1: single epochs of a high rate are far above."""


def identification_blocks(study: StudyTable) -> tuple[Any, ...]:
    """Tables and figure of the identification."""
    return (errors_table(study), rates_table(study), values_table(study), Picture(rates_drawing(study)))


def identification_sentence(study: StudyTable) -> str:
    """What became of each error by the paper's rate, beside its claim that all fall."""
    changes = [
        f"{name.upper()} {number(_mean(study, name, NOMINAL))} to {number(_mean(study, name, CHOSEN))}, "
        f"change {_change(study, name, CHOSEN).text}"
        for name in ERRORS
    ]
    return (
        f"IPINN at the paper's rate, errors on recordings held out: {'; '.join(changes)}; "
        f"n = {len(_pairs(study, ERRORS[0], CHOSEN))} pumps{_failed(study, CHOSEN)}. The paper: all three fall."
    )


def errors_table(study: StudyTable) -> Table:
    """RMSE, PE and SVE of every twin on the recordings held out."""
    twins = [row["twin"] for row in study.rows()]
    rows = tuple(
        (
            Cell(twin_words(twin)),
            Cell("all three fall" if twin == CHOSEN else ""),
            *(_spread(study, metric, twin) for metric in ERRORS),
            *(_change(study, metric, twin) for metric in ERRORS),
            Cell(f"{len(_pairs(study, ERRORS[0], twin))}{_failed(study, twin)}"),
        )
        for twin in twins
    )
    return Table(
        "Errors against recordings held out: mean ± standard deviation over n pumps, and what is added to the nominal "
        "twin's, paired by pump, with Student's 95 % interval.",
        (
            "twin",
            "the paper, its rig",
            *(study.metrics[metric] for metric in ERRORS),
            *(f"{metric.upper()} less nominal" for metric in ERRORS),
            "n",
        ),
        rows,
    )


def rates_table(study: StudyTable) -> Table:
    """Loss and best epoch of each learning rate."""
    rows = tuple(
        (
            Cell(twin_words(twin)),
            Cell(_PRINTED_RATES.get(twin, "")),
            *(_spread(study, metric, twin) for metric in ("first_loss", "loss", "best_epoch", "wall_s")),
        )
        for twin in _searched(study)
    )
    return Table(
        "Learning rates of the IPINN, the paper's grid: the loss on the recordings that are calibrated on.",
        ("twin", "the paper", *(study.metrics[metric] for metric in ("first_loss", "loss", "best_epoch", "wall_s"))),
        rows,
    )


def values_table(study: StudyTable) -> Table:
    """The six values: nominal, true and identified."""
    nominal, identified = mean_parameters(study, NOMINAL), mean_parameters(study, CHOSEN)
    rows = []
    for name, moved in zip(PARAMETERS, FLEET_FACTORS, strict=True):
        before = nominal[name][0]
        mean, factor = identified.get(name, (np.nan, np.nan))
        rows.append(
            (
                Cell(f"{_LETTERS[name]}, {words(name)}"),
                Cell(_PRINTED_VALUES.get(name, "not printed")),
                Cell(number(before)),
                Cell(f"{moved:g}"),
                Cell(f"{number(mean / before)} (× or ÷ {number(factor)})", f"{number(mean)} of {number(before)}"),
            )
        )
    return Table(
        "The six values [N·s/m, N/m]. True and identified ones are shares of the nominal one: the rig's mean, and the "
        "geometric mean over the pumps with the factor of one standard deviation. The rig's own factor is "
        f"{number(float(np.exp(DISPERSION)))}. The rig was built so that C_sw and C_hz move as the paper found: to "
        "agree with the paper proves nothing.",
        (
            "value",
            "the paper, empirical to identified",
            "nominal",
            "true / nominal",
            "identified / nominal, IPINN at the paper's rate",
        ),
        tuple(rows),
    )


@figure_style()
def rates_drawing(study: StudyTable) -> Drawing:
    """Loss of each epoch: for each learning rate the median over pumps, and the middle half of them."""
    curves = study.details["curves"]
    names = _searched(study)
    colors = series_colors(names)
    figure, axes = panels(1, 1, 3.6)
    panel = axes[0, 0]
    cut = 0.0
    for name in names:
        losses = _padded([curve["loss"] for curve in curves if curve["twin"] == name])
        epoch = np.arange(1, losses.shape[1] + 1)
        low, middle, high = np.nanpercentile(losses, (25, 50, 75), axis=0)
        style = "--" if name == SOLVED_BY_RK4 else "-"
        panel.fill_between(epoch, low, high, color=colors[name], alpha=0.12, linewidth=0)
        panel.plot(epoch, middle, style, color=colors[name], linewidth=1.5, label=twin_words(name))
        cut = max(cut, _CUT * float(middle[0]))
    panel.set(xlabel="epoch", ylabel="loss [m/s²]", yscale="log")
    if 0 < cut < panel.get_ylim()[1]:
        panel.set_ylim(top=cut)
    name_decades(panel)
    if names:
        figure.legend(loc="outside upper center", ncols=3)
    rows = [
        {"twin": curve["twin"], "seed": curve["seed"], "specimen": curve["specimen"], "epoch": epoch, "loss": loss}
        for curve in curves
        for epoch, loss in enumerate(curve["loss"], 1)
    ]
    return render_drawing(
        f"{study.study.replace('-', '_')}_rates",
        figure,
        tabulate(rows),
        title="Loss of the IPINN by learning rate",
        caption="Spectrum loss and boundary loss together: the median over pumps, and the 25th to 75th percentile. "
        f"Cut at {_CUT} times the median loss of epoch 1; {_steepest(study)}.",
    )


def twin_words(twin: str) -> str:
    """Name of a way to identify in words."""
    if twin == SOLVED_BY_RK4:
        return f"{twin_words(CHOSEN)}, RK4"
    if twin in PHASES_APART:
        return f"Gauss-Newton, {'with' if twin == PHASES_APART[1] else 'without'} phases"
    return f"IPINN, rate {twin.removeprefix('ipinn_')}" if twin.startswith("ipinn_") else words(twin)


def _padded(curves: Sequence[Sequence[float]]) -> np.ndarray:
    """(curve, epoch) with NaN after the end of a shorter curve."""
    padded = np.full((len(curves), max(map(len, curves))), np.nan)
    for row, curve in zip(padded, curves, strict=True):
        row[: len(curve)] = curve
    return padded


def _steepest(study: StudyTable) -> str:
    """How far the losses of single epochs rise, in words."""
    rises: dict[str, float] = {}
    for curve in study.details["curves"]:
        rise = max(curve["loss"]) / curve["loss"][0]
        rises[curve["twin"]] = max(rise, rises.get(curve["twin"], 0.0))
    said = ", ".join(f"{number(rise)} ({twin_words(twin)})" for twin, rise in rises.items())
    return f"single epochs reach at most so many times the first loss of their pump: {said or 'none'}"


def _searched(study: StudyTable) -> list[str]:
    """Twins of searches in epochs."""
    return list(dict.fromkeys(curve["twin"] for curve in study.details["curves"]))


def _finite(study: StudyTable, metric: str, twin: str) -> list[float]:
    return [value for value in study.values(metric, twin=twin) if np.isfinite(value)]


def _mean(study: StudyTable, metric: str, twin: str) -> float:
    return float(np.mean(_finite(study, metric, twin) or [np.nan]))


def _pairs(study: StudyTable, metric: str, twin: str) -> list[float]:
    """What a twin's error has above that of the nominal twin, for each pump whose search ended."""
    pairs = zip(study.values(metric, twin=twin), study.values(metric, twin=NOMINAL), strict=True)
    return [after - before for after, before in pairs if np.isfinite(after - before)]


def _failed(study: StudyTable, twin: str) -> str:
    """How many searches failed, in words; empty where none did."""
    failed = len(study.of(twin=twin)) - len(_pairs(study, ERRORS[0], twin))
    return f", {failed} failed" if failed else ""


def _change(study: StudyTable, metric: str, twin: str) -> Cell:
    """Difference from the nominal twin."""
    if twin == NOMINAL:
        return Cell("")
    differences = _pairs(study, metric, twin)
    if not differences:
        return Cell("—", "no number: the search failed")
    low, high = paired_interval(differences)
    interval = f" ({low:+.3f} to {high:+.3f})" if low == low else ""
    return Cell(f"{float(np.mean(differences)):+.3f}{interval}", f"{len(differences)} pumps")


def _spread(study: StudyTable, metric: str, twin: str) -> Cell:
    values = _finite(study, metric, twin)
    if not values:
        return Cell("—", "no number: the search failed, or has none")
    deviation = f" ± {number(float(np.std(values, ddof=1)))}" if len(values) > 1 else ""
    return Cell(f"{number(float(np.mean(values)))}{deviation}", ", ".join(map(number, values)))
