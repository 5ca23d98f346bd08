"""Fillers by name."""

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


def register_filler(name: str, filler: Filler) -> None:
    """Add a filler under a name by which the studies and ``swashtwin bench augment`` find it.

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
