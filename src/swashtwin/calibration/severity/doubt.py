"""Calibrations that a severity may rest on if the pump's calibration is in doubt.

A calibration that misses its lines, or strains a constant, is wrong in something, and so is each
severity that rests on it, by more than its interval. The healthy recordings are therefore fitted
again as if each of a few simple mistakes had been made (`misfit_hypotheses`). The severity is
estimated under those that fit best, and its interval reaches around all of these results.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from swashtwin.calibration.measurement import Lines, measure
from swashtwin.calibration.misfit_hypotheses import (
    CONSTANT_NAMES,
    TIE_FACTOR,
    MisfitHypothesis,
    find_suspected_mistakes,
    free_all_supports,
    try_mistakes,
)
from swashtwin.calibration.posterior import (
    DOUBTFUL_MISFIT,
    MAX_MISFIT,
    Posterior,
    posterior_covariance,
)
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.spectrum_objective import Objective, build_objective
from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, build_manifest, find_copies

# Constants that any pump's supports may have otherwise than specified.
_SUPPORTS = ("mount", "bearing")


@dataclass(frozen=True, eq=False)
class Explanation:
    """A calibration that a severity may rest on."""

    mistake: str
    """The mistake that it corrects, as a clause; empty for none."""
    calibration: Calibration
    """The calibration without the mistake."""
    pressure_factor: float = 1.0
    """Factor on all specified discharge pressures."""
    channel_names: Mapping[str, str] = field(default_factory=dict)
    """Name of each channel that has another one."""

    def correct(self, recording: Recording) -> Recording:
        """Return the recording without the mistake."""
        channels = tuple(self.channel_names.get(name, name) for name in recording.channels)
        condition = recording.condition
        if condition is not None:
            pressure = self.pressure_factor * condition.discharge_pressure
            condition = condition.replace(discharge_pressure=pressure)
        return recording.replace(channels=channels, condition=condition)


def describe_doubt(calibration: Calibration) -> str:
    """Return why a calibration, or what it held fixed, may make severities wrong; empty if nothing
    does.
    """
    if calibration.suspected_mistakes:
        return f"its lines fit better if {calibration.suspected_mistakes[0]}"
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
    try:
        objective = _rebuild_objective(calibration, used)
    except DataError:
        # the recordings of the calibration are not given
        return ()

    point = calibration.posterior.point
    hypotheses = [free_all_supports(objective)]
    if calibration.misfit > DOUBTFUL_MISFIT:
        hypotheses += try_mistakes(objective, point)
    else:
        # behind a small misfit, wrong supports may hide, and what the calibration suspects
        hypotheses += find_suspected_mistakes(objective, point)

    limit = DOUBTFUL_MISFIT
    if calibration.misfit > DOUBTFUL_MISFIT:
        smallest = min(calibration.misfit, *(hypothesis.misfit for hypothesis in hypotheses))
        limit = min(MAX_MISFIT, TIE_FACTOR * smallest)

    explanations = [Explanation("", calibration)]
    explanations += [
        _explain(calibration, objective, hypothesis)
        for hypothesis in hypotheses
        if hypothesis.misfit <= limit
    ]
    likely = [
        explanation for explanation in explanations if explanation.calibration.misfit <= limit
    ]
    return tuple(sorted(likely, key=lambda explanation: explanation.calibration.misfit))


def _rebuild_objective(calibration: Calibration, healthy: Sequence[Recording]) -> Objective:
    """Return the objective of a calibration, from its recordings.

    Raises
    ------
    DataError
        The recordings of the calibration are missing.
    """
    nominal = calibration.nominal
    settings = calibration.settings
    band: tuple[float, float] = tuple(settings["band"])
    lines: Lines = settings["lines"]
    recordings = [recording.replace(label=nominal.label) for recording in healthy]
    twins = [nominal.at(fit.condition) for fit in calibration.fits]
    measurements = [
        measure(twin, recordings, band, lines, phases=settings["phases"]) for twin in twins
    ]
    unknowns = replace(calibration.posterior.unknowns, initial_point=None)
    return replace(build_objective(twins, measurements), unknowns=unknowns)


def _explain(
    calibration: Calibration, objective: Objective, hypothesis: MisfitHypothesis
) -> Explanation:
    """Return the calibration as if a mistake of its `objective` had been made and corrected."""
    corrected = hypothesis.objective
    unknowns = replace(corrected.unknowns, initial_point=None)
    covariance = posterior_covariance(corrected, hypothesis.point)
    conditions = [comparison.twin.condition for comparison in corrected.comparisons]
    fits = tuple(
        replace(fit, condition=condition)
        for fit, condition in zip(calibration.fits, conditions, strict=True)
    )

    nominal = replace(
        calibration.nominal, pump=corrected.twin.pump, topology=corrected.twin.topology
    )
    pressure = objective.twin.condition.discharge_pressure
    return Explanation(
        hypothesis.mistake,
        replace(
            calibration,
            nominal=nominal,
            posterior=Posterior(unknowns, hypothesis.point, covariance),
            fits=fits,
            misfit=hypothesis.misfit,
        ),
        pressure_factor=corrected.twin.condition.discharge_pressure / pressure,
        channel_names=dict(zip(objective.channels, corrected.channels, strict=True)),
    )
