"""JAX: a jitted scan over the steps in reverse mode, and diffrax with a constant step."""

import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from peers.contender import Contender
from peers.problem import Problem

Array = jax.Array
jax.config.update("jax_enable_x64", True)


class JaxTrajectory(Contender):
    """Compiled ahead, so that neither time nor memory of the compiler counts; a subclass says how
    states come.
    """

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.slopes = jnp.asarray(problem.state_slopes)
        self.weight = jnp.asarray(problem.push_weight)
        self.rows = jnp.asarray(problem.sensor_rows)
        self.start = jnp.asarray(problem.start)
        self.bin_scale = jnp.asarray(problem.bin_scale)
        self.target = jnp.asarray(problem.target)
        self.tables = (jnp.asarray(problem.load), jnp.asarray(problem.motion))
        self.compiled: dict[str, Callable] = {}

    def states(self, state: Array, load: Array, motion: Array, weight: Array) -> Array:
        """States (step, 26) of x' = `state` x + `load` + `motion` `weight`, the start first."""
        raise NotImplementedError

    def motion_of(self, values: Array, tables: tuple[Array, Array]) -> Array:
        """Velocities (step, sensor) of the sensors [m/s]."""
        state = self.slopes[0] + jnp.tensordot(values, self.slopes[1:], 1)
        return self.states(state, *tables, self.weight @ values) @ self.rows.T

    def _loss(self, values: Array, tables: tuple[Array, Array]) -> Array:
        gains = jnp.diff(self.motion_of(values, tables), axis=0)
        amplitude = jnp.abs(jnp.fft.rfft(gains, axis=0)[1 : len(self.target) + 1]) * self.bin_scale
        return jnp.sqrt(jnp.mean((amplitude - self.target) ** 2) / jnp.mean(self.target**2))

    def _run(self, name: str, function: Callable, values: np.ndarray) -> Array:
        at = jnp.asarray(values)
        if name not in self.compiled:
            self.compiled[name] = jax.jit(function).lower(at, self.tables).compile()
        return jax.block_until_ready(self.compiled[name](at, self.tables))

    def prepare(self, values: np.ndarray) -> float:
        """Compile the gradient without running it; returns how long that took [s]."""
        started = time.perf_counter()
        at = jnp.asarray(values)
        self.compiled["gradient"] = (
            jax.jit(jax.value_and_grad(self._loss)).lower(at, self.tables).compile()
        )
        return time.perf_counter() - started

    def value(self, values: np.ndarray) -> float:
        return float(self._run("value", self._loss, values))

    def gradient(self, values: np.ndarray) -> tuple[float, np.ndarray]:
        loss, slopes = self._run("gradient", jax.value_and_grad(self._loss), values)
        return float(loss), np.asarray(slopes)

    def velocities(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(self._run("velocities", self.motion_of, values))


class JaxScan(JaxTrajectory):
    """The classical Runge-Kutta method in `lax.scan`."""

    def states(self, state: Array, load: Array, motion: Array, weight: Array) -> Array:
        h = self.problem.step
        push = load + motion @ weight

        def step(x: Array, pushes: tuple[Array, Array, Array]) -> tuple[Array, Array]:
            start, middle, end = pushes
            k1 = state @ x + start
            k2 = state @ (x + h / 2 * k1) + middle
            k3 = state @ (x + h / 2 * k2) + middle
            k4 = state @ (x + h * k3) + end
            x = x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
            return x, x

        states = jax.lax.scan(step, self.start, (push[:-2:2], push[1::2], push[2::2]))[1]
        return jnp.concatenate([self.start[None], states])
