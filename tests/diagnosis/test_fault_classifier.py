"""`FaultClassifier` keeps scikit-learn's conventions, answers per recording, and scores no training
recording.
"""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.model_selection import StratifiedGroupKFold, cross_validate
from sklearn.utils.estimator_checks import check_estimator

from swashtwin import presets
from swashtwin.diagnosis import (
    AnomalyDetector,
    FaultClassifier,
    PriorClassifier,
    diagnose,
)
from swashtwin.foundation import DataError, InputError, LeakError
from swashtwin.learning import (
    PAPER_TRAINING,
    RECOMMENDED_TRAINING,
    BandPowerNetwork,
    WindowSet,
    cut_windows,
    evaluate,
    fit,
)
from swashtwin.recordings import Recording, Recordings

CLASSES = ("normal", "piston")
SMALL = {"network": "band_powers", "window": 128, "epochs": 4, "batch_size": 8}


def recordings(tag: str, per_class: int = 3) -> list[Recording]:
    measured = []
    for index, label in enumerate(CLASSES):
        for number in range(per_class):
            draw = np.random.default_rng([index, number, *tag.encode()])
            phase = 2 * np.pi * (0.05 + 0.1 * index) * np.arange(640) + draw.uniform(0, 6)
            signal = np.sin(phase) + 0.3 * draw.normal(size=640)
            measured.append(Recording(signal[None], 1000.0, f"{tag} {label} {number}", label=label))

    return measured


def synthetic_windows(label: str, manifest: tuple[str, ...] = ()) -> WindowSet:
    draw = np.random.default_rng(5)
    signal = draw.normal(size=(6, 1, 128)).astype(np.float32)
    nan = np.full(6, np.nan)

    return WindowSet(
        signal=signal,
        target=np.zeros(6, dtype=np.int64),
        classes=(label,),
        recording_id=np.array([f"made {index}" for index in range(6)]),
        specimen=np.full(6, ""),
        discharge_pressure=nan,
        speed=nan,
        start=np.zeros(6, dtype=np.int64),
        synthetic=np.ones(6, dtype=np.bool_),
        sample_rate=1000.0,
        channels=("acceleration",),
        manifest=dict.fromkeys(manifest, ()),
    )


@pytest.fixture(scope="module")
def classifier() -> FaultClassifier:
    return FaultClassifier(**SMALL).fit(recordings("train"))


@pytest.mark.filterwarnings("ignore")
def test_the_checks_of_scikit_learn_pass():
    expected = {
        "check_do_not_raise_errors_in_init_or_set_params": "the type checker of these tests refuses -1 for a text",
        "check_methods_sample_order_invariance": "levels are of single precision",
        "check_methods_subset_invariance": "levels are of single precision",
    }
    results = check_estimator(
        FaultClassifier("band_powers"),
        expected_failed_checks=expected,
        on_fail=None,
        on_skip=None,
    )
    failed = {
        result["check_name"]: result["exception"]
        for result in results
        if result["status"] == "failed"
    }
    skipped = {result["check_name"] for result in results if result["status"] == "skipped"}

    assert failed == {}

    # one needs SCIPY_ARRAY_API in the environment, the other pandas
    assert skipped <= {"check_array_api_input", "check_classifier_data_not_an_array"}
    assert len(results) > 40


def test_the_defaults_are_the_recommended_training_and_the_preset_is_the_papers():
    assert FaultClassifier("band_powers").make_training_settings() == RECOMMENDED_TRAINING
    assert (
        FaultClassifier(**presets.recommended.classifier).get_params()
        == FaultClassifier().get_params()
    )

    paper = FaultClassifier(**presets.paper.classifier)
    assert (paper.network, paper.make_training_settings()) == ("bitcn", PAPER_TRAINING)


def test_it_trains_as_fit_does_bit_for_bit_and_clones_to_the_same_bits(classifier):
    windows = cut_windows(recordings("train"), length=128)
    settings = classifier.make_training_settings()
    fitted = fit(BandPowerNetwork(1, 2), windows, settings=settings)
    new = cut_windows(recordings("new"), length=128)

    np.testing.assert_array_equal(classifier.predict_proba(new), fitted.predict_proba(new))

    cloned = clone(classifier).fit(windows)
    np.testing.assert_array_equal(cloned.predict_proba(new), fitted.predict_proba(new))


def test_the_number_of_channels_is_known_after_recordings_arrays_and_loading(classifier, tmp_path):
    assert classifier.n_features_in_ == 1
    windows = cut_windows(recordings("train"), length=128)
    X = windows.signal[:, 0]
    fitted = FaultClassifier("band_powers", sample_rate=1000.0).fit(X, windows.target)
    assert fitted.n_features_in_ == 128

    # the only channel may be left out
    loaded = FaultClassifier.load(fitted.save(tmp_path / "pump.safetensors"))
    assert loaded.n_features_in_ == 1
    np.testing.assert_array_equal(loaded.predict_proba(X), fitted.predict_proba(X))
    with pytest.raises(ValueError, match="X has 2 features"):
        loaded.predict(np.zeros((1, 2, 128)))


