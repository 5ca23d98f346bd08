"""Calibration from recordings to result."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, astuple, fields, is_dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from swashtwin.calibration.calibration_notes import UNPLACED_CHANNEL, collect_notes
from swashtwin.calibration.fit import evaluate_fit
from swashtwin.calibration.ipinn import IPINN
from swashtwin.calibration.measurement import (
    DEFAULT_BAND,
    LINE_SPEED_TOLERANCE,
    Lines,
    assign_single_channels,
    measure,
    select_matching_recordings,
)
from swashtwin.calibration.misfit_hypotheses import MisfitHypothesis, find_suspected_mistakes
from swashtwin.calibration.posterior import (
    Posterior,
    build_estimates,
    compute_misfit,
    posterior_covariance,
)
from swashtwin.calibration.recording_checks import require_one_machine
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.search import (
    Calibrator,
    GaussNewton,
    Progress,
    SearchResult,
    widening_search,
)
from swashtwin.calibration.severity.law_search import identify_law
from swashtwin.calibration.spectrum_objective import NO_NUISANCES, Objective, build_objective
from swashtwin.calibration.unknowns import Nuisances, build_search_space, find_default_bounds
from swashtwin.foundation import VERSION, DataError, InputError
from swashtwin.physics import Twin
from swashtwin.pump import (
    Fault,
    OperatingCondition,
    Pump,
    group_by_condition,
    is_same_class,
    load_pump,
)
from swashtwin.recordings import Recording, build_manifest, summarize_recordings

PAPER_CALIBRATION: Mapping[str, Any] = MappingProxyType(
    {"method": IPINN(), "nuisances": NO_NUISANCES, "phases": False}
)
"""The paper's settings, ``calibrate(pump, recordings, **PAPER_CALIBRATION)``: its network, the six
values, no phases.
"""
RECOMMENDED_NUISANCES = Nuisances.by_axis()
"""Constants that `calibrate` searches by default."""
FREE_PATH_STD = 1.0
"""Prior deviation of the logarithm of the gain, and of the housing's shares, of a sensor whose
position is unknown.
"""
MIN_SQUARES_FALL = 1.0
"""Fall of the sum of squares, priors included, from which another optimum replaces the first."""


def calibrate(
    pump: str | Pump | Twin | Sequence[Twin],
    recordings: Iterable[Recording],
    *,
    fault: Fault | None = None,
    method: Calibrator | None = None,
    seed: int = 0,
    bounds: Mapping[str, tuple[float, float]] | float | None = None,
    band: tuple[float, float] | None = None,
    lines: Lines = "piston",
    nuisances: Nuisances = RECOMMENDED_NUISANCES,
    phases: bool = True,
    explain_misfit: bool = True,
    law: Fault | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Return the twin whose lines come nearest to those of measured recordings, and how far to
    trust its six values.

    Of `recordings`, those of the class of `fault` (without one, ``"normal"`` or ``"healthy"``) are
    used, with the operating point that each specifies; the others are listed in
    `Calibration.excluded_recordings` with the reason. Recordings at several operating points are
    fitted together, with one set of values; so are recordings of several sets of sensors. Channels
    are the pump's sensors of the same names; a single channel of another name counts as the first
    of them, its gain and the housing's share in it free. Calibrating is training: no recording used
    here may be part of a test set.

    Parameters
    ----------
    pump : a pump, or its name (`load_pump`); the search starts at its interface values. Or a
        `Twin`, or several that differ in condition only: then the recordings within 1 % of a twin's
        speed and 6 % of its discharge pressure are used.
    fault : fault of the recorded pump, with dimensions; `None` is a healthy pump.
    method : `GaussNewton` by default; `IPINN` is the paper's.
    bounds : bounds of the search: a factor, or (lower, upper) by parameter name or symbol. The
        default is a factor of 10, widened tenfold up to 1000 for a value that ends at a bound;
        `IPINN` keeps its bounds.
    band : frequencies [Hz] whose lines are compared; see `DEFAULT_BAND`.
    lines : multiples of the piston count, or all shaft orders; see `measure`.
    nuisances : constants searched with the six values, with their priors; by default mounting by
        axis, each bearing, excitation, sensors with cross-talk, and two modes of the housing.
        ``Nuisances()`` searches no constants, as in the paper.
    phases : compare the lines' phases too, which makes the values more certain
        (docs/explanation/calibration.md). The shaft's angle is then followed on the recording
        itself. The paper compares amplitudes only.
    explain_misfit : if the calibrated lines miss the measured ones by more than expected, or a
        bound or a prior strains the fit, calibrate again as if each of a few simple mistakes (two
        channels swapped, another unit) had been made. The search starts again from those that
        explain it; what is still suspected at the best optimum is noted.
    law : a recess with its known dimensions, whose law is searched on the recordings of its class
        after the healthy ones (`Calibration.law`): how far slippers follow it, under which contact,
        how deep it acts.
    progress : called with (steps done, total steps, loss).

    Raises
    ------
    DataError
        No recording can be used, or one is unfit, or shows no line to follow for the phases; or
        they are of several machines.
    UnitError
        A recording is not in m/s^2.
    InputError
        Impossible bounds or band, or a law with a calibration on faulty recordings.
    """
    if law is not None and fault is not None:
        raise InputError(
            "A fault's law is searched with the healthy pump's calibration.",
            field="fault",
            remedy="Omit {fault}.",
        )

    started = time.perf_counter()
    recordings = list(recordings)
    method = method or GaussNewton()
    band = band or DEFAULT_BAND

    twins = build_starting_twins(pump, recordings, fault)
    recordings, unplaced = assign_single_channels(recordings, twins[0].pump)
    if unplaced:
        nuisances = replace(
            nuisances,
            gains=max(nuisances.gains, FREE_PATH_STD),
            residue=max(nuisances.residue, FREE_PATH_STD),
        )
    build_search_space(twins[0], bounds)  # refuses impossible bounds before anything is measured

    groups = _group_by_channels(twins, recordings)
    measurements = [measure(twin, group, band, lines, phases=phases) for twin, group in groups]
    require_one_machine(
        [recording for measurement in measurements for recording in measurement.recordings],
        "a calibration",
    )
    objective = build_objective([twin for twin, _ in groups], measurements, bounds, nuisances)

    widened = find_default_bounds(bounds)
    if isinstance(method, IPINN):
        widened = ()  # a loss of the paper's method pulls values back into the bounds
    objective, result, hypotheses = _search(
        objective,
        method,
        widened=widened,
        explain_misfit=explain_misfit,
        seed=seed,
        progress=progress,
    )

    calibration = _build_calibration(
        twins[0], method, objective, result, hypotheses, unplaced=unplaced, seed=seed
    )
    if law is not None:
        calibration = _add_law(calibration, objective, recordings, law)
    return replace(calibration, wall_s=time.perf_counter() - started)


