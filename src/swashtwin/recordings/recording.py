"""One uninterrupted measurement: its facts, and samples that may stay in their file."""

import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, InputError, plain_text
from swashtwin.pump import OperatingCondition
from swashtwin.recordings.formats.columns import BLOCK_SAMPLES
from swashtwin.recordings.samples import Samples

_OF_SAMPLES: Any = object()
"""Stands for the speed that the samples have."""


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Recording:
    """Signals that were sampled together, without a gap, at one operating condition.

    A recording is whole in training or in test: windows carry its `recording_id`, and no split
    parts it. One that was loaded from a file reads its samples when they are asked for: `signal`
    reads them all and keeps them, `slice` and `blocks` read a part. The facts are there without
    reading.

    Parameters
    ----------
    signal : samples (channel, time) in `unit`.
    sample_rate, recording_id, channels, unit, label, condition, specimen, synthetic, attributes :
    as described below.
    speed : angular speed of the shaft at each sample [rad/s], or None where it did not change or
        was not measured.

    Raises
    ------
    DataError
        The arrays have another shape, a name is missing, or the sample rate or a speed cannot be.

    Examples
    --------
    >>> Recording(np.zeros((2, 4000)), 1000.0, "a", channels=("x", "y"), label="normal")
    Recording('a': normal, 2 channels at 1000 Hz, 4 s)
    """

    sample_rate: float
    """Samples per second and channel [Hz]."""
    recording_id: str
    """Unique name within a data set."""
    channels: tuple[str, ...]
    """Name of each channel, in the order of `signal`; names and labels are in one Unicode form
    (`plain_text`).
    """
    unit: str
    """Unit of every channel; readers convert acceleration to m/s^2 and leave other units alone."""
    label: str | None
    """Class of the pump's condition, or None where it is not known."""
    condition: OperatingCondition | None
    """Operating condition, or None where it is not known; the mean where `speed` says that it
    changed.
    """
    specimen: str | None
    """Which physical machine (or which machined fault) was measured; splits by specimen use it."""
    synthetic: bool
    """Whether a model made it. A synthetic recording never enters a test set."""
    attributes: Mapping[str, str]
    """Further facts from the file or the index (source file, sensor, date)."""
    samples: Samples
    """Where the samples are: in memory, or in a file; `signal`, `slice` and `blocks` give them."""

    def __init__(
        self,
        signal: Float[np.ndarray, "channel time"] | None = None,
        sample_rate: float = math.nan,
        recording_id: str = "",
        channels: tuple[str, ...] = ("acceleration",),
        unit: str = "m/s^2",
        label: str | None = None,
        condition: OperatingCondition | None = None,
        speed: Float[np.ndarray, " time"] | None = _OF_SAMPLES,
        specimen: str | None = None,
        synthetic: bool = False,
        attributes: Mapping[str, str] | None = None,
        samples: Samples | None = None,
    ) -> None:
        if signal is None and samples is not None and speed is not _OF_SAMPLES:
            signal = samples.signal
        if (samples is None and signal is None) or not recording_id:
            raise InputError(
                "a recording needs a signal (channel, time), a sample_rate in Hz and a recording_id."
            )
        kinds: dict[str, tuple[object, type, str]] = {
            "label": (label, str, "text"),
            "specimen": (specimen, str, "text"),
            "recording_id": (recording_id, str, "text"),
            "condition": (condition, OperatingCondition, "an OperatingCondition"),
        }
        for name, (value, kind, word) in kinds.items():
            if value is not None and not isinstance(value, kind):
                raise InputError(f"{recording_id}: {name} ({value!r}) must be {word}.")
        if not (
            isinstance(sample_rate, (int, float, np.number))
            and np.isfinite(sample_rate)
            and sample_rate > 0
        ):
            raise DataError(
                f"{recording_id}: sample_rate ({sample_rate!r} Hz) must be a positive number."
            )
        channels = (channels,) if isinstance(channels, str) else channels
        if signal is not None:
            signal = _own_samples(signal, recording_id)
            if speed is _OF_SAMPLES:
                speed = None if samples is None else samples.speed
            speed = None if speed is None else np.asarray(speed, dtype=np.float64)
            origin = samples if samples is not None and samples.name == recording_id else None
            samples = Samples.in_memory(recording_id, signal, speed, origin=origin)
        assert samples is not None
        facts = {
            "sample_rate": sample_rate,
            "recording_id": recording_id,
            "channels": tuple(plain_text(name) for name in channels),
            "unit": unit,
            "label": None if label is None else plain_text(label) or None,
            "condition": condition,
            "specimen": None if specimen is None else plain_text(specimen) or None,
            "synthetic": synthetic,
            "attributes": {} if attributes is None else attributes,
            "samples": samples,
        }
        for name, value in facts.items():
            object.__setattr__(self, name, value)
        if len(channels) != samples.shape[0]:
            raise DataError(
                f"{recording_id}: {len(channels)} channel names for {samples.shape[0]} channels."
            )

    def __iter__(self) -> NoReturn:
        """Refused: a function of several recordings was given one."""
        raise InputError(
            f"{self.recording_id} is one recording where several are expected; give a list of it."
        )

    def __repr__(self) -> str:
        """Short text: name, class, channels and length."""
        channels = f"{self.n_channels} channel{'s' * (self.n_channels != 1)}"
        return (
            f"Recording({self.recording_id!r}: {self.label or 'no label'}, {channels} at {self.sample_rate:g} Hz, "
            f"{self.duration:.4g} s)"
        )

    @property
    def signal(self) -> Float[np.ndarray, "channel time"]:
        """Samples in `unit`, float64, which are read when first asked for and then stay in
        memory.
        """
        return self.samples.signal

    @property
    def speed(self) -> Float[np.ndarray, " time"] | None:
        """Angular speed of the shaft at each sample [rad/s], or None where it did not change or was
        not measured.
        """
        return self.samples.speed

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return self.samples.shape[0]

    @property
    def n_samples(self) -> int:
        """Number of samples of each channel."""
        return self.samples.shape[1]

    @property
    def duration(self) -> float:
        """Length [s]."""
        return float(self.n_samples / self.sample_rate)

    @property
    def time(self) -> Float[np.ndarray, " time"]:
        """Time of each sample since the first [s]."""
        return np.arange(self.n_samples) / self.sample_rate

    @property
    def has_speed(self) -> bool:
        """Whether the speed of the shaft is known at each sample."""
        return self.samples.has_speed

    def slice(self, start: int, stop: int) -> "Recording":
        """The recording from sample `start` to before sample `stop`, in memory.

        Raises
        ------
        InputError
            There are no such samples.
        DataError
            The file is damaged there, or was changed after it was opened.
        """
        signal, speed = self.samples.signal_part(start, stop), self.samples.speed_part(start, stop)
        return self.replace(
            samples=Samples.in_memory(self.recording_id, signal, speed, origin=self.samples)
        )

    def blocks(self) -> "Iterator[Recording]":
        """The recording in parts of `BLOCK_SAMPLES` samples, which follow each other without a gap."""
        for start in range(0, self.n_samples, BLOCK_SAMPLES):
            yield self.slice(start, start + BLOCK_SAMPLES)

    def replace(self, **changes: Any) -> "Recording":
        """The same recording with some facts, its signal or its speed changed; samples in a file
        are not read for it.

        Examples
        --------
        >>> Recording(np.zeros((1, 4)), 2.0, "a").replace(label="piston")
        Recording('a': piston, 1 channel at 2 Hz, 2 s)
        """
        return replace(self, **changes)

    def select_channels(self, channels: Sequence[str]) -> "Recording":
        """The same measurement with only `channels`, in that order."""
        missing = [name for name in channels if name not in self.channels]
        if missing:
            raise InputError(
                f"{self.recording_id} has no channel {missing[0]!r}; it has {', '.join(self.channels)}."
            )
        rows = [self.channels.index(name) for name in channels]
        return self.replace(samples=self.samples.pick(rows), channels=tuple(channels))

    def unloaded(self) -> "Recording":
        """The same recording with nothing of its file in memory; itself where it was not read from
        a file.
        """
        return self.replace(samples=self.samples.unopened())

    def content_hashes(self) -> tuple[str, ...]:
        """What was recorded, whatever the file is called: a hash of each channel
        (`Samples.content_hashes`).

        Two recordings with a hash in common hold the same measurement. A copy under another name,
        in another format or at another rate of ``resample`` is noticed; a `fingerprint` tells one
        that was cut, filtered or scaled.
        """
        return tuple(digest for digest in self.samples.content_hashes() if digest)

    def fingerprint(self) -> str:
        """SHA-256 of the samples, the sample rate, the channels and the unit, hexadecimal; no other
        fact counts.
        """
        digest = hashlib.sha256(
            repr((float(self.sample_rate), self.channels, self.unit, self.signal.shape)).encode()
        )
        digest.update(np.ascontiguousarray(self.signal, dtype="<f8").tobytes())
        return digest.hexdigest()


