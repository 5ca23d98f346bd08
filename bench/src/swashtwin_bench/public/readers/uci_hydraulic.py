"""Reader of the hydraulic rig of ZeMA (UCI 447), whose pump leaks in three grades.

It makes one recording of each cycle of 60 s.
"""

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, stem_of
from swashtwin_bench.public.readers.named_files import files_below

RATE = 10.0
"""Sample rate of every channel here [Hz]: that of the flow meters."""

# Samples of a cycle at `RATE`.
_SAMPLES = 600

_UNITS = (
    {f"PS{number}": "bar" for number in range(1, 7)}
    | {"EPS1": "W", "FS1": "l/min", "FS2": "l/min"}
    | {f"TS{number}": "degC" for number in range(1, 5)}
    | {"VS1": "mm/s", "CE": "%", "CP": "kW", "SE": "%"}
)
_LEAKAGE = ("no_leakage", "weak_leakage", "severe_leakage")
_PROFILE = ("cooler_pct", "valve_pct", "pump_leakage", "accumulator_bar", "stable_flag")
_SENSOR = re.compile(r"([A-Z]+\d?)(_mean1hz)?")


def read_uci_hydraulic(folder: Path | str) -> list[Recording]:
    """Return every cycle of the set as one recording: 2205 cycles of 600 samples at 10 Hz.

    A recording has one rate, the set's sensors have three. Sensors of 10 Hz (FS1, FS2) are as
    measured. Those of 1 Hz (TS, VS1, CE, CP, SE) are held for ten samples each, so nothing is lost
    or invented. Those of 100 Hz (PS, EPS1) are means over 0.1 s if the original files exist;
    otherwise their means over 1 s are held as well. ``attributes["NAME_rate"]`` states the rate of
    the file. Sensors are recognized by the names of their files (``FS1.txt``, ``PS1.txt.gz``,
    ``PS1_mean1hz.tsv.gz``) anywhere below `folder`; the labels come from ``profile.txt``.

    Labels are the grades of the pump's internal leakage, ``no_leakage``, ``weak_leakage``,
    ``severe_leakage``. Channels carry several units, so the recording's is ``1``;
    ``attributes["units"]`` lists them in the channels' order.

    Groups for an honest split: ``attributes["pump_run"]`` (37 contiguous runs of one grade) and
    ``attributes["cooler_block"]`` (3, the runs of one cooler level). Further ``condition_run`` (194
    runs of one setting of everything), ``cooler_pct``, ``valve_pct``, ``accumulator_bar``,
    ``stable_flag`` (1: perhaps not yet settled) and ``cycle`` (from 0, in the order of
    measurement).

    Raises
    ------
    DataError
        `folder` holds no ``profile.txt``, or a sensor's file has another number of cycles.

    Notes
    -----
    What misleads: the rig went through the settings in order, and neighboring cycles are nearly
    equal, so a random split puts near copies on both sides. VS1 is a velocity's RMS once a second:
    the set has no vibration signal.

    References
    ----------
    Helwig, Pignanelli and Schuetze, I2MTC 2015, doi:10.1109/I2MTC.2015.7151267.
    """
    folder = Path(folder)
    paths = files_below(folder, ".txt", ".txt.gz", ".tsv.gz")
    profile = next((path for path in paths if stem_of(path) == "profile"), None)
    if profile is None:
        raise DataError(f"{folder} holds no profile.txt, which has the labels of the cycles.")
    labels = _table(profile).astype(int)

    sensors: dict[str, Float[np.ndarray, "cycle time"]] = {}
    rates: dict[str, str] = {}
    for path in paths:
        match = _SENSOR.fullmatch(stem_of(path))
        if match is None or match[1] not in _UNITS:
            continue
        # Files are sorted by path, so original samples come before their means over 1 s.
        if match[2] and match[1] in sensors:
            continue

        samples = _table(path)
        if len(samples) != len(labels):
            raise DataError(
                f"{path} has {len(samples)} cycles, {profile} {len(labels)}. One file is truncated."
            )
        sensors[match[1]] = _at_ten_hertz(samples, path)
        rates[f"{match[1]}_rate"] = f"{samples.shape[1] // 60} Hz"

    channels = tuple(name for name in _UNITS if name in sensors)
    if not channels:
        raise DataError(f"{folder} holds no file of a sensor, such as FS1.txt.")

    signals = np.stack([sensors[name] for name in channels], axis=1)
    shared_attributes = {"units": " ".join(_UNITS[name] for name in channels)} | rates

    return [
        Recording(
            signal=signals[cycle],
            sample_rate=RATE,
            recording_id=f"cycle_{cycle:04d}",
            channels=channels,
            unit="1",
            label=_LEAKAGE[int(labels[cycle, 2])],
            specimen="rig",
            attributes=shared_attributes | groups | {"cycle": str(cycle)},
        )
        for cycle, groups in enumerate(_groups(labels))
    ]


def _table(path: Path) -> Float[np.ndarray, "cycle value"]:
    """Return a table of numbers without heading, of which a row is a cycle and not a time.

    A reader of recordings asks what the rows are, and sends each of up to 6,000 columns alone.
    """
    try:
        return np.loadtxt(path, delimiter="\t", ndmin=2)
    except ValueError as cause:
        raise DataError(f"{path} is not a table of numbers separated by tabs: {cause}.") from cause


def _at_ten_hertz(
    samples: Float[np.ndarray, "cycle value"], path: Path
) -> Float[np.ndarray, "cycle time"]:
    """Return samples at `RATE`: held for ten samples, or averaged."""
    count = samples.shape[1]
    if count == _SAMPLES // 10:
        return np.repeat(samples, 10, axis=1)
    if count % _SAMPLES == 0:
        return samples.reshape(len(samples), _SAMPLES, -1).mean(axis=2)

    raise DataError(f"{path} has {count} values in a cycle; must be 60, 600 or 6000.")


def _groups(labels: np.ndarray) -> list[dict[str, str]]:
    """Return the settings of each cycle and the numbers of its runs."""
    settings = labels[:, :4]
    columns = {
        "pump_run": settings[:, 2:3],
        "condition_run": settings,
        "cooler_block": settings[:, :1],
    }
    runs = {name: _number_runs(values) for name, values in columns.items()}

    groups = []
    for cycle, row in enumerate(labels):
        attributes = {name: str(numbers[cycle]) for name, numbers in runs.items()}
        for name, value in zip(_PROFILE, row, strict=True):
            attributes[name] = str(value)
        groups.append(attributes)

    return groups


def _number_runs(values: np.ndarray) -> list[int]:
    """Return the number of the run of equal rows that each row belongs to, from 0."""
    is_change = (values[1:] != values[:-1]).any(axis=1)
    return [0, *np.cumsum(is_change).tolist()]
