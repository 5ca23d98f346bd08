"""A recording, and files of every format that hold it."""

from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import MPa, celsius, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, load_recording, write_recording

WRITABLE = ("h5", "mat", "wav", "csv", "tdms", "parquet", "npz", "mf4")
READABLE = (*WRITABLE, "uff")


def some_recording() -> Recording:
    """Two channels of noise of which everything is known."""
    return Recording(
        signal=np.random.default_rng(0).standard_normal((2, 600)),
        sample_rate=25600.0,
        recording_id="normal_15MPa_1",
        channels=("axial x", "radial"),
        label="normal",
        condition=OperatingCondition(
            speed=rpm(860.0),
            discharge_pressure=MPa(15.0),
            oil_temperature=celsius(45.0),
        ),
        specimen="A",
        attributes={"sensor": "352C33"},
    )


def noise(
    name: str, channels: tuple[str, ...] = ("x", "y"), count: int = 400, **facts: Any
) -> Recording:
    """Noise of its own for each name, at 1 kHz."""
    signal = np.random.default_rng(sum(name.encode())).standard_normal((len(channels), count))
    return Recording(
        **{
            "signal": signal,
            "sample_rate": 1000.0,
            "recording_id": name,
            "channels": channels,
            **facts,
        }
    )


def write_uff(path: Path, signal: np.ndarray, step: float, unit: str = "m/s^2") -> None:
    """Write a universal file of a time response for each row, with a sample each `step` seconds."""
    import pyuff

    sets = [
        pyuff.prepare_58(
            id1=f"point {number}",
            func_type=1,
            rsp_node=number,
            rsp_dir=1,
            ref_node=0,
            ref_dir=0,
            ord_data_type=4,
            num_pts=len(row),
            abscissa_spacing=1,
            abscissa_min=0.0,
            abscissa_inc=step,
            abscissa_spec_data_type=17,
            ordinate_spec_data_type=12,
            orddenom_spec_data_type=0,
            ordinate_axis_units_lab=unit,
            data=row,
            x=np.arange(len(row)) * step,
        )
        for number, row in enumerate(signal)
    ]
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")


def written(recording: Recording, folder: Path, suffix: str) -> Path:
    """Return a file of the recording, also in a format that swashtwin only reads."""
    path = folder / f"file.{suffix}"
    if suffix == "uff":
        write_uff(path, recording.signal, 1 / recording.sample_rate)
        return path
    return write_recording(recording, path)


def read_back(path: Path) -> Recording:
    """Return the recording of a file, with the unit that WAV has no place for."""
    if path.suffix == ".wav":
        return load_recording(path, unit="m/s^2")
    return load_recording(path)
