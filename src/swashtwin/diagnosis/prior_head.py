"""The network that a prior trains for one machine, on changes in units of its healthy scatter.

Changes of measured and of virtual recordings alike are divided by the healthy scatter of their own
pump. The directions in which the machine's healthy recordings differ are shrunk by 1 / sqrt(1 + v /
lambda), where v is the variance along each (as structural health monitoring removes temperature and
load: arXiv 2409.17735). Then a small network learns the classes of the virtual changes.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from jaxtyping import Bool, Float, Float64, Int, Int64

from swashtwin.foundation import DataError, InputError
from swashtwin.pump import SPEED_TOLERANCE
from swashtwin.recordings import Recording
from swashtwin.signals import TURNS, OrderBands, recording_density, require_shaft_frequency

# Relative deviations of the speed among which that of the piston passes is searched for, if it is
# not the specified one, and their number. Beyond, shaft orders beside the passes fit as well.
_MAX_OTHER_SPEED = 0.12
_N_OTHER_SPEEDS = 241

# Mean power of the passes at another speed, above that at the specified one [dB], from which the
# recording contradicts it: 11 dB or more at a speed that is 3 to 10 % wrong, and less than -8 dB in
# 130 recordings of versions 1 and 2 of the rig at the right one.
_MIN_OTHER_RISE_DB = 3.0

# Largest relative deviation of the speed from the one that a recording specifies.
_MAX_SPEED_DEVIATION = 0.012

_N_SPEED_CANDIDATES = 97

# Piston passes that must lie below half the sample rate.
_MIN_PASSES = 12

LAMBDA = 0.1
"""Variance, in squared healthy scatters, from which a healthy direction is shrunk; selected on
fleets 100-103 of both versions of the rig."""
TEMPERATURE = 1.5
"""Divides the network's logits. On virtual pumps whose program of effects was not trained, the
likelihood is flat from 1.1 to 1.6."""
UNKNOWN_RATE = 0.05
"""Share of virtual recordings of the prior's own classes that are called unknown."""
MIN_LINE_CHANGE = 1.5
"""Root mean square of the lines' changes, in healthy standard deviations, from which on a fault is
named: with less, most of the change is that of the noise floor."""
FEW_SHOT_WEIGHT = 30.0
"""Weight of a measured fault; that of a virtual recording of a fault is 1."""

BACKGROUND_WEIGHT = 0.5
"""Weight of virtual recordings that are healthy or of an unknown fault."""

# Recordings for which the typical scatter of virtual pumps counts in a pump's scatter.
_N_PRIOR_SCATTER = 6

# Recordings from which the scatter of a virtual pump is estimated.
_N_REFERENCES = 4

# Every 7th virtual pump is held out of the training, to learn which answers are unknown.
_HELD_OUT_INTERVAL = 7

_N_UNITS = 64
_N_EPOCHS = 24


@dataclass(frozen=True, eq=False)
class OrderSpectrum:
    """Power of a recording over shaft orders, if its shaft turns as fast as specified."""

    power: Float64[np.ndarray, "channel cell"]
    """Power of each channel in cells of the order axis [squared unit]."""
    order_width: float
    """Width of a cell [shaft orders]."""
    bands: OrderBands
    """Bands of orders in which the power is summed."""

    def band_powers(self, speed_ratio: float) -> Float64[np.ndarray, "channel level"]:
        """Return the powers of each channel in the bands [log10 of the squared unit].

        Powers of bands beyond half the sample rate are NaN.

        Parameters
        ----------
        speed_ratio : speed to which orders refer, over the specified one.
        """
        return self.bands.log_powers(self.power, self.order_width / speed_ratio)

    def refine_speed(self) -> float:
        """Return the speed near the specified one, over it, at which the passes are strongest."""
        ratios = 1 + np.linspace(-_MAX_SPEED_DEVIATION, _MAX_SPEED_DEVIATION, _N_SPEED_CANDIDATES)
        return float(ratios[self._pass_levels(ratios).argmax()])

    def find_other_speed(self) -> float | None:
        """Return the speed, over the specified one, that the passes show; None if they fit."""
        ratios = 1 + np.linspace(-_MAX_OTHER_SPEED, _MAX_OTHER_SPEED, _N_OTHER_SPEEDS)
        levels = self._pass_levels(ratios)

        is_specified = np.abs(ratios - 1) <= SPEED_TOLERANCE
        index = int(np.where(is_specified, -np.inf, levels).argmax())
        rise_db = 10 * (levels[index] - levels[is_specified].max())
        return float(ratios[index]) if rise_db >= _MIN_OTHER_RISE_DB else None

    def _pass_levels(self, ratios: Float64[np.ndarray, " speed"]) -> Float64[np.ndarray, " speed"]:
        """Return the mean log10 power at the piston passes if the speed is each of some ratios."""
        pass_orders = np.arange(1, self.bands.passes + 1) * self.bands.piston_count
        level = np.log10(np.maximum(self.power, 1e-30)).mean(axis=0)
        cells = ratios[:, None] * pass_orders / self.order_width
        return np.asarray(np.interp(cells, np.arange(level.size), level).mean(axis=1))