def _group_by_channels(
    twins: Sequence[Twin], recordings: Sequence[Recording]
) -> list[tuple[Twin, list[Recording]]]:
    """Return each twin with its recordings, once for each set of channels.

    Every group also holds all recordings that do not agree with the twin, so that they are listed
    as excluded.
    """
    groups = []
    for twin in twins:
        matching, _ = select_matching_recordings(twin, recordings)
        channels_by_id = {id(recording): recording.channels for recording in matching}
        for channels in dict.fromkeys(channels_by_id.values()):
            group = [
                recording
                for recording in recordings
                if channels_by_id.get(id(recording), channels) == channels
            ]
            groups.append((twin, group))
    return groups


def _build_calibration(
    nominal: Twin,
    method: Calibrator,
    objective: Objective,
    result: SearchResult,
    hypotheses: Sequence[MisfitHypothesis],
    *,
    unplaced: Sequence[str],
    seed: int,
) -> Calibration:
    """Return the result of a search with its posterior, fits and notes."""
    covariance = posterior_covariance(objective, result.point)
    posterior = Posterior(objective.unknowns, result.point, covariance)
    estimates = build_estimates(
        objective, result.point, covariance, has_suspected_mistake=bool(hypotheses)
    )
    misfit = compute_misfit(objective, result.point)
    calibrated = posterior.twin_at(nominal, result.point)

    used = _used_recordings(objective)
    recording_ids = tuple(recording.recording_id for recording in used)
    excluded = objective.comparisons[0].measurement.excluded_recordings
    channel_notes = [UNPLACED_CHANNEL.format(name, nominal.pump.channels[0]) for name in unplaced]
    return Calibration(
        twin=calibrated,
        nominal=nominal,
        estimates=estimates,
        posterior=posterior,
        fits=tuple(
            evaluate_fit(comparison, nominal, calibrated, posterior)
            for comparison in objective.comparisons
        ),
        history=result.history,
        recording_ids=recording_ids,
        recording_hashes=build_manifest(used),
        excluded_recordings=tuple(
            (name, reason) for name, reason in excluded if name not in recording_ids
        ),
        notes=(
            *channel_notes,
            *collect_notes(objective, result, estimates, misfit, hypotheses),
        ),
        misfit=misfit,
        suspected_mistakes=tuple(hypothesis.mistake for hypothesis in hypotheses),
        method=type(method).__name__,
        settings=_collect_settings(method, objective, seed),
        simulations=result.simulations,
        wall_s=0.0,
        version=VERSION,
        origin=summarize_recordings(used).origin,
    )


