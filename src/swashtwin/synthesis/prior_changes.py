"""What faults change in the recordings of many virtual pumps."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Shaped
from joblib import delayed

from swashtwin.foundation import InputError, SwashTwinError, parallel, stream
from swashtwin.pump import CLASSES
from swashtwin.signals import OrderBands
from swashtwin.synthesis.pump_prior import OTHER, PumpPrior, draw_drawing
from swashtwin.synthesis.virtual_pump import CELLS, VirtualPump

_REFERENCES = 4
"""Healthy recordings of a virtual pump, of which one to all are its reference."""
_TESTED = ("normal", "normal", *(label for label in CLASSES if label != "normal"), OTHER)
"""Classes of the recordings of a virtual pump that are compared with its references."""


@dataclass(frozen=True, eq=False)
class OrderChanges:
    """Changes of the levels of simulated recordings against the healthy ones of their pumps."""

    bands: OrderBands
    """Bands of the drawing's levels; a pump of another number of pistons has as many."""
    change: Float[np.ndarray, "recording channel level"]
    """Level (`OrderBands.levels`), less its mean over the pump's reference recordings."""
    label: Shaped[np.ndarray, " recording"]
    """Class of each recording."""
    pump: Int[np.ndarray, " recording"]
    """Row of its pump."""
    scatter: Float[np.ndarray, "pump channel level"]
    """Standard deviation of the levels between healthy recordings of each pump."""
    drawn: Bool[np.ndarray, " pump"]
    """Whether each pump has a drawing of its own."""


def simulate_changes(
    prior: PumpPrior,
    count: int,
    *,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> OrderChanges:
    """Healthy recordings and one of each fault, of `count` virtual pumps, as changes against their references.

    Every other pump has a drawing of its own (`draw_drawing`), for no machine is its drawing. Only spectra of the
    steady state are computed, no samples: about 0.1 s of a core for a pump. A pump does not depend on how many are
    drawn with it.

    Parameters
    ----------
    jobs : processes side by side.
    progress : called with the number of pumps that are done, and of all.

    Raises
    ------
    InputError
        Fewer than two pumps, or none whose chamber pressures converge.
    """
    if count < 2:
        raise InputError(f"a pump prior needs two pumps at least, not {count}.")
    work = parallel(jobs, return_as="generator")(
        delayed(_changes_of_pump)(prior, seed, number) for number in range(count)
    )
    parts = []
    for number, part in enumerate(work, 1):
        parts.append(part)
        if progress is not None:
            progress(number, count)
    drawn = np.array([number % 2 == 1 for number, part in enumerate(parts) if part is not None], dtype=bool)
    if not drawn.size:
        raise InputError(f"no chamber pressure of {count} virtual pumps of {prior.pump.name} converges.")
    changes, scatter = zip(*(part for part in parts if part is not None), strict=True)
    return OrderChanges(
        OrderBands(prior.pump.rotating_group.piston_count),
        np.concatenate(changes),
        np.tile(np.array(_TESTED), drawn.size),
        np.repeat(np.arange(drawn.size), len(_TESTED)),
        np.stack(scatter),
        drawn,
    )


def _changes_of_pump(
    prior: PumpPrior, seed: int, number: int
) -> tuple[Float[np.ndarray, "recording channel level"], Float[np.ndarray, "channel level"]] | None:
    """(changes of one pump, its healthy scatter); None where the chamber pressures of a recording do not converge."""
    torch.set_num_threads(1)
    rng = stream(seed, "pump prior", number)
    drawing = draw_drawing(rng) if number % 2 else prior.pump
    bands = OrderBands(drawing.rotating_group.piston_count)
    highest = int(bands.highest * bands.piston_count) + 1
    try:
        power = VirtualPump(prior, rng, drawing, highest).spectra(("normal",) * _REFERENCES + _TESTED)
    except SwashTwinError:
        return None
    levels = bands.levels(power, 1 / CELLS)
    references = levels[: int(rng.integers(1, _REFERENCES + 1))]
    scatter = levels[:_REFERENCES].std(axis=0, ddof=1)
    return (levels[_REFERENCES:] - references.mean(axis=0)).astype(np.float16), scatter.astype(np.float16)
