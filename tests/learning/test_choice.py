"""Training that selects a candidate: which one wins, on which folds, and its confidence."""

from dataclasses import replace

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import (
    WindowSet,
    choose_candidate,
    cut_windows,
    fit_best_candidate,
)
from swashtwin.learning.windows.splitting import fold_training_rows
from swashtwin.recordings import Recording

LENGTH = 256


def recordings(
    loudness: float = 1.0, per_class: int = 4, speed: float | None = None
) -> list[Recording]:
    """Two classes that differ by a line, and by `loudness`."""
    measured = []
    for index, label in enumerate(("normal", "piston")):
        for number in range(per_class):
            draw = np.random.default_rng([index, number])
            time = np.arange(4 * LENGTH)
            line = np.sin(2 * np.pi * (0.05 + 0.03 * index) * time + draw.uniform(0, 6))
            noise = draw.normal(size=(2, 4 * LENGTH))
            gain = loudness if label == "piston" else 1.0
            recording = Recording(
                gain * (line + 0.5 * noise),
                1e3,
                f"{label} {number}",
                channels=("x", "y"),
                label=label,
                specimen="ABCD"[number % 4],
            )
            measured.append(recording)

    return measured


def windows(**options: float) -> WindowSet:
    return cut_windows(recordings(**options), length=LENGTH)


@pytest.fixture(scope="module")
def fitted():
    return fit_best_candidate(windows(), seed=3)


def test_the_most_invariant_of_equally_good_candidates_is_selected(fitted) -> None:
    choice = fitted.choice
    tied = [trial.candidate for trial in choice.trials if trial.is_tied]

    assert len(tied) > 1
    assert choice.candidate == tied[0]
    assert choice.candidate == "band_shapes"
    assert (choice.group, choice.n_folds) == ("specimen", 4)
    assert choice.n_windows == len(windows())
    assert choice.candidate in choice.sentence()


def test_the_confidence_comes_from_the_folds(fitted) -> None:
    assert fitted.confidence.cross_fitted
    assert fitted.confidence.n_recordings == 8
    assert fitted.confidence.error_rate == pytest.approx(0.112, abs=2e-3)
    assert set(fitted.manifest) == {recording.recording_id for recording in recordings()}


def test_the_same_seed_selects_and_trains_the_same(fitted) -> None:
    repeated = fit_best_candidate(windows(), seed=3)

    assert repeated.choice == fitted.choice
    np.testing.assert_array_equal(
        repeated.predict_proba(windows()), fitted.predict_proba(windows())
    )


def test_folds_fall_back_to_recordings_and_too_few_have_no_trial() -> None:
    unnamed = windows()
    unnamed = replace(unnamed, specimen=np.full(len(unnamed), ""))

    assert choose_candidate(unnamed)[1].group == "recording"

    single = fit_best_candidate(windows(per_class=1))
    assert single.choice.trials == ()
    assert single.confidence is None
    assert "too few" in single.choice.sentence()


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(InputError, match="seed"):
        choose_candidate(windows(), seed=-1)


def test_recordings_that_cannot_be_held_out_are_trained_without_a_confidence() -> None:
    # the label is a letter that changes with every recording, so that two remain for a class
    measured = []
    for number, recording in enumerate(recordings(per_class=10)):
        label = "abcdefghij"[number % 10]
        name = f"{number:02d}"
        measured.append(replace(recording, recording_id=name, label=label, specimen=None))

    few = fit_best_candidate(cut_windows(measured, length=LENGTH))

    assert few.choice.trials
    assert few.confidence is None


def test_a_sample_that_is_far_too_large_is_refused_by_name() -> None:
    broken = windows()
    broken.signal[5, 1, 7] = -1e20

    with pytest.raises(DataError, match=r"normal 1: samples reach 1e\+20"):
        fit_best_candidate(broken)


def test_no_fold_trains_on_synthetic_windows_made_from_its_test_windows() -> None:
    measured = windows()
    names = np.array([f"duplicates of {name}" for name in measured.specimen])
    copies = replace(
        measured,
        synthetic=np.ones(len(measured), dtype=bool),
        specimen=names,
        content={},
    )
    is_tested = measured.specimen == "A"
    _, choice, answers = choose_candidate(measured + copies)

    # no synthetic window is tested on
    assert choice.n_windows == len(answers.target) == len(measured)

    expected = {"B", "C", "D", "duplicates of B", "duplicates of C", "duplicates of D"}
    assert trained_specimens(measured + copies, is_tested) == expected


def trained_specimens(windows: WindowSet, is_tested: np.ndarray) -> set[str]:
    """Return the specimens of the windows that a fold trains on; the first windows are measured."""
    rows = fold_training_rows(
        windows.target, windows.specimen, windows.synthetic, np.flatnonzero(is_tested)
    )
    return set(windows.specimen[rows].tolist())


