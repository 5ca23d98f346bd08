"""Bands of shaft orders and piston passes, alike in number for every number of pistons."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.foundation import InputError
from swashtwin.signals.band_powers import MIN_POWER

SPEED_VARIATION = 0.004
"""Half-width of the speed's variation [relative] over which a piston pass is summed."""
FLOOR_QUANTILE = 0.25
"""Quantile of a band's cells that is its noise floor: lines fill less than the other cells."""


@dataclass(frozen=True)
class OrderBands:
    """Bands for a pump with a given number of pistons.

    In this order: shaft orders 1 to 3; each of the first `passes` piston passes, as wide as a
    wandering speed smears it; what lies between order 3 and the first pass, and between each pass
    and the next; and `wide` logarithmic bands from there to `highest` passes. Bands that hold no
    pass have a noise floor besides.
    """

    piston_count: int
    """Pistons of the pump."""
    passes: int = 20
    """Multiples of the piston-pass frequency that have a band."""
    wide: int = 6
    """Number of bands above the last pass."""
    highest: float = 48.0
    """Upper edge of the last band [piston passes]."""

    def __post_init__(self) -> None:
        is_possible = self.piston_count >= 5 and self.passes >= 1 and self.wide >= 1
        if not is_possible or self.highest <= self.passes + 1:
            raise InputError(
                f"Invalid bands for {self.piston_count} pistons, {self.passes} passes and "
                f"{self.wide} wide bands up to pass {self.highest:g}: use 5 pistons or more, at "
                f"least one pass and one wide band, and an upper edge above pass "
                f"{self.passes + 1}."
            )

    @cached_property
    def edges(self) -> Float64[np.ndarray, "band 2"]:
        """Lower and upper edge of each band [shaft orders]; the last `n_floors` have a floor."""
        count = self.piston_count
        single = [(order - 0.5, order + 0.5) for order in (1, 2, 3)]

        passes = []
        between = [(3.5, count - 0.5)]
        for order in range(count, (self.passes + 1) * count, count):
            # A quarter of the spacing at most, so that neighboring passes leave a band between.
            half_width = min(0.5 + SPEED_VARIATION * order, count / 4)
            passes.append((order - half_width, order + half_width))
            between.append((order + half_width, order + count - half_width))

        wide = np.geomspace((self.passes + 1) * count, self.highest * count, self.wide + 1)
        return np.array([*single, *passes, *between, *pairwise(wide.tolist())])

    @property
    def n_floors(self) -> int:
        """Number of noise floors."""
        return self.passes + 1 + self.wide

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each power, such as ``pass 3`` or ``floor between 3``."""
        lines = ["order 1", "order 2", "order 3"]
        lines += [f"pass {number}" for number in range(1, self.passes + 1)]

        broad = ["below pass 1"]
        broad += [f"between {number}" for number in range(1, self.passes + 1)]
        broad += [f"above {number}" for number in range(1, self.wide + 1)]
        return (*lines, *broad, *(f"floor {name}" for name in broad))

    def log_powers(
        self, power: Float[np.ndarray, "*batch cell"], width: float
    ) -> Float64[np.ndarray, "*batch band"]:
        """Return log10 of the power in each band, then of each floor's power per cell.

        Bands beyond the last cell are NaN.

        Parameters
        ----------
        power : power of each cell of the order axis; the center of cell i is at i times `width`.
        width : width of a cell [shaft orders]. A cell that an edge cuts counts by its share.
        """
        order = np.arange(power.shape[-1]) * width
        low = self.edges[:, :1]
        high = self.edges[:, 1:]

        overlap = np.minimum(order + width / 2, high) - np.maximum(order - width / 2, low)
        sums = power @ (np.clip(overlap, 0, None) / width).T

        floors = []
        for lower, upper in self.edges[-self.n_floors :]:
            cells = power[..., (order > lower) & (order < upper)]
            if cells.shape[-1]:
                floors.append(np.quantile(cells, FLOOR_QUANTILE, axis=-1))
            else:
                floors.append(np.full_like(sums[..., 0], np.nan))

        powers = np.concatenate([sums, np.stack(floors, axis=-1)], axis=-1)
        upper_edges = np.concatenate([high[:, 0], high[-self.n_floors :, 0]])
        is_covered = upper_edges <= order[-1] + width
        return np.where(is_covered, np.log10(np.maximum(powers, MIN_POWER)), np.nan)
