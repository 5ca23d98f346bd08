"""Contracts of `.importlinter` that import-linter does not have itself.

A room's front door (its ``__init__``) loads names when they are first used, and its
``__init__.pyi`` says where each lives. `FrontDoor` refuses an import that goes past a door;
`DoorNames` looks behind it.
"""

import ast
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


def _room(module: str) -> str:
    """``"swashtwin.pump"`` of ``"swashtwin.pump.faults"``; all of another distribution is one
    room.
    """
    root, *names = module.split(".")
    return ".".join([root, *names[: root == "swashtwin"]])


class FrontDoor(Contract):
    """Every import from another room names the room itself, never a module in it."""

    type_name = "front_door"

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        trespasses = []
        for importer in sorted(graph.modules):
            for imported in sorted(graph.find_modules_directly_imported_by(importer)):
                is_door = imported == _room(imported)
                if not is_door and _room(importer) != _room(imported):
                    trespasses.append((importer, imported))
        return ContractCheck(kept=not trespasses, metadata={"trespasses": trespasses})

    def render_broken_contract(self, check: ContractCheck) -> None:
        for importer, imported in check.metadata["trespasses"]:
            output.print_error(
                f"{importer} imports {imported}: import the name from {_room(imported)}."
            )


class DoorNames(Contract):
    """No module of a package imports a name that lives in a forbidden one or in a neighbor, by
    whichever door it comes.

    Written as ``import swashtwin...`` an import gives the whole package, so that form is refused
    whatever it names.
    """

    type_name = "door_names"
    source = fields.StringField()
    forbidden = fields.ListField(fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        imports = []
        for module in sorted(graph.find_descendants(self.source)):
            homes = sorted(set(_homes(module)))
            imports.extend((module, home) for home in homes if self._refuses(home))
        return ContractCheck(kept=not imports, metadata={"imports": imports})

    def _refuses(self, home: str) -> bool:
        is_neighbor = _is_within(home, self.source.rpartition(".")[0]) and not _is_within(
            home, self.source
        )

        return is_neighbor or any(
            _is_within(home, name) or _is_within(name, home) for name in self.forbidden
        )

    def render_broken_contract(self, check: ContractCheck) -> None:
        for module, home in check.metadata["imports"]:
            output.print_error(f"{module} uses {home}.")


def _is_within(name: str, package: str) -> bool:
    return f"{name}.".startswith(f"{package}.")


def _homes(module: str) -> Iterator[str]:
    """Where each name that `module` imports lives, behind the doors."""
    for node in ast.walk(_tree(module)):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (_home(_imported(module, node), alias.name) for alias in node.names)


def _home(module: str, name: str) -> str:
    """Module that defines `name`, which `module` offers; the whole of `module` for ``*``."""
    if name == "*" or _file(module) is None:
        return module
    for node in _tree(module).body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return _home(_imported(module, node), alias.name)

    return f"{module}.{name}"


def _imported(module: str, node: ast.ImportFrom) -> str:
    """Full name of the module that a ``from ... import`` in `module` names."""
    if not node.level:
        return str(node.module)
    is_package = _file(module).stem == "__init__"
    parts = module.split(".")[: None if is_package and node.level == 1 else is_package - node.level]
    return ".".join([*parts, *([node.module] if node.module else [])])


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(_file(module).read_text(encoding="utf-8"))


@cache
def _file(module: str) -> Path | None:
    """Return the door of a room or the source of a module; None for a module of another package."""
    root, *names = module.split(".")
    if root not in ("swashtwin", "swashtwin_bench"):
        return None
    path = Path(find_spec(root).submodule_search_locations[0]).joinpath(*names)
    files = (
        path / "__init__.pyi",
        path / "__init__.py",
        path.with_name(f"{path.name}.py"),
    )

    return next((file for file in files if file.is_file()), None)
