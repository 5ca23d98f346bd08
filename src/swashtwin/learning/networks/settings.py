"""Settings of a network, held against what its constructor takes before anything is built."""

import difflib
import inspect
import math
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any

from swashtwin.foundation import InputError
from swashtwin.learning.networks.network import Network


def default_settings(kind: type[Network]) -> dict[str, Any]:
    """Default of every setting of a network by name; an ablation has those of the network that it takes a part from."""
    found: dict[str, Any] = {}
    for owner in kind.__mro__:
        parameters = inspect.signature(vars(owner).get("__init__", kind.__init__)).parameters.values()
        found |= {one.name: one.default for one in parameters if one.default is not one.empty}
        if all(one.kind is not one.VAR_KEYWORD for one in parameters):
            break
    return found


def checked_settings(kind: type[Network], settings: dict[str, Any]) -> dict[str, Any]:
    """`settings` as the constructor takes them: one entry for a setting of several becomes a tuple of one.

    Raises
    ------
    InputError
        The network has no setting of that name (the nearest is offered), or its value is of another kind than the
        default: a share or a word where a whole number is due, several numbers for one.
    """
    taken = default_settings(kind)
    checked = {}
    for word, value in settings.items():
        if word not in taken:
            near = difflib.get_close_matches(word, taken, n=1)
            hint = f" Did you mean {near[0]}?" if near else ""
            raise InputError(f"network {kind.name} has no setting {word!r}; it has {', '.join(taken)}.{hint}")
        checked[word] = _checked(f"{kind.name}: {word}", value, taken[word])
    return checked


def _checked(what: str, value: Any, default: Any) -> Any:
    if default is None or isinstance(default, tuple):  # none by default: whole numbers, worked out from the others
        if value is None and default is None:
            return None
        entries = tuple(value) if isinstance(value, Sequence) and not isinstance(value, str) else (value,)
        return tuple(_checked(what, entry, default[0] if default else 1) for entry in entries)
    if isinstance(default, bool):
        fits, due = isinstance(value, bool), "true or false"
    elif isinstance(default, int):
        fits, due = isinstance(value, Integral) and not isinstance(value, bool), "a whole number"
    elif isinstance(default, float):
        fits = isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
        due = "a number"
    else:
        fits, due = isinstance(value, str), "a word"
    if not fits:
        raise InputError(f"{what} ({value}) must be {due}; {default} is usual.")
    return type(default)(value)
