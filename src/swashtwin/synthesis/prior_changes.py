"""What faults change in the recordings of many virtual pumps."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int, Shaped
from joblib import delayed

from swashtwin.foundation import InputError, SwashTwinError, parallel, stream
from swashtwin.pump import CLASSES
from swashtwin.signals import OrderBands
from swashtwin.synthesis.pump_prior import PumpPrior
from swashtwin.synthesis.virtual_pump import CELLS, OTHER, VirtualPump

_REFERENCES = 4
"""Healthy recordings of a virtual pump, of which one to all are its reference."""
_TESTED = ("normal", "normal", *(label for label in CLASSES if label != "normal"), OTHER)
"""Classes of the recordings of a virtual pump that are compared with its references."""


@dataclass(frozen=True, eq=False)
class OrderChanges:
    """Changes of the levels of simulated recordings against the healthy ones of their pumps."""

    bands: OrderBands
    """Bands of the levels."""
    change: Float[np.ndarray, "recording channel level"]
    """Level (`OrderBands.levels`), less its mean over the pump's reference recordings."""
    label: Shaped[np.ndarray, " recording"]
    """Class of each recording."""
    pump: Int[np.ndarray, " recording"]
    """Number of its pump."""


def simulate_changes(
    prior: PumpPrior,
    count: int,
    *,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> OrderChanges:
    """Healthy recordings and one of each fault, of `count` virtual pumps, as changes against their references.

    Only spectra of the steady state are computed, no samples: about 0.1 s of a core for a pump.

    Parameters
    ----------
    seed : addresses every draw; a pump does not depend on how many are drawn with it.
    jobs : processes side by side.
    progress : called with the number of pumps that are done, and of all.

    Raises
    ------
    InputError
        No pump, or none whose chamber pressures converge.
    """
    if count < 1:
        raise InputError(f"a pump prior needs a pump at least, not {count}.")
    bands = OrderBands(prior.pump.rotating_group.piston_count)
    work = parallel(jobs, return_as="generator")(
        delayed(_changes_of_pump)(prior, bands, seed, number) for number in range(count)
    )
    parts = []
    for number, part in enumerate(work, 1):
        parts.append(part)
        if progress is not None:
            progress(number, count)
    drawn = [number for number, part in enumerate(parts) if part is not None]
    if not drawn:
        raise InputError(f"no chamber pressure of {count} virtual pumps of {prior.pump.name} converges.")
    return OrderChanges(
        bands,
        np.concatenate([part for part in parts if part is not None]),
        np.tile(np.array(_TESTED), len(drawn)),
        np.repeat(drawn, len(_TESTED)),
    )


def _changes_of_pump(
    prior: PumpPrior, bands: OrderBands, seed: int, number: int
) -> Float[np.ndarray, "recording channel level"] | None:
    """Changes of one pump; None where the chamber pressures of one of its recordings do not converge."""
    torch.set_num_threads(1)
    rng = stream(seed, "pump prior", number)
    try:
        power = VirtualPump(prior, rng, int(bands.highest * bands.piston_count) + 1).spectra(
            ("normal",) * _REFERENCES + _TESTED
        )
    except SwashTwinError:
        return None
    levels = bands.levels(power, 1 / CELLS)
    references = levels[: int(rng.integers(1, _REFERENCES + 1))]
    return (levels[_REFERENCES:] - references.mean(axis=0)).astype(np.float32)
