"""Networks by name, and their settings, checked against the constructor before anything is
built.
"""

import difflib
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from swashtwin.foundation import InputError, load_extra
from swashtwin.learning.networks.solved_network import SolvedNetwork, require_shapes

if TYPE_CHECKING:
    from torch import nn

    from swashtwin.learning.networks.network import Network

AnyNetwork: TypeAlias = "Network | SolvedNetwork"
"""A network of either kind: trained in epochs by torch, or solved by numpy."""

NETWORKS: dict[str, type | tuple[str, str]] = {
    "band_powers": ("band_power_network", "BandPowerNetwork"),
    "extra_trees": ("tree_network", "ExtraTrees"),
    "random_forest": ("tree_network", "RandomForest"),
    "bitcn": ("bitcn", "BiTCN"),
}
"""Class of each network, or module and name of a class of this package that nobody needed yet
(`network_class`).
"""

BUILT_IN = frozenset(NETWORKS)
"""Names of the networks of this package, which no other network can take."""
_ENTRY_POINTS = "swashtwin.networks"


def network_class(name: str) -> Any:
    """Class of the network of that name; a saved model is built again by it.

    Raises
    ------
    InputError
        No network is called so; the nearest is offered.
    MissingExtraError
        The network needs torch, which is not installed.
    """
    if name not in NETWORKS:
        for entry in entry_points(group=_ENTRY_POINTS, name=name):
            register_network(name, entry.load())
    if name not in NETWORKS:
        near = difflib.get_close_matches(name.lower(), NETWORKS, n=1, cutoff=0.3)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise InputError(
            f"unknown network {name!r}; there are {', '.join(sorted(NETWORKS))}.{hint}"
        )
    found = NETWORKS[name]
    if isinstance(found, tuple):
        module = load_extra(
            f"swashtwin.learning.networks.{found[0]}", "networks", f"the network {name}"
        )
        found = NETWORKS[name] = getattr(module, found[1])
    return found


def register_network(name: str, network: "type[AnyNetwork] | Callable[..., nn.Module]") -> None:
    """Make an own network known under `name`, to be trained, saved and loaded like any other.

    A saved model names its network only, so the same call must come before it is loaded elsewhere.
    A package can have it made automatically, for the command line too, by an entry point `name` of
    the group ``swashtwin.networks`` that points at `network`.

    Parameters
    ----------
    name : new name; registering it again replaces the earlier network.
    network : a function, or a class, that gives a `torch.nn.Module` from ``(n_channels, n_classes,
        length)``. The module takes scaled windows ``(window, channel, sample)`` and gives
        ``(window, class)`` scores before softmax. Further arguments with defaults are settings. Or
        a subclass of `Network`, or of `SolvedNetwork` where numpy finds the weights at once, which
        has this `name`.

    Raises
    ------
    InputError
        The name is empty, belongs to a network of this package, or the class has another name; or
        it takes other arguments.

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
        raise InputError("a network needs a name that is not empty; a saved model is loaded by it.")
    if name in BUILT_IN:
        raise InputError(f"the name {name!r} belongs to a network of swashtwin; choose another.")
    own: Any = network
    if hasattr(own, "represent_at"):
        if own.name != name:
            raise InputError(f"{own.__name__}.name is {own.name!r}; register it under that name.")
        NETWORKS[name] = own
    else:
        from swashtwin.learning.networks.network import OwnModule

        signature = inspect.signature(network)
        try:
            signature.bind(1, 2, 64)
        except TypeError as cause:
            raise InputError(
                f"network {name!r} is called with (n_channels, n_classes, length), but takes {signature}: {cause}; "
                "give further arguments defaults."
            ) from None
        NETWORKS[name] = type(name, (OwnModule,), {"name": name, "build": staticmethod(network)})


def build_network(
    name: str, n_channels: int, n_classes: int, *, length: int | None = None, **settings: Any
) -> AnyNetwork:
    """The network of that name with untrained weights.

    Parameters
    ----------
    length : samples per window and channel; only networks from `register_network` need it.

    Raises
    ------
    InputError
        No network or none of its settings is called so (the nearest is offered), or a setting
        cannot be.
    MissingExtraError
        The network needs torch, which is not installed.
    """
    kind = network_class(name)
    checked = checked_settings(kind, settings)
    if hasattr(kind, "build"):
        if length is None:
            raise InputError(
                f"network {name!r} is built for one window length; give that length, in samples."
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
    """The network of that name with settings and weights of a saved one.

    Raises
    ------
    InputError
        As `build_network`.
    ValueError
        The weights are not those of a network with these settings; one of this package takes no
        memory before.
    """
    if not issubclass(network_class(name), SolvedNetwork) and name in BUILT_IN:
        import torch

        with torch.device("meta"):
            unloaded: Any = build_network(name, **settings)
        needed = {key: tuple(value.shape) for key, value in unloaded.state_dict().items()}
        require_shapes(needed, weights)
    return build_network(name, **settings).loaded(weights)


def default_settings(kind: Any) -> dict[str, Any]:
    """Default of every setting of a network by name; a subclass has those of its base class too."""
    defaults: dict[str, Any] = {}
    build = getattr(kind, "build", None)  # of a person's own module
    for constructor in (
        [build] if build else [vars(owner).get("__init__", kind.__init__) for owner in kind.__mro__]
    ):
        parameters = inspect.signature(constructor).parameters.values()
        defaults |= {
            item.name: item.default for item in parameters if item.default is not item.empty
        }
        if all(item.kind is not item.VAR_KEYWORD for item in parameters):
            break
    return defaults


def checked_settings(kind: Any, settings: dict[str, Any]) -> dict[str, Any]:
    """`settings` as the constructor takes them: one entry for a setting of several becomes a tuple
    of one.

    Raises
    ------
    InputError
        The network has no setting of that name (the nearest is offered), or the value is of another
        kind.
    """
    defaults = default_settings(kind)
    checked = {}
    for word, value in settings.items():
        if word not in defaults:
            near = difflib.get_close_matches(word, defaults, n=1)
            hint = f" Did you mean {near[0]}?" if near else ""
            raise InputError(
                f"network {kind.name} has no setting {word!r}; it has {', '.join(defaults)}.{hint}"
            )
        checked[word] = _checked(f"{kind.name}: {word}", value, defaults[word])
    return checked


_KINDS: dict[type, tuple[Any, str]] = {
    bool: (bool, "true or false"), int: (Integral, "a whole number"), float: (Real, "a number"), str: (str, "a word"),
}  # fmt: skip
"""What a setting with a default of such a type may be."""


def _checked(what: str, value: Any, default: Any) -> Any:
    if default is None or isinstance(
        default, tuple
    ):  # none by default: whole numbers, worked out from the others
        if value is None and default is None:
            return None
        entries = (
            tuple(value) if isinstance(value, Sequence) and not isinstance(value, str) else (value,)
        )
        return tuple(_checked(what, entry, default[0] if default else 1) for entry in entries)
    kind, expected = next(
        (known for usual, known in _KINDS.items() if isinstance(default, usual)), _KINDS[str]
    )
    is_bool_for_number = isinstance(value, bool) and kind is not bool
    if (
        not isinstance(value, kind)
        or is_bool_for_number
        or (kind is Real and not math.isfinite(value))
    ):
        raise InputError(f"{what} ({value}) must be {expected}; {default} is usual.")
    return type(default)(value)