def compute_order_spectrum(recording: Recording, bands: OrderBands) -> OrderSpectrum:
    """Return the order spectrum of a recording.

    It comes from power densities (Welch, Hann taper) of eight turns each.

    Raises
    ------
    DataError
        The recording cannot be used, is shorter than eight turns, does not specify its speed, or
        its rate is too low for the first bands.
    """
    shaft = require_shaft_frequency(recording)
    rate = float(recording.sample_rate)
    max_frequency = _MIN_PASSES * bands.piston_count * shaft
    if max_frequency > rate / 2:
        raise DataError(
            f"{recording.recording_id} is sampled at {rate:g} Hz; a prior needs at least "
            f"{_MIN_PASSES} piston passes, so at least {2 * max_frequency:.0f} Hz."
        )

    length = scipy.fft.next_fast_len(math.ceil(TURNS * rate / shaft), real=True)
    line_width = rate / length
    power = recording_density(recording, length) * line_width
    return OrderSpectrum(power, line_width / shaft, bands)


def order_band_powers(
    recording: Recording, bands: OrderBands
) -> Float64[np.ndarray, "channel level"]:
    """Return the powers of each channel in bands of orders [log10 of the squared unit].

    The lines of the piston passes show the speed more exactly than the recording specifies it, and
    orders refer to the speed that they show. Powers of bands beyond half the sample rate are NaN.
    Errors: see `compute_order_spectrum`.
    """
    spectrum = compute_order_spectrum(recording, bands)
    return spectrum.band_powers(spectrum.refine_speed())


@dataclass(frozen=True, eq=False)
class VirtualChanges:
    """Changes of virtual pumps, with the fields of `synthesis.OrderChanges`."""

    change: Float[np.ndarray, "row channel level"]
    """Change of each recording."""
    target: Int[np.ndarray, " row"]
    """Its class; the last class is any other fault."""
    number: Int[np.ndarray, " row"]
    """Row of its pump."""
    scatter: Float[np.ndarray, "pump channel level"]
    """Healthy scatter of each pump."""
    drawn: Bool[np.ndarray, " pump"]
    """Whether a pump has its own random drawing, rather than the design's."""

    def require_shape(self, n_channels: int, n_levels: int, n_classes: int) -> None:
        """Raise an `InputError` if the arrays do not fit each other."""
        n_rows = len(self.change)
        n_pumps = len(self.scatter)
        shapes = {self.change.shape[1:], self.scatter.shape[1:]}
        if shapes != {(n_channels, n_levels)} or len(self.drawn) != n_pumps:
            raise InputError("its virtual pumps do not fit the channels and band powers.")

        for indices, limit in ((self.target, n_classes), (self.number, n_pumps)):
            is_within = not n_rows or 0 <= indices.min() <= indices.max() < limit
            if indices.shape != (n_rows,) or not is_within:
                raise InputError("its virtual recordings do not fit their classes and pumps.")

    def subset(self, pumps: Bool[np.ndarray, " pump"], channels: list[int]) -> "VirtualChanges":
        """Return the changes of some pumps and channels in double precision."""
        rows = pumps[self.number]
        new_numbers = np.cumsum(pumps) - 1
        return VirtualChanges(
            change=self.change[rows][:, channels].astype(float),
            target=self.target[rows],
            number=new_numbers[self.number[rows]],
            scatter=self.scatter[pumps][:, channels].astype(float),
            drawn=self.drawn[pumps],
        )

    def keep_measured(self, is_measured: Bool[np.ndarray, "channel level"]) -> "VirtualChanges":
        """Return the same, with zeros for band powers that a machine's recordings lack."""
        return replace(self, change=self.change * is_measured, scatter=self.scatter * is_measured)


