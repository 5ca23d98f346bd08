"""Settings of a training, and the transforms of windows that are drawn anew in each epoch."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, get_args

import numpy as np
import scipy
from jaxtyping import Float32, Int

from swashtwin.foundation import InputError, random_stream
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import NoiseKind, unit_noise

NORMALIZATIONS = ("window", "set", "none")
"""Sources of the mean and the deviation by which windows are scaled; see `Normalization`."""

DECAYS = ("none", "cosine")
"""How the learning rate changes over the epochs."""

PRECISIONS = ("float32", "bfloat16")
"""Number formats of the network in training."""

# Settings that are written only if they differ from their defaults.
_OMITTED_DEFAULTS = ("noise_snr", "noise_kinds", "noise_share", "gain", "stretch", "precision")

# Largest relative change of speed of what is still the same machine.
_MAX_STRETCH = 0.2

# Largest change of gain of what is still the same sensor.
_MAX_GAIN_DB = 40.0


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of one training run with Adam and the cross-entropy of the classes.

    Epochs, batch and learning rate default to the paper's (DOI 10.1177/00202940261419020); the
    others are our reading, since the paper does not state them.
    """

    epochs: int = 200
    """Passes over the training windows. The result is the state after the last one, never that of
    the best one on test data.
    """
    batch_size: int = 30
    """Windows per step; a last one of a single window joins the step before."""
    learning_rate: float = 1e-3
    decay: str = "none"
    """``"none"`` keeps the learning rate, as the paper does; ``"cosine"`` lets it fall to nothing
    over the epochs (our addition), so that the result does not depend on its last steps.
    """
    class_weights: bool = False
    """Whether each class has the same weight in the loss: a window of class c n / (C n_c)."""
    normalization: str = "window"
    """``"window"``, ``"set"`` or ``"none"``. Per window is the default because gain and mounting
    differ between machines, and between twin and machine; it hides what a fault does to the overall
    level.
    """
    noise_snr: float | None = None
    """Minimum signal-to-noise ratio [dB] of the noise added to windows, drawn anew in each epoch
    (`with_noise`); None adds none.
    """
    noise_kinds: Sequence[NoiseKind] = ("white",)
    """Kinds of that noise (`signals.add_noise`); each window gets one of them, with equal
    probability.
    """
    noise_share: float = field(default=0.5, repr=False)
    """Share of the windows of each epoch that get that noise, above 0 and at most 1."""
    gain: float = 0.0
    """Largest gain and loss [dB] of each channel of half the windows, drawn anew in each epoch; 0
    for none.
    """
    stretch: float = 0.0
    """Largest relative change of speed of half the windows, drawn anew in each epoch, as if the
    shaft turned a little faster or slower (`with_speed_changes`); 0 for none.
    """
    # Not in the repr, by which finished runs of earlier versions are recognized.
    precision: str = field(default="float32", repr=False)
    """``"bfloat16"`` lets convolutions and dense layers compute in 16 bits while they are trained
    (torch's autocast), which is faster on processors with such instructions. Weights, losses and
    predictions stay in 32 bits.
    """

    def __post_init__(self) -> None:
        object.__setattr__(self, "noise_kinds", tuple(self.noise_kinds))
        kinds = get_args(NoiseKind)
        snr = self.noise_snr

        self._require("epochs", self.epochs >= 1, "at least 1")
        self._require(
            "batch_size",
            self.batch_size >= 2,
            "at least 2: networks scale by the deviation within a batch",
        )
        self._require(
            "learning_rate",
            0 < self.learning_rate < math.inf,
            "a positive number, such as 1e-3",
        )
        self._require_one_of("decay", DECAYS)
        self._require_one_of("normalization", NORMALIZATIONS)
        self._require_one_of("precision", PRECISIONS)
        self._require(
            "stretch",
            0 <= self.stretch <= _MAX_STRETCH,
            f"between 0 and {_MAX_STRETCH:g}; 0.02 is 2 % of the speed",
        )
        self._require(
            "gain",
            0 <= self.gain <= _MAX_GAIN_DB,
            f"between 0 and {_MAX_GAIN_DB:g} dB; 3 is typical",
        )
        self._require(
            "noise_kinds",
            bool(self.noise_kinds) and set(self.noise_kinds) <= {*kinds},
            f"some of {', '.join(kinds)}",
        )
        self._require(
            "noise_share", 0 < self.noise_share <= 1, "above 0 and at most 1; 0.5 is half"
        )
        self._require(
            "noise_snr", snr is None or math.isfinite(snr), "a finite ratio in dB, such as 0"
        )
        if self.gain and self.normalization == "window":
            raise InputError(
                "gain would change nothing, since the normalization 'window' removes each window's "
                "level.",
                field="normalization",
                remedy="Set {normalization='set'}.",
            )

    def _require(self, name: str, is_valid: bool, allowed: str) -> None:
        if not is_valid:
            value = getattr(self, name)
            text = f"{value:g}" if isinstance(value, float) else value
            raise InputError(f"{name} ({text}) must be {allowed}.", field=name)

    def _require_one_of(self, name: str, values: Sequence[str]) -> None:
        self._require(name, getattr(self, name) in values, f"one of {', '.join(values)}")

    def to_dict(self) -> dict[str, Any]:
        """Return the settings as JSON can hold them.

        Transforms that change nothing and the default precision are left out.
        """
        defaults = {
            entry.name: entry.default for entry in fields(self) if entry.name in _OMITTED_DEFAULTS
        }
        table = asdict(self)
        for name, default in defaults.items():
            if table[name] == default:
                del table[name]
        return table

    def learning_rate_in(self, epoch: int) -> float:
        """Return the learning rate in `epoch`; the first is 1."""
        if self.decay == "none":
            return self.learning_rate
        progress = (epoch - 1) / self.epochs
        return self.learning_rate * (1 + math.cos(math.pi * progress)) / 2


