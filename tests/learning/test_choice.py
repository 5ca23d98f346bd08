"""Training that chooses: which candidate wins, on which folds, and what it leaves behind."""

from dataclasses import replace

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import WindowSet, choose_candidate, cut_windows, fit_best_candidate
from swashtwin.learning.choice.candidate_trials import _training_rows, _Views
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
            measured.append(
                Recording(
                    (line + 0.5 * noise) * (loudness if index else 1.0), 1e3, f"{label} {number}", channels=("x", "y"),
                    label=label, specimen="ABCD"[number % 4],
                )
            )  # fmt: skip

    return measured


def windows(**options: float) -> WindowSet:
    return cut_windows(recordings(**options), length=LENGTH)


@pytest.fixture(scope="module")
def fitted():
    return fit_best_candidate(windows(), seed=3)


def test_of_candidates_that_are_as_good_the_most_invariant_is_chosen(fitted) -> None:
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


def test_the_same_seed_chooses_and_trains_the_same(fitted) -> None:
    again = fit_best_candidate(windows(), seed=3)
    assert again.choice == fitted.choice
    np.testing.assert_array_equal(again.predict_proba(windows()), fitted.predict_proba(windows()))


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


def test_classes_in_turn_are_trained_without_a_confidence_where_no_recording_can_be_left_out() -> (
    None
):
    measured = [
        replace(
            recording, recording_id=f"{number:02d}", label="abcdefghij"[number % 10], specimen=None
        )
        for number, recording in enumerate(recordings(per_class=10))
    ]
    few = fit_best_candidate(cut_windows(measured, length=LENGTH))

    assert few.choice.trials
    assert few.confidence is None


def test_a_sample_that_is_far_too_large_is_refused_by_name() -> None:
    broken = windows()
    broken.signal[5, 1, 7] = -1e20

    with pytest.raises(DataError, match=r"normal 1: samples reach 1e\+20"):
        fit_best_candidate(broken)


def test_no_fold_trains_on_what_was_made_from_its_windows() -> None:
    measured = windows()
    names = np.array([f"duplicates of {name}" for name in measured.specimen])
    copies = replace(
        measured, synthetic=np.ones(len(measured), dtype=bool), specimen=names, content={}
    )
    is_tested = measured.specimen == "A"
    _, choice, answers = choose_candidate(measured + copies)

    assert choice.n_windows == len(answers.target) == len(measured), (
        "no synthetic window is tested on"
    )

    views = _Views(measured, copies, seed=0)
    rows = _training_rows(views, np.flatnonzero(~is_tested), np.flatnonzero(is_tested))

    assert set(views.windows.specimen[rows]) == {
        *"BCD",
        *(f"duplicates of {name}" for name in "BCD"),
    }


def test_what_cannot_be_trained_is_refused_before_any_trial() -> None:
    with pytest.raises(DataError, match="no label"):
        fit_best_candidate(replace(windows(), target=np.full(32, -1)))
    with pytest.raises(
        InputError,
        match=r"needs 99 .*there are 80\. Use more recordings, or an error rate of 0\.048",
    ):  # 20 of each machine
        fit_best_candidate(windows(per_class=40), error_rate=0.01)

    with pytest.raises(InputError, match="without a trial there is none"):
        fit_best_candidate(windows(per_class=1), error_rate=0.4)
