"""Files of pump priors, a card with arrays beside under the names of version 2, and those that are
shipped.
"""

from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from swashtwin.foundation import (
    InputError,
    from_table,
    read_artifact,
    to_table,
    translate_load_errors,
    write_artifact,
)

P = TypeVar("P")

VERSION = 2
_MAY_BE_NAN = ("levels", "speed", "pressure")
SHIPPED = Path(__file__).parent / "priors"
"""Folder of the shipped priors, one for each design."""


def save_prior(prior: Any, path: Path | str, kind: str) -> Path:
    """`path`, after a `PriorClassifier` was written to it whole."""
    arrays = {
        "levels": prior.band_powers,
        "speed": prior.point_speed,
        "pressure": prior.point_pressure,
    }
    parts = {"virtual": prior.virtual, "head": prior.head}
    names = {item.name for item in fields(prior)} - {
        "band_powers",
        "point_speed",
        "point_pressure",
        *parts,
    }
    card = to_table({name: getattr(prior, name) for name in sorted(names)})
    for part, values in parts.items():
        arrays |= (
            {f"{part}_{name}": value for name, value in vars(values).items()}
            if values is not None
            else {}
        )
    return write_artifact(path, kind, VERSION, card, arrays, may_be_nan=_MAY_BE_NAN)


def load_prior(path: Path | str, form: type[P], kind: str) -> P:
    """What `save_prior` wrote, or the shipped prior of a design; errors: `PriorClassifier.load`."""
    if not Path(path).suffix:
        shipped = {file.stem: file for file in sorted(SHIPPED.glob("*.safetensors"))}
        if str(path) not in shipped:
            if Path(path).exists():
                raise InputError(
                    f"{path} is no model or prior; name the file that swashtwin train or twin prior wrote."
                )
            raise InputError(
                f"no prior of the design {path} is shipped (there is {', '.join(shipped)}); make one with swashtwin "
                "twin prior --pump FILE, and give its file."
            )
        path = shipped[str(path)]
    advice = "make it with swashtwin twin prior, or with swashtwin model adapt"
    card, tensors = read_artifact(path, kind, VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)
    with translate_load_errors(path, kind):
        band_powers, speed, pressure = (tensors[name] for name in ("levels", "speed", "pressure"))
        arrays: dict[str, Any] = {
            "band_powers": band_powers,
            "point_speed": speed,
            "point_pressure": pressure,
        }
        for part in ("virtual", "head"):
            own = {
                name.removeprefix(f"{part}_"): tensors[name]
                for name in tensors
                if name.startswith(f"{part}_")
            }
            arrays |= {part: own} if own else {}
        return from_table({**card, **arrays}, form)
