"""What needs torch, numba or ONNX, and so an extra; all else is there in the base install."""

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
NAMES = {
    "argon2": "argon2_cffi", "h11": "uvicorn", "markupsafe": "jinja2", "paho": "paho_mqtt", "sklearn": "scikit_learn",
    "starlette": "fastapi", "swashtwin": "itself", "swashtwin_bench": "its bench",
}  # fmt: skip
"""Packages that come by another name, or with another one."""
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
CODE = f"""
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


def test_the_base_install_lacks_networks_and_nothing_else() -> None:
    printed = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, check=True
    ).stdout
    assert set(printed.split()) == {
        "foundation.TorchStream",
        *(f"learning.{name}" for name in ("BiTCN", "Branch", "Network", "batches")),
        *("report.build_calibration_blocks", "report.describe_verdicts"),  # of a twin
    }


def imported(room: str = "") -> dict[str, set[str]]:
    """Packages that modules of a room import, on top or within a function, each with these
    modules.
    """
    found = defaultdict(set)
    for path in (ROOT / "src" / "swashtwin" / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                names = (
                    [str(node.module)]
                    if isinstance(node, ast.ImportFrom) and not node.level
                    else []
                )
            for name in names:
                found[name.partition(".")[0]].add(path.name)
    return found


@pytest.mark.parametrize("room", ["pump", "recordings", "signals"])
def test_rooms_below_learning_import_nothing_that_the_base_install_lacks(room: str) -> None:
    """So .ci/run need not run the tests of recordings and signals again without torch."""
    assert not imported(room).keys() & set(EXTRAS)


def test_every_package_that_is_imported_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = {
        name: needs
        for name, needs in project["optional-dependencies"].items()
        if name not in ("docs", "test")
    }
    needs = [need for listed in (project["dependencies"], *extras.values()) for need in listed]
    declared = {re.split(r"[\[><=]", need)[0].lower().replace("-", "_") for need in needs}
    declared |= {
        name for name, owner in NAMES.items() if owner in declared or owner.startswith("its")
    }
    undeclared = {
        name: modules for name, modules in imported().items() if name.lower() not in declared
    }
    assert {
        name: modules for name, modules in undeclared.items() if name not in sys.stdlib_module_names
    } == {}