@dataclass(frozen=True, eq=False)
class MeasuredChanges:
    """Changes of measured recordings that a network learns from beside the virtual ones."""

    change: Float64[np.ndarray, "row channel level"]
    """Change of each recording."""
    target: Int64[np.ndarray, " row"]
    """Its class."""
    scatter: Float64[np.ndarray, "row column"]
    """Healthy scatter of its machine (`machine_scatter`)."""
    weight: Float64[np.ndarray, " row"]
    """How much it counts; a virtual recording of a fault counts 1."""


def join_measured(parts: Sequence[MeasuredChanges]) -> MeasuredChanges:
    """Return the rows of several parts."""
    return MeasuredChanges(
        change=np.concatenate([part.change for part in parts]),
        target=np.concatenate([part.target for part in parts]),
        scatter=np.concatenate([part.scatter for part in parts]),
        weight=np.concatenate([part.weight for part in parts]),
    )


@dataclass(frozen=True, eq=False)
class PriorHead:
    """Network from changes of one machine to classes."""

    scale: Float64[np.ndarray, " column"]
    """Healthy scatter of each band power; 0 for one that is not used."""
    line_scale: Float64[np.ndarray, " line"]
    """The same of the lines (`_line_changes`)."""
    direction: Float64[np.ndarray, "direction column"]
    """Directions in which healthy recordings differ."""
    shrinkage: Float64[np.ndarray, " direction"]
    """Share that is removed along each direction."""
    inner: Float64[np.ndarray, "column unit"]
    """Weights of the first layer."""
    inner_bias: Float64[np.ndarray, " unit"]
    """Biases of the first layer."""
    outer: Float64[np.ndarray, "unit class"]
    """Weights of the second layer."""
    outer_bias: Float64[np.ndarray, " class"]
    """Biases of the second layer."""
    unknown_scores: Float64[np.ndarray, " recording"]
    """Probability of the last class for held-out virtual recordings of the other classes,
    ascending."""

    def require_shape(self, width: int, n_classes: int) -> None:
        """Raise an `InputError` if the arrays do not fit each other."""
        n_units = len(self.inner_bias)
        fits = (
            self.inner.shape == (width, n_units)
            and self.outer.shape == (n_units, n_classes)
            and self.outer_bias.shape == (n_classes,)
            and self.direction.shape == (self.shrinkage.size, width)
            and self.scale.shape == (width,)
        )
        if not fits:
            raise InputError("its network does not fit the classes and band powers.")

    def predict_proba(
        self, change: Float[np.ndarray, "row channel level"]
    ) -> Float64[np.ndarray, "row class"]:
        """Return the probability of each class."""
        inputs = _network_inputs(_flatten(change), self.scale, self.direction, self.shrinkage)
        return self.answer_inputs(inputs)

    def answer_machine(
        self,
        change: Float[np.ndarray, "row channel level"],
        scatter: Float64[np.ndarray, " column"],
    ) -> Float64[np.ndarray, "row class"]:
        """Return the probability of each class for another machine, by its healthy scatter."""
        scale = np.where(self.scale > 0, scatter, 0)
        inputs = _network_inputs(_flatten(change), scale, self.direction, self.shrinkage)
        return self.answer_inputs(inputs)

    def answer_inputs(
        self, inputs: Float[np.ndarray, "row column"]
    ) -> Float64[np.ndarray, "row class"]:
        """Return the probability of each class from the network's inputs."""
        hidden = np.maximum(inputs @ self.inner + self.inner_bias, 0)
        logits = (hidden @ self.outer + self.outer_bias) / TEMPERATURE
        shares = np.exp(logits - logits.max(axis=-1, keepdims=True))
        return np.asarray(shares / shares.sum(axis=-1, keepdims=True))

    def line_change(self, change: Float[np.ndarray, "channel level"], bands: OrderBands) -> float:
        """Return the root mean square of the lines' changes, in healthy standard deviations."""
        lines = _line_changes(change[None], bands)
        scaled = _divide_by_scatter(lines, self.line_scale)[0, self.line_scale > 0]
        return float(np.sqrt(np.mean(scaled**2)))

    def p_value(self, probability: float) -> float:
        """Return the p-value of belonging to one of the classes.

        It is the share of virtual recordings of the classes whose probability of an unknown fault
        is at least as high.
        """
        n = self.unknown_scores.size
        # The tolerance counts an equal probability although it was computed in another order.
        rank = int(np.searchsorted(self.unknown_scores, probability * (1 - 1e-9)))
        return (n - rank + 1) / (n + 1)


