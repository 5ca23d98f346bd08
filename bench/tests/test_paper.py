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

SMALL = {"stride": 32, "channels": (4, 4)}
VERSIONS: list[str] = []
"""Versions of the rig that were asked for."""


def small(kind: str) -> dict[str, Any]:
    if kind.startswith("bitcn"):
        return SMALL
    return (
        {"channels": (4,)}
        if kind == "tcn"
        else {"width": 4}
        if kind.endswith("graph")
        else {"hidden": 4}
    )


@pytest.fixture(scope="module")
def recordings() -> list[Recording]:
    return tiny_recordings()


@pytest.fixture(scope="module")
def tiny_paper(recordings: list[Recording]) -> Iterator[pytest.MonkeyPatch]:
    def fleets(
        folder: Path, size: str, version: str, work: Work
    ) -> Callable[[int], Sequence[Recording]]:
        VERSIONS.append(version)
        return lambda seed: recordings

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swashtwin_bench.rigs.writing.PRESSURES", (MPa(10), MPa(15)))
        patch.setattr(
            "swashtwin_bench.studies.training_sets.discriminative_score", lambda *_, **__: 0.5
        )
        patch.setattr(
            "swashtwin_bench.results.figures._compute_tsne", lambda features: features[:, :2]
        )
        patch.setattr(experiments, "find_fleets", fleets)
        patch.setitem(plans.SCENARIOS, ("paper", "quick"), TINY)
        patch.setitem(plans.CASE_TWO, ("paper", "quick"), {"scarce_windows": 0})
        patch.setitem(plans.TRAINING, "quick", replace(plans.TRAINING["quick"], epochs=2))
        patch.setattr(
            plans,
            "NETWORKS",
            {name: (kind, {**own, **small(kind)}) for name, (kind, own) in plans.NETWORKS.items()},
        )
        patch.setattr(plans, "SNRS", (5.0,))
        searches: Mapping[str, Contender | None] = {
            NOMINAL: None,
            "ipinn_0.9": Contender(IPINN(learning_rate=0.9, epochs=2)),
            LOWEST_RATE: Contender(IPINN(epochs=3)),
            "gauss_newton_housing": Contender(GaussNewton(starts=1)),
        }
        patch.setattr(identification, "methods", lambda size: searches)
        yield patch


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("paper")


@pytest.fixture(scope="module")
def results(tiny_paper: pytest.MonkeyPatch, out: Path) -> dict[str, StudyTable]:
    return run_paper(Work((3,), out=out, command="swashtwin bench study paper"))


def test_every_experiment_of_the_paper_runs(results: dict[str, StudyTable]) -> None:
    assert list(results) == [f"paper-{name}" for name in EXPERIMENTS]
    for name, networks in plans.CLASSIFIERS.items():
        assert {row["classifier"] for row in results[f"paper-{name}"].rows()} == set(networks)
    assert {row["perturbation"] for row in results["paper-noise"].rows()} == {"clean", "5 dB"}
    assert {(row["windows"], row["split"]) for row in results["paper-case2"].rows()} == {
        ("by recording", "L2"), ("by recording", "L4"), ("at random", "L0"), ("at random", "L4"),
    }  # fmt: skip
    assert {row["classifier"] for row in results["paper-recess"].rows()} == {
        plans.PAPER_NETWORK,
        "extra_trees",
    }
    assert set(VERSIONS) == {"1", "1-deep"}


def test_repeats_train_anew_on_the_same_data(results: dict[str, StudyTable]) -> None:
    study = results["paper-algorithms"]
    assert isinstance(study, StudyResult)
    runs = [run for run in study.runs if run["factors"]["classifier"] == plans.PAPER_NETWORK]
    assert [run["seed"] for run in runs] == [0, 1]
    assert len({run["sha256"]["train"] for run in runs}) == 1
    assert runs[0]["history"] != runs[1]["history"]


