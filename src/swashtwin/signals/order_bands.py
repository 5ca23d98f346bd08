"""Bands of shaft orders: the lines of the shaft, the piston passes, what lies between them, and wide bands above."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.foundation import InputError
from swashtwin.signals.spectra import JITTER


@dataclass(frozen=True)
class OrderBands:
    """Bands of one number of pistons, in multiples of the shaft frequency.

    The shaft orders below the first piston pass one by one; each of the first `passes` piston passes, as wide as a
    wandering speed smears it; all between it and the next; and `wide` logarithmic bands from there to `highest`.
    """

    piston_count: int
    """Pistons of the pump."""
    passes: int = 20
    """Multiples of the piston-pass frequency that have a band."""
    wide: int = 6
    """Bands above the last of them."""
    highest: float = 340.0
    """Upper edge of the last band."""

    def __post_init__(self) -> None:
        if self.piston_count < 2 or self.passes < 1 or self.wide < 1 or self.highest <= self._first_wide:
            raise InputError(
                f"bands of {self.piston_count} pistons and {self.passes} passes need two pistons, a pass and a wide "
                f"band at least, and end above order {self._first_wide}, not at {self.highest:g}."
            )

    @property
    def _first_wide(self) -> int:
        return (self.passes + 1) * self.piston_count

    @cached_property
    def edges(self) -> Float64[np.ndarray, "band 2"]:
        """Lower and upper edge of each band, in shaft orders."""
        bands = [(order - 0.5, order + 0.5) for order in range(1, self.piston_count)]
        for number in range(1, self.passes + 1):
            here, there = number * self.piston_count, (number + 1) * self.piston_count
            reach = min(0.5 + JITTER * here, self.piston_count / 4)
            bands += [(here - reach, here + reach), (here + reach, there - reach)]
        wide = np.geomspace(self._first_wide, self.highest, self.wide + 1)
        return np.array([*bands, *pairwise(wide.tolist())])

    @property
    def names(self) -> tuple[str, ...]:
        """What each band holds, such as ``pass 3`` or ``between 3``."""
        return (
            *(f"order {order}" for order in range(1, self.piston_count)),
            *(f"{kind} {number}" for number in range(1, self.passes + 1) for kind in ("pass", "between")),
            *(f"above {number}" for number in range(1, self.wide + 1)),
        )

    def sums(
        self,
        power: Float[np.ndarray, "*batch cell"],
        order: Float[np.ndarray, " cell"],
        half_width: Float[np.ndarray, " cell"] | float,
    ) -> Float64[np.ndarray, "*batch band"]:
        """Power in each band.

        Parameters
        ----------
        power : of cells of the order axis.
        order, half_width : middle of each cell and half of its width, in shaft orders; a cell that an edge cuts counts
            by its share.

        Examples
        --------
        >>> bands = OrderBands(2, passes=1, wide=1, highest=9.0)
        >>> bands.sums(np.array([1.0, 2.0, 4.0]), np.array([1.0, 2.0, 6.0]), 0.5).tolist()
        [1.0, 2.0, 0.0, 4.0]
        """
        low, high = (np.asarray(order)[:, None] + sign * np.asarray(half_width).reshape(-1, 1) for sign in (-1, 1))
        overlap = np.minimum(high, self.edges[:, 1]) - np.maximum(low, self.edges[:, 0])
        return np.asarray(power) @ (np.clip(overlap, 0, None) / (high - low))