def fit_head(
    virtual: VirtualChanges,
    healthy: Float64[np.ndarray, "change channel level"],
    bands: OrderBands,
    measured: MeasuredChanges,
    *,
    seed: int = 0,
) -> PriorHead:
    """Train the head of a machine on virtual pumps, its healthy recordings and measured ones.

    Parameters
    ----------
    healthy : changes of its healthy recordings among each other, scaled to the variance of a single
        recording; NaN in bands beyond half the sample rate.
    bands : bands of the changes.
    measured : faults of the machine, and recordings of other machines, if there are any.
    """
    healthy_virtual = virtual.change[virtual.target == 0]
    scale = machine_scatter(virtual, healthy)
    line_scale = _healthy_scatter(
        _line_changes(healthy_virtual, bands), _line_changes(healthy, bands)
    )

    virtual_scale = _virtual_scatter(virtual)
    virtual_scale[:, scale == 0] = 0
    direction, shrinkage = _healthy_directions(_divide_by_scatter(_flatten(healthy), scale))

    virtual_inputs = _network_inputs(
        _flatten(virtual.change), virtual_scale[virtual.number], direction, shrinkage
    )
    measured_scale = np.where(scale > 0, measured.scatter, 0)
    measured_inputs = _network_inputs(
        _flatten(measured.change), measured_scale, direction, shrinkage
    )
    healthy_inputs = _network_inputs(_flatten(healthy), scale, direction, shrinkage)

    is_trained = virtual.number % _HELD_OUT_INTERVAL > 0
    n_classes = int(virtual.target.max()) + 1
    virtual_classes = virtual.target[is_trained]
    is_background = np.isin(virtual_classes, (0, n_classes - 1))
    virtual_weight = np.where(is_background, BACKGROUND_WEIGHT, 1.0)
    healthy_classes = np.zeros(len(healthy), dtype=np.int64)
    inner, inner_bias, outer, outer_bias = _train_network(
        np.concatenate([virtual_inputs[is_trained], measured_inputs, healthy_inputs]),
        np.concatenate([virtual_classes, measured.target, healthy_classes]),
        np.concatenate([virtual_weight, measured.weight, np.ones(len(healthy))]),
        seed,
    )

    head = PriorHead(
        scale=scale,
        line_scale=line_scale,
        direction=direction,
        shrinkage=shrinkage,
        inner=inner,
        inner_bias=inner_bias,
        outer=outer,
        outer_bias=outer_bias,
        unknown_scores=np.empty(0),
    )
    is_held_out = ~is_trained & (virtual.target < n_classes - 1)
    held_out_answers = head.answer_inputs(virtual_inputs[is_held_out])
    return replace(head, unknown_scores=np.sort(held_out_answers[:, -1]))


def machine_scatter(
    virtual: VirtualChanges, healthy: Float64[np.ndarray, "change channel level"]
) -> Float64[np.ndarray, " column"]:
    """Return the healthy scatter of each band power of a machine; 0 in a band that it lacks.

    Parameters
    ----------
    healthy : changes of its healthy recordings, as in `fit_head`.
    """
    healthy_virtual = virtual.change[virtual.target == 0]
    return _healthy_scatter(_flatten(healthy_virtual), _flatten(healthy))


def _virtual_scatter(virtual: VirtualChanges) -> Float64[np.ndarray, "pump column"]:
    """Return each virtual pump's scatter, shrunk toward that of all, since it has few
    references.
    """
    healthy_changes = _flatten(virtual.change[virtual.target == 0])
    mean_square = np.mean(healthy_changes**2, axis=0)
    scatter: Float64[np.ndarray, "pump column"] = np.sqrt(
        (_N_PRIOR_SCATTER * mean_square + _N_REFERENCES * _flatten(virtual.scatter) ** 2)
        / (_N_PRIOR_SCATTER + _N_REFERENCES)
    )
    return scatter


