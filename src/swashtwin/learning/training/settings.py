"""How a network is trained, and the loss of each epoch."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, get_args

from swashtwin.foundation import InputError
from swashtwin.signals import NoiseKind

NORMALIZATIONS = ("window", "set", "none")
"""Over what the mean and the deviation are taken that windows are scaled by; see `Normalization`."""

DECAYS = ("none", "cosine")
"""How the learning rate changes over the epochs."""

PRECISIONS = ("float32", "bfloat16")
"""Number formats of the network in training."""

_TRANSFORMS: Mapping[str, Any] = {
    "noise_snr": None,
    "noise_kinds": ("white",),
    "noise_share": 0.5,
    "gain": 0.0,
    "stretch": 0.0,
}
"""Settings that transform windows within an epoch, each with the value that leaves them as they are."""

_WIDEST, _LOUDEST = 0.2, 40.0
"""Largest change of speed [1], and of gain [dB], that are still the same machine and sensor."""


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of one training run with Adam and the cross-entropy of the classes.

    Epochs, batch and learning rate default to the paper's (DOI 10.1177/00202940261419020); the rest is our reading,
    since the paper does not say.
    """

    epochs: int = 200
    """Passes over the training windows. The last one is what comes back, never the one best on test data."""
    batch_size: int = 30
    """Windows per step; a last one of a single window joins the step before."""
    learning_rate: float = 1e-3
    """Step size of Adam."""
    decay: str = "none"
    """``"none"`` keeps the learning rate, as the paper does; ``"cosine"`` lets it fall to nothing over the epochs (our
    addition), so that the last epoch does not depend on where its last steps jumped."""
    class_weights: bool = False
    """Whether each class counts the same in the loss: a window of class c weighs n / (C n_c)."""
    normalization: str = "window"
    """``"window"``, ``"set"`` or ``"none"``. Per window is the default because gain and mounting
    differ between machines, and between twin and machine; it hides what a fault does to the overall level."""
    noise_snr: float | None = None
    """Least signal-to-noise ratio [dB] of the noise that windows of each epoch get, drawn anew
    (`train_transforms.with_noise`); None adds none."""
    noise_kinds: Sequence[NoiseKind] = ("white",)
    """Kinds of that noise (`signals.add_noise`); each window gets one of them, all alike likely."""
    noise_share: float = field(default=0.5, repr=False)
    """Share of the windows of each epoch that get that noise, above 0 and at most 1."""
    gain: float = 0.0
    """Largest gain and loss [dB] of each channel of half the windows of each epoch, drawn anew; 0 for none."""
    stretch: float = 0.0
    """Largest change of speed, relative, of half the windows of each epoch, drawn anew, as if the shaft turned a little
    faster or slower (`train_transforms.at_other_speeds`); 0 for none."""
    precision: str = field(default="float32", repr=False)  # finished runs of earlier versions are found by the repr
    """``"bfloat16"`` lets convolutions and dense layers compute in 16 bits while they are trained (torch's autocast):
    faster where the processor has such instructions. Weights, losses and predictions stay in 32 bits."""

    def __post_init__(self) -> None:
        if self.epochs < 1:
            raise InputError(f"epochs ({self.epochs}) must be at least 1.")
        if self.batch_size < 2:
            raise InputError(
                f"batch_size ({self.batch_size}) must be at least 2: networks scale by the deviation within a batch."
            )
        if not (math.isfinite(self.learning_rate) and self.learning_rate > 0):
            raise InputError(f"learning_rate ({self.learning_rate:g}) must be a positive number, such as 1e-3.")
        choices = {"decay": DECAYS, "normalization": NORMALIZATIONS, "precision": PRECISIONS}
        for name, options in choices.items():
            if getattr(self, name) not in options:
                raise InputError(f"{name} {getattr(self, name)!r} is none of {', '.join(options)}.")
        self._require_transforms()

    def _require_transforms(self) -> None:
        if not 0 <= self.stretch <= _WIDEST:
            raise InputError(f"stretch ({self.stretch:g}) must be between 0 and {_WIDEST:g}; 0.02 is 2 % of the speed.")
        if not 0 <= self.gain <= _LOUDEST:
            raise InputError(f"gain ({self.gain:g}) must be between 0 and {_LOUDEST:g} dB; 3 is usual.")
        object.__setattr__(self, "noise_kinds", tuple(self.noise_kinds))
        unknown = [kind for kind in self.noise_kinds if kind not in get_args(NoiseKind)]
        if unknown or not self.noise_kinds:
            raise InputError(
                f"noise_kinds ({', '.join(map(str, self.noise_kinds)) or 'none'}) are some of "
                f"{', '.join(get_args(NoiseKind))}."
            )
        if not 0 < self.noise_share <= 1:
            raise InputError(f"noise_share ({self.noise_share:g}) must be above 0 and at most 1; 0.5 is half.")
        if self.noise_snr is not None and not math.isfinite(self.noise_snr):
            raise InputError(f"noise_snr ({self.noise_snr:g}) must be a finite ratio in dB, such as 0.")
        if self.gain and self.normalization == "window":
            raise InputError(
                "gain would change nothing, since normalization 'window' takes each window's own level away; take "
                "another normalization, such as 'set'."
            )

    def to_dict(self) -> dict[str, Any]:
        """Settings as JSON can hold them, without the transforms that change nothing and the usual precision."""
        values, usual = asdict(self), {**_TRANSFORMS, "precision": PRECISIONS[0]}
        return {name: value for name, value in values.items() if name not in usual or value != usual[name]}

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
"""Ours: a rate that falls to nothing is done in 30 epochs, and one scale for the whole training set keeps the level,
which a fault changes. Chosen on fleets 100 to 102 of the virtual rig, on which no study is reported
(docs/explanation/networks.md)."""


@dataclass(frozen=True)
class Epoch:
    """Loss and accuracy of one pass over the training windows."""

    number: int
    """First epoch is 1."""
    loss: float
    """Mean cross-entropy over the training windows, while the weights move."""
    accuracy: float
    """Share of the training windows classified right, while the weights move."""
