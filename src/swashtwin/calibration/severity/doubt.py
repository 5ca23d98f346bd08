"""Calibrations that a severity may rest on if the pump's calibration is in doubt.

A calibration that misses its lines, or strains a constant, is wrong in something, and so is each
severity that rests on it, by more than its interval. The healthy recordings are therefore fitted
again as if each of a few simple mistakes had been made (`misfit_hypotheses`). The severity is
estimated under those that fit best, and its interval reaches around all of these results.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np

from swashtwin.calibration.drawing_errors import PRESSURE_FACTORS
from swashtwin.calibration.measurement import Lines, measure
from swashtwin.calibration.misfit_hypotheses import (
    CONSTANT_NAMES,
    START_OFFSETS,
    TIE_FACTOR,
    WIDE_PRIORS,
)
from swashtwin.calibration.posterior import (
    DOUBTFUL_MISFIT,
    MAX_MISFIT,
    Posterior,
    compute_misfit,
    posterior_covariance,
)
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.search import GaussNewton
from swashtwin.calibration.spectrum_objective import Objective, build_objective
from swashtwin.calibration.unknowns import SCALE_NAMES
from swashtwin.foundation import DataError
from swashtwin.physics import Topology
from swashtwin.recordings import Recording, build_manifest, find_copies

_REFIT = GaussNewton(starts=1, max_iterations=8)

# Constants that any pump's supports may have otherwise than specified.
_SUPPORTS = ("mount", "bearing")
_WIDE_SUPPORTS = {
    name: getattr(WIDE_PRIORS, name) for name in (*_SUPPORTS, "mount_axes", "each_bearing")
}


@dataclass(frozen=True)
class Mistake:
    """What may have been specified wrongly."""

    description: str
    """The mistake, as a clause; empty for none."""
    priors: Mapping[str, float] = field(default_factory=dict)
    """Nuisances with their standard deviations that are searched instead."""
    offsets: tuple[float, ...] = (0.0,)
    """Starts of the searched constant, in logarithms from the twin's."""
    pressure_factor: float = 1.0
    """Factor on all specified discharge pressures."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Name of each channel that has another one."""
    topology: Topology | None = None
    """How the bodies are joined; `None` as specified."""

    def correct(self, recording: Recording) -> Recording:
        """Return the recording without the mistake."""
        channels = tuple(self.names.get(name, name) for name in recording.channels)
        condition = recording.condition
        if condition is not None:
            pressure = self.pressure_factor * condition.discharge_pressure
            condition = condition.replace(discharge_pressure=pressure)
        return recording.replace(channels=channels, condition=condition)


NO_MISTAKE = Mistake("")


@dataclass(frozen=True, eq=False)
class Explanation:
    """A calibration that a severity may rest on."""

    mistake: Mistake
    calibration: Calibration


def describe_doubt(calibration: Calibration) -> str:
    """Return why a calibration, or what it held fixed, may make severities wrong; empty if nothing
    does.
    """
    if calibration.misfit > DOUBTFUL_MISFIT:
        return (
            f"its lines differ from the measured ones {calibration.misfit:.2g} times as much as "
            "noise and model error explain"
        )
    if calibration.is_in_doubt:
        return "its fit strains a bound or a prior"

    nuisances = calibration.posterior.unknowns.nuisances
    fixed = [CONSTANT_NAMES[name] for name in _SUPPORTS if not getattr(nuisances, name)]
    if fixed:
        return f"it did not search {' and '.join(fixed)}"
    return ""


def explain_doubt(
    calibration: Calibration, healthy: Sequence[Recording]
) -> tuple[Explanation, ...]:
    """Return the calibrations that explain the healthy recordings best, each with the mistake that
    it corrects; none if no mistake explains them.

    They leave up to `TIE_FACTOR` of the smallest misfit, and at most `MAX_MISFIT`. The calibration
    itself is among them if it does.

    Parameters
    ----------
    healthy : recordings of the calibration.
    """
    # by content: recordings of other machines may have the same names
    used_ids = find_copies(calibration.recording_hashes, build_manifest(healthy))
    used = [recording for recording in healthy if recording.recording_id in used_ids]

    # without a misfit only priors are strained, and wider ones answer that
    mistakes = _list_mistakes(calibration)
    if calibration.misfit <= DOUBTFUL_MISFIT:
        mistakes = iter([_wrong_supports()])

    explanations = [Explanation(NO_MISTAKE, calibration)]
    try:
        explanations += [
            Explanation(mistake, _calibrate_again(calibration, used, mistake))
            for mistake in mistakes
        ]
    except DataError:
        # the recordings of the calibration are not given
        return ()

    explanations.sort(key=lambda explanation: explanation.calibration.misfit)
    limit = min(MAX_MISFIT, TIE_FACTOR * explanations[0].calibration.misfit)
    if calibration.misfit <= DOUBTFUL_MISFIT:
        limit = DOUBTFUL_MISFIT
    return tuple(
        explanation for explanation in explanations if explanation.calibration.misfit <= limit
    )


