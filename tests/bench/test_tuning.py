"""A search for settings looks at training recordings only, and goes on where it stopped."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swashtwin.bench import run_tuning
from swashtwin.bench.questions import tuning
from swashtwin.bench.questions.tuning import _space, validation_folds
from swashtwin.bench.rivals.models import MODELS
from swashtwin.bench.studies.cases import SCENARIOS
from swashtwin.bench.studies.scenario import split_scenario
from swashtwin.foundation import InputError
from swashtwin.recordings import Recording

pytest.importorskip("optuna", reason="optuna is not installed")


@pytest.fixture
def trained_models(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Models that were trained, by a training that is none."""
    models: list[Any] = []

    def scored(model: Any, windows: Any, folds: Any, *_: Any) -> tuple[float, ...]:
        models.append((model, windows, folds))
        return tuple(0.5 + model.training.learning_rate + 0.01 * number for number in range(len(folds)))

    few = {"windows": 2, "scarce_windows": 3, "held_out": 1}
    monkeypatch.setitem(SCENARIOS, "quick", replace(SCENARIOS["quick"], **few))
    monkeypatch.setattr(tuning, "validate", scored)
    return models


def test_a_search_sees_no_test_recording_and_validates_on_pumps_it_left_out(
    recordings: list[Recording], trained_models: list[Any], tmp_path: Path
) -> None:
    run_tuning(recordings, model="bitcn", trials=1, out=tmp_path)
    _, windows, folds = trained_models[0]
    split = split_scenario(recordings, SCENARIOS["quick"], 0)
    tested = frozenset.union(*split.tests.values()) | split.references
    assert not tested & set(windows.recording_id.tolist())
    assert len(folds) == 2
    for trained, validation in folds:
        assert not set(windows.specimen[trained]) & set(windows.specimen[validation])
        assert not set(trained) & set(validation)


@pytest.mark.parametrize("name", ["bitcn", "spectral_bitcn"])
def test_the_first_candidate_is_the_studys_own_model_unchanged(
    recordings: list[Recording], trained_models: list[Any], tmp_path: Path, name: str
) -> None:
    table = run_tuning(recordings, model=name, trials=3, out=tmp_path)
    study_model = MODELS["quick"][name]
    assert trained_models[0][0] == study_model
    assert study_model not in [model for model, *_ in trained_models[1:]]
    candidates = table.details["candidates"]
    assert [candidate["unchanged"] for candidate in candidates] == [True, False, False]
    assert candidates[0]["settings"]["weight_decay"] == study_model.training.weight_decay


def test_an_interrupt_does_not_lose_the_studys_own_model(
    recordings: list[Recording], trained_models: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(tuning, "validate", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_tuning(recordings, model="bitcn", trials=2, out=tmp_path)
    table = run_tuning(recordings, model="bitcn", trials=2, out=tmp_path)
    study_model = MODELS["quick"]["bitcn"]
    assert [model == study_model for model, *_ in trained_models] == [True, False]
    (marked,) = [candidate for candidate in table.details["candidates"] if candidate["unchanged"]]
    assert f"the study's own settings: {np.mean(marked['recall']):.3f}" in table.answer[0]


def test_a_search_goes_on_where_it_stopped(
    recordings: list[Recording], trained_models: list[Any], tmp_path: Path
) -> None:
    first = run_tuning(recordings, model="bitcn", trials=2, out=tmp_path)
    learning_rate = trained_models[0][0].training.learning_rate
    more = run_tuning(recordings, model="bitcn", trials=5, out=tmp_path)
    assert len(trained_models) == 5
    assert len(first.details["candidates"]) == 2
    candidates = more.details["candidates"]
    assert candidates[:2] == first.details["candidates"]
    assert candidates[0]["settings"]["learning_rate"] == pytest.approx(learning_rate)
    means = [row["recall"]["mean"] for row in more.rows()]
    assert means == sorted(means, reverse=True)
    assert more.settings["best"] in [candidate["settings"] for candidate in candidates]
    run_tuning(recordings, model="bitcn", trials=5, out=tmp_path)
    assert len(trained_models) == 5
    assert len(list((tmp_path / "tune").glob("*.journal"))) == 1


def test_another_seed_is_another_search(recordings: list[Recording], trained_models: list[Any], tmp_path: Path) -> None:
    for seed in (0, 1):
        run_tuning(recordings, model="bitcn", trials=1, seed=seed, out=tmp_path)
    assert len(trained_models) == 2


def test_what_cannot_be_searched_is_refused(
    recordings: list[Recording], trained_models: list[Any], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="has no settings to search"):
        run_tuning(recordings, model="extra_trees", trials=1, out=tmp_path)
    run_tuning(recordings, model="bitcn", trials=1, out=tmp_path)
    windows = trained_models[0][1]
    with pytest.raises(InputError, match="needs two to train on"):
        validation_folds(windows.subset(np.flatnonzero(windows.specimen == windows.specimen[0])))


@pytest.mark.parametrize(("model", "sought"), [("spectral_bitcn", 3), ("spectral_noise", 2), ("spectral_gain", 1)])
def test_no_candidate_scales_away_what_training_changes(model: str, sought: int) -> None:
    space = _space(MODELS["quick"][model])
    assert len(space["normalization"]) == sought
    for name in space["normalization"]:
        MODELS["quick"][model].with_training(normalization=name)
