"""What needs torch, numba or ONNX, and so an extra; all else works in the base install."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

EXTRAS = ("torch", "numba", "onnx", "onnxruntime", "onnxscript")
"""Packages that the base install lacks."""

NAMES = {"paho": "paho-mqtt"}
"""Packages that install a module of another name."""

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

COMPLETE_ROOMS = ("monitoring/history", "monitoring/sources", "pump", "recordings", "signals")
"""Rooms that import no extra; .ci/run does not run their tests again without torch."""

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


@pytest.mark.parametrize("room", COMPLETE_ROOMS)
def test_complete_rooms_import_only_packages_of_the_base_install(room: str) -> None:
    assert not imported_packages(room).keys() & set(EXTRAS)


def promised_modules() -> list[tuple[str, str, str]]:
    """Return each module that a call of `load_extra` or `require_modules` asks for.

    Each has the extra that the call names, and the file.
    """
    promises = []
    for path in (ROOT / "src" / "swashtwin").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
                continue
            texts = [item.value for item in node.args if isinstance(item, ast.Constant)]
            if node.func.id == "load_extra" and len(texts) == len(node.args):
                promises.append((texts[0], texts[1], path.name))
            elif node.func.id == "require_modules":
                extra = next(item.value for item in node.keywords if item.arg == "extra")
                assert isinstance(extra, ast.Constant)
                promises += [(module, extra.value, path.name) for module in texts]
    return promises


def test_the_extra_that_an_error_names_installs_the_missing_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    distributions = packages_distributions()

    broken = []
    for module, extra, file in promised_modules():
        if module.startswith("swashtwin."):
            continue  # a room that needs the extra, not a package of it
        requirements = project["optional-dependencies"][extra]
        installed = {
            canonical(re.split(r"[\[><=]", requirement)[0]) for requirement in requirements
        }
        # the map knows installed packages only
        names = {canonical(name) for name in distributions.get(module, [NAMES.get(module, module)])}
        if not names & installed:
            broken.append((file, module, extra))

    assert len(promised_modules()) > 10
    assert broken == []


def canonical(name: str) -> str:
    """Return the name of a distribution as an index compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()
