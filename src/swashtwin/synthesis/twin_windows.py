"""Windows made with a twin.

The first floor where physics and learning meet. A synthetic window is the twin's steady
acceleration with what varies from one moment to the next drawn anew, laid over noise as the machine
makes it. It carries ``synthetic=True``, which `evaluate` refuses.
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
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.physics import Twin, accelerations
from swashtwin.pump import PRESSURE_TOLERANCE, Fault, is_healthy, is_same_class, values_match
from swashtwin.recordings import Recording, default_window, join_manifests
from swashtwin.signals import synchronous_signal
from swashtwin.synthesis.background import DEFAULT_VARIATION, Variation, background_noise, draw_twin
from swashtwin.synthesis.fidelity import Fidelity, measure_fidelity
from swashtwin.synthesis.machine_check import require_same_machine

Background = Literal["none", "spectrum"]
"""What a twin's windows are laid over: nothing, or noise of measured windows' spectrum."""
Values = Literal["drawn", "calibrated", "nominal"]
"""Whose interface values synthetic windows have: draws of a calibration's posterior, its estimates,
or the nominal.
"""
_CHUNK = 64
"""Windows simulated at once: this limits memory, and Ctrl-C is handled between chunks."""


@dataclass(frozen=True, eq=False, repr=False)
class SyntheticWindows(WindowSet):
    """Windows of one class that a twin made, and what they can be compared with."""

    measured: WindowSet | None = None
    """Measured windows of the class; None where there are none."""
    measured_healthy: WindowSet | None = None
    """Measured healthy windows at the same pressures; None where there are none."""
    simulate_healthy: Callable[[], WindowSet] | None = None
    """Makes healthy windows with the same twins."""
    pistons: int = 0
    seed: int = 0
    notes: tuple[str, ...] = ()
    """What cannot be known about whether the twin is of the pump that was measured, in
    sentences.
    """

    @cached_property
    def fidelity(self) -> Fidelity | None:
        """How well they are told from the measured windows, and by what; None where the class was
        not measured.

        It takes some seconds, and is computed when it is first asked for.
        """
        if self.measured is None:
            return None
        pair = self.measured_healthy, self.simulate_healthy
        healthy = None if pair[0] is None or pair[1] is None else (pair[0], pair[1]())
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
) -> SyntheticWindows:
    """Synthetic windows of a fault, labeled with its class; their `fidelity` compares them with
    measured ones.

    Parameters
    ----------
    source : a calibration, from whose posterior the values of each window are drawn; or a twin,
        whose values all windows share.
    fault : what the windows show; None is a healthy pump. The source need not have been calibrated
        on it. A recess that states no corner acts by the law that the calibration identified, if it
        did.
    count : how many.
    like : measured training windows, or the training recordings; they give layout, classes and
        noise, and must not be test data.
    seed : addresses every draw.
    speed, pressure : shaft speed [rad/s] and absolute discharge pressure [Pa] of the windows; by
        default the source's, which must then be those that the recordings state, as far as they
        state them (`require_same_machine`). Where neither is given, windows of a calibration at
        several operating points take turns among these.
    values : what of a calibration: ``"drawn"`` for each window from the posterior, the
        ``"calibrated"`` estimates, or the ``"nominal"`` twin before.
    variation, background : what differs from window to window, and what the windows are laid over,
        see `simulate_windows`.
    window : samples per window where `like` is recordings; by default as in `FaultClassifier`
        (`default_window`).

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
    twin = (
        source
        if calibration is None
        else calibration.nominal
        if values == "nominal"
        else calibration.twin
    )
    if not isinstance(twin, Twin):
        raise InputError(
            f"the source is a {type(source).__name__}; it must be a calibration or a twin."
        )
    twin = twin.with_fault(fault)
    named = {"speed": speed, "discharge_pressure": pressure}
    changes = {name: value for name, value in named.items() if value is not None}
    conditions = [twin.condition.replace(**changes)]
    if calibration is not None and not changes:
        conditions = [fit.condition for fit in calibration.fits]
    is_stated = {"speed": speed is None, "pressure": pressure is None}
    if isinstance(like, WindowSet):
        measured, notes = like, require_same_machine(twin, conditions, like, **is_stated)
    else:
        recordings = list(like)
        labels = sorted(
            {recording.label for recording in recordings if recording.label is not None}
        )
        classes = sorted({*labels, _class_among(labels, twin)})
        measured = cut_windows(
            recordings, length=window or default_window(recordings), classes=classes
        )
        notes = require_same_machine(twin, conditions, recordings, **is_stated)
    read = measured.channels if calibration is None else calibration.posterior.channels
    sensors = [twin.pump.channels[place] for place in _sensors(twin, measured.channels)]
    if unread := [name for name in sensors if name not in read]:
        notes = (
            *notes,
            f"the calibration read {', '.join(read)}, and not {', '.join(unread)}, whose gains are those of the pump "
            "file, which no recording has checked; calibrate on them, or leave them out (channels = [...]).",
        )
    law = None if calibration is None or values == "nominal" else calibration.law
    if law is not None and law.of(fault) != fault and not law.corner.is_constrained:
        notes = (
            *notes,
            f"no recording tells how slippers follow a recess (corner: {law.corner.verdict}); the windows guess it.",
        )
    twin = replace(twin, bandwidth=min(twin.bandwidth, measured.sample_rate / 2.56))
    calibrated_on = {} if calibration is None else calibration.recording_hashes
    simulate = partial(
        simulate_windows,
        count=count,
        like=measured,
        seed=seed,
        variation=variation,
        background=background,
        posterior=[calibration.posterior] * len(conditions)
        if calibration and values == "drawn"
        else None,
        law=[law] * len(conditions),
    )
    windows = simulate([twin.at(condition) for condition in conditions])
    facts = {item.name: getattr(windows, item.name) for item in fields(WindowSet)}
    facts["manifest"] = join_manifests([windows.manifest, calibrated_on])
    healthy = [name for name in measured.classes if is_healthy(name)]
    return SyntheticWindows(
        **facts,
        measured=_comparable_windows(measured, windows, windows.label, calibrated_on),
        measured_healthy=_comparable_windows(measured, windows, healthy, calibrated_on),
        simulate_healthy=partial(
            simulate, [twin.at(condition).with_fault(None) for condition in conditions]
        ),
        pistons=twin.pump.rotating_group.piston_count,
        seed=seed,
        notes=notes,
    )


