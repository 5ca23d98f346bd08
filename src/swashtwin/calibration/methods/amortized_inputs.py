"""What an amortized network reads: the lines of a measurement or a stretch of its signal, measured or simulated.

Both are simulated in batches, once for each twin, and corrupted anew each time a twin is shown: every line by what
`Comparison.sigma` expects of model, measurement and floor, the waveform besides by its phase and by white noise.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.stats
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.calibration.objective.measurement import DEFAULT_BAND, Measurement
from swashtwin.calibration.objective.spectrum_objective import (
    FLOOR,
    MODEL_ERROR,
    NONE,
    Comparison,
    Objective,
    objective_of,
)
from swashtwin.calibration.objective.unknowns import Nuisances, Unknowns
from swashtwin.foundation import DataError, InputError, stream
from swashtwin.physics import Twin

Input = Literal["lines", "waveform"]
REVOLUTIONS = 2
"""Length of the stretch of signal that is read, in revolutions of the shaft."""
NOISE = (FLOOR, 20 * FLOOR)
"""Standard deviations of a line [m/s^2] beside the model's error, from which each showing draws one."""
SNR = (20.0, 50.0)
"""Signal-to-noise ratios [dB] from which each showing of a waveform draws one."""
_BATCH = 200
"""Twins simulated together; memory only, no result depends on it."""


@dataclass(frozen=True, eq=False)
class Shown:
    """What the network is given."""

    signal: Float[Tensor, "twin *shape"]
    """Logarithms of line amplitudes, or windows over their common RMS."""
    level: Float[Tensor, "twin 1"]
    """Logarithm of the noise of the lines, or of the windows' RMS."""


@dataclass(frozen=True, eq=False)
class Simulated:
    """Twins as they would be measured without any noise."""

    amplitude: Float[Tensor, "twin reading"]
    """Line amplitudes [m/s^2], float32."""
    lines: Complex[Tensor, "twin channel order"] | None
    """Complex lines up to the last one measured, channels of all conditions below each other; None if not read."""


def objective_without_recordings(
    twins: Twin | Sequence[Twin],
    channels: Sequence[str] | None = None,
    *,
    band: tuple[float, float] = DEFAULT_BAND,
    bounds: float | None = None,
    nuisances: Nuisances = NONE,
) -> Objective:
    """Objective like those of coming measurements, to train an amortized network before anything is measured.

    Its measurement is the twin's own lines, without scatter.

    Parameters
    ----------
    twins : one, or several that differ in condition only.
    channels : those that will be measured; None takes all of the pump's sensors.
    band, bounds, nuisances : as `calibrate` will be given them.
    """
    twins = [twins] if isinstance(twins, Twin) else list(twins)
    names = twins[0].pump.channels if channels is None else tuple(channels)
    if strange := [name for name in names if name not in twins[0].pump.channels]:
        raise InputError(f"the pump has no sensor {strange[0]!r}; it has {', '.join(twins[0].pump.channels)}.")
    return objective_of(twins, [_own(twin, names, band) for twin in twins], bounds, nuisances)


def _own(twin: Twin, channels: tuple[str, ...], band: tuple[float, float]) -> Measurement:
    count, shaft = twin.pump.rotating_group.piston_count, twin.condition.shaft_frequency
    reaching = replace(twin, bandwidth=max(band[1], count * shaft), path=None)
    orders = count * np.arange(1, int(band[1] / (count * shaft)) + 1)
    orders = orders[(orders * shaft >= band[0]) & np.isin(orders, reaching.orders)]
    if not len(orders):
        raise InputError(f"band {band} Hz holds no multiple of the piston-pass frequency ({count * shaft:.1f} Hz).")
    rows = [twin.pump.channels.index(name) for name in channels]
    with torch.no_grad():
        lines = reaching.acceleration().abs().numpy()[rows][:, np.isin(reaching.orders, orders)]
    return Measurement(channels, orders, lines, np.zeros_like(lines), (), (), (float(band[0]), float(band[1])))


def points_drawn(unknowns: Unknowns, count: int, seed: int) -> Float[np.ndarray, "twin unknown"]:
    """Points drawn from the prior: evenly where only bounds are known, else normally, cut at the bounds."""
    generator = stream(seed, "amortized", "prior")
    lower, upper, deviation = unknowns.lower, unknowns.upper, unknowns.deviation
    share = generator.uniform(size=(count, len(unknowns)))
    even = lower + (upper - lower) * share
    ends = (lower - unknowns.center) / deviation, (upper - unknowns.center) / deviation
    normal = scipy.stats.truncnorm(*ends, loc=unknowns.center, scale=deviation).ppf(share)
    only_bounds = deviation > 0.999 * (upper - lower) / math.sqrt(12)
    return np.clip(np.where(only_bounds, even, normal), lower, upper)


def simulated(objective: Objective, points: Float[np.ndarray, "twin unknown"], read: Input) -> Simulated:
    """Lines of the twins at `points`, a few hundred at a time."""
    amplitudes, lines = [], []
    with torch.no_grad():
        for part in torch.as_tensor(points).split(_BATCH):
            amplitudes.append(objective.amplitude(part).float())
            if read == "waveform":
                lines.append(torch.cat([_lines(objective, one, part) for one in objective.comparisons], dim=1))
    return Simulated(torch.cat(amplitudes), torch.cat(lines) if lines else None)


