"""The virtual rig: frozen, reproducible, different from the twin, and silent about its truth."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import InputError, MPa
from swashtwin.physics import LoadCase, Twin, force_lines
from swashtwin.pump import (
    CLASSES,
    Interfaces,
    OperatingCondition,
    Pump,
    SwashPlateDefect,
    load_pump,
)
from swashtwin.recordings import inspect_recordings, load_recordings
from swashtwin.signals import order_spectrum
from swashtwin_bench import SIZES, build_rig, rig_recordings
from swashtwin_bench.rigs.fleet import draw_specimen, film_factors
from swashtwin_bench.rigs.measuring import Run, shaft_angle, shell_lines, slipper_loading
from swashtwin_bench.rigs.writing import DEEP_VERSION, RIG_VERSION, RigSize

TINY = RigSize(specimens=1, repeats=1, duration=0.5)
LONGER = RigSize(specimens=1, repeats=1, duration=1.2)

GOLDEN_TRUTH = "5033b6f9914597763fecf8e1e73653e87c4063f336eab5e3c89a9bd0ad8671cc"
GOLDEN_LEVELS = {
    "A_normal_5MPa_1": (0.7099, 0.3954, 0.1583),
    "A_swash_plate_15MPa_1": (1.222, 1.331, 0.3823),
    "A_piston_10MPa_1": (0.9849, 0.6765, 0.1931),
    "A_valve_plate_15MPa_1": (1.9126, 0.8325, 0.3063),
}


def truth_of(run: Run) -> str:
    """What was drawn for one run, to nine digits."""
    values = [
        run.specimen.mount,
        run.specimen.bearing,
        *run.specimen.values,
        run.condition.discharge_pressure,
    ]
    fault = "none" if run.fault is None else f"{type(run.fault).__name__} {run.fault.severity:.9g}"
    return " ".join([f"{value:.9g}" for value in values] + [fault])


def test_the_rig_is_frozen() -> None:
    """Draws and levels of one pump under seed 0, pinned at rig version 1.

    A failure shows what came out; a change on purpose is a new `RIG_VERSION` with re-measured
    figures.
    """
    pairs = list(rig_recordings(0, TINY))
    digest = hashlib.sha256("\n".join(truth_of(run) for _, run in pairs).encode()).hexdigest()
    levels = {
        r.recording_id: tuple(float(v) for v in r.signal.std(axis=1).round(4)) for r, _ in pairs
    }
    assert (RIG_VERSION, digest) == ("1", GOLDEN_TRUTH)
    for name, golden in GOLDEN_LEVELS.items():
        np.testing.assert_allclose(levels[name], golden, rtol=1e-3)


@pytest.mark.parametrize("version", ["1", "2", "3"])
def test_the_same_seed_gives_the_same_samples_in_any_batch(version: str) -> None:
    size, take = RigSize(2, 1, 0.3), {"pressures": (MPa(10),), "version": version}
    first = {
        r.recording_id: r.signal
        for r, _ in rig_recordings(3, size, labels=("normal", "piston"), **take)
    }
    again = {
        r.recording_id: r.signal
        for r, _ in rig_recordings(3, size, labels=("piston", "normal"), batch=1, **take)
    }
    assert first.keys() == again.keys()
    for name, signal in first.items():
        np.testing.assert_array_equal(again[name], signal)
    assert len({signal.tobytes() for signal in first.values()}) == 4
    other = next(iter(rig_recordings(4, size, labels=("normal",), batch=1, **take)))[0]
    assert np.abs(other.signal - first[other.recording_id]).max() > 0.5


def test_pumps_of_a_fleet_differ_and_none_is_the_nominal_one(pump: Pump) -> None:
    fleet = [draw_specimen(pump, name, 0) for name in "ABCDEF"]
    values = np.array([specimen.values for specimen in fleet])
    assert np.all(np.log(values).std(axis=0) > 0.05)
    assert np.all(np.abs(np.log(values / pump.interfaces.values())).max(axis=1) > 0.3)
    assert len({specimen.mount for specimen in fleet}) == 6


def test_a_recording_states_what_was_set_and_not_what_held() -> None:
    recording, run = next(iter(rig_recordings(0, TINY)))
    assert recording.condition is not None
    assert recording.condition.discharge_pressure == 5e6
    assert 0 < abs(run.condition.discharge_pressure / 5e6 - 1) <= 0.03
    assert not any("fault" in key or "truth" in key for key in recording.attributes)


def test_the_twin_with_the_true_values_still_misses_the_rig(
    pump: Pump, at_15: OperatingCondition
) -> None:
    """The rig is no twin in disguise: handed every true interface value, the twin's lines are off
    by over 5 %.
    """
    specimen = draw_specimen(pump, "A", 0)
    run = Run(specimen, at_15, None)
    orders = np.arange(7, 175, 7)
    pressure = force_lines(LoadCase(specimen.pump, at_15, None, specimen.clearances), 180)
    truth = (
        shell_lines(run, pressure)
        * specimen.housing.response(np.arange(1, 181) * at_15.shaft_frequency)
    )[:, orders - 1]
    values = Interfaces.from_values(specimen.values * film_factors(at_15.discharge_pressure, 1.0))
    twin = Twin(pump, at_15, None, values, bandwidth=2600)
    lines = twin.acceleration().detach().numpy()[:, np.isin(twin.orders, orders)]
    error = np.linalg.norm(np.abs(lines) - np.abs(truth)) / np.linalg.norm(truth)
    assert 0.05 < error < 0.6


def test_a_healthy_pump_of_the_rig_has_once_per_revolution_content(
    pump: Pump, at_15: OperatingCondition
) -> None:
    specimen = draw_specimen(pump, "B", 1)
    scattered = force_lines(LoadCase(specimen.pump, at_15, None, specimen.clearances), 10)
    equal = force_lines(LoadCase(specimen.pump, at_15), 10)
    assert abs(equal[2, 12]) < 1e-4
    assert abs(scattered[2, 12]) > 1000 * abs(equal[2, 12])


def test_slippers_load_at_odd_multiples_of_the_piston_count() -> None:
    lines = np.abs(slipper_loading(7, 0.3, [6, 7, 14, 21]))
    assert lines[1] == pytest.approx(4 / np.pi * (1 - 0.3) / (7 * (1 + 0.3)), rel=1e-3)
    assert lines[0] < 1e-3
    assert lines[2] < 1e-3 * 5
    assert lines[3] == pytest.approx(lines[1] / 3, rel=1e-2)


def test_the_speed_wanders_by_no_more_than_half_a_percent(at_15: OperatingCondition) -> None:
    angle = shaft_angle(at_15, 100_000, 25600.0, np.random.default_rng(0))
    speed = np.diff(angle) * 25600.0 / at_15.speed
    assert np.abs(speed - 1).max() <= 0.0051
    assert np.ptp(speed) > 5e-4


def test_a_rig_on_disk_reads_back_and_passes_inspection(tmp_path: Path) -> None:
    tiny = replace(SIZES["tiny"], specimens=1, repeats=1, duration=1.0)
    index = build_rig(tmp_path / "rig", seed=0, size=tiny)
    recordings = load_recordings(index)
    assert len(recordings) == 15
    assert {r.label for r in recordings} == set(CLASSES)
    report = inspect_recordings(recordings)
    assert not report.has_errors
    by_id = {r.recording_id: r for r, _ in rig_recordings(0, tiny)}
    for recording in recordings:
        np.testing.assert_array_equal(recording.signal, by_id[recording.recording_id].signal)
        assert recording.condition == by_id[recording.recording_id].condition
    truth = json.loads((tmp_path / "rig-truth.json").read_text())
    assert set(truth["recordings"]) == set(by_id)
    assert not list((tmp_path / "rig").rglob("*truth*"))


def test_a_folder_with_files_and_an_unknown_size_are_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep me")
    with pytest.raises(InputError, match="not empty"):
        build_rig(tmp_path, seed=0)
    with pytest.raises(InputError, match="must be one of tiny, short, small, paper"):
        build_rig(tmp_path / "new", seed=0, size="huge")


def test_piston_pass_lines_stand_out_of_the_noise() -> None:
    recording, run = next(iter(rig_recordings(0, RigSize(1, 1, 2.0))))
    lines = order_spectrum(recording.signal, recording.sample_rate, 860 / 60, np.array([14, 28]))
    assert np.all(lines.amplitude[:2].max(axis=1) > 5 * lines.deviation[:2].max(axis=1))
    assert run.fault is None


# ---- thirteen sensors, and the deep recess


def test_thirteen_accelerometers_sit_where_the_pump_file_says() -> None:
    pairs = list(rig_recordings(3, LONGER, labels=("normal",), sensors=13))
    usual = list(rig_recordings(3, LONGER, labels=("normal",)))
    pump = load_pump("25scy14-1b-13")
    for (recording, run), (_, usual_run) in zip(pairs, usual, strict=True):
        assert recording.channels == pump.channels
        assert recording.n_channels == 13
        assert (run.condition, run.specimen.mount) == (
            usual_run.condition,
            usual_run.specimen.mount,
        )
        levels = recording.signal.std(axis=1)
        assert (levels > 0.05).all()
        assert np.unique(levels.round(3)).size == 13
    talk = pairs[0][1].specimen.housing.gain - np.diag(np.diag(pairs[0][1].specimen.housing.gain))
    few = usual[0][1].specimen.housing.gain - np.diag(np.diag(usual[0][1].specimen.housing.gain))
    assert np.sqrt((talk**2).sum(axis=1).mean()) < 2 * np.sqrt((few**2).sum(axis=1).mean())


@pytest.mark.parametrize(("version", "sensors"), [("2", 13), ("1", 5)])
def test_a_number_of_sensors_that_a_version_has_not_is_refused(version: str, sensors: int) -> None:
    with pytest.raises(
        InputError, match=rf"Version {version} of the rig cannot record {sensors} sensors"
    ):
        next(iter(rig_recordings(0, LONGER, version=version, sensors=sensors)))


def test_the_papers_recess_is_the_only_difference_of_the_deep_version() -> None:
    labels = ("normal", "swash_plate")
    deep = {
        r.recording_id: (r, run)
        for r, run in rig_recordings(3, LONGER, labels=labels, version=DEEP_VERSION)
    }
    for usual, run in rig_recordings(3, LONGER, labels=labels):
        recording, deep_run = deep[usual.recording_id]
        if usual.label == "normal":
            np.testing.assert_array_equal(recording.signal, usual.signal)
            continue
        fault = deep_run.fault
        assert isinstance(fault, SwashPlateDefect)
        assert isinstance(run.fault, SwashPlateDefect)
        assert (fault.depth, fault.length, fault.width) == pytest.approx((0.6e-3, 30e-3, 24e-3))
        assert (fault.angle, fault.contact) == (run.fault.angle, "shared")
        assert recording.signal.std() > 1.5 * usual.signal.std()