def test_diagnoses_and_scores_are_rows_of_frames_and_tables_of_a_notebook(classifier):
    pandas = pytest.importorskip("pandas")
    diagnoses = [classifier.diagnose(recording) for recording in recordings("new")]
    frame = pandas.concat([diagnosis.to_pandas() for diagnosis in diagnoses])
    assert frame.verdict.tolist() == [diagnosis.verdict for diagnosis in diagnoses]
    assert frame["probabilities.normal"].iloc[0] == diagnoses[0].probabilities["normal"]
    assert "probability" in diagnoses[0]._repr_html_()
    assert (
        "probability"
        not in replace(diagnoses[0], unknown=True, reasons=("a",), error_rate=0.1)._repr_html_()
    )

    scores = classifier.evaluate(recordings("new"))
    row = scores.to_pandas().iloc[0]
    assert (row["accuracy_interval.low"], row["recall.normal"]) == (
        scores.accuracy_interval[0],
        scores.recall["normal"],
    )


def test_recordings_get_one_answer_each_which_is_that_of_the_diagnosis(classifier):
    new = recordings("new")
    labels = classifier.predict(new)

    assert labels.tolist() == [recording.label for recording in new]
    for row, recording in zip(classifier.predict_proba(new), new, strict=True):
        assert dict(zip(CLASSES, row, strict=True)) == pytest.approx(
            classifier.diagnose(recording).probabilities
        )

    assert repr(classifier.diagnose(new[0])).startswith(
        "<Diagnosis of new normal 0: normal (normal "
    )
    assert classifier.diagnose(new[0]).to_dict() == diagnose(classifier.fitted_, new[0]).to_dict()
    assert classifier.predict(cut_windows(new, length=128)).shape == (30,)


def test_the_score_is_the_accuracy_of_the_predictions(classifier):
    new = recordings("new")
    windows = cut_windows(new, length=128)

    assert classifier.score(new) == np.mean(
        classifier.predict(new) == [recording.label for recording in new]
    )
    assert classifier.score(iter(new)) == classifier.score(new)
    assert classifier.score(windows) == np.mean(classifier.predict(windows) == windows.label)
    assert classifier.score(new, ["piston"] * 6) == 0.5

    scores = classifier.evaluate(new, split="L2")
    assert scores.to_dict() == evaluate(classifier.fitted_, windows, split="L2").to_dict()


def test_a_recording_with_a_part_in_the_training_is_not_scored(classifier):
    train = recordings("train")
    for test in (train, cut_windows(train, length=128)):
        with pytest.raises(LeakError, match="had a part in the classifier"):
            classifier.score(test)

    synthetic = synthetic_windows("valve_plate", manifest=("new normal 1",))
    twinned = FaultClassifier(**SMALL).fit(train, synthetic=synthetic)

    with pytest.raises(LeakError, match="new normal 1 had a part"):
        twinned.score(recordings("new"))


def test_synthetic_windows_may_bring_a_class_that_was_never_measured():
    classifier = FaultClassifier("band_powers", window=128)
    classifier.fit(
        recordings("train"),
        synthetic=[synthetic_windows("valve_plate"), synthetic_windows("normal")],
    )

    assert classifier.classes_.tolist() == ["normal", "piston", "valve_plate"]
    assert classifier.predict(recordings("new")).shape == (6,)
    with pytest.raises(DataError, match="train normal 0 is measured; give it in X"):
        classifier.fit(recordings("train"), synthetic=cut_windows(recordings("train"), length=128))


def test_a_label_of_another_language_is_mapped_to_its_fault_or_has_a_note():
    german = {"normal": "Gut", "piston": "Kolbenverschleiss"}
    train = [member.replace(label=german[member.label]) for member in recordings("train")]
    sets = [synthetic_windows("normal"), synthetic_windows("piston")]
    classifier = FaultClassifier("band_powers", window=128, epochs=1).fit(train, synthetic=sets)

    assert classifier.classes_.tolist() == ["Gut", "Kolbenverschleiss", "piston"]
    assert "'Kolbenverschleiss' stands for 'piston'" in classifier.notes_[0]

    only_healthy = classifier.fit(train[:3], synthetic=sets)
    assert not any("stands for" in note for note in only_healthy.notes_)

    mapped = FaultClassifier(
        "band_powers", window=128, epochs=1, fault_of={"Kolbenverschleiss": "piston"}
    )
    mapped.fit(train, synthetic=sets)

    assert mapped.classes_.tolist() == ["Gut", "Kolbenverschleiss"]
    assert not any("stands for" in note for note in mapped.notes_)
    assert mapped.diagnose(recordings("new")[0]).fault_of == {"Kolbenverschleiss": "piston"}

    like = [
        replace(member, classes=(*member.classes, "Kolbenverschleiss"), target=member.target)
        for member in sets
    ]

    assert mapped.fit(train, synthetic=like).classes_.tolist() == [
        "Gut",
        "Kolbenverschleiss",
    ]
    with pytest.raises(InputError, match="No recording is of the class 'Kolben'"):
        FaultClassifier("band_powers", window=128, fault_of={"Kolben": "piston"}).fit(
            train, synthetic=sets
        )


