"""Fingerprints of channels, which recognize copies that were cut, filtered, scaled or resampled.

A fingerprint holds the signs of the whitened signal in four narrow bands. Scaling leaves the signs,
a filter leaves those within its pass band, and a cut shifts them; their correlation over all shifts
therefore recognizes a copy, forward or backward in time.
"""

import base64
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import scipy
from jaxtyping import Complex, Float
from scipy import fft

from swashtwin.recordings.recording import Recording

FINGERPRINT_MARK = "~"
"""First character of a fingerprint, which distinguishes it from a hash."""
MIN_AGREEMENT = 0.4
"""Correlation of the signs from which two recordings are copies (docs/how-to/leakage.md)."""

# Lower edges of the bands [Hz], in pairs that are compared together.
#
# There are two pairs because a filter may remove one of them.
_BAND_PAIRS_HZ = ((60, 280), (1100, 1400))

_BAND_WIDTH_HZ = 120

# Complex values of a band per second: one and a half times its width.
_VALUES_PER_S = 180

# Highest band edge over the sample rate: anti-aliasing filters remove what lies above.
_MAX_BAND_EDGE = 0.475

# Rise of the taper [s].
_TAPER_TIME_S = 0.25

# Width over which the noise floor is taken as a median [Hz].
_MEDIAN_WIDTH_HZ = 8.0

# Consecutive seconds that must agree.
_MIN_TIME_S = 1.0

# Seconds that a fingerprint covers.
_MAX_TIME_S = 20.0

# Noise in a band over the highest line from which it is noise: less may be leakage of a tone.
_MIN_RELATIVE_NOISE = 2e-5

# Magnitude of a band over its median from which it is a burst: noise exceeds it once in 60,000.
_MIN_BURST_RATIO = 4.0

# Share of the energy of a band in bursts from which they determine its signs.
#
# Different recordings that have a transient of at most this share in common correlate below 0.3.
_MAX_BURST_SHARE = 0.5

# Standard deviations of the correlation of the power spectra of different recordings above which
# the signs of two recordings are compared.
_SPECTRAL_DEVIATIONS = 4.0

# Listed fingerprints that are compared together, which limits the memory.
_BLOCK_SIZE = 64


def read_beginning(recording: Recording) -> Float[np.ndarray, "channel time"]:
    """Return the samples that fingerprints cover: those of the first 20 s."""
    count = min(recording.n_samples, int(_MAX_TIME_S * recording.sample_rate))
    return recording.samples.signal_part(0, count)


def compute_fingerprints(signal: Float[np.ndarray, "channel time"], rate: float) -> tuple[str, ...]:
    """Return the fingerprint of each channel that has one.

    It is at least one second long, was sampled at 840 Hz or more, and has noise that is not
    dominated by bursts: two recordings of one transient would agree.

    Parameters
    ----------
    signal : samples of `read_beginning`.
    rate : samples per second [Hz].
    """
    if signal.shape[1] / rate < _MIN_TIME_S:
        return ()
    fingerprints = [_compute_fingerprint(channel, rate) for channel in signal]
    return tuple(filter(None, fingerprints))


def _compute_fingerprint(channel: Float[np.ndarray, " time"], rate: float) -> str:
    """Return a text such as ``"~01.360.9Qb..."``, empty if no pair of bands has noise.

    It states the pairs of bands it has, the number of values of each band, and their signs.
    """
    duration = channel.size / rate
    seconds = int(np.ceil(duration))
    value_count = int(duration * _VALUES_PER_S)
    ramp = (np.arange(int(np.ceil(_TAPER_TIME_S * rate))) + 0.5) / (_TAPER_TIME_S * rate)
    taper = np.sin(np.pi / 2 * np.minimum(ramp, 1.0)) ** 2
    tapered = channel - channel.mean()
    tapered[: taper.size] *= taper
    tapered[-taper.size :] *= taper[::-1]
    spectrum = fft.rfft(tapered, round(seconds * rate))
    highest_amplitude = float(np.sqrt((spectrum.real**2 + spectrum.imag**2).max()))

    flags = ""
    signs: list[list[np.ndarray]] = []
    for pair in _BAND_PAIRS_HZ:
        pair_signs = []
        if pair[1] + _BAND_WIDTH_HZ <= _MAX_BAND_EDGE * rate:
            for low_edge in pair:
                band = _whiten_band(spectrum, highest_amplitude, low_edge, seconds)
                values = None if band is None else band[:value_count]
                if values is not None and _burst_share(values) <= _MAX_BURST_SHARE:
                    pair_signs.append([values.real > 0, values.imag > 0])
        has_pair = len(pair_signs) == 2
        flags += str(int(has_pair))
        if has_pair:
            signs += pair_signs

    if not signs:
        return ""
    bits = base64.b64encode(np.packbits(np.array(signs)).tobytes()).decode()
    return f"{FINGERPRINT_MARK}{flags}.{value_count}.{bits}"


