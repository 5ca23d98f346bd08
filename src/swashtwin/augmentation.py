"""Windows that nobody measured, made with a twin.

The first floor where physics and learning meet. A synthetic window is the twin's steady acceleration with what varies
from one moment to the next drawn anew, laid over noise as the machine makes it. It carries ``synthetic=True``, which
`evaluate` refuses.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from swashtwin.calibration import Posterior
from swashtwin.errors import InputError
from swashtwin.seeding import derive_seed, stream
from swashtwin.signals import synchronous_signal
from swashtwin.twin import Twin, accelerations
from swashtwin.units import celsius
from swashtwin.windows import WindowSet


@dataclass(frozen=True)
class Variation:
    """What is drawn anew for each synthetic window; the shaft's phase always is. Zero switches one off.

    Speed, pressure and temperature follow docs/physics.md, section 5. Severity, angle, interface values and sensor are
    estimates of ours; those of severity and angle are also the virtual rig's own, so that results on the rig are those
    of someone who knows how much a fault spreads (docs/rig.md). The interface values spread alike; what a
    calibration leaves open of each comes on top of it (`synthesize(posterior=)`).
    """

    speed: float = 0.005
    """Half-width of the uniform spread of the speed, relative."""
    pressure: float = 0.03
    """Half-width of the uniform spread of the discharge pressure, relative."""
    severity: float = 0.2
    """Standard deviation of the logarithm of the fault's severity."""
    angle: float = math.radians(0.5)
    """Standard deviation of the place of a swash plate or bore defect [rad]."""
    temperature: tuple[float, float] = (celsius(30), celsius(60))
    """Range of the oil temperature [K]; it acts on the leakage only, not on the films' damping."""
    interfaces: float = 0.1
    """Standard deviation of the logarithm of each interface value."""
    sensor: float = 0.04
    """Standard deviation of each channel's gain, relative."""


_CHUNK = 64
"""Windows that are made together; memory does not grow beyond them, and an interruption is heard between them."""

DEFAULT_VARIATION = Variation()
"""The spread around the twin that is taken where nothing else is said."""


def synthesize(
    twin: Twin | Sequence[Twin],
    *,
    label: str,
    count: int,
    like: WindowSet,
    seed: int,
    variation: Variation = DEFAULT_VARIATION,
    background: bool = True,
    posterior: Posterior | Sequence[Posterior] | None = None,
) -> WindowSet:
    """Synthetic windows of one class, of the layout and the classes of `like`.

    Parameters
    ----------
    twin : calibrated twin, or several (one for each pump) that take turns.
    label : class of the windows, which must be the twin's.
    count : how many.
    like : measured training windows; they give layout, classes and noise, and must not be test windows.
    seed : addresses every draw.
    variation : what differs from window to window.
    background : lay the windows over noise with the spectrum of the measured windows between the piston-pass lines;
        without, they are the bare model, as the paper simulates them.
    posterior : what a calibration leaves open (`Calibration.posterior`), one for each twin: the values, scales and
        sensor path of each window are drawn from it, and `variation` spreads them further as pumps differ from one
        recording to the next. Without, every window has the twin's own.

    Raises
    ------
    InputError
        The label is not the twin's, the channels differ, there is nothing to take noise from, or there are not as many
        posteriors as twins.
    """
    twins = [twin] if isinstance(twin, Twin) else list(twin)
    _require_agreement(twins, label, count, like)
    known = _known(twins, posterior, count, seed)
    sources = [twins[i % len(twins)] for i in range(count)]
    noises = {id(one): _noise(like, one) for one in twins} if background else {}
    time = np.arange(like.length) / like.sample_rate
    signal = np.empty((count, len(like.channels), like.length), dtype=np.float32)
    for start in range(0, count, _CHUNK):
        chunk = range(start, min(start + _CHUNK, count))
        varied = [drawn(known(sources[i], i), variation, seed, i) for i in chunk]
        with torch.no_grad():
            batch = accelerations(varied)
        for i, one, lines in zip(chunk, varied, batch.lines.numpy(), strict=True):
            rng = stream(seed, "window", label, i)
            angle = rng.uniform(0, 2 * np.pi) + one.condition.speed * time
            window = synchronous_signal(lines[:, np.isin(batch.orders, one.orders)], one.orders, angle)
            window = window * np.exp(rng.normal(0, variation.sensor, (len(like.channels), 1)))
            signal[i] = window + noises[id(sources[i])].drawn(like, rng) if background else window
    pressure = np.array([one.condition.discharge_pressure for one in sources])
    return WindowSet(
        signal=signal,
        target=np.full(count, like.classes.index(label), dtype=np.int64),
        classes=like.classes,
        recording_id=np.array([f"synthetic_{label}_{p / 1e6:.4g}MPa_{seed}_{i}" for i, p in enumerate(pressure)]),
        specimen=np.array([f"twin of {one.pump.name}" for one in sources]),
        discharge_pressure=pressure,
        speed=np.array([one.condition.speed for one in sources]),
        start=np.zeros(count, dtype=np.int64),
        synthetic=np.ones(count, dtype=bool),
        sample_rate=like.sample_rate,
        channels=like.channels,
        unit=like.unit,
    )


