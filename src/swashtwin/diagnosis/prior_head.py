"""What a prior makes of a machine's recordings: levels at shaft orders, changes laid on healthy
scatter, a network.

Changes of measured and of virtual recordings alike are divided by the healthy scatter of their own
pump; the directions in which the machine's healthy recordings differ are shrunk by 1 / sqrt(1 + v /
lambda), v being the variance along each (as structural health monitoring removes temperature and
load: arXiv 2409.17735). Then a small network learns the classes of the virtual changes.
"""

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np
import scipy
from jaxtyping import Bool, Float, Float64, Int, Int64

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording
from swashtwin.signals import TURNS, OrderBands, recording_density, require_shaft_frequency

_SPEED_REACH = 0.012
"""How far the speed may be from what a recording states, relative."""
_LEAST_PASSES = 12
"""Piston passes that a sample rate must allow."""


def order_band_powers(
    recording: Recording, bands: OrderBands
) -> Float64[np.ndarray, "channel level"]:
    """Levels of each channel (`OrderBands.log_powers`), from power densities (Welch, Hann taper) of
    eight turns each.

    Lines of piston passes say the speed better than what was stated; orders are those of the speed
    that they say. Levels of bands beyond half the sample rate are NaN.

    Raises
    ------
    DataError
        The recording is unfit, shorter than eight turns, states no speed, or its rate is too low
        for the first bands.
    """
    shaft, rate = require_shaft_frequency(recording), float(recording.sample_rate)
    lowest = _LEAST_PASSES * bands.piston_count * shaft
    if lowest > rate / 2:
        raise DataError(
            f"{recording.recording_id} is sampled at {rate:g} Hz; a prior looks at {_LEAST_PASSES} piston passes at "
            f"least, which take {2 * lowest:.0f} Hz."
        )
    length = scipy.fft.next_fast_len(math.ceil(TURNS * rate / shaft), real=True)
    power, width = recording_density(recording, length) * (rate / length), rate / length / shaft
    return bands.log_powers(power, width / _speed_ratio(power, width, bands))


def _speed_ratio(
    power: Float64[np.ndarray, "channel cell"], width: float, bands: OrderBands
) -> float:
    """Speed over the stated one at which the piston passes stand out most."""
    ratios = 1 + np.linspace(-_SPEED_REACH, _SPEED_REACH, 97)
    passes = np.arange(1, bands.passes + 1) * bands.piston_count
    level = np.log10(np.maximum(power, 1e-30)).mean(axis=0)
    cells = ratios[:, None] * passes / width
    return float(ratios[np.interp(cells, np.arange(level.size), level).mean(axis=1).argmax()])


LAMBDA = 0.1
"""Variance, in squared healthy scatters, from which a healthy direction is shrunk; chosen on fleets
100-103 of both versions of the rig.
"""
TEMPERATURE = 1.5
"""Divides the network's logits: on virtual pumps whose program of effects taught nothing, the
likelihood is flat from 1.1 to 1.6.
"""
UNKNOWN_RATE = 0.05
"""Share of virtual recordings of the prior's own classes that are called unlike them."""
MOVED = 1.5
"""Root mean square of the lines' changes, in healthy scatters, up to which only the noise floor
counts as changed.
"""
FEW_SHOT_WEIGHT = 30.0
"""What a measured fault counts against a virtual recording."""
_USUAL = 6
"""Recordings for which the usual scatter of virtual pumps counts in a pump's own."""
_REFERENCES = 4
"""Recordings that a virtual pump's own scatter comes from."""
_HELD_OUT = 7
"""Every so manyth virtual pump teaches nothing and says what is unlike the prior."""
_UNITS, _EPOCHS = 64, 24


