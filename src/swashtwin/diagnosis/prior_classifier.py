"""`PriorClassifier`: names faults that nobody measured, from a machine's healthy recordings and a pump prior.

It was trained once, on virtual pumps of a design (`synthesis.simulate_changes`). What it looks at are changes: levels
at and between the piston passes, less those of the same machine's healthy recordings at the same operating point.
Housing, sensors and mounting are in both and cancel. docs/how-to/zero-shot.md says how it is used, and
docs/bench/evidence.md how far it can be trusted.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, Shaped

from swashtwin.diagnosis.alarm_scores import AlarmScores, evaluate_alarms
from swashtwin.diagnosis.classifier_input import require_recordings
from swashtwin.diagnosis.diagnosing import require_recording
from swashtwin.diagnosis.order_levels import order_levels, shaft_frequency
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import (
    DataError,
    InputError,
    from_table,
    plural,
    read_artifact,
    refuse_misfits,
    to_table,
    write_artifact,
)
from swashtwin.learning import Forest, fit_forest
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, Pump, is_healthy, values_match
from swashtwin.recordings import (
    Manifest,
    Recording,
    facts_of,
    join_manifests,
    listed_recordings,
    manifest_of,
    stated_pressure,
)
from swashtwin.signals import OrderBands

VERSION = 1
FEW_SHOT_WEIGHT = 3.0
"""What a measured fault counts in a leaf of the forest, against all that came there before it together; chosen on
fleets 100-103 of both versions of the virtual rig, without `HEALTHY_WEIGHT`."""
HEALTHY_WEIGHT = 0.3
"""What the change of a healthy recording against the others of its machine counts in a leaf, against all virtual pumps
there together; chosen on fleets 100-102 of both versions. Machines whose healthy recordings differ more than the
prior's then give fewer false alarms."""

_MAY_BE_NAN = ("speed", "pressure")
SHIPPED = Path(__file__).parent / "priors"
"""Folder of the shipped priors, one for each design."""


