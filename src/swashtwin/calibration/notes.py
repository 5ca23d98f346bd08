"""Notes on a calibration: warnings first, then what was not identified."""

import numpy as np
import torch

from swashtwin.calibration.methods.search import Search
from swashtwin.calibration.objective.measurement import GRAVITY
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.uncertainty.misfit_hypotheses import misfit_hypotheses
from swashtwin.calibration.uncertainty.posterior import Estimate

MISFIT = 2.0
"""RMS of the missed lines, in what was expected of them, from which a note says that the twin lacks something."""
_UNLEARNT = "not identified; the measurement adds hardly anything to the prior."


def notes_of(
    objective: Objective, search: Search, estimates: tuple[Estimate, ...], explain_misfit: bool
) -> tuple[str, ...]:
    """Notes of a search and what came of it; with `explain_misfit` also mistakes that would explain its misfit."""
    notes = [*search.notes, *(note for comparison in objective.comparisons for note in comparison.measurement.notes)]
    with torch.no_grad():
        nominal = objective.amplitude(objective.start)
        misfit = float(objective.weighted_loss(torch.as_tensor(search.point)))
    measured = np.concatenate([comparison.measurement.amplitude.reshape(-1) for comparison in objective.comparisons])
    ratio = float(nominal.square().mean().sqrt() / np.sqrt(np.mean(measured**2)))
    if abs(ratio / GRAVITY - 1) <= 0.2:
        notes.append(f"the nominal twin's lines are {ratio:.3g} times the measured ones: are the samples in g?")
    for estimate in estimates:
        if estimate.verdict == "at bound":
            notes.append(f"{estimate.letter} was stopped by a bound; a constant of the pump file may be wrong.")
    if misfit > MISFIT:
        notes.append(
            f"the calibrated lines miss the measured ones by {misfit:.2g} times what was expected; the model lacks "
            "something (housing modes, wrong constants), and the intervals are wider for it."
        )
    if explain_misfit:
        notes += [hypothesis.words for hypothesis in misfit_hypotheses(objective, misfit)]
    unknown = [estimate.letter for estimate in estimates if estimate.verdict == "not identified"]
    if unknown:
        notes.append(f"{', '.join(unknown)}: {_UNLEARNT}")
    return tuple(notes)


def is_warning(note: str) -> bool:
    """Whether a note says that something may be wrong, not only that a value is not identified."""
    return not note.endswith(_UNLEARNT)
