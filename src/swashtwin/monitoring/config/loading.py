"""The configuration of a watch, read from its file and checked as a whole."""

import os
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from functools import cache
from importlib import resources
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from swashtwin.foundation import (
    DataError,
    InputError,
    MissingFileError,
    SwashTwinError,
    UnitError,
    file_name,
    read_text,
    write_text,
)
from swashtwin.monitoring.config.entries import Surroundings, read_table, refuse_unknown
from swashtwin.monitoring.config.settings import (
    AlarmSettings,
    EmailChannel,
    FolderSource,
    HttpSource,
    LogChannel,
    Machine,
    MqttChannel,
    MqttSource,
    PageSettings,
    Retention,
    WatchConfig,
    WebhookChannel,
)
from swashtwin.pump import load_pump

_PARTS = {"alarms": AlarmSettings, "retention": Retention, "page": PageSettings}
_SOURCES = {kind.kind: kind for kind in (FolderSource, MqttSource, HttpSource)}
_CHANNELS = {kind.kind: kind for kind in (LogChannel, WebhookChannel, MqttChannel, EmailChannel)}
_TEXTS = ("folder", "history", "language")
_ENTRIES = (*_TEXTS, "machine", "source", "channel", *_PARTS)


def load_watch_config(path: Path, environment: Mapping[str, str] | None = None) -> WatchConfig:
    """Configuration of a watch from its TOML file.

    Parameters
    ----------
    path : the file; relative paths in it start at its folder.
    environment : variables for ``${NAME}`` in secrets; by default the process's.

    Raises
    ------
    MissingFileError, DataError, InputError, UnitError
        The file or one that it names is not there, an entry is unknown, missing, or cannot be. One line names the
        file and the entry, and no secret.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist; write one with: swashtwin watch init {path}")
    try:
        table = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as cause:
        raise DataError(f"{path}: not valid TOML: {cause}.") from cause
    surroundings = Surroundings(path.absolute().parent, os.environ if environment is None else environment)
    try:
        config = _config(path.absolute(), table, surroundings)
        _check(config)
    except (MissingFileError, DataError, UnitError, InputError) as cause:
        raise type(cause)(f"{path}: {cause}") from cause
    return config


def write_example(path: Path) -> Path:
    """`path`, after a commented configuration was written to it.

    Raises
    ------
    InputError
        The file exists already.
    """
    path = Path(path)
    if path.exists():
        raise InputError(f"{path} exists already; name another file, or remove it.")
    return write_text(path, (resources.files(__package__) / "example.toml").read_text(encoding="utf-8"))


def _config(path: Path, table: dict[str, Any], surroundings: Surroundings) -> WatchConfig:
    refuse_unknown(table, _ENTRIES, "the file")
    texts = {name: table[name] for name in _TEXTS if name in table}
    machines = [
        Machine(**read_table(Machine, entries, _title("machine", number, entries), surroundings))
        for number, entries in enumerate(_tables(table, "machine"), 1)
    ]
    return WatchConfig(
        path=path,
        **read_table(WatchConfig, texts, "the file", surroundings),
        machines=tuple(machines),
        sources=_variants(table, "source", _SOURCES, surroundings),
        channels=_variants(table, "channel", _CHANNELS, surroundings),
        **{
            name: kind(**read_table(kind, table[name], f"[{name}]", surroundings))
            for name, kind in _PARTS.items()
            if name in table
        },
    )


def _tables(table: dict[str, Any], key: str) -> list[Any]:
    tables = table.get(key, [])
    if not isinstance(tables, list):
        raise DataError(f"[{key}] must be written with two brackets: [[{key}]].")
    return tables


def _title(key: str, number: int, entries: Any) -> str:
    name = entries.get("name") if isinstance(entries, dict) else None
    return f"[[{key}]] {name!r}" if isinstance(name, str) else f"[[{key}]] number {number}"


def _variants(table: dict[str, Any], key: str, kinds: Mapping[str, Any], surroundings: Surroundings) -> tuple[Any, ...]:
    """Tables of which each has a kind, and a name that is by default the kind."""
    results = []
    for number, entries in enumerate(_tables(table, key), 1):
        kind = entries.get("kind") if isinstance(entries, dict) else None
        if not isinstance(kind, str) or kind not in kinds:
            raise DataError(f"[[{key}]] number {number}: kind = {kind!r} must be one of {', '.join(map(repr, kinds))}.")
        named = {"name": kind, **{name: value for name, value in entries.items() if name != "kind"}}
        results.append(kinds[kind](**read_table(kinds[kind], named, _title(key, number, named), surroundings)))
    return tuple(results)


def _check(config: WatchConfig) -> None:
    """Raise where entries contradict each other, or what they name."""
    if not config.machines:
        raise DataError("the file has no [[machine]]; add one with its name.")
    if not config.sources:
        raise DataError('the file has no [[source]]; add one, such as kind = "folder" with its path.')
    names = tuple(machine.name for machine in config.machines)
    _refuse_repetition(names, "[[machine]]")
    _refuse_repetition([source.name for source in config.sources], "[[source]]")
    _refuse_repetition([channel.name for channel in config.channels], "[[channel]]")
    for machine in config.machines:
        _check_machine(machine)
    for source in config.sources:
        machine_name = None if isinstance(source, HttpSource) else source.machine
        if machine_name is not None and machine_name not in names:
            near = get_close_matches(machine_name, names, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"add a [[machine]] with name = {machine_name!r}."
            raise DataError(f"[[source]] {source.name!r}: machine {machine_name!r} is not in the file; {hint}")
    page = config.page
    if not _is_loopback(page.host) and page.users is None and page.tokens is None:
        raise InputError(
            f"[page]: host = {page.host!r} lets other computers read and acknowledge; add users or tokens, "
            'or take host = "127.0.0.1".'
        )


def _check_machine(machine: Machine) -> None:
    if file_name(machine.name) != machine.name:
        raise InputError(
            f"[[machine]] {machine.name!r}: the name also names a folder; write it as {file_name(machine.name)!r}."
        )
    if machine.pump is not None:
        try:
            _require_pump(machine.pump)
        except SwashTwinError as cause:
            raise DataError(f"[[machine]] {machine.name!r}: {cause}") from cause


@cache
def _require_pump(pump: str) -> None:
    load_pump(pump)


def _refuse_repetition(names: Sequence[str], title: str) -> None:
    name, count = Counter(names).most_common(1)[0] if names else ("", 1)
    if count > 1:
        raise DataError(f"{count} of {title} have the name {name!r}; give each a name of its own.")


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"
