"""More channels of the rig: 13 accelerometers, and what a test stand records beside vibration."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import cut_windows
from swashtwin.pump import BoreDefect, PistonWear, SwashPlateDefect, load_pump
from swashtwin.recordings import Recording, load_recordings
from swashtwin.signals import order_spectrum
from swashtwin_bench import SIZES, build_rig, rig_recordings
from swashtwin_bench.rigs.process import PROCESS, TANK_TEMPERATURE
from swashtwin_bench.rigs.writing import DEEP_VERSION, RigSize

TINY = RigSize(specimens=1, repeats=1, duration=1.2)


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rigs") / "rig"
    build_rig(folder, seed=3, size=TINY, process=True)
    return folder


def test_thirteen_accelerometers_sit_where_the_pump_file_says() -> None:
    pairs = list(rig_recordings(3, TINY, labels=("normal",), sensors=13))
    usual = list(rig_recordings(3, TINY, labels=("normal",)))
    pump = load_pump("25scy14-1b-13")
    for (recording, run), (_, usual_run) in zip(pairs, usual, strict=True):
        assert recording.channels == pump.channels
        assert recording.n_channels == 13
        assert (run.condition, run.specimen.mount) == (usual_run.condition, usual_run.specimen.mount)
        levels = recording.signal.std(axis=1)
        assert (levels > 0.05).all()
        assert np.unique(levels.round(3)).size == 13
    talk = pairs[0][1].specimen.housing.gain - np.diag(np.diag(pairs[0][1].specimen.housing.gain))
    few = usual[0][1].specimen.housing.gain - np.diag(np.diag(usual[0][1].specimen.housing.gain))
    assert np.sqrt((talk**2).sum(axis=1).mean()) < 2 * np.sqrt((few**2).sum(axis=1).mean())


@pytest.mark.parametrize(("version", "sensors"), [("2", 13), ("1", 5)])
def test_a_number_of_sensors_that_a_version_has_not_is_refused(version: str, sensors: int) -> None:
    with pytest.raises(InputError, match=rf"{sensors} sensors cannot be recorded by version {version} of the rig"):
        next(iter(rig_recordings(0, TINY, version=version, sensors=sensors)))


def test_the_papers_recess_is_the_only_difference_of_the_deep_version() -> None:
    labels = ("normal", "swash_plate")
    deep = {r.recording_id: (r, run) for r, run in rig_recordings(3, TINY, labels=labels, version=DEEP_VERSION)}
    for usual, run in rig_recordings(3, TINY, labels=labels):
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


def test_each_instrument_has_an_index_and_training_takes_accelerometers(stand: Path) -> None:
    vibration = load_recordings(stand)
    assert {recording.unit for recording in vibration} == {"m/s^2"}
    assert cut_windows(vibration, length=2048).channels == ("cover_z", "body_y", "body_x")
    for channel in PROCESS:
        recordings = load_recordings(stand / f"{channel.name}.toml")
        assert [recording.recording_id for recording in recordings] == [each.recording_id for each in vibration]
        assert [recording.condition for recording in recordings] == [each.condition for each in vibration]
        assert {recording.channels for recording in recordings} == {(channel.name,)}
        assert {recording.unit for recording in recordings} == {channel.unit}
        assert {recording.sample_rate for recording in recordings} == {channel.sample_rate}
        assert {recording.duration for recording in recordings} == {1.2}


def test_outlet_pressure_ripples_at_the_piston_pass_about_the_set_pressure(stand: Path) -> None:
    (recording,) = of(stand, "outlet_pressure", "A_normal_10MPa_1")
    assert recording.signal.mean() == pytest.approx(10e6, rel=0.04)
    orders = np.arange(1, 15)
    lines = order_spectrum(recording.signal, recording.sample_rate, 860 / 60, orders)
    assert orders[lines.amplitude[0].argmax()] in (7, 14)


def test_worn_pistons_leak_and_lower_the_outlet_flow(stand: Path) -> None:
    runs = {recording.recording_id: run for recording, run in rig_recordings(3, TINY, labels=("normal", "piston"))}
    assert isinstance(runs["A_piston_15MPa_1"].fault, PistonWear)
    flows = {name: of(stand, "outlet_flow", name)[0].signal.mean() / runs[name].condition.speed for name in list(runs)}
    assert flows["A_piston_15MPa_1"] < 0.98 * flows["A_normal_15MPa_1"]
    displacement = load_pump("25scy14-1b").rotating_group.displacement
    assert flows["A_normal_5MPa_1"] == pytest.approx(displacement / (2 * np.pi), rel=0.06)


def test_the_tank_is_a_little_cooler_than_the_oil_in_the_pump(stand: Path) -> None:
    for recording in load_recordings(stand / f"{TANK_TEMPERATURE.name}.toml"):
        assert recording.condition is not None
        assert 0 < recording.condition.oil_temperature - recording.signal.mean() < 4.5
        assert np.ptp(recording.signal) <= 0.2 + 1e-9


def test_instruments_can_be_added_later_and_change_no_vibration(stand: Path, tmp_path: Path) -> None:
    folder = tmp_path / "rig"
    few = replace(SIZES["tiny"], specimens=1, repeats=1, duration=TINY.duration)
    build_rig(folder, seed=3, size=few, file_format="csv")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    build_rig(folder, seed=3, size=few, file_format="csv", process=True)
    assert all(path.read_bytes() == content for path, content in before.items())
    for channel in PROCESS:
        for ours, theirs in zip(load_recordings(folder / f"{channel.name}.toml"), of(stand, channel.name), strict=True):
            np.testing.assert_allclose(ours.signal, theirs.signal, rtol=1e-6)


def test_vibration_and_pressure_of_one_recording_are_never_trained_and_tested_on(stand: Path) -> None:
    pressure = of(stand, "outlet_pressure")
    assert {each.recording_id for each in pressure} == {each.recording_id for each in load_recordings(stand)}
    with pytest.raises(DataError, match="two recordings have the id A_normal_5MPa_1; ids tell training from test"):
        cut_windows([*pressure, *load_recordings(stand)], length=2048)


def test_version_two_has_the_instruments_too(tmp_path: Path) -> None:
    build_rig(tmp_path / "rig", seed=3, size=RigSize(1, 1, 0.5), version="2", process=True)
    pressures = load_recordings(tmp_path / "rig" / "outlet_pressure.toml")
    assert all(
        recording.signal.mean() == pytest.approx(recording.condition.discharge_pressure, rel=0.09)
        for recording in pressures
        if recording.condition is not None
    )
    assert {BoreDefect.label} <= {recording.label for recording in pressures}


def of(folder: Path, channel: str, name: str = "") -> list[Recording]:
    return [each for each in load_recordings(folder / f"{channel}.toml") if name in ("", each.recording_id)]
