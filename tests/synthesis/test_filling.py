"""Filling: which cells are short, what a plan adds, and that only training recordings decide."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from twin_recordings import SIX_VALUES

from swashtwin.calibration import Calibration, GaussNewton, calibrate
from swashtwin.diagnosis import FaultClassifier
from swashtwin.foundation import InputError, MPa, mm, um
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.learning.windows.splitting import fold_training_rows
from swashtwin.pump import DamScratch, GrooveErosion, PistonWear, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.synthesis import FILLS, Filling, FillingPlan
from swashtwin_bench import rig_recordings
from swashtwin_bench.rigs.writing import RigSize

PUMP = "25scy14-1b"
LABELS = ("normal", "swash_plate", "piston")
PRESSURES = (MPa(10), MPa(15))


@pytest.fixture(scope="module")
def recordings() -> list[Recording]:
    """Two recordings of each of three classes at two pressures, of each of two pumps."""
    pairs = rig_recordings(0, RigSize(2, 2, 1.2), labels=LABELS, pressures=PRESSURES)
    return [recording for recording, _ in pairs]


def is_in_gap(recording: Recording) -> bool:
    """Return whether a recording shows the recess at 15 MPa."""
    assert recording.condition is not None
    return (
        recording.label == "swash_plate" and recording.condition.discharge_pressure == PRESSURES[1]
    )


@pytest.fixture(scope="module")
def measured(recordings: list[Recording]) -> WindowSet:
    """Windows of all recordings but those of the recess at 15 MPa."""
    known = [recording for recording in recordings if not is_in_gap(recording)]
    return cut_windows(known, length=2048, classes=LABELS)


@pytest.fixture(scope="module")
def calibration(recordings: list[Recording]) -> Calibration:
    """Twin of pump A, from one of its healthy recordings at each pressure."""
    healthy = [
        recording
        for recording in recordings
        if recording.label == "normal" and recording.recording_id.endswith("_1")
    ]
    of_a = [recording for recording in healthy if recording.specimen == "A"]
    method = GaussNewton(starts=1, max_iterations=2)
    return calibrate(PUMP, of_a, method=method, explain_misfit=False, **SIX_VALUES)


def counts_of(plan: FillingPlan) -> dict[tuple[str, float], int]:
    """Return the planned windows by class and pressure."""
    return {(cell.label, cell.pressure): cell.count for cell in plan.cells}


@pytest.mark.parametrize(
    ("fill", "filled"),
    [
        ("cells", {("swash_plate", MPa(15))}),
        ("points", {(label, MPa(15)) for label in LABELS}),
        ("all", {(label, pressure) for label in LABELS for pressure in PRESSURES}),
    ],
)
def test_a_plan_fills_the_short_cells_or_every_class_alike(
    measured: WindowSet, fill: Any, filled: set[tuple[str, float]]
) -> None:
    plan = Filling(PUMP, fill=fill, count=5).plan(measured)

    assert [cell.label for cell in plan.cells if cell.is_short] == ["swash_plate"]
    assert counts_of(plan) == {
        (label, pressure): 5 * ((label, pressure) in filled)
        for label in LABELS
        for pressure in PRESSURES
    }
    assert plan.count == 5 * len(filled)


def test_every_class_at_the_short_points_is_the_default(measured: WindowSet) -> None:
    assert Filling(PUMP).plan(measured).cells == Filling(PUMP, fill="points").plan(measured).cells


@pytest.mark.parametrize(("kept", "is_short"), [(1, True), (2, False)])
def test_a_cell_with_less_than_half_of_the_median_is_short(
    measured: WindowSet, kept: int, is_short: bool
) -> None:
    # the other cells have four recordings
    in_cell = (measured.label == "piston") & (measured.discharge_pressure == MPa(10))
    names = np.unique(measured.recording_id[in_cell])[:kept]
    few = measured.subset(~in_cell | np.isin(measured.recording_id, names))

    cells = Filling(PUMP).plan(few).cells
    (cell,) = [cell for cell in cells if (cell.label, cell.pressure) == ("piston", MPa(10))]
    assert (cell.n_recordings, cell.is_short) == (kept, is_short)


def test_the_windows_are_those_of_the_plan(measured: WindowSet, calibration: Calibration) -> None:
    plan = Filling([calibration, PUMP], count=4).plan(measured)
    progress: list[tuple[int, int]] = []
    windows = plan.simulate(lambda count, total: progress.append((count, total)))

    assert windows.synthetic.all()
    assert windows.counts() == {(label, MPa(15)): 4 for label in LABELS}
    assert progress == [(4, 12), (8, 12), (12, 12)]
    assert len(set(windows.recording_id)) == 12
    # what lent its noise or was calibrated on may not be tested on
    assert {*measured.recordings, *calibration.recording_ids} <= set(windows.manifest)
    assert len(measured + windows) == len(measured) + 12

    assert plan.twins_of(plan.filled[0]) == {"A": 2, f"nominal {PUMP}": 2}
    assert f"A (2), nominal {PUMP} (2)" in str(plan)


def test_a_calibration_simulates_its_own_fault_with_its_own_law(
    measured: WindowSet, calibration: Calibration
) -> None:
    # depth times C_sw is identified: the depth of one does not fit the other's C_sw
    shallow, deep = (SwashPlateDefect(depth=mm(depth)) for depth in (0.05, 0.2))
    with_shallow = replace(calibration, twin=calibration.twin.with_fault(shallow))
    with_deep = replace(calibration, twin=calibration.twin.with_fault(deep))

    def turns_of(sources: list[Any], **arguments: Any) -> list[tuple[int, object]]:
        plan = Filling(sources, count=4, **arguments).plan(measured)
        (cell, *_) = [cell for cell in plan.filled if cell.label == "swash_plate"]
        assert sum(plan.twins_of(cell).values()) == 4
        return plan.turns_of(cell)

    assert turns_of([with_shallow, with_deep]) == [(0, shallow), (1, deep)]

    # a twin without a fault of the class has those of the others in turns, and as many windows
    assert turns_of([with_shallow, with_deep, PUMP]) == [
        *((0, shallow), (1, deep), (2, shallow)),
        *((0, shallow), (1, deep), (2, deep)),
    ]
    of_healthy = turns_of([with_shallow, calibration])
    assert of_healthy == [(0, shallow), (1, shallow)]

    # what the user specifies holds for every twin
    specified = turns_of([with_shallow, with_deep], fault_of={"swash_plate": [deep]})
    assert specified == [(0, deep), (1, deep)]


def test_a_fold_without_a_machine_has_no_window_of_its_twin(
    measured: WindowSet, calibration: Calibration
) -> None:
    both = measured + Filling([calibration, PUMP], count=2).plan(measured).simulate()
    is_of_a = both.specimen == "A"

    rows = fold_training_rows(both.target, both.specimen, both.synthetic, np.flatnonzero(is_of_a))

    assert set(both.specimen[rows].tolist()) == {"B", f"twin of {PUMP}"}


def test_the_windows_of_a_cell_do_not_depend_on_what_else_is_filled(measured: WindowSet) -> None:
    def recess_windows(fill: Any) -> np.ndarray:
        windows = Filling(PUMP, fill=fill, count=2).plan(measured).simulate()
        in_gap = (windows.label == "swash_plate") & (windows.cell_pressure == MPa(15))
        return windows.signal[in_gap]

    alone = recess_windows("cells")
    assert len(alone) == 2
    np.testing.assert_array_equal(recess_windows("points"), alone)


def test_windows_have_the_name_of_the_measured_class(measured: WindowSet) -> None:
    worn = replace(measured, classes=("healthy", "Schaden X", "piston"))

    plan = Filling(PUMP).plan(worn)
    assert plan.count == 0
    assert "The twins simulate no fault called Schaden X" in plan.notes[0]
    assert "fault_of" in plan.notes[0]

    fault_of = {"Schaden X": SwashPlateDefect(depth=mm(0.07))}
    plan = Filling(PUMP, fault_of=fault_of, count=2).plan(worn)
    assert "swash_plate, depth 70 um" in str(plan)
    windows = plan.simulate()
    assert windows.classes == worn.classes
    assert windows.counts() == {(label, MPa(15)): 2 for label in worn.classes}


def test_a_class_that_nobody_recorded_is_filled_at_every_point(measured: WindowSet) -> None:
    fault_of = {"valve_plate": [DamScratch(area=0.8e-6), GrooveErosion(advance=0.09)]}
    plan = Filling(PUMP, fault_of=fault_of, count=2, fill="cells").plan(measured)

    counts = counts_of(plan)
    assert [counts["valve_plate", pressure] for pressure in PRESSURES] == [2, 2]
    assert any("No recording has the class valve_plate" in note for note in plan.notes)
    windows = plan.simulate()
    assert windows.classes == (*LABELS, "valve_plate")
    assert windows.counts()["valve_plate", MPa(10)] == 2


def test_faults_come_from_the_settings_a_calibration_or_the_name_of_the_class(
    measured: WindowSet, calibration: Calibration
) -> None:
    def piston_of(source: Any, **arguments: Any) -> tuple[object, bool]:
        plan = Filling(source, **arguments).plan(measured)
        (cell, *_) = [cell for cell in plan.filled if cell.label == "piston"]
        is_noted = any("piston" in note and "typical values" in note for note in plan.notes)
        return cell.faults, is_noted

    worn = PistonWear(clearance=um(90))
    assert piston_of(PUMP) == ((PistonWear(clearance=um(40)),), True)
    assert piston_of(PUMP, fault_of={"piston": worn}) == ((worn,), False)
    of_worn_pump = replace(calibration, twin=calibration.twin.with_fault(worn))
    assert piston_of(of_worn_pump) == ((worn,), False)
    less_worn = PistonWear(clearance=um(50))
    of_other = replace(calibration, twin=calibration.twin.with_fault(less_worn))
    assert piston_of([of_worn_pump, of_other]) == ((worn, less_worn), False)

    # also if the recordings name the part otherwise
    in_german = replace(measured, classes=("normal", "swash_plate", "Kolbenverschleiss"))
    cells = Filling(of_worn_pump).plan(in_german).filled
    assert [cell.faults for cell in cells if cell.label == "Kolbenverschleiss"] == [(worn,)]


def test_what_limits_the_windows_is_noted(measured: WindowSet, calibration: Calibration) -> None:
    notes = Filling(calibration).plan(measured).notes
    assert any("No twin was calibrated on B" in note for note in notes)

    unknown = measured.discharge_pressure.copy()
    unknown[measured.recording_id == measured.recording_id[0]] = np.nan
    notes = Filling(PUMP).plan(replace(measured, discharge_pressure=unknown)).notes
    assert any("1 recording without speed or pressure" in note for note in notes)

    is_healthy_at_15 = (measured.label == "normal") & (measured.discharge_pressure == MPa(15))
    notes = Filling(PUMP, fill="all").plan(measured.subset(~is_healthy_at_15)).notes
    assert any("No healthy recording at 860 rpm, 15 MPa" in note for note in notes)


def test_nothing_is_filled_if_no_cell_is_short(recordings: list[Recording]) -> None:
    plan = Filling(PUMP).plan(recordings, window=2048)
    assert plan.count == 0
    assert "No cell is short" in plan.notes[0]
    assert len(plan.simulate()) == 0


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        pytest.param(
            {"fill": "some"},
            "must be one of cells, points, all",
            marks=pytest.mark.wrong_types,
            id="fill",
        ),
        pytest.param({"count": 0}, "at least 1", id="count"),
        pytest.param({"twins": ()}, "There is no twin to fill with", id="no twin"),
        pytest.param(
            {"twins": [3]}, "twins holds a int", marks=pytest.mark.wrong_types, id="not a twin"
        ),
    ],
)
def test_an_invalid_filling_is_refused(arguments: dict[str, Any], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        Filling(**{"twins": PUMP, **arguments})


@pytest.mark.parametrize(
    ("faults", "reason"),
    [
        pytest.param(
            3,
            "stands for 3, which is not a fault",
            marks=pytest.mark.wrong_types,
            id="a number",
        ),
        pytest.param("normal", "not a fault. Label healthy recordings normal", id="healthy"),
        pytest.param(("piston", "swash_plate"), "faults of one part, not for piston and", id="two"),
        pytest.param((), "not for no fault", id="none"),
    ],
)
def test_an_invalid_fault_is_refused(measured: WindowSet, faults: Any, reason: str) -> None:
    given = [faults] if isinstance(faults, int) else faults
    with pytest.raises(InputError, match=reason):
        Filling(PUMP, fault_of={"piston": given}).plan(measured)


def test_recordings_without_an_operating_point_cannot_be_filled(measured: WindowSet) -> None:
    unknown = replace(measured, speed=np.full(len(measured), np.nan))
    with pytest.raises(InputError, match="No recording specifies both speed and discharge"):
        Filling(PUMP).plan(unknown)


def test_the_twin_of_another_pump_is_refused(recordings: list[Recording]) -> None:
    nine = [replace(recording, attributes={"pistons": "9"}) for recording in recordings]
    filling = Filling(PUMP)
    with pytest.raises(InputError, match="is of a pump with 9 pistons"):
        filling.plan(nine)
    with pytest.raises(InputError, match="is of a pump with 9 pistons"):
        FaultClassifier().fit(nine, synthetic=filling)


def test_every_way_to_fill_is_documented() -> None:
    assert all(f'``"{name}"``' in str(Filling.__doc__) for name in FILLS)


def test_a_training_fills_from_the_recordings_that_are_not_held_out(
    recordings: list[Recording], calibration: Calibration
) -> None:
    known = [recording for recording in recordings if not is_in_gap(recording)]
    classifier = FaultClassifier(
        "extra_trees", network_settings={"trees": 5}, window=2048, test_fraction=0.4
    )
    classifier.fit(known, synthetic=Filling(calibration, count=3))

    held_out = set(classifier.held_out_)
    assert held_out
    # the twin's recordings are trained on, and no held-out recording had a part in a window
    assert not held_out & set(calibration.recording_ids)
    assert set(calibration.recording_ids) <= set(classifier.manifest)
    assert not held_out & set(classifier.manifest)
    assert classifier.n_synthetic_ >= 9
    assert any("Filling (points)" in note for note in classifier.notes_)
    tested = [recording for recording in known if recording.recording_id in held_out]
    assert 0 <= classifier.score(tested) <= 1
