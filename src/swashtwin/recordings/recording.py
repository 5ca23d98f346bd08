"""One uninterrupted measurement: its facts, and samples that may stay in their file."""

import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Any, NoReturn

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, InputError, load_extra, plain_text, plural
from swashtwin.pump import OperatingCondition
from swashtwin.recordings.columns import BLOCK_SAMPLES
from swashtwin.recordings.samples import Samples

# Default of the argument `speed`: None would remove the speed that the samples have.
_SPEED_OF_SAMPLES: Any = object()


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Recording:
    """Signals that were sampled together, without a gap, at one operating point.

    A recording is whole in training or in test: windows carry its `recording_id`, and no split
    parts it. One that was loaded from a file reads its samples on demand: `signal` reads them all
    and keeps them, `slice` and `blocks` read a part. The facts need no reading.

    Parameters
    ----------
    signal : samples (channel, time) in `unit`.
    sample_rate, recording_id, channels, unit, label, condition, specimen, synthetic, attributes :
        as described below.
    speed : angular speed of the shaft at each sample [rad/s], or None if it was constant or not
        measured.

    Raises
    ------
    DataError
        The arrays have another shape, a name is missing, or the sample rate or a speed is invalid.

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
    """Name of each channel, in the order of `signal`.

    Names and labels are in one Unicode form (`plain_text`). A channel whose name is blank is called
    ``channel_`` and its number from 0, as a channel of a file without names.
    """
    unit: str
    """Unit of every channel; readers convert acceleration to m/s^2 and leave other units alone."""
    label: str | None
    """Class of the pump's condition, or None if it is unknown."""
    condition: OperatingCondition | None
    """Operating point, or None if it is unknown; the mean if `speed` varies."""
    specimen: str | None
    """Physical machine, or machined fault, that was measured; splits by specimen use it."""
    synthetic: bool
    """Whether a model made it. A synthetic recording never enters a test set."""
    attributes: Mapping[str, str]
    """Further facts from the file or the index (source file, sensor, date)."""
    samples: Samples
    """Samples in memory or in a file; `signal`, `slice` and `blocks` return them."""

    def __init__(
        self,
        signal: Float[np.ndarray, "channel time"] | None = None,
        sample_rate: float = math.nan,
        recording_id: str = "",
        channels: tuple[str, ...] = ("acceleration",),
        unit: str = "m/s^2",
        label: str | None = None,
        condition: OperatingCondition | None = None,
        speed: Float[np.ndarray, " time"] | None = _SPEED_OF_SAMPLES,
        specimen: str | None = None,
        synthetic: bool = False,
        attributes: Mapping[str, str] | None = None,
        samples: Samples | None = None,
    ) -> None:
        if (samples is None and signal is None) or not recording_id:
            raise InputError(
                "A recording needs a signal (channel, time), a sample_rate in Hz and a "
                "recording_id."
            )
        _require_types(recording_id, label, specimen, condition)
        _require_sample_rate(recording_id, sample_rate)

        samples = _combine_samples(recording_id, signal, speed, samples)
        channels = (channels,) if isinstance(channels, str) else channels
        if len(channels) != samples.shape[0]:
            raise DataError(
                f"{recording_id}: {len(channels)} channel names for {samples.shape[0]} channels."
            )

        channels = tuple(
            plain_text(name) or f"channel_{number}" for number, name in enumerate(channels)
        )
        _require_unique_channels(recording_id, channels)

        facts = {
            "sample_rate": sample_rate,
            "recording_id": recording_id,
            "channels": channels,
            "unit": unit,
            "label": plain_text(label or "") or None,
            "condition": condition,
            "specimen": plain_text(specimen or "") or None,
            "synthetic": synthetic,
            "attributes": dict(attributes or {}),
            "samples": samples,
        }
        for name, value in facts.items():
            object.__setattr__(self, name, value)  # the dataclass is frozen

    def __iter__(self) -> NoReturn:
        """Refuse: a function of several recordings was called with one."""
        raise InputError(
            f"{self.recording_id} is one recording, but several are expected; pass a list of it."
        )

    def __repr__(self) -> str:
        """Return a short text: name, class, channels and length."""
        return (
            f"Recording({self.recording_id!r}: {self.label or 'no label'}, "
            f"{plural(self.n_channels, 'channel')} at {self.sample_rate:g} Hz, "
            f"{self.duration:.4g} s)"
        )

    @property
    def signal(self) -> Float[np.ndarray, "channel time"]:
        """Samples in `unit`, which are read on first use and then stay in memory.

        The array cannot be written to; change a copy, and `replace` the signal by it.
        """
        return self.samples.signal

    @property
    def speed(self) -> Float[np.ndarray, " time"] | None:
        """Angular speed of the shaft at each sample [rad/s].

        None if it was constant or not measured.
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
        """Return the recording from sample `start` to before sample `stop`, in memory.

        Raises
        ------
        InputError
            The recording has no such samples.
        DataError
            The file is damaged there, or was changed after it was opened.
        """
        samples = Samples.in_memory(
            self.recording_id,
            self.samples.signal_part(start, stop),
            self.samples.speed_part(start, stop),
            origin=self.samples,
        )
        return self.replace(samples=samples)

    def blocks(self) -> "Iterator[Recording]":
        """Yield the recording in consecutive parts of `BLOCK_SAMPLES` samples."""
        for start in range(0, self.n_samples, BLOCK_SAMPLES):
            yield self.slice(start, start + BLOCK_SAMPLES)

    def replace(self, **changes: Any) -> "Recording":
        """Return the same recording with some facts, its signal or its speed changed.

        Samples in a file are not read for it.

        Examples
        --------
        >>> Recording(np.zeros((1, 4)), 2.0, "a").replace(label="piston")
        Recording('a': piston, 1 channel at 2 Hz, 2 s)
        """
        return replace(self, **changes)

    def to_xarray(self) -> Any:
        """Return the samples as an ``xarray.DataArray`` (channel, time), with facts as attributes.

        Its coordinates are the names of the channels, the time [s], and the speed of the shaft
        [rad/s] if it varies. Facts are in SI units; unknown ones are left out.

        Raises
        ------
        MissingExtraError
            xarray is not installed.
        """
        xarray = load_extra("xarray", "frames", "to_xarray")
        coordinates: dict[str, Any] = {
            "channel": list(self.channels),
            "time": ("time", self.time, {"units": "s"}),
        }
        if self.speed is not None:
            coordinates["speed"] = ("time", self.speed, {"units": "rad/s"})

        facts: dict[str, Any] = {
            **self.attributes,
            **({} if self.condition is None else asdict(self.condition)),
            "units": self.unit,
            "recording_id": self.recording_id,
            "label": self.label,
            "specimen": self.specimen,
            "sample_rate": self.sample_rate,
            # a netCDF file holds no truth values
            "synthetic": int(self.synthetic),
        }
        known_facts = {name: value for name, value in facts.items() if value is not None}
        return xarray.DataArray(
            self.signal, coordinates, ("channel", "time"), name="signal", attrs=known_facts
        )

    def select_channels(self, channels: Sequence[str]) -> "Recording":
        """Return the same measurement with only `channels`, in that order."""
        for name in channels:
            if name not in self.channels:
                raise InputError(
                    f"{self.recording_id} has no channel {name!r}; it has "
                    f"{', '.join(self.channels)}."
                )

        rows = [self.channels.index(name) for name in channels]
        return self.replace(samples=self.samples.select(rows), channels=tuple(channels))

    def unloaded(self) -> "Recording":
        """Return the same recording with nothing of its file in memory.

        Itself if it was not read from a file.
        """
        samples = self.samples.unopened()
        return self if samples is self.samples else self.replace(samples=samples)

    @contextmanager
    def loaded(self, max_values: int = 1 << 21) -> "Iterator[Recording]":
        """Hold all samples in memory within the block, so that its steps read the file once.

        Afterwards they are forgotten, unless they were in memory before.

        Parameters
        ----------
        max_values : samples of all channels above which the recording stays in its file; by
            default those of 17 MB.
        """
        was_loaded = self.samples.is_loaded
        if self.n_channels * self.n_samples <= max_values:
            self.samples.signal  # noqa: B018 - reads
        try:
            yield self
        finally:
            if not was_loaded:
                self.samples.release()

    def content_hashes(self) -> tuple[str, ...]:
        """Return a hash of each channel, whatever the file is called (`Samples.content_hashes`).

        Two recordings with a hash in common hold the same measurement. A copy under another name,
        in another format or at another rate of ``resample`` has the same hashes; one that was cut,
        filtered or scaled is detected by its `fingerprints` instead.
        """
        return tuple(digest for digest in self.samples.content_hashes() if digest)

    def fingerprint(self) -> str:
        """Return the SHA-256 of samples, sample rate, channels and unit, hexadecimal.

        No other fact counts.
        """
        signal = self.signal
        facts = (float(self.sample_rate), self.channels, self.unit, signal.shape)
        digest = hashlib.sha256(repr(facts).encode())
        digest.update(np.ascontiguousarray(signal, dtype="<f8").tobytes())
        return digest.hexdigest()


def _require_types(
    recording_id: object, label: object, specimen: object, condition: object
) -> None:
    expected_types: tuple[tuple[str, object, type, str], ...] = (
        ("label", label, str, "text"),
        ("specimen", specimen, str, "text"),
        ("recording_id", recording_id, str, "text"),
        ("condition", condition, OperatingCondition, "an OperatingCondition"),
    )
    for name, value, expected_type, type_name in expected_types:
        if value is not None and not isinstance(value, expected_type):
            raise InputError(f"{recording_id}: {name} ({value!r}) must be {type_name}.")


def _require_sample_rate(recording_id: str, sample_rate: object) -> None:
    is_number = isinstance(sample_rate, (int, float, np.number))
    if not (is_number and np.isfinite(sample_rate) and sample_rate > 0):  # type: ignore[call-overload, operator]
        raise DataError(
            f"{recording_id}: sample_rate ({sample_rate!r} Hz) must be a positive number."
        )


def _require_unique_channels(recording_id: str, channels: Sequence[str]) -> None:
    for name, count in Counter(channels).items():
        if count > 1:
            raise DataError(
                f"{recording_id}: {count} channels are named {name!r}; each channel needs its own "
                "name.",
                field="names",
            )


def _combine_samples(
    recording_id: str,
    signal: np.ndarray | None,
    speed: Any,  # np.ndarray (time), None, or _SPEED_OF_SAMPLES
    samples: Samples | None,
) -> Samples:
    """Return the samples of a recording from the arguments of its constructor.

    `signal` and `speed` replace those of `samples`, and then keep their content hashes: the
    measurement is the same.
    """
    has_new_speed = speed is not _SPEED_OF_SAMPLES
    if signal is None:
        assert samples is not None
        if not has_new_speed:
            return samples
        signal = samples.signal

    signal = _copy_signal(signal, recording_id)
    if not has_new_speed:
        speed = None if samples is None else samples.speed
    if speed is not None:
        speed = np.asarray(speed, dtype=np.float64)

    is_same_measurement = samples is not None and samples.name == recording_id
    origin = samples if is_same_measurement else None
    return Samples.in_memory(recording_id, signal, speed, origin=origin)


def _copy_signal(signal: np.ndarray, recording_id: str) -> np.ndarray:
    """Return a copy of a signal as real numbers, with NaN for masked samples.

    A copy, because a caller may change its array afterwards.
    """
    try:
        values = np.asarray(signal)
    except ValueError as cause:
        raise DataError(
            f"{recording_id}: the channels of signal differ in length; a recording is one array "
            "(channel, time)."
        ) from cause
    if values.dtype.kind not in "fiub":
        raise DataError(
            f"{recording_id}: signal holds {values.dtype} values; a recording holds real numbers."
        )

    is_float = values.dtype in (np.float32, np.float64)
    dtype = values.dtype if is_float else np.dtype(np.float64)
    return np.array(np.ma.filled(np.ma.asarray(signal, dtype), np.nan), dtype=dtype)


def join_blocks(blocks: Iterable[Recording]) -> Recording:
    """Return one recording of consecutive blocks, with the facts of the first.

    Raises
    ------
    DataError
        There is no block, or one differs from the first in channels, sample rate, id, unit, or in
        whether it has a speed.
    """
    blocks = list(blocks)
    if not blocks:
        raise DataError("There is no block to join into a recording.")
    first = blocks[0]
    for block in blocks[1:]:
        require_same_facts(first, block)

    signal = np.concatenate([block.signal for block in blocks], axis=1)
    speeds = [block.speed for block in blocks if block.speed is not None]
    speed = np.concatenate(speeds) if speeds else None
    return first.replace(samples=Samples.in_memory(first.recording_id, signal, speed))


def require_same_facts(first: Recording, block: Recording) -> None:
    """Refuse a block that cannot continue `first`."""
    for name in ("recording_id", "channels", "sample_rate", "unit"):
        expected = getattr(first, name)
        value = getattr(block, name)
        if value != expected:
            raise DataError(
                f"{first.recording_id}: a block has {name} {value!r}, the first one {expected!r}."
            )
    if block.has_speed != first.has_speed:
        raise DataError(f"{first.recording_id}: only some blocks have a speed.")


def require_unique_ids(ids: Iterable[str], collection: str) -> None:
    """Refuse recordings of which two have the same id.

    Parameters
    ----------
    collection : what they are part of, for the message, such as ``"a data set"``.
    """
    for name, count in Counter(ids).items():
        if count > 1:
            raise InputError(
                f"Two recordings have the id {name!r}; ids must be unique within {collection}."
            )
