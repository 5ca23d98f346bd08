"""Part of the page about the evidence for one verdict."""

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
_NAMED = (1, *range(5, 100, 5))  # orders
_OF_ENVELOPES = (
    " Right of the signal's lines: those of the envelope (of all of the signal, and of its high frequencies alone), "
    "which show how often the vibration swells; then the level as a whole and the shape of the waveform."
)
_LIMITS = (
    "Evidence says what the network looked at, not what causes the vibration: a line can speak for a class because it "
    "happened to differ between the pumps of the training.",
    "It compares with {baseline} and with the second likeliest class only; lines shared by all classes do not show.",
    "Two lines that matter only together share their contribution; one alone may add nothing.",
)


def build_evidence_part(evidence: Evidence, key: str) -> Part:
    """Part of the page about the evidence for one verdict."""
    end = evidence.start + evidence.duration
    introduction = (
        f"This looks at {evidence.start:.3g} s to {end:.3g} s of the recording, the stretch that speaks "
        f"most for the verdict. Compared with {evidence.baseline}, these samples change the network's score of "
        f"{format_label(evidence.label)} over that of {format_label(evidence.rival)} by {format_number(evidence.margin)}"
    )
    pictures: tuple[Drawing, ...] = ()
    if evidence.adds_up:
        gap = format_percent(evidence.completeness_error) if evidence.completeness_error else "0 %"
        introduction += (
            ". The figure below divides that change between lines (by integrated gradients; "
        )
        introduction += f"{gap} of it is left over)."
        pictures = (draw_contributions(evidence, key),)
    else:
        introduction += f". {evidence.remark} The order of the lines may still help."
    header: tuple[str, ...] = (
        ("line", "channel", "share") if evidence.adds_up else ("line", "channel")
    )
    shares = (
        "shares are of all contributions, for and against"
        if evidence.adds_up
        else "the strongest first"
    )
    lines = [
        (evidence.describe(band), format_label(channel), format_percent(share))
        for channel, band, share in evidence.strongest(6)
    ]
    rows = tuple(line[: len(header)] for line in lines)
    nearest = tuple(
        (near.recording_id, format_label(near.label), format_number_cell(near.distance))
        for near in evidence.nearest
    )
    blocks = (
        *evidence.sentences()[1:],
        introduction,
        *pictures,
        Table(f"The strongest contributions to the verdict; {shares}.", header, rows),
        Table(
            "The training recordings nearest by their vibration features, independent of the network; distances in "
            "standard deviations between training recordings.",
            ("recording", "class", "distance"),
            nearest,
        ),
        Bullets(
            "What to check next", tuple(f"{check.what} {check.why}" for check in evidence.checks)
        ),
        Bullets(
            "What this evidence is not",
            tuple(limit.format(baseline=evidence.baseline) for limit in _LIMITS),
        ),
    )
    title = (
        "What the network looked at" if evidence.unknown else f"Why {format_label(evidence.label)}"
    )
    return Part(
        title=f"Evidence for {evidence.recording_id}",
        answer=evidence.sentences()[:1],
        sections=(
            Section(SectionOrder.VERDICT, f"{title}: evidence in {evidence.recording_id}", blocks),
        ),
        results={"evidence": [evidence.to_dict()]},
        subject=evidence.recording_id,
    )


@figure_style()
def draw_contributions(evidence: Evidence, key: str) -> Drawing:
    """Contribution of each order and third octave to the score, channel by channel."""
    channels = evidence.channels
    steps = [
        1 if after.part == band.part != "whole" else 4 for band, after in pairwise(evidence.bands)
    ]
    positions = np.concatenate(
        [[0], np.cumsum(steps, dtype=np.int64)]
    )  # parts apart, with room for a lone name
    figure, axes = create_panels(
        len(channels), 1, 1.1 + 1.35 * len(channels), sharex=True, sharey=True
    )
    for channel, name in enumerate(channels):
        panel, adds = axes[channel, 0], evidence.contributions[channel]
        for position, band in zip(positions, evidence.bands, strict=True):
            if evidence.pistons and band.order is not None and band.order % evidence.pistons == 0:
                panel.axvline(position, color=LIGHT, linewidth=5, zorder=0)
        panel.bar(positions, adds, color=np.where(adds >= 0, CALIBRATED, _AGAINST), width=0.8)
        panel.axhline(0, color=MEASURED, linewidth=0.8)
        panel.set_title(format_label(name), loc="left")
        panel.grid(axis="x", visible=False)
    axes[len(channels) // 2, 0].set_ylabel("adds to the score")
    _name_bands(axes[-1, 0], positions, evidence.bands)
    has_orders = any(band.order is not None for band in evidence.bands)
    has_envelope = any(band.part == "envelope" for band in evidence.bands)
    along = "order of the shaft, then third octaves" if has_orders else "third octaves"
    axes[-1, 0].set_xlabel(f"{along}; then the same of the envelope" if has_envelope else along)
    marked = (
        " Gray: the piston-pass line and its multiples." if evidence.pistons and has_orders else ""
    )
    caption = (
        f"Blue speaks for {format_label(evidence.label)}, orange for {format_label(evidence.rival)}.{marked} A bar is the "
        "contribution of the lines in that order or third octave to the network's score."
        f"{_OF_ENVELOPES if has_envelope else ''}"
    )
    columns: dict[str, Any] = {
        "channel": np.repeat(channels, len(positions)),
        "band": [band.name for _ in channels for band in evidence.bands],
        "low_hz": np.tile([band.low for band in evidence.bands], len(channels)),
        "high_hz": np.tile([band.high for band in evidence.bands], len(channels)),
        "adds": evidence.contributions.ravel(),
    }
    return render_drawing(
        f"{key}_lines", figure, columns, title="Which lines speak for the verdict", caption=caption
    )


def _name_bands(panel: Axes, positions: np.ndarray, bands: tuple[Band, ...]) -> None:
    """Ticks at every fifth order, every third of the third octaves, and what belongs to no band."""
    names: dict[int, str] = {}
    for part in ("signal", "envelope"):
        members = [index for index, band in enumerate(bands) if band.part == part]
        octaves = [
            index for index in members if bands[index].order is None and bands[index].low > 0
        ]
        names |= {
            index: str(bands[index].order) for index in members if bands[index].order in _NAMED
        }
        names |= {index: f"from {format_frequency(bands[index].low)}" for index in octaves[1::3]}
    names |= {index: band.name for index, band in enumerate(bands) if band.part == "whole"}
    upright = any(band.order is None and band.low > 0 for band in bands)
    panel.set_xticks(positions[list(names)], list(names.values()), rotation=90 if upright else 0)
