"""Manifests: which recordings had a part in something, by name and by content.

A manifest maps the id of each recording to the hashes of its channels (`Recording.content_hashes`)
and to their `fingerprints`, or to none where its content is not known. Content decides; only where
one side has none, the name does.
"""

import base64
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import scipy
from jaxtyping import Complex64, Float
from scipy import fft

from swashtwin.recordings.recording import Recording

Manifest = Mapping[str, tuple[str, ...]]
"""Hashes and fingerprints of the content of each recording, by its id."""


def build_manifest(recordings: Iterable[Recording]) -> dict[str, tuple[str, ...]]:
    """Manifest of recordings; their samples are read once."""
    return join_manifests(
        {recording.recording_id: (*recording.content_hashes(), *fingerprints(recording))}
        for recording in recordings
    )


def join_manifests(manifests: "Iterable[Manifest | Iterable[str]]") -> dict[str, tuple[str, ...]]:
    """One manifest of several, by id; mere ids are recordings whose content is not known.

    Examples
    --------
    >>> join_manifests([{"b": ("1f",)}, ["a"], {"b": ("2e",)}])
    {'a': (), 'b': ('1f', '2e')}
    """
    joined: dict[str, set[str]] = {}
    for manifest in manifests:
        for name in manifest:
            hashes = manifest[name] if isinstance(manifest, Mapping) else ()
            joined.setdefault(str(name), set()).update(hashes)
    return {name: tuple(sorted(joined[name])) for name in sorted(joined)}


def find_exact_copies(manifest: "Manifest | Iterable[str]", recordings: Manifest) -> dict[str, str]:
    """Those of `recordings` whose samples, as they are, stand in `manifest`: id there, by id here.

    A recording is in it if it shares the content of a channel with one of the manifest, whatever
    both are called; where the content of either is not known, if the names are the same. Altered
    copies are those of `find_copies`, whose cost grows with the manifest.

    Examples
    --------
    >>> find_exact_copies({"a": ("1f",), "twin": ()}, {"a": ("2e",), "copy of a": ("1f",), "twin": ("3d",)})
    {'copy of a': 'a', 'twin': 'twin'}
    """
    listed = join_manifests([manifest])
    names = {digest: name for name, hashes in listed.items() for digest in hashes}
    seen: dict[str, str] = {}
    for name, hashes in recordings.items():
        same = next((names[digest] for digest in hashes if digest in names), None)
        if same is not None:
            seen[name] = same
        elif name in listed and not (hashes and listed[name]):
            seen[name] = name
    return seen


def find_copies(manifest: "Manifest | Iterable[str]", recordings: Manifest) -> dict[str, str]:
    """Those of `recordings` that are in `manifest`, as they are or altered: id there, by id here.

    Besides `find_exact_copies` these are copies that were cut, filtered, scaled, resampled or
    reversed (`find_altered_copies`).
    """
    listed = join_manifests([manifest])
    seen = find_exact_copies(listed, recordings)
    others = {name: hashes for name, hashes in recordings.items() if name not in seen}
    known, new = (
        {
            name: [text for text in entries if text.startswith(MARK)]
            for name, entries in manifest.items()
        }
        for manifest in (listed, others)
    )
    return {**seen, **find_altered_copies(known, new)}


def find_duplicates(manifest: Manifest) -> dict[str, str]:
    """Recordings that hold what an earlier one of the manifest holds: the id of that, by their
    own.
    """
    repeated: dict[str, str] = {}
    firsts: dict[str, str] = {}
    for name, hashes in manifest.items():
        first = next((firsts[digest] for digest in hashes if digest in firsts), None)
        if first is not None:
            repeated[name] = first
        for digest in hashes:
            firsts.setdefault(digest, name)
    return repeated


def describe_copies(seen: Mapping[str, str]) -> str:
    """The first of `find_copies`, and how many more, to begin a sentence with."""
    name, listed = next(iter(seen.items()))
    same = (
        "" if name == listed else f", which holds the samples of {listed}, as they are or altered,"
    )
    more = f" and {len(seen) - 1} more" if len(seen) > 1 else ""
    return f"recording {name}{same}{more}"


MARK = "~"
"""First character of a fingerprint, which tells it from a hash."""
ALIKE = 0.4
"""Correlation of the signs from which two recordings are copies; how it was chosen is in
docs/how-to/leakage.md.
"""
_PAIRS = ((60, 280), (1100, 1400))
"""Lower edges of the bands [Hz], in pairs that are compared together: a filter may leave one pair
only.
"""
_WIDTH, _RATE = 120, 180
"""Width of a band [Hz], and complex values of it per second."""
_TAPER, _NEAR = 0.25, 8.0
"""Rise of the taper [s], and width over which the median is taken [Hz]."""
_SHORTEST, _LONGEST = 1.0, 20.0
"""Seconds in a row that must agree, and that are looked at."""
_BLOCK = 64
"""Listed fingerprints that are compared at a time, which bounds the memory."""
_SMALLEST = 2e-5
"""Noise in a band over the greatest line from which there is any; what is less may be a tone's, by
the taper.
"""


