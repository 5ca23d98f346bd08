"""The stated error rates hold on new recordings, and an untrained class is called unknown."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commandline import run, run_json
from sklearn.covariance import LedoitWolf
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.metrics import roc_auc_score
from tree_models import fit_trees

from swashtwin.diagnosis import diagnose, load_classifier, save_classifier
from swashtwin.diagnosis.classifier_file import VERSION, VERSION_WITHOUT_MACHINES
from swashtwin.foundation import (
    DataError,
    InputError,
    LeakError,
    MPa,
    read_artifact,
    rpm,
    write_artifact,
)
from swashtwin.learning import (
    BiTCN,
    Confidence,
    FittedClassifier,
    TrainingSettings,
    WindowSet,
    allowed_error_rate,
    cross_fitted_confidence,
    cut_windows,
    fit,
    learn_confidence,
    pooled_probabilities,
    predict_recordings,
    score_confidence,
    validation_share,
)
from swashtwin.learning.covariance import shrunk_covariance
from swashtwin.learning.features import reference_features
from swashtwin.learning.training.confidence import temperature_scaled
from swashtwin.learning.training.training_reference import build_reference
from swashtwin.learning.training.virtual_problems import HELD_OUT_SHARES, transport_p_values
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, write_index, write_recording

CLASSES = ("normal", "piston")
CYCLES_PER_SAMPLE = {"normal": 0.05, "piston": 0.15, "howl": 0.35}


def recording(name: str, label: str, noise: float = 0.3) -> Recording:
    draw = np.random.default_rng(list(name.encode()))
    phase = 2 * np.pi * CYCLES_PER_SAMPLE[label] * np.arange(320) + draw.uniform(0, 6)
    signal = np.sin(phase) + noise * draw.normal(size=320)
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))

    return Recording(signal[None], 1000.0, name, label=label, condition=condition)


def several(
    purpose: str, count: int, labels: tuple[str, ...] = CLASSES, noise: float = 0.3
) -> list[Recording]:
    recordings = []
    for label in labels:
        recordings.extend(recording(f"{purpose} {label} {n}", label, noise) for n in range(count))

    return recordings


def windows(recordings: list[Recording]) -> WindowSet:
    return cut_windows(recordings, length=80, classes=CLASSES)


@pytest.fixture(scope="module")
def bare() -> FittedClassifier:
    settings = TrainingSettings(epochs=25, batch_size=12, learning_rate=3e-3, normalization="set")
    return fit(
        BiTCN(1, 2, channels=(8, 12), kernel_size=3, stride=2),
        windows(several("train", 4)),
        settings=settings,
    )


@pytest.fixture(scope="module")
def calibrated(bare: FittedClassifier) -> FittedClassifier:
    return learn_confidence(bare, windows(several("validation", 10)))


def confidence(
    scores: np.ndarray, rate: float = 0.1, target: np.ndarray | None = None
) -> Confidence:
    if target is None:
        target = np.arange(scores.size) % 4

    return Confidence(1.0, 1.0, (1,), scores[None], target, np.sort(scores), rate)


def test_a_prediction_set_is_never_empty_and_grows_as_the_error_rate_falls() -> None:
    three = np.arange(39) % 3
    predictor = confidence(np.full(39, 1e-6), target=three)
    doubtful = np.array([[0.4, 0.35, 0.25]])

    assert predictor.prediction_set(doubtful, 1).tolist() == [[True, False, False]]

    predictor = confidence(np.linspace(0, 3, 39), target=three)
    sizes = [predictor.prediction_set(doubtful, 1, rate).sum() for rate in (0.6, 0.3, 0.05)]

    assert sizes == sorted(sizes)
    assert sizes[-1] == 3


def test_the_temperature_changes_no_verdict_and_few_recordings_limit_the_certainty(
    calibrated: FittedClassifier,
) -> None:
    answers = predict_recordings(calibrated, windows(several("test", 5)))
    soft = calibrated.confidence.temperature_scaled(answers.probability, answers.n_windows)

    np.testing.assert_array_equal(soft.argmax(axis=1), answers.probability.argmax(axis=1))
    np.testing.assert_allclose(soft.sum(axis=1), 1)

    # 20 validation recordings, all classified correctly, prove no more than about 21/22
    assert soft.max() < 0.999
    assert np.median(soft.max(axis=1)) == pytest.approx(21 / 22, abs=0.05)


def correlated(
    count: int, dependence: float, draw: np.random.Generator, n_windows: int = 16
) -> tuple[np.ndarray, ...]:
    """Return (window, class) probabilities, and recording and class of each window.

    The probabilities are right for a single window; windows of a recording share a part of their
    deviation.
    """
    target = np.arange(count) % 2
    shared = np.sqrt(dependence) * draw.normal(size=(count, 1))
    independent = np.sqrt(1 - dependence) * draw.normal(size=(count, n_windows))
    value = np.where(target, 0.8, -0.8)[:, None] + shared + independent
    piston = 1 / (1 + np.exp(-2 * 0.8 * value.ravel()))
    names = np.repeat([f"recording {index:04}" for index in range(count)], n_windows)

    return np.column_stack([1 - piston, piston]), names, np.repeat(target, n_windows)


@pytest.mark.parametrize(("dependence", "temperature"), [(0.0, 1.0), (0.3, 2.0), (1.0, 0.5)])
def test_temperature_and_dependence_match_those_of_the_drawn_windows(
    dependence, temperature
) -> None:
    probability, names, target = correlated(300, dependence, np.random.default_rng(0))
    too_sure = temperature_scaled(probability, 1 / temperature)
    result = cross_fitted_confidence(too_sure, names, target, np.zeros(300))

    assert result.temperature == pytest.approx(temperature, rel=0.15)
    # the estimate is shrunk, for few recordings do not prove full certainty
    assert result.dependence == pytest.approx(dependence, abs=0.12)
    assert result.cross_fitted
    assert result.listening_windows == (1, 2, 4, 8, 16)


def test_windows_without_a_known_dependence_count_as_a_single_window() -> None:
    probability, names, target = correlated(100, 0.0, np.random.default_rng(0), n_windows=1)
    result = cross_fitted_confidence(probability, names, target, np.zeros(100))

    assert result.dependence == 1

    pooled = pooled_probabilities(np.tile(probability[:1], (8, 1)), result)
    np.testing.assert_allclose(pooled, pooled_probabilities(probability[:1], result))


def test_probabilities_and_sets_hold_from_a_single_window_to_a_whole_recording() -> None:
    draw = np.random.default_rng(0)
    predictor = cross_fitted_confidence(*correlated(300, 0.2, draw), draw.normal(size=300))
    probability, _, target = correlated(600, 0.2, draw)
    windows = probability.reshape(600, 16, 2)
    target = target[::16]
    for count in (1, 3, 16):
        pooled = np.stack([pooled_probabilities(part[:count]) for part in windows])
        calibrated = predictor.temperature_scaled(pooled, count)

        assert calibrated.max(axis=1).mean() == pytest.approx(
            np.mean(pooled.argmax(axis=1) == target), abs=0.03
        )

        covered = predictor.prediction_set(pooled, count)[np.arange(600), target]
        assert 0.86 < covered.mean() < 0.96


def test_each_class_with_enough_recordings_has_its_rate_and_scarce_classes_share_one() -> None:
    target = np.repeat([0, 1, 2, 3], [30, 12, 5, 3])
    scores = np.linspace(0, 1, 50)
    predictor = confidence(scores, target=target)

    # 5 and 3 recordings are too few even together, so the class of 12 joins them
    assert predictor.class_groups(4).tolist() == [0, -1, -1, -1]
    assert predictor.class_groups(4, 0.15).tolist() == [0, 1, -1, -1]
    assert predictor.class_groups(5, 0.25).tolist() == [0, 1, 2, -1, -1]

    probability = np.array([[0.9, 0.04, 0.03, 0.03]])
    expected = (1 + np.count_nonzero(scores[30:] >= -np.log(0.04))) / 21

    np.testing.assert_allclose(predictor.plausibility(probability, 1)[0, 1], expected)

    of_first_class = (1 + np.count_nonzero(scores[:30] >= -np.log(0.9))) / 31
    np.testing.assert_allclose(predictor.plausibility(probability, 1)[0, 0], of_first_class)


def test_held_out_machines_are_judged_together_and_adjusted_by_virtual_problems() -> None:
    target = np.repeat([0, 1, 2], 20)
    by_recording = confidence(np.linspace(0, 1, 60), target=target)
    by_machine = replace(by_recording, n_machines=2, cross_fitted=True)
    probability = np.array([[0.9, 0.06, 0.04], [0.5, 0.3, 0.2]])

    assert by_machine.class_groups(3).tolist() == [-1, -1, -1]
    assert by_machine.basis == (
        "60 training recordings, each classified by models trained without its machine, adjusted "
        "by 60 virtual problems of 2 pumps"
    )

    unadjusted = replace(by_machine, n_machines=9)
    assert unadjusted.basis.endswith("trained without its machine")
    measured = unadjusted.plausibility(probability, 1)
    np.testing.assert_array_equal(
        by_machine.plausibility(probability, 1), transport_p_values(measured, 2)
    )


def test_virtual_problems_keep_the_order_of_p_values_and_raise_none() -> None:
    p_value = np.linspace(0, 1, 501)
    for n_machines in HELD_OUT_SHARES:
        transported = transport_p_values(p_value, n_machines)
        assert (np.diff(transported) >= 0).all()
        assert (transported <= p_value).all()
        assert transported[-1] == 1
        # K machines promise no rate below 1 / (K + 1): the sets at 0.1 stay wider than at that.
        assert transported[p_value > 1 / (n_machines + 1)].min() > 0.1

    np.testing.assert_array_equal(transport_p_values(p_value, 9), p_value)


@pytest.mark.parametrize(("count", "rate"), [(20, 0.1), (9, 0.1), (6, 0.143), (2, 0.334)])
def test_few_training_recordings_give_the_minimum_error_rate_that_they_allow(
    count: int, rate: float
) -> None:
    answers = correlated(count, 0.5, np.random.default_rng(0), n_windows=3)
    predictor = cross_fitted_confidence(*answers, np.zeros(count))

    assert predictor.error_rate == rate
    basis = "training recordings, each classified by models trained without it"
    assert predictor.basis == f"{count} {basis}"
    with pytest.raises(
        InputError,
        match=rf"0\.03 needs 33 validation recordings, and there are {count}",
    ):
        cross_fitted_confidence(*answers, np.zeros(count), error_rate=0.03)


def test_out_of_fold_answers_to_twenty_recordings_keep_the_error_rate() -> None:
    draw = np.random.default_rng(0)
    means = draw.normal(size=(3, 4))
    covered = []

    for _ in range(25):
        target = np.arange(80) % 3
        of_recording = draw.normal(size=(80, 1, 4))
        of_window = draw.normal(size=(80, 6, 4))
        values = means[target][:, None] + of_recording + of_window
        rows = values[:20].reshape(120, 4)
        classes = np.repeat(target[:20], 6)
        names = np.repeat(np.arange(20), 6)
        out_of_fold = np.zeros((120, 3))

        for fold in range(5):
            tested = names // 3 % 5 == fold
            model = LinearDiscriminantAnalysis().fit(rows[~tested], classes[~tested])
            out_of_fold[tested] = model.predict_proba(rows[tested])

        predictor = cross_fitted_confidence(out_of_fold, names, classes, draw.normal(size=20))
        model = LinearDiscriminantAnalysis().fit(rows, classes)
        pooled = np.stack(
            [pooled_probabilities(model.predict_proba(windows)) for windows in values[20:]]
        )
        covered.append(predictor.prediction_set(pooled, 6)[np.arange(60), target[20:]].mean())

    # an error rate of 0.1 should cover 0.9
    assert 0.88 < np.mean(covered) < 0.97


def test_out_of_fold_answers_that_do_not_fit_or_are_not_finite_are_refused() -> None:
    probability, names, target = correlated(10, 0.5, np.random.default_rng(0), n_windows=3)
    with pytest.raises(
        InputError, match=r"30, 30 and 30 windows of 10 recordings, ood_score has 30"
    ):
        cross_fitted_confidence(probability, names, target, np.zeros(30))

    probability[4] = np.nan
    with pytest.raises(DataError, match="recording 0001: its out-of-fold answer is not finite"):
        cross_fitted_confidence(probability, names, target, np.zeros(10))


@pytest.mark.parametrize("kind", ["network", "trees"])
def test_an_untrained_class_is_called_unknown_and_trained_ones_are_not(
    calibrated: FittedClassifier, kind: str
) -> None:
    if kind == "trees":
        trees = fit_trees(windows(several("train", 4)), 20)
        answer = learn_confidence(trees, windows(several("validation", 10)))
    else:
        answer = calibrated
    result = score_confidence(answer, windows(several("test", 10)))

    assert result.accuracy == 1
    assert result.coverage >= 0.8
    assert result.set_size == 1
    assert result.called_unknown <= 0.3

    recordings = several("test", 10) + several("test", 20, ("howl",))
    unlabeled = windows([recording.replace(label=None) for recording in recordings])
    scores = predict_recordings(answer, unlabeled).ood_score
    names = sorted(recording.recording_id for recording in recordings)
    is_untrained = ["howl" in name for name in names]  # scores are sorted by name

    assert roc_auc_score(is_untrained, scores) > 0.95


def test_a_diagnosis_has_prediction_sets_and_states_that_a_class_is_unknown(
    calibrated: FittedClassifier,
) -> None:
    trained = diagnose(calibrated, recording("new piston", "piston"))
    assert trained.prediction_set == ("piston",)
    assert trained.verdict == "piston"
    assert trained.score <= trained.threshold
    assert "all other classes are excluded at an error rate of 10 %" in trained.sentence()

    strange = diagnose(calibrated, recording("new howl", "howl").replace(label=None))
    assert strange.unknown
    assert strange.score > strange.threshold
    assert strange.sentence().startswith(
        "Unknown: the recording differs from every trained class more than 90 % of the training"
    )

    # the verdict is the first entry that a reader of the JSON sees
    answer = json.loads(json.dumps(strange.to_dict(), allow_nan=False))
    assert next(iter(answer.items())) == ("verdict", "unknown")


def test_a_confidence_is_saved_with_its_classifier(calibrated, bare, tmp_path) -> None:
    piston = recording("new piston", "piston")
    for classifier in (calibrated, bare):
        loaded = load_classifier(save_classifier(classifier, tmp_path / "a.safetensors"))
        assert diagnose(loaded, piston).to_dict() == diagnose(classifier, piston).to_dict()

    path = save_classifier(calibrated, tmp_path / "previous.safetensors")
    card, arrays = read_artifact(path, "classifier", VERSION, advice="", may_be_nan=None)
    del card["confidence"]["n_machines"]
    write_artifact(path, "classifier", VERSION_WITHOUT_MACHINES, card, arrays, may_be_nan=None)
    previous = load_classifier(path)
    assert diagnose(previous, piston).to_dict() == diagnose(calibrated, piston).to_dict()

    loaded = load_classifier(
        save_classifier(replace(bare, training_reference=None), tmp_path / "b.safetensors")
    )

    assert loaded.training_reference is None
    assert diagnose(loaded, piston).error_rate is None
    with pytest.raises(DataError, match="Train it with measured recordings"):
        learn_confidence(loaded, windows(several("validation", 10)))


def test_validation_recordings_join_the_manifest_and_leaks_are_refused(bare, calibrated) -> None:
    assert {"validation piston 3", "train normal 0"} <= set(calibrated.manifest)
    with pytest.raises(LeakError, match="had a part"):
        score_confidence(calibrated, windows(several("validation", 2)))
    with pytest.raises(LeakError, match="was trained on"):
        learn_confidence(bare, windows(several("train", 4) + several("validation", 4)))


def test_too_few_recordings_for_an_error_rate_are_refused_with_their_numbers(
    bare, calibrated
) -> None:
    message = (
        r"0\.1 needs 9 validation .* there are 8\. Use more recordings, "
        r"or an error rate of 0\.112"
    )
    with pytest.raises(InputError, match=message):
        learn_confidence(bare, windows(several("validation", 4)))

    with pytest.raises(InputError, match=r"0\.01 needs 99 .*there are 20"):
        diagnose(calibrated, recording("new", "normal"), error_rate=0.01)
    with pytest.raises(InputError, match="between 0 and 1"):
        learn_confidence(bare, windows(several("validation", 10)), error_rate=10)
    with pytest.raises(InputError, match=r"validation_fraction=0\.2"):
        diagnose(bare, recording("new", "normal"), error_rate=0.1)
    with pytest.raises(InputError, match="Calibrate it on recordings"):
        score_confidence(bare, windows(several("test", 2)))


def test_the_training_reference_is_bounded_and_measured_only(bare, monkeypatch) -> None:
    train = windows(several("train", 4))
    monkeypatch.setattr("swashtwin.learning.training.training_reference.MAX_RECORDINGS", 5)
    few = build_reference(train, reference_features(train))

    assert len(few.recording_id) == len(few.label) == len(few.features) == 5

    synthetic = replace(train, synthetic=np.ones(len(train), dtype=bool))
    assert build_reference(synthetic, reference_features(synthetic)) is None
    assert bare.training_reference.distances(bare.training_reference.features[2]).argmin() == 2


@pytest.mark.parametrize("shape", [(20, 82), (60, 30), (3, 10), (30, 1)])
def test_the_shrunk_covariance_is_that_of_scikit_learn(shape) -> None:
    rows = np.random.default_rng(0).normal(size=shape) * np.arange(1, shape[1] + 1)
    expected = LedoitWolf().fit(rows).covariance_

    np.testing.assert_allclose(
        shrunk_covariance(rows), expected, rtol=1e-12, atol=1e-12 * expected.max()
    )


def test_the_commands_train_evaluate_and_diagnose_with_a_confidence(
    tmp_path: Path,
) -> None:
    recordings = several("rig", 12)
    folder = tmp_path / "rig"
    files = [
        write_recording(recording, folder / f"{recording.recording_id}.h5")
        for recording in recordings
    ]
    write_index(recordings, files, folder)
    shape = ["--network", "bitcn", "--window", 80]
    for setting in ("epochs=12", "stride=2", "channels=8,12", "kernel_size=3"):
        shape += ["--set", setting]
    shape += ["--set", "learning_rate=3e-3"]
    out = ("--out", tmp_path / "m.safetensors")

    answer = run_json("train", folder, "--validation-fraction", 0.5, *out, *shape)
    assert not set(answer["validation"]) & set(answer["held_out"])
    assert answer["temperature"] > 0

    scored = run_json("evaluate", answer["model"], folder)["confidence"]
    assert scored["n_recordings"] == len(answer["held_out"])

    (diagnosis,) = run_json("diagnose", answer["model"], files[0], "--error-rate", 0.2)["diagnoses"]
    assert diagnosis["error_rate"] == 0.2

    printed = run("diagnose", answer["model"], *files[:2], "--report", tmp_path / "page").stdout
    assert "prediction set" in printed
    assert "error rate of 10 %" in (tmp_path / "page" / "report.html").read_text(encoding="utf-8")

    fractions = ("--validation-fraction", 0.3, "--test-fraction", 0.4)
    again = ("--set", "epochs=1", "--force")
    errors = run("train", folder, *fractions, *out, *shape, *again).stderr
    assert (
        "An error rate of 0.1 needs 9 validation recordings, and a share of 0.3 is about" in errors
    )
    assert "are held out for it; they allow an error rate of 0.1" in errors


@pytest.mark.parametrize(
    ("recordings", "fraction", "share", "count", "rate"),
    [
        (270, 0.2, 0.2, 54, 0.1),
        (29, 0.2, 0.333, 9, 0.1),
        (24, 0.2, 0.5, 12, 0.1),
        (12, 0.2, 0.5, 6, 0.143),
    ],
)
def test_a_validation_takes_the_recordings_that_the_error_rate_needs_if_available(
    recordings: int, fraction: float, share: float, count: int, rate: float
) -> None:
    assert validation_share(recordings, 0.1, fraction) == (share, count)
    assert allowed_error_rate(count, 0.1) == rate
