"""Readers of sets with one recording per file, described by the name of the file."""

import csv
import re
from collections.abc import Callable
from pathlib import Path

from swashtwin.foundation import DataError, MissingFileError
from swashtwin.recordings import Entry, Recording, load_entry, stem_of, suffix_of


def files_below(folder: Path, *suffixes: str) -> list[Path]:
    """Return the files with one of `suffixes` below `folder`, sorted by path.

    Raises
    ------
    MissingFileError
        The folder does not exist.
    DataError
        The folder holds no such file.
    """
    if not folder.is_dir():
        raise MissingFileError(f"{folder} is not a folder. Give the folder that holds the set.")

    paths = sorted(
        path for path in folder.rglob("*") if suffix_of(path) in suffixes and path.is_file()
    )
    if not paths:
        raise DataError(
            f"{folder} holds no {' or '.join(suffixes)} file. Give the folder that holds the set."
        )

    return paths


def read_set_table(folder: Path) -> dict[str, dict[str, str]]:
    """Return the rows of the set's ``files.csv`` by their column ``file``.

    They hold checksums. The table is empty if the set came without the file.
    """
    path = folder / "files.csv"
    if not path.is_file():
        return {}

    with path.open(newline="", encoding="utf-8-sig") as file:
        return {row["file"]: row for row in csv.DictReader(file) if row.get("file")}


def drop_empty(texts: dict[str, str | None]) -> dict[str, str]:
    """Return the texts that are not empty."""
    return {name: text for name, text in texts.items() if text}


def _read(
    folder: Path | str,
    suffixes: tuple[str, ...],
    pattern: str,
    example: str,
    entry: Callable[[str, re.Match[str], dict[str, str]], Entry],
) -> list[Recording]:
    """Return the recordings of the files whose stem matches a pattern.

    Parameters
    ----------
    example : name of a file, for the error message.
    entry : describes a file by its path, the match of its stem, and its row of the set's table.
    """
    folder = Path(folder)
    table = read_set_table(folder)

    recordings = []
    for path in files_below(folder, *suffixes):
        match = re.fullmatch(pattern, stem_of(path))
        if match is not None:
            file = path.relative_to(folder).as_posix()
            recordings.append(load_entry(path, entry(file, match, table.get(file, {}))))

    if not recordings:
        raise DataError(
            f'{folder} holds no file named like "{example}". Give the folder of the set.'
        )

    return recordings


def read_bearing_run_to_failure(folder: Path | str) -> list[Recording]:
    """Return the recordings of six rolling bearings that ran until they failed.

    They are sorted by bearing and time. Each snapshot has 2 channels, 0.1 s at 25.6 kHz. Nectoux
    and others, "PRONOSTIA: an experimental platform for bearings accelerated degradation tests",
    IEEE PHM 2012, learning set. The files are named ``Bearing1_1_00007.csv`` (bearing, snapshot),
    gzip'd or not; a snapshot was taken every 10 s. Nobody labeled when damage began, so there are
    no labels.

    ``specimen`` is the bearing; ``attributes["snapshot"]`` counts from 1. If the set came with a
    ``files.csv``, ``attributes["snapshots"]`` is the number of snapshots of the bearing. The speed
    is that of the literature (1800, 1650 and 1500 rev/min).

    Raises
    ------
    DataError
        `folder` holds no such file, or one is damaged.
    """
    speeds = {"1": "1800 rpm", "2": "1650 rpm", "3": "1500 rpm"}

    def entry(file: str, match: re.Match[str], row: dict[str, str]) -> Entry:
        attributes = {
            "speed": speeds.get(match[2]),
            "snapshot": str(int(match[3])),
            "snapshots": row.get("of"),
        }
        return Entry(
            file=file,
            id=match[0],
            specimen=match[1],
            channels=(4, 5),
            names=("horizontal", "vertical"),
            unit="g",
            sample_rate="25.6 kHz",
            separator=",",
            decimal=".",
            header_lines=0,
            attributes=drop_empty(attributes),
        )

    return _read(
        folder, (".csv", ".csv.gz"), r"(Bearing(\d)_\d+)_(\d+)", "Bearing1_1_00007.csv", entry
    )


