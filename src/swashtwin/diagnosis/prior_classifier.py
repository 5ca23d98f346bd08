"""`PriorClassifier`: names faults that nobody measured, from a machine's healthy recordings and a
pump prior.

The prior is changes of virtual pumps (`synthesis.simulate_changes`): levels of lines and of the
noise floor, less those of the same pump's healthy recordings. Housing, sensors and mounting are in
both and cancel. `fit` lays them on how much the machine's own healthy recordings differ
(`prior_head`). docs/how-to/zero-shot.md says how it is used, and docs/bench/evidence.md how far it
can be trusted.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int64, Shaped

from swashtwin.diagnosis.alarm_scores import AlarmScores, evaluate_alarms
from swashtwin.diagnosis.prior_head import (
    UNKNOWN_RATE,
    PriorHead,
    VirtualChanges,
    fit_head,
    order_band_powers,
)
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
    find_exact_copies,
    join_manifests,
    specified_pressure,
    summarize_recordings,
)
from swashtwin.signals import OrderBands, require_shaft_frequency

VERSION = 2
_MAY_BE_NAN = ("levels", "speed", "pressure")
SHIPPED = Path(__file__).parent / "priors"
"""Folder of the shipped priors, one for each design."""
P = TypeVar("P")

_ANY = (0.0, 1e12)


@dataclass(frozen=True, eq=False)
class PriorClassifier:
    """Classes of recordings from their changes against healthy ones; `make_prior` or `load_model`
    makes it.

    `fit` gives the classifier of certain machines from their healthy recordings, and leaves the
    prior, which serves for all machines, as it is. It is no estimator of scikit-learn, which hands
    over arrays: these state no speed, pressure and machine.
    """

    KIND: ClassVar[str] = "prior classifier"
    """Kind of its file."""

    pump: str
    """Name of the design."""
    bands: OrderBands
    """Bands of the levels."""
    channels: tuple[str, ...]
    """Channels: of the virtual pumps, and after `fit` those of the machine among them, in its
    order.
    """
    classes: tuple[str, ...]
    """Classes, in the order of the probabilities; the first one is healthy, the last is none of the
    others.
    """
    speed: tuple[float, float]
    """Speeds of the virtual pumps [rad/s]."""
    pressure: tuple[float, float]
    """Their discharge pressures [Pa]."""
    n_pumps: int
    """Number of virtual pumps."""
    virtual: VirtualChanges | None = None
    """Changes of the virtual pumps; None after `fit`."""
    head: PriorHead | None = None
    """What maps changes to classes; None before."""
    band_powers: Float64[np.ndarray, "recording channel level"] = field(
        default_factory=lambda: np.empty((0, 0, 0))
    )
    """Levels of the healthy recordings [log10 of the squared unit], NaN beyond half the sample
    rate.
    """
    specimen: tuple[str, ...] = ()
    """Machine of each healthy recording; empty where none is stated."""
    point_speed: Float64[np.ndarray, " recording"] = field(default_factory=lambda: np.empty(0))
    """Speed of each [rad/s]."""
    point_pressure: Float64[np.ndarray, " recording"] = field(default_factory=lambda: np.empty(0))
    """Discharge pressure of each [Pa], NaN where none is stated."""
    unit: str = ""
    """Unit of the healthy recordings."""
    fault_of: Mapping[str, str] = field(default_factory=dict)
    """Class of the prior that a label of the recordings stands for."""
    taught: Mapping[str, int] = field(default_factory=dict)
    """Measured faults that it learned from: how many of each class."""
    manifest: Manifest = field(default_factory=dict)
    """Recordings that had a part in it, by id and content."""

    def __post_init__(self) -> None:
        count, width = len(self.specimen), len(self.channels) * len(self.bands.names)
        if count and self.band_powers.shape != (count, len(self.channels), len(self.bands.names)):
            raise InputError(
                f"the levels of {count} healthy recordings have the shape {self.band_powers.shape}."
            )
        if not self.point_speed.shape == self.point_pressure.shape == (count,):
            raise InputError(f"{count} healthy recordings need as many speeds and pressures.")
        if not is_healthy(self.classes[0]):
            raise InputError("the first class is not the healthy one.")
        if self.head is not None:
            self.head.require_shape(width, len(self.classes))
        if self.virtual is not None:
            self.virtual.require_shape(len(self.channels), len(self.bands.names), len(self.classes))

    def __repr__(self) -> str:
        few = "".join(f", {count} of {label}" for label, count in self.taught.items())
        return (
            f"<PriorClassifier: {self.n_pumps} virtual pumps of {self.pump}, "
            f"{plural(len(self.specimen), 'healthy recording')}{few}>"
        )

    def fit(
        self,
        recordings: Sequence[Recording],
        *,
        pistons: int | None = None,
        fault_of: Mapping[str, str] | None = None,
        seed: int = 0,
    ) -> "PriorClassifier":
        """The classifier of these machines.

        Other recordings are compared with the healthy ones. How these differ among each other is
        the unit of every change, and directions in which they differ count less; measured faults
        teach it further.

        Parameters
        ----------
        recordings : healthy ones of each machine and operating point, labeled so or not at all, and
            measured faults as far as there are any (few-shot).
        pistons : pistons of the machine where it is of another design; then only virtual pumps of
            drawings of their own teach, and no speed or pressure is refused.
        fault_of : class that a label stands for, such as ``{"Verschleiß": "piston"}``.

        Raises
        ------
        DataError
            No healthy recording, channels that the virtual pumps lack, a speed or a pressure
            outside the prior's, a class that it does not know, an unfit recording, or a classifier
            that is adapted already.
        """
        recordings = require_recordings(recordings)
        sound = [item for item in recordings if item.label is None or is_healthy(item.label)]
        faulty = [item for item in recordings if not (item.label is None or is_healthy(item.label))]
        if not sound:
            raise DataError(
                "a pump prior needs healthy recordings of the machine, labeled normal; there is none."
            )
        adapted = replace(
            self.narrowed(sound[0].channels, sound[0].unit, pistons), fault_of=dict(fault_of or {})
        )
        for recording in recordings:
            adapted._require_fit(recording, sound[0].unit)
        classes = {str(item.label): adapted.class_of(str(item.label)) for item in faulty}
        for label in (label for label, name in classes.items() if name is None):
            raise DataError(
                f"the prior knows {', '.join(self.classes[:-1])}, and no {label!r}; leave it out."
            )
        target = [str(classes[str(item.label)]) for item in faulty]
        adapted = replace(
            adapted,
            **adapted._points(sound),
            taught={name: target.count(name) for name in self.classes if name in target},
            manifest=join_manifests([self.manifest, build_manifest(recordings)]),
        )
        return adapted.fit_band_powers(
            [adapted.change(recording)[0] for recording in faulty], target, seed=seed
        )

    def narrowed(
        self, channels: tuple[str, ...], unit: str, pistons: int | None = None
    ) -> "PriorClassifier":
        """The prior of a machine's channels and, where it is of another design, of its number of
        pistons; raises as `fit` does.
        """
        if self.virtual is None:
            raise DataError(
                "this classifier is adapted already; adapt the prior itself, with all recordings at once."
            )
        if missing := [name for name in channels if name not in self.channels]:
            raise DataError(
                f"the recordings have the channels {', '.join(channels)}, and the prior of {self.pump} has no "
                f"{missing[0]} but {', '.join(self.channels)}. Name yours so, as far as you have them (--channels and "
                "--names, or channels of a [[machine]]), or make a prior of your pump file (swashtwin twin prior)."
            )
        pumps, prior = np.ones(self.n_pumps, dtype=bool), self
        if pistons is not None:
            pumps = self.virtual.drawn
            prior = replace(self, bands=OrderBands(pistons), speed=_ANY, pressure=_ANY)
        virtual = self.virtual.of(pumps, [self.channels.index(name) for name in channels])
        return replace(
            prior, virtual=virtual, channels=channels, unit=unit, n_pumps=int(pumps.sum())
        )

    def fit_band_powers(
        self,
        changes: Sequence[Float64[np.ndarray, "channel level"]] = (),
        labels: Sequence[str] = (),
        *,
        seed: int = 0,
    ) -> "PriorClassifier":
        """The classifier of the machine that the prior was `narrowed` to, whose healthy `band_powers` it
        has.

        Parameters
        ----------
        changes, labels : measured faults (`change`) and their classes.
        """
        assert self.virtual is not None
        head = fit_head(
            self.virtual.measured(np.isfinite(self.band_powers).all(axis=0)),
            self.healthy_changes(),
            self.bands,
            np.array(changes).reshape(-1, *self.band_powers.shape[1:]),
            np.array([self.classes.index(name) for name in labels], dtype=np.int64),
            seed=seed,
        )
        return replace(self, virtual=None, head=head)

    def with_healthy(self, healthy: Sequence[Recording]) -> "PriorClassifier":
        """The adapted classifier that compares with these healthy recordings of further machines
        too.

        What maps changes to classes stays: the healthy scatter is that of the machines that it was
        adapted to. It raises as `fit` does, and a `DataError` where one is labeled faulty.
        """
        for recording in healthy:
            self._require_fit(recording, self.unit)
            if not (recording.label is None or is_healthy(recording.label)):
                raise DataError(
                    f"{recording.recording_id} is labeled {recording.label} and is no healthy recording."
                )
        new = self._points(healthy)
        specimen = (*self.specimen, *new.pop("specimen"))
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), values]) for name, values in new.items()
        }
        manifest = join_manifests([self.manifest, build_manifest(healthy)])
        return replace(self, **arrays, specimen=specimen, manifest=manifest)

    def _points(self, healthy: Sequence[Recording]) -> dict[str, Any]:
        """Fields of the classifier that healthy recordings make: levels, machines, speeds,
        pressures.
        """
        band_powers = np.array([order_band_powers(item, self.bands) for item in healthy])
        return {
            "band_powers": band_powers.reshape(-1, len(self.channels), len(self.bands.names)),
            "specimen": tuple(item.specimen or "" for item in healthy),
            "point_speed": 2
            * math.pi
            * np.array([require_shaft_frequency(item) for item in healthy]),
            "point_pressure": np.array([specified_pressure(item) for item in healthy]),
        }

    def class_of(self, label: str) -> str | None:
        """Class of the prior that a recording's label stands for, if any."""
        try:
            return canonical_label(self.fault_of.get(label, label), self.classes[:-1])
        except InputError:
            return None

    def change(
        self, recording: Recording
    ) -> tuple[Float64[np.ndarray, "channel level"], tuple[str, ...]]:
        """Change of a recording's levels [log10] against its machine's healthy ones, and notes on
        what was compared.

        A `DataError` where it is unfit, or of a machine or operating point that has no healthy
        recording.
        """
        self._require_fit(recording, self.unit)
        members, notes = self._members(recording)
        change = order_band_powers(recording, self.bands) - self.band_powers[members].mean(axis=0)
        measured = np.isfinite(self.band_powers).all(axis=0)
        if np.isnan(change[measured]).any():
            raise DataError(
                f"{recording.recording_id} is sampled at a lower rate than the healthy recordings."
            )
        return np.where(measured, change, 0.0), notes

    def predict_proba(
        self, recordings: Sequence[Recording]
    ) -> Float64[np.ndarray, "recording class"]:
        """Probability of each class, of each recording; raises as `change` does."""
        return self._adapted().predict_proba(
            np.stack([self.change(recording)[0] for recording in recordings])
        )

    def diagnose(self, recording: Recording) -> Diagnosis:
        """The likeliest class of a recording, or no verdict where it cannot be compared with
        healthy ones.

        It is unknown where at most `UNKNOWN_RATE` of the prior's own recordings are as unlike its
        classes, and where only the noise floor changed. A `DataError` where the prior is of no
        machine yet.
        """
        require_recording(recording)
        head = self._adapted()
        result = Diagnosis(recording.recording_id, "prior", facts=summarize_recordings([recording]))
        try:
            change, notes = self.change(recording)
            seen = find_exact_copies(
                self.manifest, {recording.recording_id: recording.content_hashes()}
            )
        except DataError as cause:
            return replace(result, no_verdict=str(cause))
        if seen:
            notes = (
                "It is one of the recordings that the classifier learned from; this proves nothing.",
                *notes,
            )
        probability = head.predict_proba(change[None])[0]
        label = self.classes[int(probability[:-1].argmax())]
        p_value = head.p_value(float(probability[-1]))
        reasons: tuple[str, ...] = ()
        if p_value <= UNKNOWN_RATE or probability.argmax() == len(self.classes) - 1:
            reasons = (
                f"It is unlike the classes that the prior holds: {100 * p_value:.2g} % of its own recordings are as "
                f"unlike, at a rate of {100 * UNKNOWN_RATE:g} %. It resembles {label.replace('_', ' ')} most.",
            )
        elif label != self.classes[0] and not head.lines_moved(change, self.bands):
            reasons = (
                f"Only the noise floor changed, and no line, so that {label.replace('_', ' ')} would be a guess: any "
                "fault, cavitation or a neighbor may raise it.",
            )
        n_members = len(self._members(recording)[0])
        return replace(
            result,
            label=label,
            unknown=bool(reasons),
            probabilities=dict(zip(self.classes, probability.tolist(), strict=True)),
            score=1 - float(probability[0]),
            p_value=p_value,
            basis=plural(n_members, "healthy recording") + " of the machine",
            n_basis=n_members,
            reasons=reasons,
            notes=notes,
        )

    def evaluate(self, X: Sequence[Recording], y: Any = None) -> AlarmScores:
        """False alarms, alarms and names of faults, on recordings that had no part in it
        (`evaluate_alarms`).
        """
        recordings = relabel_recordings(require_recordings(X), y)
        labels = [item.label and (self.class_of(item.label) or item.label) for item in recordings]
        return evaluate_alarms(self.diagnose, self.manifest, recordings, labels, None)

    def _adapted(self) -> PriorHead:
        if self.head is None:
            raise DataError(
                "this is a prior of no machine yet; adapt it to healthy recordings (swashtwin model adapt)."
            )
        return self.head

    def _require_fit(self, recording: Recording, unit: str) -> None:
        """Refuse a recording that no virtual pump is like."""
        name = recording.recording_id
        if recording.channels != self.channels:
            raise DataError(
                f"{name} has the channels {', '.join(recording.channels)}, and the healthy recordings "
                f"{', '.join(self.channels)}; give them in this order with --channels and --names."
            )
        if unit and recording.unit != unit:
            raise DataError(
                f"{name} is in {recording.unit}, the healthy recordings are in {unit}; bring them to one."
            )
        for what, value, (low, high), scale, word in (
            (
                "speed",
                2 * math.pi * require_shaft_frequency(recording),
                self.speed,
                30 / math.pi,
                "rev/min",
            ),
            ("discharge pressure", specified_pressure(recording), self.pressure, 1e-6, "MPa"),
        ):
            if not (math.isnan(value) or low <= value <= high):
                raise DataError(
                    f"{name} was recorded at a {what} of {value * scale:.4g} {word}; the prior's virtual pumps run at "
                    f"{low * scale:.4g} to {high * scale:.4g} {word}. Of another design, state --pistons."
                )

    def healthy_changes(self) -> Float64[np.ndarray, "change channel level"]:
        """Change of each healthy recording against the others of its machine and operating point,
        times sqrt(n / (n + 1)) for n others: it then varies as a single recording does.

        A recording without another one at its discharge pressure is left out.
        """
        rows = []
        for index, band_powers in enumerate(self.band_powers):
            others = np.arange(len(self.band_powers)) != index
            point = self.specimen[index], self.point_speed[index], self.point_pressure[index]
            at_pressure, at_speed = self._comparable(*point, others)
            others = at_speed if at_speed.any() else at_pressure
            if count := int(others.sum()):
                rows.append(
                    (band_powers - self.band_powers[others].mean(axis=0))
                    * math.sqrt(count / (count + 1))
                )
        return np.array(rows).reshape(-1, *self.band_powers.shape[1:])

    def _comparable(
        self, specimen: str, speed: float, pressure: float, among: Bool[np.ndarray, " healthy"]
    ) -> tuple[Bool[np.ndarray, " healthy"], Bool[np.ndarray, " healthy"]]:
        """Healthy recordings of a machine at a discharge pressure, and those of them at a speed."""
        same = np.array([name == specimen for name in self.specimen], dtype=bool) & among
        at_pressure = same & values_match(self.point_pressure, pressure, PRESSURE_TOLERANCE)
        return at_pressure, at_pressure & values_match(self.point_speed, speed, SPEED_TOLERANCE)

    def _members(
        self, recording: Recording
    ) -> tuple[Int64[np.ndarray, " healthy"], tuple[str, ...]]:
        """Indices of the healthy recordings that it is compared with, and notes."""
        specimen, pressure = recording.specimen or "", specified_pressure(recording)
        notes: tuple[str, ...] = ()
        if not specimen and len(set(self.specimen)) == 1 and self.specimen[0]:
            specimen = self.specimen[0]
            notes = (
                f"It names no machine; {specimen}, the only one with healthy recordings, was assumed.",
            )
        if specimen not in self.specimen:
            listed = (
                ", ".join(sorted({name or "an unnamed machine" for name in self.specimen}))
                or "no machine"
            )
            raise DataError(
                f"no healthy recording is of the machine {recording.specimen or 'without a name'} (there are those of "
                f"{listed}), so nothing can be said about this one; name its machine in an index."
            )
        speed = 2 * math.pi * require_shaft_frequency(recording)
        at_pressure, at_speed = self._comparable(
            specimen, speed, pressure, np.ones(len(self.specimen), dtype=bool)
        )
        if not at_pressure.any():
            raise DataError(
                f"no healthy recording of {recording.specimen or 'the machine'} is at a discharge pressure of "
                f"{pressure / 1e6:.4g} MPa, so nothing can be said about this one."
            )
        if at_speed.any():
            return np.flatnonzero(at_speed), notes
        note = "Its machine has healthy recordings at another speed only; a change of speed may look like a fault."
        return np.flatnonzero(at_pressure), (*notes, note)

    def save(self, path: Path | str) -> Path:
        """`path`, after the classifier was written to it whole."""
        return save_prior(self, path, self.KIND)

    @classmethod
    def load(cls, path: Path | str) -> "PriorClassifier":
        """The classifier that `save` wrote, or the shipped prior of a design. Errors:
        `load_model`.
        """
        return load_prior(path, cls, cls.KIND)


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
    """Prior of the changes of virtual pumps (`synthesis.simulate_changes`).

    Parameters
    ----------
    change, label, number, scatter, drawn : as of `synthesis.OrderChanges`, the healthy class first
        and the one of what is none of the faults last; an `InputError` where there are fewer than
        three.
    speed, pressure : ranges of the design's operating points [rad/s, Pa].
    """
    classes = tuple(dict.fromkeys(label.tolist()))
    if len(classes) < 3 or not is_healthy(classes[0]):
        raise InputError(
            "a prior needs three classes at least, the healthy one first and that of unknown faults last; the virtual "
            f"pumps show {', '.join(classes) or 'none'}."
        )
    target = np.array([classes.index(name) for name in label.tolist()], dtype=np.int8)
    change, scatter = change.astype(np.float16), scatter.astype(np.float16)
    return PriorClassifier(
        pump=pump.name,
        bands=OrderBands(pump.rotating_group.piston_count),
        channels=pump.channels,
        classes=classes,
        speed=speed,
        pressure=pressure,
        n_pumps=len(drawn),
        virtual=VirtualChanges(change, target, number.astype(np.int32), scatter, drawn),
    )