@dataclass(frozen=True, eq=False)
class VirtualChanges:
    """Changes of virtual pumps, as `synthesis.OrderChanges` has them."""

    change: Float[np.ndarray, "row channel level"]
    """Change of each recording."""
    target: Int[np.ndarray, " row"]
    """Its class; the last class is whatever is none of the others."""
    number: Int[np.ndarray, " row"]
    """Row of its pump."""
    scatter: Float[np.ndarray, "pump channel level"]
    """Healthy scatter of each pump."""
    drawn: Bool[np.ndarray, " pump"]
    """Whether a pump has a drawing of its own."""

    def require_shape(self, n_channels: int, n_band_powers: int, n_classes: int) -> None:
        """Refuse arrays that do not fit each other."""
        rows, pumps, shape = len(self.change), len(self.scatter), (n_channels, n_band_powers)
        if (
            self.change.shape[1:] != shape
            or self.scatter.shape[1:] != shape
            or len(self.drawn) != pumps
        ):
            raise InputError("its virtual pumps do not fit the channels and levels.")
        for values, limit in ((self.target, n_classes), (self.number, pumps)):
            if values.shape != (rows,) or (rows and not 0 <= values.min() <= values.max() < limit):
                raise InputError("its virtual recordings do not fit their classes and pumps.")

    def of(self, pumps: Bool[np.ndarray, " pump"], channels: list[int]) -> "VirtualChanges":
        """Those of some pumps and channels in double precision."""
        rows = pumps[self.number]
        number = (np.cumsum(pumps) - 1)[self.number[rows]]
        change, scatter = (
            part[:, channels].astype(float) for part in (self.change[rows], self.scatter[pumps])
        )
        return VirtualChanges(change, self.target[rows], number, scatter, self.drawn[pumps])

    def measured(self, band_powers: Bool[np.ndarray, "channel level"]) -> "VirtualChanges":
        """The same, zero in levels that a machine's recordings lack."""
        return replace(self, change=self.change * band_powers, scatter=self.scatter * band_powers)


@dataclass(frozen=True, eq=False)
class PriorHead:
    """What maps changes of one machine to classes."""

    scale: Float64[np.ndarray, " column"]
    """Healthy scatter of each level; 0 for one that is not looked at."""
    line_scale: Float64[np.ndarray, " line"]
    """The same of the lines (`_lines`)."""
    direction: Float64[np.ndarray, "direction column"]
    """Directions in which healthy recordings differ."""
    shrinkage: Float64[np.ndarray, " direction"]
    """What is taken away along each."""
    inner: Float64[np.ndarray, "column unit"]
    """Weights of the first layer."""
    inner_bias: Float64[np.ndarray, " unit"]
    """Their biases."""
    outer: Float64[np.ndarray, "unit class"]
    """Weights of the second layer."""
    outer_bias: Float64[np.ndarray, " class"]
    """Their biases."""
    strange: Float64[np.ndarray, " recording"]
    """Probability of the last class for virtual recordings of the others that taught nothing,
    rising.
    """

    def require_shape(self, width: int, n_classes: int) -> None:
        """Refuse arrays that do not fit each other."""
        units = len(self.inner_bias)
        fits = (
            self.inner.shape == (width, units)
            and self.outer.shape == (units, n_classes)
            and self.outer_bias.shape == (n_classes,)
            and self.direction.shape == (self.shrinkage.size, width)
            and self.scale.shape == (width,)
        )
        if not fits:
            raise InputError("its network does not fit the classes and levels.")

    def predict_proba(
        self, change: Float[np.ndarray, "row channel level"]
    ) -> Float64[np.ndarray, "row class"]:
        """Probability of each class."""
        return self._answer(_columns(_flat(change), self.scale, self.direction, self.shrinkage))

    def _answer(self, columns: Float[np.ndarray, "row column"]) -> Float64[np.ndarray, "row class"]:
        hidden = np.maximum(columns @ self.inner + self.inner_bias, 0)
        logits = (hidden @ self.outer + self.outer_bias) / TEMPERATURE
        shares = np.exp(logits - logits.max(axis=-1, keepdims=True))
        return np.asarray(shares / shares.sum(axis=-1, keepdims=True))

    def lines_moved(self, change: Float[np.ndarray, "channel level"], bands: OrderBands) -> bool:
        """Whether lines changed more than between healthy recordings, rather than the noise floor
        alone.
        """
        scaled = _scaled(_lines(change[None], bands), self.line_scale)[0, self.line_scale > 0]
        return bool(np.mean(scaled**2) > MOVED**2)

    def p_value(self, probability: float) -> float:
        """Share of virtual recordings of the classes whose probability of being none of them is as
        high as this one.
        """
        above = self.strange.size - int(np.searchsorted(self.strange, probability * (1 - 1e-9)))
        return (above + 1) / (self.strange.size + 1)


