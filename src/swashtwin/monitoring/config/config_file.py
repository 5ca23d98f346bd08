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
    describe_toml_error,
    from_table,
    parse_quantity,
    read_text,
    safe_file_name,
    shell_command,
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
from swashtwin.monitoring.config.time_zones import read_zone
from swashtwin.pump import load_pump, read_severity

# Start of an error message about an entry of a list, such as `source[0].`.
_LIST_INDEX = re.compile(r"^(\w+)\[(\d+)\](?:\.|: )")

# Name of an environment variable in a secret.
_VARIABLE = re.compile(r"\$\{(\w+)\}")


def load_watch_config(path: Path, environment: Mapping[str, str] | None = None) -> WatchConfig:
    """Return the configuration of a watch from its TOML file.

    Parameters
    ----------
    path : the file; relative paths in it start at its folder.
    environment : variables for ``${NAME}`` in secrets; by default those of the process.

    Raises
    ------
    MissingFileError, DataError, InputError
        The file or one that it names does not exist, or an entry is unknown, missing or invalid.
        The message is one line, names the file and the entry, and contains no secret.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(
            f"{path} does not exist; write one with: {shell_command('watch', 'init', path)}"
        )
    try:
        table = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as cause:
        raise DataError(f"{path}: not valid TOML: {describe_toml_error(cause)}.") from cause

    folder = path.absolute().parent
    variables = environment
    if variables is None:
        variables = os.environ

    def read(kind: type, value: Any) -> Any:
        if not isinstance(value, str):
            raise ValueError("it must be text in quotes")
        return _read_text_entry(kind, value, folder, variables)

    try:
        # The key has parentheses, so that no entry of the file can have its name.
        config = from_table({**table, "(file)": str(path.absolute())}, WatchConfig, to_array=read)
        _check(config)
    except InputError as cause:
        raise InputError(f"{path}: {_describe_entry_error(str(cause))}") from cause
    except SwashTwinError as cause:
        raise cause.with_context(f"{path}: ") from cause
    return config


def _describe_entry_error(text: str) -> str:
    """Return an error about an entry with the words that the file uses."""
    text = _LIST_INDEX.sub(lambda match: f"[[{match[1]}]] number {int(match[2]) + 1}: ", text)
    if "kind: " in text:
        text = (
            f"{text.rstrip('.')}; the kinds of a source are folder, mqtt, http, live, those of a "
            "channel log, webhook, mqtt, email."
        )
    return text if text.endswith(("?", ".")) else f"{text}."


def write_example(path: Path) -> Path:
    """Write a commented configuration to a file, and return its path.

    Raises
    ------
    InputError
        The file exists already.
    """
    path = Path(path)
    if path.exists():
        raise InputError(f"{path} exists already; name another file, or remove it.")
    example = resources.files(__package__) / "example.toml"
    return write_text(path, example.read_text(encoding="utf-8"))


def _read_text_entry(kind: type, value: str, folder: Path, environment: Mapping[str, str]) -> Any:
    """Return the path, quantity or secret of a text; raise `ValueError` if it is invalid."""
    if issubclass(kind, Path):
        return folder / Path(value).expanduser()
    if issubclass(kind, NameOrFile):
        # Names of the catalog have no suffix.
        if not value.endswith((".toml", ".safetensors")):
            return kind(value)
        return kind(folder / Path(value).expanduser())
    if issubclass(kind, Quantity):
        return _read_quantity(kind, value)
    return _read_secret(kind, value, environment)


def _read_quantity(kind: type[Quantity], value: str) -> Quantity:
    try:
        number = parse_quantity(value, kind.unit, name="it")
    except UnitError as cause:
        raise ValueError(str(cause).rstrip(".")) from cause
    if not math.isfinite(number) or number <= 0:
        raise ValueError(f"{value!r} must be above 0 {kind.unit}")
    return kind(number)


def _read_secret(kind: type, value: str, environment: Mapping[str, str]) -> Secret:
    """Return a secret with its environment variables replaced; refuse one that is written out."""
    is_url = issubclass(kind, SecretUrl)
    if is_url:
        _require_variable_as_password(value)
    elif not _VARIABLE.fullmatch(value):
        raise ValueError('it is written out; write "${NAME}" and set the environment variable NAME')

    def replace_variable(match: re.Match[str]) -> str:
        name = match[1]
        if name not in environment:
            raise ValueError(f"it needs the environment variable {name}, which is not set")
        if is_url:
            # A password may contain a character that ends it in a URL.
            return quote(environment[name], safe="")
        return environment[name]

    secret: Secret = kind(_VARIABLE.sub(replace_variable, value))
    return secret


def _require_variable_as_password(url: str) -> None:
    if "://" not in url:
        raise ValueError("it must be a URL, such as scheme://host/name")
    password = None
    with suppress(ValueError):  # what is invalid in the URL is reported when it is opened
        password = urlsplit(url).password
    if password and not _VARIABLE.fullmatch(password):
        raise ValueError("a password is written out; write scheme://user:${NAME}@host and set NAME")


def _check(config: WatchConfig) -> None:
    """Check what depends on several entries, or on other files."""
    if not config.machines:
        raise DataError("the file has no [[machine]]; add one with its name.")
    if not config.sources:
        raise DataError(
            'the file has no [[source]]; add one, such as kind = "folder" with its path.'
        )

    # Messages, topics and files refer to each of them by name.
    _require_unique_names("machine", [machine.name for machine in config.machines])
    _require_unique_names("source", [source.name for source in config.sources])
    _require_unique_names("channel", [channel.name for channel in config.channels])

    for machine in config.machines:
        try:
            _check_machine(machine)
        except SwashTwinError as cause:
            raise cause.with_context(f"[[machine]] {machine.name!r}: ") from cause
    for source in config.sources:
        if isinstance(source, HttpSource) or source.machine is None:
            continue
        if config.machine(source.machine) is None:
            raise DataError(
                f"[[source]] {source.name!r}: the file has no machine {source.machine!r}. Its "
                f"machines are {config.machine_names}."
            )


def _require_unique_names(table: str, names: list[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise DataError(
                f"{count} of [[{table}]] have the name {name!r}; give each a different name."
            )


def _check_machine(machine: Machine) -> None:
    # Waveforms of the machine are stored in a folder of its name.
    safe_name = safe_file_name(machine.name)
    if safe_name != machine.name:
        raise InputError(f"the name is also that of a folder; write it as {safe_name!r}.")

    if machine.model is not None:
        _require_file("model", machine.model)
    if machine.calibration is not None:
        _require_file("calibration", machine.calibration)
    if machine.prior.endswith(".safetensors"):
        _require_file("prior", Path(machine.prior))
    if machine.library is not None:
        _require_file("library", machine.library)
        _require_library(machine.library)
    _check_severity_limits(machine.severity_limits)
    if machine.tags_zone is not None:
        try:
            read_zone(machine.tags_zone)
        except InputError as cause:
            raise cause.with_context("tags_zone: ") from cause
    # A pump that cannot be loaded must fail now, not at the first alarm.
    if machine.pump is not None:
        load_pump(machine.pump)


def _check_severity_limits(limits: Mapping[str, str]) -> None:
    for kind, limit in limits.items():
        try:
            read_severity(kind, limit)
        except SwashTwinError as cause:
            raise cause.with_context(f"severity_limits: {kind}: ") from cause


def _require_library(path: Path) -> None:
    """Raise an error now, rather than at the first alarm, if a file is not a library."""
    # Imported here, since --help of each command reads the configuration's modules.
    from swashtwin.diagnosis import ChangeLibrary

    try:
        ChangeLibrary.load(path)
    except SwashTwinError as cause:
        raise cause.with_context("library: ") from cause


def _require_file(entry: str, path: Path) -> None:
    if not path.is_file():
        raise MissingFileError(f"{entry}: the file {path} does not exist.")