@dataclass(frozen=True, eq=False)
class PriorClassifier:
    """Classes of recordings from their changes against healthy ones; `fit_prior` or `load_model` makes it.

    `fit` gives the classifier of certain machines from their healthy recordings, and leaves the prior, which serves for
    all machines of the design, as it is. It is no estimator of scikit-learn, which hands over arrays: these state no
    speed, pressure and machine.
    """

    KIND: ClassVar[str] = "prior classifier"
    """Kind of its file."""

    pump: str
    """Name of the design."""
    bands: OrderBands
    """Bands of the levels."""
    channels: tuple[str, ...]
    """Channels that a recording must have, in order."""
    classes: tuple[str, ...]
    """Classes, in the order of the probabilities; the first one is healthy."""
    speed: tuple[float, float]
    """Speeds of the virtual pumps [rad/s]."""
    pressure: tuple[float, float]
    """Their discharge pressures [Pa]."""
    n_pumps: int
    """Number of virtual pumps."""
    forest: Forest
    """What maps changes to classes."""
    levels: Float64[np.ndarray, "recording channel band"]
    """Levels of the healthy recordings [log10 of the squared unit]."""
    specimen: tuple[str, ...] = ()
    """Machine of each healthy recording; empty where none is stated."""
    point_speed: Float64[np.ndarray, " recording"] = field(default_factory=lambda: np.empty(0))
    """Speed of each [rad/s]."""
    point_pressure: Float64[np.ndarray, " recording"] = field(default_factory=lambda: np.empty(0))
    """Discharge pressure of each [Pa], NaN where none is stated."""
    unit: str = ""
    """Unit of the healthy recordings."""
    taught: Mapping[str, int] = field(default_factory=dict)
    """Measured faults that it learned from: how many of each class."""
    manifest: Manifest = field(default_factory=dict)
    """Recordings that had a part in it, by id and content."""

    def __post_init__(self) -> None:
        bands, count = len(self.bands.edges), len(self.specimen)
        if self.forest.probability.shape[1] != len(self.classes) or self.forest.column.max(initial=-1) >= (
            len(self.channels) * bands
        ):
            raise InputError("the trees do not fit the classes and bands.")
        if self.levels.shape != (count, len(self.channels), bands) or not (
            self.point_speed.shape == self.point_pressure.shape == (count,)
        ):
            raise InputError(f"{count} healthy recordings need as many levels, speeds and pressures.")
        if not is_healthy(self.classes[0]):
            raise InputError("the first class is not the healthy one.")

    def __repr__(self) -> str:
        few = "".join(f", {count} of {label}" for label, count in self.taught.items())
        return (
            f"<PriorClassifier: {self.n_pumps} virtual pumps of {self.pump}, "
            f"{plural(len(self.specimen), 'healthy recording')}{few}>"
        )

    def fit(self, recordings: Sequence[Recording]) -> "PriorClassifier":
        """The classifier of these machines.

        Other recordings are compared with the healthy ones. The changes of these among each other teach it how far the
        machine moves without a fault, and measured faults teach it further.

        Parameters
        ----------
        recordings : healthy ones of each machine and operating point, labeled so or not at all, and measured faults
            as far as there are any (few-shot).

        Raises
        ------
        DataError
            No healthy recording, other channels, a speed or a pressure outside the prior's, a class
            that it does not know, an unfit recording, or a classifier that is adapted already.
        """
        if self.specimen:
            raise DataError(
                "this classifier is adapted already, and its forest has learned from other recordings; adapt the prior "
                "itself, with all recordings at once."
            )
        recordings = require_recordings(recordings)
        sound = [item for item in recordings if item.label is None or is_healthy(item.label)]
        faulty = [item for item in recordings if not (item.label is None or is_healthy(item.label))]
        if not sound:
            raise DataError("a pump prior needs healthy recordings of the machine, labeled normal; there is none.")
        for recording in recordings:
            self._require_fit(recording, sound[0].unit)
        unknown = sorted({str(item.label) for item in faulty} - set(self.classes))
        if unknown:
            raise DataError(f"the prior knows {', '.join(self.classes)}, and no {unknown[0]!r}; leave it out.")
        adapted = replace(
            self,
            levels=np.stack([order_levels(recording, self.bands) for recording in sound]),
            specimen=tuple(recording.specimen or "" for recording in sound),
            point_speed=np.array([2 * math.pi * shaft_frequency(recording) for recording in sound]),
            point_pressure=np.array([stated_pressure(recording) for recording in sound]),
            unit=sound[0].unit,
            manifest=join_manifests([self.manifest, manifest_of(recordings)]),
        )
        moves = adapted.healthy_changes()
        healthy_target = np.zeros(len(moves), dtype=np.int64)
        adapted = replace(adapted, forest=adapted.forest.taught(moves, healthy_target, HEALTHY_WEIGHT))
        if not faulty:
            return adapted
        changes = np.stack([adapted.change(recording)[0].ravel() for recording in faulty])
        return adapted.taught_by(changes, [str(recording.label) for recording in faulty])

    def taught_by(self, changes: Float64[np.ndarray, "recording change"], labels: Sequence[str]) -> "PriorClassifier":
        """The classifier after measured faults came to the leaves of its forest.

        Parameters
        ----------
        changes : of the levels of each recording (`change`), in one row.
        labels : class of each.
        """
        target = np.array([self.classes.index(label) for label in labels], dtype=np.int64)
        counts = {name: int((target == index).sum()) for index, name in enumerate(self.classes)}
        forest = self.forest.taught(changes, target, FEW_SHOT_WEIGHT)
        return replace(self, forest=forest, taught={name: count for name, count in counts.items() if count})

    def change(self, recording: Recording) -> tuple[Float64[np.ndarray, "channel band"], tuple[str, ...]]:
        """Change of a recording's levels [log10] against its machine's healthy ones, and notes on what was compared.

        Raises
        ------
        DataError
            It is unfit, or of a machine or operating point that has no healthy recording.
        """
        self._require_fit(recording, self.unit)
        members, notes = self._members(recording)
        return order_levels(recording, self.bands) - self.levels[members].mean(axis=0), notes

    def predict_proba(self, recordings: Sequence[Recording]) -> Float64[np.ndarray, "recording class"]:
        """Probability of each class, of each recording; raises as `change` does."""
        changes = np.stack([self.change(recording)[0] for recording in recordings])
        return self.forest.predict_proba(changes.reshape(len(changes), -1))

    def diagnose(self, recording: Recording) -> Diagnosis:
        """The class of a recording. One that cannot be used, or compared with no healthy one, has no verdict."""
        require_recording(recording)
        result = Diagnosis(recording.recording_id, "prior", facts=facts_of([recording]))
        try:
            change, notes = self.change(recording)
            seen = listed_recordings(self.manifest, {recording.recording_id: recording.content_hashes()})
        except DataError as cause:
            return replace(result, no_verdict=str(cause))
        if seen:
            notes = ("It is one of the recordings that the classifier learned from; this proves nothing.", *notes)
        probability = self.forest.predict_proba(change.reshape(1, -1))[0]
        n_members = len(self._members(recording)[0])
        return replace(
            result,
            label=self.classes[int(probability.argmax())],
            probabilities=dict(zip(self.classes, probability.tolist(), strict=True)),
            score=1 - float(probability[0]),
            basis=plural(n_members, "healthy recording") + " of the machine",
            n_basis=n_members,
            notes=notes,
        )

    def evaluate(self, X: Sequence[Recording], y: Any = None) -> AlarmScores:
        """False alarms, alarms and names of faults, on recordings that had no part in it (`evaluate_alarms`)."""
        return evaluate_alarms(self.diagnose, self.manifest, X, y, None)

    def _require_fit(self, recording: Recording, unit: str) -> None:
        """Refuse a recording that no virtual pump is like."""
        name, shaft = recording.recording_id, shaft_frequency(recording)
        if recording.channels != self.channels:
            raise DataError(
                f"{name} has the channels {', '.join(recording.channels)}, and the prior of {self.pump} those of its "
                f"pump file: {', '.join(self.channels)}. Give them in this order with --channels and --names, or make "
                "a prior of a pump file with your sensors (swashtwin twin prior)."
            )
        if unit and recording.unit != unit:
            raise DataError(f"{name} is in {recording.unit}, the healthy recordings are in {unit}; bring them to one.")
        pressure = stated_pressure(recording)
        for what, value, (low, high), scale, word in (
            ("speed", 2 * math.pi * shaft, self.speed, 30 / math.pi, "rev/min"),
            ("discharge pressure", pressure, self.pressure, 1e-6, "MPa"),
        ):
            if not (math.isnan(value) or low <= value <= high):
                raise DataError(
                    f"{name} was recorded at a {what} of {value * scale:.4g} {word}; the prior's virtual pumps run at "
                    f"{low * scale:.4g} to {high * scale:.4g} {word}. Make a prior for it with swashtwin twin prior."
                )

    def healthy_changes(self) -> Float64[np.ndarray, "change column"]:
        """Change of each healthy recording against the others of its machine and operating point, in one row each.

        A recording without another one at its discharge pressure is left out.
        """
        rows = []
        for index, levels in enumerate(self.levels):
            others = np.arange(len(self.levels)) != index
            at_pressure, at_speed = self._comparable(
                self.specimen[index], self.point_speed[index], self.point_pressure[index], others
            )
            others = at_speed if at_speed.any() else at_pressure
            if others.any():
                rows.append((levels - self.levels[others].mean(axis=0)).ravel())
        return np.stack(rows) if rows else np.empty((0, math.prod(self.levels.shape[1:])))

    def _comparable(
        self, specimen: str, speed: float, pressure: float, among: Bool[np.ndarray, " healthy"]
    ) -> tuple[Bool[np.ndarray, " healthy"], Bool[np.ndarray, " healthy"]]:
        """Healthy recordings of a machine at a discharge pressure, and those of them at a speed."""
        same = np.array([name == specimen for name in self.specimen], dtype=bool) & among
        at_pressure = same & values_match(self.point_pressure, pressure, PRESSURE_TOLERANCE)
        return at_pressure, at_pressure & values_match(self.point_speed, speed, SPEED_TOLERANCE)

    def _members(self, recording: Recording) -> tuple[Int64[np.ndarray, " healthy"], tuple[str, ...]]:
        """Indices of the healthy recordings that it is compared with, and notes."""
        specimen, pressure = recording.specimen or "", stated_pressure(recording)
        if specimen not in self.specimen:
            listed = ", ".join(sorted({name or "an unnamed machine" for name in self.specimen})) or "no machine"
            raise DataError(
                f"no healthy recording is of the machine {recording.specimen or 'without a name'} (there are those of "
                f"{listed}), so nothing can be said about this one."
            )
        speed = 2 * math.pi * shaft_frequency(recording)
        at_pressure, at_speed = self._comparable(specimen, speed, pressure, np.ones(len(self.specimen), dtype=bool))
        if not at_pressure.any():
            raise DataError(
                f"no healthy recording of {recording.specimen or 'the machine'} is at a discharge pressure of "
                f"{pressure / 1e6:.4g} MPa, so nothing can be said about this one."
            )
        if at_speed.any():
            return np.flatnonzero(at_speed), ()
        note = "Its machine has healthy recordings at another speed only; a change of speed may look like a fault."
        return np.flatnonzero(at_pressure), (note,)

    def save(self, path: Path | str) -> Path:
        """`path`, after the classifier was written to it whole."""
        arrays = {"levels": self.levels, "speed": self.point_speed, "pressure": self.point_pressure}
        names = {item.name for item in fields(self)} - {"forest", "levels", "point_speed", "point_pressure"}
        card = to_table({name: getattr(self, name) for name in sorted(names)})
        tensors = {**self.forest.tensors(), **arrays}
        return write_artifact(path, self.KIND, VERSION, card, tensors, may_be_nan=_MAY_BE_NAN)

    @classmethod
    def load(cls, path: Path | str) -> "PriorClassifier":
        """The classifier that `save` wrote, or the shipped prior of a design, such as ``"25scy14-1b"``.

        Raises
        ------
        MissingFileError
            There is no such file.
        InputError
            No prior of this design is shipped.
        ArtifactError
            The file is damaged, edited, something else, or of another version.
        """
        if not Path(path).suffix:
            path = _shipped(str(path))
        advice = "make it with swashtwin twin prior, or with swashtwin model adapt"
        card, tensors = read_artifact(path, cls.KIND, VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)
        with refuse_misfits(path, cls.KIND):
            names = {"levels": "levels", "point_speed": "speed", "point_pressure": "pressure"}
            arrays = {name: tensors[key] for name, key in names.items()}
            return from_table({**card, **arrays, "forest": vars(Forest.of_tensors(tensors))}, cls)


