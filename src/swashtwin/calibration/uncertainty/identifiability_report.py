"""The identifiability report: which coordinates a measurement determines, alone or in combination."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from swashtwin.calibration.discrepancy import (
    Discrepancy,
    Linearization,
    estimate_discrepancy,
    linearize,
    noise_covariance,
)
from swashtwin.calibration.measurement import measure
from swashtwin.calibration.posterior import (
    IDENTIFIED_STD,
    UNIDENTIFIED_SHARE,
    Estimate,
    estimates_of,
    sandwich,
)
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.spectrum_objective import Objective, comparison_of
from swashtwin.calibration.unknowns import CONSTANTS, VALUES, touched
from swashtwin.foundation import DataError, to_table
from swashtwin.pump import PARAMETERS
from swashtwin.recordings import Recording

Standing = Literal["identified", "weak", "traded off", "flat", "dead", "at bound"]

DEAD = 0.1
"""A coordinate is dead where one standard deviation of its prior moves all lines together by fewer sigma than this."""
TRADED = 3.0
"""A coordinate is traded off where others cost it this factor of certainty."""
SHOWN = 0.35
"""Share of a direction's unit length from which a value is named in it."""


@dataclass(frozen=True)
class Direction:
    """A combination of the six values, independent of the others given the measurement."""

    share: float
    """Posterior over prior standard deviation along it: 0 fully known, 1 nothing learned."""
    weights: tuple[tuple[str, float], ...]
    """How much of each value, by letter: changes of the logarithm in prior standard deviations, of unit length."""

    @property
    def words(self) -> str:
        """What it combines, such as ``"K_v traded with K_Hz"``."""
        named = sorted(
            (weight for weight in self.weights if abs(weight[1]) > SHOWN), key=lambda weight: -abs(weight[1])
        )
        letters = [letter for letter, _ in named]
        if len(letters) == 1:
            combination = f"{letters[0]} alone"
        elif len(letters) == 2:
            same = named[0][1] * named[1][1] > 0
            kind = "product" if same else "ratio"
            combination = f"the {kind} of {letters[0]} and {letters[1]}"
        else:
            combination = ", ".join(letters[:-1]) + f" and {letters[-1]} together"
        if self.share > UNIDENTIFIED_SHARE:
            return f"not determined: {' traded with '.join(letters)}"
        return f"{combination}: uncertainty reduced to {self.share:.2g} of the prior's"


