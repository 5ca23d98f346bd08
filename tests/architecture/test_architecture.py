"""The architecture: floors, front doors, light imports, short modules, and examples that run as
printed.
"""

import ast
import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "swashtwin"
BENCH = ROOT / "bench" / "src" / "swashtwin_bench"
MODULES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))
ROOMS = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.pyi"))
HEAVY = ("torch", "numpy", "scipy", "sklearn", "matplotlib", "h5py", "polars", "pint", "joblib")


def test_imports_go_one_way_down(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "importlinter.cli._configure_logging", lambda verbose: None
    )  # it turns off all other logs
    assert (
        lint_imports(config_filename=str(ROOT / ".importlinter"), no_cache=True)
        == EXIT_STATUS_SUCCESS
    )


BREACHES = {
    "oddments.py": ("", "oddments"),
    "foundation/errors.py": ("import swashtwin.cli", "foundation.errors -> swashtwin.cli"),
    "calibration/procedure.py": (
        "import swashtwin.learning",
        "calibration.procedure -> swashtwin.learning",
    ),
    "report/page.py": ("import swashtwin_bench", "report.page -> swashtwin_bench"),
    "report/drawing.py": (
        "import swashtwin.pump.faults",
        "report.drawing imports swashtwin.pump.faults",
    ),
    "recordings/columns.py": ("import swashtwin.recordings.samples", "form no cycle BROKEN"),
    "learning/features.py": ("import swashtwin.physics", "learning.features -> swashtwin.physics"),
    "learning/windows/cutting.py": (
        "import swashtwin.learning.choice.candidates",
        "No cycles are allowed in swashtwin.learning.",
    ),
    "learning/windows/window_set.py": (
        "import swashtwin.learning.windows.cutting",
        "No cycles are allowed in swashtwin.learning.windows.",
    ),
    "calibration/unknowns.py": (
        "import swashtwin.calibration.severity.inversion",
        "No cycles are allowed in swashtwin.calibration.",
    ),
    "../swashtwin_bench/demo.py": (
        "import swashtwin.pump.faults",
        "demo imports swashtwin.pump.faults",
    ),
    **{
        f"../swashtwin_bench/rigs/breach_{index}.py": (text, f"rigs.breach_{index} uses")
        for index, text in enumerate(
            (
                "from swashtwin.physics import Twin",
                "from swashtwin import Twin",
                "from swashtwin import physics",
                "from swashtwin.physics import *",
                "from swashtwin import calibration",
                "import swashtwin as st",
                "import swashtwin.physics as physics",
                "from swashtwin_bench.questions.twin_matrix import Twin",
                "from swashtwin_bench import questions",
            )
        )
    },
}
"""What is added to a module, and how it is refused; the rigs' law is tried by every way of writing
an import.
"""


def test_whatever_breaks_the_floors_is_refused(tmp_path: Path) -> None:
    """All is tried at once: reading the package takes longest."""
    for package in (PACKAGE, BENCH):
        shutil.copytree(
            package, tmp_path / package.name, ignore=shutil.ignore_patterns("__pycache__")
        )
    for module, (text, _) in BREACHES.items():
        with (tmp_path / "swashtwin" / module).open("a") as file:
            file.write(f"{text}\n")
    command = [
        sys.executable,
        "-c",
        "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(",
    ]
    command[-1] += f"{str(ROOT / '.importlinter')!r}, no_cache=True))"
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT / "tests" / "support")]),
    }
    process = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert process.returncode == 1
    output = " ".join(process.stdout.split())
    assert {module: words for module, (_, words) in BREACHES.items() if words not in output} == {}
    assert "0 kept, 6 broken" in output


def test_importing_swashtwin_loads_nothing_heavy() -> None:
    code = "import sys, swashtwin; print(*sorted(sys.modules))"
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert not set(HEAVY) & set(process.stdout.split())


@pytest.mark.parametrize("package", ["", *ROOMS])
def test_every_name_at_a_door_can_be_imported(package: str) -> None:
    door = import_module(f"swashtwin.{package}".rstrip("."))
    stub = ast.parse((PACKAGE / package / "__init__.pyi").read_text(encoding="utf-8"))
    names = [
        alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    ]
    assert sorted(names) == sorted(door.__all__)
    for name in names:
        assert getattr(door, name) is not None


@pytest.mark.parametrize("package", ROOMS)
def test_no_name_at_a_door_is_also_a_module_of_the_room(package: str) -> None:
    modules = {path.stem for path in (PACKAGE / package).iterdir()}
    assert not modules & set(import_module(f"swashtwin.{package}").__all__)


def test_no_module_but_a_door_only_imports() -> None:
    for module in MODULES:
        body = ast.parse((PACKAGE / module).read_text(encoding="utf-8")).body
        is_empty = all(isinstance(node, ast.Import | ast.ImportFrom | ast.Expr) for node in body)
        assert module.endswith(("__init__.py", "__main__.py")) or not is_empty, module


def test_the_house_has_at_most_14_rooms_on_12_floors() -> None:
    law = (ROOT / ".importlinter").read_text(encoding="utf-8")
    floors = re.search(r"layers =\n((?: {4}.+\n)+)", law)
    assert floors is not None
    assert len(floors[1].splitlines()) <= 12
    assert len(ROOMS) <= 14


def test_no_module_evaluates_its_annotations_late_or_has_a_name_that_says_nothing() -> None:
    for module in MODULES:
        assert "from __future__ import annotations" not in (PACKAGE / module).read_text(
            encoding="utf-8"
        )
        assert not {"utils", "helpers", "common", "misc"} & set(re.split(r"[/.]", module))
