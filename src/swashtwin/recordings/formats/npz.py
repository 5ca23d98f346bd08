"""NumPy archives of arrays."""

from pathlib import Path

import numpy as np

from swashtwin.recordings.formats.raw import Options, RawFile
from swashtwin.recordings.formats.tables import timed_columns
from swashtwin.recordings.formats.variables import sorted_variables
from swashtwin.recordings.recording import Recording


def read(path: Path, options: Options) -> RawFile:
    """Vectors of an archive as columns, its single numbers and texts as attributes; an array of objects is refused.

    A vector called ``time`` or ``t`` that is as long as the others [s] gives the rate.
    """
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        raw = sorted_variables([(name, archive[name]) for name in archive.files])
    times = [name for name in raw.columns if name.lower() in ("time", "t")]
    if raw.sample_rate is not None or not (times or options.time_column is not None):
        return raw
    columns = {name: raw.columns[name] for name in (*times, *(name for name in raw.columns if name not in times))}
    return timed_columns(path, columns, raw.units, raw.attributes, options)


def write(recording: Recording, path: Path) -> None:
    """Write ``signal`` (time by channel), ``sample_rate``, ``unit`` and ``channels``."""
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            signal=recording.signal.T,
            sample_rate=recording.sample_rate,
            unit=recording.unit,
            channels=np.array(recording.channels),
        )