def fingerprints(recording: Recording) -> tuple[str, ...]:
    """Fingerprint of each channel that has one: a second long at least, sampled at 900 Hz or more,
    with noise.
    """
    rate = float(recording.sample_rate)
    if recording.duration < _SHORTEST:
        return ()
    signal = recording.slice(0, min(recording.n_samples, int(_LONGEST * rate))).signal
    return tuple(text for channel in signal if (text := _fingerprint(channel, rate)))


def _fingerprint(channel: Float[np.ndarray, " time"], rate: float) -> str:
    """Such as ``"~01.360.9Qb..."``: which pairs of bands it has, the number of values of each band,
    and their signs.
    """
    duration = channel.size / rate
    seconds = int(np.ceil(duration))
    ramp = np.minimum((np.arange(channel.size) + 0.5) / (_TAPER * rate), 1.0)
    taper = np.sin(np.pi / 2 * np.minimum(ramp, ramp[::-1])) ** 2
    spectrum = fft.rfft((channel - channel.mean()) * taper, round(seconds * rate))
    size, near = np.abs(spectrum), int(_NEAR * seconds) | 1
    used, signs = "", []
    for pair in _PAIRS:
        found = []
        for low in pair if pair[1] + _WIDTH <= 0.475 * rate else ():
            band = slice(low * seconds, (low + _WIDTH) * seconds)
            noise = scipy.ndimage.median_filter(size[band], near, mode="nearest")
            if np.median(noise) > _SMALLEST * size.max():
                flat = spectrum[band] / np.maximum(size[band], np.maximum(noise, 1e-300))
                values = fft.ifft(flat, _RATE * seconds)[: int(duration * _RATE)]
                found.append([values.real > 0, values.imag > 0])
        used += str(int(len(found) == 2))
        signs += found if len(found) == 2 else []
    if not signs:
        return ""
    bits = np.packbits(np.array(signs)).tobytes()
    return f"{MARK}{used}.{int(duration * _RATE)}.{base64.b64encode(bits).decode()}"


def _length(text: str) -> int:
    return int(text.split(".")[1])


def _signs(text: str) -> Complex64[np.ndarray, "band time"]:
    """The values of a fingerprint, of size 1; zeros in bands that it does not have."""
    pairs, length, bits = text[len(MARK) :].split(".")
    used = np.repeat([flag == "1" for flag in pairs], 2)
    count = 2 * int(length) * int(used.sum())
    flags = np.unpackbits(np.frombuffer(base64.b64decode(bits), np.uint8), count=count)
    values = 2.0 * flags.reshape(-1, 2, int(length)) - 1
    signs = np.zeros((used.size, int(length)), np.complex64)
    signs[used] = (values[:, 0] + 1j * values[:, 1]) / np.sqrt(2)
    return signs


def find_altered_copies(
    listed: Mapping[str, Sequence[str]], recordings: Mapping[str, Sequence[str]]
) -> dict[str, str]:
    """Those of `recordings` that are copies of listed ones: id there, by id here.

    The first fingerprint of a recording is compared with all of a listed one, so that exchanged and
    left out channels hide no copy.

    Parameters
    ----------
    listed, recordings : fingerprints by id.
    """
    by_length: dict[int, list[tuple[str, str]]] = {}
    for name, texts in listed.items():
        for text in texts:
            by_length.setdefault(_length(text), []).append((name, text))
    sought: dict[int, list[tuple[str, np.ndarray]]] = {}
    for name, texts in recordings.items():
        if texts:
            sought.setdefault(_length(texts[0]), []).append((name, _signs(texts[0])))
    best = {name: (0.0, "") for group in sought.values() for name, _ in group}
    blocks = (
        items[start : start + _BLOCK]
        for items in by_length.values()
        for start in range(0, len(items), _BLOCK)
    )
    for block in blocks if sought else ():
        signs = np.stack([_signs(text) for _, text in block])
        for group in sought.values():
            for name, agreements in zip(
                (name for name, _ in group), _agreements(signs, group), strict=True
            ):
                first = int(agreements.argmax())
                best[name] = max(best[name], (float(agreements[first]), block[first][0]))
    return {name: other for name, (agreement, other) in best.items() if agreement >= ALIKE}


def _agreements(
    listed: Complex64[np.ndarray, "channel band time"], sought: Sequence[tuple[str, np.ndarray]]
) -> Iterator[Float[np.ndarray, " channel"]]:
    """Greatest correlation with each sought one, all of a length, over all shifts, forward and
    backward, in one pair of bands.
    """
    sizes = listed.shape[-1], sought[0][1].shape[-1]
    size = fft.next_fast_len(sum(sizes))
    ones = [fft.rfft(np.ones(count), size) for count in sizes]
    count = np.round(fft.irfft(ones[0] * np.conj(ones[1]), size))
    valid = count > 0.9 * _SHORTEST * _RATE
    spectra = fft.fft(listed, size)
    for _, signs in sought:
        best = np.zeros(len(listed))
        for pair in (slice(0, 2), slice(2, 4)):
            if not (listed[:, pair].any() and signs[pair].any()):
                continue
            for other in (signs[pair], np.conj(signs[pair, ::-1])):
                correlation = np.abs(
                    fft.ifft(spectra[:, pair] * np.conj(fft.fft(other, size)))
                ).mean(axis=1)
                best = np.maximum(best, (correlation[:, valid] / count[valid]).max(axis=1))
        yield best