def _own_samples(signal: np.ndarray, name: str) -> np.ndarray:
    """Samples of its own for a recording, real numbers, NaN where they are masked; a caller may
    change the array.
    """
    samples = np.asarray(signal)
    if samples.dtype.kind not in "fiub":
        raise DataError(
            f"{name}: signal holds {samples.dtype} values; a recording holds real numbers."
        )
    kind = samples.dtype if samples.dtype in (np.float32, np.float64) else np.dtype(np.float64)
    return np.array(np.ma.filled(np.ma.asarray(signal, kind), np.nan), dtype=kind)


def join_blocks(blocks: Iterable[Recording]) -> Recording:
    """One recording of blocks that follow each other without a gap; the first one's facts hold for
    all.

    Raises
    ------
    DataError
        There is no block, or one differs from the first in channels, sample rate, id, or in whether
        it has a speed.
    """
    blocks = list(blocks)
    if not blocks:
        raise DataError("no block to make a recording of.")
    for block in blocks[1:]:
        require_same_facts(blocks[0], block)
    speeds = [block.speed for block in blocks if block.speed is not None]
    signal = np.concatenate([block.signal for block in blocks], axis=1)
    name, speed = blocks[0].recording_id, np.concatenate(speeds) if speeds else None
    return blocks[0].replace(samples=Samples.in_memory(name, signal, speed))


def require_same_facts(first: Recording, block: Recording) -> None:
    """Refuse a block that cannot continue `first`."""
    for name in ("recording_id", "channels", "sample_rate", "unit"):
        if getattr(block, name) != getattr(first, name):
            raise DataError(
                f"{first.recording_id}: a block has {name} {getattr(block, name)!r}, the first one "
                f"{getattr(first, name)!r}."
            )
    if block.has_speed != first.has_speed:
        raise DataError(f"{first.recording_id}: some blocks have a speed and some have none.")


def require_unique_ids(ids: Iterable[str], where: str) -> None:
    """Refuse recordings of which two have one id."""
    counts = Counter(ids)
    for name, count in counts.items():
        if count > 1:
            raise InputError(
                f"two recordings have the id {name!r}; ids must be unique within {where}."
            )
