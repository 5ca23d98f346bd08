"""Library of changes: what measured faults of other machines add to a pump prior.

A fleet of the virtual rig is tested, others are the library: of the same version, of another one,
with wrong labels, and a single machine. No machine of the tested fleet is in a library.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swashtwin.diagnosis import (
    ChangeLibrary,
    PriorClassifier,
    fit_with_library,
    join_libraries,
    measure_library,
)
from swashtwin.foundation import random_stream
from swashtwin.pump import CLASSES, Pump
from swashtwin.recordings import Recording
from swashtwin_bench.questions.zero_shot import DESIGN, METRICS, recording_scores
from swashtwin_bench.results.runs import Work
from swashtwin_bench.results.table import StudyTable, Trial, describe_origin
from swashtwin_bench.rigs.writing import (
    OTHER_DESIGNS,
    PRESSURES,
    SIZES,
    VERSIONS,
    rig_recordings,
)

STUDY = "library"

REFERENCES = 4
"""Healthy recordings of a machine and operating point that it is compared with."""

TESTS = 1
"""Healthy recordings of a machine and operating point that test."""

ALONE = "prior alone"
LIKE = "machines of the version"
ONE = "one machine of the version"
SHUFFLED = "machines of the version, faults shuffled"
EXCHANGED = "machines of the version, faults exchanged"


def of_version(version: str) -> str:
    """Return the name of the library with machines of another version."""
    return f"machines of version {version}"


_METRICS = {
    "recording_balanced_accuracy": METRICS["recording_balanced_accuracy"],
    "sure_and_wrong": METRICS["sure_and_wrong"],
    "unknown": METRICS["unknown"],
    "recordings": "recordings",
    "machines": "machines used",
    "weight": "weight",
    **{f"recall_{name}": METRICS[f"recall_{name}"] for name in CLASSES},
}


@dataclass(frozen=True)
class LibrarySettings:
    """Fleets of the study."""

    versions: tuple[str, ...] = ("1", "2", "3")
    """Versions of the virtual rig, each of which is tested."""
    library: tuple[int, ...] = (110, 111)
    """Seeds of the fleets in the libraries."""


@dataclass(frozen=True, eq=False)
class _Fleet:
    """Recordings of a fleet, and the design of each machine."""

    recordings: tuple[Recording, ...]
    pump_of: Mapping[str, Pump]


def library(work: Work, settings: LibrarySettings) -> StudyTable:
    """Return the scores of a prior with libraries of several kinds, on fleets that they lack.

    Parameters
    ----------
    work : each seed is a tested fleet.
    """
    versions = settings.versions
    cases = [(version, seed) for version in versions for seed in settings.library]
    measured = work.map("libraries", _measure_fleet, cases)
    libraries = {
        version: join_libraries(
            [part for (name, _), part in zip(cases, measured, strict=True) if name == version]
        )
        for version in versions
    }

    tests = [(version, seed, libraries) for version in versions for seed in work.seeds]
    results = work.map("fleets", _test_fleet, tests)
    trials = [trial for fleet_trials, _ in results for trial in fleet_trials]
    study = StudyTable(
        study=STUDY,
        title="Library of changes: measured faults of other machines beside the pump prior",
        metrics=_METRICS,
        trials=tuple(trials),
        answer=(),
        settings={"versions": list(versions), "library": list(settings.library)},
        origin=results[0][1],
        notes=(
            "The pumps of a fleet and a design are adapted together. Recordings of the library "
            "are of other fleets, so all faults are of pumps that were not seen (L4).",
        ),
    )
    return replace(study, answer=_answer(study, versions))


def _record_fleet(version: str, seed: int) -> _Fleet:
    """Return recordings at two pressures, healthy ones and two of each fault and pressure."""
    faulty_size = SIZES["short"]
    n_speeds = len(VERSIONS[version].speeds)
    healthy_size = replace(faulty_size, repeats=n_speeds * (REFERENCES + TESTS))
    pairs = [
        pair
        for size, labels in ((healthy_size, CLASSES[:1]), (faulty_size, CLASSES[1:]))
        for pair in rig_recordings(
            seed, size, labels=labels, pressures=PRESSURES[::2], version=version
        )
    ]
    recordings = tuple(
        recording.replace(
            recording_id=f"{version}-{seed}-{recording.recording_id}",
            specimen=f"{version}-{seed}-{recording.specimen}",
        )
        for recording, _ in pairs
    )
    pump_of = {f"{version}-{seed}-{run.specimen.name}": run.specimen.pump for _, run in pairs}
    return _Fleet(recordings, pump_of)


def _by_design(fleet: _Fleet) -> list[tuple[Pump, list[Recording]]]:
    """Return the recordings of the machines of each piston count, with one of their pumps."""
    groups: dict[int, tuple[Pump, list[Recording]]] = {}
    for recording in fleet.recordings:
        pump = fleet.pump_of[str(recording.specimen)]
        _, members = groups.setdefault(pump.rotating_group.piston_count, (pump, []))
        members.append(recording)
    return [groups[count] for count in sorted(groups)]


def _measure_fleet(version: str, seed: int) -> ChangeLibrary:
    fleet = _record_fleet(version, seed)
    return join_libraries([measure_library(members, pump) for pump, members in _by_design(fleet)])


def _test_fleet(
    version: str, seed: int, libraries: Mapping[str, ChangeLibrary]
) -> tuple[list[Trial], str]:
    """Return the scores of a fleet with each library, and its origin."""
    fleet = _record_fleet(version, seed)
    like = libraries[version]
    candidates: dict[str, ChangeLibrary | None] = {
        ALONE: None,
        LIKE: like,
        ONE: ChangeLibrary(like.pumps[:1]),
    }
    candidates |= {of_version(name): libraries[name] for name in libraries if name != version}
    candidates[SHUFFLED] = _shuffle_faults(like, seed)
    candidates[EXCHANGED] = _exchange_faults(like)

    trials = []
    for name, candidate in candidates.items():
        factors = {"version": version, "library": name}
        trials.append(Trial(factors, seed, _score(fleet, version, candidate)))
    return trials, describe_origin(fleet.recordings)


def _relabel(
    library: ChangeLibrary, new_labels: Callable[[tuple[str, ...]], Sequence[str]]
) -> ChangeLibrary:
    pumps = [replace(pump, label=tuple(new_labels(pump.label))) for pump in library.pumps]
    return ChangeLibrary(tuple(pumps))


def _shuffle_faults(library: ChangeLibrary, seed: int) -> ChangeLibrary:
    """Return a library whose faults are drawn from those of each machine."""
    rng = random_stream(seed, "library", "shuffle")
    return _relabel(library, lambda labels: rng.permutation(labels).tolist())


def _exchange_faults(library: ChangeLibrary) -> ChangeLibrary:
    """Return a library in which each fault has the name of the next one, in all machines."""
    faults = CLASSES[1:]
    following = dict(zip(faults, (*faults[1:], faults[0]), strict=True))
    return _relabel(library, lambda labels: [following[label] for label in labels])


def _score(fleet: _Fleet, version: str, library: ChangeLibrary | None) -> dict[str, float]:
    """Return the scores of a fleet, adapted by design with a library."""
    prior = PriorClassifier.load(DESIGN)
    probabilities = []
    targets = []
    unknown = []
    weights = []
    machines = []
    for pump, members in _by_design(fleet):
        pistons = pump.rotating_group.piston_count if version in OTHER_DESIGNS else None
        references, tests = _split(members)
        if library is None:
            model = prior.fit(references, pistons=pistons)
            weights.append(0.0)
            machines.append(0)
        else:
            model, use = fit_with_library(prior, references, library, pistons=pistons)
            weights.append(use.weight)
            machines.append(use.n_pumps if use.weight else 0)

        for recording in tests:
            diagnosis = model.diagnose(recording)
            probabilities.append([diagnosis.probabilities[name] for name in CLASSES])
            targets.append(CLASSES.index(str(recording.label)))
            unknown.append(diagnosis.unknown)

    scores = recording_scores(
        np.array(probabilities), np.array(targets), CLASSES, np.array(unknown)
    )
    return {
        **scores,
        "recordings": float(len(targets)),
        "weight": float(np.mean(weights)),
        "machines": float(np.mean(machines)),
    }


def _split(recordings: Sequence[Recording]) -> tuple[list[Recording], list[Recording]]:
    """Return the healthy recordings to compare with, and the others, which test."""
    references: list[Recording] = []
    tests: list[Recording] = []
    counts: dict[tuple[object, ...], int] = {}
    for recording in recordings:
        assert recording.condition is not None
        point = (
            recording.specimen,
            recording.condition.speed,
            recording.condition.discharge_pressure,
        )
        if recording.label == CLASSES[0] and counts.get(point, 0) < REFERENCES:
            counts[point] = counts.get(point, 0) + 1
            references.append(recording)
        else:
            tests.append(recording)
    return references, tests


def _answer(study: StudyTable, versions: Sequence[str]) -> tuple[str, ...]:
    sentences = []
    for version in versions:
        parts = []
        for row in study.rows():
            if row["version"] == version:
                score = row["recording_balanced_accuracy"]["mean"]
                parts.append(f"{row['library']} {score:.3f}")
        sentences.append(f"Version {version}, balanced accuracy: {'; '.join(parts)}.")
    return tuple(sentences)