def _wrong_supports() -> Mistake:
    return Mistake("mounting and bearings are other than specified", priors=_WIDE_SUPPORTS)


def _list_mistakes(calibration: Calibration) -> Iterator[Mistake]:
    """Yield the mistakes that may explain a misfit."""
    yield _wrong_supports()
    for name in (*_SUPPORTS, "sensor"):
        yield Mistake(
            f"{CONSTANT_NAMES[name]} is other than specified",
            priors={name: getattr(WIDE_PRIORS, name)},
            offsets=START_OFFSETS[name],
        )
    for factor in PRESSURE_FACTORS:
        yield Mistake(
            f"the discharge pressure is {factor:g} times the specified one", pressure_factor=factor
        )

    channels = calibration.posterior.channels
    for first, second in combinations(channels, 2):
        yield Mistake(
            f"{first} and {second} have each other's name", names={first: second, second: first}
        )
    if len(channels) > 1:
        yield Mistake(
            "channels have other gains than specified", priors={"gains": WIDE_PRIORS.gains}
        )
    topology: Topology = "T1"
    if calibration.nominal.topology == "T1":
        topology = "T2"
    yield Mistake(f"the bodies are joined as in topology {topology}", topology=topology)


def _calibrate_again(
    calibration: Calibration, healthy: Sequence[Recording], mistake: Mistake
) -> Calibration:
    """Return the calibration on the same recordings without a mistake.

    Raises
    ------
    DataError
        The recordings of the calibration are missing.
    """
    nominal = calibration.nominal
    if mistake.topology is not None:
        nominal = replace(nominal, topology=mistake.topology)
    conditions = [
        fit.condition.replace(
            discharge_pressure=mistake.pressure_factor * fit.condition.discharge_pressure
        )
        for fit in calibration.fits
    ]
    recordings = [mistake.correct(recording.replace(label=nominal.label)) for recording in healthy]

    settings = calibration.settings
    band: tuple[float, float] = tuple(settings["band"])
    lines: Lines = settings["lines"]
    twins = [nominal.at(condition) for condition in conditions]
    measurements = [
        measure(twin, recordings, band, lines, phases=settings["phases"]) for twin in twins
    ]
    objective = build_objective(twins, measurements)
    unknowns = calibration.posterior.unknowns
    nuisances = replace(unknowns.nuisances, **dict[str, Any](mistake.priors))
    unknowns = replace(unknowns, nuisances=nuisances, initial_point=None)
    objective = replace(objective, unknowns=unknowns)

    point, misfit = _refit(objective, mistake)
    posterior = Posterior(unknowns, point, posterior_covariance(objective, point))
    fits = tuple(
        replace(fit, condition=condition)
        for fit, condition in zip(calibration.fits, conditions, strict=True)
    )
    return replace(calibration, nominal=nominal, posterior=posterior, fits=fits, misfit=misfit)


def _refit(objective: Objective, mistake: Mistake) -> tuple[np.ndarray, float]:
    """Return the best point of searches from all starts of the mistake's constant, and its
    misfit.
    """
    unknowns = objective.unknowns
    refits = []
    for offset in mistake.offsets:
        start = unknowns.start.copy()
        if offset:
            (name,) = mistake.priors
            start[unknowns.names.index(name)] = (
                unknowns.twin_scales[SCALE_NAMES.index(name)] + offset
            )
        started = replace(objective, unknowns=replace(unknowns, initial_point=start))
        point = _REFIT.search(started, seed=0).point
        refits.append((compute_misfit(objective, point), point))
    misfit, point = min(refits, key=lambda refit: refit[0])
    return point, misfit
