"""Fillers by name."""

from importlib.metadata import entry_points

from swashtwin.foundation import InputError
from swashtwin.synthesis.distortion import Jitter
from swashtwin.synthesis.duplicates import Duplicate, NoisyDuplicate
from swashtwin.synthesis.filler import Filler
from swashtwin.synthesis.interpolation import ADASYN, SMOTE

FILLERS: dict[str, Filler] = {
    "duplicate": Duplicate(),
    "noisy_duplicate": NoisyDuplicate(),
    "jitter": Jitter(),
    "smote": SMOTE(),
    "smote_spectrum": SMOTE(space="spectrum"),
    "adasyn": ADASYN(),
    "adasyn_spectrum": ADASYN(space="spectrum"),
}
"""Fillers that need measured windows only, with their default settings; `register_filler` adds one."""
_ENTRY_POINTS = "swashtwin.fillers"


def register_filler(name: str, filler: Filler) -> None:
    """Add a filler under a name by which the studies and ``swashtwin bench augment`` find it.

    A package can have it added automatically, for the command line too, by an entry point `name` of the group
    ``swashtwin.fillers`` that points at `filler`.

    Raises
    ------
    InputError
        The name is taken, or the filler cannot be called.
    """
    if not isinstance(filler, Filler):
        raise InputError(f"filler {name!r} is {filler!r}, which cannot be called; see Filler.")
    if name in FILLERS:
        raise InputError(f"a filler named {name!r} is registered already; choose another name.")
    FILLERS[name] = filler


def has_filler(name: str) -> bool:
    """Whether a filler has this name, be it registered or offered by the entry point of a package."""
    if name not in FILLERS:
        for entry in entry_points(group=_ENTRY_POINTS, name=name):
            register_filler(name, entry.load())
    return name in FILLERS