@dataclass(frozen=True, eq=False)
class IdentifiabilityReport:
    """What a measurement determines of the coordinates searched, around one point."""

    names: tuple[str, ...]
    """Coordinates, as in `Unknowns.names`."""
    estimates: tuple[Estimate, ...]
    """The six values with intervals and verdicts."""
    std: Float[np.ndarray, " unknown"]
    """Posterior standard deviation of each coordinate."""
    prior_std: Float[np.ndarray, " unknown"]
    """Prior standard deviation of each."""
    correlation: Float[np.ndarray, "unknown unknown"]
    """Posterior correlation."""
    standing: tuple[Standing, ...]
    """A word for each coordinate: ``dead``: no line changes with it; ``flat``: the posterior is the prior; ``traded
    off``: the lines change with it, but as with others; ``at bound``; ``weak``; ``identified``."""
    directions: tuple[Direction, ...]
    """Independent combinations of the six values, the best known first."""
    condition_number: float
    """Greatest over least eigenvalue of the Fisher information of the six logarithms, nuisances integrated out."""
    discrepancy: Discrepancy
    """What the twin lacks, as the lines show it."""

    @property
    def share(self) -> Float[np.ndarray, " unknown"]:
        """Posterior over prior standard deviation of each coordinate."""
        return self.std / self.prior_std

    @property
    def words(self) -> tuple[str, ...]:
        """What a reader should know, in sentences."""
        by: dict[str, list[str]] = {}
        for name, standing in zip(self.names[VALUES], self.standing, strict=False):
            by.setdefault(standing, []).append(name)
        sentences = [f"{', '.join(letters)}: {standing}." for standing, letters in by.items()]
        sentences += [f"{direction.words}." for direction in self.directions]
        sentences += _discrepancy_words(self.discrepancy)
        return tuple(sentences)

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it."""
        number = self.condition_number if np.isfinite(self.condition_number) else None
        return {**to_table(self), "condition_number": number, "words": list(self.words)}


def identifiability(calibration: Calibration, recordings: Iterable[Recording]) -> IdentifiabilityReport:
    """What the recordings of a calibration determine, alone or in combination.

    Parameters
    ----------
    recordings : those that it was calibrated on, by id; others among them are not looked at.

    Raises
    ------
    DataError
        A recording that was calibrated on is missing.
    """
    wanted = set(calibration.recording_ids)
    used = {recording.recording_id: recording for recording in recordings if recording.recording_id in wanted}
    if missing := [name for name in calibration.recording_ids if name not in used]:
        raise DataError(f"{missing[0]} is missing, on which the twin was calibrated; give its recordings.")
    settings, comparisons = calibration.settings, []
    for fit in calibration.fits:
        twin = calibration.nominal.at(fit.condition)
        of_fit = [used[name] for name in fit.recording_ids]
        measurement = measure(twin, of_fit, tuple(settings["band"]), settings["lines"], phases=settings["phases"])
        comparisons.append(comparison_of(twin, measurement, calibration.posterior.channels))
    objective = Objective(tuple(comparisons), calibration.posterior.unknowns)
    return identifiability_at(objective, calibration.posterior.point)


def identifiability_at(objective: Objective, point: Float[np.ndarray, " unknown"]) -> IdentifiabilityReport:
    """Identifiability of the coordinates of `objective` around `point`."""
    point = np.asarray(point, dtype=float)
    around = linearize(objective, point)
    discrepancy = estimate_discrepancy(around)
    covariance = sandwich(around, noise_covariance(around, discrepancy))
    std, prior = np.sqrt(np.diag(covariance)), objective.unknowns.deviation
    correlation = covariance / np.outer(std, std)
    return IdentifiabilityReport(
        names=objective.unknowns.names,
        estimates=estimates_of(objective, point, covariance),
        std=std,
        prior_std=prior,
        correlation=correlation,
        standing=tuple(_standings(around, std)),
        directions=tuple(_directions(objective.unknowns.names[VALUES], covariance[VALUES, VALUES], prior[VALUES])),
        condition_number=_condition_number(around),
        discrepancy=discrepancy,
    )


def _standings(around: Linearization, std: np.ndarray) -> Iterable[Standing]:
    unknowns = around.objective.unknowns
    prior, point = unknowns.deviation, around.point
    effect = np.linalg.norm(around.slope / around.sigma[:, None], axis=0) * prior
    alone = prior / np.sqrt(1 + effect**2)  # were all others known
    on_bound = touched(point, unknowns)
    for i in range(len(point)):
        limit = IDENTIFIED_STD if i < len(PARAMETERS) else UNIDENTIFIED_SHARE * prior[i] / 2
        if effect[i] < DEAD:
            yield "dead"
        elif on_bound[i]:
            yield "at bound"
        elif std[i] <= limit:
            yield "identified"
        elif std[i] > TRADED * alone[i]:
            yield "traded off"
        else:
            yield "flat" if std[i] > UNIDENTIFIED_SHARE * prior[i] else "weak"


def _directions(letters: tuple[str, ...], covariance: np.ndarray, prior: np.ndarray) -> Iterable[Direction]:
    variance, vectors = np.linalg.eigh(covariance / np.outer(prior, prior))
    for value, vector in zip(variance, vectors.T, strict=True):
        sign = np.sign(vector[np.argmax(np.abs(vector))])
        weights = tuple(zip(letters, (float(w) for w in sign * vector), strict=True))
        yield Direction(float(np.sqrt(max(value, 0.0))), weights)


def _condition_number(around: Linearization) -> float:
    scaled = around.slope / around.sigma[:, None]
    values, rest = scaled[:, VALUES], scaled[:, CONSTANTS] * around.objective.unknowns.deviation[CONSTANTS]
    inner = np.linalg.solve(rest.T @ rest + np.eye(rest.shape[1]), rest.T @ values)
    return float(np.linalg.cond(values.T @ values - values.T @ rest @ inner))


def _discrepancy_words(discrepancy: Discrepancy) -> list[str]:
    causes = [f"the {name} may be off by {share:.0%}" for name, share in discrepancy.constants if share > 0.02]
    shapes = {
        "lines of all channels by {:.0%} together": discrepancy.excitation,
        "lines of one channel by {:.0%} together": discrepancy.path,
        "single lines by {:.0%}": discrepancy.line,
    }
    causes += [f"it misses {shape.format(share)}" for shape, share in shapes.items() if share > 0.02]
    if not causes:
        return ["The twin meets the lines as well as expected."]
    return [f"What the twin lacks, as its residuals show: {'; '.join(causes)}. The intervals allow for it."]
