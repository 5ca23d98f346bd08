"""A set of windows, each with the facts of the recording it was cut from, and their operating
points.
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int64, Shaped

from swashtwin.foundation import DataError, InputError, load_artifact, plural, save_artifact
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, merge_close_values, values_match
from swashtwin.recordings import Manifest, join_manifests


@dataclass(frozen=True)
class WindowLayout:
    """What windows must have in common to be learned from together."""

    sample_rate: float
    """Samples per second and channel [Hz]."""
    channels: tuple[str, ...]
    unit: str
    length: int
    """Samples per window and channel."""

    def difference(self, other: "WindowLayout") -> str | None:
        """Words for the first thing in which `other` differs, with both values, or None where
        nothing does.
        """
        if not math.isclose(self.sample_rate, other.sample_rate, rel_tol=1e-6):
            return f"sample rate {self.sample_rate:g} Hz against {other.sample_rate:g} Hz"
        if len(self.channels) != len(other.channels):
            return f"{len(self.channels)} channel(s) against {len(other.channels)}"
        if self.channels != other.channels:
            return f"channels {', '.join(self.channels)} against {', '.join(other.channels)}"
        if self.unit != other.unit:
            return f"unit {self.unit} against {other.unit}"
        if self.length != other.length:
            return f"window length {self.length} against {other.length} samples"
        return None


@dataclass(frozen=True, eq=False)
class WindowSet:
    """Windows of one layout, and for each its class, its recording, its specimen and its condition.

    Built by `cut_windows`; ``a + b`` joins two sets, `subset` takes a part. The recording's id
    stays with each window, so that a split and an evaluation can refuse a leak.
    """

    signal: Float32[np.ndarray, "window channel time"]
    """Samples in `unit`."""
    target: Int64[np.ndarray, " window"]
    """Index into `classes`; -1 where the class is not known."""
    classes: tuple[str, ...]
    recording_id: Shaped[np.ndarray, " window"]
    """Recording that each window was cut from (strings)."""
    specimen: Shaped[np.ndarray, " window"]
    """Machine that was measured (strings); empty where nobody wrote it down."""
    discharge_pressure: Float[np.ndarray, " window"]
    """Absolute pressure at the outlet [Pa]; NaN where not known."""
    speed: Float[np.ndarray, " window"]
    """Angular speed of the shaft [rad/s]; NaN where not known."""
    start: Int64[np.ndarray, " window"]
    """Index in the recording of each window's first sample."""
    synthetic: Bool[np.ndarray, " window"]
    sample_rate: float
    """Samples per second and channel [Hz]."""
    channels: tuple[str, ...]
    """Name of each channel, in the order of `signal`."""
    unit: str = "m/s^2"
    manifest: Manifest = field(default_factory=dict)
    """Recordings that had a part in the windows without standing in them
    (`swashtwin.recordings.Manifest`): those that a twin was calibrated on, and those that lent a
    synthetic window its noise. Training on the windows is training on these.
    """
    content: Manifest = field(default_factory=dict)
    """Hashes of the content of the recordings that the windows were cut from, by id; what is
    missing goes by name.
    """

    def __post_init__(self) -> None:
        if self.signal.ndim != 3 or self.signal.shape[1] != len(self.channels):
            raise DataError(
                f"signal has shape {self.signal.shape}; with {len(self.channels)} channel name(s) it must be "
                f"(window, {len(self.channels)}, time)."
            )
        for name in _PER_WINDOW:
            if getattr(self, name).shape[:1] != (len(self),):
                raise DataError(
                    f"{name} has {getattr(self, name).shape[0]} entries for {len(self)} windows."
                )
        if len(set(self.classes)) != len(self.classes):
            raise InputError(f"classes ({', '.join(self.classes)}) name one class twice.")
        if len(self) and not -1 <= self.target.min() <= self.target.max() < len(self.classes):
            raise DataError(f"target holds indices outside -1...{len(self.classes) - 1}.")

    @property
    def recordings(self) -> dict[str, tuple[str, ...]]:
        """The recordings that the windows were cut from, with the hashes of their content."""
        return {
            name: tuple(self.content.get(name, ()))
            for name in np.unique(self.recording_id).tolist()
        }

    @property
    def sources(self) -> dict[str, tuple[str, ...]]:
        """Every recording behind the windows: those that they were cut from, and the manifest."""
        return join_manifests([self.recordings, self.manifest])

    def __len__(self) -> int:
        return int(self.signal.shape[0])

    def __add__(self, other: "WindowSet") -> "WindowSet":
        if self.classes != other.classes:
            raise InputError(
                f"windows of the classes ({', '.join(self.classes)}) cannot join windows of the classes "
                f"({', '.join(other.classes)}); cut the second like the first."
            )
        if difference := self.layout.difference(other.layout):
            raise InputError(
                f"windows cannot be joined: {difference}; cut the second like the first."
            )
        arrays = {
            name: np.concatenate([getattr(self, name), getattr(other, name)])
            for name in _PER_WINDOW
        }
        joined = {
            "manifest": join_manifests([self.manifest, other.manifest]),
            "content": join_manifests([self.content, other.content]),
        }
        return self._with(arrays | joined)

    def _with(self, changes: dict[str, Any]) -> "WindowSet":
        values = {item.name: getattr(self, item.name) for item in fields(WindowSet)}
        return WindowSet(**{**values, **changes})

    def __repr__(self) -> str:
        synthetic = int(self.synthetic.sum())
        part = f", {synthetic} of them synthetic" if synthetic else ""
        recordings = plural(np.unique(self.recording_id).size, "recording")
        return (
            f"<WindowSet: {plural(len(self), 'window')}{part}, {recordings}, "
            f"{plural(self.n_channels, 'channel')}, {self.length} samples at {self.sample_rate:g} Hz, "
            f"classes {', '.join(self.classes)}>"
        )

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return int(self.signal.shape[1])

    @property
    def length(self) -> int:
        """Samples per window and channel."""
        return int(self.signal.shape[2])

    @property
    def layout(self) -> WindowLayout:
        """Sample rate, channels, unit and length together."""
        return WindowLayout(self.sample_rate, self.channels, self.unit, self.length)

    @property
    def label(self) -> Shaped[np.ndarray, " window"]:
        """Class name of each window; empty where it is not known."""
        return np.array([*self.classes, ""], dtype=np.str_)[self.target]

    @property
    def turns_per_sample(self) -> Float32[np.ndarray, " window"]:
        """Turns of the shaft per sample in each window; NaN where the speed is not known."""
        return (self.speed / (2 * np.pi * self.sample_rate)).astype(np.float32)

    def condition(self, window: int) -> Float64[np.ndarray, " quantity"]:
        """Speed [rad/s] and discharge pressure [Pa] of one window; NaN where not stated."""
        return np.array([self.speed[window], self.discharge_pressure[window]], dtype=np.float64)

    def subset(
        self, chosen: Bool[np.ndarray, " window"] | Int[np.ndarray, " chosen"]
    ) -> "WindowSet":
        """The windows that a mask keeps, or that indices name, in that order."""
        return self._with({name: getattr(self, name)[chosen] for name in _PER_WINDOW})

    def with_classes(self, classes: Sequence[str]) -> "WindowSet":
        """The same windows with classes in another order; an `InputError` where one that has
        windows is missing.
        """
        order = {name: index for index, name in enumerate(classes)}
        present = [self.classes[index] for index in np.unique(self.target) if index >= 0]
        missing = [name for name in present if name not in order]
        if missing:
            raise InputError(
                f"{missing[0]!r} has windows and is none of the classes {', '.join(classes)}."
            )
        lookup = np.array([*(order.get(name, -1) for name in self.classes), -1], dtype=np.int64)
        return self._with({"classes": tuple(classes), "target": lookup[self.target]})

    def counts(self) -> dict[tuple[str, float | None], int]:
        """Number of windows in each cell (class, discharge pressure [Pa]), empty cells included.

        Pressures of the same operating point share a cell; None stands where none is stated. An
        empty cell is a missing condition.
        """
        pressures = [None if np.isnan(value) else value for value in self.cell_pressure.tolist()]
        levels = [*distinct_values(self.cell_pressure), *([None] if None in pressures else [])]
        cells = {(name, level): 0 for name in self.classes for level in levels}
        for name, pressure in zip(self.label.tolist(), pressures, strict=True):
            if name:
                cells[name, pressure] += 1
        return cells

    @property
    def cell_pressure(self) -> Float[np.ndarray, " window"]:
        """Discharge pressure [Pa] of each window's operating point, the key of its cell; NaN where
        not stated.
        """
        return merge_close_values(self.discharge_pressure, PRESSURE_TOLERANCE)

    def require_any(self, purpose: str) -> None:
        """Raise a `DataError` where there is no window."""
        if not len(self):
            size = f"{self.length} samples ({self.length / self.sample_rate:.3g} s)"
            raise DataError(
                f"no window of {size} {purpose}; give recordings that are longer, or more of them."
            )

    def require_labels(self, purpose: str) -> None:
        """Raise a `DataError` that names a recording without a class, if there is one."""
        unknown = np.flatnonzero(self.target < 0)
        if unknown.size:
            raise DataError(
                f"{self.recording_id[unknown[0]]} has no label, which {purpose} needs; give it one, or only "
                "diagnose it."
            )

    def require_two_classes(self) -> None:
        """Raise a `DataError` where there is one class only: whatever was learned would always give
        that answer.
        """
        if len(self.classes) < 2:
            raise DataError(
                f"every window is of the class {', '.join(self.classes) or 'without a name'}; a classifier needs two "
                "classes at least: record a fault, or add synthetic windows of one. Of healthy recordings alone, "
                "an AnomalyDetector can be fitted."
            )

    def fingerprint(self) -> str:
        """SHA-256 over every sample and every fact of the set, hexadecimal."""
        digest = hashlib.sha256(repr((self.classes, self.layout)).encode())
        for name in _PER_WINDOW:
            array = np.ascontiguousarray(getattr(self, name))
            digest.update(
                "\x1f".join(array.tolist()).encode() if array.dtype.kind == "U" else array.tobytes()
            )
        return digest.hexdigest()


