"""Commands about recordings: rig, index, convert, split."""

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, progress, say, tell
from swashtwin.cli.options import (
    CalibrationFactor,
    Channels,
    GroupName,
    Index,
    Json,
    Names,
    SampleRate,
    Seed,
    Unit,
    given,
    pairs_of,
    said_as_options,
)
from swashtwin.cli.shaft import Pulses, Tachometer, Track, require_one_way, shaft_angle, vibration_of
from swashtwin.foundation import whole_folder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swashtwin.recordings import Recording


class RigFormat(StrEnum):
    """File formats that the rig writes."""

    h5 = "h5"
    mat = "mat"
    wav = "wav"
    csv = "csv"
    tdms = "tdms"


class RigSizeName(StrEnum):
    """How much the rig records."""

    small = "small"
    paper = "paper"


class Dealing(StrEnum):
    """How groups are dealt into folds."""

    stratified = "stratified"
    plain = "plain"
    each = "each"
    shuffled = "shuffled"


def load_all(paths: list[Path], **facts: object) -> "list[Recording]":
    """Recordings of indexes, folders with an index, stores, and single files with `facts`."""
    from swashtwin.recordings import load_recordings

    recordings: list[Recording] = []
    for path in paths:
        if _of_many(path, facts):
            recordings += load_recordings(path)
        else:
            with said_as_options():
                recordings += load_recordings(path, **facts)
    return recordings


def refuse_source(target: Path, paths: list[Path]) -> None:
    """Refuse a file to write that is one of those read."""
    from swashtwin.foundation import InputError
    from swashtwin.recordings import source_files

    for path in paths:
        if any(target.resolve() == one.resolve() for one in source_files(path)):
            raise InputError(f"{target} is read from {path} and would be lost; name another --out.")


def _of_many(path: Path, facts: dict[str, object]) -> bool:
    """Whether a source says itself what its recordings are; no option may then say it again."""
    from swashtwin.recordings import is_store

    if not (path.is_dir() or path.suffix == ".toml" or is_store(path)):
        return False
    if facts:
        option = f"--{next(iter(facts)).replace('_', '-')}"
        where = "convert its files anew" if is_store(path) else "edit its index"
        raise typer.BadParameter(f"is for single files, and {path} says it itself; {where}.", param_hint=option)
    return True


def rig(
    out: Annotated[Path, typer.Argument(help="New folder for the recordings.")],
    seed: Seed = 0,
    size: Annotated[RigSizeName, typer.Option(help="How much is recorded.")] = RigSizeName.small,
    file_format: Annotated[RigFormat, typer.Option("--format", help="Format of the files.")] = RigFormat.h5,
    as_json: Json = False,
) -> None:
    """Write the recordings of a virtual rig, and an index of them. It stands in for a machine and is none."""
    from swashtwin.bench import RIG_VERSION, build_rig

    with whole_folder(out), progress("recording") as bar:
        index_file = build_rig(out, seed=seed, size=size.value, file_format=file_format.value, progress=bar)
    result = {"index": index_file, "seed": seed, "size": size.value, "rig_version": RIG_VERSION}
    tell(result, as_json, lambda: say(f"{index_file}\nNext: swashtwin inspect {out}"))


