"""The command of the studies: bench study."""

import difflib
import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli import (
    Cluster,
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
    "paper": "all experiments of the paper by its own recipe, with its figures for comparison; "
    "experiments=case1,noise selects some",
    "case1": "few samples: benefit of a twin if one class has few measured windows",
    "case2": "missing operating point: a twin fills a cell that has no measured window",
    "algorithms": "all networks and baselines on the calibrated training set of Case I",
    "noise": "tests with noise, changed gains and changed speeds; training with and without noise",
    "augmentation": "all methods that fill the scarce cell, by number of synthetic windows",
    "fair-test": "calibrated twins with the law of the recess against nominal twins "
    "(docs/bench/fair-test.md)",
    "fair-test-2": "calibrated against nominal twins that fill every class, with and without a "
    "healthy reference (docs/bench/fair-test-2.md)",
    "filling": "what twins should fill: the missing cell alone, every class at its pressure, or "
    "every class everywhere; with ceilings that know the truth of the virtual rig",
    "demo": "the comparison of swashtwin demo on other fleets: no fault recorded at 15 MPa, every "
    "class filled by twins",
    "alarms": "false alarms on healthy pumps that drift; severity and delay of growing faults",
    "detector": "false alarms and detected faults of a detector trained on healthy recordings, "
    "two of twenty contaminated",
    "calibration": "errors on held-out recordings, coverage and cost of each calibration method",
    "life": "time until a growing fault reaches a limit, against the true course of wear",
    "severity": "severity by inversion against the true dimensions, by fault and dimension",
    "wrong-twins": "wrong twins and unusual pumps: do identified values hold, and is there a "
    "warning?",
    "zero-shot": "the pump prior, trained on simulations only, tested on measured faults",
    "library": "measured faults of other machines beside the pump prior: of the same version of "
    "the rig, of another one, and with wrong labels",
    "public": "public data sets on honest splits with the default training; SOURCE is their folder",
    "run-to-failure": "time of the alarm in the life of bearings run to failure; SOURCE is the "
    "folder of the data set",
}
"""Question of each study, by its name."""


def _require_study(name: str) -> str:
    if name not in STUDIES:
        suggestions = difflib.get_close_matches(name, STUDIES, n=1, cutoff=0.3)
        hint = f"did you mean {suggestions[0]}? " if suggestions else ""
        raise typer.BadParameter(
            f"unknown study {name!r}: {hint}Must be one of {', '.join(STUDIES)}."
        )
    return name


def _warn_of_slow_bfloat16() -> None:
    if not _has_bfloat16_arithmetic():
        print_note(
            "This processor has no instructions for 16 bits: training with bfloat16 is many times "
            "slower here than float32."
        )


def _has_bfloat16_arithmetic() -> bool:
    """Return whether the processor may have instructions for bfloat16.

    No x86 processor up to AVX2 has them. Of those with AVX-512 only the later ones do, which torch
    does not report.
    """
    import torch

    return torch.backends.cpu.get_cpu_capability() not in ("NO AVX", "AVX2")


class Size(StrEnum):
    """Numbers of windows and epochs of a study."""

    quick = "quick"
    medium = "medium"
    paper = "paper"


class Device(StrEnum):
    """Device on which networks are trained."""

    cpu = "cpu"
    cuda = "cuda"


