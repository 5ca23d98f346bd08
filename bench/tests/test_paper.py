"""The paper's experiments at a size of seconds: what runs, what is read again, and what the page
shows.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import run_json
from tiny_case import TINY, tiny_recordings

from swashtwin.calibration import IPINN, GaussNewton
from swashtwin.foundation import DataError, InputError, MPa
from swashtwin.learning import Epoch, WindowSet, build_network, cut_windows, fit
from swashtwin.recordings import Recording
from swashtwin_bench import EXPERIMENTS, Work, run_paper, write_paper_page
from swashtwin_bench.paper import experiments, identification
from swashtwin_bench.paper.experiments import convergence_sentence
from swashtwin_bench.paper.identification import LOWEST_RATE, NOMINAL
from swashtwin_bench.questions.calibration import Contender
from swashtwin_bench.results.reported import format_reported
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.table import StudyTable
from swashtwin_bench.rivals.models import Model, train_model
from swashtwin_bench.studies import plans
from swashtwin_bench.studies.dataset import deal_windows, prepare_dataset

pytestmark = pytest.mark.nightly


# ---- the paper in seconds


SMALL_BITCN = {"stride": 32, "channels": (4, 4)}
SMALL_NETWORKS: Mapping[str, Mapping[str, Any]] = {
    "bitcn": SMALL_BITCN,
    "tcn": {"channels": (4,)},
    "sensor_graph": {"width": 4},
}
"""Settings of a small network by kind; other kinds have `hidden` features."""

SEARCHES: Mapping[str, Contender | None] = {
    NOMINAL: None,
    "ipinn_0.9": Contender(IPINN(learning_rate=0.9, epochs=2)),
    LOWEST_RATE: Contender(IPINN(epochs=3)),
    "gauss_newton_housing": Contender(GaussNewton(starts=1)),
}

RIG_VERSIONS: list[str] = []
"""Requested versions of the rig."""


def small_networks() -> dict[str, tuple[str, dict[str, Any]]]:
    """Return the networks of the paper with few features."""
    networks = {}
    for name, (kind, settings) in plans.NETWORKS.items():
        few_features = SMALL_NETWORKS.get(kind, {"hidden": 4})
        networks[name] = (kind, {**settings, **few_features})
    return networks


@pytest.fixture(scope="module")
def recordings() -> list[Recording]:
    return tiny_recordings()


@pytest.fixture(scope="module")
def tiny_paper(recordings: list[Recording]) -> Iterator[pytest.MonkeyPatch]:
    """Run the paper on the tiny rig with small networks and few searches."""

    def tiny_fleets(
        folder: Path, size: str, version: str, work: Work
    ) -> Callable[[int], Sequence[Recording]]:
        RIG_VERSIONS.append(version)
        return lambda seed: recordings

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiments, "find_fleets", tiny_fleets)
        patch.setattr("swashtwin_bench.rigs.writing.PRESSURES", (MPa(10), MPa(15)))
        patch.setitem(plans.SCENARIOS, ("paper", "quick"), TINY)
        patch.setitem(plans.CASE_TWO, ("paper", "quick"), {"scarce_windows": 0})

        two_epochs = replace(plans.TRAINING["quick"], epochs=2)
        patch.setitem(plans.TRAINING, "quick", two_epochs)
        patch.setattr(plans, "NETWORKS", small_networks())
        patch.setattr(plans, "SNRS", (5.0,))
        patch.setattr(identification, "methods", lambda size: SEARCHES)

        # a score and a figure that take minutes and are tested elsewhere
        patch.setattr(
            "swashtwin_bench.studies.training_sets.discriminative_score", lambda *_, **__: 0.5
        )
        patch.setattr(
            "swashtwin_bench.results.figures._compute_tsne", lambda features: features[:, :2]
        )
        yield patch


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the runs of `results`."""
    return tmp_path_factory.mktemp("paper")


