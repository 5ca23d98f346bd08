"""Patterns around the steepest samples, which recognize stretches of a recording in any order.

A fingerprint compares two recordings as wholes. A recording that was put together from blocks of
others agrees with none of them over a second, but within a block its samples are those of the
original. Each pattern is a short run of steps between samples, in units of its steepest step, so
that gain, offset and a few lost digits do not change it.
"""

import base64
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt64

PATTERN_MARK = "="
"""First character of the patterns of a channel, which distinguishes them from a hash."""
MIN_SHARED_PATTERNS = 6
"""Shared patterns from which a recording may hold samples of another.

In the public sets (docs/how-to/leakage.md) different channels share one at most.
"""
# Share of the patterns of a recording that other recordings must have, so that it holds their
# samples. One strong transient that two recordings have in common is less.
_MIN_SHARE = 0.1

# Steps to both sides of the steepest one within which it is the steepest; a power of two.
_STEEPEST_RADIUS = 32

# Steps before and after the steepest one that make the pattern.
_STEPS_AROUND = 12

# Levels of a step, as a share of the steepest.
#
# With 8 levels the bursts of one machine repeat (26 shared patterns), with 64 none does. More are
# not needed, and rounding would change them.
_LEVELS = 256

# Different levels that a pattern must have: those of steps and smooth pulses repeat by chance.
_MIN_DISTINCT_LEVELS = 5

# Patterns of a channel that are kept: those of the smallest numbers, which agree between a
# recording and a part of it.
_MAX_PATTERNS = 128

# Bytes of the number of a pattern that are kept.
_NUMBER_BYTES = 6

# Odd factors that mix the levels of a pattern into its number.
_FACTORS = np.random.default_rng(0).integers(
    1 << 62, size=2 * _STEPS_AROUND + 1, dtype=np.uint64
) | np.uint64(1)


def compute_patterns(channel: Float[np.ndarray, " time"]) -> str:
    """Return the patterns of a channel as text, empty if it has none that occur once.

    Samples that are not finite, and signals that repeat exactly, have none.
    """
    numbers = _pattern_numbers(np.diff(channel))
    values, counts = np.unique(numbers, return_counts=True)
    unique_values = values[counts == 1][:_MAX_PATTERNS]
    if unique_values.size < MIN_SHARED_PATTERNS:
        return ""

    packed = unique_values.astype(">u8").view(np.uint8).reshape(-1, 8)[:, :_NUMBER_BYTES]
    return PATTERN_MARK + base64.b64encode(packed.tobytes()).decode()


def _pattern_numbers(steps: Float[np.ndarray, " time"]) -> UInt64[np.ndarray, " pattern"]:
    """Return a number for the pattern around each steepest step."""
    if steps.size < 2 * _STEEPEST_RADIUS or not np.isfinite(steps).all():
        return np.empty(0, np.uint64)

    # The maximum of each stretch of 64 steps, by doubling; each belongs to its 33rd step.
    steepness = np.abs(steps)
    highest = steepness
    shift = 1
    while shift < 2 * _STEEPEST_RADIUS:
        highest = np.maximum(highest[:-shift], highest[shift:])
        shift *= 2
    inner = steepness[_STEEPEST_RADIUS : _STEEPEST_RADIUS + highest.size]
    positions = _STEEPEST_RADIUS + np.flatnonzero((inner == highest) & (inner > 0))

    offsets = np.arange(-_STEPS_AROUND, _STEPS_AROUND + 1)
    patterns = steps[positions[:, None] + offsets] / steps[positions, None]
    levels = np.rint(_LEVELS * patterns).astype(np.int64)

    is_new = np.diff(np.sort(levels, axis=1), axis=1) > 0
    levels = levels[is_new.sum(axis=1) + 1 >= _MIN_DISTINCT_LEVELS]
    return _mix(levels.astype(np.uint64) @ _FACTORS)


def _mix(numbers: UInt64[np.ndarray, " pattern"]) -> UInt64[np.ndarray, " pattern"]:
    """Spread numbers over all bits (the finalizer of MurmurHash3): the smallest are a sample."""
    for factor in (0xFF51AFD7ED558CCD, 0xC4CEB9FE1A85EC53):
        numbers = (numbers ^ (numbers >> np.uint64(33))) * np.uint64(factor)
    mixed: np.ndarray = numbers ^ (numbers >> np.uint64(33))
    return mixed


