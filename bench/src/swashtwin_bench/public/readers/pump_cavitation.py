"""A centrifugal pump whose suction was throttled in five steps at three speeds."""

import re
from pathlib import Path

from swashtwin.foundation import DataError
from swashtwin.recordings import Entry, Recording, recording_of, stem_of
from swashtwin_bench.public.readers.files import facts_of, files_below, table_of

_NAME = re.compile(r"(\d+)[ _](\d)[ _]s(\d+)[ _](\w+)")
_CHANNELS = ("acceleration 0", "acceleration 1", "acceleration 2", "acceleration 3", "microphone")


def read_pump_cavitation(folder: Path | str) -> list[Recording]:
    """Every recording of the set: 3 speeds, 5 states, 3 repeats, 5.127 s at 6400 Hz.

    The files are named ``01 1 s700 healthy.dat`` (run, repeat, speed, label), with underscores or gzip'd or not,
    wherever below `folder`. Channels 0 to 3 are accelerometers on the pump, the fifth a microphone (inferred from its
    amplitude and resolution); no unit is stated, so it is ``1``.

    Labels: ``healthy`` and ``cavitation25`` to ``cavitation100``, where the number is the share of the flow that was
    removed by closing the suction side, not a measured intensity; at ``cavitation100`` there is no flow.

    Groups for an honest split: ``attributes["speed_nominal"]`` (``700 rpm``, ``1000 rpm``, ``1200 rpm``);
    ``attributes["repeat"]`` (1 to 3) is a weak one, since repeats were taken back to back at one setting. Where the
    set came with a ``files.csv``: ``speed`` as logged, ``flow`` and ``suction_pressure_gauge``; ``speed`` is the
    nominal one otherwise. There is one pump (``specimen``) and one day.

    Raises
    ------
    DataError
        `folder` holds no such file, or one is damaged.
    """
    folder = Path(folder)
    table = table_of(folder)
    recordings = []
    for path in files_below(folder, ".dat", ".dat.gz"):
        match = _NAME.fullmatch(stem_of(path))
        if match is None:
            continue
        name = path.relative_to(folder).as_posix()
        row = table.get(name, {})
        units = {"flow_m3h_log": "m^3/h", "suction_pressure_bar_log": "bar", "throttle_percent": "%"}
        with_unit = {key: f"{row[key]} {unit}" for key, unit in units.items() if row.get(key)}
        attributes = {
            "speed": f"{row.get('speed_rpm_log') or match[3]} rpm",
            "speed_nominal": f"{match[3]} rpm",
            "repeat": match[2],
            "run": match[1],
            "flow": with_unit.get("flow_m3h_log"),
            "suction_pressure_gauge": with_unit.get("suction_pressure_bar_log"),
            "throttle": with_unit.get("throttle_percent"),
        }
        entry = Entry(
            file=name,
            id=stem_of(path).replace(" ", "_"),
            label=match[4],
            specimen="pump",
            channels=("ch 0", "ch 1", "ch 2", "ch 3", "ch 4"),
            names=_CHANNELS,
            unit="1",
            separator="\t",
            decimal=".",
            sha256=row.get("sha256"),
            attributes=facts_of(attributes),
        )
        recordings.append(recording_of(path, entry))
    if not recordings:
        raise DataError(f'{folder} holds no file named like "01 1 s700 healthy.dat"; name the folder of the set.')
    return recordings
