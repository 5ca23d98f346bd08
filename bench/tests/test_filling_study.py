"""The study of filling: what its training sets hold, and that its ceilings know training pumps
only.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_case import FOREST

from swashtwin.calibration import GaussNewton
from swashtwin.foundation import InputError, MPa
from swashtwin.learning import WindowSet
from swashtwin.physics import OrderLines, Twin
from swashtwin.pump import SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.synthesis import twin_windows
from swashtwin_bench import Plan, Work, build_plan, rig_recordings, run_plan
from swashtwin_bench.results import naming
from swashtwin_bench.rigs.fleet import film_factors
from swashtwin_bench.rigs.measuring import Run, sensor_lines
from swashtwin_bench.rigs.writing import RigSize
from swashtwin_bench.studies import ceilings
from swashtwin_bench.studies.ceilings import (
    CEILINGS,
    PERFECT_MODEL,
    TRUE_VALUES,
    draw_training_pumps,
    without_gain,
)
from swashtwin_bench.studies.dataset import (
    StudyDataset,
    calibration_tasks,
    prepare_dataset,
    run_calibration,
)
from swashtwin_bench.studies.filling import CONTRASTS, EVERY_CLASS, EVERYWHERE, SOURCES
from swashtwin_bench.studies.plan import PlanSettings
from swashtwin_bench.studies.training_sets import (
    TrainingSet,
    build_twins,
    for_training,
    synthesize_for,
)

PRESSURES = (MPa(5), MPa(10), MPa(15))
N_SYNTHETIC = 6


def small_plan(**changes: Any) -> Plan:
    """Return the study with few windows, few trees and one pump held out."""
    plan = build_plan("filling")
    scenario = replace(
        plan.scenario,
        windows=2,
        synthetic=N_SYNTHETIC,
        held_out=1,
        method=GaussNewton(starts=1, max_iterations=1),
    )
    return replace(plan, scenario=scenario, models={"extra_trees": FOREST}, **changes)


@pytest.fixture(scope="module")
def dataset(recordings: list[Recording]) -> StudyDataset:
    """Two training pumps with calibrated twins; the recess was not measured at 15 MPa."""
    scenario = small_plan().scenario
    tasks = calibration_tasks(recordings, scenario, 0)
    return prepare_dataset(
        recordings, scenario, 0, [(task, run_calibration(task, None)) for task in tasks]
    )


@pytest.fixture(scope="module")
def filled(dataset: StudyDataset) -> Callable[[str, str], WindowSet]:
    """Return the windows of a source by ending of the training set, made once."""
    endings = {"": {}, EVERYWHERE: {"every_class": True, "every_pressure": True}}

    @cache
    def windows_of(source: str, ending: str) -> WindowSet:
        return synthesize_for(dataset, TrainingSet(source, **endings[ending]))

    return windows_of


def specimens_of(windows: WindowSet) -> set[str]:
    """Return the names of the pumps in brackets: "A" of "twin of 25scy14-1b (A)"."""
    return {name.partition("(")[2].rstrip(")") for name in windows.specimen.tolist()}


# ---- which cells are filled


@pytest.mark.nightly
@pytest.mark.parametrize("source", SOURCES)
def test_a_source_fills_the_missing_cell_alone(
    filled: Callable[[str, str], WindowSet], source: str
) -> None:
    windows = filled(source, "")
    assert windows.synthetic.all()
    assert windows.counts()["swash_plate", MPa(15)] == len(windows) == N_SYNTHETIC


@pytest.mark.nightly
@pytest.mark.parametrize("source", SOURCES)
def test_a_source_fills_every_class_at_every_pressure_alike(
    filled: Callable[[str, str], WindowSet], source: str
) -> None:
    counts = filled(source, EVERYWHERE).counts()
    assert {pressure for _, pressure in counts} == set(PRESSURES)
    assert set(counts.values()) == {N_SYNTHETIC}


@pytest.mark.nightly
def test_every_class_is_filled_at_the_pressure_of_the_missing_cell(dataset: StudyDataset) -> None:
    counts = synthesize_for(dataset, TrainingSet("nominal", every_class=True)).counts()
    assert counts == {(name, MPa(15)): N_SYNTHETIC for name in dataset.measured.classes}


@pytest.mark.nightly
@pytest.mark.parametrize("source", SOURCES)
def test_filling_further_cells_changes_no_window_of_the_missing_one(
    filled: Callable[[str, str], WindowSet], source: str
) -> None:
    # a difference between two training sets is then that of the further windows alone
    everywhere = filled(source, EVERYWHERE)
    is_missing = everywhere.label == "swash_plate"
    is_missing &= everywhere.cell_pressure == MPa(15)
    np.testing.assert_array_equal(everywhere.signal[is_missing], filled(source, "").signal)


@pytest.mark.nightly
def test_as_many_windows_as_measured_are_spread_over_the_cells(dataset: StudyDataset) -> None:
    alike = TrainingSet("nominal", every_class=True, as_many_as_measured=True)
    windows = synthesize_for(dataset, alike)
    n_measured = len(dataset.measured)
    assert n_measured - 5 < len(windows) <= n_measured
    assert len({windows.counts()[name, MPa(15)] for name in windows.classes}) == 1


@pytest.mark.nightly
def test_windows_of_few_twins_share_fault_and_values(
    dataset: StudyDataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    batches = []
    accelerations = twin_windows.accelerations

    def recorded(twins: list[Twin]) -> OrderLines:
        batches.append(twins)
        return accelerations(twins)

    monkeypatch.setattr(twin_windows, "accelerations", recorded)
    for assemblies, n_drawn in ((None, N_SYNTHETIC), (2, 2)):
        synthesize_for(dataset, TrainingSet("nominal", assemblies=assemblies))
        twins = batches.pop()
        assert len(twins) == N_SYNTHETIC
        assert len({repr(twin.fault) for twin in twins}) == n_drawn
        assert len({repr(twin.interfaces) for twin in twins}) == n_drawn
        # a pump is not reassembled for each operating point
        assert len({twin.condition.speed for twin in twins}) == N_SYNTHETIC


@pytest.mark.nightly
def test_lines_of_few_assemblies_share_fault_and_values(
    dataset: StudyDataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[Run] = []

    def recorded(run: Run) -> np.ndarray:
        runs.append(run)
        return sensor_lines(run)

    monkeypatch.setattr(ceilings, "sensor_lines", recorded)
    for assemblies, n_drawn in ((None, N_SYNTHETIC), (2, 2)):
        runs.clear()
        synthesize_for(dataset, TrainingSet(PERFECT_MODEL, assemblies=assemblies))
        assert len(runs) == N_SYNTHETIC
        assert len({repr(run.fault) for run in runs}) == n_drawn
        assert len({repr(run.specimen.values) for run in runs}) == n_drawn
        assert len({run.condition.speed for run in runs}) == N_SYNTHETIC


def test_windows_of_calibrated_twins_share_no_assembly() -> None:
    with pytest.raises(InputError, match="Windows of law do not share assemblies"):
        TrainingSet("law", assemblies=3)


def test_settings_that_came_later_leave_the_keys_of_earlier_runs_alone() -> None:
    # a finished run is found by a key that holds this description
    earlier = {"source", "every_class", "class_weights", "filler"}
    assert set(TrainingSet("nominal").describe({})) == earlier

    everywhere = TrainingSet("nominal", every_pressure=True)
    assert set(everywhere.describe({})) == {*earlier, "every_pressure"}


# ---- who makes the windows


@pytest.mark.nightly
def test_nominal_twins_without_gain_have_the_noise_of_those_with_it(
    dataset: StudyDataset, filled: Callable[[str, str], WindowSet]
) -> None:
    lender = without_gain(dataset.measured)
    healthy = dataset.measured.subset(dataset.measured.label == "normal")
    np.testing.assert_array_equal(lender.signal, healthy.signal)

    fitted = filled("nominal", "").signal
    unfitted = filled("no_gain", "").signal
    # they differ by the lines alone, which are the same but for one factor for each channel
    difference = (fitted - unfitted).astype(float)
    spectrum = np.abs(np.fft.rfft(difference, axis=2)).mean(axis=(0, 1))
    assert spectrum.max() > 20 * np.median(spectrum)


@pytest.mark.nightly
@pytest.mark.parametrize("source", CEILINGS)
def test_a_ceiling_knows_the_training_pumps_and_no_other(
    dataset: StudyDataset, filled: Callable[[str, str], WindowSet], source: str
) -> None:
    windows = filled(source, EVERYWHERE)
    assert specimens_of(windows) == set(dataset.measured.specimen.tolist())

    tested_pumps = set(dataset.tests["L4"].specimen.tolist())
    assert tested_pumps
    assert not tested_pumps & specimens_of(windows)


@pytest.mark.nightly
@pytest.mark.parametrize("source", SOURCES)
def test_no_test_recording_contributes_to_a_window(
    dataset: StudyDataset, filled: Callable[[str, str], WindowSet], source: str
) -> None:
    windows = filled(source, EVERYWHERE)
    contributors = set(windows.sources) | set(dataset.manifest)
    assert set(windows.manifest) <= set(dataset.measured.recording_id.tolist())
    for test in dataset.tests.values():
        assert not contributors & set(test.recording_id.tolist())


@pytest.mark.nightly
def test_windows_with_a_reference_are_relative_to_healthy_ones_of_the_same_twin(
    dataset: StudyDataset, filled: Callable[[str, str], WindowSet]
) -> None:
    scenario = replace(dataset.scenario, with_reference=True)
    compared = replace(dataset, scenario=scenario)
    everywhere = for_training(compared, TrainingSet("no_gain"), filled("no_gain", EVERYWHERE))
    healthy = everywhere.subset(everywhere.label == "normal")
    assert healthy.signal.var(axis=(1, 2)).mean() == pytest.approx(1, rel=0.2)

    # the missing cell alone is compared with healthy windows that are made for it
    alone = for_training(compared, TrainingSet("no_gain"), filled("no_gain", ""))
    at_pressure = everywhere.cell_pressure == MPa(15)
    in_cell = everywhere.subset((everywhere.label == "swash_plate") & at_pressure)
    np.testing.assert_allclose(alone.signal, in_cell.signal)
    assert alone.signal.var() > 1.2


@pytest.mark.nightly
def test_the_pumps_of_a_ceiling_are_those_that_were_measured(dataset: StudyDataset) -> None:
    size = RigSize(specimens=3, repeats=1, duration=0.1)
    runs = {
        str(recording.specimen): run
        for recording, run in rig_recordings(0, size, labels=("normal",), pressures=(MPa(15),))
    }
    pumps = draw_training_pumps(dataset)
    assert len(pumps) == 2
    for pump in pumps:
        measured = runs[pump.name].specimen
        assert pump.mount == measured.mount
        assert pump.clearances == measured.clearances


@pytest.mark.nightly
def test_true_twins_have_the_true_values_and_the_recess_of_the_pump(
    dataset: StudyDataset,
) -> None:
    twins, posteriors, laws = build_twins(dataset, TRUE_VALUES, "swash_plate", MPa(15))
    assert posteriors is laws is None
    for twin, pump in zip(twins, draw_training_pumps(dataset), strict=True):
        expected = pump.values * film_factors(MPa(15), 1.0)
        np.testing.assert_allclose(twin.values, expected)
        assert isinstance(twin.fault, SwashPlateDefect)
        assert twin.fault.corner == pump.following_cutoff
        assert twin.fault.gain == pump.following


@pytest.mark.nightly
def test_lines_of_the_rig_are_as_loud_as_its_recordings(
    dataset: StudyDataset, filled: Callable[[str, str], WindowSet]
) -> None:
    everywhere = filled(PERFECT_MODEL, EVERYWHERE)
    windows = everywhere.subset(everywhere.cell_pressure == MPa(15))
    for label in ("normal", "piston"):
        at_pressure = (dataset.measured.label == label) & (
            dataset.measured.discharge_pressure == MPa(15)
        )
        measured = dataset.measured.signal[at_pressure].std(axis=2).mean(axis=0)
        synthetic = windows.signal[windows.label == label].std(axis=2).mean(axis=0)
        # few windows of few assemblies, whose severities differ
        np.testing.assert_allclose(synthetic, measured, rtol=0.35)


# ---- the study


@pytest.mark.nightly
def test_the_study_compares_its_training_sets_and_is_resumed(
    recordings: list[Recording], tmp_path: Path
) -> None:
    training_sets = ("nominal", f"nominal{EVERY_CLASS}", f"{PERFECT_MODEL}{EVERYWHERE}")
    plan = small_plan().with_settings(PlanSettings(training_sets=training_sets))
    work = Work((0,), out=tmp_path)
    study = run_plan(plan, lambda seed: recordings, work)
    files = {path: path.stat().st_mtime_ns for path in tmp_path.glob("filling/*/result.json")}
    assert len(files) == 3

    # two training sets against nominal twins at L2 and L4; the third question is not asked
    differences = study.differences()
    assert [difference.metric for difference in differences] == ["recording_accuracy"] * 4
    text = " ".join(study.answer)
    assert "extra trees, L4: every class at this pressure minus the missing cell alone" in text
    assert "ceiling: the rig's own lines, every class and pressure" in text
    assert "virtual rig" in study.origin
    assert any("hidden truth" in note for note in study.notes)

    again = run_plan(plan, lambda seed: recordings, work)
    assert {path: path.stat().st_mtime_ns for path in files} == files
    assert again.rows() == study.rows()


def test_every_contrast_names_training_sets_of_the_study() -> None:
    names = set(build_plan("filling").training_sets)
    pairs = [pair for group in CONTRASTS.values() for pair in group]
    assert {name for pair in pairs for name in pair} == names


def test_every_training_set_has_a_label() -> None:
    assert set(build_plan("filling").training_sets) <= set(naming.TRAINING_SETS)


@pytest.mark.nightly
def test_ceilings_need_a_fleet_whose_truth_is_known(recordings: list[Recording]) -> None:
    with pytest.raises(InputError, match="its ceilings need the truth of the virtual rig"):
        run_plan(small_plan(), recordings)

    with pytest.raises(InputError, match="truth of version 1 of the rig, not of version 2"):
        build_plan("filling").with_settings(PlanSettings(rig="2"))

    # without ceilings the study runs on any version
    settings = PlanSettings(rig="2", training_sets=("nominal", f"nominal{EVERY_CLASS}"))
    assert build_plan("filling").with_settings(settings).rig == "2"
