"""Synthetic windows: of the right layout, marked, seeded, varied, and never in a test set."""

from dataclasses import replace

import numpy as np
import pytest

from swashtwin.bench import rig_recordings
from swashtwin.bench.rigs.writing import RigSize
from swashtwin.calibration import Nuisances, Posterior
from swashtwin.calibration.objective.search_space import search_space
from swashtwin.calibration.objective.unknowns import unknowns_of
from swashtwin.foundation import InputError, LeakError, MPa, derive_seed, mm, stream
from swashtwin.learning import WindowSet, cut_windows, evaluate, fit_extra_trees
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump, SwashPlateDefect
from swashtwin.synthesis import Filler, TwinFiller, Variation, synthesize
from swashtwin.synthesis import twin_windows as synthesis
from swashtwin.synthesis.background import background_noise
from swashtwin.synthesis.synchronous import without_synchronous

STILL = Variation(
    speed=0.0, pressure=0.0, severity=0.0, angle=0.0, temperature=(318.15, 318.15), interfaces=0.0, sensor=0.0
)


@pytest.fixture(scope="module")
def measured() -> WindowSet:
    taken = rig_recordings(0, RigSize(1, 1, 1.0), labels=("normal", "swash_plate"))
    return cut_windows([recording for recording, _ in taken], length=2048, classes=("normal", "swash_plate"))


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15, SwashPlateDefect(depth=mm(0.06), length=mm(30), width=mm(24)))


def test_synthetic_windows_join_the_measured_ones(twin: Twin, measured: WindowSet) -> None:
    synthetic = synthesize(twin, label="swash_plate", count=4, like=measured, seed=0)
    joined = measured + synthetic
    assert joined.synthetic.sum() == 4
    assert set(joined.label[joined.synthetic]) == {"swash_plate"}
    np.testing.assert_allclose(synthetic.discharge_pressure, MPa(15))
    assert len(set(synthetic.recording_id)) == 4


