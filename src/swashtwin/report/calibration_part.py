"""Part of the page about a calibration, with its figures: waveforms, spectra, search, estimates."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, MultipleLocator

from swashtwin.calibration import (
    AGREEMENT_LABELS,
    VALUE_SLICE,
    Calibration,
    Estimate,
    Fit,
    Spectra,
)
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
from swashtwin.report.page import Bullets, Group, Part, Section, SectionOrder, Table, Tone
from swashtwin.report.wording import (
    add_bar_values,
    build_facts_table,
    capitalize_sentence,
    flatten_settings,
    format_number,
    format_number_cell,
    format_parameter,
    format_percent,
    rig_notice,
)

# Identified values from which a calibration is shown as good news.
_MIN_IDENTIFIED = 3

# Notes shown on the card; the others stand in the section.
_MAX_CARD_NOTES = 3


def build_calibration_part(calibration: Calibration, key: str) -> Part:
    """Return the part of the page about one calibration."""
    counts = Counter(estimate.verdict for estimate in calibration.estimates)
    conditions = describe_conditions(calibration)
    summary = summarize_calibration(calibration)
    tone: Tone = "unsure"
    if calibration.doubt:
        tone = "bad"
    elif counts["identified"] >= _MIN_IDENTIFIED:
        tone = "good"

    provenance = build_facts_table(
        "How the calibration was made.",
        [
            ("method", calibration.method),
            *flatten_settings(calibration.settings),
            ("operating point", conditions),
            ("simulations", calibration.simulations),
            ("time taken", f"{format_number(calibration.wall_s)} s"),
            ("swashtwin version", calibration.version),
            ("calibration recordings", list(calibration.recording_ids)),
        ],
    )
    notes = [capitalize_sentence(note) for note in calibration.notes]
    further_notes = Bullets("Further notes", tuple(notes[_MAX_CARD_NOTES:]))
    blocks = (further_notes, *build_calibration_blocks(calibration, key)[1:])
    return Part(
        title=f"Calibration of {calibration.twin.pump.name}",
        answer=summary[:1],
        notice=rig_notice(RecordingSummary(origin=calibration.origin)),
        sections=(
            Section(SectionOrder.CALIBRATION, "Calibration", blocks),
            Section(SectionOrder.PROVENANCE, "Provenance of the calibration", (provenance,)),
        ),
        results={"calibrations": [calibration.to_dict()]},
        verdict=_describe_success(calibration, counts["identified"]),
        tone=tone,
        # the verdicts of the values before the remark on the recordings
        certainty=(*reversed(summary[1:]), *notes[:_MAX_CARD_NOTES]),
        actions=_recommend_actions(calibration),
        facts=(
            ("Pump", calibration.twin.pump.name),
            ("Condition", add_bar_values(conditions)),
            ("Method", calibration.method),
            ("Recordings", str(len(calibration.recording_ids))),
        ),
    )


def _describe_success(calibration: Calibration, n_identified: int) -> str:
    """Return the result in a few words; an error that fell is no success if no value is known."""
    change = _describe_spectrum_change(calibration)
    if not calibration.has_improved:
        return f"Calibration failed: spectrum error {change}"
    if n_identified == 0:
        return "None of the 6 values identified"
    return f"{n_identified} of 6 values identified; spectrum error {change}"


def _recommend_actions(calibration: Calibration) -> tuple[str, ...]:
    """Return what to do with the result."""
    if not calibration.has_improved:
        return (calibration.doubt,)

    uncertain = [
        estimate.symbol for estimate in calibration.estimates if estimate.verdict != "identified"
    ]
    actions = []
    if uncertain:
        actions.append(
            f"Do not read {', '.join(uncertain)} as measured values of the pump; swashtwin twin "
            "next shows which further recording would determine them best."
        )
    if calibration.doubt:
        return (*actions, calibration.doubt)
    return (*actions, "Synthesize recordings that you do not have: swashtwin synthesize.")


def summarize_calibration(calibration: Calibration) -> tuple[str, ...]:
    """Return the result in sentences: what came out, what it is not, and the verdicts."""
    twin = calibration.twin
    waveform_change = _describe_change(calibration, "rmse", "{} m/s²")
    return (
        f"The twin of {twin.pump.name} ({describe_conditions(calibration)}, "
        f"{format_label(twin.label)}) was calibrated with {calibration.method} on "
        f"{plural(len(calibration.recording_ids), 'recording')}. The error of its spectrum (SVE) "
        f"{_describe_spectrum_change(calibration)}; that of its waveform (RMSE) {waveform_change}.",
        "These are the recordings it was calibrated on, so neither number is a test."
        f"{_warn_of_few_lines(calibration)}",
        f"Of the six values {describe_verdicts(calibration)}.",
    )


def _describe_spectrum_change(calibration: Calibration) -> str:
    """Return how the error of the lines changed, in percent of the measured ones."""
    change = _describe_change(calibration, "spectrum_value_error", "{} %", scale=100.0)
    return f"{change} of the measured amplitudes"


def _describe_change(
    calibration: Calibration, name: str, form: str = "{}", scale: float = 1.0
) -> str:
    """Return how an error changed by calibration, such as ``fell from 0.8 to 0.1``.

    Parameters
    ----------
    form : text with the unit around each number.
    scale : factor of both numbers.
    """
    nominal = scale * getattr(calibration.nominal_agreement, name)
    calibrated = scale * getattr(calibration.calibrated_agreement, name)
    if calibrated < nominal:
        verb = "fell"
    elif calibrated > nominal:
        verb = "ROSE"
    else:
        verb = "stayed"
    values = (form.format(format_number(value)) for value in (nominal, calibrated))
    return f"{verb} from {' to '.join(values)}"


def _warn_of_few_lines(calibration: Calibration) -> str:
    """Return a warning if a small error of the lines means little, because there are few."""
    if calibration.n_lines >= calibration.n_unknowns:
        return ""
    return (
        f" {plural(calibration.n_unknowns, 'unknown')} were fitted to "
        f"{plural(calibration.n_lines, 'line')}, so a small error is no evidence for the twin."
    )


def describe_verdicts(calibration: Calibration) -> str:
    """Return how many values have which verdict, such as ``"4 are identified, 2 are weak"``."""
    counts = Counter(estimate.verdict for estimate in calibration.estimates)
    parts = []
    for verdict, count in counts.most_common():
        verb = "is" if count == 1 else "are"
        parts.append(f"{count} {verb} {verdict.replace('at bound', 'at a bound')}")
    return ", ".join(parts)


def describe_conditions(calibration: Calibration) -> str:
    """Return speed and pressure of the twin, or of every operating point if several were fitted
    together.
    """
    conditions = [fit.condition for fit in calibration.fits]
    if len(conditions) <= 1:
        conditions = [calibration.twin.condition]

    pressures_by_speed: dict[str, list[str]] = {}
    for condition in conditions:
        speed = f"{condition.speed * 30 / math.pi:.4g} rev/min"
        pressure = f"{condition.discharge_pressure / 1e6:.3g}"
        pressures_by_speed.setdefault(speed, []).append(pressure)
    return "; ".join(
        f"{speed}, {' and '.join(pressures)} MPa" for speed, pressures in pressures_by_speed.items()
    )


def build_calibration_blocks(calibration: Calibration, key: str) -> tuple[Any, ...]:
    """Return notes, tables and figures of one calibration."""
    n_used = len(calibration.recording_ids)
    n_excluded = len(calibration.excluded_recordings)
    reasons = tuple(f"{name}: {reason}" for name, reason in calibration.excluded_recordings)
    recordings = Group(
        f"Recordings: {n_used} used, {n_excluded} excluded",
        (Bullets("Used", calibration.recording_ids), Bullets("Excluded", reasons)),
        is_open=False,
    )
    return (
        Bullets("Read this first", calibration.notes),
        fit_table(calibration),
        estimates_table(calibration),
        directions_table(calibration),
        *calibration_drawings(calibration, key),
        recordings,
    )


def fit_table(calibration: Calibration) -> Table:
    """Return RMSE, PE and SVE before and after calibration."""
    nominal = asdict(calibration.nominal_agreement)
    calibrated = asdict(calibration.calibrated_agreement)
    improvement = calibration.improvement

    rows = []
    for name, label in AGREEMENT_LABELS.items():
        fall = improvement.get(name, math.nan)
        change = "—"
        if math.isfinite(fall):
            sign = "−" if fall > 0 else "+"
            change = f"{sign}{format_percent(abs(fall))}"
        cells = format_number_cell(nominal[name]), format_number_cell(calibrated[name])
        rows.append((label, *cells, change))
    return Table(
        "Difference between the twin and the recordings it was calibrated on. Errors: smaller is "
        "better. Correlation: 1 is a spectrum of the same shape, whatever its level.",
        ("", "before (nominal)", "after (calibrated)", "change"),
        tuple(rows),
    )


def _describe_verdict(estimate: Estimate) -> str:
    """Return the verdict, with the value that it is correlated with."""
    if estimate.correlated_with is None:
        return estimate.verdict
    return f"{estimate.verdict}, correlated with {estimate.correlated_with}"


def estimates_table(calibration: Calibration) -> Table:
    """Return the six values with intervals and verdicts."""
    rows = []
    for estimate in calibration.estimates:
        unit = estimate.unit.replace("*", "·")
        name = f"{estimate.symbol}, {format_parameter(estimate.name)} [{unit}]"
        rows.append(
            (
                name,
                format_number_cell(estimate.nominal),
                format_number_cell(estimate.value),
                describe_interval(estimate),
                _describe_verdict(estimate),
            )
        )

    return Table(
        "The six values. Identified: 90 % within a factor of 1.5. Weak: less certain. Not "
        "identified: the measurement adds little to the bounds. At bound: a bound stopped the "
        "search, often because a constant is wrong. Correlated: the two values can change together "
        "at almost the same spectrum.",
        ("value", "nominal", "calibrated", "90 % interval", "verdict"),
        tuple(rows),
    )


def directions_table(calibration: Calibration) -> Table:
    """Return independent combinations of the six values."""
    posterior = calibration.posterior
    symbols = tuple(estimate.symbol for estimate in calibration.estimates)

    # over the prior's deviations, so that an eigenvalue is the share of its variance that remains
    prior = posterior.unknowns.deviation[VALUE_SLICE]
    covariance = posterior.covariance[VALUE_SLICE, VALUE_SLICE] / np.outer(prior, prior)
    variance, directions = np.linalg.eigh(covariance)

    # the largest weight of each direction is positive, since its sign has no meaning
    largest = np.abs(directions).argmax(axis=0)
    directions = directions * np.sign(directions[largest, range(len(symbols))])

    rows = []
    for remaining_variance, direction in zip(variance, directions.T, strict=True):
        # rounding can make the variance of a well-known direction negative, and a measurement
        # never adds to what is unknown
        width = format_percent(math.sqrt(min(max(remaining_variance, 0.0), 1.0)))
        rows.append((width, *(f"{weight:+.2f}" for weight in direction)))
    return Table(
        "Independent combinations of the six values, the best known first: the share of the prior "
        "width that remains, and the weight of each value's logarithm.",
        ("remaining width", *symbols),
        tuple(rows),
    )


def describe_interval(estimate: Estimate) -> str:
    """Return the interval in words; an end set by the bound alone is not a limit."""
    low, high = (format_number(end) for end in estimate.interval)
    is_open_below, is_open_above = estimate.open_sides
    if is_open_below and is_open_above:
        return "no limits within the bounds"
    if is_open_below:
        return f"at most {high}"
    if is_open_above:
        return f"at least {low}"
    return f"{low} to {high}"


# Range of a spectrum below its strongest line [dB]; less if its weakest line is stronger.
_RANGE_DB = 60.0


def calibration_drawings(calibration: Calibration, key: str) -> list[Drawing]:
    """Return every figure of a calibration, in the order of the page.

    The name of each file begins with `key`.
    """
    band = calibration.settings.get("band", (math.nan, math.nan))
    figures: list[Drawing] = []
    for fit in calibration.fits:
        prefix = key
        if len(calibration.fits) > 1:
            prefix = f"{key}_{fit.condition.discharge_pressure / 1e6:.4g}_mpa"
        figures += [draw_waveforms(fit, prefix, band), draw_spectra(fit, prefix)]
    return [*figures, draw_estimates(calibration, key), draw_search(calibration, key)]


@figure_style()
def draw_waveforms(fit: Fit, key: str, band: Sequence[float]) -> Drawing:
    """Draw one revolution measured, with the twin before (left) and after (right) calibration, a
    row for each sensor.
    """
    waveforms = fit.waveforms
    channels = fit.spectra.channels
    time_ms = waveforms.time * 1e3
    columns: dict[str, np.ndarray] = {"time_s": waveforms.time}

    figure, axes = create_panels(
        len(channels), 2, 1.0 + 1.7 * len(channels), sharex=True, sharey="row"
    )
    for row, channel in enumerate(channels):
        measured = waveforms.measured[row]
        columns[f"{channel}_measured"] = measured
        sides = (
            ("nominal", waveforms.nominal[row], NOMINAL),
            ("calibrated", waveforms.calibrated[row], CALIBRATED),
        )
        for panel, (name, simulated, color) in zip(axes[row], sides, strict=True):
            columns[f"{channel}_{name}"] = simulated
            panel.plot(time_ms, measured, color=MEASURED, linewidth=1.0, alpha=0.65)
            panel.plot(time_ms, simulated, color=color, linewidth=1.1)
        axes[row, 0].set_ylabel(f"{format_label(channel)} [m/s²]")

    left, right = axes[0]
    left.set_title("before: nominal twin", color=NOMINAL, fontweight="bold")
    right.set_title("after: calibrated twin", color=CALIBRATED, fontweight="bold")
    for panel in axes[-1]:
        panel.set(xlabel="time [ms]", xlim=(0, time_ms[-1]))

    low, high = band
    caption = (
        f"One revolution of recording {fit.recording_ids[0]} (gray) and of the twin (color), both "
        f"within {low:g} to {high:g} Hz and aligned in time, because the shaft angle at the start "
        "of a recording is not known."
    )
    title = f"Waveforms before and after calibration, {_format_pressure(fit)}"
    return render_drawing(f"{key}_waveforms", figure, columns, title=title, caption=caption)


@figure_style()
def draw_spectra(fit: Fit, key: str) -> Drawing:
    """Draw line amplitudes measured, before and after calibration, a panel for each sensor, in
    decibels.
    """
    spectra = fit.spectra
    count = len(spectra.channels)
    columns = {
        "channel": np.repeat(spectra.channels, len(spectra.orders)),
        "order": np.tile(spectra.orders, count),
        "frequency_hz": np.tile(spectra.frequency, count),
    }
    for name in ("measured", "deviation", "nominal", "calibrated", "low", "high"):
        columns[name] = getattr(spectra, name).ravel()

    figure, axes = create_panels(count, 1, 1.1 + 2.0 * count, sharex=True)
    for channel, panel in enumerate(axes[:, 0]):
        _draw_spectrum_panel(panel, spectra, channel)
        panel.set_title(format_label(spectra.channels[channel]), loc="left")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    axes[-1, 0].set_xlabel("frequency [Hz], multiples of the piston-pass frequency")

    caption = (
        "Amplitudes at the multiples of the piston-pass frequency. Bars: one standard deviation of "
        "the measured amplitude, within recordings or between them. Blue band: 90 % of the twins "
        "drawn from the posterior; noise and model error are not included. 20 dB are a factor of "
        f"10. Lines more than {_RANGE_DB:g} dB below the strongest are drawn at the lower edge, as "
        "zero is."
    )
    title = f"Spectra before and after calibration, {_format_pressure(fit)}"
    return render_drawing(f"{key}_spectra", figure, columns, title=title, caption=caption)


def _format_pressure(fit: Fit) -> str:
    return f"{fit.condition.discharge_pressure / 1e6:.4g} MPa"


def _draw_spectrum_panel(panel: Axes, spectra: Spectra, channel: int) -> None:
    """Draw the lines of one sensor."""
    frequency = spectra.frequency
    measured = spectra.measured[channel]
    lines = np.stack([measured, spectra.nominal[channel], spectra.calibrated[channel]])
    top = 20 * math.log10(max(lines.max(), 1e-9))
    # a line of zero has no decibels and sets no limit
    weakest = lines.min(where=lines > 0, initial=10 ** (top / 20))
    floor = max(top - _RANGE_DB, 20 * math.log10(weakest) - 4)

    def decibel(amplitude: np.ndarray) -> np.ndarray:
        return 20 * np.log10(np.maximum(amplitude, 10 ** (floor / 20)))

    twins = (
        (spectra.nominal, "nominal twin (before)", NOMINAL, "s", "--"),
        (spectra.calibrated, "calibrated twin (after)", CALIBRATED, "D", "-"),
    )
    for amplitude, label, color, marker, style in twins:
        height = decibel(amplitude[channel])
        panel.plot(
            frequency, height, style, marker=marker, color=color, ms=4, linewidth=0.9, label=label
        )
    panel.fill_between(
        frequency,
        decibel(spectra.low[channel]),
        decibel(spectra.high[channel]),
        color=CALIBRATED,
        alpha=0.18,
        linewidth=0,
        label="calibrated twin, 90 % of its posterior",
    )

    # a line without a deviation gets a bar of no length
    deviation = np.nan_to_num(spectra.deviation[channel])
    low = decibel(measured - deviation)
    high = decibel(measured + deviation)
    panel.vlines(frequency, low, high, color=MEASURED, linewidth=1.2)
    panel.plot(
        frequency, decibel(measured), "o", color=MEASURED, ms=4.5, label="measured", zorder=3
    )
    panel.set(ylim=(floor - 2, top + 5), ylabel="dB re 1 m/s²")
    panel.yaxis.set_major_locator(MultipleLocator(20 if top - floor > 45 else 10))


@figure_style()
def draw_estimates(calibration: Calibration, key: str) -> Drawing:
    """Draw the six values over their nominal ones, with intervals, bounds and verdicts."""
    estimates = calibration.estimates
    columns: dict[str, list[Any]] = {
        "parameter": [estimate.name for estimate in estimates],
        "symbol": [estimate.symbol for estimate in estimates],
        "unit": [estimate.unit for estimate in estimates],
        "nominal": [estimate.nominal for estimate in estimates],
        "value": [estimate.value for estimate in estimates],
        "verdict": [estimate.verdict for estimate in estimates],
        "correlated_with": [estimate.correlated_with for estimate in estimates],
        "interval_low": [estimate.interval[0] for estimate in estimates],
        "interval_high": [estimate.interval[1] for estimate in estimates],
        "bound_low": [estimate.bounds[0] for estimate in estimates],
        "bound_high": [estimate.bounds[1] for estimate in estimates],
    }

    figure, axes = create_panels(1, 1, 3.6)
    panel = axes[0, 0]
    for height, estimate in enumerate(reversed(estimates)):
        _draw_estimate_row(panel, height, estimate)
    panel.axvline(1, color=NOMINAL, linewidth=1.2)
    panel.text(1, 5.62, "nominal", color=NOMINAL, ha="center", va="bottom", fontsize=9)
    names = [
        f"{format_parameter(estimate.name)}, {estimate.symbol}" for estimate in reversed(estimates)
    ]
    panel.set(ylim=(-0.6, 5.6), yticks=range(len(PARAMETERS)), yticklabels=names)
    panel.grid(axis="y", visible=False)
    panel.set(xscale="log", xlabel="value over nominal value")
    label_log_axis(panel.xaxis)

    caption = (
        "Dot: estimate. Line: 90 % interval, if the model is right. Gray: bounds of the search. "
        "Filled: identified; hollow: do not use as a measurement. Twins with very different values "
        "can have the same spectrum, so a good fit does not prove a value."
    )
    return render_drawing(
        f"{key}_estimates", figure, columns, title="The six values", caption=caption
    )


def _draw_estimate_row(panel: Axes, height: int, estimate: Estimate) -> None:
    """Draw one value with its interval and bounds."""
    color = INTERFACE_COLORS[estimate.name.split(".")[0]]
    low, high = (bound / estimate.nominal for bound in estimate.bounds)
    interval = [end / estimate.nominal for end in estimate.interval]
    marker_color = "white"
    font_weight = "normal"
    if estimate.verdict == "identified":
        marker_color = color
        font_weight = "bold"

    panel.barh(height, high - low, left=low, height=0.5, color="#efefef")
    panel.plot(interval, [height, height], color=color, linewidth=2.6)
    panel.plot(
        estimate.value / estimate.nominal,
        height,
        "o",
        color=color,
        markerfacecolor=marker_color,
        markersize=7,
        zorder=3,
    )
    panel.annotate(
        _describe_verdict(estimate),
        (1.01, height),
        xycoords=("axes fraction", "data"),
        va="center",
        fontsize=9,
        fontweight=font_weight,
    )


@figure_style()
def draw_search(calibration: Calibration, key: str) -> Drawing:
    """Draw the loss over the search, and below it each of the six values over its nominal value."""
    history = calibration.history
    steps = np.arange(1, len(history.loss) + 1)
    ratio = history.values / [estimate.nominal for estimate in calibration.estimates]
    columns = {
        "step": steps,
        "loss": history.loss,
        "spectrum": history.spectrum_loss,
        "prior": history.prior_loss,
        "boundary": history.boundary_loss,
    }
    for index, estimate in enumerate(calibration.estimates):
        columns[estimate.symbol] = history.values[:, index]

    figure, axes = create_panels(2, 1, 5.4, sharex=True, height_ratios=(2, 3))
    loss_panel, value_panel = axes[:, 0]
    for panel in (loss_panel, value_panel):
        panel.axvline(history.best_step + 1, color=LIGHT, linewidth=3)

    loss_panel.plot(steps, history.loss, color="#000000")
    loss_panel.set(yscale="log", ylabel="loss [1]", xlim=(0.5, len(steps) + 0.5))
    loss_panel.set_ylim(bottom=max(loss_panel.get_ylim()[0], history.loss.min() / 30))
    label_log_axis(loss_panel.yaxis)

    low = min(0.8, ratio.min() / 1.15)
    high = max(1.25, ratio.max() * 1.15)
    step_label = "simulation from the best start"
    if calibration.method == "IPINN":
        step_label = "epoch"
    value_panel.set(yscale="log", ylim=(low, high), ylabel="value over nominal value")
    value_panel.set_xlabel(step_label)
    value_panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    label_log_axis(value_panel.yaxis)
    for index, estimate in enumerate(calibration.estimates):
        interface, entry = estimate.name.split(".")
        style = "-" if entry == "damping" else "--"
        color = INTERFACE_COLORS[interface]
        value_panel.plot(steps, ratio[:, index], style, color=color, label=estimate.symbol)
    figure.legend(loc="outside right lower")

    caption = (
        f"Top: loss over the search with {calibration.method}, as that method measures it. Bottom: "
        "solid is damping, dashed stiffness, one color for each interface. The gray line marks the "
        f"best step, {history.best_step + 1} of {len(steps)}; its values are the result."
    )
    return render_drawing(f"{key}_search", figure, columns, title="The search", caption=caption)