def _lines(objective: Objective, comparison: Comparison, points: Tensor) -> Complex[Tensor, "twin channel order"]:
    """Lines at all orders from 0 on, in the precision of a network; zero where the twin has none."""
    twin, unknowns = comparison.twin, objective.unknowns
    rows = [twin.pump.channels.index(name) for name in comparison.measurement.channels]
    lines = twin.acceleration(unknowns.values_of(points), scales=unknowns.scales_of(points))[:, rows]
    path = unknowns.response_of(points, torch.as_tensor(twin.orders * twin.condition.shaft_frequency))
    full = torch.zeros(*lines.shape[:2], _highest(objective) + 1, dtype=torch.complex64)
    full[:, :, torch.as_tensor(twin.orders)] = (lines if path is None else lines * path).to(torch.complex64)
    return full


def _highest(objective: Objective) -> int:
    """Highest order of any condition's twin."""
    return max(int(one.twin.orders[-1]) for one in objective.comparisons)


def _length(highest: int) -> int:
    """Readings of a window whose highest line has this order."""
    return REVOLUTIONS << math.ceil(math.log2(2.5 * highest))


def shown(twins: Simulated, chosen: Int[Tensor, " chosen"], read: Input, generator: torch.Generator) -> Shown:
    """The `chosen` twins as one measurement each would show them."""
    low, high = (math.log(end) for end in NOISE)
    level = low + (high - low) * torch.rand(len(chosen), 1, generator=generator)
    if read == "lines":
        return Shown(compressed(corrupted(twins.amplitude[chosen], level.exp(), generator)), level)
    assert twins.lines is not None  # `simulated` was given the same `read`
    return Shown(*_scaled(_window(twins.lines[chosen], generator)))


def corrupted(
    amplitude: Float[Tensor, "twin reading"], noise: Float[Tensor, "*#twin"], generator: torch.Generator
) -> Float[Tensor, "twin reading"]:
    """Amplitudes off by the model's error and by `noise` [m/s^2]."""
    sigma = ((MODEL_ERROR * amplitude).square() + noise.square()).sqrt()
    return (amplitude + sigma * torch.randn(amplitude.shape, generator=generator)).abs()


def noise_level(objective: Objective) -> float:
    """Logarithm of the measurement's noise [m/s^2], within what networks are trained on."""
    variance = np.concatenate([one.measurement.deviation.ravel() ** 2 for one in objective.comparisons])
    return math.log(np.clip(math.sqrt(FLOOR**2 + float(np.mean(variance))), *NOISE))


def measured(objective: Objective, read: Input) -> Shown:
    """What the network is given of the objective's measurement.

    Raises
    ------
    DataError
        A window is read, and a recording is shorter than it.
    """
    if read == "lines":
        return Shown(compressed(objective.measured.float()[None]), torch.tensor([[noise_level(objective)]]))
    windows = np.concatenate([_measured_window(one, _highest(objective)) for one in objective.comparisons])
    return Shown(*_scaled(torch.as_tensor(windows, dtype=torch.float32)[None]))


def compressed(amplitude: Float[Tensor, "twin reading"]) -> Float[Tensor, "twin reading"]:
    """Logarithms of amplitudes [m/s^2], even below the floor: a line's error is then much the same everywhere."""
    return (amplitude.square() + FLOOR**2).log() / 2


def _scaled(window: Tensor) -> tuple[Tensor, Tensor]:
    rms = window.square().mean(dim=(-2, -1), keepdim=True).sqrt() + 1e-12
    return window / rms, rms[:, :, 0].log()


def _window(lines: Tensor, generator: torch.Generator) -> Float[Tensor, "twin channel time"]:
    """Two revolutions from a random angle on, each line off by the model's error, in white noise of their band."""
    highest = lines.shape[-1] - 1
    angle = 2 * math.pi * torch.rand(len(lines), 1, 1, generator=generator)
    error = torch.view_as_complex(torch.randn(*lines.shape, 2, generator=generator)) * MODEL_ERROR
    turned = lines * torch.polar(torch.ones(()), angle * torch.arange(highest + 1)) * (1 + error)
    ratio = SNR[0] + (SNR[1] - SNR[0]) * torch.rand(len(lines), 1, 1, generator=generator)
    power = turned.abs().square().sum(dim=-1, keepdim=True) / (REVOLUTIONS * highest) * 10 ** (-ratio / 10)
    spectrum = torch.randn(*lines.shape[:2], REVOLUTIONS * highest + 1, 2, generator=generator)
    full = torch.view_as_complex(spectrum) * (power / 2).sqrt()
    full[..., ::REVOLUTIONS] += turned
    full[..., 0] = 0
    return torch.fft.irfft(full * (_length(highest) / 2), _length(highest))


def _measured_window(comparison: Comparison, highest: int) -> Float[np.ndarray, "channel time"]:
    """Start of the first recording, without its mean and what lies above the highest order."""
    if not comparison.measurement.recordings:
        raise DataError("the objective has no recording, of which the network would read a stretch.")
    recording = comparison.measurement.recordings[0]
    length = round(REVOLUTIONS * comparison.twin.condition.period * recording.sample_rate)
    if length > recording.signal.shape[1]:
        raise DataError(
            f"{recording.recording_id} ({recording.duration:.4g} s) is shorter than the {REVOLUTIONS} revolutions that "
            "the network reads."
        )
    spectrum = np.fft.rfft(recording.signal[:, :length])[:, : REVOLUTIONS * highest + 1]
    spectrum[:, 0] = 0
    return np.fft.irfft(spectrum, _length(highest)) * (_length(highest) / length)
