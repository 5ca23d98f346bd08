"""The command of the studies: bench study."""

import difflib
import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli import (
    Jobs,
    Json,
    print_note,
    print_result,
    print_table,
    print_text,
    progress,
    read_list,
    read_pairs,
    require_folder,
    split_names,
)

if TYPE_CHECKING:
    from swashtwin_bench import StudyTable, Work

STUDIES = {
    "paper": "every experiment of the paper by its own recipe, on one page of its figures beside ours; "
    "experiments=case1,noise takes some",
    "case1": "few samples: what a twin adds where one class has few measured windows",
    "case2": "missing condition: a cell without any measured window, which twins fill",
    "algorithms": "every network and baseline on Case I's calibrated training set",
    "noise": "noise, gains and speeds in the tests, trained clean and with noise",
    "augmentation": "every filler of the scarce cell, by the number of synthetic windows",
    "fair-test": "calibrated twins with the law of the recess against nominal ones (docs/bench/fair-test.md)",
    "alarms": "false alarms on healthy pumps that drift, severity and delay where faults grow",
    "detector": "false alarms and faults caught from healthy recordings alone, with two odd ones among twenty",
    "calibration": "errors on recordings held out, coverage and cost of every way to calibrate",
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


def _has_bfloat16_arithmetic() -> bool:
    """Whether the processor may have instructions for bfloat16: no x86 up to AVX2 has, nor the
    first with AVX-512, which torch does not tell.
    """
    import torch

    return torch.backends.cpu.get_cpu_capability() not in ("NO AVX", "AVX2")


class Size(StrEnum):
    """Counts and epochs of a study."""

    quick = "quick"
    medium = "medium"
    paper = "paper"


class Device(StrEnum):
    """Where networks are trained."""

    cpu = "cpu"
    cuda = "cuda"


def study(
    name: Annotated[
        str,
        typer.Argument(
            callback=_known,
            autocompletion=lambda: list(STUDIES),
            help="\n\n".join(f"{name}: {text}" for name, text in STUDIES.items()),
        ),
    ],
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="[SOURCE]",
            help="Index, store or folder of recordings; without it, the virtual rig.",
        ),
    ] = None,
    size: Annotated[
        Size,
        typer.Option(
            help="quick: minutes of two cores; medium: the paper's counts, 30 epochs, its network on patches, "
            "hours; paper: 200 epochs, every sample a step, weeks of a CPU."
        ),
    ] = Size.quick,
    seeds: Annotated[
        str, typer.Option(help='Seeds; on the virtual rig a fleet each: "100,101".')
    ] = "0",
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help='What is set of the study, NAME=VALUE: "classifiers=bitcn,tcn"; repeatable.',
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of fleets and finished runs, which a re-run continues, and of STUDY/report.html.",
            callback=require_folder,
        ),
    ] = None,
    jobs: Jobs = 2,
    device: Annotated[Device, typer.Option(help="Where networks are trained.")] = Device.cpu,
    as_json: Json = False,
) -> None:
    """Run a study: one question, its table, its answer and a page."""
    from swashtwin_bench import Work, run_study, write_study_report

    numbers, pairs = read_list(seeds, int, "--seeds") or [], read_pairs(settings, "--set")
    if (
        pairs.get("precision") == "bfloat16"
        and device is Device.cpu
        and not _has_bfloat16_arithmetic()
    ):
        print_note(
            "This processor has no instructions for 16 bits: bfloat16 trains many times slower here than float32."
        )
    with progress(name) as bar:

        def show_activity(activity: str, count: int, total: int) -> None:
            if activity.endswith("done before"):
                print_note(f"{activity}, in {out}")
            bar(count, total, f"{name}: {activity}")

        work = Work(numbers, jobs, out, show_activity, device.value, typed_command())
        if name == "paper":
            answer = _run_paper(work, size.value, pairs, source)
        else:
            result = run_study(name, source, work=work, size=size.value, settings=pairs)
    if name == "paper":
        print_result(
            answer,
            as_json,
            lambda: print_text("\n".join([*answer["answer"], f"Report: {answer['report']}"])),
        )
        return
    page = None if out is None else write_study_report(result, folder=out / result.study)

    def show() -> None:
        print_study(result)
        if page is not None:
            print_text(f"Report: {page}")

    print_result({**result.to_dict(), "report": page}, as_json, show)


def _run_paper(
    work: "Work", size: str, settings: dict[str, str], source: Path | None
) -> dict[str, Any]:
    """Every experiment of the paper, or those of the setting ``experiments``, and the page of
    them.
    """
    from swashtwin_bench import EXPERIMENTS, paper_answer, run_paper, write_paper_page

    experiments = split_names(settings.pop("experiments", None)) or list(EXPERIMENTS)
    results = run_paper(work, size=size, experiments=experiments, settings=settings, source=source)
    assert work.out is not None
    page = write_paper_page(results, size, work.out / "paper")
    studies = [study.to_dict() for study in results.values()]
    return {"report": page, "size": size, "answer": list(paper_answer(results)), "studies": studies}


def typed_command() -> str:
    """The command line as it was typed, for a result to record."""
    return shlex.join(["swashtwin", *sys.argv[1:]])


def print_study(study: "StudyTable") -> None:
    """Print a study as a table with its answer and its notes."""
    metrics = {
        name: words for name, words in study.metrics.items() if not name.startswith("recall_")
    }

    def spread(value: dict[str, Any]) -> str:
        if value["mean"] is None:
            return "-"
        return f"{value['mean']:.3f}" + ("" if value["std"] is None else f" ± {value['std']:.3f}")

    rows = []
    for row in study.rows():
        count = max(len(value["values"]) for value in row.values() if isinstance(value, dict))
        rows.append(
            [
                *(row[name] for name in study.factors),
                count,
                *(spread(row[name]) for name in metrics),
            ]
        )
    title = f"{study.title}; seed {', '.join(map(str, study.seeds))}, {study.wall_s:.0f} s"
    print_table(title, (*study.factors, "seeds", *metrics.values()), rows)
    for text in (*study.answer, *study.notes, study.origin):
        print_text(text)