@pytest.fixture(scope="module")
def results(tiny_paper: pytest.MonkeyPatch, out: Path) -> dict[str, StudyTable]:
    return run_paper(Work((3,), out=out, command="swashtwin bench study paper"))


def column(study: StudyTable | StudyResult, *names: str) -> set[Any]:
    """Return the different values in a column of the rows, or in several."""
    rows = study.rows()
    if len(names) == 1:
        return {row[names[0]] for row in rows}
    return {tuple(row[name] for name in names) for row in rows}


# ---- what runs


def test_every_experiment_of_the_paper_runs(results: dict[str, StudyTable]) -> None:
    assert list(results) == [f"paper-{name}" for name in EXPERIMENTS]
    for name, networks in plans.CLASSIFIERS.items():
        assert column(results[f"paper-{name}"], "classifier") == set(networks)
    assert column(results["paper-noise"], "perturbation") == {"clean", "5 dB"}


def test_case_two_is_split_by_recording_and_at_random(results: dict[str, StudyTable]) -> None:
    # windows at random are no other test of the pumps that were held out
    assert column(results["paper-case2"], "windows", "split") == {
        ("by recording", "L2"),
        ("by recording", "L4"),
        ("at random", "L0"),
        ("at random", "L4"),
    }


def test_the_recess_of_the_paper_is_on_its_own_version_of_the_rig(
    results: dict[str, StudyTable],
) -> None:
    classifiers = column(results["paper-recess"], "classifier")
    assert classifiers == {plans.PAPER_NETWORK, "extra_trees"}
    assert set(RIG_VERSIONS) == {"1", "1-deep"}


def test_repeats_train_anew_on_the_same_data(results: dict[str, StudyTable]) -> None:
    study = results["paper-algorithms"]
    assert isinstance(study, StudyResult)
    runs = [run for run in study.runs if run["factors"]["classifier"] == plans.PAPER_NETWORK]
    assert [run["seed"] for run in runs] == [0, 1]
    assert len({run["sha256"]["train"] for run in runs}) == 1
    assert runs[0]["history"] != runs[1]["history"]


# ---- what is read again


