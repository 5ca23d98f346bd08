"""`PriorClassifier`: recognizes faults that nobody measured, by a prior of virtual pumps.

The prior holds changes of virtual pumps (`synthesis.simulate_changes`): powers of lines and of the
noise floor, less those of the same pump's healthy recordings. Housing, sensors and mounting are in
both and cancel. `fit` relates them to how much the machine's own healthy recordings differ
(`prior_head`). docs/how-to/zero-shot.md describes the use, and docs/bench/evidence.md the accuracy.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int64, Shaped

from swashtwin.diagnosis.alarm_scores import AlarmScores, evaluate_alarms
from swashtwin.diagnosis.changed_sensors import HealthyComparison, describe_mismatch
from swashtwin.diagnosis.fault_separation import describe_separation
from swashtwin.diagnosis.prior_head import (
    FEW_SHOT_WEIGHT,
    MIN_LINE_CHANGE,
    UNKNOWN_RATE,
    MeasuredChanges,
    PriorHead,
    VirtualChanges,
    compute_order_spectrum,
    fit_head,
    join_measured,
    machine_scatter,
    order_band_powers,
)
from swashtwin.diagnosis.progress import Progress, ignore_progress, iterate
from swashtwin.diagnosis.recording_arguments import (
    relabel_recordings,
    require_recording,
    require_recordings,
)
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import (
    DataError,
    InputError,
    from_table,
    plural,
    read_artifact,
    spell_in_words,
    to_table,
    translate_load_errors,
    write_artifact,
)
from swashtwin.pump import (
    PRESSURE_TOLERANCE,
    SPEED_TOLERANCE,
    Pump,
    canonical_label,
    is_healthy,
    values_match,
)
from swashtwin.recordings import (
    Manifest,
    Recording,
    build_manifest,
    describe_sensor_doubts,
    find_exact_copies,
    join_manifests,
    join_names,
    specified_pressure,
    summarize_recordings,
)
from swashtwin.signals import OrderBands, require_shaft_frequency

SHIPPED = Path(__file__).parent / "priors"
"""Folder of the shipped priors, one for each design."""
_VERSION = 2
_MAY_BE_NAN = ("levels", "speed", "pressure")

LOOKALIKES = {
    "piston": (
        "A scratched sealing land of the cylinder block leaks from one chamber as a worn piston "
        "does, and changes the same lines: check both."
    )
}
"""By class of a prior, a fault of another part that no line distinguishes from it."""

# Field of each array of a file of version 2.
_ARRAY_FIELDS = {"levels": "band_powers", "speed": "point_speed", "pressure": "point_pressure"}

# Fields that are dataclasses of arrays; their arrays stand in a file as `virtual_change`.
_PARTS = ("virtual", "head")

# Range of speed or pressure of a prior for another design.
_ANY_VALUE = (0.0, 1e12)

_RAD_S_TO_RPM = 30 / math.pi
_PA_TO_MPA = 1e-6


@dataclass(frozen=True, eq=False)
class PriorClassifier:
    """Classifier of recordings by their changes against healthy ones.

    `make_prior` and `load_model` return one. `fit` returns the classifier of certain machines from
    their healthy recordings, and leaves the prior, which serves for all machines, unchanged. It is
    not an estimator of scikit-learn, whose arrays specify no speed, pressure and machine.
    """

    KIND: ClassVar[str] = "prior classifier"
    """Kind of its file."""

    pump: str
    """Name of the design."""
    bands: OrderBands
    """Bands of the changes."""
    channels: tuple[str, ...]
    """Channels of the virtual pumps; after `fit` those of the machine, in its order."""
    classes: tuple[str, ...]
    """Classes, in the order of the probabilities; the first is healthy, the last is any other
    fault."""
    speed: tuple[float, float]
    """Range of the speeds of the virtual pumps [rad/s]."""
    pressure: tuple[float, float]
    """Range of their discharge pressures [Pa]."""
    n_pumps: int
    """Number of virtual pumps."""
    virtual: VirtualChanges | None = None
    """Changes of the virtual pumps; None after `fit`."""
    head: PriorHead | None = None
    """Network from changes to classes; None before `fit`."""
    band_powers: Float64[np.ndarray, "recording channel level"] = field(
        default_factory=lambda: np.empty((0, 0, 0))
    )
    """Band powers of the healthy recordings [log10 of the squared unit]; NaN beyond half the sample
    rate."""
    specimen: tuple[str, ...] = ()
    """Machine of each healthy recording; empty if not specified."""
    point_speed: Float64[np.ndarray, " recording"] = field(default_factory=lambda: np.empty(0))
    """Speed of each healthy recording [rad/s]."""
    point_pressure: Float64[np.ndarray, " recording"] = field(default_factory=lambda: np.empty(0))
    """Discharge pressure of each healthy recording [Pa]; NaN if not specified."""
    unit: str = ""
    """Unit of the healthy recordings."""
    fault_of: Mapping[str, str] = field(default_factory=dict)
    """Class of the prior that a label of the recordings stands for."""
    taught: Mapping[str, int] = field(default_factory=dict)
    """Number of measured faults of each class of the machines themselves that it was trained on;
    those of a library only stand in `manifest`."""
    manifest: Manifest = field(default_factory=dict)
    """Recordings that had a part in it, by id and content."""

    def __post_init__(self) -> None:
        n_recordings = len(self.specimen)
        n_channels = len(self.channels)
        n_bands = len(self.bands.names)

        if n_recordings and self.band_powers.shape != (n_recordings, n_channels, n_bands):
            raise InputError(
                f"the band powers of {n_recordings} healthy recordings have the shape "
                f"{self.band_powers.shape}."
            )
        if not self.point_speed.shape == self.point_pressure.shape == (n_recordings,):
            raise InputError(
                f"{n_recordings} healthy recordings need as many speeds and pressures."
            )
        if not is_healthy(self.classes[0]):
            raise InputError("the first class is not the healthy one.")
        if self.head is not None:
            self.head.require_shape(n_channels * n_bands, len(self.classes))
        if self.virtual is not None:
            self.virtual.require_shape(n_channels, n_bands, len(self.classes))

    def __repr__(self) -> str:
        faults = "".join(f", {count} of {label}" for label, count in self.taught.items())
        return (
            f"<PriorClassifier: {self.n_pumps} virtual pumps of {self.pump}, "
            f"{plural(len(self.specimen), 'healthy recording')}{faults}>"
        )

    def fit(
        self,
        recordings: Sequence[Recording],
        *,
        pistons: int | None = None,
        fault_of: Mapping[str, str] | None = None,
        seed: int = 0,
        progress: Progress = ignore_progress,
    ) -> "PriorClassifier":
        """Adapt the prior to machines and return their classifier.

        Other recordings are compared with the healthy ones. The scatter of the healthy ones is the
        unit of every change, and directions in which they differ count less. Measured faults are
        further training examples.

        Parameters
        ----------
        recordings : healthy ones of each machine and operating point, labeled as healthy or not
            labeled, and measured faults if there are any (few-shot).
        pistons : piston count of a machine of another design. Then only virtual pumps that were
            drawn at random are used, and any speed and pressure is accepted.
        fault_of : class that a label stands for, such as ``{"Verschleiß": "piston"}``.
        progress : reports the read recordings, and then the measured ones.

        Raises
        ------
        DataError
            There is no healthy recording, the virtual pumps lack a channel, a speed or a pressure
            lies outside the prior's range, the prior does not know a class, a fault was recorded
            at another speed than the healthy recordings, a recording cannot be used, or the
            classifier is adapted already.
        """
        prior, changes, fault_classes = self.compare_with(recordings, pistons, fault_of, progress)
        return prior.fit_band_powers(changes, fault_classes, seed=seed)

    def compare_with(
        self,
        recordings: Sequence[Recording],
        pistons: int | None = None,
        fault_of: Mapping[str, str] | None = None,
        progress: Progress = ignore_progress,
    ) -> "tuple[PriorClassifier, list[Float64[np.ndarray, 'channel level']], list[str]]":
        """Return the prior with a machine's healthy recordings, and its changes by faults.

        The prior is not trained for the machine yet (`fit_band_powers`). The changes are those of
        measured faults, if there are any, with the class of each.

        Parameters and errors: see `fit`.
        """
        recordings = require_recordings(recordings)
        healthy = [recording for recording in recordings if not _is_faulty(recording)]
        faulty = [recording for recording in recordings if _is_faulty(recording)]
        if not healthy:
            raise DataError(
                "A pump prior needs healthy recordings of the machine, labeled normal; there are "
                "none."
            )

        first = healthy[0]
        prior = self.for_machine(first.channels, first.unit, pistons)
        prior = replace(prior, fault_of=dict(fault_of or {}))
        for recording in recordings:
            prior._require_comparable(recording, first.unit)

        fault_classes = []
        for recording in faulty:
            fault_class = prior.class_of(str(recording.label))
            if fault_class is None:
                raise DataError(
                    f"The prior does not know the class {recording.label!r}; leave it out. It "
                    f"knows {', '.join(self.classes[:-1])}."
                )
            fault_classes.append(fault_class)

        manifest = build_manifest(iterate(recordings, progress, "reading"))
        adapted = replace(
            prior,
            **prior._reference_fields(healthy, progress),
            taught={
                name: fault_classes.count(name) for name in self.classes if name in fault_classes
            },
            manifest=join_manifests([self.manifest, manifest]),
        )
        return adapted, adapted.fault_changes(faulty, progress), fault_classes

    def for_machine(
        self, channels: tuple[str, ...], unit: str, pistons: int | None = None
    ) -> "PriorClassifier":
        """Return the prior for a machine's channels and, of another design, its piston count.

        Errors: see `fit`.
        """
        if self.virtual is None:
            raise DataError(
                "This classifier is adapted already; adapt the prior itself, with all recordings "
                "at once."
            )
        missing_channels = [name for name in channels if name not in self.channels]
        if missing_channels:
            raise DataError(
                f"The recordings have the channels {', '.join(channels)}, but the prior of "
                f"{self.pump} has no channel {missing_channels[0]}, only "
                f"{', '.join(self.channels)}.",
                field="names",
                remedy=(
                    "Name your channels like those with {channels} and {names}, or make a prior of "
                    "your pump file (swashtwin twin prior)."
                ),
            )

        prior = self
        pumps = np.ones(self.n_pumps, dtype=bool)
        if pistons is not None:
            pumps = self.virtual.drawn
            prior = replace(self, bands=OrderBands(pistons), speed=_ANY_VALUE, pressure=_ANY_VALUE)
        columns = [self.channels.index(name) for name in channels]
        return replace(
            prior,
            virtual=self.virtual.subset(pumps, columns),
            channels=channels,
            unit=unit,
            n_pumps=int(pumps.sum()),
        )

    def fit_band_powers(
        self,
        changes: Sequence[Float64[np.ndarray, "channel level"]] = (),
        labels: Sequence[str] = (),
        *,
        library: MeasuredChanges | None = None,
        seed: int = 0,
    ) -> "PriorClassifier":
        """Return the classifier of a machine, whose healthy `band_powers` the prior holds.

        Parameters
        ----------
        changes, labels : measured faults (`change`) and their classes.
        library : changes of other machines (`weigh_library`).
        """
        assert self.virtual is not None
        is_measured = np.isfinite(self.band_powers).all(axis=0)
        virtual = self.virtual.keep_measured(is_measured)
        healthy = self.healthy_changes()
        scatter = machine_scatter(virtual, healthy)
        measured = MeasuredChanges(
            change=np.array(changes).reshape(-1, *self.band_powers.shape[1:]),
            target=np.array([self.classes.index(name) for name in labels], dtype=np.int64),
            scatter=np.tile(scatter, (len(labels), 1)),
            weight=np.full(len(labels), FEW_SHOT_WEIGHT),
        )
        if library is not None:
            measured = join_measured([measured, library])
        head = fit_head(virtual, healthy, self.bands, measured, seed=seed)
        return replace(self, virtual=None, head=head)

    def with_healthy(self, healthy: Sequence[Recording]) -> "PriorClassifier":
        """Return the classifier that also compares with healthy recordings of further machines.

        The network stays: the healthy scatter is that of the machines that it was adapted to.

        Raises
        ------
        DataError
            As `fit` does, or a recording is labeled faulty.
        """
        for recording in healthy:
            self._require_comparable(recording, self.unit)
            if _is_faulty(recording):
                raise DataError(
                    f"{recording.recording_id} is labeled {recording.label} and is not healthy."
                )

        new_fields = self._reference_fields(healthy)
        specimen = (*self.specimen, *new_fields.pop("specimen"))
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), values])
            for name, values in new_fields.items()
        }
        manifest = join_manifests([self.manifest, build_manifest(healthy)])
        return replace(self, **arrays, specimen=specimen, manifest=manifest)

    def _reference_fields(
        self, healthy: Sequence[Recording], progress: Progress = ignore_progress
    ) -> dict[str, Any]:
        """Return the fields that healthy recordings give: band powers, machines, conditions."""
        reported = iterate(healthy, progress, "measuring healthy band powers")
        band_powers = np.array([order_band_powers(recording, self.bands) for recording in reported])
        shaft_frequencies = np.array([require_shaft_frequency(recording) for recording in healthy])
        return {
            "band_powers": band_powers.reshape(-1, len(self.channels), len(self.bands.names)),
            "specimen": tuple(recording.specimen or "" for recording in healthy),
            "point_speed": 2 * math.pi * shaft_frequencies,
            "point_pressure": np.array([specified_pressure(recording) for recording in healthy]),
        }

    def class_of(self, label: str) -> str | None:
        """Return the class of the prior for which a recording's label stands, or None."""
        try:
            return canonical_label(self.fault_of.get(label, label), self.classes[:-1])
        except InputError:
            return None

    def change(
        self, recording: Recording
    ) -> tuple[Float64[np.ndarray, "channel level"], tuple[str, ...]]:
        """Return the change of band powers [log10] against a machine's healthy ones, and notes.

        Raises
        ------
        DataError
            The recording cannot be used, or its machine or operating point has no healthy
            recording.
        """
        comparison, notes = self._compare(recording)
        return comparison.change, notes

    def fault_changes(
        self, recordings: Sequence[Recording], progress: Progress = ignore_progress
    ) -> list[Float64[np.ndarray, "channel level"]]:
        """Return the change of each recording of a fault, as an example to learn from.

        Raises
        ------
        DataError
            As `change` does, or there are healthy recordings at the pressure of a fault, but at
            another speed: the change of speed would be learned as the fault.
        """
        self._require_same_speed(recordings)
        reported = iterate(recordings, progress, "measuring band powers of faults")
        return [self.change(recording)[0] for recording in reported]

    def _require_same_speed(self, recordings: Sequence[Recording]) -> None:
        """Raise a `DataError` if recordings can only be compared with ones at another speed."""
        speeds = []
        for recording in recordings:
            references, _ = self._find_references(recording)
            speed = 2 * math.pi * require_shaft_frequency(recording)
            healthy_speed = self.point_speed[references]
            if not values_match(healthy_speed, speed, SPEED_TOLERANCE).any():
                speeds.append((recording.recording_id, speed, float(np.median(healthy_speed))))
        if not speeds:
            return

        names = [name for name, _, _ in speeds]
        first_name, speed, healthy_speed = speeds[0]
        ran = "recording of a fault ran" if len(speeds) == 1 else "recordings of faults ran"
        raise DataError(
            f"{len(speeds)} {ran} at another speed than the healthy recordings of the machine at "
            f"this pressure ({first_name}: {speed * _RAD_S_TO_RPM:.4g} rev/min, healthy: "
            f"{healthy_speed * _RAD_S_TO_RPM:.4g} rev/min), so the change of speed would be "
            f"learned as the fault: {join_names(names)}. Record healthy ones at this speed, or "
            "leave these recordings out."
        )

    def _compare(self, recording: Recording) -> tuple[HealthyComparison, tuple[str, ...]]:
        """Return the comparison with healthy recordings, and notes. Errors: see `change`."""
        self._require_comparable(recording, self.unit)
        references, notes = self._find_references(recording)
        healthy_mean = self.band_powers[references].mean(axis=0)

        spectrum = compute_order_spectrum(recording, self.bands)
        change = spectrum.band_powers(spectrum.refine_speed()) - healthy_mean
        is_measured = np.isfinite(self.band_powers).all(axis=0)
        if np.isnan(change[is_measured]).any():
            raise DataError(
                f"{recording.recording_id} is sampled at a lower rate than the healthy recordings."
            )
        comparison = HealthyComparison(
            change=np.where(is_measured, change, 0.0),
            spectrum=spectrum,
            healthy_mean=healthy_mean,
            n_references=references.size,
        )
        return comparison, notes

    def predict_proba(
        self, recordings: Sequence[Recording]
    ) -> Float64[np.ndarray, "recording class"]:
        """Return the probability of each class for each recording. Errors: see `change`."""
        head = self._require_adapted()
        changes = np.stack([self.change(recording)[0] for recording in recordings])
        return head.predict_proba(changes)

    def diagnose(self, recording: Recording) -> Diagnosis:
        """Return the likeliest class of a recording; no verdict if it cannot be compared.

        It is unknown if at most `UNKNOWN_RATE` of the virtual recordings fit the classes as badly,
        if its lines changed little, or if a sensor changed since the healthy recordings.

        Raises
        ------
        DataError
            The prior is not adapted to a machine yet.
        """
        require_recording(recording)
        head = self._require_adapted()
        diagnosis = Diagnosis(
            recording.recording_id, "prior", facts=summarize_recordings([recording])
        )
        try:
            with recording.loaded():
                comparison, notes = self._compare(recording)
                notes = (*notes, *describe_sensor_doubts(recording))
                content = recording.content_hashes()
        except DataError as cause:
            return replace(diagnosis, no_verdict=cause.describe(spell_in_words))
        if find_exact_copies(self.manifest, {recording.recording_id: content}):
            note = (
                "The classifier was trained with this very recording, so the answer proves nothing."
            )
            notes = (note, *notes)

        probability = head.predict_proba(comparison.change[None])[0]
        label = self.classes[int(probability[:-1].argmax())]
        reasons = self._describe_doubts(recording, comparison, probability)
        notes = (*reasons[1:], *notes)
        if label in LOOKALIKES and not reasons:
            notes = (LOOKALIKES[label], *notes)

        diagnosis = replace(
            diagnosis,
            label=label,
            unknown=bool(reasons),
            probabilities=dict(zip(self.classes, probability.tolist(), strict=True)),
            score=1 - float(probability[0]),
            p_value=head.p_value(float(probability[-1])),
            basis=plural(comparison.n_references, "healthy recording") + " of the machine",
            n_basis=comparison.n_references,
            reasons=reasons,
            notes=notes,
        )
        separation = describe_separation(diagnosis.candidates, self.channels)
        if diagnosis.unknown or not separation:
            return diagnosis
        return replace(diagnosis, separation=separation, notes=(separation, *notes))

    def _describe_doubts(
        self,
        recording: Recording,
        comparison: HealthyComparison,
        probability: Float64[np.ndarray, " class"],
    ) -> tuple[str, ...]:
        """Return why a recording is unknown; nothing if it is not."""
        head = self._require_adapted()
        mismatch = describe_mismatch(
            comparison,
            head.scale.reshape(comparison.change.shape),
            self.channels,
            60 * require_shaft_frequency(recording),
        )
        if mismatch:
            return mismatch

        label = self.classes[int(probability[:-1].argmax())]
        label_text = label.replace("_", " ")
        p_value = head.p_value(float(probability[-1]))
        if p_value <= UNKNOWN_RATE or probability.argmax() == len(self.classes) - 1:
            return (
                f"The recording fits the prior's classes worse than {100 * (1 - p_value):.3g} % of "
                f"the virtual recordings do (unknown from {100 * (1 - UNKNOWN_RATE):g} %). It "
                f"resembles {label_text} most.",
            )

        line_change = head.line_change(comparison.change, self.bands)
        if label != self.classes[0] and line_change <= MIN_LINE_CHANGE:
            return (
                f"The lines changed by {line_change:.2g} healthy standard deviations on average "
                f"({MIN_LINE_CHANGE:g} are needed to name a fault), so {label_text} would be a "
                "guess: any fault, cavitation or a neighboring machine may change the rest.",
            )
        return ()

    def evaluate(
        self, X: Sequence[Recording], y: Any = None, progress: Progress = ignore_progress
    ) -> AlarmScores:
        """Return false alarms, alarms and recognized faults on recordings not used in training.

        Parameters and errors: see `evaluate_alarms`.
        """
        recordings = relabel_recordings(require_recordings(X), y)
        labels = [
            recording.label and (self.class_of(recording.label) or recording.label)
            for recording in recordings
        ]
        return evaluate_alarms(self.diagnose, self.manifest, recordings, labels, None, progress)

    def _require_adapted(self) -> PriorHead:
        if self.head is None:
            raise DataError(
                "This prior is not adapted to a machine yet; adapt it to healthy recordings "
                "(swashtwin model adapt)."
            )
        return self.head

    def _require_comparable(self, recording: Recording, unit: str) -> None:
        """Raise a `DataError` if a recording differs from every virtual pump in its conditions."""
        name = recording.recording_id
        missing = [channel for channel in self.channels if channel not in recording.channels]
        if missing and len(recording.channels) < len(self.channels):
            raise DataError(
                f"{name} lacks {plural(len(self.channels) - len(recording.channels), 'channel')} "
                f"of the healthy recordings; not among its channels: {', '.join(missing)}.",
                field="channels",
                remedy="Read all channels of the file, or record the missing ones too.",
            )
        if recording.channels != self.channels:
            raise DataError(
                f"{name} has the channels {', '.join(recording.channels)}, the healthy recordings "
                f"have {', '.join(self.channels)}.",
                field="channels",
                remedy="Give them in this order with {channels} and {names}.",
            )
        if unit and recording.unit != unit:
            raise DataError(
                f"{name} is in {recording.unit}, the healthy recordings are in {unit}; convert "
                "them to one unit."
            )

        speed = 2 * math.pi * require_shaft_frequency(recording)
        _require_within(name, "speed", speed, self.speed, _RAD_S_TO_RPM, "rev/min")
        pressure = specified_pressure(recording)
        _require_within(name, "discharge pressure", pressure, self.pressure, _PA_TO_MPA, "MPa")

    def healthy_changes(self) -> Float64[np.ndarray, "change channel level"]:
        """Return the change of each healthy recording against the others of its operating point.

        It is scaled by sqrt(n / (n + 1)) for n others: then it varies as a single recording does. A
        recording without another one of its machine at its discharge pressure is left out.
        """
        changes = []
        for index, band_powers in enumerate(self.band_powers):
            is_other = np.arange(len(self.band_powers)) != index
            at_pressure, at_speed = self._match_references(
                self.specimen[index], self.point_speed[index], self.point_pressure[index]
            )
            references = at_speed & is_other
            if not references.any():
                references = at_pressure & is_other

            n = int(references.sum())
            if n:
                change = band_powers - self.band_powers[references].mean(axis=0)
                changes.append(change * math.sqrt(n / (n + 1)))
        return np.array(changes).reshape(-1, *self.band_powers.shape[1:])

    def _match_references(
        self, specimen: str, speed: float, pressure: float
    ) -> tuple[Bool[np.ndarray, " healthy"], Bool[np.ndarray, " healthy"]]:
        """Return the healthy recordings of a machine at a pressure, and those also at a speed."""
        of_machine = np.array([name == specimen for name in self.specimen], dtype=bool)
        at_pressure = of_machine & values_match(self.point_pressure, pressure, PRESSURE_TOLERANCE)
        at_speed = at_pressure & values_match(self.point_speed, speed, SPEED_TOLERANCE)
        return at_pressure, at_speed

    def _find_references(
        self, recording: Recording
    ) -> tuple[Int64[np.ndarray, " healthy"], tuple[str, ...]]:
        """Return the indices of the healthy recordings to compare with, and notes."""
        specimen = recording.specimen or ""
        notes: tuple[str, ...] = ()
        if not specimen and len(set(self.specimen)) == 1 and self.specimen[0]:
            specimen = self.specimen[0]
            note = (
                f"The recording does not specify its machine; {specimen}, the only one with "
                "healthy recordings, was assumed."
            )
            notes = (note,)
        if specimen not in self.specimen:
            machines = sorted({name or "an unnamed machine" for name in self.specimen})
            of_machine = f"of the machine {specimen}" if specimen else "without a machine"
            raise DataError(
                f"No healthy recording is {of_machine}, only of {', '.join(machines)}.",
                remedy="Specify the machine (specimen) of the recording, in the index or for the "
                "file.",
            )

        pressure = specified_pressure(recording)
        speed = 2 * math.pi * require_shaft_frequency(recording)
        at_pressure, at_speed = self._match_references(specimen, speed, pressure)
        if not at_pressure.any() and math.isnan(pressure):
            raise DataError(
                f"{recording.recording_id} specifies no discharge pressure, which the comparison "
                "with healthy recordings requires.",
                field="pressure",
                remedy="Set {pressure='15 MPa'}.",
            )
        if not at_pressure.any():
            raise DataError(
                f"No healthy recording of {recording.specimen or 'the machine'} is at a discharge "
                f"pressure of {pressure * _PA_TO_MPA:.4g} MPa; record one to compare with."
            )
        if at_speed.any():
            return np.flatnonzero(at_speed), notes
        note = (
            "The machine's healthy recordings are at another speed; a change of speed may look "
            "like a fault."
        )
        return np.flatnonzero(at_pressure), (*notes, note)

    def save(self, path: Path | str) -> Path:
        """Write the classifier to `path` as a complete file and return the path."""
        arrays = {name: getattr(self, field) for name, field in _ARRAY_FIELDS.items()}
        for part in _PARTS:
            values = getattr(self, part)
            if values is not None:
                arrays.update({f"{part}_{name}": array for name, array in vars(values).items()})

        array_fields = (*_ARRAY_FIELDS.values(), *_PARTS)
        names = sorted(field.name for field in fields(self) if field.name not in array_fields)
        card = to_table({name: getattr(self, name) for name in names})
        return write_artifact(path, self.KIND, _VERSION, card, arrays, may_be_nan=_MAY_BE_NAN)

    @classmethod
    def load(cls, path: Path | str) -> "PriorClassifier":
        """Return the classifier that `save` wrote, or the shipped prior of a design.

        Errors: see `load_model`.
        """
        if not Path(path).suffix:
            path = _shipped_path(path)
        advice = "make it with swashtwin twin prior, or with swashtwin model adapt"
        card, arrays = read_artifact(
            path, cls.KIND, _VERSION, advice=advice, may_be_nan=_MAY_BE_NAN
        )

        with translate_load_errors(path, cls.KIND, advice):
            table: dict[str, Any] = dict(card)
            part_arrays: dict[str, dict[str, np.ndarray]] = {}
            for name, array in arrays.items():
                part, _, part_name = name.partition("_")
                if name in _ARRAY_FIELDS:
                    table[_ARRAY_FIELDS[name]] = array
                elif part in _PARTS:
                    part_arrays.setdefault(part, {})[part_name] = array
                else:
                    raise InputError(f"the array {name!r} is unknown")
            for name, field_name in _ARRAY_FIELDS.items():
                if field_name not in table:
                    raise InputError(f"the array {name!r} is missing")
            parts = {part: part_arrays.get(part) for part in _PARTS}
            return from_table({**table, **parts}, cls, complete=True)


