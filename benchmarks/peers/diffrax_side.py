"""diffrax with a constant step."""

from collections.abc import Callable
from typing import ClassVar

import diffrax
import jax.numpy as jnp
import numpy as np

from peers.jax_side import Array, JaxTrajectory


class ClassicalRungeKutta(diffrax.AbstractERK):
    """The classical method, which diffrax does not have, as a tableau of its own (it estimates no
    error).
    """

    tableau: ClassVar[diffrax.ButcherTableau] = diffrax.ButcherTableau(
        a_lower=(np.array([0.5]), np.array([0.0, 0.5]), np.array([0.0, 0.0, 1.0])),
        b_sol=np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6]),
        b_error=np.zeros(4),
        c=np.array([0.5, 0.5, 1.0]),
    )
    interpolation_cls: ClassVar[Callable] = diffrax.ThirdOrderHermitePolynomialInterpolation.from_k

    def order(self, terms: object) -> int:
        """Order of the method."""
        return 4


class Diffrax(JaxTrajectory):
    """`diffeqsolve` with `ConstantStepSize`; time counts steps, so that every force is found by its
    number.
    """

    def states(self, state: Array, load: Array, motion: Array, weight: Array) -> Array:
        h, n = self.problem.step, self.problem.n_steps

        def rate(time: Array, x: Array, parts: tuple[Array, Array]) -> Array:
            matrix, weights = parts
            at = jnp.round(2 * time).astype(int)
            return matrix @ x + h * (load[at] + motion[at] @ weights)

        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            ClassicalRungeKutta(),
            t0=0.0,
            t1=float(n),
            dt0=1.0,
            y0=self.start,
            args=(h * state, weight),
            saveat=diffrax.SaveAt(t0=True, steps=True),
            adjoint=diffrax.RecursiveCheckpointAdjoint(),
            max_steps=n,
            throw=False,
        )
        return solution.ys
