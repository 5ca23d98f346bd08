"""Part of the page about the evidence for one verdict."""

from typing import Any

import numpy as np

from swashtwin.diagnosis import Evidence, hertz
from swashtwin.report.drawing import Drawing, panels, render_drawing
from swashtwin.report.page import Bullets, Cell, Paragraph, Part, Picture, Section, SectionOrder, Table
from swashtwin.report.style import CALIBRATED, LIGHT, MEASURED, figure_style
from swashtwin.report.wording import number, number_cell, percent, words

_AGAINST = "#d55e00"
_LIMITS = (
    "Evidence says what the network looked at, not what causes the vibration: a line can speak for a class because it "
    "happened to differ between the pumps of the training.",
    "It compares with silence and with the second likeliest class only; lines shared by all classes do not show.",
    "Two lines that matter only together share their contribution; one alone may add nothing.",
)


def evidence_part(evidence: Evidence, key: str) -> Part:
    """Part of the page about the evidence for one verdict."""
    span = evidence.moment * evidence.moments.shape[1]
    introduction = (
        f"From {evidence.start:.3g} s to {evidence.start + span:.3g} s of the recording, the stretch that speaks most "
        f"for the verdict. The network's score of {words(evidence.label)} less that of {words(evidence.rival)} "
        f"changes by {number(evidence.margin)} from silence to these samples"
    )
    pictures: tuple[Picture, ...] = ()
    if evidence.adds_up:
        gap = percent(evidence.gap) if evidence.gap else "0 %"
        introduction += f"; integrated gradients divide that between lines and moments (all but {gap} of it)."
        pictures = Picture(line_drawing(evidence, key)), Picture(moment_drawing(evidence, key))
    else:
        introduction += f". {evidence.remark} The order of the lines may still help."
    blocks = (
        Paragraph(introduction),
        *pictures[:1],
        _line_table(evidence),
        *pictures[1:],
        _neighbor_table(evidence),
        Bullets("What to check next", tuple(f"{check.what} {check.why}" for check in evidence.checks)),
        Bullets("What this evidence is not", _LIMITS),
    )
    return Part(
        title=f"Evidence for {evidence.recording_id}",
        answer=evidence.sentences(),
        notice="",
        sections=(
            Section(SectionOrder.VERDICT, f"Why {words(evidence.label)}: evidence in {evidence.recording_id}", blocks),
        ),
        results={"evidence": [evidence.to_dict()]},
    )


