"""The study of the public sets keeps groups apart, chooses settings inside, and shows a leak as a leak."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from swashtwin.cli import app
from swashtwin.diagnosis import FaultClassifier
from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording
from swashtwin_bench import run_public, run_public_default, run_scarce
from swashtwin_bench.public.default_training import _live
from swashtwin_bench.public.estimators import ESTIMATORS, GrowingSigns, SharedWeights
from swashtwin_bench.public.feature_fillers import FEATURE_FILLERS
from swashtwin_bench.public.plant_motors import motor_questions
from swashtwin_bench.public.question import Fold, Question, Setting, Units
from swashtwin_bench.public.validation import choose, leaky_scores, score_fold

RATE = 1600.0
LAG = {"healthy": 2.2e-5, "cavitation50": 1.5e-5, "cavitation100": 0.9e-5}
"""Lag [rev/min] over the speed squared of each state of the made-up pump."""


@pytest.fixture(autouse=True)
def _few_trees(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swashtwin_bench.public.estimators.N_TREES", 20)


def write_pump(folder: Path, speeds: tuple[int, ...], states: tuple[str, ...], count: int = 6720) -> Path:
    """A made-up pump_cavitation with three repeats of each state; only the slip tells the state."""
    random = np.random.default_rng(0)
    recordings_folder = folder / "pump_cavitation" / "recordings"
    recordings_folder.mkdir(parents=True)
    time = np.arange(count) / RATE
    for speed in speeds:
        for run, state in enumerate(states):
            for repeat in (1, 2, 3):
                field = 1.03 * speed
                shaft = field - LAG[state] * field**2
                lines = [2 * k * field for k in (1, 2, 3, 6, 12)] + [k * shaft for k in (1, 2, 3, 5, 6, 7)]
                tones = sum(0.4 * np.sin(2 * np.pi * at / 60 * time + random.uniform(0, 6)) for at in lines)
                signal = tones + random.normal(size=(5, count))
                table = np.column_stack([time, signal.T])
                header = "% made up\n" * 7 + "Time\tch 0\tch 1\tch 2\tch 3\tch 4"
                path = recordings_folder / f"{run:02d}_{repeat}_s{speed}_{state}.dat"
                np.savetxt(path, table, "%.6f", "\t", header=header, comments="")
    return folder


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pump(tmp_path_factory.mktemp("small"), (700, 1000, 1200), ("healthy", "cavitation100"))


def test_the_slip_grades_an_unseen_speed_where_usual_trees_fail(tmp_path: Path) -> None:
    """By the command, which prints one JSON object and writes a report."""
    made_up = write_pump(tmp_path / "sets", (700, 1000, 1200), tuple(LAG))
    command = ["bench", "public", "--data", str(made_up), "--seeds", "3", "--jobs", "1", "--json", "--out"]
    answer = CliRunner().invoke(app, [*command, str(tmp_path)])
    assert answer.exit_code == 0, answer.output
    study = json.loads(answer.stdout)
    assert study["seeds"] == [3]
    assert "an honest split" in (tmp_path / "report.html").read_text(encoding="utf-8")
    row = study["rows"][0]
    assert set(row) >= {"split", "balanced_accuracy", "random_window"}
    assert row["split"] == "pump_cavitation/speed"
    assert row["balanced_accuracy"]["mean"] > row["extra_trees"]["mean"] + 0.2
    assert row["balanced_accuracy"]["mean"] > 0.75
    folds = study["details"]["folds"]["pump_cavitation/speed"]
    assert [fold["tested"] for fold in folds] == ["700 rpm", "1000 rpm", "1200 rpm"]
    assert all("load by slip" in fold["setting"] or "both" in fold["setting"] for fold in folds)
    assert any("uci_hydraulic is not in" in note for note in study["notes"])


def test_the_ordinary_training_is_read_again_where_it_was_finished(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = run_public_default(small, classifiers=("extra_trees",), out=tmp_path)
    (row,) = study.rows()
    assert (row["split"], row["classifier"]) == ("pump_cavitation/speed", "extra_trees")
    assert 0.3 < row["recording_balanced_accuracy"]["mean"] <= 1.0
    assert row["floor"]["mean"] == 0.38
    assert [fold["fold"] for fold in study.details["folds"]] == ["700 rpm", "1000 rpm", "1200 rpm"]
    json.dumps(study.to_dict(), allow_nan=False)
    monkeypatch.delattr(FaultClassifier, "fit")
    assert run_public_default(small, classifiers=("extra_trees",), out=tmp_path).rows() == study.rows()
    with pytest.raises(InputError, match="no classifier is called 'trees'; there are chosen, "):
        run_public_default(small, classifiers=("trees",))


def test_what_no_training_takes_is_said_and_a_channel_without_a_signal_is_left_out(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: FaultClassifier, recordings: list[Recording]) -> None:
        raise DataError("too short.")

    monkeypatch.setattr(FaultClassifier, "fit", refuse)
    study = run_public_default(small, classifiers=("chosen",))
    assert study.rows()[0]["balanced_accuracy"]["mean"] is None
    assert "pump_cavitation/speed, chosen: too short." in study.notes
    signal = np.random.default_rng(0).normal(size=(2, 50))
    dead = Recording(signal * [[1.0], [0.0]], 10.0, "dead", channels=("x", "y"))
    live = Recording(signal, 10.0, "live", channels=("x", "y"))
    assert [recording.channels for recording in _live([dead, live])] == [("x",), ("x",)]


def test_the_scarce_drill_has_a_row_for_every_filler_without_and_with_a_single_recording(small: Path) -> None:
    pytest.importorskip("imblearn")
    study = run_scarce(small, seeds=[0])
    rows = {(row["measured"], row["filler"]): row for row in study.rows()}
    assert len(rows) == 11
    assert len(rows["none", "SMOTE"]["scarce_recall"]["values"]) == 6
    assert rows["every recording", "nothing"]["balanced_accuracy"]["mean"] > 0
    assert "best filler" in study.answer[0]


@pytest.mark.parametrize("name", ["copies", "shaken copies", "SMOTE"])
def test_an_error_of_a_filler_stops_the_scarce_drill(name: str, small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*arguments: object) -> np.ndarray:
        raise ValueError("broken")

    monkeypatch.setitem(FEATURE_FILLERS, name, broken)
    with pytest.raises(ValueError, match="broken"):
        run_scarce(small, seeds=[0])


def test_a_folder_without_any_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="pump_cavitation"):
        run_public(tmp_path)
    two_speeds = write_pump(tmp_path, (1000, 1200), ("healthy", "cavitation100"))
    with pytest.raises(DataError, match="two groups"):
        run_public(two_speeds)
    with pytest.raises(InputError, match="none of the sets"):
        run_public(tmp_path, sets=["paderborn"])
    with pytest.raises(InputError, match="seed"):
        run_public(tmp_path, seeds=[])


def machines(carries_over: float, seed: int = 0) -> Question:
    """Six machines of two classes, ten recordings each: one feature knows the machine, one the class."""
    random = np.random.default_rng(seed)
    machine = np.repeat(np.arange(6), 10)
    label = np.where(machine % 2, "worn", "sound")
    of_machine = 10.0 * random.permutation(6)[machine] + 0.1 * random.normal(size=60)
    state = carries_over * (machine % 2) + random.normal(size=60)
    features = {"machine": of_machine[:, None], "state": state[:, None], "usual": np.column_stack([of_machine, state])}
    group = np.array([f"pair {number // 2}" for number in machine])
    units = Units(label, np.arange(60).astype(str), group, group, features)
    settings = (Setting("machine", "extra trees"), Setting("state", "logistic 1"))
    pairs = ("pair 0", "pair 1", "pair 2")
    folds = tuple(Fold(pair, frozenset(pairs) - {pair}, frozenset({pair})) for pair in pairs)
    return Question("made up", units, settings, folds, units)


def test_inner_folds_choose_what_carries_over_and_not_what_knows_the_machine() -> None:
    question = machines(carries_over=6.0)
    train, _ = question.folds[0].sides(question.units.group)
    setting, inner = choose(question, np.flatnonzero(train), 0)
    assert setting.features == "state"
    assert inner > 0.95


def test_the_choice_never_sees_the_test_side() -> None:
    question = machines(carries_over=6.0)
    fold = question.folds[0]
    before = score_fold(question, fold, 0)
    _, test = fold.sides(question.units.group)
    for values in question.units.features.values():
        values[test] += 1e3 * np.random.default_rng(1).normal(size=values[test].shape)
    after = score_fold(question, fold, 0)
    assert (after.setting, after.inner) == (before.setting, before.inner)
    assert after.balanced_accuracy != before.balanced_accuracy


def test_a_random_split_flatters_what_knows_the_machine() -> None:
    question = machines(carries_over=0.0)
    setting_score, trees = leaky_scores(question, question.settings[0], 0)
    honest = np.mean([score_fold(question, fold, 0).rival for fold in question.folds])
    assert setting_score > 0.95
    assert trees > 0.9
    assert honest < 0.75


def test_shared_weights_learn_from_two_seats_to_name_the_third() -> None:
    random = np.random.default_rng(0)
    label = np.repeat(["a", "b", "c"], 40)
    measures = random.normal(size=(120, 3, 2))
    measures[np.arange(120), np.repeat([0, 1, 2], 40), 0] += 4.0
    X = measures.reshape(120, 6)
    fitted = SharedWeights(1.0).fit(X, label)
    assert np.mean(fitted.predict(X) == label) > 0.9
    assert fitted.weights_[0] > 5 * abs(fitted.weights_[1])
    np.testing.assert_allclose(fitted.predict_proba(X).sum(axis=1), 1.0)


@pytest.mark.parametrize("name", [name for name in ESTIMATORS if not name.startswith("growing signs")])
def test_every_estimator_of_many_classes_gives_probabilities_of_them(name: str) -> None:
    random = np.random.default_rng(0)
    label = np.repeat(["a", "b", "c"], 30)
    X = random.normal(size=(90, 6)) + 3 * np.repeat(np.eye(3), 30, axis=0).repeat(2, axis=1)
    probability = ESTIMATORS[name](0).fit(X, label).predict_proba(X)
    assert probability.shape == (90, 3)
    assert np.mean(np.array(["a", "b", "c"])[probability.argmax(axis=1)] == label) > 0.8


def test_a_sign_that_shrinks_with_the_fault_in_training_is_left_out_and_never_turned_round() -> None:
    random = np.random.default_rng(0)
    label = np.repeat(["faulty", "healthy"], 30)
    fault = np.where(label == "faulty", 1.0, 0.0)
    X = np.column_stack([fault + random.normal(0, 0.3, 60), -2 * fault + random.normal(0, 0.1, 60)])
    fitted = GrowingSigns().fit(X, label)
    assert fitted.weights_[0] > 0.5
    assert fitted.weights_[1] == 0
    elsewhere = np.array([[1.5, 3.0], [-0.5, -3.0]])
    assert fitted.predict(elsewhere).tolist() == ["faulty", "healthy"]
    assert np.allclose(fitted.predict_proba(elsewhere).sum(axis=1), 1)


def test_a_motor_with_a_strong_third_harmonic_is_faulty_at_any_gain_on_machines_that_training_never_saw() -> None:
    random, time = np.random.default_rng(1), np.arange(5000) / 1000
    recordings = []
    for block, gain in (("hA", 1.0), ("hB", 9.0), ("fA", 8.0), ("fB", 2.0)):
        third = 0.1 if block[0] == "h" else 1.0
        for number in range(8):
            lines = np.sin(2 * np.pi * 49 * time) + third * np.sin(2 * np.pi * 147 * time)
            signal = gain * (lines + 0.5 * random.normal(size=(3, 5000)))
            label = "healthy" if block[0] == "h" else "faulty"
            name, facts = f"{label}_{block}_{number}", {"block": block}
            recordings.append(Recording(signal, 1000.0, name, ("x", "y", "z"), "g", label=label, attributes=facts))
    question = motor_questions(recordings, 1)[0]
    scores = [score_fold(question, fold, 0) for fold in question.folds]
    assert min(score.balanced_accuracy for score in scores) > 0.9
    assert {score.fold for score in scores} == {"hB + fB", "hA + fA", "hA + fB", "hB + fA"}
