"""Simple mistakes that would explain a misfit; for each the twin is calibrated again as if it had
been made.

If such a mistake leaves what is searched as it is, the point that it leads to is a further start of
the search: a mode of the mounting on the wrong side of a line is a separate valley.

Tried are two channels with each other's name, the other topology, numbers of the drawing and the
pressure (`drawing_errors`), one channel read in another unit, each direction of the mounting, each
bearing, and each constant, searched from several starts. A mistake is suspected if the misfit then
falls to `MAX_REMAINING_SHARE` of the original one, which a further unknown does not achieve if it
explains nothing, and if the fall is beyond chance (`MIN_SQUARES_FALL`). Only mistakes of this list
can be named; a twin that is wrong in another way (the position of a defect) shows in the misfit
only, or not at all.

A wrong number of the drawing may leave a small misfit, since gains and supports take up most of it.
So these numbers are tested at every optimum, and tried if their score is beyond chance.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from swashtwin.calibration.discrepancy import linearize
from swashtwin.calibration.drawing_errors import (
    DrawingError,
    ScoreTest,
    score_drawing,
)
from swashtwin.calibration.measurement import GRAVITY
from swashtwin.calibration.posterior import DOUBTFUL_MISFIT, compute_misfit, is_in_doubt
from swashtwin.calibration.search import GaussNewton, select_starts
from swashtwin.calibration.spectrum_objective import Comparison, Objective
from swashtwin.calibration.unknowns import SCALE_NAMES, Nuisances
from swashtwin.physics import Topology

MAX_REMAINING_SHARE = 0.7
"""Share of the misfit that a suspected mistake leaves at most."""
MIN_SQUARES_FALL = 20.0
"""Minimum fall of the sum of squares over `Comparison.sigma`: noise reaches it, with one to three
further unknowns and eight mistakes tried, once in a thousand cases.
"""
TIE_FACTOR = 1.15
"""Mistakes that leave up to this factor of the smallest misfit are suspected as well: the lines do
not distinguish them.
"""
WIDE_PRIORS = Nuisances(
    mount=0.5, bearing=0.5, excitation=1.0, sensor=1.5, mount_axes=0.5, each_bearing=0.5, gains=1.5
)
"""Priors of constants that may be wrong by mistake: wider than the typical ones."""
_WIDE_SUPPORTS = {
    name: getattr(WIDE_PRIORS, name) for name in ("mount", "bearing", "mount_axes", "each_bearing")
}
START_OFFSETS = {
    "mount": (-0.5, 0.0, 0.5),
    "bearing": (-0.5, 0.0, 0.5),
    "excitation": (0.0,),
    "sensor": (-math.log(GRAVITY), 0.0),
}
"""Starts of the search of a constant, in logarithms from the twin's: a mode on the other side of a
line is a separate valley, and so is another unit.
"""
CONSTANT_NAMES = {
    "mount": "the mounting's stiffness",
    "bearing": "the bearings' stiffness",
    "excitation": "the defect's excitation",
    "sensor": "the gain of all channels",
}
"""Descriptions of the constants."""
PORT_DESCRIPTIONS = {
    "discharge_open": "the start of discharge",
    "suction_open": "the start of suction",
}
"""Descriptions of the angles of ports."""
MIN_SCORE = 12.0
"""Minimum fall of the sum of squares, to first order, at which a number of the drawing is tried
although the misfit is small: noise alone reaches it for one of six numbers in one of 300 fits.
"""
MIN_REPORTED_CHANGE = 0.1
"""Change of the logarithm of a support's stiffness from which it is reported."""
_IN_G = ": are its samples in g?"
_REFIT = GaussNewton(starts=1, max_iterations=8)


@dataclass(frozen=True, eq=False)
class MisfitHypothesis:
    """A mistake that would explain the misfit."""

    mistake: str
    """The mistake, as a clause."""
    objective: Objective
    """The objective as if the mistake had been made, and corrected."""
    point: Float[np.ndarray, " unknown"]
    """Calibrated coordinates of that objective."""
    misfit: float
    """RMS of the lines missed there, relative to what was expected."""


def find_suspected_mistakes(
    objective: Objective, point: Float[np.ndarray, " unknown"]
) -> tuple[MisfitHypothesis, ...]:
    """Return the mistakes that would explain the misfit at `point`, if there is something to
    explain.

    All are tried if the misfit exceeds `DOUBTFUL_MISFIT` or the fit is in doubt, otherwise only
    numbers of the drawing whose score exceeds `MIN_SCORE`.
    """
    misfit = compute_misfit(objective, point)
    if misfit > DOUBTFUL_MISFIT or is_in_doubt(objective.unknowns, point, misfit):
        if objective.measured.numel() * misfit**2 < MIN_SQUARES_FALL:
            return ()
        return _select_likely(try_mistakes(objective, point), misfit, MIN_SQUARES_FALL, objective)

    scores = score_drawing(linearize(objective, point))
    plausible = [score for score in scores if score.squares_fall > MIN_SCORE]
    return _select_likely(
        _correct_drawing(objective, point, plausible, far_sizes=False), misfit, MIN_SCORE, objective
    )