def _known(
    twins: Sequence[Twin], posterior: Posterior | Sequence[Posterior] | None, count: int, seed: int
) -> Callable[[Twin, int], Twin]:
    """What makes of a window's twin and number the twin as far as it is known."""
    if posterior is None:
        return lambda twin, index: twin
    posteriors = [posterior] if isinstance(posterior, Posterior) else list(posterior)
    if len(posteriors) != len(twins):
        raise InputError(f"{len(posteriors)} posteriors for {len(twins)} twins; give one for each.")
    turns = -(-count // len(twins))
    points = [
        one.draws(turns, derive_seed(seed, "posterior", twins[0].label, number))
        for number, one in enumerate(posteriors)
    ]

    def known(twin: Twin, index: int) -> Twin:
        turn, number = divmod(index, len(twins))
        return posteriors[number].twin_at(twin, points[number][turn])

    return known


def _require_agreement(twins: Sequence[Twin], label: str, count: int, like: WindowSet) -> None:
    if count < 1:
        raise InputError(f"count ({count}) must be at least 1.")
    if label not in like.classes:
        raise InputError(f"class {label!r} is not among the windows' classes ({', '.join(like.classes)}).")
    for one in twins:
        if one.label != label:
            raise InputError(f"the twin simulates {one.label!r}, not {label!r}; give it a fault of that class.")
        if one.pump.channels != like.channels:
            raise InputError(
                f"the twin's sensors ({', '.join(one.pump.channels)}) are not the windows' channels "
                f"({', '.join(like.channels)}); edit [[sensors]] in the pump file."
            )
        if like.sample_rate < 2 * one.bandwidth:
            raise InputError(
                f"the windows' sample rate ({like.sample_rate:g} Hz) is below twice the twin's bandwidth; use "
                f"bandwidth={like.sample_rate / 2.56:g}."
            )


def drawn(twin: Twin, variation: Variation, seed: int, index: int) -> Twin:
    """`twin` with its condition, fault and interface values as `variation` spreads them.

    Parameters
    ----------
    seed, index : address the draw; the same ones give the same twin.
    """
    rng = stream(seed, "variation", twin.label, index)
    condition = replace(
        twin.condition,
        speed=twin.condition.speed * (1 + variation.speed * rng.uniform(-1, 1)),
        discharge_pressure=twin.condition.discharge_pressure * (1 + variation.pressure * rng.uniform(-1, 1)),
        oil_temperature=rng.uniform(*variation.temperature),
    )
    fault = twin.fault
    if fault is not None:
        fault = fault.scaled(float(np.exp(rng.normal(0, variation.severity))))
        if hasattr(fault, "angle"):
            fault = replace(fault, angle=abs(fault.angle + rng.normal(0, variation.angle)))
    values = twin.values.numpy() * np.exp(rng.normal(0, variation.interfaces, 6))
    interfaces = type(twin.pump.interfaces).from_values(values)
    return replace(twin, condition=condition, fault=fault, interfaces=interfaces)


@dataclass(frozen=True, eq=False)
class _Noise:
    """Noise with the spectrum of a measured window between its piston-pass lines, in random phase."""

    windows: Int[np.ndarray, " window"]
    """Among which of the measured windows one is drawn."""
    clear: Bool[np.ndarray, " frequency"]
    """Which lines of a window's spectrum are far from the piston-pass frequency's multiples."""

    def drawn(self, like: WindowSet, rng: np.random.Generator) -> Float[np.ndarray, "channel time"]:
        window = like.signal[rng.choice(self.windows)].astype(float)
        spectrum = np.abs(np.fft.rfft(window - window.mean(axis=1, keepdims=True), axis=-1))
        line, clear = np.arange(self.clear.size), self.clear
        for row in spectrum:
            row[~clear] = np.interp(line[~clear], line[clear], row[clear])
        phase = np.exp(2j * np.pi * rng.random(spectrum.shape))
        return np.fft.irfft(spectrum * phase, like.length, axis=-1)


def _noise(like: WindowSet, twin: Twin) -> _Noise:
    frequency = np.fft.rfftfreq(like.length, 1 / like.sample_rate)
    pass_frequency = twin.pump.rotating_group.piston_count * twin.condition.shaft_frequency
    distance = np.abs(frequency / pass_frequency - np.round(frequency / pass_frequency)) * pass_frequency
    return _Noise(_quiet_windows(like, twin.condition.discharge_pressure), distance > 2.5 * frequency[1])


def _quiet_windows(like: WindowSet, pressure: float) -> np.ndarray:
    """Indices of measured normal windows (any class where there is none) at the pressure nearest to `pressure`."""
    candidates = ~like.synthetic
    if "normal" in like.classes and np.any(candidates & (like.label == "normal")):
        candidates &= like.label == "normal"
    if not candidates.any():
        raise InputError("no measured window to take noise from; pass background=False.")
    distance = np.abs(like.discharge_pressure - pressure)
    if np.isfinite(distance[candidates]).any():
        candidates &= distance <= np.nanmin(distance[candidates]) + 1e4
    return np.flatnonzero(candidates)
