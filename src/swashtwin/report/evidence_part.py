"""Part of the page about the evidence for one verdict."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from swashtwin.diagnosis import Band, Evidence, format_frequency
from swashtwin.plot import CALIBRATED, LIGHT, MEASURED, create_panels, figure_style, format_label
from swashtwin.report.drawing import Drawing, render_drawing
from swashtwin.report.page import Bullets, Part, Section, SectionOrder, Table
from swashtwin.report.wording import format_number, format_number_cell, format_percent

_AGAINST = "#d55e00"
_LABELED_ORDERS = (1, *range(5, 100, 5))

# Contributions listed in the table.
_N_CONTRIBUTIONS = 6

_ENVELOPE_CAPTION = (
    " Right of the signal's lines: those of the envelope (of the whole signal, and of its high "
    "frequencies alone), which show how often the vibration swells; then the overall level and the "
    "shape of the waveform."
)
_LIMITS = (
    "Evidence shows what the network used, not what causes the vibration: a line can speak for a "
    "class because it happened to differ between the pumps of the training.",
    "It compares with {baseline} and with the second likeliest class only; lines shared by all "
    "classes do not show.",
    "Two lines that matter only together share their contribution; one alone may add nothing.",
)


def build_evidence_part(evidence: Evidence, key: str) -> Part:
    """Return the part of the page about the evidence for one verdict."""
    if evidence.unknown:
        # what speaks for a class would contradict the answer
        answer: tuple[str, ...] = ()
        blocks: list[Any] = [_tabulate_nearest(evidence)]
    else:
        first_sentence, *further_sentences = evidence.sentences()
        answer = (first_sentence,)
        blocks = [*further_sentences, _describe_margin(evidence)]
        if evidence.adds_up:
            blocks.append(draw_contributions(evidence, key))
        blocks += [_tabulate_contributions(evidence), _tabulate_nearest(evidence)]

    checks = tuple(f"{check.what} {check.why}" for check in evidence.checks)
    blocks.append(Bullets("What to check next", checks))
    if not evidence.unknown:
        limits = tuple(limit.format(baseline=evidence.baseline) for limit in _LIMITS)
        blocks.append(Bullets("Limits of this evidence", limits))

    title = f"Why {format_label(evidence.label)}"
    if evidence.unknown:
        title = "What it resembles"
    heading = f"{title}: evidence in {evidence.recording_id}"
    return Part(
        title=f"Evidence for {evidence.recording_id}",
        answer=answer,
        sections=(Section(SectionOrder.VERDICT, heading, tuple(blocks)),),
        results={"evidence": [evidence.to_dict()]},
        subject=evidence.recording_id,
    )


def _describe_margin(evidence: Evidence) -> str:
    """Return which samples are explained, and by how much they change the score."""
    end = evidence.start + evidence.duration
    change = (
        f"This evidence is of {evidence.start:.3g} s to {end:.3g} s of the recording, the section "
        f"that speaks most for the verdict. Compared with {evidence.baseline}, these samples "
        f"change the network's score of {format_label(evidence.label)} over that of "
        f"{format_label(evidence.rival)} by {format_number(evidence.margin)}."
    )
    if not evidence.adds_up:
        return f"{change} {evidence.remark} The order of the lines may still help."
    gap = format_percent(evidence.completeness_error)
    return (
        f"{change} The figure below divides that change between lines (by integrated gradients; "
        f"{gap} of it is not attributed)."
    )


def _tabulate_contributions(evidence: Evidence) -> Table:
    """Return the lines that contribute most to the verdict."""
    rows = [
        (evidence.describe(band), format_label(channel), format_percent(share))
        for channel, band, share in evidence.strongest(_N_CONTRIBUTIONS)
    ]
    if evidence.adds_up:
        caption = (
            "The strongest contributions to the verdict; shares are of all contributions, for and "
            "against."
        )
        return Table(caption, ("line", "channel", "share"), tuple(rows))

    # shares that do not add up are not shown
    caption = "The strongest contributions to the verdict; the strongest first."
    return Table(caption, ("line", "channel"), tuple(row[:2] for row in rows))


def _tabulate_nearest(evidence: Evidence) -> Table:
    """Return the training recordings nearest to this one."""
    rows = tuple(
        (neighbor.recording_id, format_label(neighbor.label), format_number_cell(neighbor.distance))
        for neighbor in evidence.nearest
    )
    caption = (
        "The training recordings nearest by their vibration features, independent of the network; "
        "distances in standard deviations between training recordings."
    )
    return Table(caption, ("recording", "class", "distance"), rows)


@figure_style()
def draw_contributions(evidence: Evidence, key: str) -> Drawing:
    """Draw the contribution of each order and third octave to the score, channel by channel."""
    channels = evidence.channels
    bands = evidence.bands
    positions = _position_bands(bands)
    has_orders = any(band.order is not None for band in bands)
    has_envelope = any(band.part == "envelope" for band in bands)

    figure, axes = create_panels(
        len(channels), 1, 1.1 + 1.35 * len(channels), sharex=True, sharey=True
    )
    for row, name in enumerate(channels):
        panel = axes[row, 0]
        contributions = evidence.contributions[row]
        for position, band in zip(positions, bands, strict=True):
            if evidence.pistons and band.order is not None and band.order % evidence.pistons == 0:
                panel.axvline(position, color=LIGHT, linewidth=5, zorder=0)
        colors = np.where(contributions >= 0, CALIBRATED, _AGAINST)
        panel.bar(positions, contributions, color=colors, width=0.8)
        panel.axhline(0, color=MEASURED, linewidth=0.8)
        panel.set_title(format_label(name), loc="left")
        panel.grid(axis="x", visible=False)
    axes[len(channels) // 2, 0].set_ylabel("adds to the score")
    _label_bands(axes[-1, 0], positions, bands)
    axis_label = "third octaves"
    if has_orders:
        axis_label = "shaft order, then third octaves"
    if has_envelope:
        axis_label += "; then the same of the envelope"
    axes[-1, 0].set_xlabel(axis_label)

    marked = ""
    if evidence.pistons and has_orders:
        marked = " Gray: the piston-pass line and its multiples."
    caption = (
        f"Blue speaks for {format_label(evidence.label)}, orange for "
        f"{format_label(evidence.rival)}.{marked} A bar is the contribution of the lines in that "
        "order or third octave to the network's score."
    )
    if has_envelope:
        caption += _ENVELOPE_CAPTION
    columns: dict[str, Any] = {
        "channel": np.repeat(channels, len(positions)),
        "band": [band.name for band in bands] * len(channels),
        "low_hz": np.tile([band.low for band in bands], len(channels)),
        "high_hz": np.tile([band.high for band in bands], len(channels)),
        "adds": evidence.contributions.ravel(),
    }
    return render_drawing(
        f"{key}_lines", figure, columns, title="Which lines speak for the verdict", caption=caption
    )


def _position_bands(bands: Sequence[Band]) -> np.ndarray:
    """Return the positions of the bars: parts apart, with room for the name of a lone band."""
    steps = []
    for band, following in pairwise(bands):
        is_adjacent = following.part == band.part and band.part != "whole"
        steps.append(1 if is_adjacent else 4)
    return np.concatenate([[0], np.cumsum(steps, dtype=np.int64)])


def _label_bands(panel: Axes, positions: np.ndarray, bands: Sequence[Band]) -> None:
    """Label every fifth order, every third of the third octaves, and what belongs to no band."""
    names: dict[int, str] = {}
    for part in ("signal", "envelope"):
        members = [index for index, band in enumerate(bands) if band.part == part]
        octaves = [
            index for index in members if bands[index].order is None and bands[index].low > 0
        ]
        for index in members:
            if bands[index].order in _LABELED_ORDERS:
                names[index] = str(bands[index].order)
        for index in octaves[1::3]:
            names[index] = f"from {format_frequency(bands[index].low)}"
    for index, band in enumerate(bands):
        if band.part == "whole":
            names[index] = band.name

    rotation = 0
    if any(band.order is None and band.low > 0 for band in bands):
        rotation = 90  # frequencies are too long to stand side by side
    panel.set_xticks(positions[list(names)], list(names.values()), rotation=rotation)
