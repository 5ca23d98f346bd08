"""t-SNE of what networks make of the test windows: which trainings are shown, and what they are called."""

from dataclasses import replace

import numpy as np
import pytest
from stub_runs import embedding, run

from swashtwin.learning import Epoch
from swashtwin_bench import StudyResult, plan_of
from swashtwin_bench.results.runs import Run
from swashtwin_bench.results.study_figures import MOST_PANELS, embedding_drawing
from swashtwin_bench.studies.runner import assemble_result


def trained(classifier: str, training_set: str = "calibrated", seed: int = 0, **varied: str) -> Run:
    base = run(training_set, seed, 0.8, classifier)
    factors = {**base.task.factors, **varied}
    outcomes = tuple(replace(outcome, factors={**outcome.factors, **varied}) for outcome in base.outcomes)
    task = replace(base.task, factors=factors)
    return replace(base, task=task, outcomes=outcomes, history=(Epoch(1, 1.0, 0.5),), embedding=embedding(factors))


def drawn(study: StudyResult) -> tuple[str, set[str]]:
    drawing = embedding_drawing(study, "made")
    return drawing.svg, set(zip(*(drawing.columns[name] for name in ("classifier", "training_set")), strict=True))


@pytest.fixture(scope="module")
def algorithms() -> StudyResult:
    runs = [trained(name, seed=seed) for seed in (0, 1) for name in ("spectral_bitcn", "wdcnn", "lstm")]
    return assemble_result(plan_of("algorithms", "quick"), runs)


def test_networks_of_one_training_set_stand_beside_each_other(algorithms: StudyResult) -> None:
    svg, shown = drawn(algorithms)
    assert shown == {(name, "calibrated") for name in ("spectral_bitcn", "wdcnn", "lstm")}
    assert all(title in svg for title in ("BiTCN on levels (ours)", "WDCNN", "LSTM"))


def test_of_several_training_sets_only_the_studys_own_network_is_shown() -> None:
    runs = [trained(name, kind) for kind in ("measured", "calibrated") for name in ("spectral_bitcn", "wdcnn")]
    svg, shown = drawn(assemble_result(plan_of("case1", "quick"), runs))
    assert shown == {("spectral_bitcn", "measured"), ("spectral_bitcn", "calibrated")}
    assert "WDCNN" not in svg


def test_of_many_trainings_an_even_choice_is_drawn_and_counted() -> None:
    values = ["0", "5", "10", "20", "50", "100", "200"]
    kinds = ("measured", "nominal", "calibrated")
    runs = [trained("spectral_bitcn", kind, real_windows=value) for value in values for kind in kinds]
    drawing = embedding_drawing(assemble_result(plan_of("few-shot", "quick"), runs), "made")
    shown = set(zip(drawing.columns["training_set"], drawing.columns["real_windows"], strict=True))
    assert len(shown) == MOST_PANELS
    assert {("measured", "0"), ("calibrated", "200")} <= shown
    assert f"{MOST_PANELS} of 21 trainings." in drawing.caption


def test_a_network_without_features_is_counted_and_gives_no_other_its_name() -> None:
    longer = trained("spectral_noise")
    bare = replace(trained("spectral_bitcn"), embedding=None)
    flat = trained("spectral_forward")
    assert flat.embedding is not None
    flat = replace(flat, embedding=replace(flat.embedding, features=np.ones_like(flat.embedding.features)))
    drawing = embedding_drawing(assemble_result(plan_of("ablation", "quick"), [bare, longer, flat]), "made")
    assert set(drawing.columns["classifier"]) == {"spectral_noise"}
    assert "1 of 3 trainings; of the others no features were kept, or all are the same." in drawing.caption
