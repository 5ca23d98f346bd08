"""A network trained once on twins from the prior: what it says of new recordings, and when it declines."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import scipy.stats
import torch

from swashtwin.calibration import (
    AmortizedIPINN,
    AmortizedTraining,
    Calibrator,
    GaussNewton,
    Nuisances,
    Objective,
    calibrate,
    load_amortized,
    load_calibration,
    measure,
    objective_of,
    objective_without_recordings,
    save_amortized,
)
from swashtwin.calibration.methods.amortized_inputs import corrupted, measured, points_drawn, simulated
from swashtwin.calibration.methods.amortized_training import log_density_loss
from swashtwin.calibration.objective.measurement import Measurement
from swashtwin.foundation import ArtifactError, DataError, InputError, MissingFileError, MPa, mm
from swashtwin.physics import Twin
from swashtwin.pump import Interfaces, OperatingCondition, Pump, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.signals import add_noise
from swashtwin.signals.spectra import amplitude_spectrum

BAND = (0.0, 950.0)
QUICK = AmortizedTraining(twins=5000, epochs=15)
FACTORS = np.array([1, 1, 1.6, 0.7, 2.5, 1])
"""Truth over nominal."""


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15, SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6)), bandwidth=1000)


@pytest.fixture(scope="module")
def blank(twin: Twin) -> Objective:
    return objective_without_recordings(twin, band=BAND)


@pytest.fixture(scope="module")
def method(blank: Objective) -> AmortizedIPINN:
    return AmortizedIPINN.train(blank, QUICK, seed=1)


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    true = twin.with_interfaces(Interfaces.from_values(twin.values.numpy() * FACTORS))
    quiet = true.simulate(1.3, 6400.0, phase=1.0, recording_id="rec-0")
    return replace(quiet, signal=add_noise(quiet.signal, 30.0, 0))


@pytest.fixture(scope="module")
def objective(twin: Twin, recording: Recording) -> Objective:
    return objective_of(twin, measure(twin, [recording], BAND))


def with_lines(objective: Objective, change: Callable[[Measurement], Measurement]) -> Objective:
    """The objective with another measurement."""
    (one,) = objective.comparisons
    return replace(objective, comparisons=(replace(one, measurement=change(one.measurement)),))


def test_the_network_learns_what_the_prior_does_not_know(method: AmortizedIPINN) -> None:
    """A density as flat as the prior has a loss of ln 2 a coordinate."""
    losses = method.trained.losses
    assert len(losses) == QUICK.epochs
    assert losses[-1] < losses[0] < 6
    assert method.trained.held_out_loss < 6 * np.log(2) - 2


def test_its_intervals_hold_the_truth_as_often_as_they_say(method: AmortizedIPINN, blank: Objective) -> None:
    points = points_drawn(blank.unknowns, 200, seed=99)
    clean = simulated(blank, points, "lines").amplitude
    noise = 0.02 * 20 ** np.random.default_rng(0).uniform(size=(200, 1))
    generator = torch.Generator().manual_seed(0)
    lines = corrupted(clean, torch.tensor(noise, dtype=torch.float32), generator).double().numpy()
    shape = blank.comparisons[0].measured.shape
    inside = []
    for point, row, level in zip(points, lines, noise, strict=True):
        amplitude, deviation = row.reshape(shape), np.full(shape, np.sqrt(level**2 - 0.02**2))
        seen = with_lines(blank, partial(replace, amplitude=amplitude, deviation=deviation))
        reading = method.read(seen)
        inside.append((reading.lower < point) & (point < reading.upper))
        assert (reading.point > blank.unknowns.lower).all()
        assert (reading.point < blank.unknowns.upper).all()
    assert (np.mean(inside, axis=0) > 0.83).all()
    assert (np.mean(inside, axis=0) < 0.97).all()


def test_one_pass_says_what_a_recording_tells_and_what_not(
    method: AmortizedIPINN, objective: Objective, twin: Twin
) -> None:
    reading = method.read(objective)
    true = np.log(twin.values.numpy() * FACTORS)
    share = reading.deviation / objective.unknowns.deviation
    assert reading.names[:2] == ("C_sw", "K_sw")
    assert share[1] > 0.9
    assert share[4] < 0.4
    assert (reading.lower < true).all()
    assert (true < reading.upper).all()
    assert reading.notes == ()


def test_noise_widens_what_the_network_says(method: AmortizedIPINN, objective: Objective) -> None:
    noisy = with_lines(objective, lambda m: replace(m, deviation=np.full_like(m.deviation, 0.2)))
    assert method.read(noisy).deviation[4] > 1.5 * method.read(objective).deviation[4]


def test_a_pass_costs_one_simulation_and_gauss_newton_goes_on_from_it(
    method: AmortizedIPINN, objective: Objective
) -> None:
    calls: list[tuple[int, int, float]] = []
    passed = method.with_refinement("none").search(objective, seed=0, progress=lambda *call: calls.append(call))
    refined = method.search(objective, seed=0)
    rival = GaussNewton(starts=4).search(objective, seed=0)
    assert passed.simulations == len(calls) == 1
    np.testing.assert_array_equal(passed.point, method.read(objective).point)
    np.testing.assert_array_equal(refined.history.points[0], passed.point)
    assert refined.simulations < rival.simulations / 2
    np.testing.assert_allclose(refined.point, rival.point, atol=1e-3)


def test_it_calibrates_like_any_other_method(
    method: AmortizedIPINN, twin: Twin, recording: Recording, tmp_path: Path
) -> None:
    assert isinstance(method, Calibrator)
    calibration = calibrate(twin, [recording], method=method, band=BAND)
    assert calibration.method == "AmortizedIPINN"
    assert calibration.estimate("C_Hz").value == pytest.approx(2.5 * calibration.estimate("C_Hz").nominal, rel=0.15)
    assert load_calibration(calibration.save(tmp_path / "found.json")).estimates == calibration.estimates
    json.dumps(method.settings)


def test_what_it_was_not_trained_for_is_refused_by_name(
    method: AmortizedIPINN, twin: Twin, recording: Recording
) -> None:
    at_10 = twin.condition.replaced(discharge_pressure=MPa(10))
    elsewhere = replace(recording, condition=at_10)
    cases = {
        "discharge_pressure was 1.5e\\+07 in training and is 1e\\+07 here": objective_of(
            twin.at(at_10), measure(twin.at(at_10), [elsewhere], BAND)
        ),
        "orders was 7, 14, ... 63": objective_of(twin, measure(twin, [recording], (0, 800))),
        "channels was ": objective_of(twin, measure(twin, [recording.picked(recording.channels[:2])], BAND)),
        "coordinates.C_sw.lower": objective_of(twin, measure(twin, [recording], BAND), 5.0),
        "coordinates.mount.lower was absent": objective_of(
            twin, measure(twin, [recording], BAND), nuisances=Nuisances(mount=0.3)
        ),
        "topology was T1": objective_of(replace(twin, topology="T2"), measure(twin, [recording], BAND)),
        "fault.depth": objective_of(
            twin.with_fault(SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.5))),
            measure(twin, [recording], BAND),
        ),
    }
    for message, objective in cases.items():
        with pytest.raises(InputError, match=message):
            method.read(objective)


def test_the_nominal_values_are_no_part_of_what_it_was_trained_for(
    method: AmortizedIPINN, twin: Twin, objective: Objective, recording: Recording
) -> None:
    elsewhere = twin.with_interfaces(Interfaces.from_values(1.5 * twin.values.numpy()))
    space = objective.space
    bounds = dict(zip(objective.unknowns.names, zip(space.lower, space.upper, strict=True), strict=True))
    moved = objective_of(elsewhere, measure(elsewhere, [recording], BAND), bounds)
    np.testing.assert_allclose(method.read(moved).point, method.read(objective).point)


def test_lines_unlike_any_twins_are_named_in_a_note(method: AmortizedIPINN, objective: Objective) -> None:
    in_g = with_lines(objective, lambda m: replace(m, amplitude=m.amplitude / 9.80665))
    assert method.read(objective).strangeness < 1 < method.read(in_g).strangeness
    for refine in ("none", "gauss_newton"):
        (note,) = method.with_refinement(refine).search(in_g, seed=0).notes
        assert "unlike those of any twin" in note


def test_twins_of_the_prior_are_hardly_ever_called_strange(method: AmortizedIPINN, blank: Objective) -> None:
    clean = simulated(blank, points_drawn(blank.unknowns, 1000, seed=5), "lines").amplitude
    generator = torch.Generator().manual_seed(0)
    for noise in (0.02, 0.1, 0.4):
        strangeness = method.trained.usual.strangeness(corrupted(clean, torch.tensor(noise), generator), np.log(noise))
        assert (strangeness > 1).float().mean() < 0.02
        assert strangeness.median() > 0.2


def test_the_same_seed_trains_the_same_network_and_leaves_random_numbers_alone(blank: Objective) -> None:
    few = AmortizedTraining(twins=300, epochs=2)
    torch.manual_seed(3)
    expected = torch.rand(1)
    torch.manual_seed(3)
    calls: list[tuple[int, int, float]] = []
    first, again, other = (
        AmortizedIPINN.train(blank, few, seed=seed, progress=lambda *call: calls.append(call)).trained
        for seed in (0, 0, 1)
    )
    assert torch.rand(1) == expected
    assert first.losses == again.losses != other.losses
    assert [call[:2] for call in calls[:2]] == [(1, 2), (2, 2)]
    for one, two in zip(first.network.parameters(), again.network.parameters(), strict=True):
        assert torch.equal(one, two)


def test_a_saved_network_says_the_same(method: AmortizedIPINN, objective: Objective, tmp_path: Path) -> None:
    path = save_amortized(method.with_refinement("none", 7), tmp_path / "network.safetensors")
    again = load_amortized(path)
    np.testing.assert_array_equal(again.read(objective).point, method.read(objective).point)
    np.testing.assert_array_equal(again.read(objective).upper, method.read(objective).upper)
    assert again.read(objective).strangeness == method.read(objective).strangeness
    assert (again.refine, again.most_iterations, again.training) == ("none", 7, QUICK)
    assert again.trained.losses == method.trained.losses
    assert [file.name for file in tmp_path.iterdir()] == ["network.safetensors"]


def test_a_damaged_network_is_refused(method: AmortizedIPINN, tmp_path: Path) -> None:
    from safetensors.torch import save_file

    with pytest.raises(MissingFileError, match="does not exist"):
        load_amortized(tmp_path / "none.safetensors")
    path = save_amortized(method, tmp_path / "network.safetensors")
    content = path.read_bytes()
    foreign = tmp_path / "foreign.safetensors"
    save_file({"a": torch.zeros(2)}, foreign)
    broken = {
        "cut": (content[: len(content) // 2], "damaged"),
        "edited": (content[:-4] + b"\x00\x00\x80\x3f", "was changed"),
        "foreign": (foreign.read_bytes(), "holds no amortized network"),
        "widened": (content.replace(b'most_iterations\\": 20', b'most_iterations\\": 90'), "was changed"),
    }
    for name, (data, message) in broken.items():
        assert data != content
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ArtifactError, match=message):
            load_amortized(tmp_path / name)


def test_points_are_spread_as_the_priors_say(blank: Objective, twin: Twin) -> None:
    unknowns = objective_without_recordings(twin, band=BAND, nuisances=Nuisances.usual()).unknowns
    points = points_drawn(unknowns, 4000, seed=0)
    np.testing.assert_allclose(points.mean(axis=0), unknowns.center, atol=0.08)
    np.testing.assert_allclose(points.std(axis=0), unknowns.deviation, rtol=0.05)
    assert (points >= unknowns.lower).all()
    assert (points <= unknowns.upper).all()
    kurtosis = scipy.stats.kurtosis(points)
    np.testing.assert_allclose(kurtosis[:6], -1.2, atol=0.1)
    np.testing.assert_allclose(kurtosis[6:], 0, atol=0.25)


def test_the_loss_is_that_of_a_normal_density_cut_at_the_bounds() -> None:
    middle, deviation, true = np.array([0.3, -0.9, 0.99]), np.array([0.2, 0.5, 3.0]), np.array([0.1, -1.0, 0.5])
    ends = (-1 - middle) / deviation, (1 - middle) / deviation
    expected = -scipy.stats.truncnorm(*ends, loc=middle, scale=deviation).logpdf(true).sum()
    found = torch.tensor(middle)[None], torch.tensor(np.log(deviation))[None]
    assert float(log_density_loss(found, torch.tensor(true)[None])[0]) == pytest.approx(expected)


def test_a_window_holds_the_lines_whatever_its_rate(twin: Twin, objective: Objective) -> None:
    quiet = twin.simulate(1.3, 6400.0, phase=0.4)
    shown = measured(objective_of(twin, measure(twin, [quiet], BAND)), "waveform")
    window = (shown.signal[0] * shown.level.exp()).numpy()
    turns = np.abs(np.fft.rfft(window)[:, ::2]) * 2 / window.shape[1]
    orders = objective.comparisons[0].measurement.orders
    true = objective.amplitude(objective.start).reshape(3, -1).numpy()
    np.testing.assert_allclose(turns[:, orders], true, rtol=0.02, atol=0.02)
    assert amplitude_spectrum(window, 512.0)[1].max() > 0.5 * true.max()


def test_a_network_reads_waveforms_too(blank: Objective, objective: Objective, twin: Twin) -> None:
    method = AmortizedIPINN.train(blank, AmortizedTraining(read="waveform", twins=300, epochs=2, physics=0.1))
    assert np.isfinite(method.read(objective).point).all()
    with pytest.raises(DataError, match="no recording, of which"):
        method.read(blank)
    (one,) = objective.comparisons
    (recording,) = one.measurement.recordings
    short = replace(recording, signal=recording.signal[:, :500])
    with pytest.raises(DataError, match="shorter than the 2 revolutions"):
        method.read(with_lines(objective, lambda m: replace(m, recordings=(short,))))


def test_several_pressures_and_nuisances_are_learnt_together(twin: Twin) -> None:
    twins = [twin.at(twin.condition.replaced(discharge_pressure=MPa(level))) for level in (15, 10)]
    blank = objective_without_recordings(twins, twin.pump.channels[:2], band=BAND, nuisances=Nuisances.usual(gains=0.1))
    for read in ("lines", "waveform"):
        method = AmortizedIPINN.train(blank, AmortizedTraining(read=read, twins=200, epochs=1))
        assert method.trained.network.dense[-1].out_features == 2 * 12
    recordings = [one.simulate(1.3, 6400.0) for one in twins]
    names = twin.pump.channels[:2]
    pairs = [measure(one, [recording.picked(names)], BAND) for one, recording in zip(twins, recordings, strict=True)]
    reading = method.read(objective_of(twins, pairs, nuisances=Nuisances.usual(gains=0.1)))
    assert len(reading.point) == len(reading.names) == 12


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"twins": 10}, "at least 100"),
        ({"learning_rate": 2.0}, "such as 3e-3"),
        ({"physics": -1.0}, "positive weight"),
    ],
)
def test_impossible_trainings_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        AmortizedTraining(**settings)  # type: ignore[arg-type]


def test_impossible_refinements_and_measurements_are_refused(method: AmortizedIPINN, twin: Twin) -> None:
    with pytest.raises(InputError, match="at least 1"):
        method.with_refinement("gauss_newton", 0)
    with pytest.raises(InputError, match="no sensor 'north'"):
        objective_without_recordings(twin, ["north"])
    with pytest.raises(InputError, match="holds no multiple"):
        objective_without_recordings(twin, band=(0, 50))
    with pytest.raises(InputError, match="lower learning_rate"):
        AmortizedIPINN.train(
            objective_without_recordings(twin, band=BAND),
            AmortizedTraining(twins=200, epochs=3, physics=1e300),
        )
