"""The ways that the benchmark times compute the same; their times are not looked at here."""

import ast
import importlib
import importlib.util
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"
STEPS = 60


@pytest.fixture(scope="module", autouse=True)
def benchmarks() -> Iterator[None]:
    """The benchmarks' own modules, importable as when a script there is run."""
    sys.path.insert(0, str(FOLDER))
    yield
    sys.path.remove(str(FOLDER))


def module(name: str) -> ModuleType:
    return importlib.import_module(f"peers.{name}")


def gradient_of(name: str, of_class: str) -> tuple[float, np.ndarray, np.ndarray]:
    contender_class = getattr(module(name), of_class)
    contender = contender_class(module("problem").Problem(STEPS, per_step=contender_class.per_step))
    values = contender.problem.nominal
    loss, slopes = contender.gradient(values)
    assert contender.value(values) == pytest.approx(loss, rel=1e-12)
    return loss, slopes * values, contender.velocities(values)


@pytest.fixture(scope="module")
def eager(benchmarks: None) -> tuple[float, np.ndarray, np.ndarray]:
    return gradient_of("eager", "Eager")


@pytest.mark.parametrize(
    ("name", "of_class", "package"),
    [
        ("numba_adjoint", "Numba", "numba"),
        ("jax_side", "JaxScan", "jax"),
        ("diffrax_side", "Diffrax", "diffrax"),
    ],
)
def test_every_installed_peer_gives_the_numbers_of_the_eager_loop(
    name: str, of_class: str, package: str, eager: tuple[float, np.ndarray, np.ndarray]
) -> None:
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    loss, slopes, velocities = gradient_of(name, of_class)
    assert loss == pytest.approx(eager[0], rel=1e-10)
    np.testing.assert_allclose(slopes, eager[1], rtol=0, atol=1e-9 * np.abs(eager[1]).max())
    np.testing.assert_allclose(velocities, eager[2], rtol=0, atol=1e-10 * np.abs(eager[2]).max())


def test_the_steady_motion_continues_as_the_eager_loop_steps_it(
    eager: tuple[float, np.ndarray, np.ndarray],
) -> None:
    """It starts there; what remains is the Runge-Kutta method's own error at the edge of its
    stability.
    """
    steady = module("ours").Steady(module("problem").Problem(STEPS))
    exact = steady.velocities(steady.problem.nominal)
    np.testing.assert_allclose(eager[2], exact, rtol=0, atol=1e-5 * np.abs(exact).max())


def test_the_loss_of_the_eager_loop_has_the_slopes_that_differences_give() -> None:
    contender_class = module("eager").Eager
    contender = contender_class(module("problem").Problem(STEPS))
    values = contender.problem.nominal
    slopes = contender.gradient(values)[1] * values
    for i in (0, 2, 4):
        ahead, behind = (
            contender.value(values * (1 + sign * 1e-5 * np.eye(6)[i])) for sign in (1, -1)
        )
        assert (ahead - behind) / 2e-5 == pytest.approx(slopes[i], rel=1e-5)


def test_steady_state_and_its_runge_kutta_agree_in_loss_and_slopes() -> None:
    exact, stepped = (module("ours").__dict__[name] for name in ("Steady", "SteadyRungeKutta"))
    problem = module("problem").Problem()
    values = problem.nominal
    loss, slopes = exact(problem).gradient(values)
    other, others = stepped(problem).gradient(values)
    assert other == pytest.approx(loss, rel=1e-6)
    np.testing.assert_allclose(
        others * values, slopes * values, rtol=0, atol=1e-5 * np.abs(slopes * values).max()
    )


@pytest.mark.parametrize("path", sorted(FOLDER.rglob("*.py")), ids=lambda path: path.stem)
def test_every_name_that_a_benchmark_imports_from_swashtwin_exists(path: Path) -> None:
    """Imports within functions count, and those in code that a benchmark gives to another
    process.
    """
    for module_name, name in swashtwin_imports(path.read_text(encoding="utf-8")):
        imported = importlib.import_module(module_name)
        assert name is None or hasattr(imported, name), f"{module_name} has no {name}"


def swashtwin_imports(text: str) -> Iterator[tuple[str, str | None]]:
    try:
        nodes = list(ast.walk(ast.parse(textwrap.dedent(text))))
    except SyntaxError:  # a string that is no code
        return
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("swashtwin"):
            yield from ((str(node.module), alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (
                (alias.name, None) for alias in node.names if alias.name.startswith("swashtwin")
            )
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and "import" in node.value
        ):
            yield from swashtwin_imports(node.value)