def try_mistakes(
    objective: Objective, point: Float[np.ndarray, " unknown"]
) -> Iterator[MisfitHypothesis]:
    """Yield each mistake of the list, calibrated as if it had been made at `point`."""
    scores = score_drawing(linearize(objective, point))
    yield from _correct_drawing(objective, point, scores, far_sizes=True)
    for make_mistake in (
        _swap_channels,
        _change_topology,
        _free_constants,
        _free_supports,
        _free_gains,
    ):
        yield from make_mistake(objective)


def _select_likely(
    hypotheses: Iterable[MisfitHypothesis],
    misfit: float,
    min_squares_fall: float,
    objective: Objective,
) -> tuple[MisfitHypothesis, ...]:
    """Return the mistakes that explain a misfit beyond chance and are as good as the best one."""
    min_fall = min_squares_fall / objective.measured.numel()
    limit = min(MAX_REMAINING_SHARE * misfit, math.sqrt(max(0.0, misfit**2 - min_fall)))
    likely = sorted(
        (hypothesis for hypothesis in hypotheses if hypothesis.misfit < limit),
        key=lambda hypothesis: hypothesis.misfit,
    )
    return tuple(
        hypothesis for hypothesis in likely if hypothesis.misfit <= TIE_FACTOR * likely[0].misfit
    )


def _calibrate_as_if(mistake: str, objective: Objective) -> MisfitHypothesis:
    """Return the hypothesis of a mistake that `objective` corrects."""
    point = _REFIT.search(objective, seed=0).point
    return MisfitHypothesis(mistake, objective, point, compute_misfit(objective, point))


def _swap_channels(objective: Objective) -> Iterator[MisfitHypothesis]:
    """Each pair of channels with each other's name."""
    for first, second in combinations(objective.channels, 2):
        names = {first: second, second: first}
        comparisons = tuple(
            _rename_channels(comparison, names) for comparison in objective.comparisons
        )
        channels = tuple(names.get(name, name) for name in objective.channels)
        unknowns = objective.unknowns.with_changes(channels)
        mistake = f"{first} and {second} have each other's name: check the wiring"
        yield _calibrate_as_if(mistake, Objective(comparisons, unknowns))


def _rename_channels(comparison: Comparison, names: dict[str, str]) -> Comparison:
    """Return the comparison with other channel names; those not in `names` stay."""
    measurement = comparison.measurement
    channels = tuple(names.get(name, name) for name in measurement.channels)
    searched = tuple(names.get(name, name) for name in comparison.searched_channels)
    return replace(
        comparison,
        measurement=replace(measurement, channels=channels),
        searched_channels=searched,
    )


def _change_topology(objective: Objective) -> Iterator[MisfitHypothesis]:
    """The other topology."""
    topology: Topology = "T1"
    if objective.twin.topology == "T1":
        topology = "T2"
    comparisons = tuple(
        replace(comparison, twin=replace(comparison.twin, topology=topology))
        for comparison in objective.comparisons
    )
    mistake = f"the bodies are joined as in topology {topology}"
    yield _calibrate_as_if(mistake, replace(objective, comparisons=comparisons))


def _correct_drawing(
    objective: Objective,
    point: Float[np.ndarray, " unknown"],
    scores: Iterable[ScoreTest],
    *,
    far_sizes: bool,
) -> Iterator[MisfitHypothesis]:
    """Each scored number of the drawing corrected; of several sizes the one of smallest misfit.

    Parameters
    ----------
    scores : what the lines at `point` show of each number; the search goes on from there.
    far_sizes : whether errors that are too large for a score are tried too, each from the best
        start drawn with it.
    """
    for score in scores:
        error = score.error
        size = float(np.clip(score.size, -error.max_size, error.max_size))
        hypotheses = [_change_drawing(objective, error, size, point)]
        if far_sizes:
            hypotheses += [
                _try_far_size(objective, error, far_size) for far_size in error.far_sizes
            ]

        possible = [hypothesis for hypothesis in hypotheses if hypothesis is not None]
        if possible:
            yield min(possible, key=lambda hypothesis: hypothesis.misfit)


def _try_far_size(
    objective: Objective, error: DrawingError, size: float
) -> MisfitHypothesis | None:
    """Return the hypothesis that a number is wrong by far; `None` if no such pump exists."""
    changed = error.apply(objective, size)
    if changed is None:
        return None
    (start,) = select_starts(changed, 1, seed=0)
    return _change_drawing(objective, error, size, start)


