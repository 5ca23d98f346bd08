"""What is suspicious about the samples of one channel: clipping, dropouts, offsets."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int

from swashtwin.recordings.checks.findings import Finding
from swashtwin.recordings.recording import Recording

_CLIP_RUN = 3
"""Samples in a row at the extreme that count as clipped."""
_FLAT_SAMPLES, _FLAT_TIME = 20, 2e-3
"""A stretch of one value is flat from this many samples and this long [s] on."""
_OFFSET_RATIO = 5.0
"""Mean over standard deviation from which an offset is called large."""


def channel_findings(name: str, row: Float[np.ndarray, " time"], recording: Recording) -> Iterator[Finding]:
    clipped = clipped_samples(row)
    if clipped:
        message = f"{clipped} samples ({clipped / len(row):.2%}) stand in a row at the extreme: the range was exceeded."
        yield Finding("clipping", "warning", name, message)
    elif _touches_full_scale(row):
        message = (
            f"samples touch the converter's full scale ({row.min():.4g} to {row.max():.4g}): peaks may be cut off."
        )
        yield Finding("clipping", "warning", name, message)
    starts, lengths = _runs(row[1:] == row[:-1])
    interior = [not np.isclose(row[start], (np.nanmin(row), np.nanmax(row))).any() for start in starts]
    least = max(_FLAT_SAMPLES, _FLAT_TIME * recording.sample_rate)
    flat = (lengths + 1 >= least) & (np.array(interior, dtype=bool) | (clipped == 0))
    if flat.any():
        longest = int(np.argmax(np.where(flat, lengths, 0)))
        message = (
            f"{int(flat.sum())} flat stretches; the longest is {(lengths[longest] + 1) / recording.sample_rate:.4g} s "
            f"at {starts[longest] / recording.sample_rate:.4g} s: dropouts?"
        )
        yield Finding("flat", "warning", name, message)
    mean, std = float(np.nanmean(row[np.isfinite(row)])), float(np.nanstd(row[np.isfinite(row)]))
    if abs(mean) > _OFFSET_RATIO * std:
        message = (
            f"the offset {mean:.4g} {recording.unit} is {abs(mean) / std:.1f} times the vibration's std {std:.4g}."
        )
        yield Finding("offset", "warning", name, message)


def clipped_samples(row: Float[np.ndarray, " time"]) -> int:
    """Readings in runs at an extreme, where the extreme is crowded as only a stop makes it."""
    low, high = float(np.nanmin(row)), float(np.nanmax(row))
    if not (np.isfinite(low) and np.isfinite(high)):
        return 0
    total = 0
    for extreme in (low, high):
        at = np.abs(row - extreme) <= 1e-6 * (high - low)
        _, lengths = _runs(at)
        long = lengths[lengths >= _CLIP_RUN]
        near = np.count_nonzero(np.abs(row - extreme) <= 0.01 * (high - low)) - np.count_nonzero(at)
        if long.sum() > max(near, 2 * _CLIP_RUN - 1):
            total += int(long.sum())
    return total


def _touches_full_scale(row: Float[np.ndarray, " time"]) -> bool:
    """Whether several samples are -2^k or 2^k - 1 converter steps, as far as a converter of k + 1 bits reaches."""
    values = np.unique(row)
    if len(values) < 3 or not np.isfinite(values).all():
        return False
    step = float(np.diff(values).min())
    least, most = row.min() / step, row.max() / step
    if max(-least, most) > 2**24 or np.abs(values / step - np.round(values / step)).max() > 0.01:
        return False  # no converter's raw steps
    ends = [2**bits for bits in range(9, 24)]
    touching = 0
    if round(-least) in ends:
        touching += int(np.count_nonzero(row == values[0]))
    if round(most) + 1 in ends:
        touching += int(np.count_nonzero(row == values[-1]))
    return touching >= 2


def _runs(mask: Bool[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " run"], Int[np.ndarray, " run"]]:
    """First index and length of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return edges[::2], edges[1::2] - edges[::2]
