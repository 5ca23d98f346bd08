"""Excerpts of a long recording, which stand for it in whatever transforms all samples at once."""

import math

import numpy as np

from swashtwin.recordings import Recording, specified_shaft_frequency

MAX_WHOLE_VALUES = 1 << 23
"""Samples of all channels up to which a recording is used as a whole: 64 MB in double precision."""
MAX_TURNED_SAMPLES = 1 << 21
"""Samples of one channel up to which a recording is resampled by angle as a whole.

That takes 500 bytes for each sample of one channel after the other: 1 GB.
"""
EXCERPT_COUNT = 8
"""Maximum number of excerpts whose spectra are averaged."""
MIN_EXCERPT_S = 0.5
"""Shortest excerpt [s], which resolves 2 Hz."""
MIN_EXCERPT_TURNS = 20
"""Turns of the shaft in the shortest excerpt, which resolve 0.05 orders."""

# Samples of all channels and excerpts together: 8 MB, whose spectra take about a second. Of many
# channels, or of a slow shaft, there are fewer excerpts.
_EXCERPT_VALUES = 1 << 20

# A single excerpt is no longer, unless a slow shaft requires it: a hundred turns at 1500 rpm, and
# 5.1 s at 51.2 kHz.
_MAX_SINGLE_SAMPLES = 1 << 18

# Samples of one channel that a slow shaft may require: 20 turns at 115 rpm and 50 kHz. Resampled
# by angle, they leave the process of a recording of 2 GB below 1 GB.
_MAX_REQUIRED_SAMPLES = 1 << 19


def is_long(recording: Recording) -> bool:
    """Return whether a recording has too many samples to be read as a whole."""
    return recording.n_samples * recording.n_channels > MAX_WHOLE_VALUES


def excerpts(
    recording: Recording, count: int = EXCERPT_COUNT, *, max_samples: int = MAX_WHOLE_VALUES
) -> list[Recording]:
    """Return a recording itself, or excerpts of a long one, spread evenly over it.

    Parameters
    ----------
    count : maximum number of excerpts; one is in the middle.
    max_samples : samples of one channel up to which it is the recording itself, unless it is long.
    """
    if not is_long(recording) and recording.n_samples <= max_samples:
        return [recording]

    n_channels = recording.n_channels
    min_length = _min_length(recording)
    count = max(1, min(count, _EXCERPT_VALUES // (min_length * n_channels)))
    usual_length = min(_EXCERPT_VALUES // (count * n_channels), _MAX_SINGLE_SAMPLES)
    length = max(usual_length, min_length)
    starts = np.linspace(0, recording.n_samples - length, count + 2)[1:-1].astype(int)
    return [recording.slice(start, start + length) for start in starts.tolist()]


def _min_length(recording: Recording) -> int:
    """Return the samples of the shortest excerpt that resolves the lines of a recording."""
    duration = MIN_EXCERPT_S
    shaft_hz = specified_shaft_frequency(recording)
    if shaft_hz:
        duration = max(duration, MIN_EXCERPT_TURNS / shaft_hz)

    max_values_length = MAX_WHOLE_VALUES // recording.n_channels
    limit = min(_MAX_REQUIRED_SAMPLES, max_values_length, recording.n_samples)
    # Limited first: a speed close to 0 would exceed every integer type.
    return max(1, math.ceil(min(duration * recording.sample_rate, limit)))


def describe_excerpts(
    parts: list[Recording], recording: Recording, n_usable: int | None = None
) -> str:
    """Return what a result of `excerpts` is of; empty if it is the whole recording.

    Parameters
    ----------
    n_usable : number of excerpts that the result is of; all by default.
    """
    if parts[0].n_samples == recording.n_samples:
        return ""
    duration = f"{parts[0].duration:.3g} s"
    if len(parts) == 1:
        return f"{duration} in the middle of the recording"
    if n_usable is not None and n_usable < len(parts):
        return f"{n_usable} of {len(parts)} excerpts of {duration} each"
    return f"{len(parts)} excerpts of {duration} each"