def test_the_same_seed_gives_the_same_windows_and_another_seed_others(twin: Twin, measured: WindowSet) -> None:
    first, again, other = (
        synthesize(twin, label="swash_plate", count=2, like=measured, seed=seed).signal for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.1


def test_a_window_does_not_depend_on_those_made_beside_it(
    twin: Twin, measured: WindowSet, pump: Pump, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = replace(twin, pump=replace(pump, name="other"), condition=twin.condition.replaced(speed=60.0))
    few, many = (synthesize([twin, other], label="swash_plate", count=count, like=measured, seed=0) for count in (3, 7))
    monkeypatch.setattr(synthesis, "_CHUNK", 2)
    chunked = synthesize([twin, other], label="swash_plate", count=7, like=measured, seed=0)
    np.testing.assert_array_equal(many.signal[:3], few.signal)
    np.testing.assert_array_equal(many.signal, chunked.signal)
    np.testing.assert_array_equal(many.recording_id, chunked.recording_id)
    np.testing.assert_array_equal(many.speed[1::2], 60.0)


def test_no_score_is_given_on_synthetic_windows(twin: Twin, measured: WindowSet) -> None:
    trees = fit_extra_trees(measured, seed=0, n_trees=5)
    synthetic = synthesize(twin, label="swash_plate", count=2, like=measured, seed=0)
    with pytest.raises(LeakError, match="synthetic"):
        evaluate(trees, synthetic)


def test_without_variation_and_noise_a_window_is_the_twin_s_simulation(twin: Twin, measured: WindowSet) -> None:
    bare = synthesize(
        twin, label="swash_plate", count=2, like=measured, seed=0, variation=STILL, background=False
    ).signal
    simulated = twin.simulate(2048 / 25600, 25600.0).signal
    np.testing.assert_allclose(bare.std(axis=2), np.tile(simulated.std(axis=1), (2, 1)), rtol=0.05)


def test_the_background_has_the_level_of_the_measured_noise(twin: Twin, measured: WindowSet) -> None:
    """Above the twin's band there is nothing but noise, in measured and synthetic windows alike."""
    synthetic = synthesize(twin, label="swash_plate", count=12, like=measured, seed=0)

    def above_6_kHz(windows: WindowSet) -> np.ndarray:
        spectrum = np.abs(np.fft.rfft(windows.signal, axis=2)) ** 2
        return np.sqrt(spectrum[:, :, 500:].mean(axis=(0, 2)))

    at_15 = measured.discharge_pressure == MPa(15)
    normal = measured.subset(at_15 & (measured.label == "normal"))
    np.testing.assert_allclose(above_6_kHz(synthetic), above_6_kHz(normal), rtol=0.25)


def test_a_strong_line_between_bins_does_not_raise_the_background_far_from_it(twin: Twin, measured: WindowSet) -> None:
    noise = 0.01 * stream(0, "noise").normal(size=(1, measured.signal.shape[1], 2048))
    line = 100 * np.sin(2 * np.pi * 100.5 * np.arange(2048) / 2048)
    loud = replace(measured.subset(np.array([0])), signal=(noise + line).astype(np.float32))
    drawn = background_noise(loud, twin, "spectrum").drawn(stream(0, "drawn"))
    far = [np.abs(np.fft.rfft(one, axis=-1))[..., 400:-1] for one in (drawn, noise[0])]
    assert np.sqrt(np.mean(far[0] ** 2)) < 1.5 * np.sqrt(np.mean(far[1] ** 2))


def test_severity_spreads_as_asked(twin: Twin, measured: WindowSet) -> None:
    calm = replace(STILL, severity=0.0)
    wild = replace(STILL, severity=0.5)
    levels = [
        synthesize(
            twin, label="swash_plate", count=10, like=measured, seed=0, variation=v, background=False
        ).signal.std(axis=2)[:, 0]
        for v in (calm, wild)
    ]
    assert levels[1].std() > 5 * levels[0].std()


def test_several_twins_take_turns(twin: Twin, measured: WindowSet, pump: Pump) -> None:
    other = replace(twin, pump=replace(pump, name="other"))
    synthetic = synthesize([twin, other], label="swash_plate", count=4, like=measured, seed=0)
    assert list(synthetic.specimen) == [f"twin of {name}" for name in (pump.name, "other") * 2]


def test_what_does_not_fit_is_refused(twin: Twin, measured: WindowSet, pump: Pump) -> None:
    with pytest.raises(InputError, match="not 'normal'"):
        synthesize(twin, label="normal", count=1, like=measured, seed=0)
    with pytest.raises(InputError, match="not among the windows' classes"):
        synthesize(twin, label="piston", count=1, like=measured, seed=0)
    with pytest.raises(InputError, match="at least 1"):
        synthesize(twin, label="swash_plate", count=0, like=measured, seed=0)
    deaf = replace(twin, pump=replace(pump, sensors=pump.sensors[:1]))
    with pytest.raises(InputError, match="are not the windows' channels"):
        synthesize(deaf, label="swash_plate", count=1, like=measured, seed=0)
    only_synthetic = synthesize(twin, label="swash_plate", count=2, like=measured, seed=0)
    with pytest.raises(InputError, match="background=False"):
        synthesize(twin, label="swash_plate", count=1, like=only_synthetic, seed=0)


@pytest.fixture(scope="module")
def posterior(twin: Twin) -> Posterior:
    """All six values within 20 %, the mounting and the sensors within their priors."""
    unknowns = unknowns_of(twin, twin.pump.channels, search_space(twin), Nuisances.usual(gains=0.1))
    deviation = np.where(np.arange(len(unknowns)) < 6, 0.2, unknowns.deviation)
    return Posterior(unknowns, twin.pump.channels, unknowns.start, np.diag(deviation**2))


def test_windows_of_a_posterior_are_those_of_its_draws(twin: Twin, measured: WindowSet, posterior: Posterior) -> None:
    made = synthesize(
        twin,
        label="swash_plate",
        count=3,
        like=measured,
        seed=4,
        variation=STILL,
        background=False,
        posterior=posterior,
    )
    for window, drawn in zip(
        made.signal, posterior.twins(twin, 3, derive_seed(4, "posterior", "swash_plate", 0)), strict=True
    ):
        own = synthesize(drawn, label="swash_plate", count=3, like=measured, seed=4, variation=STILL, background=False)
        assert np.sqrt(np.mean((own.signal - window) ** 2, axis=(1, 2))).min() < 1e-4
        assert np.abs(own.signal.std(axis=-1) - window.std(axis=-1)).max(axis=1).min() < 1e-4


def test_a_posterior_spreads_the_levels_and_its_draws_do_not_depend_on_the_count(
    twin: Twin, measured: WindowSet, posterior: Posterior
) -> None:
    still = {"label": "swash_plate", "like": measured, "seed": 0, "variation": STILL, "background": False}
    plain = synthesize(twin, count=8, **still).signal.std(axis=-1)
    spread = synthesize(twin, count=8, **still, posterior=posterior).signal
    assert spread.std(axis=-1).std(axis=0).min() > 5 * plain.std(axis=0).max()
    few = synthesize(twin, count=3, **still, posterior=posterior).signal
    np.testing.assert_array_equal(few, spread[:3])


def test_each_twin_has_its_own_posterior(twin: Twin, measured: WindowSet, posterior: Posterior, pump: Pump) -> None:
    exact = replace(posterior, covariance=np.eye(len(posterior.unknowns)) * 1e-18)
    pair = [twin, replace(twin, pump=replace(pump, name="other"))]
    still = {"label": "swash_plate", "like": measured, "seed": 0, "variation": STILL, "background": False}
    made = synthesize(pair, count=4, **still, posterior=[exact, posterior]).signal.std(axis=-1)
    assert np.abs(made[0] - made[2]).max() < 0.01 * np.abs(made[1] - made[3]).max()
    alike = synthesize(pair, count=2, **still, posterior=[posterior, posterior]).signal.std(axis=-1)
    assert np.abs(alike[0] / alike[1] - 1).max() > 0.01  # two pumps do not share a draw
    with pytest.raises(InputError, match="1 posteriors for 2 twins"):
        synthesize(pair, count=4, **still, posterior=posterior)


def test_without_its_synchronous_part_a_steady_machine_is_its_noise() -> None:
    rng, period, length = stream(0, "synchronous"), 250.0, 300
    rate = 1 + 0.004 * rng.uniform(-1, 1, 40)
    angle = 2 * np.pi * (rng.random((40, 1)) + np.arange(length) * rate[:, None] / period)
    turning = np.stack([np.sin(7 * angle) + np.cos(angle), 2 * np.cos(14 * angle + 1)], axis=1)
    noise = 0.3 * rng.normal(size=turning.shape)
    left = without_synchronous(turning + noise, period)
    np.testing.assert_allclose(left.std(axis=(0, 2)), 0.3, rtol=0.1)
    likeness = [np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in zip(left, noise, strict=True)]
    assert np.median(likeness) > 0.9


def test_a_residual_is_laid_under_the_windows_as_it_was_measured(twin: Twin, measured: WindowSet) -> None:
    over, bare = (
        synthesize(twin, label="swash_plate", count=12, like=measured, seed=0, background=kind).signal.astype(float)
        for kind in ("residual", "none")
    )
    spectrum = np.abs(np.fft.rfft(over - bare, axis=2)) ** 2
    at_15 = measured.discharge_pressure == MPa(15)
    normal = np.abs(np.fft.rfft(measured.signal[at_15 & (measured.label == "normal")], axis=2)) ** 2
    above = np.sqrt(spectrum[:, :, 500:].mean(axis=(0, 2)) / normal[:, :, 500:].mean(axis=(0, 2)))
    np.testing.assert_allclose(above, 1.0, rtol=0.25)  # above 6 kHz there is only noise
    passing = np.round(7 * twin.condition.shaft_frequency * np.arange(1, 6) * measured.length / measured.sample_rate)
    assert (
        spectrum[:, :, passing.astype(int)].mean(axis=(0, 2))
        < 0.5 * normal[:, :, passing.astype(int)].mean(axis=(0, 2))
    ).all()


def test_a_machine_lends_its_twin_its_own_noise(twin: Twin, measured: WindowSet) -> None:
    loud = replace(measured, signal=measured.signal * np.float32(20), specimen=np.full(len(measured), "loud"))
    both = measured + loud
    asked = {"label": "swash_plate", "count": 4, "like": both, "seed": 0}
    quiet_machine = str(measured.specimen[0])
    bare = synthesize([twin, twin], background="none", **asked).signal
    level = [
        (synthesize([twin, twin], machines=pair, **asked).signal - bare).std(axis=(1, 2))
        for pair in ((quiet_machine, quiet_machine), (quiet_machine, "loud"))
    ]
    np.testing.assert_array_equal(level[0][::2], level[1][::2])
    np.testing.assert_allclose(level[1][1::2], 20 * level[0][1::2], rtol=1e-3)
    with pytest.raises(InputError, match="1 machines for 2 twins"):
        synthesize([twin, twin], machines=["loud"], **asked)
    with pytest.raises(InputError, match="no measured window of p9"):
        synthesize([twin], machines=["p9"], **asked)


def test_a_residual_takes_several_windows_of_a_recording(twin: Twin, measured: WindowSet) -> None:
    few = measured.subset(np.arange(2))
    with pytest.raises(InputError, match="4 windows of one recording"):
        synthesize(twin, label="swash_plate", count=1, like=few, seed=0, background="residual")


def test_twins_stand_behind_the_same_protocol_as_data(twin: Twin, measured: WindowSet, posterior: Posterior) -> None:
    healthy = twin.with_fault(None)
    filler = TwinFiller([healthy, twin], background="none", variation=STILL)
    assert isinstance(filler, Filler)
    made = filler(measured, label="swash_plate", pressure=MPa(10), count=3, seed=0)
    at_10 = twin.at(twin.condition.replaced(discharge_pressure=MPa(10)))
    own = synthesize(at_10, label="swash_plate", count=3, like=measured, seed=0, background=False, variation=STILL)
    np.testing.assert_array_equal(made.signal, own.signal)
    np.testing.assert_array_equal(made.discharge_pressure, MPa(10))
    drawing = replace(filler, posterior=[posterior, posterior])
    drawn = drawing(measured, label="swash_plate", pressure=float("nan"), count=3, seed=0)
    np.testing.assert_array_equal(drawn.discharge_pressure, MPa(15))
    assert np.abs(drawn.signal.std(axis=2) / made.signal.std(axis=2) - 1).max() > 0.01
    with pytest.raises(InputError, match="no twin simulates 'piston'"):
        filler(measured, label="piston", pressure=MPa(10), count=3, seed=0)
