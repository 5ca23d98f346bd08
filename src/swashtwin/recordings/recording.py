"""One uninterrupted measurement, and what is known of it."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, InputError
from swashtwin.pump import OperatingCondition


@dataclass(frozen=True, eq=False)
class Recording:
    """Signals that were sampled together, without a gap, at one operating condition.

    It is the unit of honesty: windows carry its `recording_id`, and no split puts one recording on both sides.
    """

    signal: Float[np.ndarray, "channel time"]
    """Converter readings in `unit`, float64."""
    sample_rate: float
    """Readings per second and channel [Hz]."""
    recording_id: str
    """Unique name within a data set."""
    channels: tuple[str, ...] = ("acceleration",)
    """Name of each channel, in the order of `signal`."""
    unit: str = "m/s^2"
    """Unit of every channel; readers convert acceleration to m/s^2, and leave what they cannot convert as it was."""
    label: str | None = None
    """Class of the pump's condition, or None where nobody knows."""
    condition: OperatingCondition | None = None
    """Operating condition, or None where nobody wrote it down; the mean where `speed` says that it changed."""
    speed: Float[np.ndarray, " time"] | None = None
    """Angular speed of the shaft at each reading [rad/s], or None where it did not change or nobody measured it."""
    specimen: str | None = None
    """Which physical machine (or which machined fault) was measured; splits by specimen use it."""
    synthetic: bool = False
    """Whether a model made it. A synthetic recording never enters a test set."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Whatever else the file said (source file, sensor, date)."""

    def __post_init__(self) -> None:
        if self.signal.ndim != 2 or self.signal.size == 0:
            raise DataError(f"{self.recording_id}: signal has shape {self.signal.shape}; it must be (channel, time).")
        if not (np.isfinite(self.sample_rate) and self.sample_rate > 0):
            raise DataError(f"{self.recording_id}: sample_rate ({self.sample_rate!r} Hz) must be a positive number.")
        if len(self.channels) != self.signal.shape[0]:
            raise DataError(
                f"{self.recording_id}: {len(self.channels)} channel names for {self.signal.shape[0]} channels."
            )
        if self.speed is not None:
            self._require_speed(self.speed)

    def _require_speed(self, speed: np.ndarray) -> None:
        readings = self.signal.shape[1]
        if speed.shape != (readings,):
            raise DataError(
                f"{self.recording_id}: speed has shape {speed.shape} for {readings} readings; one for each."
            )
        wrong = np.flatnonzero(~(np.isfinite(speed) & (speed >= 0)))
        if wrong.size:
            raise DataError(
                f"{self.recording_id}: speed ({speed[wrong[0]]:g} rad/s at reading {wrong[0]}) must be zero or a "
                "positive number."
            )

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.signal.shape[0])

    @property
    def duration(self) -> float:
        """Length [s]."""
        return float(self.signal.shape[1] / self.sample_rate)

    @property
    def time(self) -> Float[np.ndarray, " time"]:
        """Time of each reading since the first [s]."""
        return np.arange(self.signal.shape[1]) / self.sample_rate

    def fingerprint(self) -> str:
        """SHA-256 of the readings, the sample rate, the channels and the unit, hexadecimal; no other fact counts."""
        digest = hashlib.sha256(repr((float(self.sample_rate), self.channels, self.unit, self.signal.shape)).encode())
        digest.update(np.ascontiguousarray(self.signal, dtype="<f8").tobytes())
        return digest.hexdigest()

    def relabeled(self, label: str | None) -> "Recording":
        """The same measurement under another class."""
        return replace(self, label=label)

    def picked(self, channels: Sequence[str]) -> "Recording":
        """The same measurement with only `channels`, in that order."""
        missing = [name for name in channels if name not in self.channels]
        if missing:
            raise InputError(f"{self.recording_id} has no channel {missing[0]!r}; it has {', '.join(self.channels)}.")
        rows = [self.channels.index(name) for name in channels]
        return replace(self, signal=self.signal[rows], channels=tuple(channels))


def joined(blocks: Iterable[Recording]) -> Recording:
    """One recording of blocks that follow each other without a gap; the first one's facts hold for all.

    Raises
    ------
    DataError
        There is no block, or one differs from the first in channels, sample rate, id, or in whether it has a speed.
    """
    kept = list(blocks)
    if not kept:
        raise DataError("no block to make a recording of.")
    for block in kept[1:]:
        require_same_facts(kept[0], block)
    speeds = [block.speed for block in kept if block.speed is not None]
    signal = np.concatenate([block.signal for block in kept], axis=1)
    return replace(kept[0], signal=signal, speed=np.concatenate(speeds) if speeds else None)


def require_same_facts(first: Recording, block: Recording) -> None:
    """Refuse a block that cannot continue `first`."""
    for name in ("recording_id", "channels", "sample_rate", "unit"):
        if getattr(block, name) != getattr(first, name):
            raise DataError(
                f"{first.recording_id}: a block has {name} {getattr(block, name)!r}, the first one "
                f"{getattr(first, name)!r}."
            )
    if (block.speed is None) != (first.speed is None):
        raise DataError(f"{first.recording_id}: some blocks have a speed and some have none.")


def select(
    recordings: Iterable[Recording],
    *,
    label: str | None = None,
    ids: Iterable[str] | None = None,
    specimen: str | None = None,
) -> list[Recording]:
    """Recordings that meet every condition given, in their order.

    Parameters
    ----------
    label : class to keep.
    ids : recording ids to keep, such as ``train.recording_id``, so that nothing of the test set is used.
    specimen : machine to keep.

    Raises
    ------
    DataError
        Nothing is left.
    """
    wanted = None if ids is None else {str(name) for name in ids}
    recordings = list(recordings)
    kept = [
        recording
        for recording in recordings
        if (label is None or recording.label == label)
        and (wanted is None or recording.recording_id in wanted)
        and (specimen is None or recording.specimen == specimen)
    ]
    if not kept:
        asked = {"label": label, "specimen": specimen}
        words = " and ".join(f"the {name} {value!r}" for name, value in asked.items() if value is not None)
        specimens = ", ".join(sorted({str(recording.specimen) for recording in recordings})) or "none"
        raise DataError(f"no recording has {words or 'such an id'}; the specimens are {specimens}.")
    return kept
