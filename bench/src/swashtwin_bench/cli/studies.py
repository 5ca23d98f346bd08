"""Commands of the studies: bench study, bench paper, bench report."""

import difflib
import shlex
import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli import (
    Jobs,
    Json,
    as_folder,
    note,
    note_done_before,
    progress,
    read_pairs,
    read_seeds,
    read_words,
    require_files,
    resumable,
    say,
    table,
    tell,
)

if TYPE_CHECKING:
    from swashtwin_bench import StudyTable, Work

STUDIES = {
    "case1": "few samples: what a twin adds where one class has few measured windows",
    "case2": "missing condition: a cell without any measured window, which twins fill",
    "recess": "Case I with the paper's recess of 0.6 mm",
    "algorithms": "every network and baseline on Case I's calibrated training set",
    "ablation": "BiTCN without one of its parts",
    "noise": "noise, gains and speeds in the tests, trained clean and with noise",
    "related": "networks that the paper names as related work",
    "augmentation": "every filler of the scarce cell, by the number of synthetic windows",
    "unseen-pressure": "no fault was ever measured at the test's pressure: filled by twins, and not",
    "fair-test": "calibrated twins with the law of the recess against nominal ones (docs/bench/fair-test.md)",
    "alarms": "false alarms on healthy pumps that drift, severity and delay where faults grow",
    "calibration": "errors on recordings held out, coverage and cost of every way to calibrate",
    "confidence": "calibration, coverage, and faults that a classifier never trained on",
    "severity": "severity by inversion against the hidden truth, by fault and dimension",
    "wrong-twins": "wrong twins and odd truths: do values called identified hold, and is one warned?",
    "zero-shot": "the pump prior, which learned from twins alone, tested on measured faults",
    "public": "public sets on honest splits by the ordinary training; SOURCE holds a folder of each",
    "run-to-failure": "when the alarm comes in the life of bearings run until they failed; SOURCE holds the set",
}
"""Question of each study, by its name."""


def _known(name: str) -> str:
    if name not in STUDIES:
        near = difflib.get_close_matches(name, STUDIES, n=1, cutoff=0.3)
        hint = f"did you mean {near[0]}? There" if near else "there"
        raise typer.BadParameter(f"no study is called {name!r}; {hint} are {', '.join(STUDIES)}.")
    return name


StudyName = Annotated[
    str,
    typer.Argument(
        callback=_known,
        autocompletion=lambda: list(STUDIES),
        help="\n\n".join(f"{name}: {text}" for name, text in STUDIES.items()),
    ),
]


class Size(StrEnum):
    """Counts and epochs of a study."""

    quick = "quick"
    medium = "medium"
    paper = "paper"


class Recipe(StrEnum):
    """Whose network and counts."""

    ours = "ours"
    paper = "paper"


class Device(StrEnum):
    """Where networks are trained."""

    cpu = "cpu"
    cuda = "cuda"


SizeName = Annotated[
    Size,
    typer.Option(
        help="quick: minutes of two cores; medium: the paper's counts, 30 epochs, its network on patches, "
        "hours; paper: 200 epochs, every sample a step, weeks of a CPU."
    ),
]
Seeds = Annotated[str, typer.Option(help='Seeds; on the virtual rig a fleet each: "100,101".')]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help='What is set of the study, NAME=VALUE: "classifiers=bitcn,tcn"; repeatable.'),
]
DeviceName = Annotated[Device, typer.Option(help="Where networks are trained.")]


def study(
    name: StudyName,
    source: Annotated[
        Path | None,
        typer.Argument(metavar="[SOURCE]", help="Index, store or folder of recordings; without it, the virtual rig."),
    ] = None,
    size: SizeName = Size.quick,
    recipe: Annotated[
        Recipe, typer.Option(help="Our network and settings, or the paper's, in the paper's seven studies.")
    ] = Recipe.ours,
    seeds: Seeds = "0",
    settings: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of fleets and finished runs, which a re-run continues, and of STUDY/report.html.",
            callback=as_folder,
        ),
    ] = None,
    jobs: Jobs = 2,
    device: DeviceName = Device.cpu,
    as_json: Json = False,
) -> None:
    """Run a study: one question, its table, its answer and a page."""
    numbers, pairs = read_seeds(seeds), read_pairs(settings, "--set")
    from swashtwin_bench import run_study, write_study_report

    def run(work: "Work") -> "StudyTable":
        return run_study(name, source, work=work, size=size.value, recipe=recipe.value, settings=pairs)

    result = _watched(name, numbers, out, jobs, device, run)
    page = None if out is None else write_study_report(result, folder=out / result.study)

    def show() -> None:
        show_study(result)
        if page is not None:
            say(f"Report: {page}")

    tell({**result.to_dict(), "report": page}, as_json, show)


