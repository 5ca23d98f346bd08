"""Contracts of `.importlinter` that import-linter does not have itself.

A room's front door (its ``__init__``) loads names when they are first used, and its ``__init__.pyi`` says where each
lives. `FrontDoor` refuses an import that goes past a door; `DoorNames` looks behind it.
"""

import ast
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


def _subpackage(module: str) -> str:
    """``"swashtwin.pump"`` of ``"swashtwin.pump.faults"``."""
    return ".".join(module.split(".")[:2])


class FrontDoor(Contract):
    """Every import from another room names the room itself, never a module in it."""

    type_name = "front_door"

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        trespasses = [
            (importer, imported)
            for importer in sorted(graph.modules)
            for imported in sorted(graph.find_modules_directly_imported_by(importer))
            if _subpackage(importer) != _subpackage(imported) and imported.count(".") > 1
        ]
        return ContractCheck(kept=not trespasses, metadata={"trespasses": trespasses})

    def render_broken_contract(self, check: ContractCheck) -> None:
        for importer, imported in check.metadata["trespasses"]:
            output.print_error(f"{importer} imports {imported}: import the name from {_subpackage(imported)}.")


class DoorNames(Contract):
    """No module of a package imports a name that lives in a forbidden one, by whichever door it comes."""

    type_name = "door_names"
    source = fields.StringField()
    forbidden = fields.ListField(fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        package = Path(find_spec(_subpackage(self.source).split(".")[0]).submodule_search_locations[0])
        imports = [
            (module, home)
            for module in sorted(graph.find_descendants(self.source))
            for home in sorted(set(_homes(package, module)))
            if any(f"{home}.".startswith(f"{forbidden}.") for forbidden in self.forbidden)
        ]
        return ContractCheck(kept=not imports, metadata={"imports": imports})

    def render_broken_contract(self, check: ContractCheck) -> None:
        for module, home in check.metadata["imports"]:
            output.print_error(f"{module} uses {home}.")


def _homes(package: Path, module: str) -> Iterator[str]:
    """Where each name that `module` imports lives, behind the doors."""
    path = package.joinpath(*module.split(".")[1:])
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            behind = _door(package, node.module)
            yield from (behind.get(alias.name, f"{node.module}.{alias.name}") for alias in node.names)


def _door(package: Path, module: str) -> dict[str, str]:
    """Home of each name at the door of `module`; nothing where it has none."""
    stub = package.joinpath(*module.split(".")[1:], "__init__.pyi")
    if not stub.is_file():
        return {}
    return {
        alias.name: f"{module}.{node.module}"
        for node in ast.parse(stub.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