def twin_windows(measured: WindowSet) -> WindowSet:
    """Return windows as twins of the machines A and B, and of a type of pump, name them."""
    names = {
        "A": "twin of A",
        "B": "twin of B",
        "C": "twin of 25scy14-1b",
        "D": "twin of 25scy14-1b",
    }
    return replace(
        measured,
        synthetic=np.ones(len(measured), dtype=bool),
        specimen=np.array([names[name] for name in measured.specimen.tolist()]),
        content={},
    )


def test_a_fold_that_holds_out_a_machine_does_not_train_on_its_twin() -> None:
    measured = windows()
    both = measured + twin_windows(measured)

    expected = {"B", "C", "D", "twin of B", "twin of 25scy14-1b"}
    assert trained_specimens(both, measured.specimen == "A") == expected

    # a recording of A is held out, and the machine remains in training
    one_recording = measured.recording_id == measured.recording_id[0]
    assert trained_specimens(both, one_recording) == set(both.specimen.tolist())


@pytest.mark.parametrize(("ending", "is_recognized"), [("", False), (" pump", True)])
def test_a_trial_does_not_recognize_a_machine_by_its_twin(ending: str, is_recognized: bool) -> None:
    # a line of each recording at random, which no class explains, and twins that repeat it
    unexplained = []
    for number, recording in enumerate(recordings()):
        draw = np.random.default_rng(number)
        phase = 2 * np.pi * draw.uniform(0.05, 0.45) * np.arange(4 * LENGTH)
        signal = np.sin(phase) + 0.1 * draw.normal(size=(2, 4 * LENGTH))
        unexplained.append(replace(recording, signal=signal))
    measured = cut_windows(unexplained, length=LENGTH)
    of_twins = replace(
        measured,
        synthetic=np.ones(len(measured), dtype=bool),
        specimen=np.array([f"twin of {name}{ending}" for name in measured.specimen]),
        content={},
    )

    _, choice, _ = choose_candidate(measured + of_twins)
    assert (max(trial.clean for trial in choice.trials) > 0.9) == is_recognized


def test_a_class_that_one_twin_alone_knows_stays_in_every_fold() -> None:
    # nobody recorded the last class, and the twin of A alone simulates it
    measured = windows()
    unrecorded = measured.target == len(measured.classes) - 1
    of_twins = twin_windows(measured)
    is_kept = ~unrecorded | (of_twins.specimen == "twin of A")
    both = measured.subset(~unrecorded) + of_twins.subset(is_kept)

    tested = np.flatnonzero((both.specimen == "A") & ~both.synthetic)
    rows = fold_training_rows(both.target, both.specimen, both.synthetic, tested)

    trained = both.subset(rows)
    assert set(trained.label.tolist()) == set(measured.classes)
    from_a = trained.label[trained.specimen == "twin of A"]
    assert set(from_a.tolist()) == {measured.classes[-1]}


def test_invalid_training_data_and_error_rates_are_refused_before_any_trial() -> None:
    with pytest.raises(DataError, match="no label"):
        fit_best_candidate(replace(windows(), target=np.full(32, -1)))

    message = r"needs 99 .*there are 80\. Use more recordings, or an error rate of 0\.013"
    with pytest.raises(InputError, match=message):
        fit_best_candidate(windows(per_class=40), error_rate=0.01)

    with pytest.raises(InputError, match="without a trial there is none"):
        fit_best_candidate(windows(per_class=1), error_rate=0.4)


def bearing_recordings(length: int) -> list[Recording]:
    """Bearings with a flaw on either race, each with a housing and a speed that no other has."""
    measured = []
    for number in range(8):
        order = (3.05, 4.95)[number % 2]
        draw = np.random.default_rng(number)
        turns = draw.uniform(0.009, 0.015)
        angle = turns * np.arange(4 * length)
        strikes = np.diff(np.floor(order * angle), prepend=0.0) > 0

        time = np.arange(60)
        resonance = draw.uniform(0.15, 0.45)
        ringing = np.exp(-time / 6) * np.sin(2 * np.pi * resonance * time)
        signal = np.convolve(strikes, ringing)[: angle.size] + 0.2 * draw.normal(size=angle.size)
        recording = Recording(
            signal[None],
            1e3,
            f"bearing {number}",
            label=("outer_race", "inner_race")[number % 2],
            specimen=f"bearing {number}",
            attributes={"speed": f"{60e3 * turns} rpm"},
        )
        measured.append(recording)

    return measured


def test_bearings_with_unlike_housings_and_speeds_select_prominences_of_lines() -> None:
    windows_of_bearings = cut_windows(bearing_recordings(1024), length=1024)
    candidate, choice, _ = choose_candidate(windows_of_bearings)

    assert candidate.name == "line_prominences"
    assert candidate.network(windows_of_bearings).uses_speed
    scores = {trial.candidate: trial.score for trial in choice.trials}
    assert scores["line_prominences"] > max(scores["band_shapes"], scores["band_powers"]) + 0.1
