"""Part of the page about whether a recording deviates from the healthy ones."""

import numpy as np

from swashtwin.diagnosis import Diagnosis, next_checks
from swashtwin.plot import CALIBRATED, LIGHT, MEASURED, figure_style, log_axis, panels, words
from swashtwin.report.diagnosis_part import NO_VERDICT_ACTIONS, glance, spectrum_sentences
from swashtwin.report.drawing import Drawing, render_drawing
from swashtwin.report.page import Bullets, Part, Section, SectionOrder, Table, Tone
from swashtwin.report.wording import fact_entries, number, rig_notice, sentence

_NOT_CHECKED = (
    "Which fault it is: healthy recordings say what is usual, not what a fault looks like.",
    "Whether the healthy recordings cover what is usual, such as warm and cold oil: a recording under what none of "
    "them saw is an alarm as well.",
    "Whether several recordings of one day are so many: the false-alarm rate holds for recordings that scatter as the "
    "healthy ones do.",
)


def anomaly_part(verdict: Diagnosis, key: str) -> Part:
    """Part of the page about one verdict."""
    blocks: tuple = (Bullets("Channels that moved as a whole", verdict.shifts),)
    if verdict.deviation is not None:
        blocks += (_change_table(verdict), level_drawing(verdict, key))
    blocks += (Bullets("What was not checked", _NOT_CHECKED),)
    spectrum = spectrum_sentences(verdict.spectrum)
    shown: dict[bool | None, tuple[str, Tone, tuple[str, ...], tuple[str, ...]]] = {
        True: (
            "Alarm: unlike the healthy recordings", "bad",
            (f"It differs from the healthy recordings. Moved: {verdict.moved or 'no single level'}.", *spectrum),
            tuple(check.what for check in next_checks(unknown=True)),
        ),
        False: (
            "No alarm", "good",
            ("It differs no more from the healthy recordings than these from each other.", *spectrum),
            ("Nothing now. Record again at the same speed and pressure, and keep this recording as a reference.",),
        ),
        None: ("No verdict", "unsure", (sentence(verdict.no_verdict or ""),), NO_VERDICT_ACTIONS),
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
        facts=fact_entries(verdict.facts),
    )


def _change_table(verdict: Diagnosis) -> Table:
    rows = tuple(
        (change.level, words(change.channel), f"{change.change:+.1f}", number(change.spreads))
        for change in verdict.changes
    )
    caption = (
        "Levels that moved, furthest first: change from the mean of the healthy recordings, and over the standard "
        "deviation of such a difference between healthy ones. Alarms are raised by all levels together, not by one."
    )
    return Table(caption, ("level", "channel", "change [dB]", "standard deviations"), rows)


@figure_style()
def level_drawing(verdict: Diagnosis, key: str) -> Drawing:
    """Change of each band, and of each shaft order, channel by channel, with three standard deviations in gray."""
    assert verdict.deviation is not None
    change = verdict.deviation.change
    spread = change / np.where(verdict.deviation.spreads == 0, 1, verdict.deviation.spreads)
    channels = list(dict.fromkeys(level.channel for level in verdict.levels))
    has_orders = any(level.order is not None for level in verdict.levels)
    figure, axes = panels(len(channels), 1 + has_orders, 1.0 + 1.3 * len(channels), sharey=True, sharex="col")
    for row, channel in enumerate(channels):
        for column in range(1 + has_orders):
            panel = axes[row, column]
            members = [
                index
                for index, level in enumerate(verdict.levels)
                if level.channel == channel and not level.is_envelope and (level.order is not None) is bool(column)
            ]
            levels = [verdict.levels[index] for index in members]
            center = [level.order if level.order is not None else (level.low * level.high) ** 0.5 for level in levels]
            panel.fill_between(center, -3 * spread[members], 3 * spread[members], color=LIGHT, linewidth=0)
            panel.axhline(0, color=MEASURED, linewidth=0.8)
            panel.plot(center, change[members], color=CALIBRATED, marker=".", markersize=4, linewidth=1)
            panel.set_title(words(channel), loc="left")
            if not column:
                panel.set_xscale("log")
                log_axis(panel.xaxis)
    axes[len(channels) // 2, 0].set_ylabel("change [dB]")
    axes[-1, 0].set_xlabel("frequency [Hz]")
    if has_orders:
        axes[-1, 1].set_xlabel("order of the shaft")
    columns = {
        "channel": [level.channel for level in verdict.levels],
        "level": [level.words() for level in verdict.levels],
        "change_db": change.tolist(),
        "standard_deviations": verdict.deviation.spreads.tolist(),
    }
    caption = (
        "Blue: this recording less the mean of the healthy ones. Gray: three standard deviations of healthy ones. "
        "The data hold the levels of the envelope too."
    )
    return render_drawing(f"{key}_levels", figure, columns, title="Change of the levels", caption=caption)
