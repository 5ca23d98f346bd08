"""Calibration from recordings to result."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.calibration.fleet.likelihood import Likelihood
from swashtwin.calibration.fleet.population import Population
from swashtwin.calibration.methods.checkpoint import Checkpoint, ResumableCalibrator
from swashtwin.calibration.methods.ipinn import IPINN
from swashtwin.calibration.methods.search import Calibrator, Progress, Search
from swashtwin.calibration.notes import notes_of
from swashtwin.calibration.objective.agreement import fit_of
from swashtwin.calibration.objective.measurement import DEFAULT_BAND, Lines, Measurement, measure
from swashtwin.calibration.objective.spectrum_objective import NONE, Objective, objective_of
from swashtwin.calibration.objective.unknowns import Nuisances
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.uncertainty.identifiability_report import estimates_of, posterior_covariance
from swashtwin.calibration.uncertainty.posterior import Posterior
from swashtwin.foundation import VERSION, InputError
from swashtwin.physics import Twin
from swashtwin.recordings import Recording


def calibrate(
    twin: Twin | Sequence[Twin],
    recordings: Iterable[Recording],
    *,
    method: Calibrator | None = None,
    seed: int = 0,
    bounds: Mapping[str, tuple[float, float]] | float | None = None,
    band: tuple[float, float] | None = None,
    lines: Lines = "piston",
    nuisances: Nuisances = NONE,
    prior: Population | None = None,
    phases: bool = False,
    progress: Progress | None = None,
    checkpoint: Path | str | None = None,
    resume: bool = False,
) -> Calibration:
    """Twin whose lines come nearest to those of measured recordings, and how far to trust its six values.

    `recordings` may hold more than fits: used are those whose label is the twin's, whose speed is within 1 % and whose
    discharge pressure is within 6 % of the twin's; the others are listed in `Calibration.left_out`. So all known
    recordings can be given as they are, and a twin at 15 MPa is never taught at 10 MPa by mistake. Calibrating is
    training: no recording used here may stand in a test set.

    Parameters
    ----------
    twin : where to start; its interface values are the nominal ones. Several twins of one pump, which differ in
        condition only, are calibrated together: one set of values for all of them.
    method : `IPINN` (the paper's) by default; `GaussNewton` takes a tenth of the time.
    bounds : where to search: a factor (10 by default), or (least, greatest) by parameter name or letter.
    band : frequencies [Hz] whose lines are compared; see `DEFAULT_BAND`.
    lines : multiples of the piston count, or all shaft orders; see `measure`.
    nuisances : constants searched beside the six values, with their priors; none by default, as in the paper.
    prior : what is known of pumps of this type (`calibrate_fleet`); by default nothing but the bounds.
    phases : compare the lines' phases too, which makes the values more certain (docs/calibration.md); the paper drops
        them. The shaft's angle is then followed on the recording itself.
    progress : called with (steps done, steps in all, loss).
    checkpoint : file that a search in epochs (`IPINN`, `DirectAdam`) is kept in every 25 of them.
    resume : continue from `checkpoint` if it exists; the result has the same bits as a search without interruption.

    Raises
    ------
    DataError
        No recording agrees with the twin, or one is unfit, or shows no line to follow for the phases.
    UnitError
        A recording is not in m/s^2.
    InputError
        Impossible bounds or band; the checkpoint is of another search, or the method keeps none.
    """
    started = time.perf_counter()
    method = IPINN() if method is None else method
    twins = [twin] if isinstance(twin, Twin) else list(twin)
    objective = prepared(
        twins,
        list(recordings),
        bounds=bounds,
        band=band,
        nuisances=nuisances,
        lines=lines,
        phases=phases,
        prior=prior,
    )
    settings = settings_of(method, objective, seed)
    kept = _checkpoint(checkpoint, resume, method, {**settings, "measurement (SHA-256)": objective.fingerprint()})
    found = method.search(objective, seed=seed, progress=progress, **kept)
    if prior is None:
        covariance = posterior_covariance(objective, found.point)
    else:
        settings["prior"] = f"population of {', '.join(prior.specimens)}"
        found, covariance = settled(objective, found)
    return concluded(
        objective, twins[0], found, covariance, method=method, settings=settings, wall_s=time.perf_counter() - started
    )


def prepared(
    twins: Sequence[Twin],
    recordings: Sequence[Recording],
    *,
    bounds: Mapping[str, tuple[float, float]] | float | None,
    band: tuple[float, float] | None,
    nuisances: Nuisances,
    lines: Lines = "piston",
    phases: bool = False,
    prior: Population | None = None,
) -> Objective:
    """Objective of `calibrate` on the recordings that agree with the twins."""
    measurements = _measured(twins, recordings, DEFAULT_BAND if band is None else band, lines, phases)
    objective = objective_of(twins, measurements, bounds, nuisances)
    return objective if prior is None else replace(objective, unknowns=prior.prior_of(objective.unknowns))


def settings_of(method: Calibrator, objective: Objective, seed: int) -> dict[str, Any]:
    """Settings of a search, as JSON can hold them."""
    measurement = objective.comparisons[0].measurement
    kept = {"band": list(measurement.band), "lines": measurement.lines, "phases": objective.has_phases, "seed": seed}
    return {**_settings(method), **kept}


def settled(objective: Objective, found: Search) -> tuple[Search, np.ndarray]:
    """What was found, moved to where the posterior is highest if the twin's discrepancy is counted, and the covariance.

    A search weighs lines as if their errors were independent, and so believes the measurement more than a prior that
    says something; see `likelihood`.
    """
    likelihood = Likelihood.around(objective, found.point)
    point = likelihood.summit(objective, found.point)
    return replace(found, point=point), likelihood.covariance(objective, point)


def concluded(
    objective: Objective,
    nominal: Twin,
    found: Search,
    covariance: Float[np.ndarray, "unknown unknown"],
    *,
    method: Calibrator,
    settings: Mapping[str, Any],
    wall_s: float,
) -> Calibration:
    """Calibration of what a search found.

    Parameters
    ----------
    nominal : the twin before.
    covariance : of the coordinates found, about the truth.
    wall_s : how long it took [s].
    """
    measurements = [one.measurement for one in objective.comparisons]
    estimates = estimates_of(objective, found.point, covariance)
    posterior = Posterior(objective.unknowns, measurements[0].channels, found.point, covariance)
    calibrated = posterior.twin_at(nominal, found.point)
    return Calibration(
        twin=calibrated,
        nominal=nominal,
        estimates=estimates,
        posterior=posterior,
        fits=tuple(fit_of(one, nominal, calibrated, posterior) for one in objective.comparisons),
        history=found.history,
        recording_ids=tuple(name for one in measurements for name in one.recording_ids),
        recording_hashes={one.recording_id: one.fingerprint() for m in measurements for one in m.recordings},
        left_out=_left_out(measurements),
        notes=notes_of(objective, found, estimates),
        method=type(method).__name__,
        settings=settings,
        simulations=found.simulations,
        wall_s=wall_s,
        version=VERSION,
    )


def _measured(
    twins: Sequence[Twin], recordings: Sequence[Recording], band: tuple[float, float], lines: Lines, phases: bool
) -> list[Measurement]:
    constant = [name for name in (item.name for item in fields(Twin)) if name != "condition"]
    for one in twins[1:]:
        if any(getattr(one, name) != getattr(twins[0], name) for name in constant):
            raise InputError("twins that are calibrated together must differ in condition only: twin.at(condition).")
    return [measure(one, recordings, band, lines, phases=phases) for one in twins]


def _checkpoint(
    path: Path | str | None, resume: bool, method: Calibrator, job: Mapping[str, Any]
) -> dict[str, Checkpoint]:
    """What `method.search` is given beside the rest to keep its state."""
    name = type(method).__name__
    if path is None:
        if resume:
            raise InputError("resume=True needs checkpoint=, the file to continue from.")
        return {}
    if not isinstance(method, ResumableCalibrator):
        raise InputError(f"{name} keeps no checkpoint: begun again with the same seed it ends at the same bits.")
    if Path(path).exists() and not resume:
        raise InputError(f"{path} exists; continue it with resume=True, or delete it to start again.")
    return {"checkpoint": Checkpoint(Path(path), job={"method": name, **job})}


def _left_out(measurements: Sequence[Measurement]) -> tuple[tuple[str, str], ...]:
    """What none of the measurements holds, with the reason of the first."""
    used = {name for one in measurements for name in one.recording_ids}
    return tuple(pair for pair in measurements[0].left_out if pair[0] not in used)


def _settings(method: Calibrator) -> dict[str, Any]:
    settings: dict[str, Any] = dict(getattr(method, "settings", {}))  # of a method that is more than its settings
    if is_dataclass(method) and not isinstance(method, type):
        settings = asdict(method)
    if hasattr(method, "solver"):
        settings["solver"] = repr(method.solver)
    return {name: list(value) if isinstance(value, tuple) else value for name, value in settings.items()}