def test_validation_recordings_have_no_part_in_the_synthetic_windows():
    classifier = FaultClassifier(
        "band_powers", window=128, validation_fraction=0.5, error_rate=0.25
    )
    train = recordings("train", per_class=6)
    manifest = ("train normal 0", "train normal 2", "train piston 0", "train piston 2")
    classifier.fit(train, synthetic=synthetic_windows("normal", manifest))
    trained = set(classifier.fitted_.training_reference.recording_id)

    assert set(manifest) <= trained
    assert len(trained) == 8

    everything = tuple(recording.recording_id for recording in train)
    with pytest.raises(DataError, match="without a part in synthetic ones"):
        classifier.fit(train, synthetic=synthetic_windows("normal", everything))


def test_too_few_validation_recordings_are_refused_before_the_training():
    epochs = []
    with pytest.raises(InputError, match="needs 9 validation recordings, and there are 3"):
        FaultClassifier(**SMALL, validation_fraction=0.34, error_rate=0.1).fit(
            recordings("train"), progress=lambda *step: epochs.append(step)
        )

    assert epochs == []


def test_arrays_are_cross_validated_by_recording():
    windows = cut_windows(recordings("all"), length=128)
    labels = np.array(["sound", "worn"])[windows.target]
    result = cross_validate(
        FaultClassifier("band_powers", sample_rate=1000.0), windows.signal, labels,
        groups=windows.recording_id, cv=StratifiedGroupKFold(3), error_score="raise",
    )  # fmt: skip

    assert result["test_score"].min() > 0.9

    result = cross_validate(
        FaultClassifier("band_powers", window=128), recordings("all"), ["sound"] * 3 + ["worn"] * 3,
        cv=3, error_score="raise",
    )  # fmt: skip

    assert result["test_score"].tolist() == [1, 1, 1]


def test_classes_of_an_array_keep_their_type_and_groups_enter_the_manifest():
    windows = cut_windows(recordings("all"), length=128)
    classifier = FaultClassifier("band_powers").fit(
        windows.signal, windows.target, groups=windows.recording_id
    )

    assert classifier.classes_.dtype.kind == "i"
    assert set(classifier.predict(windows.signal)) == {0, 1}
    assert tuple(classifier.fitted_.manifest) == tuple(np.unique(windows.recording_id))


def test_a_loaded_classifier_has_the_parameters_and_answers_of_the_saved_one(tmp_path):
    settings = {
        "network_settings": {"dropout": 0.2},
        "training_settings": {"noise_snr": 0.0},
    }
    classifier = FaultClassifier(**SMALL, **settings, seed=3).fit(recordings("train"))
    loaded = FaultClassifier.load(classifier.save(tmp_path / "pump.safetensors"))
    new = recordings("new")

    np.testing.assert_array_equal(loaded.predict_proba(new), classifier.predict_proba(new))
    assert loaded.get_params() == classifier.get_params() | {"sample_rate": 1000.0}
    assert clone(loaded).get_params() == loaded.get_params()


@pytest.mark.parametrize("kind", ["specimen", "mill", "by id"])
def test_a_loaded_classifier_keeps_its_group(kind, tmp_path):
    train = [
        replace(recording, specimen=f"P{number}", attributes={"mill": f"m{number}"})
        for number, recording in enumerate(recordings("train"))
    ]
    by_id = {recording.recording_id: f"day {number}" for number, recording in enumerate(train)}
    group = by_id if kind == "by id" else kind
    classifier = FaultClassifier(**SMALL, group=group).fit(train)
    loaded = FaultClassifier.load(classifier.save(tmp_path / "pump.safetensors"))

    assert loaded.group == group
    assert clone(loaded).group == group


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {"network": "spectral"},
            "unknown network 'spectral'; there are .*band_powers.*bitcn",
        ),
        (
            {"training_settings": {"epochs": 3}},
            "training_settings has no field 'epochs'",
        ),
        ({"training_settings": {"noise": 3}}, "training_settings has no field 'noise'"),
        ({"network_settings": {"width": 3}}, "has no setting 'width'"),
        ({"epochs": 0}, "epochs .0. must be at least 1"),
        ({"epochs": "3"}, "epochs .'3'. must be a whole number"),
        ({"window": "128"}, "window .'128'. must be a whole number or None"),
        ({"window": 128.5}, "window .128.5. must be a whole number"),
        ({"error_rate": "0.1"}, "error_rate .'0.1'. must be a number or None"),
        ({"group": 3}, "group .3. must be text or a mapping by name"),
        (
            {"fault_of": "piston"},
            "fault_of .'piston'. must be a mapping by name or None",
        ),
        ({"network": 3}, "network .3. must be text"),
    ],
)
def test_a_wrong_parameter_is_named_in_one_line(parameters, message):
    with pytest.raises(InputError, match=message) as caught:
        FaultClassifier(**{**SMALL, **parameters}).fit(recordings("train"))
    assert "\n" not in str(caught.value)


