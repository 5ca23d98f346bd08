"""Excerpts of a long recording, which stand for it in whatever transforms all samples at once."""

import numpy as np

from swashtwin.recordings import Recording

MAX_WHOLE_VALUES = 1 << 23
"""Samples of all channels up to which a recording is used as a whole: 64 MB in double precision."""
MAX_TURNED_VALUES = 1 << 21
"""The same for a recording that is resampled by angle, which takes 500 bytes for each sample."""
EXCERPT_COUNT = 8
"""Excerpts whose spectra are averaged."""

# Samples of all channels and excerpts together: 8 MB, whose spectra take about a second.
_EXCERPT_VALUES = 1 << 20

# Shortest and longest excerpt: 0.64 s and 5.1 s at 51.2 kHz. The shortest resolves 2 Hz; of many
# channels there are fewer excerpts. The longest has a hundred turns at 1500 rpm.
_MIN_SAMPLES = 1 << 15
_MAX_SAMPLES = 1 << 18


def is_long(recording: Recording) -> bool:
    """Return whether a recording has too many samples to be read as a whole."""
    return recording.n_samples * recording.n_channels > MAX_WHOLE_VALUES


def excerpts(
    recording: Recording, count: int = EXCERPT_COUNT, *, max_values: int = MAX_WHOLE_VALUES
) -> list[Recording]:
    """Return a recording itself, or excerpts of a long one, spread evenly over it.

    Parameters
    ----------
    count : maximum number of excerpts; one is in the middle.
    max_values : samples of all channels up to which it is the recording itself.
    """
    if recording.n_samples * recording.n_channels <= max_values:
        return [recording]

    max_count = _EXCERPT_VALUES // (_MIN_SAMPLES * recording.n_channels)
    count = max(1, min(count, max_count))
    length = _EXCERPT_VALUES // (count * recording.n_channels)
    length = min(max(length, _MIN_SAMPLES), _MAX_SAMPLES, recording.n_samples)
    starts = np.linspace(0, recording.n_samples - length, count + 2)[1:-1].astype(int)
    return [recording.slice(start, start + length) for start in starts.tolist()]


def describe_excerpts(parts: list[Recording], recording: Recording) -> str:
    """Return what a result of `excerpts` is of; empty if it is the whole recording."""
    if parts[0].n_samples == recording.n_samples:
        return ""
    duration = f"{parts[0].duration:.3g} s"
    if len(parts) == 1:
        return f"{duration} in the middle of the recording"
    return f"{len(parts)} excerpts of {duration} each"
