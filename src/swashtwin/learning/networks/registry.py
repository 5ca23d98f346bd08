"""Networks by name, and the check of their settings before anything is built."""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from swashtwin.foundation import InputError, closest_name, load_extra
from swashtwin.learning.networks.solved_network import SolvedNetwork, require_shapes

if TYPE_CHECKING:
    from torch import nn

    from swashtwin.learning.networks.network import Network

AnyNetwork: TypeAlias = "Network | SolvedNetwork"
"""A network of either kind: trained in epochs by torch, or solved by numpy."""

NETWORKS: dict[str, type | tuple[str, str]] = {
    "band_powers": ("band_power_network", "BandPowerNetwork"),
    "line_prominences": ("line_prominence_network", "LineProminenceNetwork"),
    "extra_trees": ("tree_network", "ExtraTrees"),
    "random_forest": ("tree_network", "RandomForest"),
    "bitcn": ("bitcn", "BiTCN"),
}
"""Class of each network, or module and name of a class that is not imported yet (`network_class`).
"""

BUILT_IN = frozenset(NETWORKS)
"""Names of the networks of this package, which no other network can use."""
_ENTRY_POINTS = "swashtwin.networks"


def network_class(name: str) -> Any:
    """Return the class of a network; a saved model is built again by it.

    Raises
    ------
    InputError
        The name is unknown; the nearest is suggested.
    MissingExtraError
        The network needs torch, which is not installed.
    """
    if name not in NETWORKS:
        for entry in entry_points(group=_ENTRY_POINTS, name=name):
            register_network(name, entry.load())
    if name not in NETWORKS:
        suggestion = closest_name(name, NETWORKS)
        hint = f" Did you mean {suggestion!r}?" if suggestion else ""
        raise InputError(
            f"unknown network {name!r}; there are {', '.join(sorted(NETWORKS))}.{hint}"
        )

    network = NETWORKS[name]
    if isinstance(network, tuple):
        module_name, class_name = network
        module = load_extra(
            f"swashtwin.learning.networks.{module_name}", "networks", f"the network {name}"
        )
        network = getattr(module, class_name)
        NETWORKS[name] = network
    return network


def register_network(name: str, network: "type[AnyNetwork] | Callable[..., nn.Module]") -> None:
    """Register a network under `name`, to be trained, saved and loaded like any other.

    A saved model holds the name of its network only, so the same call must come before it is loaded
    elsewhere. A package can register one automatically, for the command line too, by an entry point
    `name` of the group ``swashtwin.networks`` that points at `network`.

    Parameters
    ----------
    name : new name; registering it again replaces the earlier network.
    network : a function, or a class, that returns a `torch.nn.Module`. It takes
        ``(n_channels, n_classes, length)``; further arguments with defaults are settings. The
        module takes scaled windows ``(window, channel, sample)`` and returns ``(window, class)``
        scores before softmax. Or a subclass of `Network` that has this `name`, or of
        `SolvedNetwork` if numpy solves for the weights directly.

    Raises
    ------
    InputError
        The name is empty, belongs to a network of this package, or is not that of the class; or
        the function takes other arguments.

    Examples
    --------
    >>> from torch import nn
    >>> def linear(n_channels, n_classes, length):
    ...     return nn.Sequential(nn.Flatten(), nn.Linear(n_channels * length, n_classes))
    >>> register_network("linear", linear)
    >>> build_network("linear", 2, 5, length=64).n_classes
    5
    >>> del NETWORKS["linear"]
    """
    if not name:
        raise InputError("A network needs a name that is not empty: a saved model is loaded by it.")
    if name in BUILT_IN:
        raise InputError(f"the name {name!r} belongs to a network of swashtwin; choose another.")

    candidate: Any = network
    if hasattr(candidate, "represent_at"):
        if candidate.name != name:
            raise InputError(
                f"{candidate.__name__}.name is {candidate.name!r}; register it under that name."
            )
        NETWORKS[name] = candidate
        return

    from swashtwin.learning.networks.network import OwnModule

    signature = inspect.signature(network)
    try:
        signature.bind(1, 2, 64)
    except TypeError as cause:
        raise InputError(
            f"network {name!r} is called with (n_channels, n_classes, length), but takes "
            f"{signature}: {cause}; give further arguments defaults."
        ) from None
    NETWORKS[name] = type(name, (OwnModule,), {"name": name, "build": staticmethod(network)})


