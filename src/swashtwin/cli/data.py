"""Commands of the group data: convert, split."""

from pathlib import Path
from typing import Annotated, Any

import typer

from swashtwin.cli.console import progress, say, tell
from swashtwin.cli.options import GroupName, Index, Json, Reading, Seed, Sources, reads_files
from swashtwin.cli.outputs import Force, require_output
from swashtwin.cli.sources import load_sources
from swashtwin.foundation import plural


@reads_files
def convert(
    paths: Sources,
    out: Annotated[Path, typer.Option(help="Store to write, .h5; it appears when it is complete.")],
    reading: Reading,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write recordings of any format to one chunked HDF5 store; they may be larger than memory."""
    from swashtwin.recordings import write_store

    require_output(out, inputs=paths, force=force)
    recordings = load_sources(paths, **reading)
    with progress("MB") as bar:
        write_store(recordings, out, progress=bar)
    seconds, size = sum(recording.duration for recording in recordings), out.stat().st_size
    result = {"store": out, "recordings": len(recordings), "seconds": seconds, "bytes": size}

    def show() -> None:
        say(f"{out}: {plural(len(recordings), 'recording')}, {seconds:.4g} s, {size / 1e6:.4g} MB")
        say(f"Next: swashtwin inspect {out}")

    tell(result, as_json, show)


def split(
    source: Index,
    out: Annotated[Path | None, typer.Option(help="Folder for both files; that of the index by default.")] = None,
    test_fraction: Annotated[
        float | None, typer.Option(help="Share to test on, above 0 and at most 0.5; 0.2 by default.")
    ] = None,
    group: GroupName = "recording",
    folds: Annotated[
        int | None, typer.Option(min=2, help="Write this many folds, fold-1/train.toml and so on, not one split.")
    ] = None,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Split an index by recording into train.toml and test.toml, for a twin and a classifier alike.

    Calibrating is training: calibrate, synthesize and train with train.toml, and evaluate with test.toml.
    """
    from swashtwin.learning import cut_windows, group_folds, split_by_recording
    from swashtwin.recordings import load_recordings, narrow_index, recording_groups

    if test_fraction is not None and folds:
        raise typer.BadParameter("the number of folds sets it.", param_hint="--test-fraction")
    folder = out or (source if source.is_dir() else source.parent)
    first = folder / ("fold-1" if folds else "")
    require_output(first / "train.toml", first / "test.toml", inputs=[source], force=force)
    recordings = load_recordings(source)
    shortest = min(recording.n_samples for recording in recordings)
    windows = cut_windows(recordings, length=shortest, allow_partial_revolution=True)
    groups = recording_groups(recordings, group)
    if folds is None:
        share = 0.2 if test_fraction is None else test_fraction
        pairs = {"": split_by_recording(windows, test_fraction=share, seed=seed, group=groups)}
    else:
        dealt = group_folds(windows, group=groups, n_folds=folds, seed=seed)
        pairs = {f"fold-{n}": (windows.subset(one), windows.subset(other)) for n, (one, other) in enumerate(dealt, 1)}
    sides = {
        fold: {name: sorted(set(part.recording_id.tolist())) for name, part in (("train", train), ("test", test))}
        for fold, (train, test) in pairs.items()
    }
    targets = [folder / fold / f"{name}.toml" for fold, side in sides.items() for name in side]
    require_output(*targets, inputs=[source], force=force)
    parts: list[dict[str, Any]] = []
    for fold, side in sides.items():
        paths = {name: folder / fold / f"{name}.toml" for name in side}
        files = {name: narrow_index(source, recordings, side[name], path) for name, path in paths.items()}
        parts.append({**files, **{f"{name}_recordings": ids for name, ids in side.items()}})
    result = {"seed": seed, "group": group, **({"folds": parts} if folds else parts[0])}

    def show() -> None:
        for part in parts:
            for name in ("train", "test"):
                say(f"{part[name]}: {plural(len(part[f'{name}_recordings']), 'recording')}")

    tell(result, as_json, show)