def index(
    folder: Annotated[Path, typer.Argument(help="Folder of measurements; it is only read.")],
    out: Annotated[Path | None, typer.Option(help="Index file; recordings.toml in the folder by default.")] = None,
    label_pattern: Annotated[
        str | None, typer.Option(help="Regular expression searched in each path; its named groups become facts.")
    ] = None,
    csv_table: Annotated[Path | None, typer.Option("--table", help="CSV table with one row per file.")] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option("--column", metavar="KEY=COLUMN", help="Which column of the table holds which key; repeatable."),
    ] = None,
    include: Annotated[list[str] | None, typer.Option(help="Pattern of paths to keep; repeatable.")] = None,
    sample_rate: SampleRate = None,
    unit: Unit = None,
    channels: Channels = None,
    names: Names = None,
    calibration_factor: CalibrationFactor = None,
    resample: Annotated[str | None, typer.Option(help='Rate to resample everything to, such as "12 kHz".')] = None,
    speed: Annotated[str | None, typer.Option(help='Shaft speed where nothing says it: "860 rpm".')] = None,
    pressure: Annotated[str | None, typer.Option(help='Discharge pressure where nothing says it: "15 MPa".')] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an index that exists.")] = False,
    as_json: Json = False,
) -> None:
    """Propose an index of a folder's files, to look over and correct; a terminal is asked what nobody says."""
    from swashtwin.recordings import propose_index, save_index

    path = out or folder / "recordings.toml"
    proposal = propose_index(
        folder,
        label_pattern=label_pattern,
        table=csv_table,
        columns=pairs_of(columns, "--column"),
        include=include or [],
        sample_rate=sample_rate,
        unit=unit,
        channels=channels or None,
        names=names or None,
        calibration_factor=calibration_factor,
        resample=resample,
        speed=speed,
        discharge_pressure=pressure,
        index_folder=path.parent,
        ask=None if as_json or not sys.stdin.isatty() else _asked,
    )
    _refuse_existing(path, overwrite)
    save_index(proposal.index, path)
    entries = proposal.index["recording"]
    result: dict[str, Any] = {"index": path, "recordings": len(entries), "classes": proposal.index.get("classes", [])}
    result |= {"facts": list(proposal.facts), "skipped": list(proposal.skipped)}

    def show() -> None:
        for reason in proposal.skipped:
            note(f"left out: {reason}")
        for sentence in proposal.facts:
            say(sentence)
        say(f"{path}: {len(entries)} recordings of {', '.join(result['classes']) or 'classes that the files name'}")
        say(f"Look it over, then: swashtwin inspect {path}")

    tell(result, as_json, show)


def convert(
    paths: Annotated[list[Path], typer.Argument(metavar="FILE|INDEX...", help="Files, indexes, or folders with one.")],
    out: Annotated[Path, typer.Option(help="Store to write, .h5; it appears when it is whole.")],
    sample_rate: SampleRate = None,
    unit: Unit = None,
    calibration_factor: CalibrationFactor = None,
    channels: Channels = None,
    names: Names = None,
    readings_per_turn: Annotated[
        int | None,
        typer.Option(help="Store even steps of the shaft's angle instead of time: so many a turn, even; whole files."),
    ] = None,
    played_at: Annotated[
        str | None, typer.Option(help='Speed at which all turns are played back: "860 rpm"; the rate follows from it.')
    ] = None,
    tachometer: Tachometer = None,
    pulses: Pulses = None,
    track: Track = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a store that exists.")] = False,
    as_json: Json = False,
) -> None:
    """Write recordings of any format, also such as are larger than memory, to one chunked HDF5 store."""
    from swashtwin.recordings import write_store

    refuse_source(out, paths)
    _refuse_existing(out, overwrite)
    facts = given(
        sample_rate=sample_rate, unit=unit, channels=channels, names=names, calibration_factor=calibration_factor
    )
    recordings = load_all(paths, **facts)
    if readings_per_turn is None:
        _refuse_without_turns(played_at=played_at, tachometer=tachometer, pulses=pulses, track=track)
    else:
        recordings = _along_the_angle(recordings, readings_per_turn, played_at, (tachometer, pulses, track))
    with progress("MB") as bar:
        write_store(recordings, out, progress=bar)
    seconds, size = sum(recording.duration for recording in recordings), out.stat().st_size
    result = {"store": out, "recordings": len(recordings), "seconds": seconds, "bytes": size}

    def show() -> None:
        say(f"{out}: {len(recordings)} recordings, {seconds:.4g} s, {size / 1e6:.4g} MB")
        say(f"Next: swashtwin inspect {out}")

    tell(result, as_json, show)


def _refuse_without_turns(**options: object) -> None:
    for name, value in options.items():
        if value is not None:
            raise typer.BadParameter("is for --readings-per-turn.", param_hint=f"--{name.replace('_', '-')}")


def _along_the_angle(
    recordings: "list[Recording]",
    readings_per_turn: int,
    played_at: str | None,
    shaft: tuple[str | None, int | None, str | None],
) -> "list[Recording]":
    """The recordings at even steps of the shaft's angle, all played back at one speed."""
    from swashtwin.foundation import parse
    from swashtwin.signals import resampled_by_angle, stated_angle

    require_one_way(*shaft)
    if played_at is None:
        reason = 'recordings of different speeds need one in common to be played back at, such as "860 rpm".'
        raise typer.BadParameter(reason, param_hint="--played-at")
    speed = parse(played_at, "rad/s", name="played_at")
    made = []
    for one in recordings:
        angle = shaft_angle(one, *shaft) or stated_angle(one)
        made.append(resampled_by_angle(vibration_of(one, shaft[0]), angle, readings_per_turn, played_at=speed))
    return made


