"""How a network is trained: settings, transforms of windows drawn anew in each epoch, and its
losses.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from typing import Any, get_args

import numpy as np
import scipy
from jaxtyping import Float32, Int

from swashtwin.foundation import InputError, random_stream
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import NoiseKind, unit_noise

NORMALIZATIONS = ("window", "set", "none")
"""Over what the mean and the deviation are taken that windows are scaled by; see
`Normalization`.
"""

DECAYS = ("none", "cosine")
"""How the learning rate changes over the epochs."""

PRECISIONS = ("float32", "bfloat16")
"""Number formats of the network in training."""

_OFTEN_USUAL = ("noise_snr", "noise_kinds", "noise_share", "gain", "stretch", "precision")
"""Settings that are written only where they differ from their defaults."""

_WIDEST, _LOUDEST = 0.2, 40.0
"""Largest change of speed [1], and of gain [dB], that are still the same machine and sensor."""


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of one training run with Adam and the cross-entropy of the classes.

    Epochs, batch and learning rate default to the paper's (DOI 10.1177/00202940261419020); the rest
    is our reading, since the paper does not say.
    """

    epochs: int = 200
    """Passes over the training windows. The last one is what comes back, never the one best on test
    data.
    """
    batch_size: int = 30
    """Windows per step; a last one of a single window joins the step before."""
    learning_rate: float = 1e-3
    decay: str = "none"
    """``"none"`` keeps the learning rate, as the paper does; ``"cosine"`` lets it fall to nothing
    over the epochs (our addition), so that the last epoch does not depend on where its last steps
    jumped.
    """
    class_weights: bool = False
    """Whether each class counts the same in the loss: a window of class c weighs n / (C n_c)."""
    normalization: str = "window"
    """``"window"``, ``"set"`` or ``"none"``. Per window is the default because gain and mounting
    differ between machines, and between twin and machine; it hides what a fault does to the overall
    level.
    """
    noise_snr: float | None = None
    """Least signal-to-noise ratio [dB] of the noise that windows of each epoch get, drawn anew
    (`with_noise`); None adds none."""
    noise_kinds: Sequence[NoiseKind] = ("white",)
    """Kinds of that noise (`signals.add_noise`); each window gets one of them, all alike likely."""
    noise_share: float = field(default=0.5, repr=False)
    """Share of the windows of each epoch that get that noise, above 0 and at most 1."""
    gain: float = 0.0
    """Largest gain and loss [dB] of each channel of half the windows of each epoch, drawn anew; 0
    for none.
    """
    stretch: float = 0.0
    """Largest change of speed, relative, of half the windows of each epoch, drawn anew, as if the
    shaft turned a little faster or slower (`at_other_speeds`); 0 for none.
    """
    precision: str = field(
        default="float32", repr=False
    )  # finished runs of earlier versions are found by the repr
    """``"bfloat16"`` lets convolutions and dense layers compute in 16 bits while they are trained
    (torch's autocast): faster where the processor has such instructions. Weights, losses and
    predictions stay in 32 bits.
    """

    def __post_init__(self) -> None:
        object.__setattr__(self, "noise_kinds", tuple(self.noise_kinds))
        kinds, snr = get_args(NoiseKind), self.noise_snr
        for name, fits, right in (
            ("epochs", self.epochs >= 1, "at least 1"),
            (
                "batch_size",
                self.batch_size >= 2,
                "at least 2: networks scale by the deviation within a batch",
            ),
            ("learning_rate", 0 < self.learning_rate < math.inf, "a positive number, such as 1e-3"),
            ("decay", self.decay in DECAYS, f"one of {', '.join(DECAYS)}"),
            (
                "normalization",
                self.normalization in NORMALIZATIONS,
                f"one of {', '.join(NORMALIZATIONS)}",
            ),
            ("precision", self.precision in PRECISIONS, f"one of {', '.join(PRECISIONS)}"),
            (
                "stretch",
                0 <= self.stretch <= _WIDEST,
                f"between 0 and {_WIDEST:g}; 0.02 is 2 % of the speed",
            ),
            ("gain", 0 <= self.gain <= _LOUDEST, f"between 0 and {_LOUDEST:g} dB; 3 is usual"),
            (
                "noise_kinds",
                self.noise_kinds and set(self.noise_kinds) <= {*kinds},
                f"some of {', '.join(kinds)}",
            ),
            ("noise_share", 0 < self.noise_share <= 1, "above 0 and at most 1; 0.5 is half"),
            ("noise_snr", snr is None or math.isfinite(snr), "a finite ratio in dB, such as 0"),
        ):
            if not fits:
                value = getattr(self, name)
                shown = f"{value:g}" if isinstance(value, float) else value
                raise InputError(f"{name} ({shown}) must be {right}.")
        if self.gain and self.normalization == "window":
            raise InputError(
                "gain would change nothing, since normalization 'window' takes each window's own level away; take "
                "another normalization, such as 'set'."
            )

    def to_dict(self) -> dict[str, Any]:
        """Settings as JSON can hold them, without the transforms that change nothing and the usual
        precision.
        """
        usual = {item.name: item.default for item in fields(self) if item.name in _OFTEN_USUAL}
        return {
            name: value
            for name, value in asdict(self).items()
            if name not in usual or value != usual[name]
        }

    def learning_rate_in(self, epoch: int) -> float:
        """Learning rate in `epoch`, the first being 1."""
        if self.decay == "none":
            return self.learning_rate
        return self.learning_rate * (1 + math.cos(math.pi * (epoch - 1) / self.epochs)) / 2


