"""Version 3 of the virtual rig: frozen, reproducible, and each fault acts where physics says."""

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pytest

from swashtwin.foundation import InputError, MPa, rpm
from swashtwin.pump import CLASSES, OperatingCondition, Pump
from swashtwin.recordings import Recording
from swashtwin_bench import rig_recordings
from swashtwin_bench.rigs.courses import PlantCourse, plant_course, typical_faults
from swashtwin_bench.rigs.measuring import Run
from swashtwin_bench.rigs.version_three.fleet import LABELS, PATHS, Damage, draw_specimen
from swashtwin_bench.rigs.version_three.machine import solve_oil
from swashtwin_bench.rigs.version_three.measuring import contact_paths, draw_sounds, measure
from swashtwin_bench.rigs.writing import RigSize

TINY = RigSize(specimens=1, repeats=1, duration=0.5)
TRENDS = typical_faults("3")
GOLDEN_TRUTH = "4f974122d5e36e6b71dfcb17ee00ccd0bb6145e2d56bbf53d4c3dc5133f69a44"
GOLDEN_LEVELS = {
    "A_normal_5MPa_1": (13.83, 8.784, 12.626),
    "A_swash_plate_15MPa_1": (31.177, 23.069, 18.896),
    "A_cylinder_block_10MPa_1": (20.395, 15.351, 11.418),
    "A_piston_10MPa_1": (23.066, 14.159, 20.123),
    "A_valve_plate_15MPa_1": (24.26, 23.628, 15.298),
}


def test_version_three_is_frozen() -> None:
    """Draws and levels of one pump under seed 0 are the pinned ones.

    A failure shows the new values; another law is another version.
    """
    pairs = list(rig_recordings(0, TINY, version="3"))

    truths: list[float] = []
    for _, run in pairs:
        severity = run.fault.severity if run.fault else 0
        truths += [*run.specimen.values, run.condition.speed, severity]
    text = " ".join(f"{value:.9g}" for value in truths)
    assert hashlib.sha256(text.encode()).hexdigest() == GOLDEN_TRUTH

    levels = {
        recording.recording_id: recording.signal.std(axis=1).round(3) for recording, _ in pairs
    }
    for name, golden in GOLDEN_LEVELS.items():
        np.testing.assert_allclose(levels[name], golden, rtol=2e-3)


# ---- fleets and recordings


def test_a_fleet_has_three_pumps_of_each_design(pump: Pump) -> None:
    fleet = [draw_specimen(pump, name, 5) for name in "ABCDEF"]
    counts = Counter(specimen.pump.rotating_group.piston_count for specimen in fleet)
    assert counts == {7: 3, 9: 3}

    for specimen in fleet:
        design = specimen.design
        displacement = len(specimen.clearances) * design.area * 2 * design.lift
        assert displacement == pytest.approx(design.nameplate.displacement, rel=0.02)


def test_no_two_pumps_of_a_fleet_are_equal(pump: Pump) -> None:
    fleet = [draw_specimen(pump, name, 5) for name in "ABCDEF"]
    for name in ("values", "rigid", "drives", "shifts", "foreign", "mounting"):
        assert len({getattr(specimen, name).tobytes() for specimen in fleet}) == 6


@pytest.fixture(scope="module")
def of_all_classes() -> list[tuple[Recording, Run]]:
    """Two recordings of 0.1 s of each class, at 5 MPa."""
    size = RigSize(specimens=1, repeats=2, duration=0.1)
    return list(rig_recordings(0, size, labels=LABELS, pressures=(MPa(5),), version="3"))


def test_recordings_are_of_the_requested_classes_speeds_and_sizes(
    of_all_classes: list[tuple[Recording, Run]],
) -> None:
    counts = Counter(recording.label for recording, _ in of_all_classes)
    assert counts == dict.fromkeys(LABELS, 2)

    for recording, run in of_all_classes:
        assert recording.signal.shape == (3, 2560)
        assert recording.condition
        assert recording.condition.speed in (rpm(1000), rpm(1450))
        # the motor slips
        assert 0.98 < run.condition.speed / recording.condition.speed < 1
        assert recording.label == ("normal" if run.fault is None else run.fault.label)


def test_a_compound_has_a_second_fault_of_the_papers_classes(
    of_all_classes: list[tuple[Recording, Run]],
) -> None:
    faults = [run.fault for _, run in of_all_classes]
    compound = next(fault for fault in faults if isinstance(fault, Damage) and fault.second)
    assert compound.second
    assert compound.second.label in CLASSES


def test_other_versions_refuse_the_further_classes() -> None:
    with pytest.raises(InputError, match="Invalid class 'loose_slipper' for version 2 of the rig"):
        list(rig_recordings(0, TINY, labels=("loose_slipper",), version="2"))


