"""A set of windows, each with the facts of the recording it was cut from."""

import hashlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int64, Shaped

from swashtwin.foundation import (
    DataError,
    InputError,
    html_table,
    load_artifact,
    plural,
    save_artifact,
    shorten,
)
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, merge_close_values, values_match
from swashtwin.recordings import Manifest, join_manifests


@dataclass(frozen=True)
class WindowLayout:
    """Properties that windows must share to be learned from together."""

    sample_rate: float
    """Samples per second and channel [Hz]."""
    channels: tuple[str, ...]
    unit: str
    length: int
    """Samples per window and channel."""

    def difference(self, other: "WindowLayout") -> str | None:
        """Describe the first property in which `other` differs, with both values.

        None if nothing differs.
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
    """Windows of one layout, each with its class, recording, specimen and operating point.

    `cut_windows` builds it, ``a + b`` joins two sets, `subset` takes a part. The recording's id
    stays with each window, so that a split and an evaluation can refuse a leak.
    """

    signal: Float32[np.ndarray, "window channel time"]
    """Samples in `unit`."""
    target: Int64[np.ndarray, " window"]
    """Index into `classes`; -1 if the class is unknown."""
    classes: tuple[str, ...]
    recording_id: Shaped[np.ndarray, " window"]
    """Recording that each window was cut from (strings)."""
    specimen: Shaped[np.ndarray, " window"]
    """Machine that was measured (strings); empty if not specified."""
    discharge_pressure: Float[np.ndarray, " window"]
    """Absolute pressure at the outlet [Pa]; NaN if unknown."""
    speed: Float[np.ndarray, " window"]
    """Angular speed of the shaft [rad/s]; NaN if unknown."""
    start: Int64[np.ndarray, " window"]
    """Index in the recording of each window's first sample."""
    synthetic: Bool[np.ndarray, " window"]
    sample_rate: float
    """Samples per second and channel [Hz]."""
    channels: tuple[str, ...]
    """Name of each channel, in the order of `signal`."""
    unit: str = "m/s^2"
    manifest: Manifest = field(default_factory=dict)
    """Recordings that contributed to the windows without standing in them: those that a twin was
    calibrated on, and those that lent a synthetic window its noise. Training on the windows is
    training on these.
    """
    content: Manifest = field(default_factory=dict)
    """Hashes of the content of the recordings that the windows were cut from, by id. A recording
    without hashes is recognized by its id alone.
    """

    def __post_init__(self) -> None:
        n_channels = len(self.channels)
        if self.signal.ndim != 3 or self.signal.shape[1] != n_channels:
            raise DataError(
                f"signal has shape {self.signal.shape}; with {n_channels} channel name(s) it must "
                f"be (window, {n_channels}, time)."
            )
        for name in _PER_WINDOW:
            array = getattr(self, name)
            if array.shape[:1] != (len(self),):
                raise DataError(f"{name} has {array.shape[0]} entries for {len(self)} windows.")

        n_classes = len(self.classes)
        if len(set(self.classes)) != n_classes:
            raise InputError(f"classes ({', '.join(self.classes)}) name one class twice.")
        if len(self) and not -1 <= self.target.min() <= self.target.max() < n_classes:
            raise DataError(f"target holds indices outside -1...{n_classes - 1}.")

    @property
    def recordings(self) -> dict[str, tuple[str, ...]]:
        """The recordings that the windows were cut from, with the hashes of their content."""
        names = np.unique(self.recording_id).tolist()
        return {name: tuple(self.content.get(name, ())) for name in names}

    @property
    def sources(self) -> dict[str, tuple[str, ...]]:
        """All recordings behind the windows: those that they were cut from, and the manifest."""
        return join_manifests([self.recordings, self.manifest])

    def __len__(self) -> int:
        return int(self.signal.shape[0])

    def __getitem__(self, index: Any) -> "WindowSet":
        """Return one window, or those of a slice, a mask or indices, as a window set.

        Raises
        ------
        IndexError
            There is no such window.
        """
        return self.subset(np.atleast_1d(np.arange(len(self))[index]))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Return `signal`; without it NumPy would take each window for a further dimension."""
        return np.array(self.signal, dtype, copy=copy)

    def __add__(self, other: "WindowSet") -> "WindowSet":
        if self.classes != other.classes:
            raise InputError(
                f"Windows of the classes ({', '.join(self.classes)}) cannot be joined with windows "
                f"of the classes ({', '.join(other.classes)}). Cut the second like the first."
            )
        difference = self.layout.difference(other.layout)
        if difference:
            raise InputError(
                f"Windows cannot be joined: {difference}. Cut the second like the first."
            )

        changes: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(other, name)])
            for name in _PER_WINDOW
        }
        changes["manifest"] = join_manifests([self.manifest, other.manifest])
        changes["content"] = join_manifests([self.content, other.content])
        return self._replaced(changes)

    def _replaced(self, changes: dict[str, Any]) -> "WindowSet":
        """Return a plain window set with some fields changed, also of a subclass."""
        values = _field_values(self)
        values.update(changes)
        return WindowSet(**values)

    def __repr__(self) -> str:
        n_synthetic = int(self.synthetic.sum())
        synthetic = f", {n_synthetic} of them synthetic" if n_synthetic else ""
        recordings = plural(np.unique(self.recording_id).size, "recording")
        return shorten(
            f"<WindowSet: {plural(len(self), 'window')}{synthetic}, {recordings}, "
            f"{plural(self.n_channels, 'channel')}, {self.length} samples at "
            f"{self.sample_rate:g} Hz, classes {', '.join(self.classes)}>"
        )

    def _repr_html_(self) -> str:
        counts = self.counts()
        pressures = list(dict.fromkeys(pressure for _, pressure in counts))
        names = [
            "no pressure" if value is None else f"{value / 1e6:.4g} MPa" for value in pressures
        ]
        rows = [(label, *(counts[label, value] for value in pressures)) for label in self.classes]
        return html_table(repr(self), ("windows", *names), rows)

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
        """Class name of each window; empty if unknown."""
        return np.array([*self.classes, ""], dtype=np.str_)[self.target]

    @property
    def turns_per_sample(self) -> Float32[np.ndarray, " window"]:
        """Turns of the shaft per sample in each window; NaN if the speed is unknown."""
        return (self.speed / (2 * np.pi * self.sample_rate)).astype(np.float32)

    def condition(self, window: int) -> Float64[np.ndarray, " quantity"]:
        """Return speed [rad/s] and discharge pressure [Pa] of one window; NaN if not specified."""
        return np.array([self.speed[window], self.discharge_pressure[window]], dtype=np.float64)

    def subset(
        self, rows: Bool[np.ndarray, " window"] | Int[np.ndarray, " selected"]
    ) -> "WindowSet":
        """Return the windows that a mask selects, or those at some indices, in that order."""
        return self._replaced({name: getattr(self, name)[rows] for name in _PER_WINDOW})

    def with_classes(self, classes: Sequence[str]) -> "WindowSet":
        """Return the same windows with other classes, or the same classes in another order.

        Raises
        ------
        InputError
            A class that has windows is not among `classes`.
        """
        order = {name: index for index, name in enumerate(classes)}
        present = [self.classes[index] for index in np.unique(self.target) if index >= 0]
        excluded = [name for name in present if name not in order]
        if excluded:
            raise InputError(
                f"The class {excluded[0]!r} has windows and is not among the classes "
                f"{', '.join(classes)}."
            )

        # The last entry is for target -1, a window without a class.
        lookup = np.array([*(order.get(name, -1) for name in self.classes), -1], dtype=np.int64)
        return self._replaced({"classes": tuple(classes), "target": lookup[self.target]})

    def counts(self) -> dict[tuple[str, float | None], int]:
        """Return the number of windows in each cell (class, discharge pressure [Pa]).

        Pressures of the same operating point share a cell; None stands for windows without a
        specified pressure. Empty cells are included: they are missing operating points.
        """
        window_pressures: list[float | None] = [
            None if np.isnan(value) else value for value in self.cell_pressure.tolist()
        ]
        cell_pressures: list[float | None] = list(distinct_values(self.cell_pressure))
        if None in window_pressures:
            cell_pressures.append(None)

        cells = dict.fromkeys(itertools.product(self.classes, cell_pressures), 0)
        for label, pressure in zip(self.label.tolist(), window_pressures, strict=True):
            if label:
                cells[label, pressure] += 1
        return cells

    @property
    def cell_pressure(self) -> Float[np.ndarray, " window"]:
        """Discharge pressure [Pa] of each window's operating point, the key of its cell.

        NaN if not specified.
        """
        return merge_close_values(self.discharge_pressure, PRESSURE_TOLERANCE)

    def require_any(self, purpose: str) -> None:
        """Raise a `DataError` if there is no window."""
        if not len(self):
            size = f"{self.length} samples ({self.length / self.sample_rate:.3g} s)"
            raise DataError(
                f"There is no window of {size} {purpose}. Give longer recordings, or more of them."
            )

    def require_labels(self, purpose: str) -> None:
        """Raise a `DataError` that names a recording without a class, if there is one."""
        unlabeled = np.flatnonzero(self.target < 0)
        if unlabeled.size:
            raise DataError(
                f"{self.recording_id[unlabeled[0]]} has no label, and {purpose} needs one. Add it, "
                "or only diagnose the recording."
            )

    def require_two_classes(self) -> None:
        """Raise a `DataError` if there is only one class: the answer would always be the same."""
        if len(self.classes) < 2:
            label = ", ".join(self.classes) or "without a name"
            raise DataError(
                f"Every window is of the class {label}; a classifier needs at least two classes. "
                "Record a fault, or add synthetic windows of one. On healthy recordings alone, fit "
                "an AnomalyDetector."
            )

    def fingerprint(self) -> str:
        """Return the SHA-256 over every sample and every fact of the set, hexadecimal."""
        digest = hashlib.sha256(repr((self.classes, self.layout)).encode())
        for name in _PER_WINDOW:
            array = np.ascontiguousarray(getattr(self, name))
            if array.dtype.kind == "U":
                # Bytes of a string array depend on its longest entry.
                digest.update("\x1f".join(array.tolist()).encode())
            else:
                digest.update(array.tobytes())
        return digest.hexdigest()


def distinct_values(values: Float[np.ndarray, " window"]) -> tuple[float, ...]:
    """Return each value that occurs, ascending, without NaN."""
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

_KIND = "window set"
_VERSION = 4
_MAY_BE_NAN = ("discharge_pressure", "speed")


def _field_values(windows: WindowSet) -> dict[str, Any]:
    """Return the fields of a window set by name, without those that a subclass adds."""
    return {entry.name: getattr(windows, entry.name) for entry in fields(WindowSet)}


def save_windows(windows: WindowSet, path: Path | str) -> Path:
    """Write the windows and their manifest to `path`, completely or not at all.

    Raises
    ------
    ArtifactError
        A sample is NaN or infinite.
    """
    plain_windows = WindowSet(**_field_values(windows))
    return save_artifact(path, _KIND, _VERSION, plain_windows, may_be_nan=_MAY_BE_NAN)


def load_windows(path: Path | str) -> WindowSet:
    """Load the windows that `save_windows` wrote.

    Raises
    ------
    MissingFileError
        No such file.
    ArtifactError
        The file is damaged, edited, not a window file, or of another version.
    """
    advice = "swashtwin synthesize, or save_windows, writes windows"
    return load_artifact(path, WindowSet, _KIND, _VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)


SYNTHETIC_SPEED_TOLERANCE = 0.03
"""Relative difference of speeds: the slip of a motor, and the spread with which synthetic windows
are drawn.
"""


def require_shared_speed(measured: WindowSet, synthetic: WindowSet) -> None:
    """Require that some synthetic windows run at a measured speed.

    Windows without a specified speed pass.
    """
    require_matching_values(
        synthetic.speed,
        measured.speed[~measured.synthetic],
        quantity="speed",
        subject="the synthetic windows run",
        remedy="Make synthetic windows with a twin that is calibrated on these recordings.",
    )


def require_matching_values(
    simulated: Float[np.ndarray, " simulated"],
    measured: Float[np.ndarray, " measured"],
    *,
    quantity: str,
    subject: str,
    remedy: str,
) -> None:
    """Require that a simulated speed or pressure matches a measured one.

    It passes if either side specifies no value.

    Parameters
    ----------
    simulated, measured : speeds [rad/s] or discharge pressures [Pa], NaN if not specified.
    quantity : ``"speed"`` or ``"pressure"``.
    subject : what `simulated` belongs to, with a verb: ``"the twin runs"``.
    remedy : sentence that states what to do.
    """
    if quantity == "speed":
        tolerance = SYNTHETIC_SPEED_TOLERANCE
        factor = 30 / math.pi
        unit = "rev/min"
    else:
        tolerance = PRESSURE_TOLERANCE
        factor = 1e-6
        unit = "MPa"

    simulated_values = distinct_values(simulated)
    measured_values = distinct_values(measured)
    if not (simulated_values and measured_values):
        return
    if any(
        np.any(values_match(np.array(measured_values), value, tolerance))
        for value in simulated_values
    ):
        return

    simulated_range = _format_range(simulated_values, factor, unit)
    measured_range = _format_range(measured_values, factor, unit)
    subject = subject[0].upper() + subject[1:]
    raise InputError(
        f"{subject} at {simulated_range}, but the recordings specify {measured_range}.",
        field=quantity,
        remedy=remedy,
    )


def _format_range(values: Sequence[float], factor: float, unit: str) -> str:
    low = f"{values[0] * factor:.4g}"
    high = f"{values[-1] * factor:.4g}"
    if low == high:
        return f"{low} {unit}"
    return f"{low} to {high} {unit}"


def operating_points(
    condition: Float[np.ndarray, "recording quantity"],
) -> tuple[Float64[np.ndarray, "point quantity"], Int64[np.ndarray, " recording"]]:
    """Return the distinct operating points, and the index of that of each recording.

    An operating point is a speed [rad/s] and a pressure [Pa]; close ones are the same.
    """
    tolerances = (SPEED_TOLERANCE, PRESSURE_TOLERANCE)
    merged = [
        merge_close_values(column, tolerance)
        for column, tolerance in zip(condition.T, tolerances, strict=True)
    ]
    points, index = np.unique(np.stack(merged, axis=1), axis=0, return_inverse=True)
    return points, index.reshape(-1)


def group_means(
    rows: Float[np.ndarray, "row *axes"], group: Int[np.ndarray, " row"]
) -> Float[np.ndarray, "group *axes"]:
    """Return the mean of the rows of each group 0, 1, ..."""
    n_groups = int(group.max()) + 1
    return np.stack([rows[group == number].mean(axis=0) for number in range(n_groups)])
