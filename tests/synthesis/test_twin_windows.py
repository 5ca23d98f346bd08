"""Windows of a twin: layout, seeds, variation, background, and windows of a calibration."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, recording_of

from swashtwin.calibration import (
    Calibration,
    GaussNewton,
    Nuisances,
    Posterior,
    calibrate,
)
from swashtwin.calibration.posterior import Verdict
from swashtwin.calibration.unknowns import Unknowns, build_search_space
from swashtwin.foundation import (
    InputError,
    MPa,
    derive_seed,
    mm,
    random_stream,
    rpm,
    um,
)
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, PistonWear, Pump, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.synthesis import (
    Variation,
    machine_of,
    simulate_windows,
    synthesize,
    twin_windows,
)
from swashtwin.synthesis.background import background_noise
from swashtwin.synthesis.fidelity import causes
from swashtwin.synthesis.twin_windows import SyntheticWindows
from swashtwin_bench import rig_recordings
from swashtwin_bench.rigs.writing import RigSize

NO_VARIATION = Variation(
    speed=0.0,
    pressure=0.0,
    severity=0.0,
    angle=0.0,
    temperature=(318.15, 318.15),
    interfaces=0.0,
    sensor=0.0,
)


@pytest.fixture(scope="module")
def measured() -> WindowSet:
    labels = ("normal", "swash_plate")
    pairs = rig_recordings(0, RigSize(1, 1, 1.0), labels=labels)
    return cut_windows([recording for recording, _ in pairs], length=2048, classes=labels)


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15, SwashPlateDefect(depth=mm(0.06), length=mm(30), width=mm(24)))


def test_synthetic_windows_join_the_measured_ones(twin: Twin, measured: WindowSet) -> None:
    synthetic = simulate_windows(twin, count=4, like=measured, seed=0)
    windows = measured + synthetic

    assert windows.synthetic.sum() == 4
    assert set(windows.label[windows.synthetic]) == {"swash_plate"}
    np.testing.assert_allclose(synthetic.discharge_pressure, MPa(15))
    assert len(set(synthetic.recording_id)) == 4


def test_the_same_seed_gives_the_same_windows_and_another_seed_others(
    twin: Twin, measured: WindowSet
) -> None:
    def signal(seed: int) -> np.ndarray:
        return simulate_windows(twin, count=2, like=measured, seed=seed).signal

    np.testing.assert_array_equal(signal(seed=0), signal(seed=0))
    assert np.abs(signal(seed=0) - signal(seed=1)).max() > 0.1


@pytest.fixture(scope="module")
def two_twins(twin: Twin, pump: Pump) -> list[Twin]:
    """Twins of two pumps at two speeds, the second of 60 rad/s."""
    slow = twin.condition.replace(speed=60.0)
    return [twin, replace(twin, pump=replace(pump, name="second"), condition=slow)]


def test_a_window_does_not_depend_on_the_number_of_windows(
    two_twins: list[Twin], measured: WindowSet
) -> None:
    three = simulate_windows(two_twins, count=3, like=measured, seed=0)
    seven = simulate_windows(two_twins, count=7, like=measured, seed=0)
    np.testing.assert_array_equal(seven.signal[:3], three.signal)
    np.testing.assert_array_equal(seven.speed[1::2], 60.0)


def test_a_window_does_not_depend_on_the_chunk_in_which_it_is_simulated(
    two_twins: list[Twin], measured: WindowSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = simulate_windows(two_twins, count=7, like=measured, seed=0)
    monkeypatch.setattr(twin_windows, "_CHUNK", 2)
    chunked = simulate_windows(two_twins, count=7, like=measured, seed=0)
    np.testing.assert_array_equal(whole.signal, chunked.signal)
    np.testing.assert_array_equal(whole.recording_id, chunked.recording_id)


def test_without_variation_and_noise_a_window_is_the_twins_simulation(
    twin: Twin, measured: WindowSet
) -> None:
    windows = simulate_windows(
        twin, count=2, like=measured, seed=0, variation=NO_VARIATION, background="none"
    )
    simulated = twin.simulate(2048 / 25600, 25600.0).signal

    # windows begin at any shaft angle, so that their deviations agree but not their samples
    expected = np.tile(simulated.std(axis=1), (2, 1))
    np.testing.assert_allclose(windows.signal.std(axis=2), expected, rtol=0.05)


def test_the_background_has_the_level_of_the_measured_noise(
    twin: Twin, measured: WindowSet
) -> None:
    synthetic = simulate_windows(twin, count=12, like=measured, seed=0)

    # above the twin's band, both contain noise alone
    def above_6_kHz(windows: WindowSet) -> np.ndarray:
        power = np.abs(np.fft.rfft(windows.signal, axis=2)) ** 2
        return np.sqrt(power[:, :, 500:].mean(axis=(0, 2)))

    at_15 = measured.discharge_pressure == MPa(15)
    normal = measured.subset(at_15 & (measured.label == "normal"))

    np.testing.assert_allclose(above_6_kHz(synthetic), above_6_kHz(normal), rtol=0.25)


def synthesize_with_gain(twin: Twin, measured: WindowSet, gain: int) -> SyntheticWindows:
    like = replace(measured, signal=gain * measured.signal)
    return synthesize(twin, twin.fault, count=24, like=like)


def test_windows_have_the_gain_of_the_healthy_machine(twin: Twin, measured: WindowSet) -> None:
    plain = synthesize_with_gain(twin, measured, gain=1)
    loud = synthesize_with_gain(twin, measured, gain=3)

    # the third channel is silent in the twin: it measures crosstalk, which has no gain
    plain_signal = plain.signal[:, :2]
    loud_signal = loud.signal[:, :2]
    np.testing.assert_allclose(loud_signal, 3 * plain_signal, rtol=1e-3, atol=1e-4)


def as_machine(windows: WindowSet, name: str, *, gain: float = 1.0) -> WindowSet:
    """The windows as if they were recorded on a machine of this name, louder by `gain`."""
    recording_id = np.array([f"{name}-{identity}" for identity in windows.recording_id])
    return replace(
        windows,
        signal=(gain * windows.signal).astype(np.float32),
        specimen=np.full(len(windows), name),
        recording_id=recording_id,
    )


def test_a_twin_of_a_machine_has_its_gain_and_noise_alone(twin: Twin, measured: WindowSet) -> None:
    quiet = as_machine(measured, "quiet")
    both = quiet + as_machine(measured, "loud", gain=3)

    def simulate(like: WindowSet, **arguments: Any) -> np.ndarray:
        return simulate_windows(twin, count=6, like=like, seed=0, **arguments).signal

    expected = simulate(quiet)
    np.testing.assert_array_equal(simulate(both, specimens=["quiet"]), expected)
    assert simulate(both).std() > 1.2 * expected.std()

    # two machines take turns with their twins
    turns = simulate_windows([twin, twin], count=6, like=both, seed=0, specimens=["quiet", "loud"])
    np.testing.assert_array_equal(turns.signal[::2], expected[::2])
    assert turns.signal[1::2].std() > 2 * expected[1::2].std()

    # folds that hold a machine out recognize its windows by this name
    assert turns.specimen.tolist() == ["twin of quiet", "twin of loud"] * 3


def test_the_pool_lends_noise_if_the_machine_has_no_healthy_windows_at_the_pressure(
    twin: Twin, measured: WindowSet
) -> None:
    is_at_15 = measured.discharge_pressure == MPa(15)
    elsewhere = as_machine(measured.subset(~is_at_15), "elsewhere")
    like = elsewhere + as_machine(measured, "other")

    def simulate(**arguments: Any) -> np.ndarray:
        return simulate_windows(twin, count=2, like=like, seed=0, **arguments).signal

    np.testing.assert_array_equal(simulate(specimens=["elsewhere"]), simulate())


def test_there_is_one_specimen_for_each_twin(twin: Twin, measured: WindowSet) -> None:
    with pytest.raises(InputError, match="There are 2 specimens for 1 twins; give one for each"):
        simulate_windows(twin, count=1, like=measured, seed=0, specimens=["A", "B"])


def test_a_gain_error_is_attributed_to_path_and_floor(twin: Twin, measured: WindowSet) -> None:
    plain = synthesize_with_gain(twin, measured, gain=1)
    assert plain.measured_healthy is not None
    assert plain.simulate_healthy is not None
    healthy = plain.simulate_healthy()
    half_plain = replace(plain, signal=plain.signal / 2)
    half_healthy = replace(healthy, signal=healthy.signal / 2)

    differences_db = causes(plain, half_plain, 7, (healthy, half_healthy))

    # half is 6.02 dB
    expected = {"law": 0, "path": 6.02, "floor": 6.02, "variation": 0}
    assert differences_db == pytest.approx(expected, abs=0.01)


def test_a_strong_line_between_bins_does_not_raise_the_background_far_from_it(
    twin: Twin, measured: WindowSet
) -> None:
    noise = 0.01 * random_stream(0, "noise").normal(size=(1, measured.signal.shape[1], 2048))
    line = 100 * np.sin(2 * np.pi * 100.5 * np.arange(2048) / 2048)
    loud = replace(measured.subset(np.array([0])), signal=(noise + line).astype(np.float32))
    background = background_noise(loud, twin).draw(random_stream(0, "drawn"))

    def rms_far_from_the_line(signal: np.ndarray) -> float:
        spectrum = np.abs(np.fft.rfft(signal, axis=-1))
        return float(np.sqrt(np.mean(spectrum[..., 400:-1] ** 2)))  # the line is at bin 100.5

    assert rms_far_from_the_line(background) < 1.5 * rms_far_from_the_line(noise[0])


def test_severity_varies_with_its_setting(twin: Twin, measured: WindowSet) -> None:
    def scatter(severity: float) -> float:
        variation = replace(NO_VARIATION, severity=severity)
        windows = simulate_windows(
            twin, count=10, like=measured, seed=0, variation=variation, background="none"
        )
        return windows.signal.std(axis=2)[:, 0].std()

    assert scatter(severity=0.5) > 5 * scatter(severity=0.0)


def test_twins_of_several_classes_are_refused(twin: Twin, measured: WindowSet) -> None:
    with pytest.raises(InputError, match="Give twins of one class"):
        simulate_windows([twin, twin.with_fault(None)], count=2, like=measured, seed=0)


def test_a_class_that_the_windows_lack_is_refused(twin: Twin, measured: WindowSet) -> None:
    worn = twin.with_fault(PistonWear(clearance=um(40)))
    with pytest.raises(InputError, match="class 'piston' is not among the windows' classes"):
        simulate_windows(worn, count=1, like=measured, seed=0)


def test_a_number_of_windows_that_is_not_positive_is_refused(
    twin: Twin, measured: WindowSet
) -> None:
    with pytest.raises(InputError, match="at least 1"):
        simulate_windows(twin, count=0, like=measured, seed=0)


def test_a_channel_without_a_sensor_of_the_twin_is_refused(
    twin: Twin, measured: WindowSet, pump: Pump
) -> None:
    single_sensor = replace(twin, pump=replace(pump, sensors=pump.sensors[:1]))
    message = r"'body_y' of the windows is not among the twin's sensors \(cover_z\)"
    with pytest.raises(InputError, match=message):
        simulate_windows(single_sensor, count=1, like=measured, seed=0)


def test_a_background_needs_measured_windows(twin: Twin, measured: WindowSet) -> None:
    only_synthetic = simulate_windows(twin, count=2, like=measured, seed=0)
    with pytest.raises(InputError, match="set background='none'"):
        simulate_windows(twin, count=1, like=only_synthetic, seed=0)


@pytest.fixture(scope="module")
def posterior(twin: Twin) -> Posterior:
    """All six values within 20 %, the mounting and the sensors within their priors."""
    unknowns = Unknowns(
        build_search_space(twin),
        Nuisances.typical(gains=0.1),
        twin.pump.channels,
        np.zeros(11),
    )
    deviation = np.where(np.arange(len(unknowns)) < 6, 0.2, unknowns.deviation)
    return Posterior(unknowns, unknowns.start, np.diag(deviation**2))


def test_windows_of_a_posterior_are_those_of_its_draws(
    twin: Twin, measured: WindowSet, posterior: Posterior
) -> None:
    def simulate(source: Twin, **arguments: Any) -> np.ndarray:
        return simulate_windows(
            source,
            count=3,
            like=measured,
            seed=4,
            variation=NO_VARIATION,
            background="none",
            **arguments,
        ).signal

    windows = simulate(twin, posterior=[posterior])
    draws = posterior.twins(twin, 3, derive_seed(4, "posterior", "swash_plate", 0))

    for window, draw in zip(windows, draws, strict=True):
        # one of the three, as each begins at another shaft angle
        simulated = simulate(draw)
        rms_difference = np.sqrt(np.mean((simulated - window) ** 2, axis=(1, 2)))
        assert rms_difference.min() < 1e-4
        level_difference = np.abs(simulated.std(axis=-1) - window.std(axis=-1)).max(axis=1)
        assert level_difference.min() < 1e-4


@pytest.fixture(scope="module")
def calibration(pump: Pump) -> Calibration:
    """Calibration of a healthy pump at 10 and 15 MPa."""
    recordings = []
    for seed, pressure in enumerate((MPa(10), MPa(15))):
        condition = OperatingCondition(speed=rpm(860), discharge_pressure=pressure)
        recording = recording_of(Twin(pump, condition, bandwidth=2600), seed=seed)
        recordings.append(replace(recording, recording_id=f"healthy-{seed}"))

    return calibrate(pump, recordings, method=GaussNewton(starts=1, max_iterations=4), **SIX_VALUES)


FAULT = SwashPlateDefect(depth=mm(0.07), length=mm(30), width=mm(24))


@pytest.fixture(scope="module")
def calibrated_windows(calibration: Calibration, measured: WindowSet) -> SyntheticWindows:
    return synthesize(calibration, FAULT, count=4, like=measured, background="spectrum")


def test_a_calibration_and_a_fault_are_enough(
    calibrated_windows: SyntheticWindows, measured: WindowSet
) -> None:
    windows = calibrated_windows
    assert set(windows.label) == {"swash_plate"}
    assert windows.synthetic.all()
    assert len(measured + windows) == len(measured) + 4
    # in turn, the pressures of the calibration
    np.testing.assert_array_equal(windows.discharge_pressure, [MPa(10), MPa(15)] * 2)


def test_windows_of_a_calibration_are_those_of_its_twins_and_posterior(
    calibration: Calibration, calibrated_windows: SyntheticWindows, measured: WindowSet
) -> None:
    twins = [calibration.twin.with_fault(FAULT).at(fit.condition) for fit in calibration.fits]
    simulated = simulate_windows(
        twins, count=4, like=measured, seed=0, posterior=[calibration.posterior] * 2
    )
    np.testing.assert_array_equal(calibrated_windows.signal, simulated.signal)


def test_windows_of_a_calibration_have_gain_and_noise_of_its_machine(
    calibration: Calibration, measured: WindowSet
) -> None:
    quiet = as_machine(measured, "quiet")
    is_healthy = quiet.label == "normal"
    recording_id = np.where(is_healthy, calibration.recording_ids[0], quiet.recording_id)
    quiet = replace(quiet, recording_id=recording_id)
    both = quiet + as_machine(measured, "loud", gain=3)

    assert machine_of(calibration, both) == "quiet"
    assert machine_of(calibration, measured) == ""
    # another machine's recording of the same name
    content = {calibration.recording_ids[0]: ("other samples",)}
    assert machine_of(calibration, replace(both, content=content)) == ""
    windows = synthesize(calibration, FAULT, count=4, like=both)
    alone = synthesize(calibration, FAULT, count=4, like=quiet)
    np.testing.assert_array_equal(windows.signal, alone.signal)


def test_windows_of_a_calibration_have_their_fidelity(calibrated_windows: SyntheticWindows) -> None:
    fidelity = calibrated_windows.fidelity
    assert fidelity is not None
    assert fidelity.pressures == (MPa(10), MPa(15))
    assert fidelity.n_synthetic == 4


def test_windows_of_a_calibration_may_have_another_pressure(
    calibration: Calibration, measured: WindowSet
) -> None:
    windows = synthesize(calibration, None, count=2, like=measured, pressure=MPa(5))
    np.testing.assert_array_equal(windows.discharge_pressure, MPa(5))


def test_windows_of_a_doubtful_calibration_state_its_doubt(
    calibration: Calibration, measured: WindowSet
) -> None:
    def notes(verdict: Verdict, calibration: Calibration = calibration) -> tuple[str, ...]:
        estimates = tuple(replace(member, verdict=verdict) for member in calibration.estimates)
        doubtful = replace(calibration, estimates=estimates)
        return synthesize(doubtful, FAULT, count=1, like=measured).notes

    assert not any("nominal twin" in note for note in notes("identified"))
    assert notes("weak")[0].startswith("None of the twin's six values is identified")

    worse = tuple(
        replace(fit, calibrated_agreement=fit.nominal_agreement) for fit in calibration.fits
    )
    assert notes("identified", replace(calibration, fits=worse))[0].startswith(
        "The calibrated twin's lines are no nearer"
    )

    # nominal windows do not rest on the calibrated values
    doubtful = replace(calibration, fits=worse)
    nominal = synthesize(doubtful, FAULT, count=1, like=measured, values="nominal")
    assert not any("Do not" in note for note in nominal.notes)


def test_channels_that_the_calibration_did_not_read_are_noted(
    calibration: Calibration, calibrated_windows: SyntheticWindows, measured: WindowSet
) -> None:
    assert not any("The calibration read" in note for note in calibrated_windows.notes)

    unknowns = replace(calibration.posterior.unknowns, channels=("cover_z",))
    posterior = replace(calibration.posterior, unknowns=unknowns)
    of_one_channel = replace(calibration, posterior=posterior)
    windows = synthesize(of_one_channel, FAULT, count=1, like=measured, values="nominal")

    expected = (
        "The calibration read cover_z, but not body_y, body_x: "
        "the gains of these are those of the pump"
    )
    assert windows.notes[-1].startswith(expected)


@pytest.fixture(scope="module")
def healthy(twin: Twin, pump: Pump) -> Twin:
    return Twin(pump, twin.condition, bandwidth=2600)


@pytest.fixture(scope="module")
def healthy_recordings(healthy: Twin) -> list[Recording]:
    return [replace(recording_of(healthy, seed=seed), synthetic=False) for seed in range(2)]


def test_recordings_in_place_of_windows_are_cut_first(
    twin: Twin, healthy: Twin, healthy_recordings: list[Recording]
) -> None:
    windows = synthesize(healthy, twin.fault, count=2, like=healthy_recordings)

    assert windows.classes == ("normal", "swash_plate")
    assert windows.signal.shape == (2, 3, 2048)
    assert windows.sample_rate == 6400.0
    assert windows.fidelity is None  # no recording of the class


def test_the_length_of_windows_of_recordings_may_be_given(
    healthy: Twin, healthy_recordings: list[Recording]
) -> None:
    windows = synthesize(healthy, None, count=1, like=healthy_recordings, window=1024)
    assert windows.length == 1024
    assert set(windows.label) == {"normal"}
