"""Commands on the virtual rig: demo, bench rig."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli import (
    Json,
    Seed,
    print_result,
    print_text,
    progress,
    require_folder,
)
from swashtwin.foundation import shell_command
from swashtwin_bench.cli.studies import print_study, typed_command

if TYPE_CHECKING:
    from swashtwin_bench import Demo


def demo(
    out: Annotated[
        Path,
        typer.Option(
            help="Folder for the rig, the model, the twin and the report.", callback=require_folder
        ),
    ] = Path("swashtwin-demo"),
    as_json: Json = False,
) -> None:
    """Diagnose faults that were never recorded at this pressure, with the help of twins.

    The demo records pumps on a virtual rig, calibrates twins, trains a model on measured windows
    alone and with those of twins, and writes the comparison as a page. It takes a few minutes and
    prints three commands to try next.
    """
    from swashtwin_bench import QUESTION, run_demo, summarize_demo

    with progress("demo") as bar:

        def show_activity(activity: str, count: int, total: int) -> None:
            bar(count, total, activity)

        result = run_demo(out, jobs=2, progress=show_activity, command=typed_command())

    answer = summarize_demo(result)
    next_commands = _list_next_commands(result)

    def show() -> None:
        print_study(result.study)
        print_text("")
        print_text(QUESTION)
        for sentence in answer:
            print_text(sentence)
        print_text(f"Report: {result.page}")

        print_text("")
        print_text("Try next:")
        for purpose, command in next_commands.items():
            print_text(f"  {command}    ({purpose})")

    table = {
        **result.study.to_dict(),
        "report": result.page,
        "model": result.model,
        "twin": result.twin,
        "question": QUESTION,
        "demo_answer": answer,
        "labels": result.labels,
        "correct": {name: result.count_correct(name) for name in result.diagnoses},
        "diagnoses": {
            name: [diagnosis.to_dict() for diagnosis in diagnoses]
            for name, diagnoses in result.diagnoses.items()
        },
        "next": list(next_commands.values()),
    }
    print_result(table, as_json, show)


def _list_next_commands(demo: "Demo") -> dict[str, str]:
    """Return command lines to try after the demo, by purpose."""
    out = demo.model.parent

    return {
        "diagnose another recording": shell_command(
            "diagnose", demo.model, demo.next_recording, "--report", out / "another.html"
        ),
        f"look at the twin of pump {demo.pump}": shell_command(
            "report", demo.twin, "--out", out / "twin"
        ),
        "train on the rig's recordings, or on a folder of yours": shell_command(
            "train", demo.rig, "--out", out / "own.safetensors"
        ),
    }


class Spread(StrEnum):
    """How far the pumps of the rig lie from their drawing."""

    standard = "standard"
    wide = "wide"


def rig(
    out: Annotated[Path, typer.Argument(help="New folder for the recordings.")],
    seed: Seed = 0,
    size: Annotated[
        str,
        typer.Option(
            help="Number and length of the recordings: tiny, short, many, small or paper."
        ),
    ] = "small",
    version: Annotated[
        str,
        typer.Option(
            "--rig-version",
            help="1; 2, which shares less with the twin; 3, a pump of another maker; 1-deep or "
            "2-deep, with the recess of the paper.",
        ),
    ] = "1",
    spread: Annotated[
        Spread,
        typer.Option(
            help="Spread of the pumps: standard; or wide, further from their drawing (version 1)."
        ),
    ] = Spread.standard,
    sensor_count: Annotated[
        int,
        typer.Option(
            help="Number of accelerometers: 3, or 13 as in the paper (version 1 only, at the "
            "positions of pump 25scy14-1b-13)."
        ),
    ] = 3,
    as_json: Json = False,
) -> None:
    """Record pumps on a virtual rig (a simulation), and write the recordings and their index."""
    from swashtwin_bench import build_rig
    from swashtwin_bench.rigs.writing import wide_version

    if spread is Spread.wide:
        version = wide_version(version)

    with progress("recording") as bar:
        index_file = build_rig(
            out, seed=seed, size=size, version=version, sensors=sensor_count, progress=bar
        )

    result = {"index": index_file, "seed": seed, "size": size, "rig_version": version}

    def show() -> None:
        print_text(str(index_file))
        print_text(f"Next: {shell_command('inspect', out)}")

    print_result(result, as_json, show)
