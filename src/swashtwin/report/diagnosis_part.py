"""Part of the page about one recording: its class, or whether it deviates from the healthy ones."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import PercentFormatter

from swashtwin.diagnosis import Diagnosis, HealthySpectrum, next_checks
from swashtwin.foundation import plural
from swashtwin.plot import (
    CALIBRATED,
    LIGHT,
    MEASURED,
    create_panels,
    figure_style,
    format_label,
    format_unit,
    label_log_axis,
    series_colors,
)
from swashtwin.pump import is_healthy, propose_class
from swashtwin.recordings import RecordingSummary
from swashtwin.report.drawing import Cutaway, Drawing, build_cutaways, render_drawing
from swashtwin.report.living_pump import LivingPump, build_living_pumps
from swashtwin.report.model_part import build_choice_blocks
from swashtwin.report.page import Bullets, Group, Part, Section, SectionOrder, Table, Tone
from swashtwin.report.wording import (
    capitalize_sentence,
    format_number,
    format_percent,
    list_facts,
    rig_notice,
)
from swashtwin.signals import BandPower

_UNCALIBRATED = (
    "The model's confidence was not calibrated, so the score ranks the classes and is not a "
    "probability."
)

# Notes shown on the card; the others stand in the section.
_MAX_CARD_NOTES = 3

_MAX_CHECKS = 4
NO_VERDICT_ACTIONS = (
    "Check what the reason names: the sensor, its cable, the file.",
    "Then record again at the same speed and pressure; swashtwin inspect reports whether a "
    "recording can be used.",
)
_NOT_CHECKED = (
    "Whether the pump has a fault outside the trained classes: the answer is always one of the "
    "classes listed.",
    "Whether it has two faults at once.",
    "Whether pump, sensors and mounting resemble those of the training; scores at split L4 show "
    "the cost of another pump.",
    "Whether the score is a probability: windows of one recording are not independent, so it only "
    "ranks the classes.",
)
_NOT_CHECKED_BY_PRIOR = (
    *_NOT_CHECKED[:2],
    "Whether this machine is like the virtual pumps on which the prior was trained.",
)
_NOT_CHECKED_IF_CALIBRATED = (
    _NOT_CHECKED[1],
    "Whether this recording resembles those that calibrated the confidence: rates and thresholds "
    "hold only for their pumps, sensors, mountings and operating points.",
    "Whether the pump has a fault outside the trained classes that looks like one of them: only "
    "recordings far from all trained classes are called unknown.",
)


def build_diagnosis_part(diagnosis: Diagnosis, key: str) -> Part:
    """Return the part of the page about one diagnosis."""
    frame = Part(
        title=f"Diagnosis of {diagnosis.recording_id}",
        notice=rig_notice(diagnosis.facts),
        results={"diagnoses": [diagnosis.to_dict()]},
        subject=diagnosis.recording_id,
        facts=_list_facts_of_machine(diagnosis),
    )
    if diagnosis.label is None:
        return _without_verdict(frame, diagnosis)

    confidence = _UNCALIBRATED
    if diagnosis.error_rate is not None:
        confidence = diagnosis.sentence()
    notes = tuple(note for note in diagnosis.notes if note not in confidence)
    labels = tuple(diagnosis.fault_of.get(name, name) for name in diagnosis.candidates)
    checks = next_checks(*labels, unknown=diagnosis.unknown)[:_MAX_CHECKS]
    marked_labels = labels[:1]
    if diagnosis.unknown or is_healthy(diagnosis.label):
        marked_labels = ()

    blocks: list[Any] = [Bullets("Further notes", notes[_MAX_CARD_NOTES:])]
    if not diagnosis.unknown:
        # shares among the trained classes presume one of them, so they would contradict "unknown"
        blocks.append(draw_probabilities(diagnosis, key))
    choice_blocks = build_choice_blocks(diagnosis.choice)
    if choice_blocks:
        blocks.append(Group("How the model was chosen", choice_blocks, is_open=False))
    blocks.append(Bullets("What was not checked", _list_not_checked(diagnosis)))

    verdict, tone = _describe_verdict(diagnosis)
    return replace(
        frame,
        answer=_describe_answer(diagnosis),
        sections=(Section(SectionOrder.VERDICT, "Basis of the verdict", tuple(blocks)),),
        verdict=verdict,
        tone=tone,
        urgency=_describe_urgency(diagnosis, labels),
        certainty=(*_describe_certainty(diagnosis, confidence), *notes[:_MAX_CARD_NOTES]),
        actions=tuple(check.what for check in checks),
        glance=build_glance(diagnosis, key, marked_labels),
    )


def _without_verdict(frame: Part, diagnosis: Diagnosis) -> Part:
    """Return the part of a recording that got no verdict."""
    title = "Why there is no verdict"
    reason = diagnosis.no_verdict or ""
    blocks = (Bullets(title, (reason,)), Bullets("Notes", diagnosis.notes))
    return replace(
        frame,
        answer=(capitalize_sentence(reason),),
        sections=(Section(SectionOrder.VERDICT, title, blocks),),
        verdict="No verdict",
        tone="unsure",
        urgency=_NO_VERDICT_URGENCY,
        actions=NO_VERDICT_ACTIONS,
    )


NO_MACHINE = "not specified"
"""What a page states of a machine that the recording does not name."""


def _list_facts_of_machine(diagnosis: Diagnosis) -> tuple[tuple[str, str], ...]:
    """Return the facts of a recording, and that the machine is missing if it is."""
    facts = list_facts(diagnosis.facts)
    if diagnosis.facts.machine:
        return facts
    return (("Machine", NO_MACHINE), *facts)


# Classes whose fault can break the pump at once (`swashtwin.diagnosis.CHECKS`).
_BREAKS_PUMP = ("loose_slipper",)

_NO_VERDICT_URGENCY = "How urgent: not known, since the recording was not judged."


def _describe_urgency(diagnosis: Diagnosis, labels: Sequence[str]) -> str:
    """Return how soon something must be done.

    No model of this page estimates a severity, so that only the kind of fault decides.

    Parameters
    ----------
    labels : classes that the verdict leaves, as faults of the model.
    """
    if diagnosis.unknown:
        return (
            "Check soon: the cause is not known, so it cannot be called harmless. Stop if noise, "
            "temperature or case drain flow rises."
        )
    faults = [label for label in labels if not is_healthy(label)]
    if not faults:
        return "Nothing is urgent."
    if any((propose_class(label) or label) in _BREAKS_PUMP for label in faults):
        return "Urgent: stop the pump and look, since a slipper that comes off breaks it."
    return (
        "Check soon: the severity was not estimated. Stop if noise, temperature or case drain flow "
        "rises."
    )


def _list_not_checked(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what a verdict of this kind does not show."""
    if diagnosis.kind == "prior":
        return _NOT_CHECKED_BY_PRIOR
    if diagnosis.error_rate is None:
        return _NOT_CHECKED
    return _NOT_CHECKED_IF_CALIBRATED