def fit_head(
    virtual: VirtualChanges,
    healthy: Float64[np.ndarray, "change channel level"],
    bands: OrderBands,
    measured: Float64[np.ndarray, "fault channel level"],
    target: Int64[np.ndarray, " fault"],
    *,
    seed: int = 0,
) -> PriorHead:
    """Head of a machine from the changes of its healthy recordings among each other, and from
    measured faults if any.

    Parameters
    ----------
    healthy : scaled to the variance of a single recording; NaN in levels that the sample rate does
        not allow.
    bands : of the levels.
    measured, target : changes of measured faults and their classes.
    """
    from sklearn.neural_network import MLPClassifier

    usual = virtual.change[virtual.target == 0]
    scale, line_scale = (
        _scatter(_flat(usual), _flat(healthy)),
        _scatter(_lines(usual, bands), _lines(healthy, bands)),
    )
    mean_square = np.mean(_flat(usual) ** 2, axis=0)
    of_pumps = np.sqrt(
        (_USUAL * mean_square + _REFERENCES * _flat(virtual.scatter) ** 2) / (_USUAL + _REFERENCES)
    )
    of_pumps[:, scale == 0] = 0
    scaled = _scaled(_flat(healthy), scale)
    _, root, direction = np.linalg.svd(scaled, full_matrices=False)
    shrinkage = 1 - 1 / np.sqrt(1 + root**2 / max(len(scaled), 1) / LAMBDA)
    teaches = virtual.number % _HELD_OUT > 0
    rows = _columns(_flat(virtual.change), of_pumps[virtual.number], direction, shrinkage)
    of_machine = _columns(_flat(np.concatenate([measured, healthy])), scale, direction, shrinkage)
    classes = np.concatenate(
        [virtual.target[teaches], target, np.zeros(len(healthy), dtype=np.int64)]
    )
    n_classes = int(virtual.target.max()) + 1
    weight = np.where(np.isin(np.arange(n_classes), (0, n_classes - 1)), 0.5, 1.0)[classes]
    weight[teaches.sum() :] = np.where(classes[teaches.sum() :] == 0, 1.0, FEW_SHOT_WEIGHT)
    network = MLPClassifier(
        (_UNITS,), alpha=1.0, learning_rate_init=2e-3, batch_size=128, max_iter=_EPOCHS, tol=0.0,
        n_iter_no_change=_EPOCHS + 1, random_state=seed % 2**32,
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it is stopped early on purpose
        network.fit(
            np.concatenate([rows[teaches], of_machine]).astype(np.float32),
            classes,
            sample_weight=weight,
        )
    (inner, outer), (inner_bias, outer_bias) = (
        [part.astype(np.float64) for part in layers]
        for layers in (network.coefs_, network.intercepts_)
    )
    layers = (inner, inner_bias, outer, outer_bias)
    head = PriorHead(scale, line_scale, direction, shrinkage, *layers, np.empty(0))
    left_out = rows[~teaches & (virtual.target < n_classes - 1)]
    return replace(head, strange=np.sort(head._answer(left_out)[:, -1]))


def _flat(values: Float[np.ndarray, "row channel level"]) -> Float[np.ndarray, "row column"]:
    return values.reshape(len(values), math.prod(values.shape[1:]))


def _lines(
    change: Float[np.ndarray, "row channel level"], bands: OrderBands
) -> Float[np.ndarray, "row line"]:
    """Shaft orders, piston passes, and what rises above the floor between them."""
    below = change.shape[-1] - 2 * bands.n_floors
    single, broad, floor = np.split(change, [below, below + bands.n_floors], axis=-1)
    return _flat(np.concatenate([single, broad - floor], axis=-1))


def _scatter(
    usual: Float[np.ndarray, "row column"], healthy: Float64[np.ndarray, "change column"]
) -> Float64[np.ndarray, " column"]:
    """Healthy scatter of a machine, the usual one counting for some recordings; 0 where it has no
    level.
    """
    squares = _USUAL * np.mean(usual**2, axis=0) + (healthy**2).sum(axis=0)
    return np.nan_to_num(np.sqrt(squares / (_USUAL + len(healthy))))


def _scaled(
    rows: Float[np.ndarray, "row column"], scale: Float64[np.ndarray, "*#row column"]
) -> Float64[np.ndarray, "row column"]:
    return np.divide(
        rows, scale, out=np.zeros(rows.shape), where=np.broadcast_to(scale > 0, rows.shape)
    )


def _columns(
    rows: Float[np.ndarray, "row column"],
    scale: Float64[np.ndarray, "*#row column"],
    direction: Float64[np.ndarray, "direction column"],
    shrinkage: Float64[np.ndarray, " direction"],
) -> Float64[np.ndarray, "row column"]:
    """What the network sees of changes."""
    scaled = _scaled(rows, scale)
    return np.arcsinh(scaled - ((scaled @ direction.T) * shrinkage) @ direction)
