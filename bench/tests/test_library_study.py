"""The study of libraries: its rows, its wrong labels, and that no tested machine teaches."""

from dataclasses import replace

import pytest

from swashtwin.diagnosis import PriorClassifier, measure_library
from swashtwin.pump import CLASSES, load_pump
from swashtwin.recordings import Recording
from swashtwin_bench import Work
from swashtwin_bench.questions import library as study
from swashtwin_bench.questions.library import ALONE, EXCHANGED, LIKE, LibrarySettings, of_version

PUMP = load_pump("25scy14-1b")


@pytest.fixture
def small_prior(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the shipped prior by one with every hundredth of its virtual pumps."""
    prior = PriorClassifier.load("25scy14-1b")
    assert prior.virtual is not None
    is_selected = prior.virtual.number % 100 == 0
    parts = {
        name: getattr(prior.virtual, name)[is_selected] for name in ("change", "target", "number")
    }
    small = replace(prior, virtual=replace(prior.virtual, **parts))
    monkeypatch.setattr(PriorClassifier, "load", lambda name: small)


@pytest.mark.usefixtures("small_prior")
def test_a_tested_machine_does_not_teach_even_if_it_is_in_the_library(
    recordings: list[Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    at_15 = [recording for recording in recordings if "_15MPa_" in recording.recording_id]
    fleet = study._Fleet(tuple(at_15), {str(recording.specimen): PUMP for recording in at_15})
    monkeypatch.setattr(study, "_record_fleet", lambda version, seed: fleet)
    monkeypatch.setattr(study, "REFERENCES", 1)

    table = study.library(Work(), LibrarySettings(versions=("1",), library=(110,))).to_dict()
    scores = {row["library"]: row["recording_balanced_accuracy"]["mean"] for row in table["rows"]}

    assert [*scores][:2] == [ALONE, LIKE]
    assert of_version("2") not in scores
    assert len(set(scores.values())) == 1
    assert [row["weight"]["mean"] for row in table["rows"]] == [0.0] * len(scores)
    assert f"{EXCHANGED} {scores[EXCHANGED]:.3f}" in table["answer"][0]


def test_exchanged_faults_have_the_name_of_the_next_one(recordings: list[Recording]) -> None:
    of_one = [recording for recording in recordings if recording.specimen == "A"]
    measured = measure_library(of_one, PUMP)
    exchanged = study._exchange_faults(measured)

    faults = CLASSES[1:]
    pairs = set(zip(measured.pumps[0].label, exchanged.pumps[0].label, strict=True))
    assert pairs == set(zip(faults, (*faults[1:], faults[0]), strict=True))
