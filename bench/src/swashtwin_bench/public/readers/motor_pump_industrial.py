"""Motors of 45 kW that drive water pumps, healthy and faulty (Kafeel et al., 2021)."""

import re
from pathlib import Path

from swashtwin.foundation import DataError
from swashtwin.recordings import Entry, Recording, recording_of
from swashtwin_bench.public.readers.files import files_below, table_of

_NAME = re.compile(r"([HF])\w*?(\d+)", re.IGNORECASE)
_LABELS = {"h": "healthy", "f": "faulty"}
_LAST_OF_A = {"h": 17, "f": 80}
_TRANSIENT = range(97, 104)


def read_motor_pump_industrial(folder: Path | str) -> list[Recording]:
    """Every recording of the set: 103 healthy and 117 faulty ones of 5 s at 1 kHz, three axes.

    The files are ``H1.mat`` to ``H103.mat`` and ``F1.mat`` to ``F117.mat``, wherever below `folder`, each with the
    variable ``H`` (time by x, y, z). ``faulty`` covers faults of bearings and of alignment; which file has which is not
    stated. Values were scaled to about unit RMS by the set's authors, so the unit is ``1`` and level means nothing.

    Groups for an honest split: ``attributes["block"]`` (``hA`` healthy 1-17, ``hB`` healthy 18-103, ``fA`` faulty 1-80,
    ``fB`` faulty 81-117). The blocks were read off the dominant lines and are probably machines or mounting points;
    the set names no machine. ``attributes["transient"]`` is ``1`` for faulty 97-103, which look like a start or stop.

    Raises
    ------
    DataError
        `folder` holds no such file, or one is damaged.

    References
    ----------
    Kafeel et al., Sensors 21 (2021) 7587, doi:10.3390/s21227587.
    """
    folder = Path(folder)
    table = table_of(folder)
    named = [(match, path) for path in files_below(folder, ".mat") if (match := _NAME.fullmatch(path.stem))]
    if not named:
        raise DataError(f"{folder} holds no file called H1.mat or F1.mat; name the folder that holds the set.")
    recordings = []
    for letter, number, path in sorted((match[1].lower(), int(match[2]), path) for match, path in named):
        name = path.relative_to(folder).as_posix()
        entry = Entry(
            file=name,
            id=f"{_LABELS[letter]}_{number}",
            label=_LABELS[letter],
            channels=("H*",),
            names=("x", "y", "z"),
            unit="1",
            sample_rate="1 kHz",
            sha256=table.get(name, {}).get("sha256"),
            attributes={
                "block": letter + ("A" if number <= _LAST_OF_A[letter] else "B"),
                "transient": str(int(letter == "f" and number in _TRANSIENT)),
            },
        )
        recordings.append(recording_of(path, entry))
    return recordings
