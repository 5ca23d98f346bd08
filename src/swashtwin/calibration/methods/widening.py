"""Bounds that grow while the optimum touches one."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from swashtwin.calibration.methods.search import Calibrator, Progress, Search
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.objective.unknowns import DEFAULT_FACTOR, VALUES, SearchSpace, Unknowns, touched
from swashtwin.pump import LETTERS, PARAMETERS

GREATEST_FACTOR = 1000.0
"""Bounds are widened up to this factor from the nominal value."""
WIDENED = "the bounds were widened beyond a factor of 10, as the optimum touched one."
"""How a note about widened bounds ends."""


def widening_search(
    objective: Objective,
    method: Calibrator,
    names: Collection[str],
    *,
    seed: int,
    progress: Progress | None = None,
) -> tuple[Objective, Search]:
    """Search, repeated within bounds tenfold wider for each of `names` that ends at one, and the objective it ended in.

    The prior of a value is as wide as its bounds, so it widens with them. Each further search starts from the optimum
    before. It ends where no such value touches a bound, or all that do are at `GREATEST_FACTOR`.
    """
    search = method.search(objective, seed=seed, progress=progress)
    simulations, widened = search.simulations, set[str]()
    while letters := _to_widen(objective, search, names):
        widened |= letters
        objective = replace(objective, unknowns=_wider(objective.unknowns, letters))
        begun = replace(objective, unknowns=replace(objective.unknowns, begun=search.point))
        search = method.search(begun, seed=seed, progress=progress)
        simulations += search.simulations
    if widened:
        note = f"{', '.join(letter for letter in LETTERS.values() if letter in widened)}: {WIDENED}"
        search = replace(search, simulations=simulations, notes=(*search.notes, note))
    return objective, search


def _to_widen(objective: Objective, search: Search, names: Collection[str]) -> set[str]:
    """Letters of values that touch a bound which may still be widened."""
    space = objective.unknowns.space
    may_grow = space.upper / space.nominal < GREATEST_FACTOR * (1 - 1e-9)
    at_bound = touched(search.point, objective.unknowns)[VALUES]
    letters = [LETTERS[name] for name in PARAMETERS]
    return {letter for letter, grow, at in zip(letters, may_grow, at_bound, strict=True) if grow and at} & set(names)


def _wider(unknowns: Unknowns, letters: Collection[str]) -> Unknowns:
    """`unknowns` within wider bounds of some values, and the wider priors that follow from them."""
    space = unknowns.space
    factor = np.array([DEFAULT_FACTOR if letter in letters else 1.0 for letter in LETTERS.values()])
    wider = SearchSpace(space.nominal, space.lower / factor, space.upper * factor)
    return replace(unknowns, space=wider, begun=None)