def _describe_certainty(diagnosis: Diagnosis, confidence: str) -> tuple[str, ...]:
    """Return how sure the verdict is, in sentences.

    Parameters
    ----------
    confidence : what the model's confidence states of the verdict.
    """
    if diagnosis.is_prior_unknown:
        return (confidence,)
    if not diagnosis.unknown:
        return (_describe_support(diagnosis), confidence)
    if diagnosis.kind == "prior":
        return (confidence, diagnosis.reasons[0])
    distance = (
        f"Its distance is {format_number(diagnosis.score)}; below "
        f"{format_number(diagnosis.threshold)} it would count as known."
    )
    return (confidence, distance)


def _describe_support(diagnosis: Diagnosis) -> str:
    """Return what supports the verdict, in a sentence."""
    assert diagnosis.label is not None
    count = len(diagnosis.probabilities)
    share = format_percent(diagnosis.probabilities[diagnosis.label])
    if diagnosis.kind == "prior":
        return f"Of {count} classes the pump prior gives this one a probability of {share}."

    n_agreeing = round(diagnosis.agreement * diagnosis.n_windows)
    return (
        f"Of {count} classes this one has a {_name_share(diagnosis)} of {share} over all windows; "
        "taken alone, "
        f"{n_agreeing} of {diagnosis.n_windows} windows give this class "
        f"({format_percent(diagnosis.agreement)})."
    )


def _name_share(diagnosis: Diagnosis) -> str:
    """Return what the share of a class is: a probability only if the model was calibrated."""
    if diagnosis.error_rate is None:
        return "score"
    return "probability"


def _describe_verdict(diagnosis: Diagnosis) -> tuple[str, Tone]:
    """Return the verdict in a few words, and its color."""
    assert diagnosis.label is not None
    if diagnosis.is_prior_unknown:
        return "Unknown: like a fault outside the trained classes", "unsure"
    if diagnosis.unknown:
        return "Unknown: differs from every trained class", "unsure"
    if len(diagnosis.candidates) > 1:
        return f"Not certain: {' or '.join(map(format_label, diagnosis.candidates))}", "unsure"
    if is_healthy(diagnosis.label):
        return "No fault found", "good"
    return f"Suspected fault: {format_label(diagnosis.label)}", "bad"