def read_motor_pump_industrial(folder: Path | str) -> list[Recording]:
    """Return the recordings of motors of 45 kW that drive water pumps.

    There are 103 healthy and 117 faulty recordings of 5 s at 1 kHz, along three axes. The files are
    ``H1.mat`` to ``H103.mat`` and ``F1.mat`` to ``F117.mat``, wherever below `folder`, each with
    the variable ``H`` (time by x, y, z). ``faulty`` covers faults of bearings and of alignment;
    which file has which is not stated. Values were scaled to about unit RMS by the set's authors,
    so the unit is ``1`` and the loudness means nothing.

    Groups for an honest split: ``attributes["block"]`` (``hA`` healthy 1-17, ``hB`` healthy 18-103,
    ``fA`` faulty 1-80, ``fB`` faulty 81-117). The blocks were read off the dominant lines and are
    probably machines or mounting points; the set names no machine. ``attributes["transient"]`` is
    ``1`` for faulty 97-103, which look like a start or stop.

    Raises
    ------
    DataError
        `folder` holds no such file, or one is damaged.

    References
    ----------
    Kafeel et al., Sensors 21 (2021) 7587, doi:10.3390/s21227587.
    """

    def entry(file: str, match: re.Match[str], row: dict[str, str]) -> Entry:
        letter = match[1].lower()
        number = int(match[2])
        label, last_number_of_block_a = {"h": ("healthy", 17), "f": ("faulty", 80)}[letter]
        is_transient = letter == "f" and 97 <= number <= 103

        return Entry(
            file=file,
            id=f"{label}_{number}",
            label=label,
            channels=("H*",),
            names=("x", "y", "z"),
            unit="1",
            sample_rate="1 kHz",
            sha256=row.get("sha256"),
            attributes={
                "block": letter + ("A" if number <= last_number_of_block_a else "B"),
                "transient": str(int(is_transient)),
            },
        )

    recordings = _read(folder, (".mat",), r"(?i)([HF])\w*?(\d+)", "H1.mat", entry)
    return sorted(recordings, key=lambda r: (str(r.label), int(r.recording_id.rpartition("_")[2])))


def read_pump_cavitation(folder: Path | str) -> list[Recording]:
    """Return the recordings of a centrifugal pump whose suction was throttled.

    There are 3 speeds, 5 states and 3 repeats, each of 5.127 s at 6400 Hz. The files are named ``01
    1 s700 healthy.dat`` (run, repeat, speed, label), with underscores or gzip'd or not, wherever
    below `folder`. Channels 0 to 3 are accelerometers on the pump, the fifth a microphone (inferred
    from its amplitude and resolution); no unit is stated, so it is ``1``.

    Labels: ``healthy`` and ``cavitation25`` to ``cavitation100``, where the number is the share of
    the flow that was removed by closing the suction side, not a measured intensity; at
    ``cavitation100`` there is no flow.

    Groups for an honest split: ``attributes["speed_nominal"]`` (``700 rpm``, ``1000 rpm``, ``1200
    rpm``); ``attributes["repeat"]`` (1 to 3) is a weak one, since repeats were taken back to back
    at one setting. If the set came with a ``files.csv``, there are ``speed`` as logged, ``flow``
    and ``suction_pressure_gauge``; otherwise ``speed`` is the nominal one. There is one pump
    (``specimen``) and one day.

    Raises
    ------
    DataError
        `folder` holds no such file, or one is damaged.
    """

    def entry(file: str, match: re.Match[str], row: dict[str, str]) -> Entry:
        attributes = {
            "speed": f"{row.get('speed_rpm_log') or match[3]} rpm",
            "speed_nominal": f"{match[3]} rpm",
            "repeat": match[2],
            "run": match[1],
        }
        for name, column, unit in (
            ("flow", "flow_m3h_log", "m^3/h"),
            ("suction_pressure_gauge", "suction_pressure_bar_log", "bar"),
            ("throttle", "throttle_percent", "%"),
        ):
            if row.get(column):
                attributes[name] = f"{row[column]} {unit}"

        return Entry(
            file=file,
            id=match[0].replace(" ", "_"),
            label=match[4],
            specimen="pump",
            channels=("ch 0", "ch 1", "ch 2", "ch 3", "ch 4"),
            names=(*(f"acceleration {number}" for number in range(4)), "microphone"),
            unit="1",
            separator="\t",
            decimal=".",
            sha256=row.get("sha256"),
            attributes=attributes,
        )

    pattern = r"(\d+)[ _](\d)[ _]s(\d+)[ _](\w+)"
    return _read(folder, (".dat", ".dat.gz"), pattern, "01 1 s700 healthy.dat", entry)