PAPER_TRAINING = TrainingSettings()
"""The paper's training: 200 epochs, batches of 30, learning rate 1e-3."""

RECOMMENDED_TRAINING = TrainingSettings(
    epochs=30, batch_size=64, learning_rate=2e-3, decay="cosine", normalization="set"
)
"""Ours: a rate that falls to nothing is done in 30 epochs, and one scale for the whole training set
keeps the level, which a fault changes. Chosen on fleets 100 to 102 of the virtual rig, on which no
study is reported (docs/explanation/networks.md).
"""


@dataclass(frozen=True)
class Epoch:
    """Loss and accuracy of one pass over the training windows."""

    number: int
    """First epoch is 1."""
    loss: float
    """Mean cross-entropy over the training windows, while the weights move."""
    accuracy: float
    """Share of the training windows classified right, while the weights move."""


NOISE_SNR_RANGE_DB = 25.0
"""Width of the range of signal-to-noise ratios [dB], above the least one."""

Samples = Float32[np.ndarray, "window channel time"]
Change = Callable[[Samples, float, np.random.Generator], Samples]


def transform_windows(
    windows: WindowSet, settings: TrainingSettings, seed: int, epoch: int
) -> tuple[Int[np.ndarray, " changed"], WindowSet]:
    """(indices of the windows that an epoch changes, these windows as it uses them).

    Each transform of `settings` acts on a random half of the windows, noise on `noise_share` of
    them: `stretch` first, then `gain`, then `noise_snr`, in the order in which machine, sensor and
    cable act.
    """
    signal, changed = windows.signal, np.zeros(len(windows), dtype=bool)
    noisy = partial(with_noise, kinds=settings.noise_kinds, sample_rate=windows.sample_rate)
    transforms: dict[str, tuple[float | None, float, Change]] = {
        "stretch": (settings.stretch or None, 0.5, at_other_speeds),
        "gain": (settings.gain or None, 0.5, with_gains),
        "disturbance": (settings.noise_snr, settings.noise_share, noisy),
    }
    for purpose, (width, share, change) in transforms.items():
        if width is None:
            continue
        rng = random_stream(seed, purpose, epoch)
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
    """The windows with noise, each at a ratio of its own, uniform in dB from the least to 25 dB
    above.

    The signal's power is the variance of the window per channel, not of the recording as in tests
    (docs/explanation/method.md, "Noise"): a synthetic window has no recording. Of several `kinds`
    each window gets one, drawn; hum needs the sample rate [Hz].
    """
    ratio = least_snr + NOISE_SNR_RANGE_DB * rng.random((len(signal), 1, 1), dtype=np.float32)
    scale = np.sqrt(signal.var(axis=-1, keepdims=True) * 10 ** (-ratio / 10))
    if tuple(kinds) == ("white",):
        return (signal + scale * rng.standard_normal(signal.shape, dtype=np.float32)).astype(
            np.float32
        )
    noisy, kind_index = signal.copy(), rng.integers(len(kinds), size=len(signal))
    for index, kind in enumerate(kinds):
        which = np.flatnonzero(kind_index == index)
        noise = unit_noise(signal[which].shape, rng, kind, sample_rate).astype(np.float32)
        noisy[which] += scale[which] * noise
    return noisy


def with_gains(signal: Samples, largest: float, rng: np.random.Generator) -> Samples:
    """The windows with each channel louder or quieter, uniform in dB up to the largest ("scaling",
    DOI 10.1145/3136755.3136817).
    """
    gain = largest * rng.uniform(-1, 1, (*signal.shape[:2], 1))
    return (signal * 10 ** (gain / 20)).astype(np.float32)


def at_other_speeds(signal: Samples, largest: float, rng: np.random.Generator) -> Samples:
    """The windows as a shaft a little faster or slower would give them, by a share uniform within
    the largest.

    Time is stretched about the window's middle; what a window lacks at its ends is mirrored.
    Frequencies of the structure move with those of the shaft, which on a machine they do not.
    """
    middle = (signal.shape[-1] - 1) / 2
    time = np.arange(signal.shape[-1]) - middle
    positions = middle + (1 + largest * rng.uniform(-1, 1, (len(signal), 1))) * time
    return np.stack(
        [
            [
                scipy.ndimage.map_coordinates(channel, position[None], order=3, mode="mirror")
                for channel in window
            ]
            for window, position in zip(signal, positions, strict=True)
        ]
    )