def save_prior(prior: Any, path: Path | str, kind: str) -> Path:
    """`path`, after a `PriorClassifier` was written to it whole."""
    arrays = {
        "levels": prior.band_powers,
        "speed": prior.point_speed,
        "pressure": prior.point_pressure,
    }
    parts = {"virtual": prior.virtual, "head": prior.head}
    names = {item.name for item in fields(prior)} - {
        "band_powers",
        "point_speed",
        "point_pressure",
        *parts,
    }
    card = to_table({name: getattr(prior, name) for name in sorted(names)})
    for part, values in parts.items():
        arrays |= (
            {f"{part}_{name}": value for name, value in vars(values).items()}
            if values is not None
            else {}
        )
    return write_artifact(path, kind, VERSION, card, arrays, may_be_nan=_MAY_BE_NAN)


def load_prior(path: Path | str, form: type[P], kind: str) -> P:
    """What `save_prior` wrote, or the shipped prior of a design; errors: `PriorClassifier.load`."""
    if not Path(path).suffix:
        shipped = {file.stem: file for file in sorted(SHIPPED.glob("*.safetensors"))}
        if str(path) not in shipped:
            if Path(path).exists():
                raise InputError(
                    f"{path} is no model or prior; name the file that swashtwin train or twin prior wrote."
                )
            raise InputError(
                f"no prior of the design {path} is shipped (there is {', '.join(shipped)}); make one with swashtwin "
                "twin prior --pump FILE, and give its file."
            )
        path = shipped[str(path)]
    advice = "make it with swashtwin twin prior, or with swashtwin model adapt"
    card, tensors = read_artifact(path, kind, VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)
    with translate_load_errors(path, kind):
        band_powers, speed, pressure = (tensors[name] for name in ("levels", "speed", "pressure"))
        arrays: dict[str, Any] = {
            "band_powers": band_powers,
            "point_speed": speed,
            "point_pressure": pressure,
        }
        for part in ("virtual", "head"):
            own = {
                name.removeprefix(f"{part}_"): tensors[name]
                for name in tensors
                if name.startswith(f"{part}_")
            }
            arrays |= {part: own} if own else {}
        return from_table({**card, **arrays}, form)