def _used_recordings(objective: Objective) -> list[Recording]:
    """Return the recordings of all comparisons."""
    return [
        recording
        for comparison in objective.comparisons
        for recording in comparison.measurement.recordings
    ]


def _add_law(
    calibration: Calibration, objective: Objective, recordings: Sequence[Recording], fault: Fault
) -> Calibration:
    """Return the calibration with the law of a recess; the recordings of the recess count as
    used.
    """
    healthy = _used_recordings(objective)
    law = identify_law(calibration, recordings, fault, healthy)
    faulty = [recording for recording in recordings if recording.recording_id in law.recording_ids]
    recording_ids = tuple(recording.recording_id for recording in (*healthy, *faulty))
    return replace(
        calibration,
        law=law,
        recording_ids=recording_ids,
        recording_hashes=build_manifest([*healthy, *faulty]),
        excluded_recordings=tuple(
            (name, reason)
            for name, reason in calibration.excluded_recordings
            if name not in recording_ids
        ),
    )


def _search(
    objective: Objective,
    method: Calibrator,
    *,
    widened: tuple[str, ...],
    explain_misfit: bool,
    seed: int,
    progress: Progress | None,
) -> tuple[Objective, SearchResult, tuple[MisfitHypothesis, ...]]:
    """Return the objective with its final bounds, the best optimum, and the mistakes that would
    explain what it still misses.

    Gauss-Newton steps start again from each suspected mistake that leaves what is searched as it
    is.

    Parameters
    ----------
    widened : symbols of the values whose bounds may be widened.
    """
    first_objective, first = widening_search(
        objective, method, widened, seed=seed, progress=progress
    )
    if not explain_misfit:
        return first_objective, first, ()

    hypotheses = find_suspected_mistakes(first_objective, first.point)
    starts = [
        hypothesis.point
        for hypothesis in hypotheses
        if hypothesis.objective.unknowns.names == first_objective.unknowns.names
    ]
    if not (starts and isinstance(method, GaussNewton)):
        return first_objective, first, hypotheses

    best_objective = first_objective
    best = first
    # the hypotheses are the further starts
    single_start = replace(method, starts=1)
    for start in starts:
        clipped = np.clip(start, objective.unknowns.lower, objective.unknowns.upper)
        unknowns = replace(objective.unknowns, initial_point=clipped)
        candidate_objective, candidate = widening_search(
            replace(objective, unknowns=unknowns), single_start, widened, seed=seed
        )
        if candidate.history.min_loss < best.history.min_loss:
            best_objective, best = candidate_objective, candidate

    fall = first.history.min_loss**2 - best.history.min_loss**2
    if fall * objective.measured.numel() < MIN_SQUARES_FALL:
        return first_objective, first, hypotheses

    unknowns = replace(best_objective.unknowns, initial_point=None)
    best_objective = replace(best_objective, unknowns=unknowns)
    return best_objective, best, find_suspected_mistakes(best_objective, best.point)


