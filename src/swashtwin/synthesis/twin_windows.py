"""Windows made with a twin.

A synthetic window is the twin's steady acceleration, with everything drawn anew that varies from
one moment to the next, laid over noise as the machine makes it. It carries ``synthetic=True``,
which `evaluate` refuses.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Shaped

from swashtwin.calibration import Calibration, FaultLaw, Posterior
from swashtwin.foundation import InputError, derive_seed, random_stream
from swashtwin.learning import TWIN_OF, WindowSet, cut_windows
from swashtwin.physics import Twin, accelerations
from swashtwin.pump import (
    PRESSURE_TOLERANCE,
    Fault,
    OperatingCondition,
    is_healthy,
    is_same_class,
    values_match,
)
from swashtwin.recordings import Recording, default_window, find_copies, join_manifests
from swashtwin.signals import synchronous_signal
from swashtwin.synthesis.background import (
    DEFAULT_VARIATION,
    BackgroundNoise,
    Variation,
    background_noise,
    draw_twin,
)
from swashtwin.synthesis.fidelity import Fidelity, measure_fidelity
from swashtwin.synthesis.machine_check import require_same_machine

Background = Literal["none", "spectrum"]
"""What a twin's windows are laid over: nothing, or noise with the spectrum of measured windows."""
Values = Literal["drawn", "calibrated", "nominal"]
"""Interface values of synthetic windows: draws of a calibration's posterior, its estimates, or the
nominal values.
"""

# Windows simulated at once: it limits memory, and Ctrl-C is handled between chunks.
_CHUNK = 64

BANDWIDTH_OF_SAMPLE_RATE = 2.56
"""Sample rate over the bandwidth of a twin: above half the rate over 1.28 an instrument's
anti-aliasing filter acts.
"""


@dataclass(frozen=True, eq=False, repr=False)
class SyntheticWindows(WindowSet):
    """Windows of one class that a twin made, and what they can be compared with."""

    measured: WindowSet | None = None
    """Measured windows of the class; None if there are none."""
    measured_healthy: WindowSet | None = None
    """Measured healthy windows at the same pressures; None if there are none."""
    simulate_healthy: Callable[[], WindowSet] | None = None
    """Makes healthy windows with the same twins."""
    pistons: int = 0
    seed: int = 0
    notes: tuple[str, ...] = ()
    """What could not be checked about the twin and the pump that was measured, as sentences."""

    @cached_property
    def fidelity(self) -> Fidelity | None:
        """How well they can be separated from the measured windows; None if there are none.

        It takes some seconds, and is computed on first access.
        """
        if self.measured is None:
            return None

        healthy = None
        if self.measured_healthy is not None and self.simulate_healthy is not None:
            healthy = (self.measured_healthy, self.simulate_healthy())
        return measure_fidelity(
            self.measured, self, seed=self.seed, pistons=self.pistons, healthy=healthy
        )