@pytest.fixture
def no_training(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail if a finished run is run again."""

    def untouched(*_: object, **__: object) -> None:
        raise AssertionError("a finished run was run again")

    monkeypatch.setattr("swashtwin_bench.studies.runner.train_and_test", untouched)
    monkeypatch.setattr(identification, "_values", untouched)


@pytest.mark.usefixtures("no_training")
def test_finished_runs_are_read_and_no_checkpoint_stays(
    results: dict[str, StudyTable], out: Path
) -> None:
    again = run_paper(Work((3,), out=out))
    assert list(again) == list(results)
    for name, study in again.items():
        assert study.rows() == results[name].rows()
    assert list(out.rglob("*.safetensors")) == []


@pytest.mark.usefixtures("no_training")
def test_recordings_from_a_folder_count_as_those_of_the_rig_with_equal_samples(
    results: dict[str, StudyTable],
    recordings: list[Recording],
    out: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(experiments, "load_recordings", lambda source: recordings)
    study = run_paper(Work((3,), out=out), experiments=("case2",), source=Path("own recordings"))
    assert study["paper-case2"].rows() == results["paper-case2"].rows()


@pytest.mark.usefixtures("no_training", "results")
def test_the_command_runs_a_part_of_the_paper(out: Path) -> None:
    settings = ("--set", "experiments=case1,noise", "--set", "training_sets=nominal")
    command = ("bench", "study", "paper", *settings, "--seeds", 3, "--jobs", 1, "--out", out)
    answer = run_json(*command)

    # noise has only one training set, so the setting does not apply to it
    case1, noise = answer["studies"]
    assert {row["training_set"] for row in case1["rows"]} == {"nominal"}
    assert {row["training_set"] for row in noise["rows"]} == {"calibrated"}
    assert answer["answer"][0] == "Case I, few samples: the paper prints no figure of what was run."
    assert Path(answer["report"]) == out / "paper" / "report.html"


def test_an_interrupted_training_goes_on_from_its_checkpoint(
    recordings: list[Recording], tmp_path: Path
) -> None:
    windows = cut_windows(recordings, length=2048, stride=8192)
    model = Model("bitcn", SMALL_BITCN, replace(plans.TRAINING["quick"], epochs=2))
    whole = train_model(model, windows, seed=0)
    path = tmp_path / "training.safetensors"

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    network = build_network("bitcn", windows.n_channels, len(windows.classes), **SMALL_BITCN)
    with pytest.raises(KeyboardInterrupt):
        fit(network, windows, settings=model.training, seed=0, checkpoint=path, progress=interrupt)
    assert path.is_file()

    trained_now: list[Epoch] = []
    resumed = train_model(model, windows, seed=0, checkpoint=path, progress=trained_now.append)
    assert resumed.history == whole.history
    # the time of an epoch is that of the epochs trained now
    assert [epoch.number for epoch in trained_now] == [2]
    assert not path.exists()


# ---- the page


@pytest.fixture(scope="module")
def page(results: dict[str, StudyTable], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_paper_page(results, "quick", tmp_path_factory.mktemp("page"))


def test_the_page_has_each_figure_of_the_paper_beside_ours(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for figure in (
        "0.812",
        "0.9748",
        "0.9029",
        "0.910",
        "9 points below BiTCN",
        "best epoch 453",
        "all three fall",
    ):
        assert figure in text
    assert "none on this page" not in text


def test_the_page_states_what_a_small_size_cannot_show(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for words in (
        "2 epochs in place of 200",
        "not how good it is",
        "true / nominal",
        "The full network is",
    ):
        assert words in text
    assert "1 fleet of pumps (seeds 3). Differences have no interval." in text


def test_the_page_comes_with_the_json_of_its_studies(
    results: dict[str, StudyTable], page: Path
) -> None:
    table = json.loads((page.parent / "results.json").read_text(encoding="utf-8"))
    assert [study["study"] for study in table["studies"]] == list(results)


def test_a_page_of_one_study_reports_that_the_others_are_missing(
    results: dict[str, StudyTable], tmp_path: Path
) -> None:
    one_study = {identification.STUDY: results[identification.STUDY]}
    page = write_paper_page(one_study, "quick", tmp_path / "one")
    assert "none on this page" in page.read_text(encoding="utf-8")


def test_convergence_counts_fleets_with_every_network(results: dict[str, StudyTable]) -> None:
    study = results["paper-ablation"]
    assert isinstance(study, StudyResult)
    assert "The full network is" in convergence_sentence(study)

    # the third network moves to another fleet, so that no fleet has all of them
    first, second, third = study.runs[:3]
    incomplete = replace(study, runs=(first, second, {**third, "seed": 9}))
    assert "no fleet" in convergence_sentence(incomplete)


@pytest.mark.parametrize(
    ("name", "classifier", "expected"),
    [
        ("case1", "paper_bitcn", "accuracy 0.812"),
        ("case1", "tcn", "the paper's BiTCN: accuracy 0.812"),
        ("algorithms", "bitcn", "the paper's BiTCN: accuracy 0.98"),
        ("algorithms", "tcn", "more than 8 points below BiTCN"),
        ("ablation", "paper_forward", "below the full model"),
        ("case9", "paper_bitcn", ""),
    ],
)
def test_a_figure_of_the_paper_beside_another_network_says_whose_it_is(
    name: str, classifier: str, expected: str
) -> None:
    factors = {"classifier": classifier, "training_set": "measured", "split": "L2"}
    assert format_reported(name, factors) == expected


# ---- failures and refusals


def test_a_search_that_fails_is_a_row_with_its_reason(
    tiny_paper: pytest.MonkeyPatch, recordings: list[Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    message = "the loss is nan in epoch 2; lower learning_rate."

    def failing(*_: object, **__: object) -> None:
        raise InputError(message)

    monkeypatch.setattr(identification, "calibrate", failing)
    study = identification.run_identification(Work((3,)), "quick", lambda seed: recordings)

    # the nominal twin needs no search
    assert np.isfinite(study.values("rmse", twin=NOMINAL)).all()
    assert not np.isfinite(study.values("rmse", twin=LOWEST_RATE)).any()
    assert f"{LOWEST_RATE}: {message}" in study.notes
    assert "every search failed" in str(identification.values_table(study))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"experiments": ("guess",)}, "no experiment guess"),
        ({"experiments": ()}, "is named"),
        ({"settings": {"training_sets": "twins"}}, "no training set 'twins'"),
        ({"size": "huge"}, "no size 'huge'"),
    ],
)
def test_invalid_arguments_are_refused_at_once(
    arguments: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        run_paper(Work(out=tmp_path), **arguments)


# ---- counts of windows


def test_a_training_set_has_as_many_windows_of_each_class_as_the_plan_says(
    recordings: list[Recording],
) -> None:
    scenario = replace(TINY, windows=5, class_windows=17)
    measured = prepare_dataset(recordings, scenario, 0, []).measured
    counts = measured.counts()

    by_class = dict.fromkeys(measured.classes, 0)
    for (label, _), count in counts.items():
        by_class[label] += count

    # the synthetic windows complete the scarce class
    assert by_class.pop("swash_plate") == 17 - scenario.synthetic
    assert set(by_class.values()) == {17}
    assert counts["swash_plate", scenario.pressure] == scenario.scarce_windows


def test_more_windows_than_were_recorded_are_refused(recordings: list[Recording]) -> None:
    scenario = replace(TINY, windows=5, class_windows=500)
    with pytest.raises(DataError, match=r"needs 500 training windows of \w+ .* Record longer"):
        prepare_dataset(recordings, scenario, 0, [])


@pytest.fixture
def split_by_recording(recordings: list[Recording]) -> tuple[WindowSet, WindowSet]:
    """Training and test windows; the test has the second recordings at the highest pressure."""
    windows = cut_windows(recordings, length=2048, stride=8192)
    is_second = np.char.endswith(windows.recording_id, "_2")
    is_test = is_second & (windows.cell_pressure == windows.cell_pressure.max())
    return windows.subset(~is_test), windows.subset(is_test)


def identities(windows: WindowSet) -> set[tuple[str, int]]:
    """Return recording and start of each window."""
    return set(zip(windows.recording_id.tolist(), windows.start.tolist(), strict=True))


def test_windows_dealt_at_random_keep_the_counts_of_each_cell(
    split_by_recording: tuple[WindowSet, WindowSet],
) -> None:
    measured, test = split_by_recording
    dealt_measured, dealt_test = deal_windows(measured, test, seed=0)
    assert dealt_measured.counts() == measured.counts()
    assert dealt_test.counts() == test.counts()


def test_windows_dealt_at_random_are_the_same_windows_and_share_recordings(
    split_by_recording: tuple[WindowSet, WindowSet],
) -> None:
    measured, test = split_by_recording
    dealt_measured, dealt_test = deal_windows(measured, test, seed=0)

    dealt = identities(dealt_measured) | identities(dealt_test)
    assert dealt == identities(measured) | identities(test)
    assert not identities(dealt_measured) & identities(dealt_test)

    # the leak that this split measures
    assert set(dealt_measured.recording_id.tolist()) & set(dealt_test.recording_id.tolist())


def test_windows_are_dealt_alike_under_one_seed(
    split_by_recording: tuple[WindowSet, WindowSet],
) -> None:
    first = deal_windows(*split_by_recording, seed=0)
    second = deal_windows(*split_by_recording, seed=0)
    assert [part.fingerprint() for part in first] == [part.fingerprint() for part in second]
