"""Version 2 of the virtual rig: frozen, reproducible, unlike version 1 and unlike any twin."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError, MPa, rpm, um
from swashtwin.physics import excitation_lines
from swashtwin.pump import BoreDefect, OperatingCondition, PistonWear, Pump, SwashPlateDefect
from swashtwin.recordings import inspect_recordings, load_recordings
from swashtwin.signals import periodic_signal
from swashtwin_bench import build_rig, rig_recordings
from swashtwin_bench.results.runs import Work
from swashtwin_bench.rigs.measuring import Run, bore_force
from swashtwin_bench.rigs.version_two.fleet import SecondSpecimen, draw_fault, draw_specimen
from swashtwin_bench.rigs.version_two.sounds import bursts, list_impacts, loudness
from swashtwin_bench.rigs.writing import RigSize
from swashtwin_bench.studies.dataset import prepare_dataset
from swashtwin_bench.studies.runner import find_fleets, require_rig
from swashtwin_bench.studies.scenario import Scenario
from swashtwin_bench.studies.training_sets import build_twins

TINY = RigSize(specimens=1, repeats=1, duration=0.5)
GOLDEN_TRUTH = "fec418347757a29a8d52d4195e446416428e9462ae830f2bb9fe5d15d32d752c"
GOLDEN_LEVELS = {
    "A_normal_5MPa_1": (0.7365, 1.1059, 0.5665),
    "A_swash_plate_15MPa_1": (1.8326, 3.4822, 1.8803),
    "A_cylinder_block_10MPa_1": (1.4166, 1.9234, 1.2716),
    "A_piston_10MPa_1": (1.1889, 2.5909, 1.8912),
    "A_valve_plate_15MPa_1": (1.5237, 3.0779, 1.2326),
}


def truth_of(run: Run) -> str:
    """What was drawn for one run, to nine digits."""
    assert isinstance(run.specimen, SecondSpecimen)
    values = [*run.specimen.supports, *run.specimen.values, run.condition.discharge_pressure]
    fault = "none" if run.fault is None else f"{type(run.fault).__name__} {run.fault.severity:.9g}"
    return " ".join([f"{value:.9g}" for value in values] + [fault])


def test_version_two_is_frozen() -> None:
    """Draws and levels of one pump under seed 0. A failure shows what came out; another law is
    another version.
    """
    pairs = list(rig_recordings(0, TINY, version="2"))
    digest = hashlib.sha256("\n".join(truth_of(run) for _, run in pairs).encode()).hexdigest()
    levels = {
        r.recording_id: tuple(float(v) for v in r.signal.std(axis=1).round(4)) for r, _ in pairs
    }
    assert digest == GOLDEN_TRUTH
    for name, golden in GOLDEN_LEVELS.items():
        np.testing.assert_allclose(levels[name], golden, rtol=1e-3)


def test_speeds_take_turns_and_a_recording_states_what_was_set() -> None:
    pairs = list(rig_recordings(0, replace(TINY, repeats=2), labels=("normal",), version="2"))
    stated = {
        recording.condition.speed for recording, _ in pairs if recording.condition is not None
    }
    assert stated == {rpm(860), rpm(1120)}
    for recording, run in pairs:
        assert recording.condition is not None
        assert 0.99 < run.condition.speed / recording.condition.speed < 1
        assert recording.attributes["origin"].endswith("version 2")


def test_a_fleet_has_both_sensor_sets_and_both_kinds_of_assembly(pump: Pump) -> None:
    fleet = [draw_specimen(pump, name, 5) for name in "ABCDEF"]
    assert {specimen.sensors for specimen in fleet} == {"studs", "magnets"}
    assert {specimen.is_reassembled for specimen in fleet} == {True, False}
    supports = np.array([specimen.supports for specimen in fleet])
    assert 0.8 <= supports.min() < 0.9 < 1.1 < supports.max() <= 1.2
    assert np.ptp(supports, axis=1).min() > 0.1


def test_a_pump_that_is_not_reassembled_keeps_its_values_and_its_fault() -> None:
    size = RigSize(specimens=4, repeats=2, duration=0.1)
    runs: dict[str, list[Run]] = {}
    for _, run in rig_recordings(5, size, labels=("piston",), version="2"):
        runs.setdefault(run.specimen.name, []).append(run)
    for of_pump in runs.values():
        specimen = of_pump[0].specimen
        assert isinstance(specimen, SecondSpecimen)
        kinds = {(tuple(run.specimen.values), run.fault) for run in of_pump}
        assert len(kinds) == (len(of_pump) if specimen.is_reassembled else 1)


def test_no_bush_pulls_at_its_piston(pump: Pump, at_15: OperatingCondition) -> None:
    specimen, defect = draw_specimen(pump, "A", 0), BoreDefect(um(600))
    motion = excitation_lines(specimen.pump, at_15, defect, 300)
    lines = bore_force(Run(specimen, at_15, defect), defect, specimen.values, motion)
    missing = -periodic_signal(lines, 4096)
    side_load = (
        specimen.pump.rotating_group.piston_area
        * 15e6
        * np.tan(specimen.pump.rotating_group.swash_angle)
    )
    assert 0.9 * side_load < missing.max() < 1.15 * side_load  # the band's edge overshoots
    assert missing.min() < -0.1 * side_load
    assert abs(np.median(missing)) < 0.02 * side_load


def test_faults_strike_and_leak_where_they_are(pump: Pump, at_15: OperatingCondition) -> None:
    specimen = draw_specimen(pump, "A", 0)
    healthy = Run(specimen, at_15, None)
    worn, recess = (
        replace(healthy, fault=fault) for fault in (PistonWear(um(60), 3), SwashPlateDefect(7e-5))
    )
    assert len(list_impacts(recess, specimen)) == len(list_impacts(healthy, specimen)) + 1
    louder = loudness(worn, specimen) / loudness(healthy, specimen)
    assert louder.max() > 1.2
    assert louder.min() == pytest.approx(1, abs=1e-3)
    angle = at_15.speed * np.arange(25600) / 25600
    quiet, loud = (
        np.abs(bursts(run, specimen, angle, 25600.0, np.random.default_rng(0))).mean()
        for run in (healthy, recess)
    )
    assert loud > 1.05 * quiet


def test_the_deep_version_has_the_papers_recess() -> None:
    fault = draw_fault("swash_plate", "A", 0, "A_swash_plate", is_deep=True)
    assert isinstance(fault, SwashPlateDefect)
    assert (fault.depth, fault.length, fault.width) == pytest.approx((0.6e-3, 0.030, 0.024))
    shallow = draw_fault("swash_plate", "A", 0, "A_swash_plate")
    assert shallow is not None
    assert shallow.severity < 0.3e-3


def test_twins_fill_a_scarce_cell_at_each_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swashtwin_bench.rigs.writing.PRESSURES", (MPa(15),))
    recordings = [
        r for r, _ in rig_recordings(0, RigSize(specimens=3, repeats=3, duration=0.4), version="2")
    ]
    dataset = prepare_dataset(recordings, Scenario(windows=2, scarce_windows=2, held_out=1), 0, [])
    assert [condition.speed for condition in dataset.conditions()] == pytest.approx(
        [rpm(860), rpm(1120)]
    )
    twins, _, _ = build_twins(dataset, "nominal", "valve_plate")
    assert len(twins) == 4


def test_a_fleet_of_version_two_lies_under_a_name_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = {"small": replace(TINY, duration=1.0)}
    for name in ("rigs.writing", "studies.runner"):
        monkeypatch.setattr(f"swashtwin_bench.{name}.SIZES", small)
    recordings = find_fleets(tmp_path, "small", "2", Work())(7)
    assert (tmp_path / "rig2-small-7" / "recordings.toml").is_file()
    report = inspect_recordings(load_recordings(tmp_path / "rig2-small-7"))
    assert not report.has_errors
    truth = json.loads((tmp_path / "rig2-small-7-truth.json").read_text())
    assert truth["rig_version"] == "2"
    assert len(truth["specimens"]["A"]["supports"]) == 7
    with pytest.raises(DataError, match="other recordings"):
        require_rig(tmp_path, recordings, small["small"])
    with pytest.raises(InputError, match="must be one of 1, 1-deep, 2, 2-deep"):
        build_rig(tmp_path / "new", seed=0, version="4")
