"""Part of the page about a calibration, with its figures: waveforms, spectra, search, estimates."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, MultipleLocator

from swashtwin.calibration import VALUE_SLICE, Calibration, Estimate, Fit, Spectra
from swashtwin.foundation import plural
from swashtwin.plot import (
    CALIBRATED,
    INTERFACE_COLORS,
    LIGHT,
    MEASURED,
    NOMINAL,
    create_panels,
    figure_style,
    format_label,
    label_log_axis,
)
from swashtwin.pump import PARAMETERS
from swashtwin.recordings import RecordingSummary
from swashtwin.report.drawing import Drawing, render_drawing
from swashtwin.report.page import Bullets, Group, Part, Section, SectionOrder, Table
from swashtwin.report.wording import (
    add_bar_values,
    build_facts_table,
    end_sentence,
    flatten_settings,
    format_number,
    format_number_cell,
    format_parameter,
    format_percent,
    rig_notice,
)

FIGURES = MappingProxyType(
    {
        "rmse": "RMSE of the waveforms [m/s²]",
        "relative_rmse": "RMSE over the RMS of the measured waveform",
        "peak_error": "PE, peak error",
        "spectrum_value_error": "SVE, spectrum value error",
        "spectral_correlation": "correlation of the lines' levels in dB",
    }
)
"""How well a twin fits its recordings, by name: in words."""


def build_calibration_part(calibration: Calibration, key: str) -> Part:
    """Part of the page about one calibration."""
    counts = Counter(estimate.verdict for estimate in calibration.estimates)
    change = _change(calibration, "spectrum_value_error")
    has_improved = (
        calibration.calibrated_agreement.spectrum_value_error
        < calibration.nominal_agreement.spectrum_value_error
    )
    provenance = build_facts_table(
        "How the calibration was made.",
        [
            ("method", calibration.method),
            *flatten_settings(calibration.settings),
            ("condition", describe_conditions(calibration)),
            ("simulations", calibration.simulations),
            ("time taken", f"{format_number(calibration.wall_s)} s"),
            ("swashtwin version", calibration.version),
            ("calibration recordings", list(calibration.recording_ids)),
        ],
    )
    more = Bullets("More to know", tuple(map(end_sentence, calibration.notes[_MOST_NOTES:])))
    return Part(
        title=f"Calibration of {calibration.twin.pump.name}",
        answer=summarize_calibration(calibration)[:1],
        notice=rig_notice(RecordingSummary(origin=calibration.origin)),
        sections=(
            Section(
                SectionOrder.CALIBRATION,
                "Calibration",
                (more, *build_calibration_blocks(calibration, key)[1:]),
            ),
            Section(SectionOrder.PROVENANCE, "Where the calibration comes from", (provenance,)),
        ),
        results={"calibrations": [calibration.to_dict()]},
        verdict=f"Spectrum error {change}; {counts['identified']} of 6 values identified",
        tone="bad" if not has_improved else "good" if counts["identified"] >= _ENOUGH else "unsure",
        certainty=(
            *summarize_calibration(calibration)[:0:-1],
            *map(end_sentence, calibration.notes[:_MOST_NOTES]),
        ),
        actions=_actions(calibration, has_improved),
        facts=(
            ("Pump", calibration.twin.pump.name),
            ("Condition", add_bar_values(describe_conditions(calibration))),
            ("Method", calibration.method),
            ("Recordings", str(len(calibration.recording_ids))),
        ),
    )


_ENOUGH, _MOST_NOTES = 3, 3


def _actions(calibration: Calibration, has_improved: bool) -> tuple[str, ...]:
    """What to do with the result."""
    if not has_improved:
        return (
            "Do not use this twin: check speed, pressure, units and the pump's parameters first.",
        )
    weak = [
        estimate.symbol for estimate in calibration.estimates if estimate.verdict != "identified"
    ]
    caution = (
        (
            f"Do not read {', '.join(weak)} as measured values of the pump; swashtwin twin next says which recording "
            "would tell most of them.",
        )
        if weak
        else ()
    )
    if len(weak) == len(calibration.estimates):
        return (
            *caution,
            "Do not synthesize with this twin before its misfit is explained: see the notes.",
        )
    return (*caution, "Use the twin for recordings nobody has: swashtwin synthesize.")


def summarize_calibration(calibration: Calibration) -> tuple[str, ...]:
    """What came out, in plain words."""
    spectrum, waveform = (_change(calibration, name) for name in ("spectrum_value_error", "rmse"))
    return (
        f"The twin of {calibration.twin.pump.name} ({describe_conditions(calibration)}, "
        f"{format_label(calibration.twin.label)}) "
        f"was calibrated with {calibration.method} on {plural(len(calibration.recording_ids), 'recording')}. The error "
        f"of its spectrum (SVE) {spectrum}; that of its waveform (RMSE) {waveform} m/s².",
        "These are the recordings it was calibrated on, so neither number is a test.",
        f"Of the six values {describe_verdicts(calibration)}.",
    )


def _change(calibration: Calibration, name: str) -> str:
    before, after = (
        getattr(fit, name)
        for fit in (calibration.nominal_agreement, calibration.calibrated_agreement)
    )
    verb = "fell" if after < before else "ROSE" if after > before else "stayed"
    return f"{verb} from {format_number(before)} to {format_number(after)}"


def describe_verdicts(calibration: Calibration) -> str:
    """How many values have which verdict, such as ``"4 are identified, 2 are weak"``."""
    counts = Counter(estimate.verdict for estimate in calibration.estimates)
    named = [
        f"{count} {'is' if count == 1 else 'are'} {verdict.replace('at bound', 'at a bound')}"
        for verdict, count in counts.most_common()
    ]
    return ", ".join(named)


def describe_conditions(calibration: Calibration) -> str:
    """Speed and pressure of the twin, or of every operating point where several were fitted
    together.
    """
    several = len(calibration.fits) > 1
    points: dict[str, list[str]] = {}
    for condition in (
        [fit.condition for fit in calibration.fits] if several else [calibration.twin.condition]
    ):
        speed = f"{condition.speed * 30 / math.pi:.4g} rev/min"
        points.setdefault(speed, []).append(f"{condition.discharge_pressure / 1e6:.3g}")
    return "; ".join(
        f"{speed}, {' and '.join(pressures)} MPa" for speed, pressures in points.items()
    )


def build_calibration_blocks(calibration: Calibration, key: str) -> tuple:
    """Notes, tables and figures of one calibration."""
    pictures = calibration_drawings(calibration, key)
    excluded_recordings = tuple(
        f"{name}: {reason}" for name, reason in calibration.excluded_recordings
    )
    title = (
        f"Recordings: {len(calibration.recording_ids)} used, {len(excluded_recordings)} left out"
    )
    recordings = (
        Bullets("Used", calibration.recording_ids),
        Bullets("Left out", excluded_recordings),
    )
    tables = fit_table(calibration), estimates_table(calibration), directions_table(calibration)
    notes = Bullets("Look at this first", calibration.notes)
    return (notes, *tables, *pictures, Group(title, recordings, is_open=False))


def fit_table(calibration: Calibration) -> Table:
    """RMSE, PE and SVE before and after."""
    before, after = asdict(calibration.nominal_agreement), asdict(calibration.calibrated_agreement)
    rows = []
    for name, label in FIGURES.items():
        share = calibration.improvement.get(name, math.nan) if before[name] else math.nan
        change = (
            f"{'−' if share > 0 else '+'}{format_percent(abs(share))}"
            if math.isfinite(share)
            else "—"
        )
        rows.append(
            (label, format_number_cell(before[name]), format_number_cell(after[name]), change)
        )
    return Table(
        "Difference between the twin and the recordings it was calibrated on. Errors: smaller is better. Correlation: "
        "1 is a spectrum of the same shape, whatever its level.",
        ("", "before (nominal)", "after (calibrated)", "change"),
        tuple(rows),
    )


def estimates_table(calibration: Calibration) -> Table:
    """The six values with intervals and verdicts."""
    rows = []
    for estimate in calibration.estimates:
        traded = f", traded with {estimate.correlated_with}" if estimate.correlated_with else ""
        unit = estimate.unit.replace("*", "·")
        name = f"{estimate.symbol}, {format_parameter(estimate.name)} [{unit}]"
        values = format_number_cell(estimate.nominal), format_number_cell(estimate.value)
        rows.append((name, *values, describe_interval(estimate), f"{estimate.verdict}{traded}"))
    return Table(
        "The six values. Identified: 90 % within a factor of 1.5. Weak: less certain. Not identified: the measurement "
        "adds little to the bounds. At bound: a bound stopped the search, often because a constant is wrong. "
        "Traded: the two can change together at almost the same spectrum.",
        ("value", "nominal", "calibrated", "90 % interval", "verdict"),
        tuple(rows),
    )


def directions_table(calibration: Calibration) -> Table:
    """Independent combinations of the six values."""
    posterior, letters = (
        calibration.posterior,
        tuple(estimate.symbol for estimate in calibration.estimates),
    )
    prior = posterior.unknowns.deviation[VALUE_SLICE]
    variance, directions = np.linalg.eigh(
        posterior.covariance[VALUE_SLICE, VALUE_SLICE] / np.outer(prior, prior)
    )
    directions = directions * np.sign(
        directions[np.abs(directions).argmax(axis=0), range(len(letters))]
    )
    rows = [
        (format_percent(math.sqrt(max(left, 0.0))), *(f"{weight:+.2f}" for weight in direction))
        for left, direction in zip(variance, directions.T, strict=True)
    ]
    return Table(
        "Independent combinations of the six values, the best known first: what is left of the width that was assumed "
        "before, and how much of each value's logarithm is in it.",
        ("width left", *letters),
        tuple(rows),
    )


def describe_interval(estimate: Estimate) -> str:
    """The interval in words; an end set by the bound alone is no limit."""
    low, high = (format_number(end) for end in estimate.interval)
    sentences = {
        (False, False): f"{low} to {high}",
        (True, False): f"at most {high}",
        (False, True): f"at least {low}",
        (True, True): "no limits within the bounds",
    }
    return sentences[estimate.open_sides]


_RANGE_DB = 60.0
"""Spectra are shown so far below their strongest line [dB], or to their weakest, whichever is
less.
"""


def calibration_drawings(calibration: Calibration, key: str) -> list[Drawing]:
    """Every figure of a calibration, in the order of the page; the name of each file begins with
    `key`.
    """
    figures: list[Drawing] = []
    band = calibration.settings.get("band", (math.nan, math.nan))
    for fit in calibration.fits:
        prefix = (
            f"{key}_{fit.condition.discharge_pressure / 1e6:.4g}_mpa"
            if len(calibration.fits) > 1
            else key
        )
        figures += [waveforms(fit, prefix, band), spectra(fit, prefix)]
    return [*figures, estimates(calibration, key), draw_search(calibration, key)]


@figure_style()
def waveforms(fit: Fit, key: str, band: Sequence[float]) -> Drawing:
    """One revolution measured, with the twin before (left) and after (right), a row for each
    sensor.
    """
    record, channels = fit.waveforms, fit.spectra.channels
    columns: dict[str, np.ndarray] = {"time_s": record.time}
    figure, axes = create_panels(
        len(channels), 2, 1.0 + 1.7 * len(channels), sharex=True, sharey="row"
    )
    for i, channel in enumerate(channels):
        sides = (
            ("nominal", record.nominal[i], NOMINAL),
            ("calibrated", record.calibrated[i], CALIBRATED),
        )
        columns |= {f"{channel}_measured": record.measured[i]}
        for panel, (name, simulated, color) in zip(axes[i], sides, strict=True):
            columns |= {f"{channel}_{name}": simulated}
            panel.plot(
                record.time * 1e3, record.measured[i], color=MEASURED, linewidth=1.0, alpha=0.65
            )
            panel.plot(record.time * 1e3, simulated, color=color, linewidth=1.1)
        axes[i, 0].set_ylabel(f"{format_label(channel)} [m/s²]")
    for panel, (name, color) in zip(
        axes[0], (("nominal", NOMINAL), ("calibrated", CALIBRATED)), strict=True
    ):
        when = "before" if name == "nominal" else "after"
        panel.set_title(f"{when}: {name} twin", color=color, fontweight="bold")
    for panel in axes[-1]:
        panel.set(xlabel="time [ms]", xlim=(0, record.time[-1] * 1e3))
    low, high = band
    caption = (
        f"One revolution of recording {fit.recording_ids[0]} (gray) and of the twin (color), both within "
        f"{low:g} to {high:g} Hz and aligned in time, because the shaft angle at the start of a recording is not known."
    )
    title = f"Waveforms before and after calibration, {_pressure(fit)}"
    return render_drawing(f"{key}_waveforms", figure, columns, title=title, caption=caption)


@figure_style()
def spectra(fit: Fit, key: str) -> Drawing:
    """Line amplitudes measured, before and after, a panel for each sensor, in decibels."""
    record = fit.spectra
    count, values = (
        len(record.channels),
        ("measured", "deviation", "nominal", "calibrated", "low", "high"),
    )
    columns = {
        "channel": np.repeat(record.channels, len(record.orders)),
        "order": np.tile(record.orders, count),
        "frequency_hz": np.tile(record.frequency, count),
        **{name: getattr(record, name).ravel() for name in values},
    }
    figure, axes = create_panels(count, 1, 1.1 + 2.0 * count, sharex=True)
    for i, panel in enumerate(axes[:, 0]):
        _spectrum_panel(panel, record, i)
        panel.set_title(format_label(record.channels[i]), loc="left")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    axes[-1, 0].set_xlabel("frequency [Hz], multiples of the piston-pass frequency")
    caption = (
        "Amplitudes at the multiples of the piston-pass frequency. Bars: one standard deviation of the measured "
        "amplitude, within recordings or between them. Blue band: 90 % of the twins drawn from the posterior; "
        "noise and model error are not in it. 20 dB are a factor of 10. Lines more than "
        f"{_RANGE_DB:g} dB below the strongest are drawn at the lower edge, as zero is."
    )
    title = f"Spectra before and after calibration, {_pressure(fit)}"
    return render_drawing(f"{key}_spectra", figure, columns, title=title, caption=caption)


def _pressure(fit: Fit) -> str:
    return f"{fit.condition.discharge_pressure / 1e6:.4g} MPa"


def _spectrum_panel(panel: Axes, record: Spectra, i: int) -> None:
    lines = np.stack([record.measured[i], record.nominal[i], record.calibrated[i]])
    top = 20 * math.log10(max(lines.max(), 1e-9))
    floor = max(
        top - _RANGE_DB, 20 * math.log10(lines.min(where=lines > 0, initial=10 ** (top / 20))) - 4
    )

    def decibel(amplitude: np.ndarray) -> np.ndarray:
        return 20 * np.log10(np.maximum(amplitude, 10 ** (floor / 20)))

    for name, color, marker, style in (
        ("nominal", NOMINAL, "s", "--"),
        ("calibrated", CALIBRATED, "D", "-"),
    ):
        label = f"{name} twin ({'before' if name == 'nominal' else 'after'})"
        height = decibel(getattr(record, name)[i])
        panel.plot(
            record.frequency,
            height,
            style,
            marker=marker,
            color=color,
            ms=4,
            linewidth=0.9,
            label=label,
        )
    band, label = (
        (decibel(record.low[i]), decibel(record.high[i])),
        "calibrated twin, 90 % of its posterior",
    )
    panel.fill_between(
        record.frequency, *band, color=CALIBRATED, alpha=0.18, linewidth=0, label=label
    )
    low, high = (record.measured[i] + sign * np.nan_to_num(record.deviation[i]) for sign in (-1, 1))
    panel.vlines(record.frequency, decibel(low), decibel(high), color=MEASURED, linewidth=1.2)
    panel.plot(
        record.frequency,
        decibel(record.measured[i]),
        "o",
        color=MEASURED,
        ms=4.5,
        label="measured",
        zorder=3,
    )
    panel.set(ylim=(floor - 2, top + 5), ylabel="dB re 1 m/s²")
    panel.yaxis.set_major_locator(MultipleLocator(20 if top - floor > 45 else 10))


@figure_style()
def estimates(calibration: Calibration, key: str) -> Drawing:
    """The six values over their nominal ones, with intervals, bounds and verdicts."""
    stated = (
        "symbol",
        "unit",
        "nominal",
        "value",
        "interval",
        "bounds",
        "verdict",
        "correlated_with",
    )
    shown = {
        name: [getattr(estimate, name) for estimate in calibration.estimates] for name in stated
    }
    (low, high), (least, most) = (
        zip(*shown.pop(name), strict=True) for name in ("interval", "bounds")
    )
    ends = {"interval_low": low, "interval_high": high, "bound_low": least, "bound_high": most}
    columns = {"parameter": [estimate.name for estimate in calibration.estimates], **shown, **ends}
    figure, axes = create_panels(1, 1, 3.6)
    panel = axes[0, 0]
    for height, estimate in enumerate(reversed(calibration.estimates)):
        _estimate_row(panel, height, estimate)
    panel.axvline(1, color=NOMINAL, linewidth=1.2)
    panel.text(1, 5.62, "nominal", color=NOMINAL, ha="center", va="bottom", fontsize=9)
    names = [f"{format_parameter(e.name)}, {e.symbol}" for e in reversed(calibration.estimates)]
    panel.set(ylim=(-0.6, 5.6), yticks=range(len(PARAMETERS)), yticklabels=names)
    panel.grid(axis="y", visible=False)
    panel.set(xscale="log", xlabel="value over nominal value")
    label_log_axis(panel.xaxis)
    caption = (
        "Dot: estimate. Line: 90 % interval, if the model is right. Gray: "
        "bounds of the search. Filled: identified; hollow: do not use as a measurement. Twins with very "
        "different values can have the same spectrum, so a good fit does not prove a value."
    )
    return render_drawing(
        f"{key}_estimates", figure, columns, title="The six values", caption=caption
    )


def _estimate_row(panel: Axes, height: int, estimate: Estimate) -> None:
    color = INTERFACE_COLORS[estimate.name.split(".")[0]]
    low, high = (bound / estimate.nominal for bound in estimate.bounds)
    panel.barh(height, high - low, left=low, height=0.5, color="#efefef")
    panel.plot(
        [end / estimate.nominal for end in estimate.interval],
        [height, height],
        color=color,
        linewidth=2.6,
    )
    share, is_constrained = estimate.value / estimate.nominal, estimate.verdict == "identified"
    panel.plot(
        share,
        height,
        "o",
        color=color,
        markerfacecolor=color if is_constrained else "white",
        markersize=7,
        zorder=3,
    )
    panel.annotate(
        f"{estimate.verdict}{f', traded with {estimate.correlated_with}' if estimate.correlated_with else ''}",
        (1.01, height), xycoords=("axes fraction", "data"), va="center", fontsize=9,
        fontweight="bold" if is_constrained else "normal",
    )  # fmt: skip


@figure_style()
def draw_search(calibration: Calibration, key: str) -> Drawing:
    """The loss over the search, and below it the six values, each over its nominal value and named
    at its end.
    """
    history = calibration.history
    step = np.arange(1, len(history.loss) + 1)
    ratio = history.values / [estimate.nominal for estimate in calibration.estimates]
    columns = {
        "step": step,
        "loss": history.loss,
        "spectrum": history.spectrum_loss,
        "prior": history.prior_loss,
    }
    columns |= {"boundary": history.boundary_loss}
    columns |= {
        estimate.symbol: history.values[:, i] for i, estimate in enumerate(calibration.estimates)
    }
    figure, axes = create_panels(2, 1, 5.4, sharex=True, height_ratios=(2, 3))
    above, below = axes[:, 0]
    for panel in (above, below):
        panel.axvline(history.best_step + 1, color=LIGHT, linewidth=3)
    above.plot(step, history.loss, color="#000000")
    above.set(yscale="log", ylabel="loss [1]", xlim=(0.5, len(step) + 0.5))
    above.set_ylim(bottom=max(above.get_ylim()[0], history.loss.min() / 30))
    label_log_axis(above.yaxis)
    low, high = min(0.8, ratio.min() / 1.15), max(1.25, ratio.max() * 1.15)
    below.set(yscale="log", ylim=(low, high), ylabel="value over nominal value")
    below.set_xlabel("epoch" if calibration.method == "IPINN" else "simulation from the best start")
    below.xaxis.set_major_locator(MaxNLocator(integer=True))
    label_log_axis(below.yaxis)
    for i, estimate in enumerate(calibration.estimates):
        interface, entry = estimate.name.split(".")
        style = "-" if entry == "damping" else "--"
        below.plot(
            step, ratio[:, i], style, color=INTERFACE_COLORS[interface], label=estimate.symbol
        )
    figure.legend(loc="outside right lower")
    caption = (
        f"Above: loss over the search with {calibration.method}, as that method measures it. Below: solid is damping, "
        f"dashed stiffness, one color for each interface. The gray line marks the best step, {history.best_step + 1} of "
        f"{len(step)}; its values are the result."
    )
    return render_drawing(f"{key}_search", figure, columns, title="The search", caption=caption)
