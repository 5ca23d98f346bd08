"""Commands about pump files: pump new, pump show."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import say, table, tell
from swashtwin.cli.options import Json

if TYPE_CHECKING:
    from swashtwin.pump import Pump

pumps = typer.Typer(no_args_is_help=True, help="Write and show the parameter sets of pumps.")


@pumps.command("new")
def new(
    name: Annotated[str, typer.Argument(help="Name of the new pump.")],
    like: Annotated[str, typer.Option(help="Pump to copy, by name or .toml file.")] = "25scy14-1b",
    folder: Annotated[Path, typer.Option(help="Where NAME.toml is written.")] = Path(),
    as_json: Json = False,
) -> None:
    """Write a commented copy of a pump file, to be edited."""
    from swashtwin.pump import new_pump

    path = new_pump(name, like=like, folder=folder)
    tell({"pump": path}, as_json, lambda: say(f"{path}\nEdit it, then: swashtwin pump show {path}"))


@pumps.command("show")
def show(
    name: Annotated[str, typer.Argument(help="Name of a pump, or its .toml file.")] = "25scy14-1b",
    as_json: Json = False,
) -> None:
    """Show every number of a pump in SI units, with its source."""
    from swashtwin.pump import available_pumps, load_pump

    pump = load_pump(name)
    parameters = [
        {"name": path, "value": value, "unit": unit, "source": pump.sources.get(path, "")}
        for path, value, unit in _numbers(pump)
    ]
    result = {"name": pump.name, "parameters": parameters, "channels": pump.channels, "available": available_pumps()}

    def tables() -> None:
        rows = [(one["name"], _text(one["value"]), one["unit"], one["source"]) for one in parameters]
        table(pump.name, ("parameter", "value", "unit", "source"), rows)

    tell(result, as_json, tables)


def _numbers(pump: "Pump") -> Iterator[tuple[str, Any, str]]:
    """(path, value, unit) of every number."""
    for section in fields(pump):
        part = getattr(pump, section.name)
        if is_dataclass(part):
            for item in fields(part):
                value = getattr(part, item.name)
                if is_dataclass(value):
                    for inner in fields(value):
                        yield f"{section.name}.{item.name}.{inner.name}", getattr(value, inner.name), _unit(inner)
                else:
                    yield f"{section.name}.{item.name}", value, _unit(item)
    for place, sensor in enumerate(pump.sensors):
        yield f"sensors[{place}].position", sensor.position, "m"


def _unit(item: Any) -> str:
    return str(item.metadata.get("unit", ""))


def _text(value: Any) -> str:
    return ", ".join(f"{one:.6g}" for one in value) if isinstance(value, tuple) else f"{value:.6g}"
