"""Settings of a network, checked against its constructor before anything is built."""

import difflib
import inspect
import math
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from typing import Any, ClassVar

import numpy as np

from swashtwin.foundation import InputError


class Configured:
    """What networks of both kinds have in common: a name, and the settings that build one again."""

    name: ClassVar[str]
    """Key in the registry; saved models name their network by it."""
    settings: dict[str, Any]
    """Arguments that build this network again; numbers, words, and tuples of these."""

    @property
    def n_channels(self) -> int:
        """Channels of a window."""
        return int(self.settings["n_channels"])

    @property
    def n_classes(self) -> int:
        """Classes told apart."""
        return int(self.settings["n_classes"])

    @property
    def uses_speed(self) -> bool:
        """Whether `represent_at` looks at the speed."""
        return False


def require_sizes(name: str, settings: dict[str, Any]) -> None:
    """Refuse a whole number below 1 among the settings of a network, and a `dropout` that is no share."""
    for word, value in settings.items():
        counts = value if isinstance(value, tuple) else (value,)
        if not counts:
            raise InputError(f"{name}: {word} needs as many as one entry.")
        if isinstance(counts[0], int) and min(counts) < 1 and not isinstance(value, bool):
            raise InputError(f"{name}: {word} ({min(counts)}) must be at least 1.")
    if not 0 <= settings.get("dropout", 0) < 1:
        share = settings["dropout"]
        raise InputError(f"{name}: dropout ({share:g}) is a share, at least 0 and below 1; a tenth is 0.1.")


def require_shapes(needed: Mapping[str, tuple[int, ...]], weights: Mapping[str, np.ndarray]) -> None:
    """Raise a `ValueError` that names the first weight that is missing, unknown, or of another shape than needed."""
    for name in [*needed, *weights]:
        shapes = needed.get(name), weights[name].shape if name in weights else None
        if shapes[0] != shapes[1]:
            raise ValueError(f"weight {name} has the shape {shapes[1]}, its settings ask for {shapes[0]}")


def default_settings(kind: Any) -> dict[str, Any]:
    """Default of every setting of a network by name; a subclass has those of its base class too."""
    defaults: dict[str, Any] = {}
    constructors = [vars(owner).get("__init__", kind.__init__) for owner in kind.__mro__]
    if build := getattr(kind, "build", None):  # a person's own module
        constructors = [build]
    for constructor in constructors:
        parameters = inspect.signature(constructor).parameters.values()
        defaults |= {item.name: item.default for item in parameters if item.default is not item.empty}
        if all(item.kind is not item.VAR_KEYWORD for item in parameters):
            break
    return defaults


def checked_settings(kind: Any, settings: dict[str, Any]) -> dict[str, Any]:
    """`settings` as the constructor takes them: one entry for a setting of several becomes a tuple of one.

    Raises
    ------
    InputError
        The network has no setting of that name (the nearest is offered), or its value is of another kind than the
        default: a share or a word instead of a whole number, or several numbers instead of one.
    """
    defaults = default_settings(kind)
    checked = {}
    for word, value in settings.items():
        if word not in defaults:
            near = difflib.get_close_matches(word, defaults, n=1)
            hint = f" Did you mean {near[0]}?" if near else ""
            raise InputError(f"network {kind.name} has no setting {word!r}; it has {', '.join(defaults)}.{hint}")
        checked[word] = _checked(f"{kind.name}: {word}", value, defaults[word])
    return checked


def _checked(what: str, value: Any, default: Any) -> Any:
    if default is None or isinstance(default, tuple):  # none by default: whole numbers, worked out from the others
        if value is None and default is None:
            return None
        entries = tuple(value) if isinstance(value, Sequence) and not isinstance(value, str) else (value,)
        return tuple(_checked(what, entry, default[0] if default else 1) for entry in entries)
    if isinstance(default, bool):
        fits, expected = isinstance(value, bool), "true or false"
    elif isinstance(default, int):
        fits, expected = isinstance(value, Integral) and not isinstance(value, bool), "a whole number"
    elif isinstance(default, float):
        fits = isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
        expected = "a number"
    else:
        fits, expected = isinstance(value, str), "a word"
    if not fits:
        raise InputError(f"{what} ({value}) must be {expected}; {default} is usual.")
    return type(default)(value)
