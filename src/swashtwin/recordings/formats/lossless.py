"""Recordings of our own HDF5 format, which states every fact."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from swashtwin.foundation import ArtifactError, DataError, InputError
from swashtwin.pump import OperatingCondition
from swashtwin.recordings.formats.raw import Options, RawFile, require_plausible_rates
from swashtwin.recordings.formats.subprocess_reader import read_in_subprocess
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.samples import Columns, Samples


def read_header(path: Path) -> Recording:
    """Recording of a file of its own; its samples are read when they are asked for."""
    return _recording(path, read_in_subprocess("hdf5", path, Options())[""])


def read_headers(path: Path) -> list[Recording]:
    """Every recording of a store.

    Raises
    ------
    ArtifactError
        The file is damaged or of another version.
    """
    try:
        contents = read_in_subprocess("hdf5", path, Options(), "read_store")
        return [_recording(path, raw) for raw in contents.values()]
    except InputError as cause:
        raise ArtifactError(f"{path} is damaged: {cause}") from cause


def condition_in(facts: Mapping[str, Any]) -> OperatingCondition | None:
    """Operating condition among the facts of a file, or None."""
    stated = facts.get("condition")
    return None if stated is None else OperatingCondition(**stated)


def _recording(path: Path, raw: RawFile) -> Recording:
    facts = raw.facts
    if "recording_id" not in facts or raw.sample_rate is None:
        raise DataError(f"{path} is no recording of swashtwin.")
    require_plausible_rates(path, raw)
    columns = Columns(tuple(raw.columns.values()), tuple(facts["factors"]), raw.speeds, tuple(facts["hashes"]))
    name = facts["recording_id"]
    return Recording(
        samples=Samples.from_columns(name, columns, partial(_same, columns)).unopened(),
        sample_rate=raw.sample_rate,
        recording_id=name,
        channels=tuple(facts["channels"]),
        unit=facts["unit"],
        label=facts["label"],
        condition=condition_in(facts),
        specimen=facts["specimen"],
        synthetic=facts["synthetic"],
        attributes=raw.attributes,
    )


def _same(columns: Columns) -> Columns:
    return columns