def _change_drawing(
    objective: Objective, error: DrawingError, size: float, start: Float[np.ndarray, " unknown"]
) -> MisfitHypothesis | None:
    """Return the hypothesis that a number is wrong by `size`; `None` if no such pump exists."""
    changed = error.apply(objective, size)
    if changed is None:
        return None
    unknowns = replace(objective.unknowns, initial_point=start)
    return _calibrate_as_if(error.describe(size), replace(changed, unknowns=unknowns))


def free_all_supports(objective: Objective) -> MisfitHypothesis:
    """Return the hypothesis that mounting and bearings are other than specified, each of them by
    itself.
    """
    unknowns = objective.unknowns.with_changes(**_WIDE_SUPPORTS)
    mistake = "mounting and bearings are other than specified"
    return _calibrate_as_if(mistake, replace(objective, unknowns=unknowns))


def _free_supports(objective: Objective) -> Iterator[MisfitHypothesis]:
    """Each direction of the mounting, or each bearing, searched separately if it was not."""
    for kind, prefix in (("mount_axes", "mount_"), ("each_bearing", "bearing_")):
        if getattr(objective.unknowns.nuisances, kind) > 0:
            continue

        unknowns = objective.unknowns.with_changes(**{kind: getattr(WIDE_PRIORS, kind)})
        refit = _calibrate_as_if("", replace(objective, unknowns=unknowns))
        changes = [
            f"{describe_constant(name)} is {np.exp(float(change)):.2g} times the twin's"
            for name, change in zip(unknowns.names, refit.point, strict=True)
            if name.startswith(prefix) and abs(change) > MIN_REPORTED_CHANGE
        ]
        if changes:
            mistake = f"{', '.join(changes)}: search each of them (nuisances=by-axis)"
            yield replace(refit, mistake=mistake)


def describe_constant(name: str) -> str:
    """Return the description of a searched constant, by its name among the coordinates."""
    if name in CONSTANT_NAMES:
        return CONSTANT_NAMES[name]
    if name.startswith("gain "):
        return f"the gain of {name.removeprefix('gain ')} (its sensor or unit)"
    if name.startswith("mode "):
        return f"{name} of the housing"
    if name in PORT_DESCRIPTIONS:
        return PORT_DESCRIPTIONS[name]

    kind, _, member = name.partition("_")
    if kind == "mount":
        direction = f"along {member}"
        if member == "tilt":
            direction = "in tilt"
        return f"{CONSTANT_NAMES['mount']} {direction}"
    if kind == "bearing":
        return f"the stiffness of bearing {member}"
    return f"the share of {name} (cross-talk)"


def _free_constants(objective: Objective) -> Iterator[MisfitHypothesis]:
    """Each constant searched from other starts, also one that was searched."""
    for name, offsets in START_OFFSETS.items():
        if name == "excitation" and objective.twin.fault is None:
            continue

        twin_scale = float(objective.unknowns.twin_scales[SCALE_NAMES.index(name)])
        unknowns = objective.unknowns.with_changes(**{name: getattr(WIDE_PRIORS, name)})
        index = unknowns.names.index(name)

        refits = []
        for offset in offsets:
            start = unknowns.start.copy()
            start[index] = twin_scale + offset
            started = replace(objective, unknowns=replace(unknowns, initial_point=start))
            refits.append(_calibrate_as_if("", started))
        best = min(refits, key=lambda refit: refit.misfit)

        factor = float(np.exp(best.point[index] - twin_scale))
        advice = ": start the search there, or correct the pump file"
        if name == "sensor" and _is_gravity(factor):
            advice = _IN_G
        mistake = f"{CONSTANT_NAMES[name]} is {factor:.2g} times the twin's{advice}"
        yield replace(best, mistake=mistake)


def _free_gains(objective: Objective) -> Iterator[MisfitHypothesis]:
    """Each channel's gain searched: one that is far from the others' is in another unit."""
    channels = objective.channels
    if len(channels) < 2:
        return

    unknowns = objective.unknowns.with_changes(gains=WIDE_PRIORS.gains)
    refit = _calibrate_as_if("", replace(objective, unknowns=unknowns))
    gains = np.exp([refit.point[unknowns.names.index(f"gain {name}")] for name in channels])
    index = int(np.argmax(np.abs(np.log(gains / np.median(gains)))))
    factor = float(gains[index] / np.median(gains))

    advice = ""
    if _is_gravity(factor):
        advice = _IN_G
    mistake = (
        f"{channels[index]} reads {factor:.2g} times what it should relative to the other "
        f"channels{advice}"
    )
    yield replace(refit, mistake=mistake)


def _is_gravity(factor: float) -> bool:
    """Return whether samples that are `factor` times too large may be in g."""
    return abs(factor * GRAVITY - 1) < 0.3
