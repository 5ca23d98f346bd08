"""Pumps of one type calibrated together: population found, weak pumps drawn to it, strong ones left where they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commandline import one_line, run, run_json
from twin_recordings import SIX_VALUES, worn_twin

from swashtwin.calibration import (
    FleetCalibration,
    GaussNewton,
    Nuisances,
    Population,
    calibrate,
    calibrate_fleet,
    load_calibration,
    load_population,
    measure,
    objective_of,
)
from swashtwin.calibration.fleet.population import Evidence, covariance_within, population_of
from swashtwin.calibration.objective.unknowns import Unknowns
from swashtwin.foundation import ArtifactError, DataError, InputError, MissingFileError, stream
from swashtwin.physics import Twin
from swashtwin.pump import Interfaces, OperatingCondition, Pump, load_pump
from swashtwin.recordings import Recording, join_manifests, write_index, write_recording
from swashtwin.signals import add_noise
from swashtwin.synthesis import PumpPrior

TYPE = np.array([1, 1, 1.6, 0.7, 2.5, 1])
"""The type's values over the nominal ones."""
SPREAD = 0.15
WEAK = ("F", "G")
QUICK = GaussNewton(starts=1)


def fleet_of(twin: Twin, names: str, seed: int) -> tuple[list[Recording], dict[str, np.ndarray]]:
    """One recording of each pump, and the logarithm of its values; weak pumps have one noisy channel."""
    recordings, truth = [], {}
    for name in names:
        deviations = stream(seed, "fleet", name).standard_normal(6)
        values = twin.values.numpy() * TYPE * np.exp(SPREAD * deviations)
        true = twin.with_interfaces(Interfaces.from_values(values))
        recording = true.simulate(1.3, 6400.0, phase=1.0, recording_id=f"rec-{name}")
        signal = add_noise(recording.signal, 0.0 if name in WEAK else 30.0, seed)
        recording = replace(recording, specimen=name, signal=signal)
        recordings.append(recording.picked(["body_x"]) if name in WEAK else recording)
        truth[name] = np.log(values)
    return recordings, truth


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return worn_twin(pump, at_15)


@pytest.fixture(scope="module")
def members(twin: Twin) -> tuple[list[Recording], dict[str, np.ndarray]]:
    return fleet_of(twin, "ABCDEFG", seed=1)


@pytest.fixture(scope="module")
def fleet(twin: Twin, members: tuple[list[Recording], dict[str, np.ndarray]]) -> FleetCalibration:
    return calibrate_fleet(twin, members[0], method=QUICK)


@pytest.fixture(scope="module")
def unknowns(twin: Twin, members: tuple[list[Recording], dict[str, np.ndarray]]) -> Unknowns:
    return objective_of(twin, measure(twin, members[0][:1])).unknowns


def test_the_population_that_evidence_was_drawn_from_is_found_within_its_intervals(unknowns: Unknowns) -> None:
    mean, spread = unknowns.center + 0.3, np.array([0.1, 0.2, 0.3, 0.1, 0.2, 0.3])
    noise = np.array([0.05, 0.05, 0.05, 0.1, 0.1, np.inf])  # of the last nothing is known
    information = np.diag(1 / noise**2)
    identified = slice(0, 5)
    is_held, errors = [], []
    for draw in range(25):
        rng = stream(draw, "evidence")
        coordinates = mean + np.hypot(spread, np.where(np.isinf(noise), 0, noise)) * rng.standard_normal((10, 6))
        evidence = {str(number): Evidence(information, information @ row) for number, row in enumerate(coordinates)}
        population = population_of(evidence, unknowns, 0.5)
        low, high = population.spread_interval.T
        is_held.append(((low < spread) & (spread < high))[identified])
        errors.append(((population.mean - mean) / population.mean_std)[identified])
        assert population.mean[5] == pytest.approx(unknowns.center[5])
        assert population.mean_std[5] == pytest.approx(unknowns.deviation[5])
    assert 0.8 <= np.mean(is_held) <= 0.98
    assert np.std(errors) == pytest.approx(1, abs=0.2)


def test_equal_pumps_have_a_spread_near_zero_and_one_pump_apart_widens_it(unknowns: Unknowns) -> None:
    information = np.diag(np.full(6, 1e4))
    alike = {str(i): Evidence(information, information @ unknowns.center) for i in range(8)}
    different = {**alike, "8": Evidence(information, information @ (unknowns.center + 1))}
    equal, unequal = (population_of(evidence, unknowns, 0.5).spread for evidence in (alike, different))
    assert (equal < 0.02).all()
    assert (unequal > 0.2).all()


