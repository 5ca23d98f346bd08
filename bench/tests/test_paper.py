"""The paper's experiments at a size of seconds: what runs, what is read again, and what the page shows."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from commandline import run_json
from tiny_case import TINY, tiny_recordings

from swashtwin.calibration import IPINN, GaussNewton
from swashtwin.foundation import DataError, InputError, MPa
from swashtwin.learning import Epoch, WindowSet, cut_windows, fit
from swashtwin.recordings import Recording
from swashtwin_bench import EXPERIMENTS, collect_studies, paper_answer, run_paper, write_paper_page
from swashtwin_bench.paper import identification, plans, running
from swashtwin_bench.paper.convergence import convergence_sentence
from swashtwin_bench.paper.identification import CHOSEN, NOMINAL, PHASES_APART
from swashtwin_bench.questions.contenders import Contender
from swashtwin_bench.results.naming import classifier_words
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.runs import fingerprint_of
from swashtwin_bench.results.table import StudyTable
from swashtwin_bench.rigs.writing import DEEP_VERSION
from swashtwin_bench.studies.dataset import prepare
from swashtwin_bench.studies.random_windows import deal_windows

pytestmark = pytest.mark.nightly

SMALL = {"stride": 32, "channels": (4, 4)}


class TinyFleets:
    """The same tiny recordings under every seed."""

    recordings: Sequence[Recording] = ()
    versions: ClassVar[list[str]] = []

    def __init__(self, *settings: str, **_: object) -> None:
        type(self).recordings = type(self).recordings or tiny_recordings()
        self.versions += settings[2:]

    def recordings_for(self, seed: int) -> tuple[Sequence[Recording], str]:
        return self.recordings, fingerprint_of(self.recordings)


def small(kind: str) -> dict[str, Any]:
    if kind.startswith("bitcn"):
        return SMALL
    return {"channels": (4,)} if kind == "tcn" else {"width": 4} if kind.endswith("graph") else {"hidden": 4}


@pytest.fixture(scope="module")
def tiny_paper() -> pytest.MonkeyPatch:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swashtwin_bench.rigs.writing.PRESSURES", (MPa(10), MPa(15)))
        patch.setattr("swashtwin_bench.studies.training_sets.discriminative_score", lambda *_, **__: 0.5)
        patch.setattr("swashtwin_bench.results.study_figures._tsne", lambda features: features[:, :2])
        patch.setattr(running, "Fleets", TinyFleets)
        patch.setattr(plans, "COUNTS", {"small": TINY, "paper": plans.COUNTS["paper"]})
        patch.setattr(plans, "CASE_TWO", {"small": {"scarce_windows": 0}})
        patch.setattr(plans, "TRAINING", {"small": replace(plans.TRAINING["small"], epochs=2)})
        patch.setattr(plans, "NETWORKS", {name: (kind, small(kind)) for name, (kind, _) in plans.NETWORKS.items()})
        patch.setattr(plans, "SNRS", (5.0,))
        searches: Mapping[str, Contender | None] = {
            NOMINAL: None,
            "ipinn_0.9": Contender(IPINN(learning_rate=0.9, epochs=2)),
            CHOSEN: Contender(IPINN(epochs=3)),
            **{name: Contender(GaussNewton(starts=1), phases="phases" in name) for name in PHASES_APART},
        }
        patch.setattr(identification, "methods", lambda size: searches)
        yield patch


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("paper")


@pytest.fixture(scope="module")
def results(tiny_paper: pytest.MonkeyPatch, out: Path) -> dict[str, StudyTable]:
    return run_paper(out, seeds=(3,), command="swashtwin bench paper")


def test_every_experiment_of_the_paper_runs(results: dict[str, StudyTable]) -> None:
    assert list(results) == [study for studies in EXPERIMENTS.values() for study in studies]
    assert {row["classifier"] for row in results["paper-algorithms"].rows()} == set(plans.ALGORITHMS)
    assert {row["classifier"] for row in results["paper-ablation"].rows()} == set(plans.ABLATED)
    assert {row["perturbation"] for row in results["paper-noise"].rows()} == {"clean", "5 dB"}
    assert {row["level"] for row in results["paper-case2-random"].rows()} == {"L0", "L4"}
    assert {row["classifier"] for row in results["paper-related"].rows()} == set(plans.RELATED)
    assert {row["classifier"] for row in results["paper-recess"].rows()} == {plans.MAIN, "extra_trees"}


def test_twins_of_the_papers_recess_simulate_it_for_recordings_that_have_it(results: dict[str, StudyTable]) -> None:
    assert TinyFleets.versions == ["1", DEEP_VERSION]
    run = results["paper-recess"].runs[0]
    (defect,) = run.task.settings["scenario"]["faults"]["swash_plate"]
    assert (defect["depth"], defect["length"], defect["width"]) == pytest.approx((0.6e-3, 30e-3, 24e-3))
    assert defect["contact"] == "shared"


def test_a_training_set_has_as_many_windows_of_each_class_as_the_plan_says() -> None:
    recordings = TinyFleets().recordings_for(0)[0]
    scenario = replace(TINY, windows=5, class_windows=17)
    dataset = prepare(recordings, scenario, 0, [])
    counts = dataset.measured.counts()
    by_class = {name: sum(n for (label, _), n in counts.items() if label == name) for name in dataset.measured.classes}
    assert by_class.pop("swash_plate") == 17 - scenario.synthetic
    assert set(by_class.values()) == {17}
    assert counts["swash_plate", scenario.pressure] == scenario.scarce_windows
    normal = [n for (label, _), n in counts.items() if label == "normal"]
    assert max(normal) - min(normal) <= 1
    with pytest.raises(DataError, match=r"500 training windows of \w+ are wanted .* record longer"):
        prepare(recordings, replace(scenario, class_windows=500), 0, [])


def test_repeats_train_anew_on_the_same_data(results: dict[str, StudyTable]) -> None:
    runs = [run for run in results["paper-algorithms"].runs if run.task.factors["classifier"] == plans.MAIN]
    assert [run.task.seed for run in runs] == [0, 1]
    assert len({run.fingerprints["train"] for run in runs}) == 1
    assert runs[0].history != runs[1].history


def test_finished_runs_are_read_and_no_checkpoint_stays(
    results: dict[str, StudyTable], out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def untouched(*_: object) -> None:
        raise AssertionError("a finished run was run again")

    monkeypatch.setattr("swashtwin_bench.studies.runner.run_task", untouched)
    monkeypatch.setattr(identification, "_values", untouched)
    again = run_paper(out, seeds=(3,), command="swashtwin bench paper")
    assert {name: study.rows() for name, study in again.items()} == {n: study.rows() for n, study in results.items()}
    assert list(out.rglob("*.safetensors")) == []


def test_a_report_of_the_folder_reads_every_study_of_classifiers(results: dict[str, StudyTable], out: Path) -> None:
    collected = collect_studies(out)
    assert {study.study for study in collected} == set(plans.PAPER_PLANS)
    assert {study.size for study in collected} == {"small"}


def test_the_command_prints_what_came_out(results: dict[str, StudyTable], out: Path) -> None:
    answer = run_json("bench", "paper", "--experiments", "ablation", "--seeds", 3, "--jobs", 1, "--out", out)
    assert [study["study"] for study in answer["studies"]] == ["paper-ablation"]
    assert Path(answer["report"]) == out / "paper" / "report.html"
    assert "The full network is" in answer["answer"][0]


def test_the_page_has_each_row_of_the_paper_beside_ours(results: dict[str, StudyTable], tmp_path: Path) -> None:
    page = write_paper_page(results, "small", tmp_path / "page")
    text = page.read_text(encoding="utf-8")
    for figure in ("0.812", "0.9748", "0.9029", "0.910", "9 points below BiTCN", "best epoch 453", "all three fall"):
        assert figure in text
    assert "2 epochs in place of 200" in text
    assert "none on this page" not in text
    assert "not how good it is" in text
    assert "1 fleet of pumps (seeds 3). Differences have no interval." in text
    assert text.count("Not a real pump") == 1
    assert text.count('href="#part-') == 1 + len(EXPERIMENTS)
    studies = json.loads((tmp_path / "page" / "results.json").read_text(encoding="utf-8"))["studies"]
    assert [study["study"] for study in studies] == list(results)


def test_a_page_of_some_experiments_names_the_figures_it_lacks(results: dict[str, StudyTable], tmp_path: Path) -> None:
    page = write_paper_page({"paper-identification": results["paper-identification"]}, "small", tmp_path)
    text = page.read_text(encoding="utf-8")
    assert "paper_identification_rates" in text
    assert "none on this page" in text


def test_the_identification_shows_true_values_and_curves_that_end_early_or_rise(
    results: dict[str, StudyTable], tmp_path: Path
) -> None:
    study = results["paper-identification"]
    curves = [{**curve, "loss": [1.0, 50.0, 0.5][: 2 + number]} for number, curve in enumerate(study.details["curves"])]
    study = replace(study, details={**study.details, "curves": curves})
    text = write_paper_page({study.study: study}, "small", tmp_path).read_text(encoding="utf-8")
    assert "single epochs reach at most so many times the first loss of their pump: 50" in text
    assert "true / nominal" in text
    assert "IPINN, rate 0.0001" in text
    empty = replace(study, details={"curves": [], "parameters": study.details["parameters"][:1]})
    assert "true / nominal" in write_paper_page({study.study: empty}, "small", tmp_path).read_text(encoding="utf-8")


def test_twins_of_another_rig_are_shown_too(results: dict[str, StudyTable], tmp_path: Path) -> None:
    recess = replace(results["paper-recess"], origin="another rig")
    few = {"paper-case1": results["paper-case1"], "paper-recess": recess}
    text = write_paper_page(few, "small", tmp_path / "page").read_text(encoding="utf-8")
    assert "paper_recess_calibration" in text
    assert "<p>another rig</p>" in text


def test_nothing_is_called_fastest_where_epochs_were_not_timed(results: dict[str, StudyTable]) -> None:
    study = results["paper-ablation"]
    assert isinstance(study, StudyResult)
    assert "The full network is" in convergence_sentence(study)
    untimed = replace(study, runs=tuple(replace(run, values={}) for run in study.runs))
    assert convergence_sentence(untimed).endswith("not every epoch was timed.")
    assert "The full network is" not in convergence_sentence(untimed)
    partial = replace(study, runs=study.runs[:2])
    assert classifier_words("paper_forward") not in convergence_sentence(partial)


def test_a_search_that_fails_is_a_row_with_its_reason(
    results: dict[str, StudyTable], monkeypatch: pytest.MonkeyPatch, tiny_paper: pytest.MonkeyPatch
) -> None:
    def failing(*_: object, **__: object) -> None:
        raise InputError("the loss is nan in epoch 2; lower learning_rate.")

    monkeypatch.setattr(identification, "calibrate", failing)
    source = SimpleNamespace(recordings_for=TinyFleets().recordings_for)
    study = identification.run_identification(source, size="small", seeds=(3,))  # type: ignore[arg-type]
    assert not np.isfinite(study.values("rmse", twin=CHOSEN)).any()
    assert np.isfinite(study.values("rmse", twin=NOMINAL)).all()
    assert f"{CHOSEN}: the loss is nan in epoch 2; lower learning_rate." in study.notes


def test_one_training_set_alone_has_a_page(
    results: dict[str, StudyTable], out: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def untouched(*_: object) -> None:
        raise AssertionError("a finished run was run again")

    monkeypatch.setattr("swashtwin_bench.studies.runner.run_task", untouched)
    alone = run_paper(out, seeds=(3,), experiments=("case1", "noise"), training_sets=("calibrated",))
    assert {row["training_set"] for row in alone["paper-case1"].rows()} == {"calibrated"}
    page = write_paper_page(alone, "small", tmp_path).read_text(encoding="utf-8")
    assert "0.9748" in page
    assert {row["training_set"] for row in alone["paper-noise"].rows()} == {"calibrated"}
    nominal = run_paper(out, seeds=(3,), experiments=("case1", "noise"), training_sets=("nominal",))
    assert {row["training_set"] for row in nominal["paper-noise"].rows()} == {"calibrated"}
    assert paper_answer(nominal)[0] == "Case I, few samples: the paper prints no figure of what was run."
    words = ("bench", "paper", "--experiments", "case1", "--seeds", 3, "--out", out, "--training-sets", "nominal")
    (study, _) = run_json(*words, "--jobs", 1)["studies"]
    assert {row["training_set"] for row in study["rows"]} == {"nominal"}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"experiments": ("guess",)}, "no experiment guess"),
        ({"experiments": ()}, "is named"),
        ({"training_sets": ("twins",)}, "no training set 'twins'"),
        ({"size": "huge"}, "of size 'huge'"),
        ({"seeds": ()}, "at least one seed"),
    ],
)
def test_what_cannot_be_run_is_refused_at_once(wrong: dict[str, tuple[str, ...]], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        run_paper(tmp_path, **wrong)  # type: ignore[arg-type]


def test_windows_dealt_at_random_keep_the_counts_of_each_cell() -> None:
    recordings = TinyFleets().recordings_for(0)[0]
    windows = cut_windows(list(recordings), length=2048, stride=8192)
    is_test = np.isin(windows.recording_id, [r.recording_id for r in recordings if r.recording_id.endswith("_2")])
    is_test &= windows.cell_pressure == windows.cell_pressure.max()
    measured, test = windows.subset(~is_test), windows.subset(is_test)
    dealt = deal_windows(measured, test, seed=0)
    assert [each.counts() for each in dealt] == [measured.counts(), test.counts()]
    assert names(dealt[0]) | names(dealt[1]) == names(windows)
    assert not names(dealt[0]) & names(dealt[1])
    assert set(dealt[0].recording_id.tolist()) & set(dealt[1].recording_id.tolist())
    assert [each.fingerprint() for each in deal_windows(measured, test, seed=0)] == [d.fingerprint() for d in dealt]


def names(windows: WindowSet) -> set[tuple[str, int]]:
    return set(zip(windows.recording_id.tolist(), windows.start.tolist(), strict=True))


def test_an_interrupted_training_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    from swashtwin_bench.rivals.models import Model, train_model

    windows = cut_windows(list(TinyFleets().recordings_for(0)[0]), length=2048, stride=8192)
    model = Model("bitcn", SMALL, replace(plans.TRAINING["small"], epochs=2))
    whole = train_model(model, windows, seed=0)
    path = tmp_path / "training.safetensors"

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    from swashtwin.learning import build_network

    network = build_network("bitcn", windows.n_channels, len(windows.classes), **SMALL)
    with pytest.raises(KeyboardInterrupt):
        fit(network, windows, settings=model.training, seed=0, checkpoint=path, progress=interrupt)
    assert path.is_file()
    trained_now: list[Epoch] = []
    resumed = train_model(model, windows, seed=0, checkpoint=path, progress=trained_now.append)
    assert resumed.history == whole.history
    assert [epoch.number for epoch in trained_now] == [2]  # an epoch's time is that of these alone
    assert not path.exists()
