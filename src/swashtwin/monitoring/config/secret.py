"""Passwords and tokens: taken from the environment, never shown."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import quote, urlsplit

from swashtwin.foundation import InputError

_VARIABLE = re.compile(r"\$\{(\w+)\}")


@dataclass(frozen=True)
class Secret:
    """A text that no log, error or ``repr`` shows.

    Examples
    --------
    >>> Secret("hunter2"), str(Secret("hunter2")), bool(Secret(""))
    (Secret(***), '***', False)
    """

    text: str = field(repr=False)
    """The secret itself; `reveal` says in a program that it is wanted."""

    def reveal(self) -> str:
        """The secret itself, to be handed to a server and to nothing else."""
        return self.text

    def __repr__(self) -> str:
        return "Secret(***)"

    def __str__(self) -> str:
        return "***"

    def __bool__(self) -> bool:
        return bool(self.text)


NO_SECRET = Secret("")
"""Stands where no secret is needed."""


def fill_variables(text: str, name: str, environment: Mapping[str, str], *, in_url: bool = False) -> str:
    """`text` with each ``${NAME}`` replaced by that environment variable.

    Parameters
    ----------
    name : how the error message calls the text.
    in_url : whether values are quoted as a part of a URL.

    Raises
    ------
    InputError
        A variable is not set.
    """

    def value(match: re.Match[str]) -> str:
        if match[1] not in environment:
            raise InputError(f"{name} needs the environment variable {match[1]}, which is not set.")
        return quote(environment[match[1]], safe="") if in_url else environment[match[1]]

    return _VARIABLE.sub(value, text)


def names_variable(text: str) -> bool:
    """Whether `text` is one ``${NAME}`` and nothing else."""
    return _VARIABLE.fullmatch(text) is not None


def plain_password(url: str) -> bool:
    """Whether a URL holds a password that is written out."""
    try:
        password = urlsplit(url).password
    except ValueError:
        return False
    return bool(password) and not names_variable(password or "")
