"""Synthetic windows: of the right layout, marked, seeded, varied, and never in a test set."""

from dataclasses import replace

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
from swashtwin.synthesis import (
    Variation,
    simulate_windows,
    synthesize,
)
from swashtwin.synthesis import twin_windows as synthesis
from swashtwin.synthesis.background import background_noise
from swashtwin.synthesis.fidelity import causes
from swashtwin_bench import rig_recordings
from swashtwin_bench.rigs.writing import RigSize

STILL = Variation(
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
    pairs = rig_recordings(0, RigSize(1, 1, 1.0), labels=("normal", "swash_plate"))
    return cut_windows(
        [recording for recording, _ in pairs],
        length=2048,
        classes=("normal", "swash_plate"),
    )


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
    first, repeated, second = (
        simulate_windows(twin, count=2, like=measured, seed=seed).signal for seed in (0, 0, 1)
    )

    np.testing.assert_array_equal(first, repeated)
    assert np.abs(first - second).max() > 0.1


def test_a_window_does_not_depend_on_the_others_of_its_set(
    twin: Twin, measured: WindowSet, pump: Pump, monkeypatch: pytest.MonkeyPatch
) -> None:
    second = replace(
        twin,
        pump=replace(pump, name="other"),
        condition=twin.condition.replace(speed=60.0),
    )
    few, more = (
        simulate_windows([twin, second], count=count, like=measured, seed=0) for count in (3, 7)
    )
    monkeypatch.setattr(synthesis, "_CHUNK", 2)
    chunked = simulate_windows([twin, second], count=7, like=measured, seed=0)

    np.testing.assert_array_equal(more.signal[:3], few.signal)
    np.testing.assert_array_equal(more.signal, chunked.signal)
    np.testing.assert_array_equal(more.recording_id, chunked.recording_id)
    np.testing.assert_array_equal(more.speed[1::2], 60.0)


def test_without_variation_and_noise_a_window_is_the_twin_s_simulation(
    twin: Twin, measured: WindowSet
) -> None:
    bare = simulate_windows(
        twin, count=2, like=measured, seed=0, variation=STILL, background="none"
    ).signal
    simulated = twin.simulate(2048 / 25600, 25600.0).signal

    np.testing.assert_allclose(bare.std(axis=2), np.tile(simulated.std(axis=1), (2, 1)), rtol=0.05)


def test_the_background_has_the_level_of_the_measured_noise(
    twin: Twin, measured: WindowSet
) -> None:
    """Above the twin's band there is nothing but noise, in measured and synthetic windows alike."""
    synthetic = simulate_windows(twin, count=12, like=measured, seed=0)

    def above_6_kHz(windows: WindowSet) -> np.ndarray:
        spectrum = np.abs(np.fft.rfft(windows.signal, axis=2)) ** 2
        return np.sqrt(spectrum[:, :, 500:].mean(axis=(0, 2)))

    at_15 = measured.discharge_pressure == MPa(15)
    normal = measured.subset(at_15 & (measured.label == "normal"))

    np.testing.assert_allclose(above_6_kHz(synthetic), above_6_kHz(normal), rtol=0.25)


def test_windows_have_the_gain_of_the_healthy_machine_and_causes_are_separated(
    twin: Twin, measured: WindowSet
) -> None:
    plain, loud = (
        synthesize(
            twin,
            twin.fault,
            count=24,
            like=replace(measured, signal=gain * measured.signal),
        )
        for gain in (1, 3)
    )
    # the third channel is silent in the twin: it measures cross-talk, which has no gain
    sensors_with_signal = slice(0, 2)
    np.testing.assert_allclose(
        loud.signal[:, sensors_with_signal],
        3 * plain.signal[:, sensors_with_signal],
        rtol=1e-3,
        atol=1e-4,
    )
    assert plain.measured_healthy is not None
    assert plain.simulate_healthy is not None

    healthy = plain.measured_healthy, plain.simulate_healthy()
    deaf = (
        replace(plain, signal=plain.signal / 2),
        replace(healthy[1], signal=healthy[1].signal / 2),
    )
    quieter = causes(plain, deaf[0], 7, (healthy[1], deaf[1]))

    assert quieter == pytest.approx(
        {"law": 0, "path": 6.02, "floor": 6.02, "variation": 0}, abs=0.01
    )


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
    calm = replace(STILL, severity=0.0)
    wild = replace(STILL, severity=0.5)
    levels = [
        simulate_windows(
            twin, count=10, like=measured, seed=0, variation=v, background="none"
        ).signal.std(axis=2)[:, 0]
        for v in (calm, wild)
    ]

    assert levels[1].std() > 5 * levels[0].std()


def test_twins_that_do_not_fit_the_windows_are_refused(
    twin: Twin, measured: WindowSet, pump: Pump
) -> None:
    with pytest.raises(InputError, match="Give twins of one class"):
        simulate_windows([twin, twin.with_fault(None)], count=2, like=measured, seed=0)
    with pytest.raises(InputError, match="class 'piston' is not among the windows' classes"):
        simulate_windows(
            twin.with_fault(PistonWear(clearance=um(40))),
            count=1,
            like=measured,
            seed=0,
        )

    with pytest.raises(InputError, match="at least 1"):
        simulate_windows(twin, count=0, like=measured, seed=0)

    deaf = replace(twin, pump=replace(pump, sensors=pump.sensors[:1]))
    with pytest.raises(
        InputError,
        match="'body_y' of the windows is not among the twin's sensors \\(cover_z\\)",
    ):
        simulate_windows(deaf, count=1, like=measured, seed=0)

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
    synthetic = simulate_windows(
        twin,
        count=3,
        like=measured,
        seed=4,
        variation=STILL,
        background="none",
        posterior=[posterior],
    )

    for window, draw in zip(
        synthetic.signal,
        posterior.twins(twin, 3, derive_seed(4, "posterior", "swash_plate", 0)),
        strict=True,
    ):
        simulated = simulate_windows(
            draw, count=3, like=measured, seed=4, variation=STILL, background="none"
        )

        assert np.sqrt(np.mean((simulated.signal - window) ** 2, axis=(1, 2))).min() < 1e-4
        assert np.abs(simulated.signal.std(axis=-1) - window.std(axis=-1)).max(axis=1).min() < 1e-4


@pytest.fixture(scope="module")
def calibration(pump: Pump) -> Calibration:
    """Calibration of a healthy pump at 10 and 15 MPa."""
    points = [
        OperatingCondition(speed=rpm(860), discharge_pressure=MPa(pressure))
        for pressure in (10, 15)
    ]
    recordings = [
        replace(
            recording_of(Twin(pump, condition, bandwidth=2600), seed=number),
            recording_id=f"healthy-{number}",
        )
        for number, condition in enumerate(points)
    ]

    return calibrate(pump, recordings, method=GaussNewton(starts=1, max_iterations=4), **SIX_VALUES)


def test_a_calibration_and_a_fault_are_enough(
    calibration: Calibration, measured: WindowSet
) -> None:
    fault = SwashPlateDefect(depth=mm(0.07), length=mm(30), width=mm(24))
    windows = synthesize(calibration, fault, count=4, like=measured, background="spectrum")

    assert set(windows.label) == {"swash_plate"}
    assert windows.synthetic.all()
    np.testing.assert_array_equal(windows.discharge_pressure, [MPa(10), MPa(15)] * 2)

    twins = [calibration.twin.with_fault(fault).at(fit.condition) for fit in calibration.fits]
    simulated = simulate_windows(
        twins, count=4, like=measured, seed=0, posterior=[calibration.posterior] * 2
    )

    np.testing.assert_array_equal(windows.signal, simulated.signal)
    assert windows.fidelity is not None
    assert (windows.fidelity.pressures, windows.fidelity.n_synthetic) == (
        (MPa(10), MPa(15)),
        4,
    )
    assert len(measured + windows) == len(measured) + 4

    elsewhere = synthesize(calibration, None, count=2, like=measured, pressure=MPa(5))
    np.testing.assert_array_equal(elsewhere.discharge_pressure, MPa(5))
    assert not any("The calibration read" in note for note in windows.notes)

    of_one = replace(
        calibration,
        posterior=replace(
            calibration.posterior,
            unknowns=replace(calibration.posterior.unknowns, channels=("cover_z",)),
        ),
    )
    noted = synthesize(of_one, fault, count=1, like=measured, values="nominal").notes[-1]

    expected = (
        "The calibration read cover_z, but not body_y, body_x: "
        "the gains of these are those of the pump"
    )
    assert noted.startswith(expected)


def test_recordings_are_cut_into_windows_that_the_synthetic_ones_are_like(
    twin: Twin, pump: Pump
) -> None:
    healthy = Twin(pump, twin.condition, bandwidth=2600)
    recordings = [replace(recording_of(healthy, seed=seed), synthetic=False) for seed in range(2)]
    windows = synthesize(healthy, twin.fault, count=2, like=recordings)

    assert windows.classes == ("normal", "swash_plate")
    assert windows.signal.shape == (2, 3, 2048)
    assert windows.fidelity is None  # no recording of the class
    assert windows.sample_rate == 6400.0

    short = synthesize(healthy, None, count=1, like=recordings, window=1024)
    assert short.length == 1024
    assert set(short.label) == {"normal"}