def test_an_error_that_all_pumps_share_is_not_averaged_away(unknowns: Unknowns) -> None:
    strong, weak = np.diag(np.full(6, 400.0)), np.diag(np.full(6, 4.0))
    evidence = {str(i): Evidence(strong, strong @ unknowns.center) for i in range(8)}
    evidence["weak"] = Evidence(weak, weak @ unknowns.center)
    shared = np.diag(np.full(6, 0.2**2))
    free = population_of(evidence, unknowns, 0.5)
    bound = replace(free, mean_covariance=free.mean_covariance + shared)
    for population, error, least in ((free, 0 * shared, 0.0), (bound, shared, 0.2)):
        covariance = covariance_within(evidence["weak"], population, error, unknowns.deviation)
        std = np.sqrt(np.diag(covariance))
        assert (std > least).all()
        assert (std < 0.3).all()
    assert (np.sqrt(np.diag(covariance_within(evidence["weak"], free, 0 * shared, unknowns.deviation))) < 0.15).all()


def test_the_values_that_recordings_tell_give_the_types_mean_and_spread(
    fleet: FleetCalibration, members: tuple[list[Recording], dict[str, np.ndarray]], twin: Twin
) -> None:
    population = fleet.population
    true = np.log(twin.values.numpy() * TYPE)
    for letter in ("C_v", "C_Hz"):
        index = population.names.index(letter)
        low, high = population.spread_interval[index]
        assert abs(population.mean[index] - true[index]) < 3 * population.mean_std[index]
        assert low < SPREAD < high
    assert fleet.is_converged
    assert population.specimens == tuple("ABCDEFG")


def test_a_weak_pump_is_drawn_toward_the_others_and_comes_nearer_to_the_truth(
    fleet: FleetCalibration, members: tuple[list[Recording], dict[str, np.ndarray]]
) -> None:
    alone, within = [], []
    for name in WEAK:
        for index in (2, 3, 4):  # C_v, K_v, C_Hz; of the others nobody knows much
            alone.append(np.log(fleet.alone[name][index].value) - members[1][name][index])
            within.append(np.log(fleet.calibrations[name].estimates[index].value) - members[1][name][index])
            assert fleet.calibrations[name].estimates[index].log_std < fleet.alone[name][index].log_std
    assert np.square(within).mean() < 0.5 * np.square(alone).mean()


def test_a_pump_with_strong_recordings_hardly_moves(fleet: FleetCalibration) -> None:
    for name in "ABCDE":
        for index in (2, 4):
            alone, within = fleet.alone[name][index], fleet.calibrations[name].estimates[index]
            assert abs(np.log(within.value / alone.value)) < 0.5 * alone.log_std


def test_what_no_recording_tells_stays_not_identified(fleet: FleetCalibration) -> None:
    assert all(calibration.estimate("K_sw").verdict == "not identified" for calibration in fleet.calibrations.values())
    assert any("K_sw" in text and "not identified" in text for text in fleet.calibrations["A"].notes)


def test_a_new_pump_of_the_type_starts_from_what_the_others_taught(twin: Twin, fleet: FleetCalibration) -> None:
    recordings, truth = fleet_of(twin, "G", seed=5)
    recordings = [replace(recording, specimen="new") for recording in recordings]
    blind = calibrate(twin, recordings, method=QUICK, **SIX_VALUES)
    taught = calibrate(twin, recordings, method=QUICK, prior=fleet.population, **SIX_VALUES)
    indices = [2, 3, 4]
    errors = [
        np.square([np.log(calibration.estimates[index].value) - truth["G"][index] for index in indices]).mean()
        for calibration in (blind, taught)
    ]
    assert errors[1] < errors[0]
    assert taught.estimate("K_v").log_std < 0.5 * blind.estimate("K_v").log_std
    assert taught.settings["prior"] == "population of A, B, C, D, E, F, G"


