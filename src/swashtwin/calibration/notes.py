"""What a user should look at after a calibration, in sentences: warnings first, then what was not learnt."""

import numpy as np
import torch

from swashtwin.calibration.methods.search import Search
from swashtwin.calibration.objective.measurement import GRAVITY
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.uncertainty.misfit_hypotheses import suspicions
from swashtwin.calibration.uncertainty.posterior import Estimate

MISFIT = 2.0
"""RMS of the missed lines, in what was expected of them, from which a twin is said to lack something."""
_UNLEARNT = "not identified; the measurement hardly says more than was known before."


def notes_of(objective: Objective, found: Search, estimates: tuple[Estimate, ...]) -> tuple[str, ...]:
    """Notes of a search and what came of it."""
    notes = [*found.notes, *(note for one in objective.comparisons for note in one.measurement.notes)]
    with torch.no_grad():
        nominal = objective.amplitude(objective.start)
        misfit = float(objective.weighted_loss(torch.as_tensor(found.point)))
    measured = np.concatenate([one.measurement.amplitude.reshape(-1) for one in objective.comparisons])
    ratio = float(nominal.square().mean().sqrt() / np.sqrt(np.mean(measured**2)))
    if abs(ratio / GRAVITY - 1) <= 0.2:
        notes.append(f"the nominal twin's lines are {ratio:.3g} times the measured ones: are the readings in g?")
    for estimate in estimates:
        if estimate.verdict == "at bound":
            notes.append(f"{estimate.letter} was stopped by a bound: a constant of the pump file may be wrong.")
    if misfit > MISFIT:
        notes.append(
            f"the calibrated lines miss the measured ones by {misfit:.2g} times what was expected; the model lacks "
            "something (housing modes, wrong constants), and the intervals were widened for it."
        )
    notes += [one.words for one in suspicions(objective, misfit)]
    unknown = [estimate.letter for estimate in estimates if estimate.verdict == "not identified"]
    if unknown:
        notes.append(f"{', '.join(unknown)}: {_UNLEARNT}")
    return tuple(notes)


def is_warning(note: str) -> bool:
    """Whether a note says that something may be wrong, and not only that something is not known."""
    return not note.endswith(_UNLEARNT)
