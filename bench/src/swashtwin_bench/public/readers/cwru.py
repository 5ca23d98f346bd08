"""Bearings of Case Western Reserve University: drive end and fan end, 12 and 48 kHz."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from swashtwin.foundation import DataError
from swashtwin.recordings import Entry, ReadOptions, Recording, load_entry, open_raw
from swashtwin_bench.public.readers.named_files import drop_empty, files_below, read_set_table

# Nominal speed [rpm] at each load [hp].
_LOADS = {0: 1797, 1: 1772, 2: 1750, 3: 1730}

# End, rate [kHz], label, diameter of the fault [mil], its place [o'clock], and the record at each
# load.
_SERIES = (
    ("DE", 12, "inner_race", 7, "", "105 106 107 108"),
    ("DE", 12, "inner_race", 14, "", "169 170 171 172"),
    ("DE", 12, "inner_race", 21, "", "209 210 211 212"),
    ("DE", 12, "inner_race", 28, "", "3001 3002 3003 3004"),
    ("DE", 12, "ball", 7, "", "118 119 120 121"),
    ("DE", 12, "ball", 14, "", "185 186 187 188"),
    ("DE", 12, "ball", 21, "", "222 223 224 225"),
    ("DE", 12, "ball", 28, "", "3005 3006 3007 3008"),
    ("DE", 12, "outer_race", 7, "6", "130 131 132 133"),
    ("DE", 12, "outer_race", 7, "3", "144 145 146 147"),
    ("DE", 12, "outer_race", 7, "12", "156 158 159 160"),
    ("DE", 12, "outer_race", 14, "6", "197 198 199 200"),
    ("DE", 12, "outer_race", 21, "6", "234 235 236 237"),
    ("DE", 12, "outer_race", 21, "3", "246 247 248 249"),
    ("DE", 12, "outer_race", 21, "12", "258 259 260 261"),
    ("DE", 48, "inner_race", 7, "", "109 110 111 112"),
    ("DE", 48, "inner_race", 14, "", "174 175 176 177"),
    ("DE", 48, "inner_race", 21, "", "213 214 215 217"),
    ("DE", 48, "ball", 7, "", "122 123 124 125"),
    ("DE", 48, "ball", 14, "", "189 190 191 192"),
    ("DE", 48, "ball", 21, "", "226 227 228 229"),
    ("DE", 48, "outer_race", 7, "6", "135 136 137 138"),
    ("DE", 48, "outer_race", 7, "3", "148 149 150 151"),
    ("DE", 48, "outer_race", 7, "12", "161 162 163 164"),
    ("DE", 48, "outer_race", 14, "6", "201 202 203 204"),
    ("DE", 48, "outer_race", 21, "6", "238 239 240 241"),
    ("DE", 48, "outer_race", 21, "3", "250 251 252 253"),
    ("DE", 48, "outer_race", 21, "12", "262 263 264 265"),
    ("FE", 12, "inner_race", 7, "", "278 279 280 281"),
    ("FE", 12, "inner_race", 14, "", "274 275 276 277"),
    ("FE", 12, "inner_race", 21, "", "270 271 272 273"),
    ("FE", 12, "ball", 7, "", "282 283 284 285"),
    ("FE", 12, "ball", 14, "", "286 287 288 289"),
    ("FE", 12, "ball", 21, "", "290 291 292 293"),
    ("FE", 12, "outer_race", 7, "6", "294 295 296 297"),
    ("FE", 12, "outer_race", 7, "3", "298 299 300 301"),
    ("FE", 12, "outer_race", 7, "12", "302 305 306 307"),
    ("FE", 12, "outer_race", 14, "6", "313 - - -"),
    ("FE", 12, "outer_race", 14, "3", "310 309 311 312"),
    ("FE", 12, "outer_race", 21, "6", "315 - - -"),
    ("FE", 12, "outer_race", 21, "3", "- 316 317 318"),
    ("DE", 48, "normal", 0, "", "97 98 99 100"),
    ("FE", 48, "normal", 0, "", "97 98 99 100"),
)

_NUMBER = re.compile(r"(?<!\d)(\d{2,4})(?!\d)")
_SPEED = re.compile(r"(X\d+)?RPM", re.IGNORECASE)


class _Record(NamedTuple):
    """One record at one end of the motor."""

    number: int
    end: str
    kilohertz: int
    label: str
    mil: int
    position: str
    load: int

    @property
    def specimen(self) -> str:
        if self.label == "normal":
            return f"{self.end}-healthy"

        return f"{self.end}-{self.label}-{self.mil}"


def read_cwru(folder: Path | str) -> list[Recording]:
    """Return every recording of the CWRU bearing set, one for each record and end.

    Each has the signal of the accelerometer at its end. A file is recognized by the record number
    in its name (``105.mat``, ``105_0.mat``, ``..._rec105.mat``), anywhere below `folder`; the
    record decides label, rate and load. Other files are skipped, and of two files of a record the
    first is read.

    Labels are the seat of the fault: ``normal``, ``inner_race``, ``ball``, ``outer_race``. The
    channel is called ``acceleration`` at either end, so that one classifier can diagnose both.
    Readings are assumed to be in g, as in the literature.

    Groups for an honest split: ``specimen`` (the bearing: end, seat and diameter; both rates, all
    loads and all positions on the outer race are one), ``attributes["fault_size_mil"]``,
    ``attributes["end"]`` (``DE`` or ``FE``, two types of bearing). Further ``load_hp``,
    ``or_position`` [o'clock], ``record``, ``rate_khz``, and ``speed`` (as measured, or nominal for
    the load if the file states none).

    Raises
    ------
    DataError
        `folder` holds no record of the set, or one is damaged.

    Notes
    -----
    What misleads: the normal records are at 48 kHz and most faults at 12 kHz, so a network may
    learn the rate. There is one healthy bearing at each end. The loads are the same bearings again.
    If the set came with a ``files.csv``, ``attributes["known_problem"]`` states failed acquisitions
    (table 3 of Smith and Randall, 2015, doi:10.1016/j.ymssp.2015.04.021).
    """
    folder = Path(folder)
    records = _records()
    table = read_set_table(folder)

    paths: dict[int, Path] = {}
    for path in files_below(folder, ".mat"):
        numbers = {int(text) for text in _NUMBER.findall(path.stem)} & records.keys()
        # A name with the numbers of two records does not tell which one it holds.
        if len(numbers) == 1:
            paths.setdefault(numbers.pop(), path)

    if not paths:
        raise DataError(
            f"{folder} holds no file named after a record of the CWRU set, such as 105.mat."
        )

    recordings: list[Recording] = []
    for number, path in sorted(paths.items()):
        recordings += _recordings(path, folder, records[number], table)

    return recordings


def _records() -> dict[int, list[_Record]]:
    """Return the records by number; the normal ones exist at both ends."""
    records: dict[int, list[_Record]] = {}
    for end, kilohertz, label, mil, position, numbers in _SERIES:
        for load, text in enumerate(numbers.split()):
            if text != "-":
                record = _Record(int(text), end, kilohertz, label, mil, position, load)
                records.setdefault(record.number, []).append(record)
    return records


def _recordings(
    path: Path, folder: Path, records: list[_Record], table: dict[str, dict[str, str]]
) -> Iterator[Recording]:
    file = path.relative_to(folder).as_posix()
    row = table.get(file, {})
    raw = open_raw(path, ReadOptions())
    speeds = [text for name, text in raw.attributes.items() if text and _SPEED.fullmatch(name)]
    measured_speed = float(speeds[0]) if speeds else None

    for record in records:
        variables = [name for name in raw.columns if name.endswith(f"_{record.end}_time")]
        if not variables:
            raise DataError(
                f"{path} has no variable X..._{record.end}_time; it has {', '.join(raw.columns)}."
            )
        # A file may also hold the variables of another record (99.mat does).
        matching = [name for name in variables if name.startswith(f"X{record.number:03d}")]
        variable = matching[0] if matching else variables[0]

        speed = _LOADS[record.load] if measured_speed is None else measured_speed
        attributes = {
            "speed": f"{speed:g} rpm",
            "end": record.end,
            "fault_size_mil": str(record.mil),
            "or_position": record.position,
            "load_hp": str(record.load),
            "record": str(record.number),
            "rate_khz": str(record.kilohertz),
            "known_problem": row.get("known_problem"),
        }
        entry = Entry(
            file=file,
            id=f"cwru_{record.number}_{record.end}",
            label=record.label,
            specimen=record.specimen,
            channels=(variable,),
            names=("acceleration",),
            unit="g",
            sample_rate=f"{record.kilohertz} kHz",
            sha256=row.get("sha256"),
            attributes=drop_empty(attributes),
        )
        yield load_entry(path, entry)
