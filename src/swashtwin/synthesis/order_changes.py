"""Changes of the order spectra of virtual pumps by faults, from which a pump prior learns."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Shaped

from swashtwin.foundation import InputError, SwashTwinError, parallel, random_stream
from swashtwin.pump import CLASSES
from swashtwin.signals import OrderBands
from swashtwin.synthesis.pump_prior import OTHER_TROUBLE, PumpPrior, draw_drawing
from swashtwin.synthesis.virtual_pump import CELLS, VirtualPump

# Healthy recordings of a virtual pump, of which one to all are its reference.
_REFERENCES = 4

# Classes of the recordings of a virtual pump that are compared with its references.
_TESTED = ("normal", "normal", *(label for label in CLASSES if label != "normal"), OTHER_TROUBLE)


@dataclass(frozen=True, eq=False)
class OrderChanges:
    """Changes of the band powers of simulated recordings against healthy ones of the same pumps."""

    bands: OrderBands
    """Bands of the drawing; a pump with another number of pistons has as many."""
    change: Float[np.ndarray, "recording channel band"]
    """`OrderBands.log_powers`, less their mean over the pump's reference recordings."""
    label: Shaped[np.ndarray, " recording"]
    pump: Int[np.ndarray, " recording"]
    """Row of its pump."""
    scatter: Float[np.ndarray, "pump channel band"]
    """Standard deviation of the band powers between healthy recordings of each pump."""
    has_own_drawing: Bool[np.ndarray, " pump"]
    """Whether each pump has another drawing than the prior's."""


def simulate_changes(
    prior: PumpPrior,
    count: int,
    *,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> OrderChanges:
    """Simulate `count` virtual pumps, healthy and with each fault.

    Every second pump has another drawing (`draw_drawing`), because no machine is exactly its
    drawing. Only spectra of the steady state are computed, no samples: about 0.1 s of one core for
    a pump. A pump does not depend on how many are drawn with it.

    Parameters
    ----------
    jobs : number of processes, unless a cluster does the work (`swashtwin.foundation.parallel`).
    progress : called with the number of finished pumps, and the total.

    Raises
    ------
    InputError
        Fewer than two pumps, or none whose chamber pressures converge.
    """
    if count < 2:
        raise InputError(f"A pump prior needs at least two pumps, not {count}.")

    work = parallel(
        partial(_simulate_pump, prior, seed), [(number,) for number in range(count)], jobs=jobs
    )
    changes = []
    scatter = []
    has_drawing = []
    for number, result in enumerate(work):
        if result is not None:
            changes.append(result[0])
            scatter.append(result[1])
            has_drawing.append(_has_own_drawing(number))
        if progress is not None:
            progress(number + 1, count)

    n_pumps = len(changes)
    if not n_pumps:
        raise InputError(
            f"The chamber pressures of all {count} virtual pumps of {prior.pump.name} diverge. "
            "Check the rated speed, the rated pressure and the valve plate in the pump file."
        )
    return OrderChanges(
        bands=OrderBands(prior.pump.rotating_group.piston_count),
        change=np.concatenate(changes),
        label=np.tile(np.array(_TESTED), n_pumps),
        pump=np.repeat(np.arange(n_pumps), len(_TESTED)),
        scatter=np.stack(scatter),
        has_own_drawing=np.array(has_drawing, dtype=bool),
    )


def _has_own_drawing(number: int) -> bool:
    return number % 2 == 1


def _simulate_pump(
    prior: PumpPrior, seed: int, number: int
) -> tuple[Float[np.ndarray, "recording channel band"], Float[np.ndarray, "channel band"]] | None:
    """Return the changes of one pump and its healthy scatter.

    None if the chamber pressures of a recording do not converge.
    """
    torch.set_num_threads(1)
    rng = random_stream(seed, "pump prior", number)
    drawing = draw_drawing(rng) if _has_own_drawing(number) else prior.pump
    bands = OrderBands(drawing.rotating_group.piston_count)
    highest = int(bands.highest * bands.piston_count) + 1
    try:
        pump = VirtualPump(prior, rng, drawing, highest)
        power = pump.spectra(("normal",) * _REFERENCES + _TESTED)
    except SwashTwinError:
        return None

    band_powers = bands.log_powers(power, 1 / CELLS)
    n_references = int(rng.integers(1, _REFERENCES + 1))
    reference = band_powers[:n_references].mean(axis=0)
    scatter = band_powers[:_REFERENCES].std(axis=0, ddof=1)
    changes = band_powers[_REFERENCES:] - reference
    # Half precision is enough: 2,000 pumps have some 20 million changes.
    return changes.astype(np.float16), scatter.astype(np.float16)
