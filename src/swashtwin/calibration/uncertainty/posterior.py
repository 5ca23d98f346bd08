"""What is known after a calibration: a point and how far around it the truth may lie."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.calibration.objective.unknowns import Unknowns
from swashtwin.foundation import InputError, stream
from swashtwin.physics import Twin
from swashtwin.pump import Interfaces

_TRIES = 200
"""How often a draw beyond the bounds is drawn anew before it is put on the bound."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Density of all coordinates searched: normal and cut at their bounds, or as draws that were sampled from it."""

    unknowns: Unknowns
    """What was searched."""
    channels: tuple[str, ...]
    """Channels that were measured."""
    point: Float[np.ndarray, " unknown"]
    """Coordinates found."""
    covariance: Float[np.ndarray, "unknown unknown"]
    """Their covariance; its first six rows are the logarithms of the six values."""
    sampled: Float[np.ndarray, "sample unknown"] | None = None
    """Draws of a sampler (`sample_posterior`); None is the normal density (Laplace's approximation)."""

    def twin_at(self, twin: Twin, point: Float[np.ndarray, " unknown"]) -> Twin:
        """`twin` with the values, scales and sensor path of `point`."""
        values = Interfaces.from_values(np.exp(point[:6]))
        path = self.unknowns.path_at(point, self.channels, twin.pump.channels)
        moved = twin.with_interfaces(values, self.unknowns.scales_at(point))
        return moved if path is None else replace(moved, path=path)

    def draws(self, count: int, seed: int) -> Float[np.ndarray, "draw unknown"]:
        """Points drawn from the density; the same seed gives the same ones, whatever the count."""
        if count < 1:
            raise InputError(f"count ({count}) must be at least 1.")
        if self.sampled is not None:
            rows = [stream(seed, "posterior", index).integers(len(self.sampled)) for index in range(count)]
            return self.sampled[rows]
        root = np.linalg.cholesky(self.covariance)
        return np.stack([self._draw(root, seed, index) for index in range(count)])

    def _draw(self, root: np.ndarray, seed: int, index: int) -> np.ndarray:
        rng = stream(seed, "posterior", index)
        lower, upper = self.unknowns.lower, self.unknowns.upper
        for _ in range(_TRIES):
            point = self.point + root @ rng.standard_normal(len(self.point))
            if ((point >= lower) & (point <= upper)).all():
                break
        return np.clip(point, lower, upper)

    def twins(self, twin: Twin, count: int, seed: int) -> list[Twin]:
        """`twin` with the coordinates of each of `count` draws."""
        return [self.twin_at(twin, point) for point in self.draws(count, seed)]

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it."""
        unknowns = {name: _plain(value) for name, value in vars(self.unknowns).items()}
        own = {name: _plain(getattr(self, name)) for name in ("channels", "point", "covariance", "sampled")}
        return {"unknowns": unknowns, **own}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> "Posterior":
        """What `to_dict` wrote."""
        unknowns = {item.name: _back(table["unknowns"][item.name]) for item in fields(Unknowns)}
        sampled = table.get("sampled")  # calibrations saved before there were samplers have none
        return cls(
            unknowns=Unknowns(**unknowns),
            channels=tuple(table["channels"]),
            point=np.array(table["point"], dtype=float),
            covariance=np.array(table["covariance"], dtype=float),
            sampled=None if sampled is None else np.array(sampled, dtype=float),
        )


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else list(value) if isinstance(value, tuple) else value


def _back(value: Any) -> Any:
    if not isinstance(value, list):
        return value
    return tuple(value) if all(isinstance(one, str) for one in value) else np.array(value, dtype=float)