def split(
    source: Index,
    out: Annotated[Path | None, typer.Option(help="Folder for both; that of the index by default.")] = None,
    test_fraction: Annotated[
        float | None, typer.Option(help="Share to test on, above 0 and at most 0.5; 0.2 by default.")
    ] = None,
    group: GroupName = "recording",
    folds: Annotated[
        int | None, typer.Option(min=2, help="Write this many folds, fold-1/train.toml and so on, not one split.")
    ] = None,
    dealing: Annotated[
        Dealing | None, typer.Option(help="Folds: classes alike in each, of like size, each group once, or drawn.")
    ] = None,
    seed: Seed = 0,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a split that exists.")] = False,
    as_json: Json = False,
) -> None:
    """Split an index by recording into train.toml and test.toml, for a twin and a classifier alike.

    Calibrating is training: calibrate, synthesize and train with train.toml, and evaluate with test.toml.
    """
    from swashtwin.recordings import load_recordings, narrow_index

    if folds is not None and dealing is Dealing.each:
        raise typer.BadParameter("each group is a fold with --dealing each; leave it out.", param_hint="--folds")
    if test_fraction is not None and (folds or dealing) and dealing is not Dealing.shuffled:
        reason = "folds say themselves how much is tested on; only --dealing shuffled draws a share."
        raise typer.BadParameter(reason, param_hint="--test-fraction")
    recordings = load_recordings(source)
    sides = _sides(recordings, 0.2 if test_fraction is None else test_fraction, group, folds, dealing, seed)
    folder = out or (source if source.is_dir() else source.parent)
    for place, name in ((place, name) for place, side in sides.items() for name in side):
        _refuse_existing(folder / place / f"{name}.toml", overwrite)
    parts: list[dict[str, Any]] = []
    for place, side in sides.items():
        paths = {name: folder / place / f"{name}.toml" for name in side}
        written = {name: narrow_index(source, recordings, side[name], path) for name, path in paths.items()}
        parts.append({**written, **{f"{name}_recordings": ids for name, ids in side.items()}})
    result = {"seed": seed, "group": group, **({"folds": parts} if folds or dealing else parts[0])}

    def show() -> None:
        for part in parts:
            for name in ("train", "test"):
                say(f"{part[name]}: {len(part[f'{name}_recordings'])} recordings")

    tell(result, as_json, show)


def _sides(
    recordings: "Sequence[Recording]",
    test_fraction: float,
    group: str,
    folds: int | None,
    dealing: Dealing | None,
    seed: int,
) -> dict[str, dict[str, list[str]]]:
    """Recording ids of each role, by the folder that they are to stand in."""
    from swashtwin.learning import cut_windows, group_folds, split_by_recording
    from swashtwin.recordings import recording_groups

    shortest = min(recording.n_samples for recording in recordings)
    whole = cut_windows(recordings, length=shortest, allow_partial_revolution=True)
    groups = recording_groups(recordings, group)
    if folds is None and dealing is None:
        pairs = [split_by_recording(whole, test_fraction=test_fraction, seed=seed, group=groups)]
    else:
        how: Any = (dealing or Dealing.stratified).value
        dealt = group_folds(
            whole, group=groups, n_folds=folds or 5, dealing=how, test_fraction=test_fraction, seed=seed
        )
        pairs = [(whole.subset(trained), whole.subset(tested)) for trained, tested in dealt]
    names = [""] if folds is None and dealing is None else [f"fold-{number}" for number in range(1, len(pairs) + 1)]
    return {
        name: {
            role: sorted(set(part.recording_id.tolist())) for role, part in zip(("train", "test"), pair, strict=True)
        }
        for name, pair in zip(names, pairs, strict=True)
    }


def _asked(key: str, question: str) -> str | None:
    """Answer of whoever sits at the terminal; None where it is empty."""
    answer: str = typer.prompt(f"{question} [{key}]", default="", show_default=False, err=True)
    return answer.strip() or None


def _refuse_existing(path: Path, overwrite: bool) -> None:
    from swashtwin.foundation import InputError

    if path.exists() and not overwrite:
        raise InputError(f"{path} exists and may have been edited; replace it with --overwrite, or name another --out.")
