"""Networks by name."""

import difflib
import inspect
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any

from torch import nn

from swashtwin.foundation import InputError, TorchStream
from swashtwin.learning.networks.bitcn import BiTCN
from swashtwin.learning.networks.level_network import LevelNetwork
from swashtwin.learning.networks.network import Network
from swashtwin.learning.networks.own_module import OwnModule
from swashtwin.learning.networks.settings import checked_settings

NETWORKS: dict[str, type[Network]] = {network.name: network for network in (LevelNetwork, BiTCN)}
"""Class of each network; a saved model is built again by its name here."""


BUILT_IN = frozenset(NETWORKS)
"""Names of the networks of this package, which no other network can take."""
_ENTRY_POINTS = "swashtwin.networks"


def register_network(name: str, network: type[Network] | Callable[..., nn.Module]) -> None:
    """Make an own network known under `name`, to be trained, saved and loaded like any other.

    A saved model names its network only, so the same call must come before it is loaded elsewhere. A package can have
    it made automatically, for the command line too, by an entry point `name` of the group ``swashtwin.networks`` that
    points at `network`.

    Parameters
    ----------
    name : new name; registering it again replaces the earlier network.
    network : a function, or a class, that gives a `torch.nn.Module` from ``(n_channels, n_classes, length)``. The
        module takes scaled windows ``(window, channel, sample)`` and gives ``(window, class)`` scores before softmax.
        Further arguments with defaults are settings. Or a subclass of `Network`, which has this `name`.

    Raises
    ------
    InputError
        The name is empty, belongs to a network or a baseline of this package, or the class has another name; or it
        takes other arguments.

    Examples
    --------
    >>> def linear(n_channels, n_classes, length):
    ...     return nn.Sequential(nn.Flatten(), nn.Linear(n_channels * length, n_classes))
    >>> register_network("linear", linear)
    >>> build_network("linear", 2, 5, length=64).n_classes
    5
    >>> del NETWORKS["linear"]
    """
    from swashtwin.learning.estimators.registry import BASELINES  # scikit-learn takes a second to import

    if not name:
        raise InputError("a network needs a name that is not empty; a saved model is loaded by it.")
    if name in BUILT_IN or name in BASELINES:
        kind = "network" if name in BUILT_IN else "classifier on features"
        raise InputError(f"the name {name!r} belongs to a {kind} of swashtwin; choose another.")
    if isinstance(network, type) and issubclass(network, Network):
        if network.name != name:
            raise InputError(f"{network.__name__}.name is {network.name!r}; register it under that name.")
        NETWORKS[name] = network
    else:
        _require_arguments(name, network)
        NETWORKS[name] = type(name, (OwnModule,), {"name": name, "build": staticmethod(network)})


def _require_arguments(name: str, network: Callable[..., object]) -> None:
    """Refuse what cannot be called with channels, classes and length."""
    signature = inspect.signature(network)
    try:
        signature.bind(1, 2, 64)
    except TypeError as cause:
        raise InputError(
            f"network {name!r} is called with (n_channels, n_classes, length), but takes {signature}: {cause}; give "
            "further arguments defaults."
        ) from None


def has_network(name: str) -> bool:
    """Whether a network has this name, be it registered or offered by the entry point of a package."""
    if name not in NETWORKS:
        for entry in entry_points(group=_ENTRY_POINTS, name=name):
            register_network(name, entry.load())
    return name in NETWORKS


def build_network(name: str, n_channels: int, n_classes: int, *, length: int | None = None, **settings: Any) -> Network:
    """The network of that name with untrained weights.

    Parameters
    ----------
    length : samples per window and channel; only networks from `register_network` need it.

    Raises
    ------
    InputError
        No network or none of its settings is called so (the nearest is offered), or a setting cannot be.
    """
    if not has_network(name):
        near = difflib.get_close_matches(name.lower(), NETWORKS, n=1, cutoff=0.3)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise InputError(f"unknown network {name!r}; there are {', '.join(sorted(NETWORKS))}.{hint}")
    kind = NETWORKS[name]
    checked = checked_settings(kind, settings)
    if issubclass(kind, OwnModule):
        if length is None:
            raise InputError(f"network {name!r} is built for one window length; give that length, in samples.")
        checked["length"] = length
    with TorchStream(0):
        return kind(n_channels=n_channels, n_classes=n_classes, **checked)
