"""Fingerprints by which a copy of a recording is known after it was cut, filtered, scaled, resampled or reversed.

A fingerprint says of each octave, every 10 ms, whether its level rises or falls: one bit. Gain, offset, drift, the
rate and a filter change few of these bits, and reversing the time turns them over. Flow noise makes them differ between
two recordings of one machine (in the manner of Haitsma and Kalker 2002, audio fingerprints).
"""

import base64
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Float32

from swashtwin.recordings.recording import Recording

MARK = "~"
"""First character of a fingerprint, which tells it from a hash."""
ALIKE = 0.65
"""Agreement from which two recordings are copies: 1 where all bits are the same, 0 where half of them are. Among 11,175
pairs of different recordings of one machine of the virtual rig (2 s, five states, one operating point) the greatest was
0.52, of each of three channels; copies with 1 % of noise had 0.97 and more, pieces of one second 0.84 and more."""
_EDGES = 62.5 * 2.0 ** np.arange(9)
"""Edges of the octaves [Hz]."""
_HOP, _SMOOTH, _STEP = 0.005, 20, 8
"""Time between short spectra [s] (each four times as long), how many are smoothed together, and how many pairs of these
lie between two levels that are compared."""
_LEAST, _LONGEST = 75, 20.0
"""Bits in a row that must agree (each stands for 10 ms), and seconds of a recording that are looked at."""
_SMALLEST = 1e-3
"""Change of a level that is none: that of a pure tone."""


def fingerprints(recording: Recording) -> tuple[str, ...]:
    """Fingerprint of each channel that has one: a second long at least, and sampled at 500 Hz or more."""
    rate = float(recording.sample_rate)
    if recording.duration < 1.0 or rate / 2 < _EDGES[2]:
        return ()
    signal = recording.slice(0, min(recording.n_samples, int(_LONGEST * rate))).signal
    return tuple(text for channel in signal if (text := _fingerprint(channel, rate)))


def _fingerprint(channel: Float[np.ndarray, " time"], rate: float) -> str:
    length = round(4 * _HOP * rate)
    starts = np.round(np.arange(int((channel.size - length) / (_HOP * rate)) + 1) * (_HOP * rate)).astype(np.int64)
    frames = np.lib.stride_tricks.sliding_window_view((channel - channel.mean()).astype(np.float32), length)
    taper = np.hanning(length).astype(np.float32)
    n_bands = int(np.count_nonzero(_EDGES[1:] <= rate / 2 * 1.001))
    first = np.searchsorted(np.fft.rfftfreq(length, 1 / rate), _EDGES[: n_bands + 1])
    powers = []
    for part in np.array_split(starts, -(-starts.size // 512)):
        lines = np.abs(np.fft.rfft(frames[part] * taper, axis=1)[:, : first[-1]]) ** 2
        powers.append(np.add.reduceat(lines, first[:-1], axis=1))
    power = np.concatenate(powers)
    weights = np.hanning(_SMOOTH)[1:-1]
    level = [np.log(np.convolve(row, weights, "valid")[::2] + 1e-30) for row in power.T]
    change = np.stack([row[_STEP:] - row[:-_STEP] for row in level])
    used = np.abs(change).mean(axis=1) > _SMALLEST
    if not np.isfinite(change).all() or used.sum() < 2 or change.shape[1] < _LEAST:
        return ""
    bits = base64.b64encode(np.packbits(change[used] > 0).tobytes()).decode()
    return f"{MARK}{''.join(str(int(flag)) for flag in used)}.{change.shape[1]}.{bits}"


def _signs(text: str) -> Float32[np.ndarray, "octave time"]:
    """+1 where a level rises, -1 where it falls, 0 in an octave that is not used."""
    flags, length, bits = text[len(MARK) :].split(".")
    used = np.array([flag == "1" for flag in flags])
    values = np.unpackbits(np.frombuffer(base64.b64decode(bits), np.uint8), count=int(length) * int(used.sum()))
    signs = np.zeros((_EDGES.size - 1, int(length)), np.float32)
    signs[: used.size][used] = 2.0 * values.reshape(-1, int(length)) - 1
    return signs


def near_copies(listed: Mapping[str, Sequence[str]], recordings: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Those of `recordings` that are copies of listed ones: id there, by id here.

    The first fingerprint of a recording is compared with all of a listed one, so that exchanged and left out channels
    hide no copy.

    Parameters
    ----------
    listed, recordings : fingerprints by id.
    """
    by_length: dict[int, list[tuple[str, np.ndarray]]] = {}
    for name, texts in listed.items():
        for text in texts:
            signs = _signs(text)
            by_length.setdefault(signs.shape[1], []).append((name, signs))
    stacks = [([name for name, _ in items], np.stack([signs for _, signs in items])) for items in by_length.values()]
    found = {}
    for name, texts in recordings.items():
        agreements = [
            (agreement, other)
            for names, signs in (stacks if texts else ())
            for agreement, other in zip(_agreement(signs, _signs(texts[0])), names, strict=True)
        ]
        best = max(agreements, default=(0.0, ""))
        if best[0] >= ALIKE:
            found[name] = best[1]
    return found


def _agreement(
    listed: Float32[np.ndarray, "channel octave time"], signs: Float32[np.ndarray, "octave part"]
) -> Float[np.ndarray, " channel"]:
    """Greatest agreement of each with `signs` over all shifts, forward and backward, in the lower or upper octaves."""
    sizes = listed.shape[-1], signs.shape[-1]
    size = 1 << (sum(sizes) - 1).bit_length()
    ones = [np.fft.rfft(np.ones(count), size) for count in sizes]
    count = np.round(np.fft.irfft(ones[0] * np.conj(ones[1]), size))
    valid = count >= _LEAST
    spectra = np.fft.rfft(listed, size)
    best = np.zeros(len(listed))
    for other in (signs, -signs[:, ::-1]):
        products = spectra * np.conj(np.fft.rfft(other, size))
        common = (listed != 0).any(axis=-1) & (other != 0).any(axis=-1)
        for half in (slice(0, 4), slice(4, 8)):
            number = common[:, half].sum(axis=1)
            total = np.fft.irfft(products[:, half].sum(axis=1), size)[:, valid] / count[valid]
            best = np.maximum(best, np.where(number > 1, total.max(axis=1) / np.maximum(number, 1), 0.0))
    return best
