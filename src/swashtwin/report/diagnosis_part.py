"""Part of the page about one recording: its class, or whether it deviates from the healthy ones."""

from dataclasses import replace

import numpy as np
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
from swashtwin.pump import is_healthy
from swashtwin.recordings import RecordingSummary
from swashtwin.report.drawing import Cutaway, Drawing, build_cutaways, render_drawing
from swashtwin.report.model_part import build_choice_blocks
from swashtwin.report.page import Bullets, Group, Part, Section, SectionOrder, Table, Tone
from swashtwin.report.wording import (
    end_sentence,
    format_number,
    format_percent,
    list_facts,
    rig_notice,
)

_UNCALIBRATED = "The model's confidence was not calibrated, so the score ranks the classes and is no probability."
_MOST_NOTES, _MOST_CHECKS = 3, 4
NO_VERDICT_ACTIONS = (
    "Look at what the reason names: the sensor, its cable, the file.",
    "Then record again at the same speed and pressure; swashtwin inspect says whether a recording can be used.",
)
_NOT_CHECKED = (
    "Whether the pump has a fault of a class that was never trained: the answer is always one of the classes listed.",
    "Whether it has two faults at once.",
    "Whether pump, sensors and mounting resemble those of the training; scores at L4 show the cost of another pump.",
    "Whether the score is a probability: windows of one recording are not independent, so it only ranks the classes.",
)
_NOT_CHECKED_BY_PRIOR = (
    *_NOT_CHECKED[:2],
    "Whether this machine is like the virtual pumps on which the prior was trained.",
)
_NOT_CHECKED_BY_TRUST = (
    _NOT_CHECKED[1],
    "Whether this recording resembles those that calibrated the confidence: rates and thresholds hold only for their "
    "pumps, sensors, mountings and conditions.",
    "A fault never trained that looks like a trained class: only recordings far from all trained classes are called "
    "unknown.",
)


def build_diagnosis_part(diagnosis: Diagnosis, key: str) -> Part:
    """Part of the page about one diagnosis."""
    frame = Part(
        title=f"Diagnosis of {diagnosis.recording_id}",
        notice=rig_notice(diagnosis.facts),
        results={"diagnoses": [diagnosis.to_dict()]},
        subject=diagnosis.recording_id,
        facts=list_facts(diagnosis.facts),
    )
    if diagnosis.label is None:
        reason, title = diagnosis.no_verdict or "", "Why there is no verdict"
        reasons: tuple = (Bullets(title, (reason,)), Bullets("Notes", diagnosis.notes))
        return replace(
            frame,
            answer=(end_sentence(reason),),
            sections=(Section(SectionOrder.VERDICT, title, reasons),),
            verdict="No verdict",
            tone="unsure",
            actions=NO_VERDICT_ACTIONS,
        )
    unknown, possible = diagnosis.unknown, diagnosis.prediction_set
    sure = (_UNCALIBRATED,) if diagnosis.error_rate is None else (diagnosis.sentence(),)
    notes = tuple(note for note in diagnosis.notes if note not in sure[0])
    far = (
        f"Its distance is {format_number(diagnosis.score)}; below "
        f"{format_number(diagnosis.threshold)} it would be a known one."
    )
    far = diagnosis.reasons[0] if diagnosis.kind == "prior" and unknown else far
    certainty = (
        sure
        if diagnosis.is_prior_unknown
        else (*sure, far)
        if unknown
        else (*_how_sure(diagnosis), *sure)
    )
    labels = tuple(diagnosis.fault_of.get(name, name) for name in possible or (diagnosis.label,))
    not_checked = _NOT_CHECKED if diagnosis.error_rate is None else _NOT_CHECKED_BY_TRUST
    chosen = build_choice_blocks(diagnosis.choice)
    blocks = (
        Bullets("More to know before trusting it", notes[_MOST_NOTES:]),
        draw_probabilities(diagnosis, key),
        *((Group("How the model was chosen", chosen, is_open=False),) if chosen else ()),
        Bullets(
            "What was not checked",
            _NOT_CHECKED_BY_PRIOR if diagnosis.kind == "prior" else not_checked,
        ),
    )
    verdict, tone = _verdict(diagnosis)
    return replace(
        frame,
        answer=_answer(diagnosis),
        sections=(Section(SectionOrder.VERDICT, "How the verdict came about", blocks),),
        verdict=verdict,
        tone=tone,
        certainty=(*certainty, *notes[:_MOST_NOTES]),
        actions=tuple(check.what for check in next_checks(*labels, unknown=unknown)[:_MOST_CHECKS]),
        glance=glance(diagnosis, key, () if unknown or is_healthy(diagnosis.label) else labels[:1]),
    )


