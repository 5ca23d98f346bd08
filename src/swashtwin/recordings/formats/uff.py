"""Universal files, data set 58 (functions at nodal degrees of freedom)."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError
from swashtwin.recordings.formats.raw import Options, RawFile, known_unit, load_extra, snapped_rate

_TIME_RESPONSE = 1
_DELIMITER = re.compile(rb"^    -1\s*$", re.MULTILINE)
_STEP_DIGITS = 5e-6
"""Largest relative error of a step written with six digits."""
_DIRECTIONS = {0: "", 1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}


def read(path: Path, options: Options) -> RawFile:
    """Time responses of a universal file; their step has six digits, so the rate is snapped to a sensible one."""
    if len(_DELIMITER.findall(path.read_bytes())) % 2:
        raise DataError(f"{path} is cut off: its last data set has no end.")
    content = load_extra("pyuff").UFF(str(path)).read_sets()
    sets = content if isinstance(content, list) else [content]
    responses = [one for one in sets if one.get("type") == 58 and one.get("func_type") == _TIME_RESPONSE]
    if not responses:
        raise DataError(f"{path} holds no time response (data set 58, function type 1).")
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    steps = set()
    for number, one in enumerate(responses):
        name = _name(one, number, columns)
        columns[name] = np.asarray(one["data"], dtype=np.float64)
        if len(columns[name]) != int(one["num_pts"]):
            raise DataError(f"{path} is cut off: {name} has {len(columns[name])} of {one['num_pts']} readings.")
        if not one["abscissa_spacing"]:
            raise DataError(f"{path}: {name} is unevenly sampled; one recording has one rate.")
        unit = known_unit(one.get("ordinate_axis_units_lab", ""))
        if unit:
            units[name] = unit
        steps.add(float(one["abscissa_inc"]))
    if len(steps) > 1 or not min(steps) > 0:
        raise DataError(f"{path} holds time steps of {sorted(steps)} s; one recording has one positive step.")
    step = steps.pop()
    mantissa = float(f"{step:e}".split("e")[0])
    return RawFile(columns, snapped_rate(step, _STEP_DIGITS / mantissa), units)


def _name(one: dict[str, Any], number: int, taken: dict[str, np.ndarray]) -> str:
    title = str(one.get("id1", "")).strip()
    point = f"{one.get('rsp_node', number)}{_DIRECTIONS.get(one.get('rsp_dir', 0), '')}"
    for name in (title, point):
        if name and name.upper() != "NONE" and name not in taken:
            return name
    return f"channel_{number}"