def distinct_values(values: Float[np.ndarray, " window"]) -> tuple[float, ...]:
    """Each value that occurs, ascending, without NaN."""
    return tuple(float(value) for value in np.unique(values[~np.isnan(values)]))


_PER_WINDOW = (
    "signal",
    "target",
    "recording_id",
    "specimen",
    "discharge_pressure",
    "speed",
    "start",
    "synthetic",
)

_KIND, _VERSION = "window set", 4
_MAY_BE_NAN = ("discharge_pressure", "speed")


def save_windows(windows: WindowSet, path: Path | str) -> Path:
    """`path`, after the windows and their manifest were written to it whole; an `ArtifactError` for
    NaN or infinity.
    """
    alone = WindowSet(**{item.name: getattr(windows, item.name) for item in fields(WindowSet)})
    return save_artifact(path, _KIND, _VERSION, alone, may_be_nan=_MAY_BE_NAN)


def load_windows(path: Path | str) -> WindowSet:
    """The windows that `save_windows` wrote.

    Raises
    ------
    MissingFileError
        No such file.
    ArtifactError
        It is damaged, edited, no window file, or of another version.
    """
    advice = "swashtwin synthesize, or save_windows, writes windows"
    return load_artifact(path, WindowSet, _KIND, _VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)


SYNTHETIC_SPEED_TOLERANCE = 0.03
"""Relative difference of speeds: the slip of a motor, and the spread with which synthetic windows
are drawn.
"""


