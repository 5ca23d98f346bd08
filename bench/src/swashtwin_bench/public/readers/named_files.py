"""Sets of one recording a file, whose name says what it is of."""

import csv
import re
from collections.abc import Callable
from pathlib import Path

from swashtwin.foundation import DataError, MissingFileError
from swashtwin.recordings import Entry, Recording, load_entry, stem_of, suffix_of


def files_below(folder: Path, *suffixes: str) -> list[Path]:
    """Files with one of `suffixes` below `folder`, sorted by path.

    Raises
    ------
    MissingFileError
        There is no such folder.
    DataError
        It holds no such file.
    """
    if not folder.is_dir():
        raise MissingFileError(f"{folder} is not a folder; name the one that holds the set.")
    paths = sorted(
        path for path in folder.rglob("*") if suffix_of(path) in suffixes and path.is_file()
    )
    if not paths:
        raise DataError(
            f"{folder} holds no {' or '.join(suffixes)} file; name the folder that holds the set."
        )
    return paths


def read_set_table(folder: Path) -> dict[str, dict[str, str]]:
    """Rows of the set's ``files.csv``, with checksums, by their column ``file``; empty where the
    set came without.
    """
    path = folder / "files.csv"
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8-sig") as file:
        return {row["file"]: row for row in csv.DictReader(file) if row.get("file")}


def drop_empty(texts: dict[str, str | None]) -> dict[str, str]:
    """The texts that say something."""
    return {name: text for name, text in texts.items() if text}


def _read(
    folder: Path | str,
    suffixes: tuple[str, ...],
    pattern: str,
    example: str,
    entry: Callable[[str, re.Match[str], dict[str, str]], Entry],
) -> list[Recording]:
    """Recordings of the files whose stem is the `pattern`.

    Parameters
    ----------
    entry : gives what is known of a file, from its path, its name's parts and its row of the set's
        table.
    """
    folder = Path(folder)
    table = read_set_table(folder)
    recordings = []
    for path in files_below(folder, *suffixes):
        if (match := re.fullmatch(pattern, stem_of(path))) is not None:
            name = path.relative_to(folder).as_posix()
            recordings.append(load_entry(path, entry(name, match, table.get(name, {}))))
    if not recordings:
        raise DataError(
            f'{folder} holds no file named like "{example}"; name the folder of the set.'
        )
    return recordings


def read_bearing_run_to_failure(folder: Path | str) -> list[Recording]:
    """Six rolling bearings that ran until they failed, bearing after bearing, in order of time.

    Each snapshot has 2 channels, 0.1 s at 25.6 kHz. Nectoux and others, "PRONOSTIA: an experimental
    platform for bearings accelerated degradation tests", IEEE PHM 2012, learning set. The files are
    named ``Bearing1_1_00007.csv`` (bearing, snapshot), gzip'd or not; a snapshot was taken every 10
    s. Nobody labeled when damage began, so there are no labels.

    ``specimen`` is the bearing; ``attributes["snapshot"]`` counts from 1, and where the set came
    with a ``files.csv`` ``attributes["snapshots"]`` is how many the bearing had. The speed is that
    of the literature (1800, 1650 and 1500 rev/min).

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
    """Motors of 45 kW that drive water pumps: 103 healthy and 117 faulty recordings of 5 s at 1
    kHz, three axes.

    The files are ``H1.mat`` to ``H103.mat`` and ``F1.mat`` to ``F117.mat``, wherever below
    `folder`, each with the variable ``H`` (time by x, y, z). ``faulty`` covers faults of bearings
    and of alignment; which file has which is not stated. Values were scaled to about unit RMS by
    the set's authors, so the unit is ``1`` and level means nothing.

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
        letter, number = match[1].lower(), int(match[2])
        label, last_of_a = {"h": ("healthy", 17), "f": ("faulty", 80)}[letter]
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
                "block": letter + ("A" if number <= last_of_a else "B"),
                "transient": str(int(letter == "f" and 97 <= number <= 103)),
            },
        )

    recordings = _read(folder, (".mat",), r"(?i)([HF])\w*?(\d+)", "H1.mat", entry)
    return sorted(recordings, key=lambda r: (str(r.label), int(r.recording_id.rpartition("_")[2])))


def read_pump_cavitation(folder: Path | str) -> list[Recording]:
    """A centrifugal pump whose suction was throttled: 3 speeds, 5 states, 3 repeats, 5.127 s at
    6400 Hz.

    The files are named ``01 1 s700 healthy.dat`` (run, repeat, speed, label), with underscores or
    gzip'd or not, wherever below `folder`. Channels 0 to 3 are accelerometers on the pump, the
    fifth a microphone (inferred from its amplitude and resolution); no unit is stated, so it is
    ``1``.

    Labels: ``healthy`` and ``cavitation25`` to ``cavitation100``, where the number is the share of
    the flow that was removed by closing the suction side, not a measured intensity; at
    ``cavitation100`` there is no flow.

    Groups for an honest split: ``attributes["speed_nominal"]`` (``700 rpm``, ``1000 rpm``, ``1200
    rpm``); ``attributes["repeat"]`` (1 to 3) is a weak one, since repeats were taken back to back
    at one setting. Where the set came with a ``files.csv``: ``speed`` as logged, ``flow`` and
    ``suction_pressure_gauge``; ``speed`` is the nominal one otherwise. There is one pump
    (``specimen``) and one day.

    Raises
    ------
    DataError
        `folder` holds no such file, or one is damaged.
    """

    def entry(file: str, match: re.Match[str], row: dict[str, str]) -> Entry:
        logged = {
            "flow": ("flow_m3h_log", "m^3/h"),
            "suction_pressure_gauge": ("suction_pressure_bar_log", "bar"),
            "throttle": ("throttle_percent", "%"),
        }
        attributes = {
            "speed": f"{row.get('speed_rpm_log') or match[3]} rpm",
            "speed_nominal": f"{match[3]} rpm",
            "repeat": match[2],
            "run": match[1],
            **{name: f"{row[key]} {unit}" for name, (key, unit) in logged.items() if row.get(key)},
        }
        return Entry(
            file=file,
            id=match[0].replace(" ", "_"),
            label=match[4],
            specimen="pump",
            channels=("ch 0", "ch 1", "ch 2", "ch 3", "ch 4"),
            names=(
                "acceleration 0",
                "acceleration 1",
                "acceleration 2",
                "acceleration 3",
                "microphone",
            ),
            unit="1",
            separator="\t",
            decimal=".",
            sha256=row.get("sha256"),
            attributes=attributes,
        )

    pattern = r"(\d+)[ _](\d)[ _]s(\d+)[ _](\w+)"
    return _read(folder, (".dat", ".dat.gz"), pattern, "01 1 s700 healthy.dat", entry)
