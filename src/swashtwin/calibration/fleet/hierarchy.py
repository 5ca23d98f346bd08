"""Several pumps of one type, calibrated together: each with the others as its prior."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.calibration.fleet.likelihood import Likelihood
from swashtwin.calibration.fleet.population import (
    SPREAD_WIDTH,
    Evidence,
    Population,
    covariance_within,
    names_shared,
    population_of,
)
from swashtwin.calibration.methods.gauss_newton import GaussNewton
from swashtwin.calibration.methods.search import Calibrator, Search
from swashtwin.calibration.objective.measurement import select_agreeing
from swashtwin.calibration.objective.operating_points import starting_twins
from swashtwin.calibration.objective.spectrum_objective import NONE, Objective
from swashtwin.calibration.objective.unknowns import Nuisances
from swashtwin.calibration.procedure import build_objective, build_result, settings_of
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.uncertainty.posterior import Estimate, estimates_of, posterior_covariance
from swashtwin.foundation import DataError, InputError, file_name, one_thread
from swashtwin.physics import Twin
from swashtwin.pump import Fault, Pump
from swashtwin.recordings import Recording, manifest_of

MOST_ROUNDS = 12
"""Most rounds in which population and pumps are estimated, each given the other."""
TOLERANCE = 0.01
"""They have converged where no mean and no logarithm of a spread moves by more than this."""


@dataclass(frozen=True, eq=False)
class FleetCalibration:
    """Pumps of one type, each calibrated on its recordings with the others as prior."""

    population: Population
    """What the pumps have in common; the prior of a new pump (``calibrate(..., prior=population)``)."""
    calibrations: Mapping[str, Calibration]
    """Calibration of each specimen: an ordinary one, whose prior was the population."""
    alone: Mapping[str, tuple[Estimate, ...]]
    """The six values of each as its own recordings give them."""
    left_out: tuple[tuple[str, str], ...]
    """Each specimen that no recording agreed with the twin of, and why."""
    rounds: int
    """Rounds in which population and pumps were estimated."""
    is_converged: bool
    """Whether they had converged by then."""
    wall_s: float
    """How long it took [s]."""

    def __repr__(self) -> str:
        return f"<FleetCalibration of {len(self.calibrations)} specimens: {', '.join(self.calibrations)}>"

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should look at, in words."""
        notes = []
        count = len(self.population.specimens)
        if count < 5:
            notes.append(
                f"{count} pumps say little about how much pumps of their type differ: see the spreads' intervals."
            )
        if not self.is_converged:
            notes.append(f"population and pumps had not converged after {self.rounds} rounds.")
        return tuple(notes)

    def to_dict(self) -> dict[str, Any]:
        """Population and values of each specimen, as JSON can hold them; the calibrations have files of their own."""
        return {
            "population": self.population.to_dict(),
            "specimens": {
                name: {
                    "alone": [asdict(estimate) for estimate in self.alone[name]],
                    "within": [asdict(estimate) for estimate in calibration.estimates],
                    "recording_ids": list(calibration.recording_ids),
                    "notes": list(calibration.notes),
                }
                for name, calibration in self.calibrations.items()
            },
            "left_out": [list(pair) for pair in self.left_out],
            "rounds": self.rounds,
            "is_converged": self.is_converged,
            "notes": list(self.notes),
            "wall_s": round(self.wall_s, 2),
        }

    def save(self, folder: Path | str) -> list[Path]:
        """Files written to `folder`: ``population.json``, and ``SPECIMEN.json`` for each specimen."""
        folder = Path(folder)
        paths = {name: folder / f"{_file_name(name)}.json" for name in self.calibrations}
        if len({str(path).lower() for path in paths.values()}) < len(paths):
            raise InputError(f"specimens {', '.join(paths)} differ in characters only that a file name cannot hold.")
        written = [self.population.save(folder / "population.json")]
        return written + [calibration.save(paths[name]) for name, calibration in self.calibrations.items()]


def _file_name(specimen: str) -> str:
    name = file_name(specimen)
    return f"{name}_" if name.lower() == "population" else name


@dataclass(frozen=True, eq=False)
class _Member:
    """One specimen on its way."""

    twins: tuple[Twin, ...]
    objective: Objective
    search: Search
    likelihood: Likelihood
    alone: tuple[Estimate, ...]

    @property
    def evidence(self) -> Evidence:
        return self.likelihood.evidence(self.objective, self.search.point)

    @property
    def discrepancy_covariance(self) -> np.ndarray:
        """Covariance of the coordinates by what the twin lacks, beside that by noise."""
        point, objective = self.search.point, self.objective
        total: np.ndarray = self.likelihood.covariance(objective, point)
        return total - Likelihood.around(objective, point, with_discrepancy=False).covariance(objective, point)

    def with_prior(self, population: Population) -> "_Member":
        """The same, moved to where its own recordings and the population have it."""
        unknowns = replace(self.objective.unknowns, center=population.mean, deviation=population.spread)
        point = self.likelihood.maximum(replace(self.objective, unknowns=unknowns), self.search.point)
        return replace(self, search=replace(self.search, point=point))