def test_a_course_of_version_three_grows_its_fault() -> None:
    course = PlantCourse(
        recordings=3, kind="scuffed", onset=1, severity=2.0, duration=0.1, version="3"
    )
    pairs = plant_course(100, "A", course)
    labels_and_severities = [(recording.label, severity) for recording, severity in pairs]
    assert labels_and_severities == [("normal", 0), ("piston", 1), ("piston", 2)]


# ---- what each fault changes


def run_with(pump: Pump, fault: Damage | None) -> Run:
    return Run(draw_specimen(pump, "A", 0), OperatingCondition(rpm(1450), MPa(10)), fault)


@pytest.mark.parametrize("mode", TRENDS)
def test_a_fault_of_severity_zero_is_a_healthy_pump(pump: Pump, mode: str) -> None:
    runs = [
        run_with(pump, None),
        run_with(pump, Damage(0.0, mode, piston=1)),
        run_with(pump, Damage(1.5, mode)),
    ]
    # one name for all three, so that they share their random numbers
    healthy, zero, faulty = measure(runs, 0.1, 25600.0, [(0, "one")] * 3)
    np.testing.assert_array_equal(zero, healthy)
    assert np.abs(faulty - healthy).max() > 0.1


LOUDER = {
    "recess": "seepage",
    "scoring": "swash_z",
    "face": "seepage",
    "scuffed": "rotor_y",
    "scratch": "jets",
    "erosion": "jets",
    "wear": "seepage",
    "race": "rotor_y",
    "cavitation": "cover_z",
}
"""Level that a fault raises: a power lost in the oil, or the sharpness of a path's noise."""

ONCE_A_TURN = {
    "bore": "rotor_y",
    "face": "cover_z",
    "scuffed": "cover_z",
    "loose": "swash_z",
}
"""Path on which a fault of one piston adds a force."""

EACH_PASS = {
    "scratch": "cover_z",
    "erosion": "cover_z",
    "wear": "cover_z",
    "cavitation": "cover_z",
    "recess": "swash_z",
    "scoring": "swash_z",
}
"""Path on which a fault that all pistons pass adds a force."""

FORCED_PATHS = ONCE_A_TURN | EACH_PASS


@dataclass(frozen=True, eq=False)
class Effects:
    """What the housing receives from a pump."""

    force_lines: Mapping[str, np.ndarray]
    """Force lines of each path by order."""
    levels: Mapping[str, float]
    """Levels by the names in `LOUDER`."""


def effects_of(pump: Pump, fault: Damage | None) -> Effects:
    run = run_with(pump, fault)
    specimen = draw_specimen(pump, "A", 0)
    oil = solve_oil(run, specimen)

    steps = 2100
    angle = 2 * np.pi * np.arange(9 * steps) / steps
    rate = steps * run.condition.shaft_frequency
    # contacts are stepped in time: the last of nine revolutions is free of their start
    forces = contact_paths(run, specimen, oil, angle, rate)[:, -steps:]
    sounds = draw_sounds(run, specimen, oil, angle, rate, np.random.default_rng(0))

    # the fourth power weighs short bursts more than steady noise
    sharpness = (sounds**4).mean(axis=1) ** 0.25
    levels = dict(zip(PATHS, sharpness, strict=True))
    levels |= {"seepage": oil.seepage.mean(), "jets": oil.jets.mean()}
    return Effects(dict(zip(PATHS, np.fft.rfft(forces), strict=True)), levels)


@pytest.fixture(scope="module")
def healthy(pump: Pump) -> Effects:
    return effects_of(pump, None)


def test_each_fault_has_an_expected_effect() -> None:
    assert LOUDER.keys() | FORCED_PATHS.keys() == TRENDS.keys()


@pytest.mark.parametrize("mode", TRENDS)
def test_each_fault_changes_what_physics_says(pump: Pump, healthy: Effects, mode: str) -> None:
    """In a pump with nine pistons, the fault of one piston shows at all orders.

    A fault that all pistons pass shows at orders 9, 18, 27, ...
    """
    faulty = effects_of(pump, TRENDS[mode])

    if mode in LOUDER:
        name = LOUDER[mode]
        assert faulty.levels[name] > 1.15 * healthy.levels[name]

    if mode in FORCED_PATHS:
        path = FORCED_PATHS[mode]
        lines = healthy.force_lines[path]
        change = np.abs(faulty.force_lines[path] - lines)[1:400] ** 2
        assert change.sum() > 5e-6 * (np.abs(lines[1:]) ** 2).sum()

        at_piston_orders = change[8::9].sum()
        assert (at_piston_orders > 0.85 * change.sum()) == (mode in EACH_PASS)