def test_finished_runs_are_read_and_no_checkpoint_stays(
    results: dict[str, StudyTable],
    recordings: list[Recording],
    out: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def untouched(*_: object, **__: object) -> None:
        raise AssertionError("a finished run was run again")

    monkeypatch.setattr("swashtwin_bench.studies.runner.train_and_test", untouched)
    monkeypatch.setattr(identification, "_values", untouched)
    again = run_paper(Work((3,), out=out))
    assert {name: study.rows() for name, study in again.items()} == {
        n: study.rows() for n, study in results.items()
    }
    assert list(out.rglob("*.safetensors")) == []
    monkeypatch.setattr(experiments, "load_recordings", lambda source: recordings)
    own = run_paper(Work((3,), out=out), experiments=("case2",), source=Path("own recordings"))
    assert own["paper-case2"].rows() == results["paper-case2"].rows()
    words = (
        "bench",
        "study",
        "paper",
        "--set",
        "experiments=case1,noise",
        "--set",
        "training_sets=nominal",
    )
    answer = run_json(*words, "--seeds", 3, "--jobs", 1, "--out", out)
    case1, noise = answer["studies"]
    assert {row["training_set"] for row in case1["rows"]} == {"nominal"}
    assert {row["training_set"] for row in noise["rows"]} == {"calibrated"}
    assert answer["answer"][0] == "Case I, few samples: the paper prints no figure of what was run."
    assert Path(answer["report"]) == out / "paper" / "report.html"


def test_the_page_has_each_row_of_the_paper_beside_ours(
    results: dict[str, StudyTable], tmp_path: Path
) -> None:
    page = write_paper_page(results, "quick", tmp_path / "page")
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
    for words in (
        "2 epochs in place of 200",
        "not how good it is",
        "true / nominal",
        "The full network is",
    ):
        assert words in text
    assert "none on this page" not in text
    assert "1 fleet of pumps (seeds 3). Differences have no interval." in text
    studies = json.loads((tmp_path / "page" / "results.json").read_text(encoding="utf-8"))[
        "studies"
    ]
    assert [study["study"] for study in studies] == list(results)
    one = write_paper_page(
        {identification.STUDY: results[identification.STUDY]}, "quick", tmp_path / "one"
    )
    assert "none on this page" in one.read_text(encoding="utf-8")


def test_convergence_counts_fleets_with_every_network(results: dict[str, StudyTable]) -> None:
    study = results["paper-ablation"]
    assert isinstance(study, StudyResult)
    assert "The full network is" in convergence_sentence(study)
    assert "no fleet" in convergence_sentence(
        replace(study, runs=(*study.runs[:2], {**study.runs[2], "seed": 9}))
    )


def test_a_search_that_fails_is_a_row_with_its_reason(
    tiny_paper: pytest.MonkeyPatch, recordings: list[Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object, **__: object) -> None:
        raise InputError("the loss is nan in epoch 2; lower learning_rate.")

    monkeypatch.setattr(identification, "calibrate", failing)
    study = identification.run_identification(Work((3,)), "quick", lambda seed: recordings)
    assert not np.isfinite(study.values("rmse", twin=LOWEST_RATE)).any()
    assert np.isfinite(study.values("rmse", twin=NOMINAL)).all()
    assert f"{LOWEST_RATE}: the loss is nan in epoch 2; lower learning_rate." in study.notes
    assert "every search failed" in str(identification.values_table(study))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"experiments": ("guess",)}, "no experiment guess"),
        ({"experiments": ()}, "is named"),
        ({"settings": {"training_sets": "twins"}}, "no training set 'twins'"),
        ({"size": "huge"}, "no size 'huge'"),
    ],
)
def test_what_cannot_be_run_is_refused_at_once(
    wrong: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        run_paper(Work(out=tmp_path), **wrong)


def test_a_training_set_has_as_many_windows_of_each_class_as_the_plan_says(
    recordings: list[Recording],
) -> None:
    scenario = replace(TINY, windows=5, class_windows=17)
    dataset = prepare_dataset(recordings, scenario, 0, [])
    counts = dataset.measured.counts()
    by_class = {
        name: sum(n for (label, _), n in counts.items() if label == name)
        for name in dataset.measured.classes
    }
    assert by_class.pop("swash_plate") == 17 - scenario.synthetic
    assert set(by_class.values()) == {17}
    assert counts["swash_plate", scenario.pressure] == scenario.scarce_windows
    with pytest.raises(DataError, match=r"needs 500 training windows of \w+ .* Record longer"):
        prepare_dataset(recordings, replace(scenario, class_windows=500), 0, [])


def test_windows_dealt_at_random_keep_the_counts_of_each_cell(recordings: list[Recording]) -> None:
    windows = cut_windows(recordings, length=2048, stride=8192)
    is_test = np.isin(
        windows.recording_id, [r.recording_id for r in recordings if r.recording_id.endswith("_2")]
    )
    is_test &= windows.cell_pressure == windows.cell_pressure.max()
    measured, test = windows.subset(~is_test), windows.subset(is_test)
    dealt = deal_windows(measured, test, seed=0)
    assert [each.counts() for each in dealt] == [measured.counts(), test.counts()]
    assert names(dealt[0]) | names(dealt[1]) == names(windows)
    assert not names(dealt[0]) & names(dealt[1])
    assert set(dealt[0].recording_id.tolist()) & set(dealt[1].recording_id.tolist())
    assert [each.fingerprint() for each in deal_windows(measured, test, seed=0)] == [
        d.fingerprint() for d in dealt
    ]


def names(windows: WindowSet) -> set[tuple[str, int]]:
    return set(zip(windows.recording_id.tolist(), windows.start.tolist(), strict=True))


def test_an_interrupted_training_goes_on_from_its_checkpoint(
    recordings: list[Recording], tmp_path: Path
) -> None:
    windows = cut_windows(recordings, length=2048, stride=8192)
    model = Model("bitcn", SMALL, replace(plans.TRAINING["quick"], epochs=2))
    whole = train_model(model, windows, seed=0)
    path = tmp_path / "training.safetensors"

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    network = build_network("bitcn", windows.n_channels, len(windows.classes), **SMALL)
    with pytest.raises(KeyboardInterrupt):
        fit(network, windows, settings=model.training, seed=0, checkpoint=path, progress=interrupt)
    assert path.is_file()
    trained_now: list[Epoch] = []
    resumed = train_model(model, windows, seed=0, checkpoint=path, progress=trained_now.append)
    assert resumed.history == whole.history
    assert [epoch.number for epoch in trained_now] == [2]  # an epoch's time is that of these alone
    assert not path.exists()


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
    assert (
        format_reported(name, {"classifier": classifier, "training_set": "measured", "split": "L2"})
        == expected
    )
