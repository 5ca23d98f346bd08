"""The methods that search: all minimize the same thing, count what they simulate, and leave no trace behind."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from swashtwin.calibration import (
    CMAES,
    IPINN,
    LBFGS,
    Calibrator,
    DirectAdam,
    GaussNewton,
    Nuisances,
    Objective,
    choose_learning_rate,
    measure,
    objective_of,
)
from swashtwin.calibration.methods.ipinn import spectrum_loss_of
from swashtwin.calibration.methods.search import EXACT, History, Progress, Search, with_priors
from swashtwin.foundation import DataError, InputError, MissingExtraError, mm
from swashtwin.physics import HarmonicBalance, Twin
from swashtwin.pump import Interfaces, OperatingCondition, Pump, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.signals import add_noise

FACTORS = np.array([1, 1, 1.6, 0.7, 2.5, 1])
"""Truth over nominal."""
QUICK: dict[str, Calibrator] = {
    "gauss_newton": GaussNewton(starts=2),
    "lbfgs": LBFGS(starts=2),
    "direct_adam": DirectAdam(starts=2, epochs=12),
    "cma_es": CMAES(most_simulations=60),
    "ipinn": IPINN(epochs=6),
}
"""Every method, cut short."""
each_method = pytest.mark.parametrize("method", QUICK.values(), ids=QUICK)


def recording_of(twin: Twin, seed: int = 0) -> Recording:
    """Noisy recording of the twin with its values times `FACTORS`."""
    true = twin.with_interfaces(Interfaces.from_values(twin.values.numpy() * FACTORS))
    recording = true.simulate(1.3, 6400.0, phase=1.0 + seed, recording_id=f"rec-{seed}")
    return replace(recording, signal=add_noise(recording.signal, 30, seed))


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15, SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6)), bandwidth=2600)


@pytest.fixture(scope="module")
def objective(twin: Twin) -> Objective:
    return objective_of(twin, measure(twin, [recording_of(twin)]))


@pytest.fixture(scope="module")
def constants(twin: Twin) -> Objective:
    """The same, with constants beside the six values."""
    return objective_of(twin, measure(twin, [recording_of(twin)]), None, Nuisances.usual())


class CountingSolver:
    """Harmonic balance that counts its calls and the parameter sets in them."""

    def __init__(self) -> None:
        self.calls = self.sets = 0

    def steady_state(
        self, mass: Tensor, damping: Tensor, stiffness: Tensor, frequency: Tensor, force: Tensor
    ) -> Tensor:
        """Complex amplitudes of the motion."""
        self.calls += 1
        self.sets += damping.shape[:-2].numel()
        return HarmonicBalance().steady_state(mass, damping, stiffness, frequency, force)


@pytest.mark.parametrize(
    "method", [LBFGS(starts=1), CMAES(), DirectAdam(epochs=300)], ids=["lbfgs", "cma_es", "direct_adam"]
)
def test_every_rival_finds_the_minimum_that_gauss_newton_finds(objective: Objective, method: Calibrator) -> None:
    expected = GaussNewton(starts=1).search(objective, seed=0)
    search = method.search(objective, seed=0)
    assert search.history.least_loss == pytest.approx(expected.history.least_loss, rel=1e-3)
    np.testing.assert_allclose(search.point, expected.point, atol=0.02)


def test_rivals_find_constants_beside_the_values(constants: Objective) -> None:
    expected = GaussNewton(starts=1).search(constants, seed=0)
    search = LBFGS(starts=1).search(constants, seed=0)
    assert len(search.point) == 10
    assert search.history.least_loss == pytest.approx(expected.history.least_loss, rel=1e-3)


@each_method
def test_simulations_are_counted_as_the_solver_counts_them(objective: Objective, method: Calibrator) -> None:
    solver = CountingSolver()
    search = replace(method, solver=solver).search(objective, seed=0)  # type: ignore[type-var]
    # Gauss-Newton asks for one point in six directions at once.
    assert search.simulations == (solver.calls if isinstance(method, GaussNewton) else solver.sets)


@each_method
def test_the_step_of_least_loss_is_kept(objective: Objective, method: Calibrator) -> None:
    assert isinstance(method, Calibrator)
    search = method.search(objective, seed=0)
    history = search.history
    assert history.best == np.argmin(history.loss)
    np.testing.assert_array_equal(search.point, history.points[history.best])
    point = torch.as_tensor(search.point)
    weighted = objective.weighted_loss(point)
    if not isinstance(method, IPINN):
        assert history.spectrum_loss[history.best] == pytest.approx(weighted.item())
        assert history.least_loss == pytest.approx(with_priors(objective, point, weighted).item())
    assert len(history.gradient_norm) == (0 if isinstance(method, CMAES) else len(history.loss))
    assert (history.gradient_norm > 0).all()


@each_method
def test_the_same_seed_gives_the_same_bits_and_leaves_random_numbers_as_they_were(
    objective: Objective, method: Calibrator
) -> None:
    torch.manual_seed(1)
    np.random.seed(1)  # noqa: NPY002  # what a library might change
    expected = torch.rand(1), np.random.rand()  # noqa: NPY002
    torch.manual_seed(1)
    np.random.seed(1)  # noqa: NPY002
    first = method.search(objective, seed=5)
    assert (torch.rand(1), np.random.rand()) == expected  # noqa: NPY002
    again = method.search(objective, seed=5)
    np.testing.assert_array_equal(first.history.points, again.history.points)
    np.testing.assert_array_equal(first.point, again.point)


@pytest.mark.parametrize("method", [CMAES(most_simulations=60), IPINN(epochs=3)], ids=["cma_es", "ipinn"])
def test_another_seed_searches_elsewhere(objective: Objective, method: Calibrator) -> None:
    first, other = (method.search(objective, seed=seed).history.points for seed in (0, 1))
    assert not np.array_equal(first[-1], other[-1])


def test_a_generation_cut_off_by_its_limit_says_so(objective: Objective) -> None:
    cut, whole = (method.search(objective, seed=0) for method in (CMAES(most_simulations=60), CMAES()))
    assert "before it converged" in cut.notes[-1]
    assert not whole.notes


def test_starts_that_are_moved_at_once_go_as_they_would_alone(objective: Objective) -> None:
    """Adam moves each coordinate by its own gradient."""
    alone, among = (DirectAdam(starts=starts, epochs=40).search(objective, seed=0) for starts in (1, 3))
    assert among.simulations == 3 * alone.simulations == 120
    assert among.history.least_loss <= alone.history.least_loss * (1 + 1e-12)


@pytest.mark.parametrize("name", ["gauss_newton", "lbfgs", "cma_es", "direct_adam"])
def test_a_bound_stops_every_rival(twin: Twin, name: str) -> None:
    method = DirectAdam(epochs=150) if name == "direct_adam" else QUICK[name]
    objective = objective_of(twin, measure(twin, [recording_of(twin)]), 1.2)
    search = method.search(objective, seed=0)
    unknowns = objective.unknowns
    assert (search.history.points >= unknowns.lower - 1e-12).all()
    assert (search.history.points <= unknowns.upper + 1e-12).all()
    assert search.point[4] == pytest.approx(unknowns.upper[4], abs=0.02)


@each_method
def test_an_interrupt_passes_through_every_method(objective: Objective, method: Calibrator) -> None:
    threads = torch.get_num_threads()

    def stop(step: int, total: int, loss: float) -> None:
        assert 0 < step <= total
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        method.search(objective, seed=0, progress=stop)
    assert torch.get_num_threads() == threads


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LBFGS(starts=0), "at least 1"),
        (lambda: DirectAdam(epochs=0), "at least 1"),
        (lambda: DirectAdam(learning_rate=5), "such as 0.05"),
        (lambda: CMAES(most_simulations=0), "at least 1"),
        (lambda: CMAES(population=3), "must be at least 1 and population"),
        (lambda: CMAES(width=0.0), "such as 0.25"),
        (lambda: IPINN(patience=0), "None for all epochs"),
    ],
)
def test_impossible_settings_are_refused(make: Callable[[], Calibrator], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_a_missing_library_is_named_with_its_remedy(objective: Objective, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("cma", "optuna"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=r'needs cma, .*pip install "swashtwin\[search\]"'):
        CMAES().search(objective, seed=0)
    with pytest.raises(MissingExtraError, match="needs optuna"):
        choose_learning_rate(objective)


# The network's choices


def test_the_network_stops_when_patience_ends(objective: Objective) -> None:
    search = IPINN(epochs=200, learning_rate=0.05, patience=4).search(objective, seed=0)
    assert search.simulations == len(search.history.loss) < 200
    assert len(search.history.loss) - 1 - search.history.best == 4


def test_a_cosine_brings_the_step_size_to_zero(objective: Objective) -> None:
    def last_step(method: IPINN | DirectAdam) -> float:
        return float(np.abs(np.diff(method.search(objective, seed=0).history.points[-2:], axis=0)).max())

    assert last_step(IPINN(epochs=30, decay="cosine")) < last_step(IPINN(epochs=30)) / 5
    assert last_step(DirectAdam(epochs=30)) < last_step(DirectAdam(epochs=30, decay="constant")) / 5


def test_without_its_loss_a_bound_still_holds(twin: Twin) -> None:
    objective = objective_of(twin, measure(twin, [recording_of(twin)], (0, 1000)), 2.0)
    with_loss, without = (
        IPINN(epochs=25, learning_rate=0.05, boundary=flag).search(objective, seed=0).history for flag in (True, False)
    )
    assert with_loss.boundary_loss.max() > 0
    np.testing.assert_array_equal(without.boundary_loss, 0)
    assert (without.points <= objective.unknowns.upper + 1e-12).all()


def test_the_papers_recipe_counts_no_prior_of_the_six_values(objective: Objective, constants: Objective) -> None:
    paper, ours = (IPINN(epochs=8, priors=which).search(objective, seed=0).history for which in ("constants", "all"))  # type: ignore[arg-type]
    np.testing.assert_array_equal(paper.prior_loss, 0)
    assert (np.diff(paper.points, axis=0) != 0).any()
    assert ours.prior_loss[-1] > 0
    assert IPINN(epochs=8).search(constants, seed=0).history.prior_loss[-1] > 0


def test_the_improved_network_minimizes_what_its_rivals_do(objective: Objective) -> None:
    history = IPINN.improved(epochs=5, learning_rate=0.01).search(objective, seed=0).history
    points = torch.as_tensor(history.points)
    weighted = objective.weighted_loss(points)
    np.testing.assert_allclose(history.spectrum_loss, weighted)
    np.testing.assert_allclose(history.loss - history.boundary_loss, with_priors(objective, points, weighted))


def test_logarithms_of_lines_count_as_lines_do_near_the_measured_ones(objective: Objective) -> None:
    point = torch.as_tensor(GaussNewton(starts=1).search(objective, seed=0).point)
    logarithmic, weighted = (spectrum_loss_of(objective, kind, point, EXACT) for kind in ("logarithmic", "weighted"))
    assert logarithmic.item() == pytest.approx(weighted.item(), rel=0.25)
    assert spectrum_loss_of(objective, "linear", point, EXACT) == objective.spectrum_loss(point)


def test_a_line_at_the_noise_does_not_rule_the_logarithms(objective: Objective) -> None:
    """A line measured at 1e-9 m/s^2 is a hundred decibels off, and yet adds next to nothing."""
    (comparison,) = objective.comparisons
    amplitude = comparison.measurement.amplitude.copy()
    amplitude[0, 3] = 1e-9
    dead = replace(
        objective, comparisons=(replace(comparison, measurement=replace(comparison.measurement, amplitude=amplitude)),)
    )
    before, after = (spectrum_loss_of(which, "logarithmic", which.start, EXACT).item() for which in (objective, dead))
    assert after <= before * 1.01


def test_the_network_without_magnitudes_stands_still(objective: Objective) -> None:
    plain, scaled = (
        IPINN(epochs=20, values=kind).search(objective, seed=0).history for kind in ("plain", "base_values")
    )  # type: ignore[arg-type]
    moved, wanted = (np.abs(history.points[-1] - history.points[0]).max() for history in (plain, scaled))
    assert moved < wanted / 100


def test_the_network_reads_the_first_recording_or_all(twin: Twin) -> None:
    first, second = recording_of(twin, 0), recording_of(twin, 1)
    other = replace(second, signal=add_noise(second.signal, 0, 7))
    measurement = measure(twin, [first, second])
    pairs = [objective_of(twin, replace(measurement, recordings=pair)) for pair in ((first, second), (first, other))]

    def paths(recordings: str) -> list[np.ndarray]:
        method = IPINN(epochs=4, recordings=recordings)  # type: ignore[arg-type]
        return [method.search(objective, seed=0).history.points for objective in pairs]

    np.testing.assert_array_equal(*paths("first"))
    read = paths("all")
    assert not np.array_equal(*read)
    for points in read:
        np.testing.assert_allclose(points[0], pairs[0].unknowns.start, atol=1e-6)


def test_a_history_without_priors_and_gradients_has_none() -> None:
    history = History(np.array([2.0, 1.0]), np.array([0.5, 0.0]), np.zeros((2, 6)), 1)
    np.testing.assert_array_equal(history.loss, [2.5, 1.0])
    assert history.gradient_norm.size == 0


# The learning rate


@dataclass(frozen=True)
class Recorder(IPINN):
    """A network that finds the nominal values, nearer the truth the closer its rate is to 0.01; it keeps its rates."""

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """A point that the rate alone decides."""
        TRIED.append(self.learning_rate)
        if self.learning_rate == 0.1:
            raise InputError("the loss is nan in epoch 3; lower learning_rate.")
        if len(TRIED) == STOP_AT[0]:
            raise KeyboardInterrupt
        share = 1 - abs(np.log10(self.learning_rate) + 2) / 4
        point = objective.unknowns.start.copy()
        point[:6] += share * np.log(FACTORS)
        return Search(point, History(np.ones(1), np.zeros(1), point[None], 0), 1)


TRIED: list[float] = []
STOP_AT = [0]


@pytest.fixture
def tried() -> list[float]:
    TRIED.clear()
    STOP_AT[0] = 0
    return TRIED


def test_the_best_rate_of_the_papers_grid_is_chosen(objective: Objective, tried: list[float]) -> None:
    calls: list[tuple[int, int, float]] = []
    chosen = choose_learning_rate(objective, Recorder(), progress=lambda *call: calls.append(call))
    assert sorted(tried) == [0.0001, 0.001, 0.01, 0.1]
    assert chosen.rates == (0.1, 0.01, 0.001, 0.0001)
    assert chosen.best == chosen.method.learning_rate == 0.01
    assert chosen.weighted_losses[0] == np.inf
    assert list(chosen.weighted_losses[1:]) == sorted(chosen.weighted_losses[1:])
    assert [call[:2] for call in calls] == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_a_study_in_a_file_goes_on_after_an_interrupt(objective: Objective, tried: list[float], tmp_path: Path) -> None:
    path = tmp_path / "rates.db"
    STOP_AT[0] = 2
    rates = (0.01, 0.001, 0.0001)
    with pytest.raises(KeyboardInterrupt):
        choose_learning_rate(objective, Recorder(), rates, storage=path)
    assert len(tried) == 2
    STOP_AT[0] = 0
    resumed = choose_learning_rate(objective, Recorder(), rates, storage=path)
    assert len(tried) == 4  # the first is kept, the second begun anew
    assert resumed == choose_learning_rate(objective, Recorder(), rates, storage=path)
    assert len(tried) == 4
    assert resumed.weighted_losses == choose_learning_rate(objective, Recorder(), rates).weighted_losses
    choose_learning_rate(objective, Recorder(), rates, storage=path, seed=1)
    assert len(tried) == 10  # another seed is another study


def test_a_rate_is_chosen_for_a_real_search(objective: Objective) -> None:
    chosen = choose_learning_rate(objective, DirectAdam(epochs=60), (0.05, 0.0001))
    assert chosen.best == 0.05
    assert chosen.weighted_losses[0] < chosen.weighted_losses[1] / 2


def test_impossible_rates_and_files_are_refused(objective: Objective, tmp_path: Path) -> None:
    for rates in ((), (0.1, 2.0)):
        with pytest.raises(InputError, match=r"must each lie within 0\.\.\.1"):
            choose_learning_rate(objective, rates=rates)
    text = tmp_path / "notes.txt"
    text.write_text("not a data base, but long enough to be taken for one" * 100)
    for path in (text, tmp_path / "none" / "rates.db"):
        with pytest.raises(DataError, match=f"{path.name}: no study can be stored there"):
            choose_learning_rate(objective, storage=path)
    assert text.read_text().startswith("not a data base")
