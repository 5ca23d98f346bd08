"""Virtual problems: how the scores of a new machine rank among those of held-out ones.

With K training machines, each held-out machine is answered by models of K - 1 machines. With few
machines these are worse than the final model, so that its answers to a new machine have better
scores than those of the held-out machines: sets that are calibrated on the latter are too large. K
measured machines cannot show by how much. Problems of K virtual pumps can: there, new pumps are at
hand. Only ranks are taken from them, so that the size of the scores, and with it the difficulty, is
that of the measured machines (compare the score transporter of Bashari and others 2025,
arXiv:2505.13432).
"""

from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Float64

RATES = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)
"""Error rates of `HELD_OUT_SHARES`."""
N_PROBLEMS = MappingProxyType({2: 60, 3: 40, 4: 20, 5: 20})
"""Virtual problems behind `HELD_OUT_SHARES`, by number of training machines."""
HELD_OUT_SHARES = MappingProxyType(
    {
        2: (0.017, 0.033, 0.083, 0.167, 0.233, 0.300, 0.417, 0.500, 0.583),
        3: (0.011, 0.033, 0.078, 0.144, 0.211, 0.256, 0.367, 0.456, 0.544),
        4: (0.017, 0.042, 0.075, 0.142, 0.192, 0.242, 0.342, 0.433, 0.525),
        5: (0.013, 0.027, 0.067, 0.140, 0.200, 0.240, 0.327, 0.413, 0.527),
    }
)
"""By number of training machines: share of the held-out recordings above the score that a share
`RATES` of the recordings of new pumps exceeds.

From ``benchmarks/virtual_problems.py`` on 20 virtual fleets, lines "all". More machines than these
need no adjustment: a model hardly changes if one of them is held out.
"""


def transport_p_values(
    p_value: Float[np.ndarray, "*recording class"], n_machines: int
) -> Float64[np.ndarray, "*recording class"]:
    """Return p-values among held-out recordings as p-values of a new machine.

    None rises, so that no prediction set grows. With another number of machines than those of
    `HELD_OUT_SHARES` they stay the same.

    Parameters
    ----------
    n_machines : machines of the training, each of which was held out.

    Examples
    --------
    >>> transport_p_values(np.array([0.0, 0.17, 1.0]), 2).round(1)
    array([0. , 0.1, 1. ])
    >>> transport_p_values(np.array([0.17]), 9)
    array([0.17])
    """
    shares = HELD_OUT_SHARES.get(n_machines)
    if shares is None:
        return np.asarray(p_value, dtype=np.float64)
    transported = np.interp(p_value, (0.0, *shares, 1.0), (0.0, *RATES, 1.0))
    return np.asarray(np.minimum(p_value, transported), dtype=np.float64)
