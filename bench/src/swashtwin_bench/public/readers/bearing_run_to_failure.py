"""Six rolling bearings that ran until they failed (PRONOSTIA)."""

import re
from pathlib import Path

from swashtwin.foundation import DataError
from swashtwin.recordings import Entry, Recording, recording_of, stem_of
from swashtwin_bench.public.readers.files import files_below, table_of

_NAME = re.compile(r"(Bearing(\d)_\d+)_(\d+)")
_SPEEDS = {"1": "1800 rpm", "2": "1650 rpm", "3": "1500 rpm"}


def read_bearing_run_to_failure(folder: Path | str) -> list[Recording]:
    """Every snapshot of the set, bearing after bearing, in order of time: 2 channels, 0.1 s at 25.6 kHz.

    Nectoux and others, "PRONOSTIA: an experimental platform for bearings accelerated degradation tests", IEEE PHM 2012,
    learning set. The files are named ``Bearing1_1_00007.csv`` (bearing, snapshot), gzip'd or not; a snapshot was taken
    every 10 s. Nobody labeled when damage began, so there are no labels.

    ``specimen`` is the bearing; ``attributes["snapshot"]`` counts from 1, and where the set came with a ``files.csv``
    ``attributes["snapshots"]`` is how many the bearing had. The speed is that of the literature (1800, 1650 and 1500
    rev/min).

    Raises
    ------
    DataError
        `folder` holds no such file, or one is damaged.
    """
    folder = Path(folder)
    table = table_of(folder)
    recordings = []
    for path in files_below(folder, ".csv", ".csv.gz"):
        match = _NAME.fullmatch(stem_of(path))
        if match is None:
            continue
        name = path.relative_to(folder).as_posix()
        total = table.get(name, {}).get("of")
        entry = Entry(
            file=name,
            id=stem_of(path),
            specimen=match[1],
            channels=(4, 5),
            names=("horizontal", "vertical"),
            unit="g",
            sample_rate="25.6 kHz",
            separator=",",
            decimal=".",
            header_lines=0,
            attributes={
                "speed": _SPEEDS.get(match[2], ""),
                "snapshot": str(int(match[3])),
                **({"snapshots": total} if total else {}),
            },
        )
        recordings.append(recording_of(path, entry))
    if not recordings:
        raise DataError(f'{folder} holds no file named like "Bearing1_1_00007.csv"; name the folder of the set.')
    return recordings
