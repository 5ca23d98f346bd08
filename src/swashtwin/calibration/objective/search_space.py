"""Within which values a calibration searches."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics import Twin
from swashtwin.pump import LETTERS, PARAMETERS

DEFAULT_FACTOR = 10.0
"""The search reaches from a tenth of each nominal value to ten times it."""


@dataclass(frozen=True, eq=False)
class SearchSpace:
    """Bounds of the six interface values.

    All bounds are positive, and positive values make K and C positive definite: every point within is a stable pump.
    """

    nominal: Float[np.ndarray, " 6"]
    """Where the search starts, in the order of `pump.PARAMETERS`."""
    lower: Float[np.ndarray, " 6"]
    """Least values."""
    upper: Float[np.ndarray, " 6"]
    """Greatest values."""

    @property
    def prior_std(self) -> Float[np.ndarray, " 6"]:
        """Standard deviation of ln value where only the bounds are known: that of a uniform density of ln value."""
        return np.log(self.upper / self.lower) / math.sqrt(12)

    @property
    def log_center(self) -> Float[np.ndarray, " 6"]:
        """Natural logarithm of the geometric middle of the bounds."""
        return np.log(self.upper * self.lower) / 2

    def boundary_loss(self, values: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch"]:
        """Mean over the parameters of how far each lies beyond its bounds, relative to the bound."""
        lower, upper = torch.as_tensor(self.lower), torch.as_tensor(self.upper)
        return (torch.relu(values / upper - 1) + torch.relu(1 - values / lower)).mean(dim=-1)


def search_space(twin: Twin, bounds: Mapping[str, tuple[float, float]] | float | None = None) -> SearchSpace:
    """Bounds around the twin's interface values.

    Parameters
    ----------
    bounds : a factor for all, or (least, greatest) by parameter name or letter for some, a factor of 10 for the others.

    Raises
    ------
    InputError
        An unknown parameter, or bounds that do not hold the nominal value.

    Examples
    --------
    ``search_space(twin, {"C_sw": (5e5, 5e6)})``
    """
    nominal = twin.values.numpy()
    factor = float(bounds) if isinstance(bounds, int | float) else DEFAULT_FACTOR
    if not (math.isfinite(factor) and factor > 1):
        raise InputError(f"bounds ({factor:g}) must be a factor above 1, such as 10.")
    lower, upper = nominal / factor, nominal * factor
    names = {**{name: i for i, name in enumerate(PARAMETERS)}, **{LETTERS[n]: i for i, n in enumerate(PARAMETERS)}}
    for name, (least, greatest) in bounds.items() if isinstance(bounds, Mapping) else ():
        if name not in names:
            raise InputError(f"bounds name {name!r}, which is none of {', '.join(names)}.")
        index = names[name]
        if not 0 < least <= nominal[index] <= greatest or least == greatest:
            raise InputError(
                f"bounds of {name} ({least:g}, {greatest:g}) must be positive and hold the nominal value "
                f"{nominal[index]:g}."
            )
        lower[index], upper[index] = least, greatest
    return SearchSpace(nominal=nominal, lower=lower, upper=upper)
