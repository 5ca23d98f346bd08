"""Competing implementations that the benchmark times compute the same values.

Their times are not tested.
"""

import ast
import importlib
import importlib.util
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from swashtwin.monitoring.config.config_file import load_watch_config

FOLDER = Path(__file__).parents[2] / "benchmarks"
STEPS = 60


@pytest.fixture(scope="module", autouse=True)
def benchmarks() -> Iterator[None]:
    """Make the modules of the benchmarks importable, as when a script there is run."""
    sys.path.insert(0, str(FOLDER))
    yield
    sys.path.remove(str(FOLDER))


def import_peer(name: str) -> ModuleType:
    return importlib.import_module(f"peers.{name}")


@dataclass(frozen=True, eq=False)
class Solution:
    """What one implementation computes at the nominal values."""

    loss: float
    slopes: np.ndarray
    """Derivatives of the loss by the logarithm of each value."""
    velocities: np.ndarray


def solve(module: str, class_name: str) -> Solution:
    contender_class = getattr(import_peer(module), class_name)
    problem = import_peer("problem").Problem(STEPS, per_step=contender_class.per_step)
    contender = contender_class(problem)
    values = problem.nominal

    loss, gradient = contender.gradient(values)
    assert contender.value(values) == pytest.approx(loss, rel=1e-12)
    return Solution(loss, gradient * values, contender.velocities(values))


@pytest.fixture(scope="module")
def eager(benchmarks: None) -> Solution:
    return solve("eager", "Eager")


# ---- agreement


@pytest.mark.parametrize(
    ("module", "class_name", "package"),
    [
        ("numba_adjoint", "Numba", "numba"),
        ("jax_side", "JaxScan", "jax"),
        ("diffrax_side", "Diffrax", "diffrax"),
    ],
)
def test_every_installed_peer_gives_the_numbers_of_the_eager_loop(
    module: str, class_name: str, package: str, eager: Solution
) -> None:
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")

    peer = solve(module, class_name)
    assert peer.loss == pytest.approx(eager.loss, rel=1e-10)

    # relative to the largest, because a small slope is a difference of large terms
    max_slope = np.abs(eager.slopes).max()
    np.testing.assert_allclose(peer.slopes, eager.slopes, rtol=0, atol=1e-9 * max_slope)
    max_velocity = np.abs(eager.velocities).max()
    np.testing.assert_allclose(peer.velocities, eager.velocities, rtol=0, atol=1e-10 * max_velocity)


def test_the_steady_motion_continues_as_the_eager_loop_steps_it(eager: Solution) -> None:
    """The loop starts at the steady motion.

    The remaining difference is the error of the Runge-Kutta method at the edge of its stability.
    """
    steady = import_peer("ours").Steady(import_peer("problem").Problem(STEPS))
    exact = steady.velocities(steady.problem.nominal)
    tolerance = 1e-5 * np.abs(exact).max()
    np.testing.assert_allclose(eager.velocities, exact, rtol=0, atol=tolerance)


@pytest.mark.parametrize("index", [0, 2, 4])
def test_the_loss_of_the_eager_loop_has_the_slopes_that_differences_give(
    index: int, eager: Solution
) -> None:
    contender = import_peer("eager").Eager(import_peer("problem").Problem(STEPS))
    values = contender.problem.nominal
    change = 1e-5 * np.eye(6)[index]

    ahead = contender.value(values * (1 + change))
    behind = contender.value(values * (1 - change))
    assert (ahead - behind) / 2e-5 == pytest.approx(eager.slopes[index], rel=1e-5)


def test_steady_state_and_its_runge_kutta_agree_in_loss_and_slopes() -> None:
    ours: Any = import_peer("ours")
    problem = import_peer("problem").Problem()
    values = problem.nominal

    exact_loss, exact_gradient = ours.Steady(problem).gradient(values)
    stepped_loss, stepped_gradient = ours.SteadyRungeKutta(problem).gradient(values)
    assert stepped_loss == pytest.approx(exact_loss, rel=1e-6)

    slopes = exact_gradient * values
    tolerance = 1e-5 * np.abs(slopes).max()
    np.testing.assert_allclose(stepped_gradient * values, slopes, rtol=0, atol=tolerance)


# ---- imports


@pytest.mark.parametrize("path", sorted(FOLDER.rglob("*.py")), ids=lambda path: path.stem)
def test_every_name_that_a_benchmark_imports_from_swashtwin_exists(path: Path) -> None:
    """Imports within functions count, and those in code that a benchmark gives to another
    process.
    """
    for module_name, name in swashtwin_imports(path.read_text(encoding="utf-8")):
        imported = importlib.import_module(module_name)
        assert name is None or hasattr(imported, name), f"{module_name} has no {name}"


def swashtwin_imports(text: str) -> Iterator[tuple[str, str | None]]:
    """Yield module and name of each import from swashtwin; the name is `None` for a module."""
    try:
        tree = ast.parse(textwrap.dedent(text))
    except SyntaxError:
        # a string that is not code
        return

    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("swashtwin"):
            for alias in node.names:
                yield str(node.module), alias.name

        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.startswith("swashtwin"):
                    yield alias.name, None

        # a string may be code
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and "import" in node.value
        ):
            yield from swashtwin_imports(node.value)


def test_the_watch_reads_the_configuration_that_is_killed(tmp_path: Path) -> None:
    watch = importlib.import_module("watch")
    path = watch.write_killed_config(tmp_path, "postgresql://127.0.0.1/swashtwin", 1883)
    config = load_watch_config(path)
    assert [source.kind for source in config.sources] == ["folder", "http", "mqtt"]
    assert config.retention.latest == 5