def _healthy_directions(
    scaled_changes: Float64[np.ndarray, "change column"],
) -> tuple[Float64[np.ndarray, "direction column"], Float64[np.ndarray, " direction"]]:
    """Return the directions in which healthy recordings scatter, and the shrinkage along each."""
    _, singular_values, direction = np.linalg.svd(scaled_changes, full_matrices=False)
    variance = singular_values**2 / max(len(scaled_changes), 1)
    return direction, 1 - 1 / np.sqrt(1 + variance / LAMBDA)


def _train_network(
    inputs: Float64[np.ndarray, "row column"],
    classes: Int[np.ndarray, " row"],
    weight: Float64[np.ndarray, " row"],
    seed: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the weights and biases of both layers: inner, inner bias, outer, outer bias."""
    from sklearn.neural_network import MLPClassifier

    # Early stopping is the regularization. No epoch improves the loss by this tolerance, so that
    # the training ends after the last epoch, before scikit-learn warns that it did not converge.
    # To hide the warning would not be safe: all threads share the filters of warnings.
    network = MLPClassifier(
        (_N_UNITS,),
        alpha=1.0,
        learning_rate_init=2e-3,
        batch_size=min(128, len(inputs)),
        max_iter=_N_EPOCHS + 1,
        tol=sys.float_info.max,
        n_iter_no_change=_N_EPOCHS - 2,
        random_state=seed % 2**32,
    )
    network.fit(inputs.astype(np.float32), classes, sample_weight=weight)
    assert network.n_iter_ == _N_EPOCHS

    inner, outer = (weights.astype(np.float64) for weights in network.coefs_)
    inner_bias, outer_bias = (biases.astype(np.float64) for biases in network.intercepts_)
    return inner, inner_bias, outer, outer_bias


def _flatten(values: Float[np.ndarray, "row channel level"]) -> Float[np.ndarray, "row column"]:
    return values.reshape(len(values), math.prod(values.shape[1:]))


def _line_changes(
    change: Float[np.ndarray, "row channel level"], bands: OrderBands
) -> Float[np.ndarray, "row line"]:
    """Return shaft orders, piston passes, and what rises above the floor between them."""
    n_single = change.shape[-1] - 2 * bands.n_floors
    single, broad, floor = np.split(change, [n_single, n_single + bands.n_floors], axis=-1)
    return _flatten(np.concatenate([single, broad - floor], axis=-1))


def _healthy_scatter(
    virtual: Float[np.ndarray, "row column"], healthy: Float64[np.ndarray, "change column"]
) -> Float64[np.ndarray, " column"]:
    """Return the healthy scatter of a machine; 0 in a band that it does not have.

    The scatter of virtual pumps counts for some recordings, since healthy ones may be few.
    """
    squares = _N_PRIOR_SCATTER * np.mean(virtual**2, axis=0) + (healthy**2).sum(axis=0)
    return np.nan_to_num(np.sqrt(squares / (_N_PRIOR_SCATTER + len(healthy))))


def _divide_by_scatter(
    changes: Float[np.ndarray, "row column"], scatter: Float64[np.ndarray, "*#row column"]
) -> Float64[np.ndarray, "row column"]:
    """Return changes in units of the scatter; 0 in a band without one."""
    has_scatter = np.broadcast_to(scatter > 0, changes.shape)
    return np.divide(changes, scatter, out=np.zeros(changes.shape), where=has_scatter)


def _network_inputs(
    changes: Float[np.ndarray, "row column"],
    scatter: Float64[np.ndarray, "*#row column"],
    direction: Float64[np.ndarray, "direction column"],
    shrinkage: Float64[np.ndarray, " direction"],
) -> Float64[np.ndarray, "row column"]:
    """Return changes as the network takes them: scaled, shrunk along healthy directions,
    bounded.
    """
    scaled = _divide_by_scatter(changes, scatter)
    healthy_part = ((scaled @ direction.T) * shrinkage) @ direction
    return np.arcsinh(scaled - healthy_part)
