"""Commands of the studies that are no plan of tasks: on pumps of the virtual rig, on recordings, on public sets."""

from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli import (
    Jobs,
    Json,
    ReportFolder,
    Window,
    as_folder,
    progress,
    read_seeds,
    read_words,
    resumable,
)
from swashtwin.foundation import parse
from swashtwin_bench.cli.plans import OptionalIndex
from swashtwin_bench.cli.results import tell_study, typed_command
from swashtwin_bench.cli.rig import RigVersionName, VersionOfRig, require_rig_for

FleetSeeds = Annotated[str, typer.Option(help='Seeds, one fleet of the virtual rig each: "2,3,4".')]
Seeds = Annotated[str, typer.Option(help='Seeds of draws, weights, trees and splits: "0,1,2".')]
Specimens = Annotated[int, typer.Option(min=1, max=6, help="Number of pumps in each fleet.")]
TrainingsFolder = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="Folder of finished trainings, which a re-run continues, and of STUDY/report.html.",
        callback=as_folder,
    ),
]
CoursesFolder = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="Folder of finished courses, which a re-run continues, and of STUDY/report.html.",
        callback=as_folder,
    ),
]
PublicData = Annotated[Path, typer.Option(help="Folder that holds the public sets, each in a folder of its own name.")]


def calibration(
    seeds: FleetSeeds = "0",
    label: Annotated[str, typer.Option(help="Class calibrated on: normal or swash_plate.")] = "normal",
    specimens: Specimens = 6,
    repeats: Annotated[int, typer.Option(min=2, help="Recordings of each pump and pressure; one is held out.")] = 3,
    thick_film: Annotated[
        bool, typer.Option("--thick-film", help="Pumps whose slipper films are thick enough for K_sw to show.")
    ] = False,
    methods: Annotated[str | None, typer.Option(help="Ways to calibrate, with commas; all by default.")] = None,
    out: ReportFolder = None,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """Errors on recordings held out, coverage and cost of every way to calibrate, on pumps of the virtual rig."""
    from swashtwin_bench import CONTENDERS, CalibrationStudySettings, run_calibration_study

    numbers = read_seeds(seeds)
    settings = CalibrationStudySettings(
        label=label,
        specimens=specimens,
        repeats=repeats,
        thick_film=thick_film,
        contenders=tuple(read_words(methods) or CONTENDERS),
    )
    with progress("calibrating pumps of the virtual rig") as bar:
        study = run_calibration_study(
            seeds=numbers, settings=settings, jobs=jobs, progress=bar, command=typed_command()
        )
    tell_study(study, out, as_json)


def confidence(
    seeds: FleetSeeds = "2,3,4",
    error_rate: Annotated[
        float,
        typer.Option(help="Share of recordings whose prediction set may be wrong, or that are wrongly unknown."),
    ] = 0.1,
    classifiers: Annotated[str, typer.Option(help="Classifiers: bitcn, extra_trees, chosen.")] = "bitcn,extra_trees",
    window: Window = 2048,
    duration: Annotated[str, typer.Option(help="Duration of a recording.")] = "0.7 s",
    out: TrainingsFolder = None,
    jobs: Jobs = 2,
    as_json: Json = False,
) -> None:
    """Whether a classifier's confidence can be trusted: calibration, coverage, and faults that it never trained on."""
    from swashtwin_bench import ConfidenceStudySettings, run_confidence

    numbers = read_seeds(seeds)
    seconds = parse(duration, "s", name="--duration")
    settings = ConfidenceStudySettings(error_rate=error_rate, length=window, duration=seconds)
    hint = "finished trainings are kept; the same command resumes" if out else "with --out, they would be kept"
    with resumable(hint), progress("training on pumps of the virtual rig") as bar:
        study = run_confidence(
            seeds=numbers,
            settings=settings,
            classifiers=read_words(classifiers),
            jobs=jobs,
            out=out,
            progress=bar,
            command=typed_command(),
        )
    tell_study(study, None if out is None else out / "confidence", as_json)


def alarms(seeds: FleetSeeds = "100,101", out: CoursesFolder = None, jobs: Jobs = 1, as_json: Json = False) -> None:
    """The alarm of a watch: false alarms on healthy pumps that drift, severity and delay where faults grow."""
    from swashtwin_bench import run_alarms

    numbers = read_seeds(seeds)
    hint = "finished courses are kept; the same command resumes" if out else "with --out, they would be kept"
    with resumable(hint), progress("watching pumps of the virtual rig") as bar:
        study = run_alarms(seeds=numbers, jobs=jobs, out=out, progress=bar, command=typed_command())
    tell_study(study, None if out is None else out / "alarms", as_json)


def run_to_failure(data: PublicData, out: ReportFolder = None, as_json: Json = False) -> None:
    """When the alarm of a bearing's first recordings comes in its life, on bearings run until they failed."""
    from swashtwin_bench import run_bearing_life

    with progress("bearings") as bar:
        study = run_bearing_life(data / "bearing_run_to_failure", progress=bar, command=typed_command())
    tell_study(study, out, as_json)


def severity(seeds: FleetSeeds = "2,3", out: ReportFolder = None, jobs: Jobs = 1, as_json: Json = False) -> None:
    """Severity by inversion on the virtual rig's trends: error against the hidden truth, by fault and dimension."""
    from swashtwin_bench import run_severity

    numbers = read_seeds(seeds)
    with progress("severities") as bar:
        study = run_severity(numbers, jobs=jobs, progress=bar, command=typed_command())
    tell_study(study, out, as_json)


def zero_shot(
    source: OptionalIndex = None,
    rig: Annotated[bool, typer.Option("--rig", help="A fleet of the virtual rig for each seed.")] = False,
    rig_version: VersionOfRig = RigVersionName.first,
    seeds: Seeds = "0",
    out: ReportFolder = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Zero-shot: the pump prior, which learned from twins alone, tested on measured faults."""
    from swashtwin.recordings import load_recordings
    from swashtwin_bench import run_zero_shot

    if (source is None) is not rig:
        raise typer.BadParameter("give either recordings or --rig.", param_hint="INDEX")
    require_rig_for(rig_version, rig)
    numbers = read_seeds(seeds)
    with progress("zero-shot") as bar:
        study = run_zero_shot(
            None if source is None else list(load_recordings(source)),
            rig_version=rig_version.value,
            seeds=numbers,
            jobs=jobs,
            progress=lambda step, count, total: bar(count, total, f"zero-shot: {step}"),
            command=typed_command(),
        )
    tell_study(study, out, as_json)


def public(
    data: PublicData,
    seeds: Seeds = "0",
    classifiers: Annotated[
        str,
        typer.Option(help='"chosen", which is what train does where nothing is set, and others beside it.'),
    ] = "chosen,extra_trees",
    public_sets: Annotated[
        str | None, typer.Option(help='Names of the sets: "cwru,pump_cavitation"; all that are there by default.')
    ] = None,
    out: TrainingsFolder = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Public sets on honest splits by the ordinary training: nothing is set but the recordings and the seed."""
    from swashtwin_bench import run_public

    numbers = read_seeds(seeds)
    hint = "finished trainings are kept; the same command resumes" if out else "with --out, they would be kept"
    with resumable(hint), progress("training on public sets") as bar:
        study = run_public(
            data,
            seeds=numbers,
            classifiers=read_words(classifiers),
            sets=read_words(public_sets),
            jobs=jobs,
            out=out,
            progress=lambda step, count, total: bar(count, total, step),
            command=typed_command(),
        )
    tell_study(study, None if out is None else out / "public", as_json)
