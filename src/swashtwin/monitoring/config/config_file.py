"""The configuration of a watch, read from its file and checked as a whole."""

import math
import os
import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

from swashtwin.foundation import (
    DataError,
    InputError,
    MissingFileError,
    SwashTwinError,
    UnitError,
    from_table,
    parse_quantity,
    read_text,
    safe_file_name,
    write_text,
)
from swashtwin.monitoring.config.settings import (
    HttpSource,
    Machine,
    NameOrFile,
    Quantity,
    Secret,
    SecretUrl,
    WatchConfig,
)
from swashtwin.pump import load_pump

_ITEM = re.compile(r"^(\w+)\[(\d+)\](?:\.|: )")
_VARIABLE = re.compile(r"\$\{(\w+)\}")


def load_watch_config(path: Path, environment: Mapping[str, str] | None = None) -> WatchConfig:
    """Configuration of a watch from its TOML file.

    Parameters
    ----------
    path : the file; relative paths in it start at its folder.
    environment : variables for ``${NAME}`` in secrets; by default the process's.

    Raises
    ------
    MissingFileError, DataError, InputError
        The file or one that it names is not there, an entry is unknown, missing, or cannot be. One
        line names the file and the entry, and no secret.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(
            f"{path} does not exist; write one with: swashtwin watch init {path}"
        )
    try:
        table = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as cause:
        raise DataError(f"{path}: not valid TOML: {cause}.") from cause
    variables = os.environ if environment is None else environment

    def read(kind: type, value: Any) -> Any:
        if not isinstance(value, str):
            raise ValueError("it must be a text in quotes")
        return _read(kind, value, path.absolute().parent, variables)

    try:
        config = from_table({**table, "(file)": str(path.absolute())}, WatchConfig, to_array=read)
        _check(config)
    except InputError as cause:
        text = _ITEM.sub(lambda match: f"[[{match[1]}]] number {int(match[2]) + 1}: ", str(cause))
        hint = "; the kinds are folder, mqtt, http, and of channels log, webhook, mqtt, email" * (
            "kind: " in text
        )
        raise InputError(f"{path}: {text.rstrip('.')}{hint}.") from cause
    except SwashTwinError as cause:
        raise cause.with_context(f"{path}: ") from cause
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
    return write_text(
        path, (resources.files(__package__) / "example.toml").read_text(encoding="utf-8")
    )


def _read(kind: type, value: str, folder: Path, environment: Mapping[str, str]) -> Any:
    """A path, secret or quantity of the text in the file; a `ValueError` where it cannot be."""
    if issubclass(kind, Path):
        return folder / Path(value).expanduser()
    if issubclass(kind, NameOrFile):
        return kind(
            folder / Path(value).expanduser()
            if value.endswith((".toml", ".safetensors"))
            else value
        )
    if issubclass(kind, Quantity):
        try:
            number = parse_quantity(value, kind.unit, name="it")
        except UnitError as cause:
            raise ValueError(str(cause).rstrip(".")) from cause
        if not (math.isfinite(number) and number > 0):
            raise ValueError(f"{value!r} must be above 0 {kind.unit}")
        return kind(number)
    return _secret(kind, value, environment)


def _secret(kind: type, value: str, environment: Mapping[str, str]) -> Secret:
    if issubclass(kind, SecretUrl):
        if "://" not in value:
            raise ValueError("it must be a URL, such as scheme://host/name")
        password = None
        with suppress(ValueError):
            password = urlsplit(value).password
        if password and not _VARIABLE.fullmatch(password):
            raise ValueError(
                "a password is written out; write scheme://user:${NAME}@host and set NAME"
            )
    elif not _VARIABLE.fullmatch(value):
        raise ValueError('it is written out; write "${NAME}" and set the environment variable NAME')

    def variable(match: re.Match[str]) -> str:
        if match[1] not in environment:
            raise ValueError(f"it needs the environment variable {match[1]}, which is not set")
        return quote(environment[match[1]], safe="") if kind is SecretUrl else environment[match[1]]

    return (SecretUrl if kind is SecretUrl else Secret)(_VARIABLE.sub(variable, value))


def _check(config: WatchConfig) -> None:
    if not config.machines:
        raise DataError("the file has no [[machine]]; add one with its name.")
    if not config.sources:
        raise DataError(
            'the file has no [[source]]; add one, such as kind = "folder" with its path.'
        )
    for title, named in (
        ("machine", config.machines),
        ("source", config.sources),
        ("channel", config.channels),
    ):
        for name, count in Counter(item.name for item in named).items():
            if count > 1:
                raise DataError(
                    f"{count} of [[{title}]] have the name {name!r}; give each a name of its own."
                )
    for machine in config.machines:
        try:
            _check_machine(machine)
        except SwashTwinError as cause:
            raise cause.with_context(f"[[machine]] {machine.name!r}: ") from cause
    for source in config.sources:
        stated = None if isinstance(source, HttpSource) else source.machine
        if stated is not None and config.machine(stated) is None:
            raise DataError(
                f"[[source]] {source.name!r}: machine {stated!r} is not in the file; there are {config.machine_names}."
            )


def _check_machine(machine: Machine) -> None:
    if safe_file_name(machine.name) != machine.name:
        raise InputError(
            f"the name also names a folder; write it as {safe_file_name(machine.name)!r}."
        )
    for name, path in (("model", machine.model), ("calibration", machine.calibration)):
        if path is not None and not path.is_file():
            raise MissingFileError(f"{name}: {path} is no file.")
    if machine.prior.endswith(".safetensors") and not Path(machine.prior).is_file():
        raise MissingFileError(f"prior: {machine.prior} is no file.")
    if machine.pump is not None:
        load_pump(machine.pump)
