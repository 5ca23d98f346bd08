"""The architecture: floors, front doors, light imports and names of modules."""

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
CONTRACTS = ROOT / ".importlinter"
MODULES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))
ROOMS = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.pyi"))

HEAVY = ("torch", "numpy", "scipy", "sklearn", "matplotlib", "h5py", "arro3", "pint", "joblib")
"""Libraries that take a noticeable time to import."""


def test_the_imports_keep_every_contract(monkeypatch: pytest.MonkeyPatch) -> None:
    # it would turn off the logs of all other tests
    monkeypatch.setattr("importlinter.cli._configure_logging", lambda verbose: None)

    status = lint_imports(config_filename=str(CONTRACTS), no_cache=True)

    assert status == EXIT_STATUS_SUCCESS


IMPORTS_OF_THE_TWIN = (
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
"""Every way in which a rig could use the twin that is to be tested on it."""

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
    "../swashtwin_bench/demo.py": (
        "import swashtwin.pump.faults",
        "demo imports swashtwin.pump.faults",
    ),
    **{
        f"../swashtwin_bench/rigs/breach_{index}.py": (text, f"rigs.breach_{index} uses")
        for index, text in enumerate(IMPORTS_OF_THE_TWIN)
    },
}
"""Text that is added to a module, and the part of the linter's output that reports it."""


def test_every_breach_of_a_contract_is_reported(tmp_path: Path) -> None:
    for package in (PACKAGE, BENCH):
        shutil.copytree(
            package, tmp_path / package.name, ignore=shutil.ignore_patterns("__pycache__")
        )
    # all at once, as reading the packages takes longest
    for module, (text, _) in BREACHES.items():
        with (tmp_path / "swashtwin" / module).open("a") as file:
            file.write(f"{text}\n")

    code = (
        "import sys; from importlinter.cli import lint_imports; "
        f"sys.exit(lint_imports({str(CONTRACTS)!r}, no_cache=True))"
    )
    # the contracts' own code is tests.support.contracts
    search_path = os.pathsep.join([str(tmp_path), str(ROOT)])
    process = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": search_path},
        capture_output=True,
        text=True,
        check=False,
    )

    assert process.returncode == 1
    output = " ".join(process.stdout.split())
    assert [module for module, (_, report) in BREACHES.items() if report not in output] == []
    # each contract is breached, so that none is empty
    assert "0 kept, 6 broken" in output


def test_importing_swashtwin_loads_no_heavy_library() -> None:
    code = "import sys, swashtwin; print(*sorted(sys.modules))"
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert not set(HEAVY) & set(process.stdout.split())


@pytest.mark.parametrize("room", ["", *ROOMS])
def test_every_public_name_of_a_room_can_be_imported(room: str) -> None:
    door = import_module(f"swashtwin.{room}".rstrip("."))
    stub = ast.parse((PACKAGE / room / "__init__.pyi").read_text(encoding="utf-8"))

    names = []
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            names += [alias.name for alias in node.names]

    assert sorted(names) == sorted(door.__all__)
    for name in names:
        assert getattr(door, name) is not None


@pytest.mark.parametrize("room", ROOMS)
def test_no_public_name_is_also_a_module_of_its_room(room: str) -> None:
    # importing the module would replace the name
    modules = {path.stem for path in (PACKAGE / room).iterdir()}
    assert not modules & set(import_module(f"swashtwin.{room}").__all__)


def only_imports(module: str) -> bool:
    """Return whether a module has nothing but imports and a docstring."""
    body = ast.parse((PACKAGE / module).read_text(encoding="utf-8")).body
    return all(isinstance(node, ast.Import | ast.ImportFrom | ast.Expr) for node in body)


def test_only_the_front_door_of_a_package_consists_of_imports() -> None:
    importing_modules = [module for module in MODULES if only_imports(module)]
    doors = ("__init__.py", "__main__.py")
    assert [module for module in importing_modules if not module.endswith(doors)] == []


def test_the_package_has_at_most_14_rooms_on_12_floors() -> None:
    contracts = CONTRACTS.read_text(encoding="utf-8")
    floors = re.search(r"layers =\n((?: {4}.+\n)+)", contracts)

    assert floors is not None
    assert len(floors[1].splitlines()) <= 12
    assert len(ROOMS) <= 14


def test_no_module_evaluates_its_annotations_late() -> None:
    texts = {module: (PACKAGE / module).read_text(encoding="utf-8") for module in MODULES}
    # the checker of array shapes needs objects: docs/explanation/architecture.md, Pitfalls
    late = "from __future__ import annotations"
    assert [module for module, text in texts.items() if late in text] == []


def test_every_module_name_states_a_subject() -> None:
    no_subjects = {"utils", "helpers", "common", "misc"}
    assert [module for module in MODULES if no_subjects & set(re.split(r"[/.]", module))] == []