def _comparable_windows(
    like: WindowSet,
    synthetic: WindowSet,
    labels: Sequence[str] | np.ndarray,
    calibrated_on: Iterable[str],
) -> WindowSet | None:
    """Measured windows of some classes, at the pressures of synthetic ones where there are some;
    None without any.

    Where all windows of the recordings calibrated on are of one specimen, they are those of that
    machine alone.
    """
    same = ~like.synthetic & np.isin(like.label, labels)
    machines = set(like.specimen[np.isin(like.recording_id, list(calibrated_on))].tolist()) - {""}
    if len(machines) == 1:
        same &= like.specimen == machines.pop()
    near = np.zeros(len(like), dtype=bool)
    for pressure in np.unique(synthetic.discharge_pressure):
        near |= np.asarray(
            values_match(like.discharge_pressure, float(pressure), PRESSURE_TOLERANCE)
        )
    if (same & near).any():
        same &= near
    return like.subset(same) if same.any() else None


def simulate_windows(
    twin: Twin | Sequence[Twin],
    *,
    count: int,
    like: WindowSet,
    seed: int,
    variation: Variation = DEFAULT_VARIATION,
    background: Background = "spectrum",
    posterior: Sequence[Posterior] | None = None,
    law: Sequence[FaultLaw | None] | None = None,
) -> WindowSet:
    """Synthetic windows of twins as they are, of the layout and the classes of `like`.

    Their level is the machine's: where `like` has healthy windows at a twin's pressure, each
    channel's gain is that which brings the healthy twin's lines to theirs.

    Parameters
    ----------
    twin : a twin, or several of one class (one for each pump) that take turns.
    count : how many.
    like : measured training windows; they give layout, classes and noise, and must not be test
        windows.
    seed : addresses every draw.
    variation : what differs from window to window.
    background : what the windows are laid over. ``"spectrum"``: noise with the spectrum of the
        measured windows between the piston-pass lines. ``"none"``: nothing, the bare model as the
        paper simulates it.
    posterior : what a calibration leaves open (`Calibration.posterior`), one for each twin: the
        values, scales and sensor path of each window are drawn from it, and `variation` spreads
        them further as pumps differ from one recording to the next. Without, every window has the
        twin's own.
    law : law of a recess (`Calibration.law`), one for each twin: how far slippers follow is drawn
        from its estimate, and the noise rises with the depth.

    Raises
    ------
    InputError
        The twins' class is not among the windows' classes or differs between them, the channels
        differ, there is nothing to lay the windows over, or there are not as many posteriors as
        twins.
    """
    twins = [twin] if isinstance(twin, Twin) else list(twin)
    require_count(count)
    _require_agreement(twins, like)
    sources = _drawn(twins, posterior, count, seed)
    sensors = [_sensors(twin, like.channels) for twin in twins]
    noises = [background_noise(like, twin) for twin in twins] if background == "spectrum" else []
    gains = [
        noise.gains(twin, rows) for noise, twin, rows in zip(noises, twins, sensors, strict=False)
    ]
    laws = [None] * len(twins) if law is None else law
    time = np.arange(like.length) / like.sample_rate
    signal = np.empty((count, len(like.channels), like.length), dtype=np.float32)
    for start in range(0, count, _CHUNK):
        chunk = range(start, min(start + _CHUNK, count))
        varied = []
        for i in chunk:
            one, own = draw_twin(sources[i], variation, seed, i), laws[i % len(twins)]
            if own is not None:
                one = one.with_fault(
                    own.of(one.fault, random_stream(seed, "law", one.label, i).normal())
                )
            varied.append(one)
        with torch.no_grad():
            batch = accelerations(varied)
        for i, source, lines in zip(chunk, varied, batch.lines.numpy(), strict=True):
            rng = random_stream(seed, "window", twins[0].label, i)
            angle = rng.uniform(0, 2 * np.pi) + source.condition.speed * time
            read = lines[sensors[i % len(twins)]][:, np.isin(batch.orders, source.orders)]
            window = synchronous_signal(read, source.orders, angle)
            window = window * np.exp(rng.normal(0, variation.sensor, (len(like.channels), 1)))
            if noises:
                own = laws[i % len(twins)]
                floor = 1.0 if own is None else own.noise_factor_of(source.fault)
                window = gains[i % len(twins)][:, None] * window + floor * noises[
                    i % len(twins)
                ].draw(rng)
            signal[i] = window
    pressure = np.array([source.condition.discharge_pressure for source in sources])
    return build_windows(
        signal,
        like=like,
        name="synthetic",
        label=_class_among(like.classes, twins[0]),
        pressure=pressure,
        speed=np.array([source.condition.speed for source in sources]),
        specimen=np.array([f"twin of {source.pump.name}" for source in sources]),
        seed=seed,
    )


