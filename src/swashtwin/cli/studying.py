"""What all studies share on the command line, and the commands that are of no other room: demo, misspecification."""

import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, progress, say, table, tell
from swashtwin.cli.exits import resumable
from swashtwin.cli.options import Jobs, Json, ReportFolder, Seed, as_folder, list_of
from swashtwin.foundation import whole_folder

if TYPE_CHECKING:
    from swashtwin.bench import StudyTable


class StudySize(StrEnum):
    """How much a study takes."""

    quick = "quick"
    paper = "paper"


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the rig and the report.", callback=as_folder)] = Path(
        "swashtwin-demo"
    ),
    seed: Seed = 0,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """Build a virtual rig, run Case I of the paper on it, and write a report: the whole way in some minutes."""
    from swashtwin.bench import SIZES, Workers, build_rig, require_rig, run_study
    from swashtwin.recordings import load_recordings

    folder = out / f"rig-{seed}"
    if (folder / "recordings.toml").is_file():
        require_rig(folder, list(load_recordings(folder)), SIZES["small"])
        note(f"using the rig that lies in {folder}")
    else:
        with whole_folder(folder), progress("recording on the virtual rig") as bar:
            build_rig(folder, seed=seed, jobs=jobs, progress=bar)
    hint = f"the rig in {folder} is whole, finished runs are kept, and the same command takes it up"
    with resumable(hint), progress("Case I") as bar:
        result = run_study(
            "case1",
            list(load_recordings(folder)),
            seeds=[seed],
            workers=Workers(jobs),
            out=out / "runs",
            progress=lambda what, done, total: bar(done, total, f"Case I: {what}"),
            command=this_command(),
        )
    tell_study(result, out / "report", as_json)


def tell_study(study: "StudyTable", folder: Path | None, as_json: bool) -> None:
    """Write the report where one is asked for, and print the study as one JSON object or as a table."""
    from swashtwin.bench import write_study_report

    page = None if folder is None else write_study_report(study, folder=folder)
    result = {**study.to_dict(), "report": page}
    tell(result, as_json, lambda: _show_table(study, result))


def _show_table(study: "StudyTable", result: dict[str, Any]) -> None:
    shown = {name: words for name, words in study.metrics.items() if not name.startswith("recall_")}
    told = [
        [*(row[name] for name in study.factors), _seeds(row), *(_spread(row[name]) for name in shown)]
        for row in [*result["rows"], *result.get("rivals", ())]
    ]
    seeds = ", ".join(map(str, study.seeds))
    table(f"{study.title}; seed {seeds}, {study.wall_s:.0f} s", (*study.factors, "seeds", *shown.values()), told)
    for text in (*study.answer, *study.notes, study.origin):
        say(text)
    if result["report"] is not None:
        say(f"Report: {result['report']}")


def _seeds(row: dict[str, Any]) -> int:
    """Seeds behind a row, which need not be all of the study's."""
    return max(len(value["values"]) for value in row.values() if isinstance(value, dict))


def _spread(value: dict[str, Any]) -> str:
    if value["mean"] is None:
        return "-"
    return f"{value['mean']:.3f}" + ("" if value["std"] is None else f" ± {value['std']:.3f}")


def this_command() -> str:
    """The command line as it was typed, for a result to carry."""
    return shlex.join(["swashtwin", *sys.argv[1:]])


class Background(StrEnum):
    """Whose recordings wrong twins are calibrated on."""

    own = "own"
    rig = "rig"


def misspecification(
    seeds: Annotated[str, typer.Option(help='Seeds of the fleets and of the twin\'s own recordings: "2,3".')] = "2",
    pumps: Annotated[int, typer.Option(min=1, max=6, help="Pumps of each fleet.")] = 4,
    background: Annotated[
        list[Background] | None,
        typer.Option(help="own: the twin's own recordings, where all else is right; rig: the virtual rig. Repeatable."),
    ] = None,
    out: ReportFolder = None,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """What calibration makes of a twin that is wrong in one stated way, and whether it warns of it."""
    from swashtwin.bench import BACKGROUNDS, run_misspecification

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
