"""Commands on the virtual rig: demo, bench rig."""

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
    """Diagnose a fault nobody recorded at this pressure: build a virtual rig, calibrate twins,
    train, write a page.

    It leaves a model, the twin of a pump and a diagnosis in its folder, runs Case II of the paper,
    and ends with three commands to go on with. A few minutes.
    """
    from swashtwin_bench import QUESTION, run_demo, summarize_demo

    with progress("demo") as bar:

        def show_activity(activity: str, count: int, total: int) -> None:
            bar(count, total, activity)

        result = run_demo(out, jobs=2, progress=show_activity, command=typed_command())
    commands = _next_commands(result)

    def show() -> None:
        print_study(result.study)
        print_text("")
        for text in (
            QUESTION,
            *summarize_demo(result),
            f"Report: {result.page}",
            "",
            "Go on with:",
        ):
            print_text(text)
        for what, command in commands.items():
            print_text(f"  {command}    ({what})")

    answer = {
        **result.study.to_dict(), "report": result.page, "model": result.model, "twin": result.twin,
        "question": QUESTION, "demo_answer": summarize_demo(result), "label": result.label,
        "with_twin": [verdict.to_dict() for verdict in result.with_twin],
        "without_twin": [verdict.to_dict() for verdict in result.without_twin], "next": list(commands.values()),
    }  # fmt: skip
    print_result(answer, as_json, show)


def _next_commands(demo: "Demo") -> dict[str, str]:
    """Command lines to go on with, by what they do."""
    out = demo.model.parent
    return {
        "diagnose another recording": _command(
            "diagnose", demo.model, demo.other, "--report", out / "another.html"
        ),
        f"look at the twin of pump {demo.pump}": _command(
            "report", demo.twin, "--out", out / "twin"
        ),
        "train on recordings; name the folder of your own": _command(
            "train", demo.rig, "--out", out / "own.safetensors"
        ),
    }


def _command(*words: object) -> str:
    """A command line that every shell understands."""
    texts = [word.as_posix() if isinstance(word, Path) else str(word) for word in words]
    return " ".join(["swashtwin", *(f'"{text}"' if " " in text else text for text in texts)])


def rig(
    out: Annotated[Path, typer.Argument(help="New folder for the recordings.")],
    seed: Seed = 0,
    size: Annotated[
        str, typer.Option(help="Number and length of the recordings: tiny, short, small or paper.")
    ] = "small",
    version: Annotated[
        str,
        typer.Option(
            "--rig-version",
            help="1, 2 which shares less with the twin, 3 of another maker, or 1-deep, 2-deep with the paper's recess.",
        ),
    ] = "1",
    sensor_count: Annotated[
        int,
        typer.Option(
            help="Accelerometers: 3, or 13 as the paper has, where pump 25scy14-1b-13 says; version 1 only."
        ),
    ] = 3,
    as_json: Json = False,
) -> None:
    """Write recordings of a virtual rig, which stands in for a machine, and an index of them."""
    from swashtwin_bench import build_rig

    with progress("recording") as bar:
        index_file = build_rig(
            out, seed=seed, size=size, version=version, sensors=sensor_count, progress=bar
        )
    result = {"index": index_file, "seed": seed, "size": size, "rig_version": version}
    print_result(
        result, as_json, lambda: print_text(f"{index_file}\nNext: swashtwin inspect {out}")
    )