def _whiten_band(
    spectrum: np.ndarray, highest_amplitude: float, low_edge: int, seconds: int
) -> np.ndarray | None:
    """Return the complex signal of a band, its lines cut to the noise; None without noise."""
    band = slice(low_edge * seconds, (low_edge + _BAND_WIDTH_HZ) * seconds)
    median_bins = int(_MEDIAN_WIDTH_HZ * seconds) | 1  # an odd number
    amplitude = np.abs(spectrum[band])
    noise = scipy.ndimage.median_filter(amplitude, median_bins, mode="nearest")
    if not np.median(noise) > _MIN_RELATIVE_NOISE * highest_amplitude:
        return None

    divisor = np.maximum(amplitude, np.maximum(noise, 1e-300))  # never 0
    values: np.ndarray = fft.ifft(spectrum[band] / divisor, _VALUES_PER_S * seconds)
    return values


def _burst_share(values: Complex[np.ndarray, " time"]) -> float:
    """Return the share of the energy of a band in values that are far above the median."""
    powers = values.real**2 + values.imag**2
    is_burst = powers > _MIN_BURST_RATIO**2 * np.median(powers)
    return float(powers[is_burst].sum() / max(powers.sum(), 1e-300))  # never 0


def _count_values(fingerprint: str) -> int:
    return int(fingerprint.split(".")[1])


def _decode_signs(fingerprint: str) -> Complex[np.ndarray, "band time"]:
    """Return the values of a fingerprint, of magnitude 1; zeros in bands that it does not have."""
    flags, length, bits = fingerprint[len(FINGERPRINT_MARK) :].split(".")
    has_band = np.repeat([flag == "1" for flag in flags], 2)
    value_count = int(length)
    bit_count = 2 * value_count * int(has_band.sum())
    packed = np.frombuffer(base64.b64decode(bits), np.uint8)
    is_positive = np.unpackbits(packed, count=bit_count)

    parts = 2.0 * is_positive.reshape(-1, 2, value_count) - 1
    signs = np.zeros((has_band.size, value_count), np.complex64)
    signs[has_band] = (parts[:, 0] + 1j * parts[:, 1]) / np.sqrt(2)
    return signs


def find_altered_copies(
    listed: Mapping[str, Sequence[str]], recordings: Mapping[str, Sequence[str]]
) -> dict[str, str]:
    """Return those of `recordings` that are copies of listed ones: listed id by id.

    The first fingerprint of a recording is compared with all of a listed one, so that exchanged and
    removed channels hide no copy. If the listed one has fewer, its first one is compared with all
    of the recording, whose first channel it may lack.

    Parameters
    ----------
    listed, recordings : fingerprints by id.
    """
    copies = _match(listed, {name: texts[:1] for name, texts in recordings.items()})
    for count in {len(texts) for texts in recordings.values()}:
        smaller = {name: texts[:1] for name, texts in listed.items() if len(texts) < count}
        remaining = {
            name: texts[1:]
            for name, texts in recordings.items()
            if len(texts) == count and name not in copies
        }
        copies |= _match(smaller, remaining)
    return copies


def _match(
    listed: Mapping[str, Sequence[str]], recordings: Mapping[str, Sequence[str]]
) -> dict[str, str]:
    """Return the listed id by that of each recording one of whose fingerprints agrees with it.

    Parameters
    ----------
    listed, recordings : fingerprints by id, which are all compared.
    """
    candidates: dict[int, list[tuple[str, np.ndarray]]] = {}
    for name, fingerprints in recordings.items():
        for fingerprint in fingerprints:
            signs = _decode_signs(fingerprint)
            candidates.setdefault(signs.shape[1], []).append((name, signs))
    if not candidates:
        return {}

    best: dict[str, tuple[float, str]] = {}
    for names, listed_signs in _listed_blocks(listed):
        for group in candidates.values():
            agreements = _agreements(listed_signs, [signs for _, signs in group])
            for (name, _), agreement in zip(group, agreements, strict=True):
                row = int(agreement.argmax())
                match = (float(agreement[row]), names[row])
                best[name] = max(best.get(name, match), match)

    return {
        name: listed_name
        for name, (agreement, listed_name) in best.items()
        if agreement >= MIN_AGREEMENT
    }