def _is_faulty(recording: Recording) -> bool:
    return recording.label is not None and not is_healthy(recording.label)


def _require_within(
    name: str, quantity: str, value: float, limits: tuple[float, float], scale: float, unit: str
) -> None:
    """Raise a `DataError` if a quantity of a recording lies outside the prior's range."""
    low, high = limits
    if math.isnan(value) or low <= value <= high:
        return
    raise DataError(
        f"{name} was recorded at a {quantity} of {value * scale:.4g} {unit}; the prior's virtual "
        f"pumps run at {low * scale:.4g} to {high * scale:.4g} {unit}.",
        field="pistons",
        remedy="If the pump is of another design, specify {pistons}.",
    )


def _shipped_path(design: Path | str) -> Path:
    shipped = {file.stem: file for file in sorted(SHIPPED.glob("*.safetensors"))}
    if str(design) in shipped:
        return shipped[str(design)]
    if Path(design).exists():
        raise InputError(
            f"{design} is not a model or prior; give the file that swashtwin train or twin prior "
            "wrote."
        )
    raise InputError(
        f"No prior of the design {design} is shipped (available: {', '.join(shipped)}). Make one "
        "of your pump file with swashtwin twin prior, and give its file."
    )


def make_prior(
    change: Float[np.ndarray, "recording channel level"],
    label: Shaped[np.ndarray, " recording"],
    number: Int[np.ndarray, " recording"],
    scatter: Float[np.ndarray, "pump channel level"],
    drawn: Bool[np.ndarray, " pump"],
    *,
    pump: Pump,
    speed: tuple[float, float],
    pressure: tuple[float, float],
) -> PriorClassifier:
    """Return the prior of the changes of virtual pumps (`synthesis.simulate_changes`).

    Parameters
    ----------
    change, label, number, scatter, drawn : as in `synthesis.OrderChanges`; the healthy class comes
        first, and the class of any other fault last.
    pump : the design.
    speed, pressure : ranges of the design's operating points [rad/s, Pa].

    Raises
    ------
    InputError
        There are fewer than three classes, or the first is not healthy.
    """
    classes = tuple(dict.fromkeys(label.tolist()))
    if len(classes) < 3 or not is_healthy(classes[0]):
        raise InputError(
            "A prior needs at least three classes, the healthy one first and that of unknown "
            f"faults last; the virtual pumps show {', '.join(classes) or 'none'}."
        )
    target = np.array([classes.index(name) for name in label.tolist()], dtype=np.int8)

    # Half precision keeps a shipped prior below 8 MB.
    virtual = VirtualChanges(
        change=change.astype(np.float16),
        target=target,
        number=number.astype(np.int32),
        scatter=scatter.astype(np.float16),
        drawn=drawn,
    )
    return PriorClassifier(
        pump=pump.name,
        bands=OrderBands(pump.rotating_group.piston_count),
        channels=pump.channels,
        classes=classes,
        speed=speed,
        pressure=pressure,
        n_pumps=len(drawn),
        virtual=virtual,
    )
