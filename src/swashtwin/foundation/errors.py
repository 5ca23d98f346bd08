"""Everything swashtwin raises on purpose.

Each error is a `SwashTwinError` and also the builtin error a caller would expect, so ``except
ValueError`` still works. An error states what is wrong with which value, what is allowed, and what
to do.

What to do depends on who reads it: a setting is `unit='g'` in Python, ``--unit g`` on the command
line and ``unit = "g"`` in an index file. A remedy therefore names settings in braces, as in
``Set {unit='g'}.``, and whoever shows the error spells them (`render_settings`).
"""

import re
from collections.abc import Callable

Spelling = Callable[[str, str], str]
"""Spells a setting from its name and its value; the value is ``""`` if none is proposed."""

_SETTING = re.compile(r"\{\{|\}\}|\{(?P<name>\w+)(?:=(?P<value>[^{}]*))?\}")


def spell_for_python(name: str, value: str) -> str:
    """Return a setting as a Python argument.

    Examples
    --------
    >>> spell_for_python("unit", "'g'"), spell_for_python("unit", "")
    ("unit='g'", 'unit')
    """
    return f"{name}={value}" if value else name


def spell_for_index(name: str, value: str) -> str:
    """Return a setting as a key of an index file (TOML).

    Examples
    --------
    >>> spell_for_index("unit", "'g'"), spell_for_index("unit", "")
    ('unit = "g"', 'unit')
    """
    if not value:
        return name
    toml_value = value.replace("'", '"')
    return f"{name} = {toml_value}"


def spell_in_words(name: str, value: str) -> str:
    """Return a setting for readers of unknown kind: a verdict may be printed, stored or shown.

    Examples
    --------
    >>> spell_in_words("sample_rate", "'25.6 kHz'"), spell_in_words("unit", "")
    ('sample rate (such as 25.6 kHz)', 'unit')
    """
    setting_name = name.replace("_", " ")
    bare_value = value.strip("'\"")
    return f"{setting_name} (such as {bare_value})" if bare_value else setting_name


def render_settings(text: str, spelling: Spelling = spell_for_python) -> str:
    """Return a text with the settings that stand in braces spelled out.

    Parameters
    ----------
    text : text with settings such as ``{unit}`` or ``{unit='g'}``; a doubled brace is a brace.
    spelling : how a setting is written for the reader.

    Examples
    --------
    >>> render_settings("Set {unit='g'}, or leave out {sample_rate}.")
    "Set unit='g', or leave out sample_rate."
    """

    def spelled(match: re.Match[str]) -> str:
        if match["name"] is None:
            return match[0][0]
        return spelling(match["name"], match["value"] or "")

    return _SETTING.sub(spelled, text)


def propose_setting(name: str, value: str) -> str:
    """Return a setting in braces with a proposed value, for a remedy.

    A value from a file may hold braces or quotes, which would be read as a setting: then the
    setting is named without a value.

    Examples
    --------
    >>> propose_setting("specimen", "A"), propose_setting("specimen", "{label}")
    ("{specimen='A'}", '{specimen}')
    """
    if re.search(r"[{}']", value):
        return f"{{{name}}}"
    return f"{{{name}='{value}'}}"


class SwashTwinError(Exception):
    """Base of every error that swashtwin raises on purpose.

    Parameters
    ----------
    message : what is wrong with which value, and what is allowed.
    field : name of the argument or setting that is to be changed.
    remedy : sentence that states what to do, with settings in braces (`render_settings`).
    """

    def __init__(self, message: str = "", *, field: str = "", remedy: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.field = field
        self.remedy = remedy

    def __str__(self) -> str:
        return self.describe()

    def describe(self, spelling: Spelling = spell_for_python) -> str:
        """Return message and remedy as one line, with settings spelled for the reader."""
        if not self.remedy:
            return self.message
        return f"{self.message} {render_settings(self.remedy, spelling)}"

    def with_context(self, prefix: str) -> "SwashTwinError":
        """Return the same error with a text before its message, such as the file's name."""
        return type(self)(f"{prefix}{self.message}", field=self.field, remedy=self.remedy)


class InputError(SwashTwinError, ValueError):
    """A value that a caller gave is invalid."""


class UnitError(InputError):
    """A quantity has no unit, or a unit of another dimension."""


class DataError(SwashTwinError, ValueError):
    """A file or a recording is damaged, incomplete, or contradicts what was specified."""


class MissingFileError(DataError, FileNotFoundError):
    """A specified file does not exist."""


class LeakError(SwashTwinError, ValueError):
    """A split or an evaluation would let training see test data."""


class StabilityError(SwashTwinError, ValueError):
    """An integration step lies above the stability limit."""


class ArtifactError(DataError):
    """A saved model or result was changed, damaged, or written by another version."""


class ClusterError(SwashTwinError, RuntimeError):
    """A cluster is gone, or one of its workers cannot do the work."""


class MissingExtraError(SwashTwinError, ImportError):
    """An optional dependency is required but not installed."""
