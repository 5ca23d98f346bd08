"""Commands of the group data: convert, split."""

from pathlib import Path
from typing import Annotated

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
    test_fraction: Annotated[float, typer.Option(help="Share to test on, above 0 and at most 0.5.")] = 0.2,
    group: GroupName = "recording",
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Split an index by recording into train.toml and test.toml, for a twin and a classifier alike.

    Calibrating is training: calibrate, synthesize and train with train.toml, and evaluate with test.toml.
    """
    from swashtwin.recordings import load_recordings, narrow_index

    folder = out or (source if source.is_dir() else source.parent)
    paths = {name: folder / f"{name}.toml" for name in ("train", "test")}
    require_output(*paths.values(), inputs=[source], force=force)
    recordings = load_recordings(source)
    sides = dict(zip(paths, recordings.split(test_fraction, by=group, seed=seed), strict=True))
    ids = {name: sorted(side.recording_ids) for name, side in sides.items()}
    files = {name: narrow_index(source, recordings, ids[name], path) for name, path in paths.items()}
    result = {"seed": seed, "group": group, **files, **{f"{name}_recordings": ids[name] for name in ids}}

    def show() -> None:
        for name, file in files.items():
            say(f"{file}: {plural(len(ids[name]), 'recording')}")

    tell(result, as_json, show)