def require_shared_speed(measured: WindowSet, synthetic: WindowSet) -> None:
    """Refuse synthetic windows that run at no speed that was measured; those without a stated speed
    pass.
    """
    require_matching_values(
        synthetic.speed, measured.speed[~measured.synthetic], quantity="speed", who="the synthetic windows run",
        remedy="make synthetic windows with a twin that is calibrated on these recordings",
    )  # fmt: skip


def require_matching_values(
    simulated: Float[np.ndarray, " simulated"],
    measured: Float[np.ndarray, " measured"],
    *,
    quantity: str,
    who: str,
    remedy: str,
) -> None:
    """Refuse a model none of whose values matches a measured one; the error names both.

    Parameters
    ----------
    simulated, measured : speeds [rad/s] or discharge pressures [Pa], NaN where not stated.
    quantity : ``"speed"`` or ``"pressure"``.
    who : whose values `simulated` are, with a verb: ``"the twin runs"``.
    """
    tolerance, factor, unit = {
        "speed": (SYNTHETIC_SPEED_TOLERANCE, 30 / math.pi, "rev/min"),
        "pressure": (PRESSURE_TOLERANCE, 1e-6, "MPa"),
    }[quantity]
    simulated, measured = (np.unique(values[~np.isnan(values)]) for values in (simulated, measured))
    is_shared = any(
        np.any(values_match(measured, value, tolerance)) for value in simulated.tolist()
    )
    if is_shared or not (simulated.size and measured.size):
        return
    texts = []
    for values in (simulated, measured):
        low, high = (f"{value * factor:.4g}" for value in (values.min(), values.max()))
        texts.append(f"{low} {unit}" if low == high else f"{low} to {high} {unit}")
    raise InputError(
        f"{who} at {texts[0]} and the recordings state {texts[1]}: they are not alike; {remedy}."
    )


def operating_points(
    condition: Float[np.ndarray, "recording quantity"],
) -> tuple[Float64[np.ndarray, "point quantity"], Int64[np.ndarray, " recording"]]:
    """(speed [rad/s] and pressure [Pa] of each operating point, index of each recording's); close
    ones are one.
    """
    tolerances = (SPEED_TOLERANCE, PRESSURE_TOLERANCE)
    merged = [
        merge_close_values(column, limit)
        for column, limit in zip(condition.T, tolerances, strict=True)
    ]
    points, point = np.unique(np.stack(merged, axis=1), axis=0, return_inverse=True)
    return points, point.reshape(-1)


def group_means(
    rows: Float[np.ndarray, "row *axes"], group: Int[np.ndarray, " row"]
) -> Float[np.ndarray, "group *axes"]:
    """Mean of the rows of each group 0, 1, ..."""
    return np.stack([rows[group == number].mean(axis=0) for number in range(int(group.max()) + 1)])
