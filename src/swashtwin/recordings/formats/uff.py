"""Universal files, data set 58 (functions at nodal degrees of freedom)."""

from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, require_memory
from swashtwin.recordings.formats.clock import read_time_column
from swashtwin.recordings.formats.raw import Options, RawFile, known_unit, load_extra, snapped_rate

_TIME_RESPONSE = 1
_PARSED = 3
"""Bytes in memory for each byte of the file while it is parsed."""
_STEP_DIGITS = 5e-6
"""Largest relative error of a step written with six digits."""
_DIRECTIONS = {0: "", 1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}


def read(path: Path, options: Options) -> RawFile:
    """Time responses of a universal file; their step has six digits, so the rate is snapped to a sensible one."""
    require_memory(path, _PARSED * path.stat().st_size)
    if not path.read_bytes().rstrip().endswith(b"-1"):
        raise DataError(f"{path} is cut off: its last data set has no end.")
    content = load_extra("pyuff").UFF(str(path)).read_sets()
    sets = content if isinstance(content, list) else [content]
    responses = [each for each in sets if each.get("type") == 58 and each.get("func_type") == _TIME_RESPONSE]
    if not responses:
        raise DataError(f"{path} holds no time response (data set 58, function type 1).")
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    rates: dict[str, float] = {}
    gaps: dict[str, str] = {}
    for number, response in enumerate(responses):
        name = _name(response, number, columns)
        columns[name] = np.asarray(response["data"], dtype=np.float64)
        count, stated = len(columns[name]), int(response["num_pts"])
        if count < stated or np.any(columns[name][stated:]):
            raise DataError(f"{path} is cut off: {name} has {count} of {stated} samples.")
        columns[name] = columns[name][:stated]  # the last line is filled with zeros
        unit = known_unit(response.get("ordinate_axis_units_lab", ""))
        if unit:
            units[name] = unit
        if not response["abscissa_spacing"]:
            rate, gap = read_time_column(path, np.asarray(response["x"], dtype=np.float64)[:stated])
            rates |= {name: rate} if rate else {}
            gaps |= {"time_gaps": gap} if gap else {}
            continue
        step = float(response["abscissa_inc"])
        if not step > 0:
            raise DataError(f"{path}: {name} has time steps of {step:g} s; a recording has a positive step.")
        mantissa = float(f"{step:e}".split("e")[0])
        rates[name] = snapped_rate(step, _STEP_DIGITS / mantissa)
    return RawFile(columns, None, units, gaps, rates=rates)


def _name(response: dict[str, Any], number: int, columns: dict[str, np.ndarray]) -> str:
    title = str(response.get("id1", "")).strip()
    point = f"{response.get('rsp_node', number)}{_DIRECTIONS.get(response.get('rsp_dir', 0), '')}"
    for name in (title, point):
        if name and name.upper() != "NONE" and name not in columns:
            return name
    return f"channel_{number}"