def _drawn(
    twins: Sequence[Twin], posteriors: Sequence[Posterior] | None, count: int, seed: int
) -> list[Twin]:
    """Twin of each window, in turns, with values drawn for that window where there are
    posteriors.
    """
    kinds, sources = len(twins), [twins[i % len(twins)] for i in range(count)]
    if posteriors is None:
        return sources
    if len(posteriors) != kinds:
        raise InputError(f"{len(posteriors)} posteriors for {kinds} twins; give one for each.")
    points = [
        item.draws(-(-count // kinds), derive_seed(seed, "posterior", twins[0].label, number))
        for number, item in enumerate(posteriors)
    ]
    return [
        posteriors[i % kinds].twin_at(twin, points[i % kinds][i // kinds])
        for i, twin in enumerate(sources)
    ]


def _class_among(classes: Sequence[str], twin: Twin) -> str:
    """Name of the twin's class among `classes`, where a healthy pump may be called
    ``"healthy"``.
    """
    names = [name for name in classes if is_same_class(name, twin.label)]
    return names[0] if names and twin.label not in names else twin.label


def _sensors(twin: Twin, channels: Sequence[str]) -> list[int]:
    """Place of each channel among the twin's sensors: by name, or the first for a single one of
    another name.
    """
    sensors = twin.pump.channels
    if len(channels) == 1 and channels[0] not in sensors:
        return [0]
    missing = [name for name in channels if name not in sensors]
    if missing:
        raise InputError(
            f"channel {missing[0]!r} of the windows is none of the twin's sensors ({', '.join(sensors)}); name the "
            "channels as the sensors (names), or edit [[sensors]] in the pump file."
        )
    return [sensors.index(name) for name in channels]


def _require_agreement(twins: Sequence[Twin], like: WindowSet) -> None:
    for twin in twins:
        if _class_among(like.classes, twin) not in like.classes:
            raise InputError(
                f"class {twin.label!r} is not among the windows' classes ({', '.join(like.classes)})."
            )
        if twin.label != twins[0].label:
            raise InputError(
                f"one twin simulates {twins[0].label!r}, another {twin.label!r}; give twins of one class."
            )
        _sensors(twin, like.channels)
        if like.sample_rate < 2 * twin.bandwidth:
            raise InputError(
                f"the windows' sample rate ({like.sample_rate:g} Hz) is below twice the twin's bandwidth; use "
                f"a bandwidth of {like.sample_rate / 2.56:g}."
            )


def require_count(count: int) -> None:
    """Raise an `InputError` where `count` is below 1."""
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
    """`signal` as synthetic windows of the layout and the classes of `like`, each a recording of
    its own.

    The recordings of `like` had a part in them, and are in their manifest. `name`, that of the
    filler, begins their recordings' ids, and `seed` and each window's number end them.
    """
    count = len(signal)
    at = ["" if math.isnan(p) else f"_{p / 1e6:.4g}MPa" for p in pressure.tolist()]
    return WindowSet(
        signal=signal.astype(np.float32),
        target=np.full(count, like.classes.index(label), dtype=np.int64),
        classes=like.classes,
        recording_id=np.array(
            [f"{name}_{label}{at[i]}_{seed}_{i}" for i in range(count)], dtype=np.str_
        ),
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
