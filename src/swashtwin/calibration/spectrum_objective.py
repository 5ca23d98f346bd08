"""How far a twin is from the measurement, and how that changes with what is searched."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.calibration.measurement import Measurement, align_lines
from swashtwin.calibration.unknowns import VALUE_SLICE, Nuisances, Unknowns, build_search_space
from swashtwin.physics import SteadySolver, Twin

Points: TypeAlias = Float[Tensor, "*batch unknown"]

MODEL_ERROR = 0.05
"""Relative error of every simulated line that even the right values leave; our estimate, as in
docs/explanation/physics.md."""
FLOOR = 0.02
"""Minimum standard deviation of a line [m/s^2], from twin and measurement together; as in
docs/explanation/physics.md.
"""


@dataclass(frozen=True, eq=False)
class Comparison:
    """One twin and one measurement at its operating point, compared line by line.

    The *observables* are compared: the lines' amplitudes, as in the paper, or, for a measurement
    with phases, the real and then the imaginary parts of its lines, after the twin was turned to
    the shaft position at which it fits best.
    """

    twin: Twin
    """The twin, computed up to the end of the measurement's band."""
    measurement: Measurement
    """The measurement."""
    floor: Float[np.ndarray, "channel order"] | float = FLOOR
    """Minimum standard deviation of a line [m/s^2]."""
    searched_channels: tuple[str, ...] = ()
    """Channels that the search's gains, cross-talk and residues belong to, in their order, if
    other recordings of the search have more channels than this measurement; empty stands for the
    measurement's channels.
    """

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of the search, in its order."""
        return self.searched_channels or self.measurement.channels

    @cached_property
    def _sensor_rows(self) -> Tensor:
        """Rows of the twin's sensors that are the channels of the search."""
        return torch.tensor([self.twin.pump.channels.index(name) for name in self.channels])

    @cached_property
    def _measured_rows(self) -> Tensor | None:
        """Rows of the measured channels among those of the search; `None` if all are measured."""
        if self.channels == self.measurement.channels:
            return None
        return torch.tensor([self.channels.index(name) for name in self.measurement.channels])

    @cached_property
    def _twin_columns(self) -> Tensor:
        """Columns of the twin's lines that were measured."""
        return torch.as_tensor(np.flatnonzero(np.isin(self.twin.orders, self.measurement.orders)))

    @cached_property
    def _measured_columns(self) -> Tensor | None:
        """Columns of the twin's lines among those measured; `None` if the twin has all of them."""
        columns = np.flatnonzero(np.isin(self.measurement.orders, self.twin.orders))
        if len(columns) == len(self.measurement.orders):
            return None
        return torch.as_tensor(columns)

    @cached_property
    def _orders(self) -> Tensor:
        return torch.as_tensor(self.measurement.orders)

    @cached_property
    def _frequency(self) -> Tensor:
        return self._orders * self.twin.condition.shaft_frequency

    @property
    def has_phases(self) -> bool:
        """Whether phases are compared too."""
        return self.measurement.phasor is not None

    @cached_property
    def measured(self) -> Float[Tensor, "channel observable"]:
        """Measured observables [m/s^2]."""
        if self.measurement.phasor is None:
            return torch.as_tensor(self.measurement.amplitude)
        return _split_parts(torch.as_tensor(self.measurement.phasor))

    @cached_property
    def sigma(self) -> Float[Tensor, "channel observable"]:
        """Standard deviation of measured minus simulated observable [m/s^2].

        From the measurement's scatter, 5 % of the amplitude for what rigid bodies cannot model, and
        `floor`, by default 0.02 m/s^2. A line of little amplitude then counts little, which it
        would not on a decibel scale.
        """
        measurement = self.measurement
        if measurement.phasor is not None and measurement.phasor_deviation is not None:
            amplitude = np.abs(measurement.phasor)
            deviation = measurement.phasor_deviation
            n_parts = 2
        else:
            amplitude = measurement.amplitude
            deviation = measurement.deviation
            n_parts = 1

        variance = deviation**2 + (MODEL_ERROR * amplitude) ** 2 + self.floor**2
        return torch.as_tensor(np.sqrt(variance)).repeat(1, n_parts)

    @property
    def deviation(self) -> Float[np.ndarray, " observable"]:
        """Standard deviation of each observable from the measurement alone [m/s^2]."""
        measurement = self.measurement
        if measurement.phasor_deviation is None:
            return measurement.deviation.reshape(-1)
        return np.tile(measurement.phasor_deviation, 2).reshape(-1)

    def lines(
        self, unknowns: Unknowns, point: Points, solver: SteadySolver | None = None
    ) -> Complex[Tensor, "*batch channel order"]:
        """Return the simulated lines [m/s^2] at `point`, differentiable.

        Their phases refer to the twin's shaft position, not to the measured one.
        """
        lines = self.twin.acceleration(
            point[..., VALUE_SLICE].exp(),
            scales=unknowns.scale_factors(point),
            port_timing=unknowns.port_timing(point),
            solver=solver,
        )
        lines = lines.index_select(-2, self._sensor_rows).index_select(-1, self._twin_columns)
        if self._measured_columns is not None:
            silent = lines.new_zeros(*lines.shape[:-1], len(self.measurement.orders))
            lines = silent.index_copy(-1, self._measured_columns, lines)

        mixing = unknowns.channel_mixing(point)
        if mixing is not None:
            lines = mixing.to(lines.dtype) @ lines

        response = unknowns.sensor_response(point, self._frequency)
        if response is not None:
            lines = lines * response

        return self._select_measured(lines)

    def _select_measured(self, lines: Tensor) -> Tensor:
        """Return the rows of the channels that were measured."""
        if self._measured_rows is None:
            return lines
        return lines.index_select(-2, self._measured_rows)

    def observables(
        self, unknowns: Unknowns, point: Points, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch channel observable"]:
        """Return the simulated observables [m/s^2] at `point`, differentiable."""
        lines = self.lines(unknowns, point, solver)
        if self.measurement.phasor is None:
            return lines.abs()

        weight = self.sigma[:, : len(self._orders)] ** -2
        measured = torch.as_tensor(self.measurement.phasor)
        return _split_parts(align_lines(lines, measured, weight, self._orders))

    def amplitude_of(self, twin: Twin) -> Float[np.ndarray, "channel order"]:
        """Return the amplitudes [m/s^2] of `twin` at the lines of this comparison; 0 for lines
        that the twin does not have.
        """
        limited = replace(twin, bandwidth=self.twin.bandwidth)
        with torch.no_grad():
            lines = self._select_measured(
                limited.acceleration().index_select(-2, self._sensor_rows)
            )

        orders = self.measurement.orders
        amplitude = np.zeros((len(lines), len(orders)))
        amplitude[:, np.isin(orders, limited.orders)] = (
            lines[:, np.isin(limited.orders, orders)].abs().numpy()
        )
        return amplitude


@dataclass(frozen=True, eq=False)
class Objective:
    """Distance between a twin and what was measured of it at one or several operating points.

    All comparisons share what is searched, one *point* of `unknowns`: so a pump measured at three
    pressures is calibrated once. The observables of all comparisons, channels and orders form one
    vector.
    """

    comparisons: tuple[Comparison, ...]
    """One for each operating point."""
    unknowns: Unknowns
    """What is searched."""

    @property
    def twin(self) -> Twin:
        """The twin at the first operating point; the others differ from it in condition only."""
        return self.comparisons[0].twin

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of all comparisons, in the order of the unknowns."""
        return self.comparisons[0].channels

    @property
    def has_phases(self) -> bool:
        """Whether phases are compared too."""
        return self.comparisons[0].has_phases

    @property
    def frequency(self) -> Float[np.ndarray, " observable"]:
        """Frequency of each observable [Hz]."""
        rows = []
        for comparison in self.comparisons:
            shaft_frequency = comparison.twin.condition.shaft_frequency
            frequency = comparison.measurement.orders * shaft_frequency
            rows.append(np.tile(frequency, comparison.measured.numel() // len(frequency)))
        return np.concatenate(rows)

    @cached_property
    def measured(self) -> Float[Tensor, " observable"]:
        """Measured observables [m/s^2]; see `Comparison`."""
        return torch.cat([comparison.measured.reshape(-1) for comparison in self.comparisons])

    @cached_property
    def sigma(self) -> Float[Tensor, " observable"]:
        """Standard deviation of measured minus simulated observable [m/s^2]; see
        `Comparison.sigma`.
        """
        return torch.cat([comparison.sigma.reshape(-1) for comparison in self.comparisons])

    @cached_property
    def start(self) -> Float[Tensor, " unknown"]:
        """The point of the nominal twin."""
        return torch.as_tensor(self.unknowns.start)

    def observables(
        self, point: Points, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch observable"]:
        """Return the simulated observables [m/s^2], differentiable."""
        parts = [
            comparison.observables(self.unknowns, point, solver) for comparison in self.comparisons
        ]
        return torch.cat([part.flatten(-2) for part in parts], dim=-1)

    def spectrum_loss(
        self, point: Points, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch"]:
        """Return the RMSE of the observables over the RMS of the measured ones (the paper's
        L_freq).

        With several operating points, the root of the mean of their squares, so that none counts
        more for being louder.
        """
        squares = []
        for comparison in self.comparisons:
            difference = comparison.observables(self.unknowns, point, solver) - comparison.measured
            squares.append(
                difference.square().mean(dim=(-2, -1)) / comparison.measured.square().mean()
            )
        return _safe_sqrt(torch.stack(squares).mean(dim=0))

    def weighted_loss(
        self, point: Points, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch"]:
        """Return the RMS of the differences over `sigma`: 1 if they are as large as expected."""
        difference = (self.observables(point, solver) - self.measured) / self.sigma
        return _safe_sqrt(difference.square().mean(dim=-1))

    def sensitivity(
        self, point: Float[Tensor, " unknown"], solver: SteadySolver | None = None
    ) -> tuple[Float[Tensor, " observable"], Float[Tensor, "observable unknown"]]:
        """Return the observables [m/s^2] at `point`, and their exact derivatives with respect to
        its coordinates.
        """
        directions = torch.eye(len(point), dtype=point.dtype)
        points = point.detach().repeat(len(point), 1).requires_grad_()
        observables = self.observables(points, solver)

        # Backward is linear in the weights it is given: its derivative along a direction, with
        # respect to them, is the forward derivative along that direction. One batch holds all
        # directions.
        weights = torch.zeros_like(observables, requires_grad=True)
        (backward,) = torch.autograd.grad(observables, points, weights, create_graph=True)
        (slope,) = torch.autograd.grad((backward * directions).sum(), weights)
        return observables[0].detach(), slope.T


def _split_parts(lines: Complex[Tensor, "*batch order"]) -> Float[Tensor, "*batch observable"]:
    """Return the real parts, then the imaginary parts."""
    return torch.cat([lines.real, lines.imag], dim=-1)


def _safe_sqrt(square: Tensor) -> Tensor:
    """Return the square root, with a finite derivative at 0, where a twin meets its own
    recording.
    """
    return (square + 1e-24).sqrt()


NO_NUISANCES = Nuisances()
"""Only the six values are searched."""


def build_objective(
    twins: Twin | Sequence[Twin],
    measurements: Measurement | Sequence[Measurement],
    bounds: Mapping[str, tuple[float, float]] | float | None = None,
    nuisances: Nuisances = NO_NUISANCES,
) -> Objective:
    """Return the objective of calibrating one pump on what was measured of it.

    Parameters
    ----------
    twins : the pump's twin, or several that differ in condition only.
    measurements : one for each twin; only lines that the twin has are compared. Their channels may
        differ.
    bounds : see `build_search_space`.
    nuisances : constants that are searched with the six values.
    """
    twins = [twins] if isinstance(twins, Twin) else list(twins)
    measurements = [measurements] if isinstance(measurements, Measurement) else list(measurements)
    channels = tuple(
        dict.fromkeys(name for measurement in measurements for name in measurement.channels)
    )

    comparisons = tuple(
        build_comparison(twin, measurement, channels)
        for twin, measurement in zip(twins, measurements, strict=True)
    )
    log_scales = np.log(twins[0].scales.values())
    space = build_search_space(twins[0], bounds)
    return Objective(comparisons, Unknowns(space, nuisances, channels, log_scales))


def build_comparison(
    twin: Twin, measurement: Measurement, channels: tuple[str, ...] = ()
) -> Comparison:
    """Return the comparison of the lines that the twin has; of a ``"spectrum"``, of all lines that
    were measured.
    """
    shaft_frequency = twin.condition.shaft_frequency
    # half an order more, so that rounding cannot cut off the last line
    bandwidth = (float(measurement.orders[-1]) + 0.5) * shaft_frequency
    limited = replace(twin, bandwidth=bandwidth, path=None)

    is_compared = np.isin(measurement.orders, limited.orders) | (measurement.lines == "spectrum")
    columns = {}
    for name in ("amplitude", "deviation", "phasor", "phasor_deviation"):
        values = getattr(measurement, name)
        if values is not None:
            columns[name] = values[:, is_compared]

    compared = replace(measurement, orders=measurement.orders[is_compared], **columns)
    return Comparison(twin=limited, measurement=compared, searched_channels=channels)
