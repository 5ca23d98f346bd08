"""The golden listing of the stored keys of each kind of saved file."""

import re
import sys
from pathlib import Path
from typing import Any

from golden_files import load_golden, save_golden
from saved_kinds import SAVED_KINDS

STORED_KEYS = "stored_keys"
"""Name of the golden file."""


def stored_keys(name: str, path: Path) -> dict[str, Any]:
    """Return the version and the stored keys of a file of a kind."""
    file = SAVED_KINDS[name].file
    version = re.sub(r".* ", "", file.version(path))
    if name == "series":
        # It is that of swashtwin, in every release another.
        version = ""
    return {"version": version, "keys": file.keys(path)}


def save_stored_keys(folder: Path) -> None:
    """Write the listing anew, unless a kind has other keys under the same version."""
    golden = load_golden(STORED_KEYS)
    listing = {}
    for name, kind in SAVED_KINDS.items():
        kind_folder = folder / name.replace(" ", "_")
        kind_folder.mkdir()
        listing[name] = stored_keys(name, kind.write(kind_folder))
        previous = golden.get(name, listing[name])
        has_same_version = previous["version"] == listing[name]["version"] != ""
        if has_same_version and previous != listing[name]:
            sys.exit(f"{name}: its stored keys changed; raise its version first.")
    save_golden(STORED_KEYS, listing)
