"""Version 3 of the virtual rig: frozen, reproducible, and each of its faults acts where physics
says.
"""

import hashlib
from collections import Counter

import numpy as np
import pytest

from swashtwin.foundation import InputError, MPa, rpm
from swashtwin.pump import CLASSES, OperatingCondition, Pump
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
    """Draws and levels of one pump under seed 0. A failure shows what came out; another law is
    another version.
    """
    pairs = list(rig_recordings(0, TINY, version="3"))
    drawn = [
        [*run.specimen.values, run.condition.speed, run.fault.severity if run.fault else 0]
        for _, run in pairs
    ]
    truth = " ".join(f"{value:.9g}" for value in np.ravel(drawn))
    levels = {
        r.recording_id: tuple(float(v) for v in r.signal.std(axis=1).round(3)) for r, _ in pairs
    }
    assert hashlib.sha256(truth.encode()).hexdigest() == GOLDEN_TRUTH
    for name, golden in GOLDEN_LEVELS.items():
        np.testing.assert_allclose(levels[name], golden, rtol=2e-3)


def test_a_fleet_has_three_pumps_of_each_design_and_no_two_are_equal(pump: Pump) -> None:
    fleet = [draw_specimen(pump, name, 5) for name in "ABCDEF"]
    assert Counter(one.pump.rotating_group.piston_count for one in fleet) == {7: 3, 9: 3}
    for one in fleet:
        displaced = len(one.clearances) * one.design.area * 2 * one.design.lift
        assert displaced == pytest.approx(one.design.nameplate.displacement, rel=0.02)
    for name in ("values", "rigid", "drives", "shifts", "foreign", "mounting"):
        assert len({getattr(one, name).tobytes() for one in fleet}) == 6


def test_recordings_are_of_the_classes_speeds_and_sizes_asked_for() -> None:
    pairs = list(
        rig_recordings(0, RigSize(1, 2, 0.1), labels=LABELS, pressures=(MPa(5),), version="3")
    )
    assert Counter(recording.label for recording, _ in pairs) == dict.fromkeys(LABELS, 2)
    for recording, run in pairs:
        assert recording.signal.shape == (3, 2560)
        assert recording.condition
        assert recording.condition.speed in (rpm(1000), rpm(1450))
        assert 0.98 < run.condition.speed / recording.condition.speed < 1
        assert recording.label == ("normal" if run.fault is None else run.fault.label)
    second = next(
        run.fault.second for _, run in pairs if isinstance(run.fault, Damage) and run.fault.second
    )
    assert second.label in CLASSES
    with pytest.raises(InputError, match="Invalid class 'loose_slipper' for version 2 of the rig"):
        list(rig_recordings(0, TINY, labels=("loose_slipper",), version="2"))


def test_a_course_of_version_three_grows_its_fault() -> None:
    course = PlantCourse(
        recordings=3, kind="scuffed", onset=1, severity=2.0, duration=0.1, version="3"
    )
    pairs = list(plant_course(100, "A", course))
    assert [(one.label, severity) for one, severity in pairs] == [
        ("normal", 0),
        ("piston", 1),
        ("piston", 2),
    ]


def run_with(pump: Pump, fault: Damage | None) -> Run:
    return Run(draw_specimen(pump, "A", 0), OperatingCondition(rpm(1450), MPa(10)), fault)


@pytest.mark.parametrize("mode", TRENDS)
def test_a_fault_of_severity_zero_is_a_healthy_pump(pump: Pump, mode: str) -> None:
    runs = [
        run_with(pump, None),
        run_with(pump, Damage(0.0, mode, piston=1)),
        run_with(pump, Damage(1.5, mode)),
    ]
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
"""What a fault raises: a power lost in the oil, or the sharpness of a path's noise."""
ONCE_A_TURN = {"bore": "rotor_y", "face": "cover_z", "scuffed": "cover_z", "loose": "swash_z"}
EACH_PASS = dict.fromkeys(("scratch", "erosion", "wear", "cavitation"), "cover_z")
EACH_PASS |= {"recess": "swash_z", "scoring": "swash_z"}
"""Path on which the faults of one piston, or of all, add a force, and its rhythm."""


def heard(pump: Pump, fault: Damage | None) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Force lines of each path by order, and levels by the names of `LOUDER`, of a pump with that
    fault.
    """
    run, specimen = run_with(pump, fault), draw_specimen(pump, "A", 0)
    oil, steps = solve_oil(run, specimen), 2100
    angle, rate = 2 * np.pi * np.arange(9 * steps) / steps, steps * run.condition.shaft_frequency
    forces = contact_paths(run, specimen, oil, angle, rate)[:, -steps:]
    sounds = draw_sounds(run, specimen, oil, angle, rate, np.random.default_rng(0))
    levels = dict(zip(PATHS, (sounds**4).mean(axis=1) ** 0.25, strict=True))
    return dict(zip(PATHS, np.fft.rfft(forces), strict=True)), levels | {
        "seepage": oil.seepage.mean(),
        "jets": oil.jets.mean(),
    }


def test_each_fault_changes_what_physics_says(pump: Pump) -> None:
    """Of a pump with nine pistons: one piston's fault shows at all orders, one that all pass at 9,
    18, 27, ...
    """
    lines, levels = heard(pump, None)
    assert LOUDER.keys() | ONCE_A_TURN.keys() | EACH_PASS.keys() == TRENDS.keys()
    for mode in TRENDS:
        faulty_lines, faulty_levels = heard(pump, TRENDS[mode])
        if mode in LOUDER:
            assert faulty_levels[LOUDER[mode]] > 1.15 * levels[LOUDER[mode]], mode
        if path := (ONCE_A_TURN | EACH_PASS).get(mode):
            power = np.abs(faulty_lines[path] - lines[path])[1:400] ** 2
            assert power.sum() > 5e-6 * (np.abs(lines[path][1:]) ** 2).sum(), mode
            assert (power[8::9].sum() > 0.85 * power.sum()) == (mode in EACH_PASS), mode
