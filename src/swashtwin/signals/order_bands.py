"""Levels of shaft orders: lines of the shaft, piston passes, what lies between them, and the floor under all."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.foundation import InputError

_WANDERING = 0.004
"""Half-width of the speed's variation [relative] over which a piston pass is summed."""
_FLOOR_SHARE = 0.25
"""Share of a band's cells that lie below its floor: lines fill fewer than the rest."""


@dataclass(frozen=True)
class OrderBands:
    """Bands of one number of pistons, alike in number for all.

    Shaft orders 1 to 3 one by one; each of the first `passes` piston passes, as wide as a wandering speed smears it;
    all between order 3 and the first pass, and between each pass and the next; and `wide` logarithmic bands from there
    to `highest` passes. Bands that hold no pass have a floor besides.
    """

    piston_count: int
    """Pistons of the pump."""
    passes: int = 20
    """Multiples of the piston-pass frequency that have a band."""
    wide: int = 6
    """Bands above the last of them."""
    highest: float = 48.0
    """Upper edge of the last band, in piston passes."""

    def __post_init__(self) -> None:
        if self.piston_count < 5 or self.passes < 1 or self.wide < 1 or self.highest <= self.passes + 1:
            raise InputError(
                f"bands of {self.piston_count} pistons and {self.passes} passes need five pistons, a pass and a wide "
                f"band at least, and end above pass {self.passes + 1}, not at {self.highest:g}."
            )

    @cached_property
    def edges(self) -> Float64[np.ndarray, "band 2"]:
        """Lower and upper edge of each band, in shaft orders; the last `n_floors` ones have a floor."""
        count = self.piston_count
        single = [(order - 0.5, order + 0.5) for order in (1, 2, 3)]
        passes, between = [], [(3.5, count - 0.5)]
        for here in range(count, (self.passes + 1) * count, count):
            reach = min(0.5 + _WANDERING * here, count / 4)
            passes.append((here - reach, here + reach))
            between.append((here + reach, here + count - reach))
        wide = np.geomspace((self.passes + 1) * count, self.highest * count, self.wide + 1)
        return np.array([*single, *passes, *between, *pairwise(wide.tolist())])

    @property
    def n_floors(self) -> int:
        """Number of floors."""
        return self.passes + 1 + self.wide

    @property
    def names(self) -> tuple[str, ...]:
        """What each level is, such as ``pass 3`` or ``floor between 3``."""
        between = ("below pass 1", *(f"between {number}" for number in range(1, self.passes + 1)))
        broad = (*between, *(f"above {number}" for number in range(1, self.wide + 1)))
        lines = (*("order 1", "order 2", "order 3"), *(f"pass {number}" for number in range(1, self.passes + 1)))
        return (*lines, *broad, *(f"floor {name}" for name in broad))

    def levels(self, power: Float[np.ndarray, "*batch cell"], width: float) -> Float64[np.ndarray, "*batch level"]:
        """log10 of the power in each band, then of the floors' power in each cell; NaN where cells end before.

        Parameters
        ----------
        power : of cells of the order axis; the middle of cell i is at i times `width`.
        width : of a cell, in shaft orders. A cell that an edge cuts counts by its share.
        """
        order = np.arange(power.shape[-1]) * width
        low, high = self.edges[:, :1], self.edges[:, 1:]
        overlap = np.minimum(order + width / 2, high) - np.maximum(order - width / 2, low)
        sums = power @ (np.clip(overlap, 0, None) / width).T
        floors = []
        for lower, upper in self.edges[-self.n_floors :]:
            cells = power[..., (order > lower) & (order < upper)]
            floors.append(np.quantile(cells, _FLOOR_SHARE, axis=-1) if cells.shape[-1] else sums[..., 0] * np.nan)
        levels = np.log10(np.maximum(np.concatenate([sums, np.stack(floors, axis=-1)], axis=-1), 1e-30))
        ends = np.concatenate([high[:, 0], high[-self.n_floors :, 0]])
        return np.where(ends <= order[-1] + width, levels, np.nan)