def synthesize(
    source: Calibration | Twin,
    fault: Fault | None,
    *,
    count: int,
    like: WindowSet | Iterable[Recording],
    seed: int = 0,
    speed: float | None = None,
    pressure: float | None = None,
    values: Values = "drawn",
    variation: Variation = DEFAULT_VARIATION,
    background: Background = "spectrum",
    window: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> SyntheticWindows:
    """Make synthetic windows of a fault, labeled with its class.

    Their `fidelity` compares them with measured ones.

    Parameters
    ----------
    source : a calibration, from whose posterior the values of each window are drawn; or a twin,
        whose values all windows share.
    fault : what the windows show; None is a healthy pump. The source need not have been calibrated
        on it. A recess without a specified corner acts by the law that the calibration identified,
        if it did.
    count : number of windows.
    like : measured training windows, or the training recordings; they give layout, classes and
        noise, and must not be test data.
    seed : seed of all draws.
    speed, pressure : shaft speed [rad/s] and absolute discharge pressure [Pa] of the windows; by
        default the source's, which must then agree with those that the recordings specify
        (`require_same_machine`). If neither is given, windows of a calibration at several operating
        points take turns among these.
    values : interface values if the source is a calibration: ``"drawn"`` from the posterior for
        each window, the ``"calibrated"`` estimates, or the ``"nominal"`` ones.
    variation, background : what differs from window to window, and what the windows are laid over,
        see `simulate_windows`.
    window : samples per window if `like` is recordings; by default as in `FaultClassifier`
        (`default_window`).
    progress : called with the number of finished windows, and of all.

    Raises
    ------
    InputError
        The channels differ, there is nothing to lay the windows over, or the twin is of another
        pump or operating point.

    Examples
    --------
    ``synthesize(calibration, SwashPlateDefect(depth=mm(0.07)), count=150, like=train)``
    """
    require_count(count)
    calibration = source if isinstance(source, Calibration) else None
    twin = _source_twin(source, values).with_fault(fault)
    conditions = _conditions_of(twin, calibration, speed=speed, pressure=pressure)

    compared = {"speed": speed is None, "pressure": pressure is None}
    if isinstance(like, WindowSet):
        measured = like
        notes = require_same_machine(twin, conditions, like, **compared)
    else:
        recordings = list(like)
        measured = _cut_like(recordings, twin, window)
        notes = require_same_machine(twin, conditions, recordings, **compared)

    law = None
    if calibration is not None and values != "nominal":
        law = calibration.law
    if calibration is not None:
        if calibration.doubt and values != "nominal":
            notes = (calibration.doubt, *notes)
        notes += describe_uncalibrated(calibration, law, twin, measured)

    bandwidth = min(twin.bandwidth, measured.sample_rate / BANDWIDTH_OF_SAMPLE_RATE)
    twin = replace(twin, bandwidth=bandwidth)
    machine = ""
    posterior = None
    if calibration is not None:
        machine = machine_of(calibration, measured)
    if calibration is not None and values == "drawn":
        posterior = [calibration.posterior] * len(conditions)
    simulate = partial(
        simulate_windows,
        count=count,
        like=measured,
        seed=seed,
        variation=variation,
        background=background,
        posterior=posterior,
        law=[law] * len(conditions),
        specimens=[machine] * len(conditions),
    )
    windows = simulate([twin.at(condition) for condition in conditions], progress=progress)

    # The recordings of the calibration had a part in the windows: no test may meet them.
    calibrated_on = {} if calibration is None else calibration.recording_hashes
    find_comparable = partial(_comparable_windows, measured, windows, machine)
    window_fields = {entry.name: getattr(windows, entry.name) for entry in fields(WindowSet)}
    window_fields["manifest"] = join_manifests([windows.manifest, calibrated_on])
    healthy_classes = [name for name in measured.classes if is_healthy(name)]
    healthy_twins = [twin.at(condition).with_fault(None) for condition in conditions]
    return SyntheticWindows(
        **window_fields,
        measured=find_comparable(windows.label),
        measured_healthy=find_comparable(healthy_classes),
        simulate_healthy=partial(simulate, healthy_twins),
        pistons=twin.pump.rotating_group.piston_count,
        seed=seed,
        notes=notes,
    )


def _source_twin(source: Calibration | Twin, values: Values) -> Twin:
    """Return the twin of a source, with nominal or calibrated interface values."""
    if isinstance(source, Twin):
        return source
    if isinstance(source, Calibration):
        return source.nominal if values == "nominal" else source.twin
    raise InputError(
        f"The source is a {type(source).__name__}; it must be a calibration or a twin."
    )


def _conditions_of(
    twin: Twin, calibration: Calibration | None, *, speed: float | None, pressure: float | None
) -> list[OperatingCondition]:
    """Return the operating points of the windows: the specified one, or those of the source."""
    if calibration is not None and speed is None and pressure is None:
        return [fit.condition for fit in calibration.fits]

    changes: dict[str, float] = {}
    if speed is not None:
        changes["speed"] = speed
    if pressure is not None:
        changes["discharge_pressure"] = pressure
    return [twin.condition.replace(**changes)]


def _cut_like(recordings: Sequence[Recording], twin: Twin, window: int | None) -> WindowSet:
    """Cut the recordings into windows, with the twin's class among the classes."""
    labels = {recording.label for recording in recordings if recording.label is not None}
    classes = sorted({*labels, _class_among(sorted(labels), twin)})
    return cut_windows(recordings, length=window or default_window(recordings), classes=classes)


def describe_uncalibrated(
    calibration: Calibration, law: FaultLaw | None, twin: Twin, measured: WindowSet
) -> tuple[str, ...]:
    """Return what the calibration leaves open about the sensors and the law of the fault."""
    notes: tuple[str, ...] = ()
    calibrated = calibration.posterior.channels
    sensors = [twin.pump.channels[index] for index in _sensor_indices(twin, measured.channels)]
    uncalibrated = [name for name in sensors if name not in calibrated]
    if uncalibrated:
        notes += (
            f"The calibration read {', '.join(calibrated)}, but not {', '.join(uncalibrated)}: the "
            "gains of these are those of the pump file, which no recording has checked. Calibrate "
            "on them, or leave them out (channels = [...]).",
        )
    if law is not None and law.apply_to(twin.fault) != twin.fault and not law.corner.is_constrained:
        notes += (
            "No recording shows how slippers follow a recess "
            f"(corner: {law.corner.verdict}); the windows guess it.",
        )
    return notes


def machine_of(calibration: Calibration, like: WindowSet) -> str:
    """Return the machine in `like` that a twin was calibrated on; empty if it is not known.

    A calibration lists its recordings; those that are in `like` name the machine. Content decides,
    since recordings of two machines may have the same name.
    """
    measured = like.subset(~like.synthetic)
    calibrated_on = list(find_copies(calibration.recording_hashes, measured.recordings))
    is_calibrated_on = ~like.synthetic & np.isin(like.recording_id, calibrated_on)
    machines = set(like.specimen[is_calibrated_on].tolist()) - {""}
    return machines.pop() if len(machines) == 1 else ""


def _comparable_windows(
    like: WindowSet, synthetic: WindowSet, machine: str, labels: Sequence[str] | np.ndarray
) -> WindowSet | None:
    """Return measured windows of some classes to compare synthetic ones with; None if none exist.

    They are at the pressures of the synthetic ones, if there are such windows, and of the machine
    that the twin was calibrated on, if it is known.
    """
    is_same_class = ~like.synthetic & np.isin(like.label, labels)
    if machine:
        is_same_class &= like.specimen == machine

    is_at_pressure = np.zeros(len(like), dtype=bool)
    for pressure in np.unique(synthetic.discharge_pressure):
        is_at_pressure |= np.asarray(
            values_match(like.discharge_pressure, float(pressure), PRESSURE_TOLERANCE)
        )
    if (is_same_class & is_at_pressure).any():
        is_same_class &= is_at_pressure
    return like.subset(is_same_class) if is_same_class.any() else None


def simulate_windows(
    twin: Twin | Sequence[Twin],
    *,
    count: int,
    like: WindowSet,
    seed: int,
    variation: Variation = DEFAULT_VARIATION,
    background: Background = "spectrum",
    posterior: Sequence[Posterior | None] | None = None,
    law: Sequence[FaultLaw | None] | None = None,
    specimens: Sequence[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> WindowSet:
    """Make synthetic windows of twins, with the layout and the classes of `like`.

    Their level is the machine's: if `like` has healthy windows at a twin's pressure, each channel's
    gain is the one that brings the healthy twin's lines to theirs.

    Parameters
    ----------
    twin : a twin, or several of one class (one for each pump) that take turns.
    count : number of windows.
    like : measured training windows; they give layout, classes and noise, and must not be test
        windows.
    seed : seed of all draws.
    variation : what differs from window to window.
    background : what the windows are laid over. ``"spectrum"``: noise with the spectrum of the
        measured windows between the piston-pass lines. ``"none"``: nothing, the bare model as the
        paper simulates it.
    posterior : uncertainty of a calibration (`Calibration.posterior`), one or None for each twin:
        the values, scales and sensor path of each window are drawn from it, and `variation` spreads
        them further as pumps differ from one recording to the next. Without, every window has the
        twin's own.
    law : law of a recess (`Calibration.law`), one for each twin: how far slippers follow is drawn
        from its estimate, and the noise rises with the depth.
    specimens : machine in `like` that each twin describes, or an empty text (`machine_of`). If
        `like` has healthy windows of that machine at the twin's pressure, noise and gain are those
        of these windows alone. Without, they are those of all machines together. The windows are
        of the specimen "twin of" this machine, or of the name of the pump.
    progress : called with the number of finished windows, and of all.

    Raises
    ------
    InputError
        The twins' class is not among the windows' classes or differs between them, the channels
        differ, there is nothing to lay the windows over, or there are not as many posteriors or
        specimens as twins.
    """
    twins = [twin] if isinstance(twin, Twin) else list(twin)
    require_count(count)
    _require_agreement(twins, like)
    machines = _machine_of_each(twins, specimens)
    sources = _draw_sources(twins, posterior, count, seed)
    laws = [None] * len(twins) if law is None else list(law)
    sensors = [_sensor_indices(twin, like.channels) for twin in twins]
    noises: list[BackgroundNoise] = []
    if background == "spectrum":
        noises = [
            background_noise(like, twin, machine)
            for twin, machine in zip(twins, machines, strict=True)
        ]
    gains = [
        noise.gains(twin, rows) for noise, twin, rows in zip(noises, twins, sensors, strict=False)
    ]

    # Each draw has an address (seed, purpose, index), so that no window depends on the chunks.
    time = np.arange(like.length) / like.sample_rate
    signal = np.empty((count, len(like.channels), like.length), dtype=np.float32)
    for start in range(0, count, _CHUNK):
        chunk = range(start, min(start + _CHUNK, count))
        varied = [
            _vary(sources[index], laws[index % len(twins)], variation, seed, index)
            for index in chunk
        ]
        with torch.no_grad():
            batch = accelerations(varied)
        for index, source, lines in zip(chunk, varied, batch.lines.numpy(), strict=True):
            kind = index % len(twins)
            rng = random_stream(seed, "window", twins[0].label, index)
            angle = rng.uniform(0, 2 * np.pi) + source.condition.speed * time
            # The batch has the orders of all its twins; this one has those in its bandwidth.
            sensor_lines = lines[sensors[kind]][:, np.isin(batch.orders, source.orders)]
            window = synchronous_signal(sensor_lines, source.orders, angle)
            window = window * np.exp(rng.normal(0, variation.sensor, (len(like.channels), 1)))
            if noises:
                noise = noises[kind].draw(rng)
                window = gains[kind][:, None] * window + _noise_factor(laws[kind], source) * noise
            signal[index] = window
        if progress is not None:
            progress(chunk.stop, count)

    return build_windows(
        signal,
        like=like,
        name="synthetic",
        label=_class_among(like.classes, twins[0]),
        pressure=np.array([source.condition.discharge_pressure for source in sources]),
        speed=np.array([source.condition.speed for source in sources]),
        specimen=np.array(_name_specimens(sources, machines), dtype=np.str_),
        seed=seed,
    )


def _machine_of_each(twins: Sequence[Twin], specimens: Sequence[str] | None) -> list[str]:
    """Return the machine that each twin describes; an empty text if none was given."""
    if specimens is None:
        return [""] * len(twins)
    if len(specimens) != len(twins):
        raise InputError(
            f"There are {len(specimens)} specimens for {len(twins)} twins; give one for each."
        )
    return list(specimens)


def _name_specimens(sources: Sequence[Twin], machines: Sequence[str]) -> list[str]:
    """Return the specimen of each window: the twin of its machine, if it is known, or of its pump.

    Folds that hold a machine out leave out windows with its name (`is_made_without`).
    """
    return [
        f"{TWIN_OF}{machines[index % len(machines)] or source.pump.name}"
        for index, source in enumerate(sources)
    ]


def _vary(source: Twin, law: FaultLaw | None, variation: Variation, seed: int, index: int) -> Twin:
    """Return the twin of one window, drawn around its source, with its fault under the law."""
    twin = draw_twin(source, variation, seed, index)
    if law is None:
        return twin
    corner_draw = random_stream(seed, "law", twin.label, index).normal()
    return twin.with_fault(law.apply_to(twin.fault, corner_draw))


def _noise_factor(law: FaultLaw | None, twin: Twin) -> float:
    """Return the factor by which the law lets a fault raise the noise; 1 without a law."""
    if law is None:
        return 1.0
    return law.noise_factor_of(twin.fault)


def _draw_sources(
    twins: Sequence[Twin], posteriors: Sequence[Posterior | None] | None, count: int, seed: int
) -> list[Twin]:
    """Return the twin of each window, in turns, with values drawn from its posterior if given."""
    n_twins = len(twins)
    sources = [twins[index % n_twins] for index in range(count)]
    if posteriors is None:
        return sources
    if len(posteriors) != n_twins:
        raise InputError(
            f"There are {len(posteriors)} posteriors for {n_twins} twins; give one for each."
        )

    n_draws = -(-count // n_twins)  # rounded up
    for number, posterior in enumerate(posteriors):
        if posterior is None:
            continue
        draws = posterior.draws(n_draws, derive_seed(seed, "posterior", twins[0].label, number))
        for turn, index in enumerate(range(number, count, n_twins)):
            sources[index] = posterior.twin_at(sources[index], draws[turn])
    return sources


def _class_among(classes: Sequence[str], twin: Twin) -> str:
    """Return the name of the twin's class among `classes`.

    A healthy pump may be called ``"healthy"`` there.
    """
    if twin.label in classes:
        return twin.label
    names = [name for name in classes if is_same_class(name, twin.label)]
    return names[0] if names else twin.label


def _sensor_indices(twin: Twin, channels: Sequence[str]) -> list[int]:
    """Return the index of each channel among the twin's sensors, by name.

    A single channel of another name is the first sensor.
    """
    sensors = twin.pump.channels
    if len(channels) == 1 and channels[0] not in sensors:
        return [0]

    unknown = [name for name in channels if name not in sensors]
    if unknown:
        raise InputError(
            f"The channel {unknown[0]!r} of the windows is not among the twin's sensors "
            f"({', '.join(sensors)}). Name the channels as the sensors (names), or edit "
            "[[sensors]] in the pump file."
        )
    return [sensors.index(name) for name in channels]


def _require_agreement(twins: Sequence[Twin], like: WindowSet) -> None:
    """Require twins of one class that is among the windows' classes, with their channels."""
    for twin in twins:
        if _class_among(like.classes, twin) not in like.classes:
            raise InputError(
                f"The class {twin.label!r} is not among the windows' classes "
                f"({', '.join(like.classes)})."
            )
        if twin.label != twins[0].label:
            raise InputError(
                f"One twin simulates {twins[0].label!r}, another {twin.label!r}. Give twins of one "
                "class."
            )
        _sensor_indices(twin, like.channels)
        if like.sample_rate < 2 * twin.bandwidth:
            raise InputError(
                f"The windows' sample rate ({like.sample_rate:g} Hz) is below twice the twin's "
                f"bandwidth ({twin.bandwidth:g} Hz). Use a bandwidth of "
                f"{like.sample_rate / BANDWIDTH_OF_SAMPLE_RATE:g} Hz."
            )


def require_count(count: int) -> None:
    """Raise an `InputError` if `count` is below 1."""
    if count < 1:
        raise InputError(f"count ({count}) must be at least 1.")


def build_windows(
    signal: Float[np.ndarray, "window channel time"],
    *,
    like: WindowSet,
    name: str,
    label: str,
    pressure: Float[np.ndarray, " window"],
    speed: Float[np.ndarray, " window"],
    specimen: Shaped[np.ndarray, " window"],
    seed: int,
) -> WindowSet:
    """Return `signal` as synthetic windows with the layout and the classes of `like`.

    Each window is a recording by itself. The recordings of `like` contributed to them, and are in
    their manifest.

    Parameters
    ----------
    name : name of the filler, with which the recordings' ids begin.
    seed : seed of the filler; the ids end with it and the window's number.
    """
    count = len(signal)
    recording_ids = []
    for index, window_pressure in enumerate(pressure.tolist()):
        at_pressure = "" if math.isnan(window_pressure) else f"_{window_pressure / 1e6:.4g}MPa"
        recording_ids.append(f"{name}_{label}{at_pressure}_{seed}_{index}")
    return WindowSet(
        signal=signal.astype(np.float32),
        target=np.full(count, like.classes.index(label), dtype=np.int64),
        classes=like.classes,
        recording_id=np.array(recording_ids, dtype=np.str_),
        specimen=specimen,
        discharge_pressure=pressure,
        speed=speed,
        start=np.zeros(count, dtype=np.int64),
        synthetic=np.ones(count, dtype=bool),
        sample_rate=like.sample_rate,
        channels=like.channels,
        unit=like.unit,
        manifest=like.sources,
    )
