"""Transforms of training windows, drawn anew in each epoch: another speed, other gains, noise.

A network does not come to rely on what changes from epoch to epoch: quiet bands that noise fills at a plant, the gain
of one sensor, the exact frequency of a line.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float32, Int
from scipy.ndimage import map_coordinates

from swashtwin.foundation import stream
from swashtwin.learning.training.settings import TrainingSettings
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import NoiseKind, unit_noise

RANGE = 25.0
"""Width of the range of signal-to-noise ratios [dB], above the least one."""

_NOISE = "disturbance"  # name of the random stream of the noise

Samples = Float32[np.ndarray, "window channel time"]
Change = Callable[[Samples, float, np.random.Generator], Samples]


def transform_windows(
    windows: WindowSet, settings: TrainingSettings, seed: int, epoch: int
) -> tuple[Int[np.ndarray, " changed"], WindowSet]:
    """(indices of the windows that an epoch changes, these windows as it uses them).

    Each transform of `settings` acts on a random half of the windows, noise on `noise_share` of them: `stretch` first,
    then `gain`, then `noise_snr`, in the order in which machine, sensor and cable act.
    """
    signal, changed = windows.signal, np.zeros(len(windows), dtype=bool)
    for purpose, width, change in _active_transforms(settings, windows.sample_rate):
        rng = stream(seed, purpose, epoch)
        share = settings.noise_share if purpose == _NOISE else 0.5
        which = np.flatnonzero(rng.random(len(windows)) < share)
        if not len(which):
            continue
        signal = signal.copy() if signal is windows.signal else signal
        signal[which] = change(signal[which], width, rng)
        changed[which] = True
    indices = np.flatnonzero(changed)
    return indices, replace(windows.subset(indices), signal=signal[indices])


def with_noise(
    signal: Samples,
    least_snr: float,
    rng: np.random.Generator,
    kinds: Sequence[NoiseKind] = ("white",),
    sample_rate: float = 0.0,
) -> Samples:
    """The windows with noise, each at a ratio of its own, uniform in dB from the least to 25 dB above.

    The signal's power is the variance of the window per channel, not of the recording as in tests
    (docs/explanation/method.md, "Noise"): a synthetic window has no recording. Of several `kinds` each window gets one,
    drawn; hum needs the sample rate [Hz].
    """
    ratio = least_snr + RANGE * rng.random((len(signal), 1, 1), dtype=np.float32)
    scale = np.sqrt(signal.var(axis=-1, keepdims=True) * 10 ** (-ratio / 10))
    if tuple(kinds) == ("white",):
        return (signal + scale * rng.standard_normal(signal.shape, dtype=np.float32)).astype(np.float32)
    noisy, kind_index = signal.copy(), rng.integers(len(kinds), size=len(signal))
    for index, kind in enumerate(kinds):
        which = np.flatnonzero(kind_index == index)
        noise = unit_noise(signal[which].shape, rng, kind, sample_rate).astype(np.float32)
        noisy[which] += scale[which] * noise
    return noisy


def with_gains(signal: Samples, largest: float, rng: np.random.Generator) -> Samples:
    """The windows with each channel louder or quieter, uniform in dB up to the largest ("scaling", DOI
    10.1145/3136755.3136817).
    """
    gain = largest * rng.uniform(-1, 1, (*signal.shape[:2], 1))
    return (signal * 10 ** (gain / 20)).astype(np.float32)


def at_other_speeds(signal: Samples, largest: float, rng: np.random.Generator) -> Samples:
    """The windows as a shaft a little faster or slower would give them, by a share uniform within the largest.

    Time is stretched about the window's middle; what a window lacks at its ends is mirrored. Frequencies of the
    structure move with those of the shaft, which on a machine they do not.
    """
    middle = (signal.shape[-1] - 1) / 2
    time = np.arange(signal.shape[-1]) - middle
    positions = middle + (1 + largest * rng.uniform(-1, 1, (len(signal), 1))) * time
    return np.stack(
        [
            [map_coordinates(channel, position[None], order=3, mode="mirror") for channel in window]
            for window, position in zip(signal, positions, strict=True)
        ]
    )


def _active_transforms(settings: TrainingSettings, sample_rate: float) -> list[tuple[str, float, Change]]:
    """(name of its random stream, largest change, function) of each transform in the settings, in order."""
    active: list[tuple[str, float, Change]] = []
    if settings.stretch:
        active.append(("stretch", settings.stretch, at_other_speeds))
    if settings.gain:
        active.append(("gain", settings.gain, with_gains))
    if settings.noise_snr is not None:
        noisy = partial(with_noise, kinds=settings.noise_kinds, sample_rate=sample_rate)
        active.append((_NOISE, settings.noise_snr, noisy))
    return active