def _how_sure(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What stands for the verdict, in a sentence."""
    assert diagnosis.label is not None
    count, share = (
        len(diagnosis.probabilities),
        format_percent(diagnosis.probabilities[diagnosis.label]),
    )
    if diagnosis.kind == "prior":
        return (f"Of {count} classes the pump prior gives this one a probability of {share}.",)
    agreeing = round(diagnosis.agreement * diagnosis.n_windows)
    kind = "score" if diagnosis.error_rate is None else "probability"
    return (
        f"Of {count} classes this one has a {kind} of {share}, all windows together; taken alone, {agreeing} of "
        f"{diagnosis.n_windows} windows say so ({format_percent(diagnosis.agreement)}).",
    )


def _verdict(diagnosis: Diagnosis) -> tuple[str, Tone]:
    """The verdict in a few words, and its color."""
    assert diagnosis.label is not None
    if diagnosis.is_prior_unknown:
        return "Unknown: like a fault that was never trained", "unsure"
    if diagnosis.unknown:
        return "Unknown: unlike every recording of the training", "unsure"
    if len(diagnosis.prediction_set) > 1:
        return f"Not certain: {' or '.join(map(format_label, diagnosis.prediction_set))}", "unsure"
    if is_healthy(diagnosis.label):
        return "No fault found", "good"
    return f"Suspected fault: {format_label(diagnosis.label)}", "bad"


def _answer(diagnosis: Diagnosis) -> tuple[str, ...]:
    """The verdict in a sentence, and how the spectrum differs from healthy ones."""
    if diagnosis.unknown:
        return (
            diagnosis.reasons[0]
            if diagnosis.is_prior_unknown
            else "It names no class: the recording does not resemble those trained.",
            *spectrum_sentences(diagnosis.spectrum),
        )
    name = format_label(diagnosis.label or "")
    nearest = f"The vibration is most like that of recordings of the class {name}."
    if diagnosis.kind == "prior":
        nearest = f"The change against {diagnosis.basis} is most like that of simulated pumps of the class {name}."
    return (nearest, *spectrum_sentences(diagnosis.spectrum))


def glance(verdict: Diagnosis, key: str, labels: tuple[str, ...]) -> tuple[Drawing | Cutaway, ...]:
    """The spectrum over healthy recordings, and the pump with the part of each label marked."""
    facts, spectrum = verdict.facts, verdict.spectrum
    pictures = () if spectrum is None else (spectrum_over_healthy(spectrum, facts, key),)
    return (
        *(cut for label in labels for cut in build_cutaways(label, facts.pistons, facts.shaft)),
        *pictures,
    )


@figure_style()
def draw_probabilities(diagnosis: Diagnosis, key: str) -> Drawing:
    """Score of each class."""
    classes, shares = list(diagnosis.probabilities), list(diagnosis.probabilities.values())
    colors = series_colors(classes)
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
    kind = "score" if diagnosis.error_rate is None else "probability"
    of_windows = f"{kind} of the class, all windows together"
    panel.set_xlabel("probability by virtual pumps" if diagnosis.kind == "prior" else of_windows)
    panel.xaxis.set_major_formatter(PercentFormatter(1, symbol=" %"))
    panel.set_xticks([0, 0.2, 0.4, 0.6, 0.8, 1])
    panel.invert_yaxis()
    panel.grid(axis="y", visible=False)
    caption = "From the mean log-probability over the windows. It ranks the classes and is no calibrated probability."
    if diagnosis.kind == "prior":
        caption = (
            "Probability of each class, softened by virtual pumps whose effects taught nothing."
        )
    if diagnosis.error_rate is not None:
        possible = ", ".join(format_label(name) for name in diagnosis.prediction_set)
        caption = (
            f"Pooled over the windows, with the temperature and the dependence of windows by {diagnosis.basis}. "
            f"Not ruled out at an error rate of {format_percent(diagnosis.error_rate)}: {possible}."
        )
    columns: dict[str, list] = {"class": classes, "score": shares}
    return render_drawing(
        f"{key}_scores",
        figure,
        columns,
        title=f"{kind.capitalize()} of each class",
        caption=caption,
    )


_MARKS = 4  # multiples of the piston-pass line
_LOWEST = 5.0  # frequency from which the axis begins at least [Hz]
_FEW_HEALTHY = 5
"""Healthy recordings below which their range is too narrow to judge by."""


def spectrum_sentences(spectrum: HealthySpectrum | None) -> tuple[str, ...]:
    """How a recording differs from healthy ones, and that few of them span a narrow range."""
    if spectrum is None:
        return ()
    if (count := len(spectrum.healthy)) >= _FEW_HEALTHY:
        return (spectrum.sentence(),)
    return (
        f"{spectrum.sentence()} {plural(count, 'healthy recording')} {'spans' if count == 1 else 'span'} a narrow "
        "range: bands outside it are no sign of a fault by themselves.",
    )


@figure_style()
def spectrum_over_healthy(spectrum: HealthySpectrum, facts: RecordingSummary, key: str) -> Drawing:
    """Levels of a recording, channel by channel, over the range and the median of healthy ones."""
    count, first = len(spectrum.channels), max(float(spectrum.low[0]), 1e-3)
    edges = np.append(np.maximum(spectrum.low, first), spectrum.high[-1])
    figure, axes = create_panels(count, 1, 1.1 + 1.25 * count, sharex=True)
    healthy, passing = spectrum.healthy, (facts.shaft or 0.0) * (facts.pistons or 0)
    least, median, greatest = healthy.min(axis=0), np.median(healthy, axis=0), healthy.max(axis=0)
    for row, (panel, name) in enumerate(zip(axes[:, 0], spectrum.channels, strict=True)):
        for multiple in range(1, _MARKS + 1) if passing else ():
            panel.axvline(
                multiple * passing, color="#888888", linewidth=1.0, linestyle=(0, (4, 2)), zorder=3
            )
        panel.stairs(
            greatest[row],
            edges,
            baseline=least[row],
            fill=True,
            color=LIGHT,
            label="range of healthy ones",
        )
        panel.stairs(
            median[row], edges, color=MEASURED, linewidth=0.9, baseline=None, label="their median"
        )
        panel.stairs(
            spectrum.level[row],
            edges,
            color=CALIBRATED,
            linewidth=1.5,
            baseline=None,
            label="this recording",
        )
        panel.set_title(format_label(name), loc="left")
    lowest = min(max(_LOWEST, 0.7 * (facts.shaft or 0.0)), edges[-2])
    axes[0, 0].set(xscale="log", xlim=(max(edges[0], lowest), edges[-1]))
    unit = format_unit(spectrum.unit)
    axes[count // 2, 0].set_ylabel(f"level [dB re 1 ({unit})²/Hz]")
    axes[-1, 0].set_xlabel("frequency [Hz]")
    label_log_axis(axes[-1, 0].xaxis)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    marked = " Dashed: the piston-pass line and its multiples." if passing else ""
    caption = (
        f"Blue: this recording. Gray: {spectrum.basis}; the line is their median, the band reaches from the least to "
        f"the greatest.{marked} 6 dB are twice the amplitude."
    )
    columns = {
        "channel": np.repeat(spectrum.channels, len(spectrum.low)),
        "low_hz": np.tile(spectrum.low, count),
        "high_hz": np.tile(spectrum.high, count),
        "level_db": spectrum.level.ravel(),
        "healthy_least_db": least.ravel(),
        "healthy_median_db": median.ravel(),
        "healthy_greatest_db": greatest.ravel(),
    }
    title, description = "Spectrum over the healthy recordings", spectrum.sentence()
    return render_drawing(
        f"{key}_spectrum", figure, columns, title=title, caption=caption, description=description
    )


_NOT_CHECKED_BY_DETECTOR = (
    "Which fault it is: healthy recordings say what is usual, not what a fault looks like.",
    "Whether the healthy recordings cover what is usual, such as warm and cold oil: a recording under what none of "
    "them saw is an alarm as well.",
    "Whether several recordings of one day are so many: the false-alarm rate holds for recordings that scatter as the "
    "healthy ones do.",
)


def build_anomaly_part(verdict: Diagnosis, key: str) -> Part:
    """Part of the page about one verdict."""
    blocks: tuple = (Bullets("Channels that moved as a whole", verdict.shifts),)
    if verdict.deviation is not None:
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
            "Levels that moved, furthest first: change from the mean of the healthy recordings, and over the standard "
            "deviation of such a difference between healthy ones. Alarms are raised by all levels together, not by one."
        )
        table = Table(caption, ("level", "channel", "change [dB]", "standard deviations"), rows)
        blocks += (table, draw_band_changes(verdict, key))
    blocks += (Bullets("What was not checked", _NOT_CHECKED_BY_DETECTOR),)
    spectrum = spectrum_sentences(verdict.spectrum)
    shown: dict[bool | None, tuple[str, Tone, tuple[str, ...], tuple[str, ...]]] = {
        True: (
            "Alarm: unlike the healthy recordings", "bad",
            (
                "It differs from the healthy recordings. Largest changes: "
                f"{verdict.largest_changes or 'no single level'}.",
                *spectrum,
            ),
            tuple(check.what for check in next_checks(unknown=True)),
        ),
        False: (
            "No alarm", "good",
            ("It differs no more from the healthy recordings than these from each other.", *spectrum),
            ("Nothing now. Record again at the same speed and pressure, and keep this recording as a reference.",),
        ),
        None: ("No verdict", "unsure", (end_sentence(verdict.no_verdict or ""),), NO_VERDICT_ACTIONS),
    }  # fmt: skip
    title, tone, answer, actions = shown[verdict.alarm]
    return Part(
        title=f"Deviation of {verdict.recording_id}",
        answer=answer,
        notice=rig_notice(verdict.facts),
        sections=(Section(SectionOrder.VERDICT, "What moved, and what was not checked", blocks),),
        results={"diagnoses": [verdict.to_dict()]},
        verdict=title,
        tone=tone,
        certainty=(*(() if verdict.alarm is None else (verdict.sentence(),)), *verdict.notes),
        actions=actions,
        glance=glance(verdict, key, ()),
        subject=verdict.recording_id,
        facts=list_facts(verdict.facts),
    )


@figure_style()
def draw_band_changes(verdict: Diagnosis, key: str) -> Drawing:
    """Change of each band, and of each shaft order, channel by channel, with three standard
    deviations in gray.
    """
    assert verdict.deviation is not None
    change = verdict.deviation.change
    spread = change / np.where(verdict.deviation.spreads == 0, 1, verdict.deviation.spreads)
    channels = list(dict.fromkeys(level.channel for level in verdict.band_powers))
    has_orders = any(level.order is not None for level in verdict.band_powers)
    figure, axes = create_panels(
        len(channels), 1 + has_orders, 1.0 + 1.3 * len(channels), sharey=True, sharex="col"
    )
    for row, channel in enumerate(channels):
        for column in range(1 + has_orders):
            panel = axes[row, column]
            members = [
                index
                for index, level in enumerate(verdict.band_powers)
                if level.channel == channel
                and not level.is_envelope
                and (level.order is not None) is bool(column)
            ]
            band_powers = [verdict.band_powers[index] for index in members]
            center = [
                level.order if level.order is not None else (level.low * level.high) ** 0.5
                for level in band_powers
            ]
            panel.fill_between(
                center, -3 * spread[members], 3 * spread[members], color=LIGHT, linewidth=0
            )
            panel.axhline(0, color=MEASURED, linewidth=0.8)
            panel.plot(
                center, change[members], color=CALIBRATED, marker=".", markersize=4, linewidth=1
            )
            panel.set_title(format_label(channel), loc="left")
            if not column:
                panel.set_xscale("log")
                label_log_axis(panel.xaxis)
    axes[len(channels) // 2, 0].set_ylabel("change [dB]")
    axes[-1, 0].set_xlabel("frequency [Hz]")
    if has_orders:
        axes[-1, 1].set_xlabel("order of the shaft")
    columns = {
        "channel": [level.channel for level in verdict.band_powers],
        "level": [level.words() for level in verdict.band_powers],
        "change_db": change.tolist(),
        "standard_deviations": verdict.deviation.spreads.tolist(),
    }
    caption = (
        "Blue: this recording less the mean of the healthy ones. Gray: three standard deviations of healthy ones. "
        "The data hold the levels of the envelope too."
    )
    return render_drawing(
        f"{key}_levels", figure, columns, title="Change of the levels", caption=caption
    )
