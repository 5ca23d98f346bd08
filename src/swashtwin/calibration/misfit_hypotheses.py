"""Simple mistakes that would explain a misfit; for each the twin is calibrated again as if it had
been made.

Where such a mistake moves only what is searched anyway, the point that it leads to is another place
to start from: a mode of the mounting on the wrong side of a line is a valley of its own
(`MisfitHypothesis.start`).

Tried are two channels with each other's name, the other topology, other pressures, one channel read
in another unit, each direction of the mounting, each bearing, and each constant, searched from
several places. A mistake is suspected where the misfit then falls to `EXPLAINED` of what it was,
which a number more does not do where it explains nothing, and where the fall is beyond chance
(`BEYOND_CHANCE`). Only mistakes of this list can be named; a twin that is wrong in another way (the
timing of the ports, the place of a defect) shows in the misfit only, or not at all.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import torch
from jaxtyping import Float

from swashtwin.calibration.measurement import GRAVITY
from swashtwin.calibration.posterior import LARGE, compute_misfit, is_in_doubt
from swashtwin.calibration.search import GaussNewton
from swashtwin.calibration.spectrum_objective import Objective
from swashtwin.calibration.unknowns import SCALES, Nuisances
from swashtwin.physics import Topology

EXPLAINED = 0.7
"""Share of the misfit that is left at most where a mistake is suspected."""
BEYOND_CHANCE = 20.0
"""By how much the sum of squares over `Comparison.sigma` must fall: noise does so, with one to
three numbers more and eight mistakes tried, once in a thousand cases.
"""
ALIKE = 1.15
"""Mistakes that leave up to this factor of the least misfit are suspected as well: the lines do not
distinguish them.
"""
WIDE = Nuisances(
    mount=0.5, bearing=0.5, excitation=1.0, sensor=1.5, mount_axes=0.5, each_bearing=0.5, gains=1.5
)
"""Priors of constants that may be wrong by mistake: wider than the usual ones."""
AWAY = {
    "mount": (-0.5, 0.0, 0.5),
    "bearing": (-0.5, 0.0, 0.5),
    "excitation": (0.0,),
    "sensor": (-math.log(GRAVITY), 0.0),
}
"""Where the search of a constant starts, in logarithms from the twin's: a mode on the other side of
a line is a valley of its own, and so is another unit.
"""
NAMES = {
    "mount": "the mounting's stiffness",
    "bearing": "the bearings' stiffness",
    "excitation": "the defect's excitation",
    "sensor": "the gain of all channels",
}
"""What the constants are called."""
PRESSURES = (0.8, 0.9, 1.1, 1.25)
"""Factors on the stated discharge pressure that are tried."""
IN_G = ": in g?"
_REFIT = GaussNewton(starts=1, max_iterations=8)


@dataclass(frozen=True, eq=False)
class MisfitHypothesis:
    """A mistake that would explain the misfit."""

    mistake: str
    """What it would be, as a clause."""
    misfit: float
    """RMS of the missed lines, in what was expected of them, had it been made."""
    before: float
    """The same as it is."""
    start: Float[np.ndarray, " unknown"] | None = None
    """Coordinates of the same search that it leads to; None where it leads to no other place."""

    @property
    def words(self) -> str:
        """It as a sentence."""
        return f"the misfit falls from {self.before:.2g} to {self.misfit:.2g} if {self.mistake}"


def suspected_mistakes(
    objective: Objective, point: Float[np.ndarray, " unknown"]
) -> tuple[MisfitHypothesis, ...]:
    """`misfit_hypotheses` at the point found, where its misfit is `LARGE` or the fit is in
    doubt.
    """
    misfit = compute_misfit(objective, point)
    is_odd = misfit > LARGE or is_in_doubt(objective.unknowns, point, misfit)
    return misfit_hypotheses(objective, misfit) if is_odd else ()


def misfit_hypotheses(objective: Objective, misfit: float) -> tuple[MisfitHypothesis, ...]:
    """Mistakes that would explain a misfit (`compute_misfit`), the likeliest first; none where no single
    one does.
    """
    count = objective.measured.numel()
    if count * misfit**2 < BEYOND_CHANCE:
        return ()
    most = min(EXPLAINED * misfit, float(np.sqrt(misfit**2 - BEYOND_CHANCE / count)))
    mistakes = (
        _swap_channels,
        _change_topology,
        _change_pressure,
        _free_constants,
        _free_supports,
        _free_gains,
    )
    hypotheses = [hypothesis for mistake in mistakes for hypothesis in mistake(objective, misfit)]
    likely = sorted(
        (item for item in hypotheses if item.misfit < most), key=lambda item: item.misfit
    )
    return tuple(item for item in likely if item.misfit <= ALIKE * likely[0].misfit)


def _refit(objective: Objective) -> tuple[np.ndarray, float]:
    """Point of another calibration, and the misfit there."""
    point = _REFIT.search(objective, seed=0).point
    with torch.no_grad():
        return point, float(objective.weighted_loss(torch.as_tensor(point)))


def _swap_channels(objective: Objective, before: float) -> Iterator[MisfitHypothesis]:
    for first, second in combinations(objective.channels, 2):
        names = {first: second, second: first}
        changed = []
        for each in objective.comparisons:
            measurement = replace(
                each.measurement, channels=tuple(names.get(n, n) for n in each.measurement.channels)
            )
            searched = tuple(names.get(name, name) for name in each.searched)
            changed.append(replace(each, measurement=measurement, searched=searched))
        _, misfit = _refit(replace(objective, comparisons=tuple(changed)))
        yield MisfitHypothesis(
            f"{first} and {second} have each other's name: look at the wiring", misfit, before
        )


def _change_topology(objective: Objective, before: float) -> Iterator[MisfitHypothesis]:
    other: Topology = "T2" if objective.twin.topology == "T1" else "T1"
    changed = tuple(
        replace(each, twin=replace(each.twin, topology=other)) for each in objective.comparisons
    )
    _, misfit = _refit(replace(objective, comparisons=changed))
    yield MisfitHypothesis(f"the bodies are joined as in topology {other}", misfit, before)


def _change_pressure(objective: Objective, before: float) -> Iterator[MisfitHypothesis]:
    """Other discharge pressures than stated; the factor of least misfit."""
    refits = []
    for factor in PRESSURES:
        changed = []
        for each in objective.comparisons:
            condition = each.twin.condition
            pressure = factor * condition.discharge_pressure
            changed.append(
                replace(each, twin=each.twin.at(condition.replace(discharge_pressure=pressure)))
            )
        refits.append((*_refit(replace(objective, comparisons=tuple(changed))), factor))
    point, misfit, factor = min(refits, key=lambda refit: refit[1])
    yield MisfitHypothesis(
        f"the discharge pressure is about {factor:g} times the stated one", misfit, before, point
    )


def _free_supports(objective: Objective, before: float) -> Iterator[MisfitHypothesis]:
    """Each direction of the mounting, or each bearing, searched by itself where it was not."""
    for kind, prefix in (("mount_axes", "mount_"), ("each_bearing", "bearing_")):
        if getattr(objective.unknowns.nuisances, kind) > 0:
            continue
        unknowns = objective.unknowns.changed(**{kind: getattr(WIDE, kind)})
        point, misfit = _refit(replace(objective, unknowns=unknowns))
        offs = {
            n: float(x)
            for n, x in zip(unknowns.names, point, strict=True)
            if n.startswith(prefix) and abs(x) > 0.1
        }
        words = [
            f"{describe_constant(name)} is {np.exp(off):.2g} times the twin's"
            for name, off in offs.items()
        ]
        if words:
            yield MisfitHypothesis(
                f"{', '.join(words)}: search each (--set nuisances=by-axis)", misfit, before
            )


def describe_constant(name: str) -> str:
    """What a constant that is searched is called, by its name among the coordinates."""
    kind, _, rest = name.partition("_")
    if name in NAMES:
        return NAMES[name]
    if kind == "mount":
        return f"{NAMES['mount']} {'in tilt' if rest == 'tilt' else f'along {rest}'}"
    if kind == "bearing":
        return f"the stiffness of bearing {rest}"
    if name.startswith("gain "):
        return f"the gain of {name.removeprefix('gain ')} (its sensor or unit)"
    return (
        f"{name} of the housing"
        if name.startswith("mode ")
        else f"the share of {name} (cross-talk)"
    )


def _free_constants(objective: Objective, before: float) -> Iterator[MisfitHypothesis]:
    """Each constant searched from other places, also one that was searched."""
    for name in AWAY:
        if name == "excitation" and objective.twin.fault is None:
            continue
        twin_value = float(objective.unknowns.twin_scales[SCALES.index(name)])
        unknowns = objective.unknowns.changed(**{name: getattr(WIDE, name)})
        index = unknowns.names.index(name)
        is_it = np.arange(len(unknowns)) == index
        starts = [
            replace(unknowns, begun=np.where(is_it, twin_value + away, unknowns.start))
            for away in AWAY[name]
        ]
        point, misfit = min(
            (_refit(replace(objective, unknowns=start)) for start in starts),
            key=lambda pair: pair[1],
        )
        factor = float(np.exp(point[index] - twin_value))
        is_unit = name == "sensor" and _is_gravity(factor)
        advice = IN_G if is_unit else ": search it from there, or correct the pump file"
        mistake = f"{NAMES[name]} is {factor:.2g} times the twin's{advice}"
        yield MisfitHypothesis(mistake, misfit, before, _start(objective, unknowns.names, point))


def _free_gains(objective: Objective, before: float) -> Iterator[MisfitHypothesis]:
    """Each channel's gain searched: one that is far from the others' is in another unit."""
    channels = objective.channels
    if len(channels) < 2:
        return
    unknowns = objective.unknowns.changed(gains=WIDE.gains)
    point, misfit = _refit(replace(objective, unknowns=unknowns))
    gains = np.exp([point[unknowns.names.index(f"gain {name}")] for name in channels])
    index = int(np.argmax(np.abs(np.log(gains / np.median(gains)))))
    factor = float(gains[index] / np.median(gains))
    unit = IN_G if _is_gravity(factor) else ""
    mistake = f"{channels[index]} reads {factor:.2g} times what it should beside the others{unit}"
    yield MisfitHypothesis(mistake, misfit, before, _start(objective, unknowns.names, point))


def _start(objective: Objective, names: tuple[str, ...], point: np.ndarray) -> np.ndarray | None:
    """The point as a start of the objective's search; None where that searches others than the
    names.
    """
    return point if names == objective.unknowns.names else None


def _is_gravity(factor: float) -> bool:
    """Whether samples that are `factor` times too large may be in g."""
    return abs(factor * GRAVITY - 1) < 0.3
