"""Universal files, data set 58 (functions at nodal degrees of freedom)."""

from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, load_extra
from swashtwin.recordings.formats.clock import TIME_UNITS
from swashtwin.recordings.formats.column_names import is_foreign_unit
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions, snap_rate
from swashtwin.recordings.formats.sample_units import normalize_unit, recognize_unit
from swashtwin.recordings.formats.time_column import read_time_column

pyuff: Any = load_extra("pyuff", "readers", "a universal file")

_FUNCTION_SET = 58
_TIME_RESPONSE = 1

# Data type of an abscissa that is the time.
_TIME_ABSCISSA = 17

# Largest absolute error of the mantissa of a step that is written with six digits.
_STEP_ROUNDING = 5e-6

_DIRECTIONS = {0: "", 1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return the time responses of a universal file.

    The steps of their time have six digits, so their rates are snapped to common ones.
    """
    if not path.read_bytes().rstrip().endswith(b"-1"):
        raise DataError(f"{path} is cut off: its last data set has no end.")

    content = pyuff.UFF(str(path)).read_sets()
    data_sets = content if isinstance(content, list) else [content]
    responses = [
        data_set
        for data_set in data_sets
        if data_set.get("type") == _FUNCTION_SET and data_set.get("func_type") == _TIME_RESPONSE
    ]
    if not responses:
        raise DataError(f"{path} holds no time response (data set 58, function type 1).")

    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    foreign_units: dict[str, str] = {}
    rates: dict[str, float] = {}
    starts: dict[str, str] = {}
    attributes: dict[str, str] = {}
    for number, response in enumerate(responses):
        name = _name(response, number, columns)
        columns[name] = _read_samples(path, name, response)
        unit = recognize_unit(response.get("ordinate_axis_units_lab", ""))
        if unit:
            units[name] = unit
        elif is_foreign_unit(response.get("ordinate_axis_units_lab", "")):
            foreign_units[name] = response["ordinate_axis_units_lab"].strip()

        rate, first_time, problem = _read_time(path, name, response)
        if rate:
            rates[name] = rate
        if problem:
            attributes["time_gaps"] = problem
        starts[name] = f"{first_time:.6g} s"
    return RawFile(
        columns,
        None,
        units,
        attributes,
        rates=rates,
        starts=starts,
        foreign_units=foreign_units,
    )


def _read_samples(path: Path, name: str, response: dict[str, Any]) -> np.ndarray:
    samples = np.asarray(response["data"])
    count = int(response["num_pts"])
    # The last line is filled with zeros; other numbers there mean that lines are missing before.
    if len(samples) < count or np.any(samples[count:]):
        raise DataError(f"{path} is cut off: {name} has {len(samples)} of {count} samples.")
    if np.iscomplexobj(samples) and np.any(samples.imag):
        raise DataError(
            f"{path}: {name} holds complex numbers, which are not a recording; "
            "export the time signal."
        )
    return samples.real[:count].astype(np.float64)


def _read_time(path: Path, name: str, response: dict[str, Any]) -> tuple[float | None, float, str]:
    """Return rate [Hz] and first time [s] of a response, and what is wrong with its times."""
    unit = normalize_unit(str(response.get("abscissa_axis_units_lab") or "s"))
    is_time = response.get("abscissa_spec_data_type", 0) in (0, _TIME_ABSCISSA)
    if not is_time or recognize_unit(unit) not in (None, *TIME_UNITS):
        raise DataError(
            f"{path}: {name} runs along {unit}, not time; export it as it was recorded."
        )
    unit_s = TIME_UNITS.get(unit, 1.0)

    if not response["abscissa_spacing"]:
        count = int(response["num_pts"])
        times = np.asarray(response["x"], dtype=np.float64)[:count]
        rate, problem = read_time_column(path, times, unit_s)
        return rate, unit_s * float(times[0]), problem

    step = unit_s * float(response["abscissa_inc"])
    if not step > 0:
        raise DataError(
            f"{path}: {name} has time steps of {step:g} s; a recording has a positive step."
        )
    mantissa = float(f"{step:e}".split("e")[0])
    first_time = unit_s * float(response["abscissa_min"])
    return snap_rate(step, _STEP_ROUNDING / mantissa), first_time, ""


def _name(response: dict[str, Any], number: int, columns: dict[str, np.ndarray]) -> str:
    """Return the title of a response, or its node and direction, or its number."""
    title = str(response.get("id1", "")).strip()
    direction = _DIRECTIONS.get(response.get("rsp_dir", 0), "")
    node = f"{response.get('rsp_node', number)}{direction}"
    for name in (title, node):
        if name and name.upper() != "NONE" and name not in columns:
            return name
    return f"channel_{number}"