def test_calibrations_and_population_are_read_back(fleet: FleetCalibration, tmp_path: Path) -> None:
    files = fleet.save(tmp_path)
    assert [file.name for file in files] == ["population.json", *(f"{name}.json" for name in "ABCDEFG")]
    again = load_population(files[0])
    assert isinstance(again, Population)
    assert again.names == fleet.population.names
    assert again.pump == fleet.population.pump == load_pump("25scy14-1b").name
    used = [calibration.recording_hashes for calibration in fleet.calibrations.values()]
    assert again.manifest == fleet.population.manifest == join_manifests(used)
    for name, value in vars(fleet.population).items():
        if isinstance(value, np.ndarray):
            assert getattr(again, name) == pytest.approx(value)
    calibration = load_calibration(files[1])
    assert calibration.posterior.draws(3, 0) == pytest.approx(fleet.calibrations["A"].posterior.draws(3, 0))


def test_a_population_of_another_design_is_refused(
    twin: Twin, members: tuple[list[Recording], dict[str, np.ndarray]], fleet: FleetCalibration
) -> None:
    other = replace(twin, pump=replace(twin.pump, name="other"))
    with pytest.raises(InputError, match=f"is of pumps {twin.pump.name}, not other"):
        calibrate(other, members[0][:1], method=QUICK, prior=fleet.population, **SIX_VALUES)
    with pytest.raises(InputError, match=f"is of pumps {twin.pump.name}, not other"):
        PumpPrior(pump=other.pump, population=fleet.population)
    fleet.population.require_pump(twin.pump.name)
    replace(fleet.population, pump="").require_pump("other")  # of a file that does not say


def test_a_damaged_population_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError):
        load_population(tmp_path / "none.json")
    (tmp_path / "other.json").write_text('{"format": "swashtwin population 0"}')
    with pytest.raises(ArtifactError, match="reads 'swashtwin population 1'"):
        load_population(tmp_path / "other.json")


def test_a_fleet_needs_two_named_pumps_on_the_same_channels(
    twin: Twin, members: tuple[list[Recording], dict[str, np.ndarray]]
) -> None:
    recordings = members[0]
    with pytest.raises(DataError, match="names no specimen"):
        calibrate_fleet(twin, [replace(recordings[0], specimen=None)], method=QUICK)
    with pytest.raises(DataError, match=r"needs two specimens .* there is one, A"):
        calibrate_fleet(twin, [recordings[0], replace(recordings[1], label="piston")], method=QUICK)
    with pytest.raises(InputError, match="different channels share no gain body_y"):
        calibrate_fleet(twin, [recordings[0], recordings[-1]], method=QUICK, nuisances=Nuisances(gains=0.1))
    with pytest.raises(InputError, match="spread_width"):
        calibrate_fleet(twin, recordings, method=QUICK, spread_width=0.0)


def test_the_command_writes_a_file_for_each_pump_and_the_population(
    members: tuple[list[Recording], dict[str, np.ndarray]], tmp_path: Path
) -> None:
    recordings = members[0][:2]
    files = [Path(f"{recording.recording_id}.h5") for recording in recordings]
    for recording, file in zip(recordings, files, strict=True):
        write_recording(recording, tmp_path / file)
    index = write_index(recordings, files, tmp_path / "recordings.toml")
    defect = ("--fault", "swash_plate:length=30mm,width=24mm,depth=0.6mm")
    words = ("twin", "calibrate-fleet", index, "--speed", "860 rpm", "--pressure", "15 MPa", *defect)
    answer = run_json(*words, "--out", tmp_path / "fleet")
    assert set(answer["specimens"]) == {"A", "B"}
    assert len(answer["files"]) == 3
    assert all(Path(file).is_file() for file in answer["files"])
    assert any("2 pumps say little" in text for text in answer["notes"])
    assert "at 15 MPa, the twin at 5 MPa" in one_line(run(*words[:5], "--pressure", "5 MPa", *defect, code=3))


def test_no_specimen_s_name_leads_out_of_the_folder_or_over_the_population(
    fleet: FleetCalibration, tmp_path: Path
) -> None:
    named = dict(zip(("population", "../out", "pump/1"), fleet.calibrations.values(), strict=False))
    files = replace(fleet, calibrations=named).save(tmp_path / "fleet")
    assert {path.parent for path in files} == {tmp_path / "fleet"}
    assert len(set(files)) == len(named) + 1
    assert load_population(tmp_path / "fleet" / "population.json").specimens == fleet.population.specimens
    twice = dict(zip(("a/b", "a_b"), fleet.calibrations.values(), strict=False))
    with pytest.raises(InputError, match="file name"):
        replace(fleet, calibrations=twice).save(tmp_path / "twice")