@figure_style()
def line_drawing(evidence: Evidence, key: str) -> Drawing:
    """Contribution of each order and third octave to the score, channel by channel."""
    channels, positions = evidence.channels, np.arange(len(evidence.bands))
    figure, axes = panels(len(channels), 1, 1.1 + 1.35 * len(channels), sharex=True, sharey=True)
    for channel, name in enumerate(channels):
        panel, adds = axes[channel, 0], evidence.lines[channel]
        for band in evidence.bands:
            if evidence.pistons and band.order is not None and band.order % evidence.pistons == 0:
                panel.axvline(evidence.bands.index(band), color=LIGHT, linewidth=5, zorder=0)
        panel.bar(positions, adds, color=np.where(adds >= 0, CALIBRATED, _AGAINST), width=0.8)
        panel.axhline(0, color=MEASURED, linewidth=0.8)
        panel.set_title(words(name), loc="left")
        panel.grid(axis="x", visible=False)
    axes[len(channels) // 2, 0].set_ylabel("adds to the score")
    ticks = [i for i, band in enumerate(evidence.bands) if band.order in (1, *range(5, 100, 5))]
    octaves = [i for i, band in enumerate(evidence.bands) if band.order is None and band.low > 0][::3]
    labels = [str(evidence.bands[i].order) for i in ticks]
    labels += [f"from {hertz(evidence.bands[i].low)}" for i in octaves]
    axes[-1, 0].set_xticks(ticks + octaves, labels, rotation=90 if octaves else 0)
    has_orders = any(band.order is not None for band in evidence.bands)
    axes[-1, 0].set_xlabel("order of the shaft, then third octaves" if has_orders else "third octaves")
    marked = " Gray: the piston-pass line and its multiples." if evidence.pistons and has_orders else ""
    caption = (
        f"Blue speaks for {words(evidence.label)}, orange for {words(evidence.rival)}.{marked} A bar is the "
        "contribution of the lines in that order or third octave to the network's score."
    )
    columns: dict[str, Any] = {
        "channel": np.repeat(channels, len(positions)),
        "band": [band.name for _ in channels for band in evidence.bands],
        "low_hz": np.tile([band.low for band in evidence.bands], len(channels)),
        "high_hz": np.tile([band.high for band in evidence.bands], len(channels)),
        "adds": evidence.lines.ravel(),
        "rms": evidence.rms.ravel(),
    }
    return render_drawing(f"{key}_lines", figure, columns, title="Which lines speak for the verdict", caption=caption)


@figure_style()
def moment_drawing(evidence: Evidence, key: str) -> Drawing:
    """Contribution of each moment to the score, with the samples' peaks, channel by channel."""
    channels, count = evidence.channels, evidence.moments.shape[1]
    time = evidence.start + (np.arange(count) + 0.5) * evidence.moment
    figure, axes = panels(len(channels), 1, 0.9 + 1.25 * len(channels), sharex=True)
    limit = max(float(np.abs(evidence.moments).max()), 1e-12)
    for channel, name in enumerate(channels):
        panel, peaks = axes[channel, 0], evidence.peaks[channel]
        panel.fill_between(time, -peaks, peaks, step="mid", color=LIGHT, linewidth=0)
        beside, adds = panel.twinx(), evidence.moments[channel]
        for side, color in ((np.maximum(adds, 0), CALIBRATED), (np.minimum(adds, 0), _AGAINST)):
            beside.fill_between(time, side, step="mid", color=color, linewidth=0)
        beside.set_ylim(-1.1 * limit, 1.1 * limit)
        beside.set_yticks([])
        beside.grid(visible=False)
        panel.set_title(words(name), loc="left")
        panel.grid(axis="x", visible=False)
    axes[len(channels) // 2, 0].set_ylabel(f"samples [{evidence.unit}]")
    axes[-1, 0].set_xlabel("time [s]")
    caption = (
        f"Gray: peaks of the samples. Blue bars: moments that speak for {words(evidence.label)}, orange for "
        f"{words(evidence.rival)}, on one scale for all channels."
    )
    columns = {
        "channel": np.repeat(channels, count),
        "time_s": np.tile(time, len(channels)),
        "adds": evidence.moments.ravel(),
        "peak": evidence.peaks.ravel(),
    }
    return render_drawing(
        f"{key}_moments", figure, columns, title="Which moments speak for the verdict", caption=caption
    )


def _line_table(evidence: Evidence) -> Table:
    rows = []
    for channel, band, share in evidence.strongest(6):
        level = evidence.rms[evidence.channels.index(channel), evidence.bands.index(band)]
        shown = (Cell(percent(share)),) if evidence.adds_up else ()
        rows.append((Cell(evidence.describe(band)), Cell(words(channel)), *shown, number_cell(float(level))))
    header = ("line", "channel", *(("share",) if evidence.adds_up else ()), f"RMS [{evidence.unit}]")
    shares = "shares are of all contributions, for and against" if evidence.adds_up else "the strongest first"
    return Table(f"The strongest contributions to the verdict; {shares}.", header, tuple(rows))


def _neighbor_table(evidence: Evidence) -> Table:
    rows = tuple(
        (Cell(recording.recording_id), Cell(words(recording.label)), number_cell(recording.distance))
        for recording in evidence.nearest
    )
    caption = (
        "The training recordings nearest by their vibration features, independent of the network; distances in "
        "standard deviations between training recordings."
    )
    return Table(caption, ("recording", "class", "distance"), rows)
