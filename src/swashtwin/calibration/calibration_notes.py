"""Notes of a calibration: what an engineer must know before trusting a value."""

from collections.abc import Iterator, Sequence

import numpy as np

from swashtwin.calibration.drawing_errors import DRAWING_ERRORS
from swashtwin.calibration.misfit_hypotheses import MisfitHypothesis, describe_constant
from swashtwin.calibration.posterior import MAX_MISFIT, Estimate, find_strained_constants
from swashtwin.calibration.search import WIDENED, SearchResult
from swashtwin.calibration.spectrum_objective import Objective
from swashtwin.calibration.unknowns import CONSTANT_SLICE

MIN_REPORTED_STDS = 2.0
"""Distance from its prior mean, in standard deviations, from which a constant is named with a
misfit.
"""
_MAX_NAMED_CONSTANTS = 3
_NOT_IDENTIFIED = "not identified; the measurement adds hardly anything to the prior."
UNPLACED_CHANNEL = (
    "{0!r} is not a sensor of the pump: it counts as {1} with a free path from the shell, which "
    "makes the values less certain. Name the channel as the sensor at its position, or add that "
    "position to [[sensors]] in the pump file."
)
"""Note on a single channel (0) that was assigned to the first sensor (1)."""


def collect_notes(
    objective: Objective,
    result: SearchResult,
    estimates: tuple[Estimate, ...],
    misfit: float,
    hypotheses: Sequence[MisfitHypothesis],
) -> tuple[str, ...]:
    """Return the notes of a search and its result, with the mistakes that would explain its
    misfit.
    """
    notes = list(result.notes)
    for comparison in objective.comparisons:
        notes += comparison.measurement.notes

    doubts = list(_describe_bounds(objective, result, estimates))
    if misfit > MAX_MISFIT:
        doubts.append(_describe_misfit(objective, result, misfit, hypotheses))
    elif hypotheses:
        doubts.append("a mistake is suspected, so no value is called identified")
    if len(hypotheses) > 1:
        doubts.append("the lines do not distinguish between several mistakes")
    doubts += [
        f"the misfit falls from {misfit:.2g} to {hypothesis.misfit:.2g} (1 or less is expected) "
        f"if {hypothesis.mistake}"
        for hypothesis in hypotheses
    ]
    if doubts:
        note = "; ".join(doubts)
        if not note.endswith("?"):
            note += "."
        notes.append(note)

    not_identified = [
        estimate.symbol for estimate in estimates if estimate.verdict == "not identified"
    ]
    if not_identified:
        notes.append(f"{', '.join(not_identified)}: {_NOT_IDENTIFIED}")
    return tuple(notes)


def is_warning(note: str) -> bool:
    """Return whether a note says that something may be wrong, not only that values are unknown or
    bounds were widened.
    """
    return not note.endswith((_NOT_IDENTIFIED, WIDENED))


def _describe_misfit(
    objective: Objective,
    result: SearchResult,
    misfit: float,
    hypotheses: Sequence[MisfitHypothesis],
) -> str:
    """Return what a large misfit means; without hypotheses, with the constants farthest off."""
    message = (
        f"the calibrated lines differ from the measured ones {misfit:.2g} times as much as noise "
        "and model error explain, so no value is called identified"
    )
    if hypotheses:
        return message

    unknowns = objective.unknowns
    distance = ((result.point - unknowns.center) / unknowns.deviation)[CONSTANT_SLICE]
    names = unknowns.names[CONSTANT_SLICE]
    far_constants = [
        describe_constant(names[index])
        for index in np.argsort(-np.abs(distance))
        if abs(distance[index]) > MIN_REPORTED_STDS and not names[index].startswith("mode ")
    ]
    if far_constants:
        farthest = ", ".join(far_constants[:_MAX_NAMED_CONSTANTS])
        return f"{message}; farthest from what was specified: {farthest}"
    return f"{message}; the model lacks something (housing modes, wrong constants)"


def _describe_bounds(
    objective: Objective, result: SearchResult, estimates: tuple[Estimate, ...]
) -> Iterator[str]:
    """Yield notes on values that a bound stopped, and on constants that ended at or near one."""
    for estimate in estimates:
        if estimate.verdict == "at bound":
            low, high = (f"{bound:.3g}" for bound in estimate.bounds)
            yield (
                f"{estimate.symbol} was stopped by a bound ({low} to {high} {estimate.unit}): "
                f"specify wider bounds of {estimate.symbol}, or correct the pump file"
            )

    strained = find_strained_constants(objective.unknowns, result.point)
    if strained:
        constants = ", ".join(describe_constant(name) for name in strained)
        yield (
            f"the fit strains constants beyond their priors ({constants}), so no value is called "
            "identified"
        )
    for error in DRAWING_ERRORS:
        if error.coordinate in strained:
            size = float(result.point[objective.unknowns.names.index(error.coordinate)])
            yield error.describe(size)
