"""Universal files, data set 58 (functions at nodal degrees of freedom)."""

from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, load_extra
from swashtwin.recordings.formats.clock import TIME_UNITS
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions, snap_rate
from swashtwin.recordings.formats.sample_units import normalize_unit, recognize_unit
from swashtwin.recordings.formats.time_column import read_time_column

pyuff: Any = load_extra("pyuff", "readers", "a universal file")

_TIME_RESPONSE = 1
_TIME = 17
"""What a data set calls an abscissa that is the time."""
_STEP_DIGITS = 5e-6
"""Largest relative error of a step written with six digits."""
_DIRECTIONS = {0: "", 1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}


def read(path: Path, options: ReadOptions) -> RawFile:
    """Time responses of a universal file; their step has six digits, so the rate is snapped to a
    sensible one.
    """
    if not path.read_bytes().rstrip().endswith(b"-1"):
        raise DataError(f"{path} is cut off: its last data set has no end.")
    content = pyuff.UFF(str(path)).read_sets()
    sets = content if isinstance(content, list) else [content]
    responses = [
        each for each in sets if each.get("type") == 58 and each.get("func_type") == _TIME_RESPONSE
    ]
    if not responses:
        raise DataError(f"{path} holds no time response (data set 58, function type 1).")
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    rates: dict[str, float] = {}
    starts: dict[str, str] = {}
    gaps: dict[str, str] = {}
    for number, response in enumerate(responses):
        name = _name(response, number, columns)
        samples, count = np.asarray(response["data"]), int(response["num_pts"])
        if len(samples) < count or np.any(samples[count:]):
            raise DataError(f"{path} is cut off: {name} has {len(samples)} of {count} samples.")
        if np.iscomplexobj(samples) and np.any(samples.imag):
            raise DataError(
                f"{path}: {name} holds complex numbers, which are no recording; export the time signal."
            )
        columns[name] = samples.real[:count].astype(
            np.float64
        )  # the last line is filled with zeros
        along = normalize_unit(str(response.get("abscissa_axis_units_lab") or "s"))
        if response.get("abscissa_spec_data_type", 0) not in (0, _TIME) or recognize_unit(
            along
        ) not in (None, *TIME_UNITS):
            raise DataError(
                f"{path}: {name} runs along {along}, not time; export it as it was recorded."
            )
        second = TIME_UNITS.get(along, 1.0)
        if unit := recognize_unit(response.get("ordinate_axis_units_lab", "")):
            units[name] = unit
        if response["abscissa_spacing"]:
            step, first = second * float(response["abscissa_inc"]), float(response["abscissa_min"])
            if not step > 0:
                raise DataError(
                    f"{path}: {name} has time steps of {step:g} s; a recording has a positive step."
                )
            rates[name] = snap_rate(step, _STEP_DIGITS / float(f"{step:e}".split("e")[0]))
        else:
            times = np.asarray(response["x"], dtype=np.float64)[:count]
            (rate, gap), first = read_time_column(path, times, second), float(times[0])
            rates |= {name: rate} if rate else {}
            gaps |= {"time_gaps": gap} if gap else {}
        starts[name] = f"{second * first:.6g} s"
    return RawFile(columns, None, units, gaps, rates=rates, starts=starts)


def _name(response: dict[str, Any], number: int, columns: dict[str, np.ndarray]) -> str:
    title = str(response.get("id1", "")).strip()
    point = f"{response.get('rsp_node', number)}{_DIRECTIONS.get(response.get('rsp_dir', 0), '')}"
    for name in (title, point):
        if name and name.upper() != "NONE" and name not in columns:
            return name
    return f"channel_{number}"
