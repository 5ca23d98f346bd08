"""What needs torch, numba or ONNX, and so an extra; all else works in the base install."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

EXTRAS = ("torch", "numba", "onnx", "onnxruntime", "onnxscript")
"""Packages that the base install lacks."""

DISTRIBUTIONS = {
    "argon2": "argon2_cffi",
    "h11": "uvicorn",
    "markupsafe": "jinja2",
    "paho": "paho_mqtt",
    "sklearn": "scikit_learn",
    "starlette": "fastapi",
}
"""Packages that are installed under another name, or with another package."""

ROOMS = (
    "foundation",
    "pump",
    "recordings",
    "signals",
    "learning",
    "plot",
    "diagnosis",
    "report",
    "monitoring",
    "cli",
)

PRINT_MISSING_NAMES = f"""
import importlib, sys
class Missing:
    def find_spec(name, path=None, target=None):
        if name in {EXTRAS}:
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Missing)
for room in {ROOMS}:
    door = importlib.import_module("swashtwin." + room)
    for name in door.__all__:
        try:
            getattr(door, name)
        except ImportError:
            print(room, name, sep=".")
"""
"""A program that prints the public names that cannot be imported without the extras."""


def test_the_base_install_lacks_only_networks_and_reports_of_a_twin() -> None:
    process = subprocess.run(
        [sys.executable, "-c", PRINT_MISSING_NAMES], capture_output=True, text=True, check=True
    )

    assert set(process.stdout.split()) == {
        "foundation.TorchStream",
        "learning.BiTCN",
        "learning.Branch",
        "learning.Network",
        "learning.batches",
        # of a twin
        "report.build_calibration_blocks",
        "report.describe_verdicts",
    }


def imported_modules(node: ast.AST) -> list[str]:
    """Return the modules that a statement imports by their full names."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and not node.level:
        return [str(node.module)]
    return []


def imported_packages(room: str = "") -> dict[str, set[str]]:
    """Return the packages that a room imports, each with the files that import it.

    Imports within a function count.
    """
    files_by_package = defaultdict(set)
    for path in (ROOT / "src" / "swashtwin" / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for module in imported_modules(node):
                package = module.partition(".")[0]
                files_by_package[package].add(path.name)
    return files_by_package


# .ci/run relies on it: it does not run the tests of recordings and signals again without torch
@pytest.mark.parametrize("room", ["pump", "recordings", "signals"])
def test_rooms_below_learning_import_only_packages_of_the_base_install(room: str) -> None:
    assert not imported_packages(room).keys() & set(EXTRAS)


def test_every_imported_package_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    requirements = list(project["dependencies"])
    for extra, extra_requirements in project["optional-dependencies"].items():
        # the package itself must not need what its documents and tests need
        if extra not in ("docs", "test"):
            requirements += extra_requirements
    declared = set()
    for requirement in requirements:
        name = re.split(r"[\[><=]", requirement)[0]
        declared.add(name.lower().replace("-", "_"))

    undeclared = {}
    for package, files in imported_packages().items():
        is_own = package in ("swashtwin", "swashtwin_bench")
        distribution = DISTRIBUTIONS.get(package, package)
        is_declared = package.lower() in declared or distribution.lower() in declared
        if not (is_own or is_declared or package in sys.stdlib_module_names):
            undeclared[package] = files

    assert undeclared == {}