def build_starting_twins(
    pump: str | Pump | Twin | Sequence[Twin],
    recordings: Sequence[Recording],
    fault: Fault | None = None,
) -> list[Twin]:
    """Return the twins of one pump: those given, or one for each operating point of the recordings
    of the fault's class.

    Raises
    ------
    InputError
        Twins differ in more than condition, or a fault is given with them.
    DataError
        No recording has the fault's class, or none of those specifies its operating point.
    """
    if isinstance(pump, str):
        pump = load_pump(pump)
    if isinstance(pump, Pump):
        return [Twin(pump, condition, fault) for condition in _operating_points(recordings, fault)]

    if isinstance(pump, Twin):
        pump = [pump]
    twins = list(pump)
    if not twins or not all(isinstance(twin, Twin) for twin in twins):
        raise InputError("pump must be a pump, the name of a pump, a twin or several twins.")
    if fault is not None:
        raise InputError(
            "fault applies to a pump only; give a twin its fault with its method with_fault."
        )

    constant = [field.name for field in fields(Twin) if field.name != "condition"]
    for twin in twins[1:]:
        if any(getattr(twin, name) != getattr(twins[0], name) for name in constant):
            raise InputError(
                "Twins that are calibrated together must differ in condition only: make them with "
                "the method at."
            )
    return twins


def _operating_points(
    recordings: Sequence[Recording], fault: Fault | None
) -> list[OperatingCondition]:
    """Return the mean condition of each group of recordings at the same operating point, by speed
    and pressure.
    """
    label = "normal"
    specify = "give {fault} for"
    if fault is not None:
        label = fault.label
        specify = "give a {fault} of the class of"

    labeled = [recording for recording in recordings if is_same_class(recording.label, label)]
    if not labeled:
        labels = ", ".join(sorted({str(recording.label) for recording in recordings}))
        reason = "there are no recordings"
        if labels:
            reason = f"labels: {labels}"
        raise DataError(
            f"No recording is labeled {label!r} ({reason}).",
            field="fault",
            remedy=f"Label healthy ones 'normal', or {specify} the faulty recordings.",
        )

    conditions = [recording.condition for recording in labeled if recording.condition is not None]
    if not conditions:
        raise DataError(
            f"{labeled[0].recording_id} specifies no operating point, nor does any other {label} "
            'recording. Add speed and discharge pressure, such as "860 rpm" and "10 MPa", to the '
            "index file."
        )

    groups = group_by_condition(conditions, speed=LINE_SPEED_TOLERANCE)
    rows = np.array([astuple(condition) for condition in conditions])
    return [OperatingCondition(*rows[group].mean(axis=0).tolist()) for group in groups]


def _collect_settings(method: Calibrator, objective: Objective, seed: int) -> dict[str, Any]:
    """Return the settings of a search as JSON values."""
    settings: dict[str, Any] = {}
    if is_dataclass(method) and not isinstance(method, type):
        settings = asdict(method)
    if hasattr(method, "solver"):
        settings["solver"] = repr(method.solver)

    measurement = objective.comparisons[0].measurement
    settings["band"] = measurement.band
    settings["lines"] = measurement.lines
    settings["phases"] = objective.has_phases
    settings["seed"] = seed
    for name, value in settings.items():
        if isinstance(value, tuple):
            settings[name] = list(value)
    return settings
