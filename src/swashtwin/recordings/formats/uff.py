"""Universal files, data set 58 (functions at nodal degrees of freedom)."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, require_memory
from swashtwin.recordings.formats.raw import Options, RawFile, known_unit, load_extra, snapped_rate

_TIME_RESPONSE = 1
_DELIMITER = re.compile(rb"^    -1\s*$", re.MULTILINE)
_PARSED = 3
"""Bytes in memory for each byte of the file while it is parsed."""
_STEP_DIGITS = 5e-6
"""Largest relative error of a step written with six digits."""
_DIRECTIONS = {0: "", 1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}


def read(path: Path, options: Options) -> RawFile:
    """Time responses of a universal file; their step has six digits, so the rate is snapped to a sensible one."""
    require_memory(path, _PARSED * path.stat().st_size)
    if len(_DELIMITER.findall(path.read_bytes())) % 2:
        raise DataError(f"{path} is cut off: its last data set has no end.")
    content = load_extra("pyuff").UFF(str(path)).read_sets()
    sets = content if isinstance(content, list) else [content]
    responses = [each for each in sets if each.get("type") == 58 and each.get("func_type") == _TIME_RESPONSE]
    if not responses:
        raise DataError(f"{path} holds no time response (data set 58, function type 1).")
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    rates: dict[str, float] = {}
    for number, response in enumerate(responses):
        name = _name(response, number, columns)
        columns[name] = np.asarray(response["data"], dtype=np.float64)
        if len(columns[name]) != int(response["num_pts"]):
            raise DataError(f"{path} is cut off: {name} has {len(columns[name])} of {response['num_pts']} samples.")
        if not response["abscissa_spacing"]:
            raise DataError(f"{path}: {name} is unevenly sampled; one recording has one rate.")
        unit = known_unit(response.get("ordinate_axis_units_lab", ""))
        if unit:
            units[name] = unit
        step = float(response["abscissa_inc"])
        if not step > 0:
            raise DataError(f"{path}: {name} has time steps of {step:g} s; a recording has a positive step.")
        mantissa = float(f"{step:e}".split("e")[0])
        rates[name] = snapped_rate(step, _STEP_DIGITS / mantissa)
    return RawFile(columns, None, units, rates=rates)


def _name(response: dict[str, Any], number: int, columns: dict[str, np.ndarray]) -> str:
    title = str(response.get("id1", "")).strip()
    point = f"{response.get('rsp_node', number)}{_DIRECTIONS.get(response.get('rsp_dir', 0), '')}"
    for name in (title, point):
        if name and name.upper() != "NONE" and name not in columns:
            return name
    return f"channel_{number}"