def build_network(
    name: str, n_channels: int, n_classes: int, *, length: int | None = None, **settings: Any
) -> AnyNetwork:
    """Return the network of that name with untrained weights.

    Parameters
    ----------
    length : samples per window and channel; only networks from `register_network` need it.

    Raises
    ------
    InputError
        The network or a setting is unknown (the nearest is suggested), or a setting is invalid.
    MissingExtraError
        The network needs torch, which is not installed.
    """
    kind = network_class(name)
    checked = checked_settings(kind, settings)
    if hasattr(kind, "build"):
        if length is None:
            raise InputError(
                f"network {name!r} is built for one window length: specify that length, in samples."
            )
        checked["length"] = length
    sizes = {"n_channels": n_channels, "n_classes": n_classes}
    if issubclass(kind, SolvedNetwork):
        return kind(**sizes, **checked)
    from swashtwin.foundation import TorchStream

    with TorchStream(0):
        network: Network = kind(**sizes, **checked)
    return network


def rebuild_network(
    name: str, settings: dict[str, Any], weights: Mapping[str, np.ndarray]
) -> AnyNetwork:
    """Return the network of that name with settings and weights of a saved one.

    Raises
    ------
    InputError
        As `build_network`.
    ValueError
        The weights misfit the settings. Those of a network of this package are checked before it
        takes any memory.
    """
    if not issubclass(network_class(name), SolvedNetwork) and name in BUILT_IN:
        import torch

        # The meta device has shapes but no memory: settings of a damaged file may be huge.
        with torch.device("meta"):
            unloaded: Any = build_network(name, **settings)
        shapes = {key: tuple(value.shape) for key, value in unloaded.state_dict().items()}
        require_shapes(shapes, weights)
    return build_network(name, **settings).loaded(weights)


def default_settings(kind: Any) -> dict[str, Any]:
    """Return the default of every setting of a network class and of its base classes."""
    build = getattr(kind, "build", None)  # present if `register_network` wrapped a user's module
    if build:
        constructors = [build]
    else:
        constructors = [vars(owner).get("__init__", kind.__init__) for owner in kind.__mro__]

    defaults: dict[str, Any] = {}
    for constructor in constructors:
        parameters = inspect.signature(constructor).parameters.values()
        for parameter in parameters:
            if parameter.default is not parameter.empty:
                defaults[parameter.name] = parameter.default
        # A constructor passes further arguments on only if it takes `**settings`.
        if all(parameter.kind is not parameter.VAR_KEYWORD for parameter in parameters):
            break
    return defaults


def checked_settings(kind: Any, settings: dict[str, Any]) -> dict[str, Any]:
    """Return settings as the constructor takes them.

    A single entry for a setting of several becomes a tuple of one.

    Raises
    ------
    InputError
        The network has no setting of that name (the nearest is suggested), or the value is of
        another kind.
    """
    defaults = default_settings(kind)
    checked = {}
    for name, value in settings.items():
        if name not in defaults:
            suggestion = closest_name(name, defaults)
            hint = f" Did you mean {suggestion}?" if suggestion else ""
            raise InputError(
                f"network {kind.name} has no setting {name!r}; it has {', '.join(defaults)}.{hint}"
            )
        checked[name] = _check_value(f"{kind.name}: {name}", value, defaults[name])
    return checked


# Values that a setting takes by the type of its default; bool comes first, as it is an int too.
_KINDS: dict[type, tuple[Any, str]] = {
    bool: (bool, "true or false"),
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    str: (str, "a word"),
}


def _check_value(setting: str, value: Any, default: Any) -> Any:
    """Return a value in the type of the default; tuples entry by entry."""
    if default is None or isinstance(default, tuple):
        if value is None and default is None:
            return None
        is_several = isinstance(value, Sequence) and not isinstance(value, str)
        entries = tuple(value) if is_several else (value,)
        # A default of None stands for whole numbers that follow from other settings.
        entry_default = default[0] if default else 1
        return tuple(_check_value(setting, entry, entry_default) for entry in entries)

    kind, description = _KINDS[str]
    for default_type, entry in _KINDS.items():
        if isinstance(default, default_type):
            kind, description = entry
            break
    is_bool_for_number = isinstance(value, bool) and kind is not bool
    is_kind = isinstance(value, kind) and not is_bool_for_number
    if not is_kind or (kind is Real and not math.isfinite(value)):
        raise InputError(f"{setting} ({value}) must be {description}; the default is {default}.")
    return type(default)(value)
