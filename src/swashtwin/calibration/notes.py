"""Notes on a calibration: one warning where it is in doubt, then what was not identified."""

from collections.abc import Iterator, Sequence

import numpy as np

from swashtwin.calibration.methods.search import Search
from swashtwin.calibration.methods.widening import WIDENED
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.objective.unknowns import CONSTANTS
from swashtwin.calibration.uncertainty.misfit_hypotheses import MisfitHypothesis, words_of_constant
from swashtwin.calibration.uncertainty.posterior import MISFIT, Estimate, strained_constants

FAR = 2.0
"""A constant that ends so many deviations of its prior from what was stated is named beside a misfit."""
_UNLEARNT = "not identified; the measurement adds hardly anything to the prior."


def notes_of(
    objective: Objective,
    search: Search,
    estimates: tuple[Estimate, ...],
    misfit: float,
    hypotheses: Sequence[MisfitHypothesis],
) -> tuple[str, ...]:
    """Notes of a search and what came of it, with the mistakes that would explain its misfit."""
    notes = [*search.notes, *(note for comparison in objective.comparisons for note in comparison.measurement.notes)]
    doubts = [*_bounds(objective, search, estimates)]
    if misfit > MISFIT:
        lacks = "" if hypotheses else f"; {_far_constants(objective, search)}"
        doubts.append(
            f"the calibrated lines miss the measured ones by {misfit:.2g} times what was expected, so no value is "
            f"called identified{lacks}"
        )
    doubts += [hypothesis.words for hypothesis in hypotheses]
    if doubts:
        notes.append("; ".join(doubts).removesuffix("?") + ("?" if doubts[-1].endswith("?") else "."))
    unknown = [estimate.letter for estimate in estimates if estimate.verdict == "not identified"]
    if unknown:
        notes.append(f"{', '.join(unknown)}: {_UNLEARNT}")
    return tuple(notes)


def is_warning(note: str) -> bool:
    """Whether a note says that something may be wrong, not only that values are unknown or bounds were widened."""
    return not note.endswith((_UNLEARNT, WIDENED))


def _bounds(objective: Objective, search: Search, estimates: tuple[Estimate, ...]) -> Iterator[str]:
    """Values that a bound stopped, and constants that ended at or near one."""
    for estimate in estimates:
        if estimate.verdict == "at bound":
            low, high = (f"{bound:.3g}" for bound in estimate.bounds)
            yield (
                f"{estimate.letter} was stopped by a bound ({low} to {high} {estimate.unit}): state wider ones "
                f'(--set "bounds={estimate.letter}=LEAST..GREATEST"), or correct the pump file'
            )
    strained = strained_constants(objective.unknowns, search.point)
    if strained:
        constants = ", ".join(words_of_constant(name) for name in strained)
        yield f"the fit strains what was stated beyond its prior ({constants}), so no value is called identified"


def _far_constants(objective: Objective, search: Search) -> str:
    """Constants that the lines pull away from what was stated, the farthest first."""
    unknowns = objective.unknowns
    away = ((search.point - unknowns.center) / unknowns.deviation)[CONSTANTS]
    names = unknowns.names[CONSTANTS]
    far = [names[i] for i in np.argsort(-np.abs(away)) if abs(away[i]) > FAR and not names[i].startswith("mode ")]
    if not far:
        return "the model lacks something (housing modes, wrong constants)"
    return "farthest from what was stated: " + ", ".join(words_of_constant(name) for name in far[:3])