def _describe_answer(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return the verdict in a sentence, and how the spectrum differs from healthy ones."""
    name = format_label(diagnosis.label or "")
    if diagnosis.is_prior_unknown:
        answer = diagnosis.reasons[0]
    elif diagnosis.unknown:
        answer = "No class is named: the recording does not resemble those of the training."
    elif diagnosis.kind == "prior":
        answer = (
            f"The change against {diagnosis.basis} is most like that of simulated pumps of the "
            f"class {name}."
        )
    else:
        answer = f"The vibration is most like that of recordings of the class {name}."
    return (answer, *describe_spectrum(diagnosis.spectrum))


def build_glance(
    verdict: Diagnosis, key: str, labels: tuple[str, ...]
) -> tuple[Drawing | Cutaway | LivingPump, ...]:
    """Return a pump that turns with the fault of each label, the orders that the fault excites, and
    the spectrum over healthy recordings.
    """
    facts = verdict.facts
    speed = None if facts.shaft is None else 2 * math.pi * facts.shaft
    blocks: list[Drawing | Cutaway | LivingPump] = []
    for label in labels:
        pumps = build_living_pumps(label, pistons=facts.pistons, speed=speed)
        blocks += pumps
        for cutaway in build_cutaways(label, facts.pistons, facts.shaft):
            blocks.append(replace(cutaway, is_below_living_pump=bool(pumps)))
    if verdict.spectrum is not None:
        blocks.append(draw_spectrum_over_healthy(verdict.spectrum, facts, key))
    return tuple(blocks)


@figure_style()
def draw_probabilities(diagnosis: Diagnosis, key: str) -> Drawing:
    """Draw the score of each class."""
    classes = list(diagnosis.probabilities)
    shares = list(diagnosis.probabilities.values())
    colors = series_colors(classes)
    share_name = _name_share(diagnosis)

    figure, axes = create_panels(1, 1, 0.9 + 0.34 * len(classes))
    panel = axes[0, 0]
    panel.barh(range(len(classes)), shares, color=[colors[name] for name in classes], height=0.7)
    for height, share in enumerate(shares):
        panel.text(share + 0.01, height, format_percent(share), va="center", fontsize=9)
    panel.set(
        yticks=range(len(classes)),
        yticklabels=[format_label(name) for name in classes],
        xlim=(0, 1.1),
    )
    if diagnosis.kind == "prior":
        panel.set_xlabel("probability by virtual pumps")
    else:
        panel.set_xlabel(f"{share_name} of the class over all windows")
    panel.xaxis.set_major_formatter(PercentFormatter(1, symbol=" %"))
    panel.set_xticks([0, 0.2, 0.4, 0.6, 0.8, 1])
    panel.invert_yaxis()
    panel.grid(axis="y", visible=False)

    return render_drawing(
        f"{key}_scores",
        figure,
        {"class": classes, "score": shares},
        title=f"{share_name.capitalize()} of each class",
        caption=_caption_probabilities(diagnosis),
    )


def _caption_probabilities(diagnosis: Diagnosis) -> str:
    """Return the caption of the classes' scores."""
    if diagnosis.error_rate is not None:
        possible = ", ".join(format_label(name) for name in diagnosis.prediction_set)
        return (
            "Pooled over the windows; temperature and dependence of the windows by "
            f"{diagnosis.basis}. Prediction set at an error rate of "
            f"{format_percent(diagnosis.error_rate)}: {possible}."
        )
    if diagnosis.kind == "prior":
        return (
            "Probability of each class, calibrated on virtual pumps that were held out of the "
            "training."
        )
    return (
        "From the mean log-probability over the windows. It ranks the classes and is not a "
        "calibrated probability."
    )


# Multiples of the piston-pass line that are marked.
_N_MARKED_LINES = 4

# Lowest frequency from which the axis begins.
_MIN_AXIS_START_HZ = 5.0

# Healthy recordings below which their range is too narrow to judge by.
_MIN_HEALTHY = 5


def describe_spectrum(spectrum: HealthySpectrum | None) -> tuple[str, ...]:
    """Return how a recording differs from healthy ones, with a warning if those are few."""
    if spectrum is None:
        return ()

    count = len(spectrum.healthy)
    if count >= _MIN_HEALTHY:
        return (spectrum.sentence(),)
    verb = "spans" if count == 1 else "span"
    return (
        f"{spectrum.sentence()} {plural(count, 'healthy recording')} {verb} a narrow range: bands "
        "outside it are not a sign of a fault by themselves.",
    )


@figure_style()
def draw_spectrum_over_healthy(
    spectrum: HealthySpectrum, facts: RecordingSummary, key: str
) -> Drawing:
    """Draw the band powers of a recording, channel by channel, over the range and the median of
    healthy ones.
    """
    count = len(spectrum.channels)

    # the axis is logarithmic, and the first band may begin at 0 Hz
    first_edge = max(float(spectrum.low[0]), 1e-3)
    edges = np.append(np.maximum(spectrum.low, first_edge), spectrum.high[-1])
    healthy_min = spectrum.healthy.min(axis=0)
    healthy_median = np.median(spectrum.healthy, axis=0)
    healthy_max = spectrum.healthy.max(axis=0)
    piston_pass = (facts.shaft or 0.0) * (facts.pistons or 0)

    figure, axes = create_panels(count, 1, 1.1 + 1.25 * count, sharex=True)
    for row, (panel, name) in enumerate(zip(axes[:, 0], spectrum.channels, strict=True)):
        _mark_piston_pass(panel, piston_pass)
        panel.stairs(
            healthy_max[row],
            edges,
            baseline=healthy_min[row],
            fill=True,
            color=LIGHT,
            label="range of healthy recordings",
        )
        _draw_steps(panel, edges, healthy_median[row], "their median", MEASURED, 0.9)
        _draw_steps(panel, edges, spectrum.level[row], "this recording", CALIBRATED, 1.5)
        panel.set_title(format_label(name), loc="left")

    axis_start = min(max(_MIN_AXIS_START_HZ, 0.7 * (facts.shaft or 0.0)), edges[-2])
    axes[0, 0].set(xscale="log", xlim=(max(edges[0], axis_start), edges[-1]))
    axes[count // 2, 0].set_ylabel(f"level [dB re 1 ({format_unit(spectrum.unit)})²/Hz]")
    axes[-1, 0].set_xlabel("frequency [Hz]")
    label_log_axis(axes[-1, 0].xaxis)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)

    marked = ""
    if piston_pass:
        marked = " Dashed: the piston-pass line and its multiples."
    caption = (
        f"Blue: this recording. Gray: {spectrum.basis}; the line is their median, the band their "
        f"range.{marked} 6 dB are twice the amplitude."
    )
    columns = {
        "channel": np.repeat(spectrum.channels, len(spectrum.low)),
        "low_hz": np.tile(spectrum.low, count),
        "high_hz": np.tile(spectrum.high, count),
        "level_db": spectrum.level.ravel(),
        "healthy_min_db": healthy_min.ravel(),
        "healthy_median_db": healthy_median.ravel(),
        "healthy_max_db": healthy_max.ravel(),
    }
    return render_drawing(
        f"{key}_spectrum",
        figure,
        columns,
        title="Spectrum over the healthy recordings",
        caption=caption,
        description=spectrum.sentence(),
    )


def _draw_steps(
    panel: Axes, edges: np.ndarray, level: np.ndarray, label: str, color: str, linewidth: float
) -> None:
    """Draw the level of each band between its edges, without lines down to the axis."""
    panel.stairs(level, edges, color=color, linewidth=linewidth, baseline=None, label=label)


def _mark_piston_pass(panel: Axes, piston_pass: float) -> None:
    """Mark the piston-pass line [Hz] and its multiples, if it is known."""
    if not piston_pass:
        return
    for multiple in range(1, _N_MARKED_LINES + 1):
        position = multiple * piston_pass
        panel.axvline(position, color="#888888", linewidth=1.0, linestyle=(0, (4, 2)), zorder=3)


_NOT_CHECKED_BY_DETECTOR = (
    "Which fault it is: healthy recordings show the baseline, not what a fault looks like.",
    "Whether the healthy recordings cover all healthy operation, such as warm and cold oil: a "
    "recording under conditions that none of them covers raises an alarm as well.",
    "Whether several recordings of one day are independent: the false-alarm rate holds for "
    "recordings that scatter as the healthy ones do.",
)


def build_anomaly_part(verdict: Diagnosis, key: str) -> Part:
    """Return the part of the page about one verdict of a detector."""
    blocks: list[Any] = [Bullets("Channels that changed as a whole", verdict.shifts)]
    if verdict.deviation is not None:
        blocks += [_tabulate_changes(verdict), draw_band_changes(verdict, key)]
    blocks.append(Bullets("What was not checked", _NOT_CHECKED_BY_DETECTOR))

    answer: tuple[str, ...]
    actions: tuple[str, ...]
    tone: Tone
    urgency = _NO_VERDICT_URGENCY
    certainty = (verdict.sentence(), *verdict.notes)
    if verdict.alarm is None:
        title = "No verdict"
        tone = "unsure"
        answer = (capitalize_sentence(verdict.no_verdict or ""),)
        actions = NO_VERDICT_ACTIONS
        certainty = verdict.notes
    elif verdict.alarm:
        title = "Alarm: differs from the healthy recordings"
        tone = "bad"
        largest = verdict.largest_changes or "no single band"
        answer = (
            f"It differs from the healthy recordings. Largest changes: {largest}.",
            *describe_spectrum(verdict.spectrum),
        )
        urgency = _describe_urgency(replace(verdict, unknown=True), ())
        actions = tuple(check.what for check in next_checks(unknown=True))
    else:
        title = "No alarm"
        tone = "good"
        urgency = _describe_urgency(verdict, ())
        answer = (
            "It differs from the healthy recordings no more than they differ from each other.",
            *describe_spectrum(verdict.spectrum),
        )
        actions = (
            "Nothing now. Record again at the same speed and pressure, and keep this recording as "
            "a reference.",
        )

    return Part(
        title=f"Deviation of {verdict.recording_id}",
        answer=answer,
        notice=rig_notice(verdict.facts),
        sections=(
            Section(SectionOrder.VERDICT, "What changed, and what was not checked", tuple(blocks)),
        ),
        results={"diagnoses": [verdict.to_dict()]},
        verdict=title,
        tone=tone,
        urgency=urgency,
        certainty=certainty,
        actions=actions,
        glance=build_glance(verdict, key, ()),
        subject=verdict.recording_id,
        facts=_list_facts_of_machine(verdict),
    )


def _tabulate_changes(verdict: Diagnosis) -> Table:
    """Return the bands that changed most."""
    rows = tuple(
        (
            change.band,
            format_label(change.channel),
            f"{change.change:+.1f}",
            format_number(change.spreads),
        )
        for change in verdict.changes
    )
    caption = (
        "Band powers that changed, the largest changes first: change from the mean of the healthy "
        "recordings, and the same over the standard deviation of such a difference between healthy "
        "ones. Alarms are raised by all band powers together, not by one."
    )
    return Table(caption, ("band", "channel", "change [dB]", "standard deviations"), rows)


def _band_center(band: BandPower) -> float:
    """Return where a band is drawn: at its order, or at its middle [Hz] on a logarithmic axis."""
    if band.order is not None:
        return band.order
    return math.sqrt(band.low * band.high)


@figure_style()
def draw_band_changes(verdict: Diagnosis, key: str) -> Drawing:
    """Draw the change of each band, and of each shaft order, channel by channel, with three
    standard deviations in gray.
    """
    assert verdict.deviation is not None
    bands = verdict.band_powers
    change = verdict.deviation.change
    spreads = verdict.deviation.spreads
    healthy_std = change / np.where(spreads == 0, 1, spreads)
    centers = np.array([_band_center(band) for band in bands])
    channels = list(dict.fromkeys(band.channel for band in bands))
    has_orders = any(band.order is not None for band in bands)

    figure, axes = create_panels(
        len(channels), 1 + has_orders, 1.0 + 1.3 * len(channels), sharey=True, sharex="col"
    )
    for row, channel in enumerate(channels):
        for column in range(1 + has_orders):
            panel = axes[row, column]
            shows_orders = bool(column)
            members = [
                index
                for index, band in enumerate(bands)
                if band.channel == channel
                and not band.is_envelope
                and (band.order is not None) is shows_orders
            ]
            reach = 3 * healthy_std[members]
            panel.fill_between(centers[members], -reach, reach, color=LIGHT, linewidth=0)
            panel.axhline(0, color=MEASURED, linewidth=0.8)
            panel.plot(
                centers[members],
                change[members],
                color=CALIBRATED,
                marker=".",
                markersize=4,
                linewidth=1,
            )
            panel.set_title(format_label(channel), loc="left")
            if not shows_orders:
                panel.set_xscale("log")
                label_log_axis(panel.xaxis)

    axes[len(channels) // 2, 0].set_ylabel("change [dB]")
    axes[-1, 0].set_xlabel("frequency [Hz]")
    if has_orders:
        axes[-1, 1].set_xlabel("shaft order")
    columns = {
        "channel": [band.channel for band in bands],
        "band": [band.describe() for band in bands],
        "change_db": change.tolist(),
        "standard_deviations": spreads.tolist(),
    }
    caption = (
        "Blue: this recording less the mean of the healthy ones. Gray: three standard deviations "
        "of healthy ones. The data include the band powers of the envelope."
    )
    return render_drawing(
        f"{key}_band_powers", figure, columns, title="Change of the band powers", caption=caption
    )