PAPER_TRAINING = TrainingSettings()
"""The paper's training: 200 epochs, batches of 30, learning rate 1e-3."""

RECOMMENDED_TRAINING = TrainingSettings(
    epochs=30, batch_size=64, learning_rate=2e-3, decay="cosine", normalization="set"
)
"""Our training: a learning rate that falls to zero needs only 30 epochs, and one scale for the
whole training set keeps the overall level, which a fault changes. Chosen on fleets 100 to 102 of
the virtual rig, on which no study is reported (docs/explanation/networks.md).
"""


@dataclass(frozen=True)
class Epoch:
    """Loss and accuracy of one pass over the training windows."""

    number: int
    """The first epoch is 1."""
    loss: float
    """Mean cross-entropy over the training windows, while the weights move."""
    accuracy: float
    """Share of the training windows classified right, while the weights move."""


NOISE_SNR_RANGE_DB = 25.0
"""Width of the range of signal-to-noise ratios [dB], above the minimum."""

# Share of the windows of an epoch that each of these transforms changes.
_GAIN_AND_STRETCH_SHARE = 0.5

Samples = Float32[np.ndarray, "window channel time"]


def transform_windows(
    windows: WindowSet, settings: TrainingSettings, seed: int, epoch: int
) -> tuple[Int[np.ndarray, " changed"], WindowSet]:
    """Return the indices of the windows that an epoch changes, and these windows as it uses them.

    Each transform of `settings` acts on a random half of the windows, noise on `noise_share` of
    them: first `stretch`, then `gain`, then `noise_snr`, in the order in which machine, sensor and
    cable act.
    """
    is_changed = np.zeros(len(windows), dtype=bool)
    if not (settings.stretch or settings.gain or settings.noise_snr is not None):
        # No copy of the samples: most networks are trained without transforms.
        return np.flatnonzero(is_changed), windows.subset(is_changed)
    signal = windows.signal.copy()

    def draw(purpose: str, share: float) -> tuple[np.ndarray, np.random.Generator]:
        """Draw which windows a transform changes."""
        rng = random_stream(seed, purpose, epoch)
        rows = np.flatnonzero(rng.random(len(windows)) < share)
        is_changed[rows] = True
        return rows, rng

    if settings.stretch:
        rows, rng = draw("stretch", _GAIN_AND_STRETCH_SHARE)
        if rows.size:
            signal[rows] = with_speed_changes(signal[rows], settings.stretch, rng)
    if settings.gain:
        rows, rng = draw("gain", _GAIN_AND_STRETCH_SHARE)
        if rows.size:
            signal[rows] = with_gains(signal[rows], settings.gain, rng)
    if settings.noise_snr is not None:
        rows, rng = draw("disturbance", settings.noise_share)
        if rows.size:
            signal[rows] = with_noise(
                signal[rows], settings.noise_snr, rng, settings.noise_kinds, windows.sample_rate
            )

    changed_rows = np.flatnonzero(is_changed)
    return changed_rows, replace(windows.subset(changed_rows), signal=signal[changed_rows])


def with_noise(
    signal: Samples,
    min_snr: float,
    rng: np.random.Generator,
    kinds: Sequence[NoiseKind] = ("white",),
    sample_rate: float = 0.0,
) -> Samples:
    """Return the windows with noise, at a ratio drawn uniformly from the minimum to 25 dB above.

    The signal's power is the variance of the window per channel, not of the recording as in tests
    (docs/explanation/method.md, "Noise"): a synthetic window has no recording. With several `kinds`
    each window gets one of them, drawn; hum needs the sample rate [Hz].
    """
    ratio = min_snr + NOISE_SNR_RANGE_DB * rng.random((len(signal), 1, 1), dtype=np.float32)
    scale = np.sqrt(signal.var(axis=-1, keepdims=True) * 10 ** (-ratio / 10))
    if tuple(kinds) == ("white",):
        white = rng.standard_normal(signal.shape, dtype=np.float32)
        return (signal + scale * white).astype(np.float32)

    noisy = signal.copy()
    kind_index = rng.integers(len(kinds), size=len(signal))
    for index, kind in enumerate(kinds):
        rows = np.flatnonzero(kind_index == index)
        noise = unit_noise(signal[rows].shape, rng, kind, sample_rate).astype(np.float32)
        noisy[rows] += scale[rows] * noise
    return noisy


def with_gains(signal: Samples, max_gain: float, rng: np.random.Generator) -> Samples:
    """Return the windows with each channel louder or quieter, uniform in dB up to `max_gain`.

    This is "scaling" of DOI 10.1145/3136755.3136817.
    """
    gain = max_gain * rng.uniform(-1, 1, (*signal.shape[:2], 1))
    return (signal * 10 ** (gain / 20)).astype(np.float32)


def with_speed_changes(signal: Samples, max_change: float, rng: np.random.Generator) -> Samples:
    """Return the windows as at a slightly higher or lower speed of the shaft.

    The relative change is uniform within `max_change`. Time is stretched about the window's middle;
    samples missing at its ends are mirrored. Frequencies of the structure move with those of the
    shaft, which on a machine they do not.
    """
    middle = (signal.shape[-1] - 1) / 2
    time = np.arange(signal.shape[-1]) - middle
    factor = 1 + max_change * rng.uniform(-1, 1, (len(signal), 1))
    stretched = np.empty_like(signal)
    for row, positions in enumerate(middle + factor * time):
        for channel, samples in enumerate(signal[row]):
            stretched[row, channel] = scipy.ndimage.map_coordinates(
                samples, positions[None], order=3, mode="mirror"
            )
    return stretched
