"""The command that repeats the paper: bench paper."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli import (
    Json,
    as_folder,
    note,
    note_done_before,
    progress,
    read_seeds,
    read_words,
    resumable,
    say,
    tell,
)
from swashtwin_bench.cli.plans import Device, DeviceName, TaskJobs
from swashtwin_bench.cli.results import typed_command


class PaperSize(StrEnum):
    """How much of the paper's counts and epochs is run."""

    small = "small"
    medium = "medium"
    paper = "paper"


class Precision(StrEnum):
    """Number format of the networks in training."""

    float32 = "float32"
    bfloat16 = "bfloat16"


def paper(
    size: Annotated[
        PaperSize,
        typer.Option(
            help="small: few windows and epochs, minutes of two cores; medium: the paper's counts, 30 epochs, its "
            "network on patches of 16 samples, hours; paper: 200 epochs, every sample a step, weeks of a CPU."
        ),
    ] = PaperSize.small,
    seeds: Annotated[
        str, typer.Option(help='Fleets of the virtual rig: "20,21"; the first is that of the repeated trainings.')
    ] = "20",
    experiments: Annotated[
        str | None,
        typer.Option(
            help="Experiments to run: case1, case2, recess, algorithms, ablation, noise, related, identification; all "
            "by default."
        ),
    ] = None,
    training_sets: Annotated[
        str | None,
        typer.Option(help="Some of measured, nominal, calibrated where an experiment compares them; all by default."),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(
            help="Folder of fleets, runs and checkpoints, which a re-run continues, and of paper/report.html.",
            callback=as_folder,
        ),
    ] = Path("swashtwin-paper"),
    jobs: TaskJobs = 2,
    device: DeviceName = Device.cpu,
    precision: Annotated[
        Precision,
        typer.Option(help="bfloat16 trains faster where the processor has such instructions, with other roundings."),
    ] = Precision.float32,
    as_json: Json = False,
) -> None:
    """Every experiment of the paper with its own network and recipe, and one page: its figures beside ours."""
    from swashtwin.foundation import has_bfloat16_arithmetic
    from swashtwin_bench import EXPERIMENTS, paper_answer, run_paper, write_paper_page

    numbers = read_seeds(seeds)
    names = EXPERIMENTS if experiments is None else read_words(experiments)
    if precision is Precision.bfloat16 and device is Device.cpu and not has_bfloat16_arithmetic():
        note(
            "This processor has no instructions for 16 bits: --precision bfloat16 trains many times slower here than "
            "float32."
        )
    hint = "finished runs are kept, and trainings go on from their last epoch; the same command resumes"
    with resumable(hint), progress("the paper") as bar:

        def show(activity: str, count: int, total: int) -> None:
            note_done_before(activity, out)
            bar(count, total, activity)

        results = run_paper(
            out,
            size=size.value,
            seeds=numbers,
            experiments=tuple(names),
            training_sets=None if training_sets is None else read_words(training_sets),
            jobs=jobs,
            device=device.value,
            precision=precision.value,
            progress=show,
            command=typed_command(),
        )
    page = write_paper_page(results, size.value, out / "paper")
    answer = paper_answer(results)
    studies = [study.to_dict() for study in results.values()]
    result = {"report": page, "size": size.value, "answer": list(answer), "studies": studies}
    tell(result, as_json, lambda: say("\n".join([*answer, f"Report: {page}"])))