def study(
    name: Annotated[
        str,
        typer.Argument(
            callback=_require_study,
            autocompletion=lambda: list(STUDIES),
            help="\n\n".join(f"{name}: {question}" for name, question in STUDIES.items()),
        ),
    ],
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="[SOURCE]",
            help="Index, store or folder of recordings. Default: the virtual rig.",
        ),
    ] = None,
    size: Annotated[
        Size,
        typer.Option(
            help="quick: minutes on two cores; medium: window counts of the paper, 30 epochs, "
            "its network on patches, hours; paper: 200 epochs, its network on every sample, weeks."
        ),
    ] = Size.quick,
    seeds: Annotated[
        str,
        typer.Option(help='Seeds, such as "100,101". On the virtual rig each is another fleet.'),
    ] = "0",
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help='Setting of the study, NAME=VALUE, such as "classifiers=bitcn,tcn"; repeatable.',
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for fleets, finished runs and STUDY/report.html. A later run with the "
            "same folder continues.",
            callback=require_folder,
        ),
    ] = None,
    jobs: Jobs = 2,
    cluster: Cluster = None,
    device: Annotated[
        Device, typer.Option(help="Device on which networks are trained.")
    ] = Device.cpu,
    as_json: Json = False,
) -> None:
    """Run a study, and print its table and its answer."""
    from swashtwin.foundation import use_cluster
    from swashtwin_bench import Work, run_study, write_study_report

    seed_list = read_list(seeds, int, "--seeds") or []
    values = read_pairs(settings, "--set")

    if values.get("precision") == "bfloat16" and device is Device.cpu:
        _warn_of_slow_bfloat16()

    with use_cluster(cluster), progress(name) as bar:

        def show_activity(activity: str, count: int, total: int) -> None:
            if activity.endswith("already finished"):
                print_note(f"{activity}, in {out}")
            bar(count, total, f"{name}: {activity}")

        work = Work(seed_list, jobs, out, show_activity, device.value, typed_command())
        if name == "paper":
            answer = _run_paper(work, size.value, values, source)
        else:
            result = run_study(name, source, work=work, size=size.value, settings=values)

    if name == "paper":
        lines = [*answer["answer"], f"Report: {answer['report']}"]
        print_result(answer, as_json, lambda: print_text("\n".join(lines)))
        return

    page = None
    if out is not None:
        page = write_study_report(result, folder=out / result.study)

    def show() -> None:
        print_study(result)
        if page is not None:
            print_text(f"Report: {page}")

    print_result({**result.to_dict(), "report": page}, as_json, show)


def _run_paper(
    work: "Work", size: str, settings: dict[str, str], source: Path | None
) -> dict[str, Any]:
    """Run the experiments of the paper (all, or those of the setting ``experiments``)."""
    from swashtwin_bench import EXPERIMENTS, paper_answer, run_paper, write_paper_page

    experiments = split_names(settings.pop("experiments", None)) or list(EXPERIMENTS)
    results = run_paper(work, size=size, experiments=experiments, settings=settings, source=source)

    assert work.out is not None  # `run_paper` requires it
    return {
        "report": write_paper_page(results, size, work.out / "paper"),
        "size": size,
        "answer": list(paper_answer(results)),
        "studies": [study.to_dict() for study in results.values()],
    }


def typed_command() -> str:
    """Return the command line as it was typed, which results record."""
    return shlex.join(["swashtwin", *sys.argv[1:]])


def print_study(study: "StudyTable") -> None:
    """Print a study as a table, its answer and its notes."""
    # The recall of each class is in the JSON and on the page; the terminal is too narrow.
    metrics = {
        name: heading for name, heading in study.metrics.items() if not name.startswith("recall_")
    }

    rows = []
    for row in study.rows():
        factors = [row[name] for name in study.factors]
        scores = [_format_score(row[name]) for name in metrics]
        n_seeds = max(len(value["values"]) for value in row.values() if isinstance(value, dict))
        rows.append([*factors, n_seeds, *scores])

    title = f"{study.title}; seed {', '.join(map(str, study.seeds))}, {study.wall_s:.0f} s"
    print_table(title, (*study.factors, "seeds", *metrics.values()), rows)

    for text in (*study.answer, *study.notes, study.origin):
        print_text(text)


def _format_score(score: dict[str, Any]) -> str:
    """Return mean and standard deviation over the seeds as text."""
    if score["mean"] is None:
        return "-"
    if score["std"] is None:
        return f"{score['mean']:.3f}"
    return f"{score['mean']:.3f} ± {score['std']:.3f}"
