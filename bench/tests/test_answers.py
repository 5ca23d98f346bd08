"""A study's answer says how far its seeds let anybody believe it."""

from dataclasses import replace

from stub_runs import run

from swashtwin_bench import models_of, plan_of
from swashtwin_bench.results.answers import case_answer
from swashtwin_bench.results.runs import Run
from swashtwin_bench.studies.runner import assemble_result


def fixed(accuracies: dict[str, tuple[float, ...]], rival: float = 0.0) -> tuple[str, ...]:
    """Answer of a study with these accuracies at L2, one for each seed."""
    seeds = tuple(range(len(next(iter(accuracies.values())))))

    def run_of(name: str, seed: int, accuracy: float, classifier: str) -> Run:
        base = run(name, seed, 0.5, classifier, ("L2",))
        outcome = base.outcomes[0]
        return replace(base, outcomes=(replace(outcome, scores=replace(outcome.scores, accuracy=accuracy)),))

    runs = [run_of(n, seed, values[seed], "spectral_bitcn") for n, values in accuracies.items() for seed in seeds]
    runs += [run_of("measured", seed, rival, "extra_trees") for seed in seeds]
    return case_answer(assemble_result(plan_of("case1", "quick"), runs))


def test_the_answer_gives_the_difference_paired_by_seed():
    measured, nominal, calibrated = (0.5, 0.6, 0.55), (0.6, 0.71, 0.64), (0.71, 0.82, 0.78)
    lead, details, _ = fixed({"measured": measured, "nominal": nominal, "calibrated": calibrated})
    assert "at L2 calibrated beat measured only by 22.0 points (95 % interval +17.0 to +27.0)" in lead
    assert "accuracy 0.550 (measured only), 0.650 (with nominal twin) and 0.770 (with calibrated twin)" in details
    assert "Calibrated beat nominal by 12.0 points (95 % interval +3.4 to +20.6)" in details
    assert "each step's interval excludes zero" in details


def test_the_answer_says_when_a_difference_drowns_in_the_seeds():
    lead, details, _ = fixed({"measured": (0.5, 0.6), "nominal": (0.51, 0.61), "calibrated": (0.7, 0.5)})
    assert "calibrated differed from measured only by +5.0 points, which may be chance (95 % interval -325.1" in lead
    assert "not every step's interval excludes zero" in details


def test_two_seeds_that_agree_are_not_yet_certain():
    lead, *_ = fixed({"measured": (0.5, 0.6), "calibrated": (0.6, 0.72)})
    assert "calibrated differed from measured only by +11.0 points, which may be chance" in lead


def test_the_answer_says_plainly_when_the_papers_order_is_not_found():
    lead, details, _ = fixed({"measured": (0.8, 0.81), "nominal": (0.7, 0.7), "calibrated": (0.6, 0.611)})
    assert "calibrated fell behind measured only by 20.0 points (95 % interval -21.1 to -18.8)" in lead
    assert "was NOT found: it is calibrated < nominal < measured" in details
    equal = fixed({"measured": (0.8, 0.8), "nominal": (0.8, 0.8), "calibrated": (0.9, 0.9)})[1]
    assert "was NOT found: it is measured = nominal < calibrated" in equal


def test_seeds_that_agree_to_the_last_window_are_no_certainty():
    lead, *_ = fixed({"measured": (0.5, 0.5), "calibrated": (0.6, 0.6)})
    assert "differed from measured only by +10.0 points under every seed (no spread to judge it by)" in lead


def test_the_answer_of_one_seed_says_that_it_may_be_chance():
    lead, details, _ = fixed({"measured": (0.5,), "nominal": (0.6,), "calibrated": (0.7,)})
    assert "scored higher than measured only by 20.0 points (one seed: it may be chance)" in lead
    assert "not every step's interval" in details


def test_other_training_sets_than_the_papers_have_an_answer_too():
    runs = [run(name, seed, 0.5 + 0.1 * seed) for name in ("posterior", "stated_prior") for seed in (0, 1)]
    answer = " ".join(case_answer(assemble_result(plan_of("case1", "quick"), runs)))
    assert "L2: highest accuracy 0.5" in answer


def test_training_sets_under_different_seeds_are_not_compared():
    runs = [run("measured", 0, 0.5, levels=("L2",)), run("calibrated", 1, 0.9, levels=("L2",))]
    lead, *_ = case_answer(assemble_result(plan_of("case1", "quick"), runs))
    assert "calibrated has no seed in common with measured only" in lead
    assert "nan" not in lead


def test_the_first_sentence_names_a_rival_that_does_better():
    accuracies = {"measured": (0.5, 0.5), "nominal": (0.6, 0.6), "calibrated": (0.7, 0.7)}
    assert (
        "BiTCN on levels (ours) was beaten at L2 by extra trees (0.900 against 0.700)"
        in fixed(accuracies, rival=0.9)[0]
    )
    assert "beaten" not in fixed(accuracies, rival=0.6)[0]


def test_the_answer_is_about_the_first_classifier_and_the_others_are_its_rivals():
    skills = {"tcn": {"measured": 0.4, "calibrated": 0.6}, "lstm": {"measured": 0.9, "calibrated": 0.8}}
    runs = []
    for classifier, accuracies in skills.items():
        for name, accuracy in accuracies.items():
            base = run(name, 0, 0.5, classifier, ("L2",))
            outcome = base.outcomes[0]
            scores = replace(outcome.scores, accuracy=accuracy)
            runs.append(replace(base, outcomes=(replace(outcome, scores=scores),)))
    plan = replace(plan_of("case1", "quick"), models=models_of("quick", ["tcn", "lstm"]))
    result = assemble_result(plan, runs)
    assert {outcome.classifier for outcome in result.outcomes} == {"tcn"}
    lead, details, _ = case_answer(result)
    assert "at L2 calibrated scored higher than measured only by 20.0 points" in lead
    assert "accuracy 0.400 (measured only) and 0.600 (with calibrated twin)" in details
    assert "(0.900 against 0.600)" in lead


def test_a_rival_of_fewer_seeds_is_not_compared_with_the_mean_of_all():
    runs = [run("calibrated", seed, (0.9, 0.5)[seed], levels=("L2",)) for seed in (0, 1)]
    rival = run("calibrated", 0, 0.95, "extra_trees", ("L2",))
    lead, details, _ = case_answer(assemble_result(plan_of("case1", "quick"), [*runs, rival]))
    assert "beaten" not in lead
    assert "Best rival" not in details


def test_the_best_row_has_all_seeds_and_the_answer_names_the_nearest_classifiers():
    skills = {
        "spectral_bitcn": (0.9, 0.6),
        "bitcn": (0.3, 0.2),
        "wdcnn": (0.8, 0.5),
        "lstm": (0.2, 0.1),
    }
    skills |= {"cnn_lstm": (0.4, 0.3), "tcn": (0.5, 0.4), "autoencoder": (0.95,)}
    runs = [
        run("calibrated", seed, skill, name, ("L2",))
        for name, values in skills.items()
        for seed, skill in enumerate(values)
    ]
    plan = plan_of("algorithms", "quick")
    (sentence,) = assemble_result(replace(plan, models=models_of("quick", skills)), runs).answer
    assert "highest accuracy of those of 2 seeds" in sentence
    assert "(BiTCN on levels (ours), with calibrated twin)" in sentence.split(". ")[0]
    positions = [sentence.index(f"less {name}") for name in ("sparse autoencoder", "WDCNN", "TCN", "CNN-LSTM")]
    assert positions == sorted(positions)
    assert "less LSTM" not in sentence
