"""Calibration from recordings to result."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, fields, is_dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from swashtwin.calibration.fit import fit_of
from swashtwin.calibration.ipinn import IPINN
from swashtwin.calibration.measurement import (
    DEFAULT_BAND,
    LINE_SPEED_TOLERANCE,
    Lines,
    assign_single_channels,
    measure,
    select_agreeing,
)
from swashtwin.calibration.misfit_hypotheses import (
    MisfitHypothesis,
    describe_constant,
    suspected_mistakes,
)
from swashtwin.calibration.posterior import (
    MISFIT,
    Estimate,
    Posterior,
    build_estimates,
    compute_misfit,
    posterior_covariance,
    strained_constants,
)
from swashtwin.calibration.recording_checks import require_one_machine
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.search import (
    WIDENED,
    Calibrator,
    GaussNewton,
    Progress,
    Search,
    widening_search,
)
from swashtwin.calibration.severity.law_search import identify_law
from swashtwin.calibration.spectrum_objective import NONE, Objective, build_objective
from swashtwin.calibration.unknowns import CONSTANTS, Nuisances, build_search_space, unstated
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
    {"method": IPINN(), "nuisances": NONE, "phases": False}
)
"""The paper's way, ``calibrate(pump, recordings, **PAPER_CALIBRATION)``: its network, the six
values, no phases.
"""
RECOMMENDED_NUISANCES = Nuisances.by_axis()
"""What `calibrate` searches beside the six values where nothing is said."""
FREE_PATH = 1.0
"""Prior deviation of the logarithm of the gain, and of the housing's shares, of a sensor whose
place is unknown.
"""
DEEPER = 1.0
"""Fall of the sum of squares, priors counted, from which another optimum is reported in place of
the first.
"""
_PLACE = (
    "{0!r} is none of the pump's sensors: it counts as {1} with a free way from the shell, which leaves the values "
    "less certain. Name it as the sensor where it sits (--names), or add that place to [[sensors]] in the pump file."
)


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
    """Twin whose lines come nearest to those of measured recordings, and how far to trust its six
    values.

    Of `recordings`, those of the class of `fault` (without one, ``"normal"`` or ``"healthy"``) are
    used, with the operating condition that each states; the others are listed in
    `Calibration.excluded_recordings` with the reason. Recordings at several operating points are fitted
    together, with one set of values; so are recordings of several sets of sensors. Channels are the
    pump's sensors of the same names; a single channel of another name counts as the first of them,
    its gain and the housing's share in it free. Calibrating is training: no recording used here may
    stand in a test set.

    Parameters
    ----------
    pump : a pump, or its name (`load_pump`); its interface values are where the search starts. Or a
        `Twin`, or several that differ in condition only: then the recordings within 1 % of a twin's
        speed and 6 % of its discharge pressure are used.
    fault : what the recorded pump had, with dimensions; None is a healthy pump.
    method : `GaussNewton` by default; `IPINN` is the paper's.
    bounds : where to search: a factor, or (least, greatest) by parameter name or letter. Where
        nothing is stated it is a factor of 10, widened tenfold up to 1000 for a value that ends at
        a bound; `IPINN` keeps its bounds.
    band : frequencies [Hz] whose lines are compared; see `DEFAULT_BAND`.
    lines : multiples of the piston count, or all shaft orders; see `measure`.
    nuisances : constants searched beside the six values, with their priors; by default mounting by
        axis, each bearing, excitation, sensors with cross-talk, and two modes of the housing.
        ``Nuisances()`` is none, as in the paper.
    phases : compare the lines' phases too, which makes the values more certain
        (docs/explanation/calibration.md). The shaft's angle is then followed on the recording
        itself. The paper compares amplitudes only.
    explain_misfit : where the calibrated lines miss the measured ones by more than expected, or a
        bound or a prior strains the fit, calibrate again as if each of a few simple mistakes (two
        channels swapped, another unit) had been made. The search starts again from those that
        explain it; what is still suspected at the best optimum is noted.
    law : a recess as far as it is known, whose law is searched on the recordings of its class
        beside the healthy ones (`Calibration.law`): how far slippers follow it, under which
        contact, how deep it acts.
    progress : called with (steps done, steps in all, loss).

    Raises
    ------
    DataError
        No recording can be used, or one is unfit, or shows no line to follow for the phases; or
        they are of several machines.
    UnitError
        A recording is not in m/s^2.
    InputError
        Impossible bounds or band, or a law beside a calibration on faulty recordings.
    """
    if law is not None and fault is not None:
        raise InputError(
            "a fault's law is searched beside the healthy pump's calibration; leave out fault."
        )
    started = time.perf_counter()
    method = GaussNewton() if method is None else method
    twins = build_starting_twins(pump, recordings := list(recordings), fault)
    recordings, unplaced = assign_single_channels(recordings, twins[0].pump)
    if unplaced:
        wide = {name: max(getattr(nuisances, name), FREE_PATH) for name in ("gains", "residue")}
        nuisances = replace(nuisances, **wide)
    build_search_space(twins[0], bounds)  # refuses impossible bounds before anything is measured
    groups = []
    for (
        twin
    ) in twins:  # once for each set of channels of those that agree with it, with all that do not
        agreeing = {
            id(recording): recording.channels for recording in select_agreeing(twin, recordings)[0]
        }
        for channels in dict.fromkeys(agreeing.values()):
            groups.append(
                (
                    twin,
                    [item for item in recordings if agreeing.get(id(item), channels) == channels],
                )
            )
    band = DEFAULT_BAND if band is None else band
    measurements = [measure(twin, group, band, lines, phases=phases) for twin, group in groups]
    require_one_machine(
        [recording for each in measurements for recording in each.recordings], "a calibration"
    )
    objective = build_objective([twin for twin, _ in groups], measurements, bounds, nuisances)
    may_widen = (
        () if isinstance(method, IPINN) else unstated(bounds)
    )  # the paper's bounds pull back by a loss
    objective, search, hypotheses = _search(
        objective, method, may_widen, explain_misfit, seed, progress
    )
    misfit = compute_misfit(objective, search.point)
    covariance = posterior_covariance(objective, search.point)
    estimates = build_estimates(objective, search.point, covariance)
    posterior = Posterior(objective.unknowns, search.point, covariance)
    calibrated = posterior.twin_at(twins[0], search.point)
    measurements = [comparison.measurement for comparison in objective.comparisons]
    used = [recording for measurement in measurements for recording in measurement.recordings]
    names = tuple(recording.recording_id for recording in used)
    calibration = Calibration(
        twin=calibrated,
        nominal=twins[0],
        estimates=estimates,
        posterior=posterior,
        fits=tuple(
            fit_of(comparison, twins[0], calibrated, posterior)
            for comparison in objective.comparisons
        ),
        history=search.history,
        recording_ids=names,
        recording_hashes=build_manifest(used),
        excluded_recordings=tuple(
            (name, reason)
            for name, reason in measurements[0].excluded_recordings
            if name not in names
        ),
        notes=(
            *(_PLACE.format(name, twins[0].pump.channels[0]) for name in unplaced),
            *notes_of(objective, search, estimates, misfit, hypotheses),
        ),
        misfit=misfit,
        method=type(method).__name__,
        settings=_settings(method, objective, seed),
        simulations=search.simulations,
        wall_s=time.perf_counter() - started,
        version=VERSION,
        origin=summarize_recordings(used).origin,
    )
    if law is None:
        return calibration
    identified = identify_law(calibration, recordings, law, used)
    used += [
        recording for recording in recordings if recording.recording_id in identified.recording_ids
    ]
    names = tuple(recording.recording_id for recording in used)
    return replace(
        calibration,
        law=identified,
        recording_ids=names,
        recording_hashes=build_manifest(used),
        excluded_recordings=tuple(
            pair for pair in calibration.excluded_recordings if pair[0] not in names
        ),
        wall_s=time.perf_counter() - started,
    )


def _search(
    objective: Objective,
    method: Calibrator,
    may_widen: tuple[str, ...],
    explain_misfit: bool,
    seed: int,
    progress: Progress | None,
) -> tuple[Objective, Search, tuple[MisfitHypothesis, ...]]:
    """The best optimum and the objective it lies in, and what mistakes would explain what it still
    misses.

    Gauss-Newton steps start again from each suspected mistake that moves only what is searched
    anyway.
    """
    found, search = widening_search(objective, method, may_widen, seed=seed, progress=progress)
    hypotheses = suspected_mistakes(found, search.point) if explain_misfit else ()
    starts = [hypothesis.start for hypothesis in hypotheses if hypothesis.start is not None]
    if not (starts and isinstance(method, GaussNewton)):
        return found, search, hypotheses
    best, once = (found, search), replace(method, starts=1)
    for start in starts:
        within = np.clip(start, objective.unknowns.lower, objective.unknowns.upper)
        begun = replace(objective, unknowns=replace(objective.unknowns, begun=within))
        again = widening_search(begun, once, may_widen, seed=seed)
        best = min(best, again, key=lambda pair: pair[1].history.min_loss)
    fall = search.history.min_loss**2 - best[1].history.min_loss ** 2
    if fall * objective.measured.numel() < DEEPER:
        return found, search, hypotheses
    better = replace(best[0], unknowns=replace(best[0].unknowns, begun=None))
    return better, best[1], suspected_mistakes(better, best[1].point)


def build_starting_twins(
    pump: str | Pump | Twin | Sequence[Twin],
    recordings: Sequence[Recording],
    fault: Fault | None = None,
) -> list[Twin]:
    """Twins of one pump: those given, or one for each operating point of the recordings of the
    fault's class.

    An `InputError` where twins differ in more than condition, or a fault is given beside them; a
    `DataError` where no recording has the fault's class, or none of those states its operating
    condition.
    """
    if isinstance(pump, str):
        pump = load_pump(pump)
    if isinstance(pump, Pump):
        return [Twin(pump, condition, fault) for condition in _operating_points(recordings, fault)]
    twins = [pump] if isinstance(pump, Twin) else list(pump)
    if not twins or not all(isinstance(twin, Twin) for twin in twins):
        raise InputError("pump must be a pump, its name, a twin or several twins; there is none.")
    if fault is not None:
        raise InputError(
            "a fault is given for a pump; a twin has its own, by its method with_fault."
        )
    constant = [item.name for item in fields(Twin) if item.name != "condition"]
    for twin in twins[1:]:
        if any(getattr(twin, name) != getattr(twins[0], name) for name in constant):
            raise InputError(
                "twins that are calibrated together must differ in condition only, as the method at makes them."
            )
    return twins


def _operating_points(
    recordings: Sequence[Recording], fault: Fault | None
) -> list[OperatingCondition]:
    """Mean condition of each group of recordings at the same operating point, by speed and
    pressure.
    """
    label = "normal" if fault is None else fault.label
    labeled = [recording for recording in recordings if is_same_class(recording.label, label)]
    if not labeled:
        labels = (
            ", ".join(sorted({str(recording.label) for recording in recordings}))
            or "no recording was given"
        )
        hint = (
            "give fault= for recordings of a fault"
            if fault is None
            else "give a fault of their class"
        )
        raise DataError(
            f"no recording is labeled {label!r} (labels: {labels}); label healthy ones 'normal', or {hint}."
        )
    conditions = [recording.condition for recording in labeled if recording.condition is not None]
    if not conditions:
        raise DataError(
            f"{labeled[0].recording_id} states no operating condition, nor does any other {label} recording; add speed "
            'and discharge pressure, such as "860 rpm" and "10 MPa", to the index file.'
        )
    groups = group_by_condition(conditions, speed=LINE_SPEED_TOLERANCE)
    rows = np.array([astuple(condition) for condition in conditions])
    return [OperatingCondition(*rows[group].mean(axis=0).tolist()) for group in groups]


def _settings(method: Calibrator, objective: Objective, seed: int) -> dict[str, Any]:
    """Settings of a search, as JSON can hold them."""
    settings: dict[str, Any] = (
        asdict(method) if is_dataclass(method) and not isinstance(method, type) else {}
    )
    if hasattr(method, "solver"):
        settings["solver"] = repr(method.solver)
    measurement = objective.comparisons[0].measurement
    settings |= {
        "band": measurement.band,
        "lines": measurement.lines,
        "phases": objective.has_phases,
        "seed": seed,
    }
    return {
        name: list(value) if isinstance(value, tuple) else value for name, value in settings.items()
    }


FAR = 2.0
"""A constant that ends so many deviations of its prior from what was stated is named beside a
misfit.
"""
_UNLEARNT = "not identified; the measurement adds hardly anything to the prior."


def notes_of(
    objective: Objective,
    search: Search,
    estimates: tuple[Estimate, ...],
    misfit: float,
    hypotheses: Sequence[MisfitHypothesis],
) -> tuple[str, ...]:
    """Notes of a search and what came of it, with the mistakes that would explain its misfit."""
    notes = [
        *search.notes,
        *(note for comparison in objective.comparisons for note in comparison.measurement.notes),
    ]
    doubts = [*_bounds(objective, search, estimates)]
    if misfit > MISFIT:
        lacks = ""
        if not hypotheses:
            away = ((search.point - objective.unknowns.center) / objective.unknowns.deviation)[
                CONSTANTS
            ]
            names = [
                objective.unknowns.names[CONSTANTS][i]
                for i in np.argsort(-np.abs(away))
                if abs(away[i]) > FAR
            ]
            far = ", ".join(
                [describe_constant(name) for name in names if not name.startswith("mode ")][:3]
            )
            lacks = "; the model lacks something (housing modes, wrong constants)"
            if far:
                lacks = f"; farthest from what was stated: {far}"
        doubts.append(
            f"the calibrated lines miss the measured ones by {misfit:.2g} times what was expected, so no value is "
            f"called identified{lacks}"
        )
    doubts += [hypothesis.words for hypothesis in hypotheses]
    if doubts:
        notes.append(
            "; ".join(doubts).removesuffix("?") + ("?" if doubts[-1].endswith("?") else ".")
        )
    unknown = [estimate.symbol for estimate in estimates if estimate.verdict == "not identified"]
    if unknown:
        notes.append(f"{', '.join(unknown)}: {_UNLEARNT}")
    return tuple(notes)


def is_warning(note: str) -> bool:
    """Whether a note says that something may be wrong, not only that values are unknown or bounds
    were widened.
    """
    return not note.endswith((_UNLEARNT, WIDENED))


def _bounds(objective: Objective, search: Search, estimates: tuple[Estimate, ...]) -> Iterator[str]:
    """Values that a bound stopped, and constants that ended at or near one."""
    for estimate in estimates:
        if estimate.verdict == "at bound":
            low, high = (f"{bound:.3g}" for bound in estimate.bounds)
            yield (
                f"{estimate.symbol} was stopped by a bound ({low} to {high} {estimate.unit}): state wider ones "
                f'(--set "bounds={estimate.symbol}=LEAST..GREATEST"), or correct the pump file'
            )
    strained = strained_constants(objective.unknowns, search.point)
    if strained:
        constants = ", ".join(describe_constant(name) for name in strained)
        yield f"the fit strains what was stated beyond its prior ({constants}), so no value is called identified"