def _watched(
    what: str, seeds: list[int], out: Path | None, jobs: int, device: Device, run: Callable[["Work"], Any]
) -> Any:
    """Result of `run` with a bar, and with what an interruption means."""
    from swashtwin_bench import Work

    kept = "finished runs are kept; the same command resumes"
    with resumable(kept if out is not None else "with --out, finished runs would be kept"), progress(what) as bar:

        def show(activity: str, count: int, total: int) -> None:
            note_done_before(activity, out)
            bar(count, total, f"{what}: {activity}")

        return run(Work(seeds, jobs, out, show, device.value, typed_command()))


def typed_command() -> str:
    """The command line as it was typed, for a result to record."""
    return shlex.join(["swashtwin", *sys.argv[1:]])


def show_study(study: "StudyTable") -> None:
    """Print a study as a table with its answer and its notes."""
    metrics = {name: words for name, words in study.metrics.items() if not name.startswith("recall_")}

    def spread(value: dict[str, Any]) -> str:
        if value["mean"] is None:
            return "-"
        return f"{value['mean']:.3f}" + ("" if value["std"] is None else f" ± {value['std']:.3f}")

    rows = []
    for row in study.rows():
        count = max(len(value["values"]) for value in row.values() if isinstance(value, dict))
        rows.append([*(row[name] for name in study.factors), count, *(spread(row[name]) for name in metrics)])
    title = f"{study.title}; seed {', '.join(map(str, study.seeds))}, {study.wall_s:.0f} s"
    table(title, (*study.factors, "seeds", *metrics.values()), rows)
    for text in (*study.answer, *study.notes, study.origin):
        say(text)


def paper(
    size: SizeName = Size.quick,
    seeds: Seeds = "20",
    experiments: Annotated[
        str | None,
        typer.Option(
            help="Some of case1, case2, recess, algorithms, ablation, noise, related, identification; all by default."
        ),
    ] = None,
    settings: Settings = None,
    out: Annotated[
        Path,
        typer.Option(
            help="Folder of fleets and finished runs, which a re-run continues, and of paper/report.html.",
            callback=as_folder,
        ),
    ] = Path("swashtwin-paper"),
    jobs: Jobs = 2,
    device: DeviceName = Device.cpu,
    as_json: Json = False,
) -> None:
    """Every experiment of the paper with its own network and recipe, and one page: its figures beside ours."""
    from swashtwin.foundation import has_bfloat16_arithmetic
    from swashtwin_bench import EXPERIMENTS, Work, paper_answer, run_paper, write_paper_page

    numbers, pairs = read_seeds(seeds), read_pairs(settings, "--set")
    names = EXPERIMENTS if experiments is None else read_words(experiments)
    if pairs.get("precision") == "bfloat16" and device is Device.cpu and not has_bfloat16_arithmetic():
        note("This processor has no instructions for 16 bits: bfloat16 trains many times slower here than float32.")

    def run(work: Work) -> Any:
        return run_paper(work, size=size.value, experiments=tuple(names), settings=pairs)

    results = _watched("the paper", numbers, out, jobs, device, run)
    page = write_paper_page(results, size.value, out / "paper")
    answer = paper_answer(results)
    studies = [study.to_dict() for study in results.values()]
    result = {"report": page, "size": size.value, "answer": list(answer), "studies": studies}
    tell(result, as_json, lambda: say("\n".join([*answer, f"Report: {page}"])))


def report(
    folders: Annotated[list[Path], typer.Argument(metavar="FOLDER...", help="Folders of studies' runs.")],
    out: Annotated[Path, typer.Option(help="Folder for report.html, its figures and their data.", callback=as_folder)],
    as_json: Json = False,
) -> None:
    """Write one page of the finished runs of studies of classifiers."""
    from swashtwin_bench import PLANS, collect_studies, write_study_report

    require_files(folders)
    studies = [study for folder in folders for study in collect_studies(folder, PLANS)]
    page = write_study_report(*studies, folder=out)
    told: list[dict[str, Any]] = [
        {"study": study.study, "size": study.size, "seeds": [*study.seeds], "runs": len(study.runs),
         "answer": [*study.answer]}
        for study in studies
    ]  # fmt: skip

    def show() -> None:
        rows = [(each["study"], each["size"], ", ".join(map(str, each["seeds"])), each["runs"]) for each in told]
        table("Studies", ("study", "size", "seeds", "runs"), rows)
        say(f"Report: {page}")

    tell({"report": page, "studies": told}, as_json, show)
