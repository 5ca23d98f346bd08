"""Commands that run a whole study: demo, study case1."""

import shlex
import sys
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, progress, say, table, tell
from swashtwin.cli.exits import resumable, whole_folder
from swashtwin.cli.options import Index, Jobs, Json, Seed, list_of

if TYPE_CHECKING:
    from swashtwin.recording import Recording
    from swashtwin.studies import StudyTable

studies = typer.Typer(no_args_is_help=True, help="Run one of the paper's studies on your recordings.")


class StudySize(StrEnum):
    """How much a study takes."""

    quick = "quick"
    paper = "paper"


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the rig and the report.")] = Path("swashtwin-demo"),
    seed: Seed = 0,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """Build a virtual rig, run Case I of the paper on it, and write a report: the whole way in some minutes."""
    from swashtwin.readers import read_recordings
    from swashtwin.rig import build_rig

    folder = out / f"rig-{seed}"
    if (folder / "recordings.toml").is_file():
        _require_this_rig(folder)
        note(f"using the rig that lies in {folder}")
    else:
        with whole_folder(folder), progress("recording on the virtual rig") as bar:
            build_rig(folder, seed=seed, jobs=jobs, progress=bar)
    with resumable(f"the rig in {folder} is whole, and the same command takes it up"):
        result = _case_one(read_recordings(folder), "quick", [seed], jobs, out / "report")
    tell(result, as_json, lambda: _show_study(result))


def _require_this_rig(folder: Path) -> None:
    from swashtwin.errors import DataError
    from swashtwin.readers import read_recordings
    from swashtwin.rig import RIG_VERSION, SIZES

    recordings, plan = read_recordings(folder), SIZES["small"]
    origin = recordings[0].attributes.get("origin", "")
    whole = len(recordings) == plan.specimens * plan.repeats * 15
    if not (origin.endswith(f"version {RIG_VERSION}") and whole):
        raise DataError(f"{folder} holds other recordings than the demo's rig; delete it, or name another --out.")


@studies.command("case1")
def case1(
    source: Index,
    size: Annotated[StudySize, typer.Option(help="Settings: quick, or the paper's.")] = StudySize.quick,
    seeds: Annotated[str, typer.Option(help='Seeds of split, weights and synthesis: "0,1,2".')] = "0",
    out: Annotated[Path | None, typer.Option(help="Folder for report.html.")] = None,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """Case I, few samples: what a twin adds where one class has few measured windows."""
    from swashtwin.readers import read_recordings

    numbers = list_of(seeds, int, "--seeds") or [0]
    result = _case_one(read_recordings(source), size.value, numbers, jobs, out)
    tell(result, as_json, lambda: _show_study(result))


def _case_one(
    recordings: "Sequence[Recording]", size: str, seeds: Sequence[int], jobs: int, folder: Path | None
) -> dict[str, Any]:
    from swashtwin.report import write_report
    from swashtwin.studies import run_case_one

    with progress("Case I") as bar:
        result = run_case_one(
            recordings,
            size=size,
            seeds=seeds,
            jobs=jobs,
            progress=lambda what, done, total: bar(done, total, f"Case I: {what}"),
            command=this_command(),
        )
    page = None if folder is None else write_report(result, folder=folder)
    return {**result.to_dict(), "report": page}


def _show_study(result: dict[str, Any]) -> None:
    metrics = ("accuracy", "recall", "f1", "g_mean", "scarce_recall")
    rows = [
        (row["classifier"], row["training_set"], row["level"], *(_spread(row[name]) for name in metrics))
        for row in [*result["rows"], *result["rivals"]]
    ]
    seeds = ", ".join(str(seed) for seed in result["seeds"])
    title = f"Case I ({result['size']}), seed {seeds}, {result['wall_s']:.0f} s"
    table(title, ("classifier", "training set", "level", *metrics), rows)
    say(result["origin"])
    if result["report"] is not None:
        say(f"Report: {result['report']}")


def _spread(value: dict[str, Any]) -> str:
    if value["mean"] is None:
        return "-"
    return f"{value['mean']:.3f}" + ("" if value["std"] is None else f" ± {value['std']:.3f}")


def tell_study(study: "StudyTable", folder: Path | None, as_json: bool) -> None:
    """Write the report where one is asked for, and print the study as one JSON object or as a table."""
    from swashtwin.report import write_report

    page = None if folder is None else write_report(study, folder=folder)
    result = {**study.to_dict(), "report": page}
    tell(result, as_json, lambda: _show_table(study, page))


def _show_table(study: "StudyTable", page: Path | None) -> None:
    rows = study.rows()
    told = [[*(row[name] for name in study.factors), *(_spread(row[name]) for name in study.metrics)] for row in rows]
    seeds = ", ".join(map(str, study.seeds))
    table(f"{study.title}; seed {seeds}, {study.wall_s:.0f} s", (*study.factors, *study.metrics.values()), told)
    for text in (*study.answer, *study.notes, study.origin):
        say(text)
    if page is not None:
        say(f"Report: {page}")


def this_command() -> str:
    """The command line as it was typed, for a result to carry."""
    return shlex.join(["swashtwin", *sys.argv[1:]])


class Background(StrEnum):
    """Whose recordings wrong twins are calibrated on."""

    own = "own"
    rig = "rig"


@studies.command("misspecification")
def misspecification(
    seeds: Annotated[str, typer.Option(help='Seeds of the fleets and of the twin\'s own recordings: "2,3".')] = "2",
    pumps: Annotated[int, typer.Option(min=1, max=6, help="Pumps of each fleet.")] = 4,
    background: Annotated[
        list[Background] | None,
        typer.Option(help="own: the twin's own recordings, where all else is right; rig: the virtual rig. Repeatable."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for report.html.")] = None,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """What calibration makes of a twin that is wrong in one stated way, and whether it warns of it."""
    from swashtwin.studies.misspecification import BACKGROUNDS, run_misspecification

    with progress("wrong twins") as bar:
        study = run_misspecification(
            seeds=list_of(seeds, int, "--seeds") or [2],
            pumps=pumps,
            backgrounds=BACKGROUNDS if not background else [one.value for one in background],
            jobs=jobs,
            progress=bar,
            command=this_command(),
        )
    tell_study(study, out, as_json)