def test_unsuitable_data_are_refused(classifier):
    windows = cut_windows(recordings("train"), length=128)
    with pytest.raises(InputError, match="y belongs to arrays"):
        FaultClassifier(**SMALL).fit(windows, windows.label)
    with pytest.raises(InputError, match="groups belongs to arrays"):
        FaultClassifier(**SMALL).fit(recordings("train"), groups=["a"] * 6)
    with pytest.raises(InputError, match="y has 1 labels for 6 recordings"):
        FaultClassifier(**SMALL).fit(recordings("train"), ["normal"])
    with pytest.raises(InputError, match=r"y.0. .None. is not a class"):
        FaultClassifier(**SMALL).fit(recordings("train"), [None] * 6)
    with pytest.raises(InputError, match="classes is the text 'normal'"):
        FaultClassifier(**SMALL).fit(recordings("train"), classes="normal")
    with pytest.raises(InputError, match="give synthetic windows as synthetic="):
        FaultClassifier(**SMALL).fit(recordings("train"), synthetic_windows("normal"))

    none = windows.subset(windows.target < 0)
    for use in (FaultClassifier(**SMALL).fit, classifier.predict, classifier.score):
        with pytest.raises(DataError, match=r"no window of 128 samples .* Give longer recordings"):
            use(none)

    for nothing in ([], Recordings([])):
        with pytest.raises(InputError, match="X holds no recording and no window"):
            classifier.predict(nothing)

    with pytest.raises(InputError, match=r"groups has shape .2,. for 30 windows"):
        FaultClassifier(**SMALL).fit(windows.signal, windows.target, groups=["a", "b"])
    with pytest.raises(InputError, match="an array is scored with score"):
        classifier.evaluate(windows.signal)
    with pytest.raises(InputError, match="X has 4 dimensions"):
        FaultClassifier(**SMALL).fit(windows.signal[None].repeat(30, 0)[:, 0:1], windows.target)
    with pytest.raises(NotFittedError):
        FaultClassifier().predict(recordings("new"))


@pytest.mark.wrong_types
@pytest.mark.parametrize("invalid", [None, "folder", ["a.csv"], np.zeros((1, 400)), 3])
def test_an_input_that_is_not_a_recording_is_refused_in_a_sentence(
    classifier: FaultClassifier, invalid: object
):
    prior = PriorClassifier.load("25scy14-1b")
    for method in (
        classifier.diagnose,
        prior.diagnose,
        AnomalyDetector().fit,
        prior.fit,
        prior.evaluate,
    ):
        with pytest.raises(
            InputError,
            match=r"is not a recording|recordings are expected|than recordings",
        ):
            method(invalid)


def test_masked_samples_are_refused_in_fit_and_predict(classifier):
    # scikit-learn's check drops the mask: what lies below it would be learned from.
    samples = np.ma.masked_array(np.ones((4, 1, 64)), mask=False)
    unmasked = FaultClassifier("band_powers", sample_rate=1000.0).fit(samples, ["a", "b"] * 2)
    samples[0, 0, 3:5] = np.ma.masked

    with pytest.raises(InputError, match="X has 2 masked samples; leave out the windows"):
        FaultClassifier("band_powers").fit(samples, ["a", "b"] * 2)
    with pytest.raises(InputError, match="X has 2 masked samples"):
        unmasked.predict(samples)


@pytest.mark.parametrize(
    ("windows", "shapes"),
    [
        ([[1.0, 2.0, 3.0], [4.0, 5.0]], r"\(2,\) and \(3,\)"),
        ([[[1.0, 2.0], [3.0]], [[1.0, 2.0], [3.0, 4.0]]], r"\(2, 1\) and \(2, 2\)"),
    ],
    ids=["windows", "channels of a window"],
)
def test_lists_of_different_lengths_are_refused_with_their_shapes(windows, shapes):
    with pytest.raises(InputError, match=f"windows of different shapes, such as {shapes}"):
        FaultClassifier("band_powers").fit(windows, ["a", "b"])