def find_altered_pairs(fingerprints: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Return the pairs of recordings that are altered copies of each other: (later, earlier).

    Only pairs with similar power spectra of the signs are compared: those do not depend on the
    shift and the direction of time, and the comparison of all pairs costs a hundredth of that of
    their signs. Copies that share less than about a sixth of their time may be missed.

    Parameters
    ----------
    fingerprints : fingerprints by id.
    """
    texts_by_id = {name: texts for name, texts in fingerprints.items() if texts}
    if len(texts_by_id) < 2:
        return []

    names = list(texts_by_id)
    pairs: set[tuple[int, int]] = set()
    for (listed, candidate), similar in _similar_fingerprints(list(texts_by_id.values())).items():
        pair = (max(listed, candidate), min(listed, candidate))
        first = texts_by_id[names[candidate]][:1]
        if pair not in pairs and _match({names[listed]: similar}, {names[candidate]: first}):
            pairs.add(pair)
    return [(names[later], names[earlier]) for later, earlier in sorted(pairs)]


def _similar_fingerprints(
    fingerprints: Sequence[Sequence[str]],
) -> dict[tuple[int, int], list[str]]:
    """Return fingerprints with power spectra like the first one of another recording.

    Each recording is listed and candidate, since the first channel of one may be missing in the
    other.

    Returns
    -------
    similar : by the numbers of the listed recording and of the candidate: those fingerprints of the
        listed one that resemble the first one of the candidate.
    """
    owners = np.repeat(np.arange(len(fingerprints)), [len(texts) for texts in fingerprints])
    is_first = np.r_[True, np.diff(owners) > 0]
    flat_fingerprints = [text for texts in fingerprints for text in texts]
    signs = [_decode_signs(text) for text in flat_fingerprints]
    lengths = np.array([values.shape[1] for values in signs])
    size = fft.next_fast_len(int(lengths.max()))
    threshold = _SPECTRAL_DEVIATIONS / np.sqrt(2 * lengths)

    is_similar = np.zeros((len(signs), len(fingerprints)), np.bool_)
    for bands in (slice(0, 2), slice(2, 4)):
        spectra = np.stack([_power_spectrum(values[bands], size) for values in signs])
        for start in range(0, len(signs), _BLOCK_SIZE):
            rows = slice(start, start + _BLOCK_SIZE)
            agreement = spectra[rows] @ spectra[is_first].T
            limit = np.maximum(threshold[rows, None], threshold[is_first])
            is_similar[rows] |= agreement > limit

    # Two first fingerprints are compared once, with the earlier one as the listed one.
    candidates = np.arange(len(fingerprints))
    is_repeated = is_first[:, None] & (owners[:, None] > candidates)
    is_similar &= ~is_repeated & (owners[:, None] != candidates)

    similar: dict[tuple[int, int], list[str]] = {}
    for row, candidate in zip(*np.nonzero(is_similar), strict=True):
        pair = (int(owners[row]), int(candidate))
        similar.setdefault(pair, []).append(flat_fingerprints[row])
    return similar


def _power_spectrum(signs: Complex[np.ndarray, "band time"], size: int) -> np.ndarray:
    """Return the deviations of the power spectra of two bands from their mean, of norm 1."""
    # Above the band there is only what the signs added.
    spectrum = fft.fft(signs, size)[:, : size * _BAND_WIDTH_HZ // _VALUES_PER_S]
    powers = spectrum.real**2 + spectrum.imag**2
    deviations = (powers - powers.mean(axis=1, keepdims=True)).ravel()
    norm = np.linalg.norm(deviations)
    fingerprint: np.ndarray = (deviations / max(norm, 1e-30)).astype(np.float32)
    return fingerprint


def _listed_blocks(
    listed: Mapping[str, Sequence[str]],
) -> Iterator[tuple[list[str], Complex[np.ndarray, "channel band time"]]]:
    """Yield blocks of listed fingerprints of one length, with the id of each."""
    by_length: dict[int, list[tuple[str, str]]] = {}
    for name, fingerprints in listed.items():
        for fingerprint in fingerprints:
            by_length.setdefault(_count_values(fingerprint), []).append((name, fingerprint))

    for pairs in by_length.values():
        for start in range(0, len(pairs), _BLOCK_SIZE):
            block = pairs[start : start + _BLOCK_SIZE]
            names = [name for name, _ in block]
            yield names, np.stack([_decode_signs(fingerprint) for _, fingerprint in block])


def _agreements(
    listed: Complex[np.ndarray, "channel band time"], candidates: Sequence[np.ndarray]
) -> Iterator[Float[np.ndarray, " channel"]]:
    """Yield the greatest correlation of each candidate with each listed channel.

    It is the greatest over all shifts, both directions of time and the pairs of bands. All
    candidates have one length.
    """
    lengths = (listed.shape[-1], candidates[0].shape[-1])
    size = fft.next_fast_len(sum(lengths))
    # The number of values that overlap at each shift normalizes the correlation.
    listed_ones, candidate_ones = (fft.rfft(np.ones(length), size) for length in lengths)
    overlap = np.round(fft.irfft(listed_ones * np.conj(candidate_ones), size))
    is_valid = overlap > 0.9 * _MIN_TIME_S * _VALUES_PER_S
    spectra = fft.fft(listed, size)

    for signs in candidates:
        best = np.zeros(len(listed))
        for pair in (slice(0, 2), slice(2, 4)):
            if not (listed[:, pair].any() and signs[pair].any()):
                continue
            reversed_signs = np.conj(signs[pair, ::-1])
            for values in (signs[pair], reversed_signs):
                products = spectra[:, pair] * np.conj(fft.fft(values, size))
                correlation = np.abs(fft.ifft(products)).mean(axis=1)
                agreement = (correlation[:, is_valid] / overlap[is_valid]).max(axis=1)
                best = np.maximum(best, agreement)
        yield best