def calibrate_fleet(
    pump: str | Pump | Twin | Sequence[Twin],
    recordings: Iterable[Recording],
    *,
    fault: Fault | None = None,
    method: Calibrator | None = None,
    seed: int = 0,
    bounds: Mapping[str, tuple[float, float]] | float | None = None,
    band: tuple[float, float] | None = None,
    nuisances: Nuisances = NONE,
    phases: bool = False,
    spread_width: float = SPREAD_WIDTH,
) -> FleetCalibration:
    """Calibration of each specimen among `recordings`, and of the population that they come from.

    Empirical Bayes: each specimen is calibrated alone; mean and spread of every coordinate over the specimens are
    estimated from what their recordings say without a prior (`population`), and each specimen is estimated again with
    the population as its prior; again until both have converged. A pump with strong recordings hardly moves, one with
    weak ones goes toward the others, and a value that no recording determines stays not identified. A discrepancy that
    all twins share moves the mean, and more pumps do not cure that: it is taken as the same in all of them in the
    mean's standard deviation.

    Parameters
    ----------
    pump : type of all pumps, or its name; or a twin, or several that differ in condition only. A specimen uses those
        at whose conditions it was measured.
    recordings : of all specimens, distinguished by `Recording.specimen`; those that do not agree with the twin are left
        out, as in `calibrate`.
    fault : what all pumps had; None is healthy pumps.
    method : of the first search of each specimen; `GaussNewton` by default.
    bounds, band, nuisances, phases : as in `calibrate`, but by default there are no nuisances and no phases. Each
        nuisance would need a mean over the type and a spread from few pumps: on the virtual rig that made the
        intervals too narrow (docs/explanation/calibration.md). Gains and modes are refused where channels differ.
    spread_width : width of the half-normal density of the spreads of ln value.

    Raises
    ------
    DataError
        A recording names no specimen, or fewer than two specimens have recordings that agree with the twin.
    InputError
        Specimens with gains or modes were measured on different channels; spread_width is not positive.
    """
    started = time.perf_counter()
    if not spread_width > 0:
        raise InputError(f"spread_width ({spread_width:g}) must be positive.")
    method = GaussNewton() if method is None else method
    recordings = list(recordings)
    used, left_out = _by_specimen(starting_twins(pump, recordings, fault), recordings)
    members = {}
    for name, (twins, group) in used.items():
        objective = build_objective(twins, group, bounds=bounds, band=band, nuisances=nuisances, phases=phases)
        members[name] = _alone(twins, objective, method, seed)
    names_shared([member.objective.unknowns for member in members.values()])
    with one_thread():
        members, population, rounds, is_converged = _together(members, spread_width)
    shared = np.mean([member.discrepancy_covariance for member in members.values()], axis=0)
    population = replace(
        population,
        mean_covariance=population.mean_covariance + shared,
        manifest=manifest_of([recording for _, group in used.values() for recording in group]),
        pump=next(iter(members.values())).twins[0].pump.name,
    )
    wall_s = time.perf_counter() - started
    return FleetCalibration(
        population=population,
        calibrations={
            name: _build_result(member, population, shared, method, seed, wall_s) for name, member in members.items()
        },
        alone={name: member.alone for name, member in members.items()},
        left_out=tuple(left_out),
        rounds=rounds,
        is_converged=is_converged,
        wall_s=time.perf_counter() - started,
    )


def _by_specimen(
    twins: Sequence[Twin], recordings: Iterable[Recording]
) -> tuple[dict[str, tuple[list[Twin], list[Recording]]], list[tuple[str, str]]]:
    """Twins and recordings of each specimen, and the specimens left out with the reason."""
    groups: dict[str, list[Recording]] = {}
    for recording in recordings:
        if not recording.specimen:
            raise DataError(f"{recording.recording_id} names no specimen; a fleet needs to know which pump it is of.")
        groups.setdefault(recording.specimen, []).append(recording)
    used, left_out = {}, []
    for name, group in groups.items():
        matching, reason = [], ""
        for twin in twins:
            try:
                select_agreeing(twin, group)
                matching.append(twin)
            except DataError as cause:
                reason = str(cause)
        if matching:
            used[name] = (matching, group)
        else:
            left_out.append((name, reason))
    if len(used) < 2:
        others = "".join(f" {name}: {reason}" for name, reason in left_out[:1])
        raise DataError(
            "a fleet needs two specimens with recordings that agree with the twin; there "
            f"{'is one, ' + next(iter(used)) if used else 'is none'}.{others}"
        )
    return used, left_out


def _alone(twins: Sequence[Twin], objective: Objective, method: Calibrator, seed: int) -> _Member:
    search = method.search(objective, seed=seed)
    alone = estimates_of(objective, search.point, posterior_covariance(objective, search.point))
    return _Member(tuple(twins), objective, search, Likelihood.around(objective, search.point), alone)


def _together(members: dict[str, _Member], spread_width: float) -> tuple[dict[str, _Member], Population, int, bool]:
    """Members and population, each estimated given the other until both converge."""
    unknowns = next(iter(members.values())).objective.unknowns
    before: Population | None = None
    for rounds in range(1, MOST_ROUNDS + 1):
        evidence = {name: member.evidence for name, member in members.items()}
        population = population_of(evidence, unknowns, spread_width)
        members = {name: member.with_prior(population) for name, member in members.items()}
        if before is not None and _distance(before, population) < TOLERANCE:
            return members, population, rounds, True
        before = population
    return members, population, MOST_ROUNDS, False


def _distance(first: Population, second: Population) -> float:
    moved = np.abs(first.mean - second.mean), np.abs(np.log(first.spread / second.spread))
    return float(np.max(moved))


def _build_result(
    member: _Member, population: Population, shared: np.ndarray, method: Calibrator, seed: int, wall_s: float
) -> Calibration:
    objective = replace(member.objective, unknowns=population.prior_of(member.objective.unknowns))
    covariance = covariance_within(member.evidence, population, shared, objective.unknowns.deviation)
    settings = {**settings_of(method, objective, seed), "prior": f"population of {', '.join(population.specimens)}"}
    return build_result(
        objective, member.twins[0], member.search, covariance, method=method, settings=settings, wall_s=wall_s
    )