def find_shared_patterns(
    listed: Mapping[str, Sequence[str]], recordings: Mapping[str, Sequence[str]]
) -> dict[str, str]:
    """Return those of `recordings` that hold samples of listed ones: the listed id by their id.

    It is the id of the recording that most of the shared patterns are of.

    Parameters
    ----------
    listed, recordings : patterns of the channels by id.
    """
    listed_sketches = {name: _Sketch.decode(texts) for name, texts in listed.items()}
    owners = _map_owners(listed_sketches)

    copies = {}
    for name, texts in recordings.items():
        sketch = _Sketch.decode(texts)
        counts = _count_shared_patterns(sketch, owners)
        # Without those that share a few patterns by chance: the sketch of a long one among them
        # would leave hardly a pattern to compare. With them, for blocks of many recordings.
        is_copy = any(
            sketch.holds_samples_of([listed_sketches[source] for source in sources])
            for sources in (_select_sources(counts), list(counts))
        )
        if is_copy:
            copies[name] = counts.most_common(1)[0][0]
    return copies


def find_shared_pairs(patterns: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Return the pairs of recordings that share samples: (later, earlier).

    Parameters
    ----------
    patterns : patterns of the channels by id.
    """
    sketches = {name: _Sketch.decode(texts) for name, texts in patterns.items()}
    owners = _map_owners(sketches)
    positions = {name: position for position, name in enumerate(sketches)}

    pairs: set[tuple[int, int]] = set()
    for name, sketch in sketches.items():
        counts = _count_shared_patterns(sketch, owners)
        del counts[name]
        sources = _select_sources(counts)
        if sketch.holds_samples_of([sketches[source] for source in sources]):
            for source in sources:
                earlier, later = sorted((positions[name], positions[source]))
                pairs.add((later, earlier))

    names = list(sketches)
    return [(names[later], names[earlier]) for later, earlier in sorted(pairs)]


@dataclass(frozen=True)
class _Sketch:
    """The smallest pattern numbers of a recording."""

    numbers: set[int]
    """Those of all channels."""
    limit: float
    """Number up to which all patterns of each channel are listed."""

    @classmethod
    def decode(cls, texts: Sequence[str]) -> "_Sketch":
        """Return the sketch of the patterns of all channels."""
        numbers: set[int] = set()
        limit = math.inf
        for text in texts:
            listed = _decode(text)
            numbers.update(listed)
            if len(listed) == _MAX_PATTERNS:
                limit = min(limit, max(listed))
        return cls(numbers, limit)

    def holds_samples_of(self, sources: "Sequence[_Sketch]") -> bool:
        """Return whether enough of the patterns are those of the sources.

        Only numbers that all sketches would list are compared: a short part of a long recording
        lists many that the long one left out.
        """
        limit = min([self.limit, *(source.limit for source in sources)])
        comparable = {number for number in self.numbers if number <= limit}
        shared = comparable & set().union(*(source.numbers for source in sources))
        n_required = max(MIN_SHARED_PATTERNS, _MIN_SHARE * len(comparable))
        return len(shared) >= n_required


def _map_owners(sketches: Mapping[str, _Sketch]) -> dict[int, list[str]]:
    """Return the recordings that list each number."""
    owners: dict[int, list[str]] = {}
    for name, sketch in sketches.items():
        for number in sketch.numbers:
            owners.setdefault(number, []).append(name)
    return owners


def _count_shared_patterns(sketch: _Sketch, owners: Mapping[int, list[str]]) -> Counter[str]:
    """Return the number of patterns that a recording shares with each listed one."""
    return Counter(owner for number in sketch.numbers for owner in owners.get(number, ()))


def _select_sources(counts: Mapping[str, int]) -> list[str]:
    """Return the recordings that share more patterns than different ones do by chance."""
    return [owner for owner, count in counts.items() if count >= MIN_SHARED_PATTERNS]


def _decode(text: str) -> list[int]:
    """Return the numbers of the patterns of one channel."""
    packed = np.frombuffer(base64.b64decode(text[len(PATTERN_MARK) :]), np.uint8)
    padded = np.zeros((packed.size // _NUMBER_BYTES, 8), np.uint8)
    padded[:, :_NUMBER_BYTES] = packed.reshape(-1, _NUMBER_BYTES)
    numbers: list[int] = padded.view(">u8")[:, 0].tolist()
    return numbers