def _shipped(design: str) -> Path:
    """File of the prior of a design."""
    shipped = {path.stem: path for path in sorted(SHIPPED.glob("*.safetensors"))}
    if design not in shipped:
        raise InputError(
            f"no prior of the design {design} is shipped (there is {', '.join(shipped)}); make one with swashtwin twin "
            "prior --pump FILE, and give its file."
        )
    return shipped[design]


def fit_prior(
    bands: OrderBands,
    change: Float[np.ndarray, "recording channel band"],
    label: Shaped[np.ndarray, " recording"],
    *,
    pump: Pump,
    speed: tuple[float, float],
    pressure: tuple[float, float],
    n_pumps: int,
    seed: int = 0,
) -> PriorClassifier:
    """Prior trained on the changes of virtual pumps (`synthesis.simulate_changes`).

    Parameters
    ----------
    bands, change, label : as of `synthesis.OrderChanges`.
    pump : the design.
    speed, pressure : ranges that the pumps were drawn from [rad/s, Pa].
    n_pumps : how many were drawn.

    Raises
    ------
    InputError
        There are fewer than two classes, or the first is not healthy.
    """
    classes = tuple(dict.fromkeys(label.tolist()))
    if len(classes) < 2 or not is_healthy(classes[0]):
        raise InputError(
            "a prior needs two classes at least, the healthy one first; the virtual pumps show "
            f"{', '.join(classes) or 'none'}."
        )
    target = np.array([classes.index(name) for name in label.tolist()], dtype=np.int64)
    forest = fit_forest(np.asarray(change, dtype=np.float64).reshape(len(change), -1), target, len(classes), seed=seed)
    return PriorClassifier(
        pump=pump.name,
        bands=bands,
        channels=pump.channels,
        classes=classes,
        speed=speed,
        pressure=pressure,
        n_pumps=n_pumps,
        forest=forest,
        levels=np.empty((0, *change.shape[1:])),
    )
