"""Numbers of a twin as C source, for the files in ``sources``.

What no input of the FMU changes is computed here: matrices, vectors along which forces act,
conductances of the films, and the lines of a displacement per unit of severity.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType

import numpy as np
import torch
from jaxtyping import Complex, Float

from swashtwin.foundation import InputError
from swashtwin.physics.chambers import (
    AIR_FLOOR,
    ATMOSPHERE,
    FLOOR,
    ITERATIONS,
    SMOOTHING,
    TOLERANCE,
)
from swashtwin.physics.dynamics import N_DOF, SHELL, Dof, block_valve_shape
from swashtwin.physics.excitation import (
    CONTACT_CUTOFF,
    bore_lines,
    canonical_recess,
    displacement_lines,
    stages,
)
from swashtwin.physics.fault_forcing import turning_terms
from swashtwin.physics.films import (
    piston_leakage,
    slipper_leakage,
    valve_plate_lands,
)
from swashtwin.physics.loads import CRACKING_SHARE, DEFAULT_STEPS, pressure_shares
from swashtwin.physics.lost_contact import slipper_shares, stop_damping_ratio
from swashtwin.physics.twin.model import Twin
from swashtwin.physics.twin.response import SUPPORTS
from swashtwin.pump import (
    MAX_PRESSURE,
    MAX_SPEED,
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    LooseSlipper,
    PistonWear,
    Pump,
    SealingLandScratch,
    SwashPlateDefect,
    TiltedBlockFace,
    ValvePlateWear,
)
from swashtwin.pump import InterfaceValue as Value

FAULTS: Mapping[type[Fault], str] = MappingProxyType(
    {
        SwashPlateDefect: "RECESS",
        PistonWear: "PISTON_WEAR",
        BoreDefect: "BORE_DEFECT",
        SealingLandScratch: "SEALING_LAND_SCRATCH",
        TiltedBlockFace: "TILTED_BLOCK_FACE",
        ValvePlateWear: "VALVE_PLATE_WEAR",
        DamScratch: "DAM_SCRATCH",
        GrooveErosion: "GROOVE_EROSION",
        LooseSlipper: "LOOSE_SLIPPER",
    }
)
"""Faults that the C source computes, by their names in it."""

SPEED_SHARE = 0.25
"""Lowest speed of an FMU over that at its start: below it a steady state has four times the lines,
and memory is reserved for as many.
"""
LINE_HARMONICS = 5
"""Harmonics of the piston-pass frequency up to which an FMU has outputs of lines: up to there the
chamber pressures are accurate within 0.5 % (`loads.DEFAULT_STEPS`).
"""

# Severity at which lines per unit of severity are computed: a power of two, so that the division
# does not round.
_UNIT_SEVERITY = 2.0**-10


@dataclass(frozen=True)
class Ranges:
    """Values that the inputs of an FMU may have [SI]."""

    min_speed: float
    max_speed: float
    max_severity: float
    """Infinite if the fault has no limit."""

    @classmethod
    def of(cls, twin: Twin) -> "Ranges":
        """Return the ranges of a twin."""
        pistons = twin.pump.rotating_group.piston_count
        max_severity = math.inf
        if isinstance(twin.fault, TiltedBlockFace):
            max_severity = math.nextafter(1.0, 0.0)
        elif twin.fault is not None:
            severity = fields(twin.fault)[0]
            max_severity = severity.metadata.get("maximum", math.inf)
        return cls(
            min_speed=SPEED_SHARE * twin.condition.speed,
            max_speed=min(MAX_SPEED, 2 * math.pi * twin.bandwidth / pistons),
            max_severity=max_severity,
        )


def require_exportable(twin: Twin) -> None:
    """Refuse a twin with a fault that the C source does not compute.

    Raises
    ------
    InputError
        The fault is not one of swashtwin.
    """
    if twin.fault is not None and type(twin.fault) not in FAULTS:
        names = ", ".join(kind.__name__ for kind in FAULTS)
        raise InputError(
            f"An FMU cannot simulate {type(twin.fault).__name__}, a fault of your own: its C "
            f"source holds {names}. Specify one of these, or none."
        )


def line_orders(pump: Pump) -> int:
    """Return the highest shaft order whose lines are outputs."""
    return LINE_HARMONICS * pump.rotating_group.piston_count


def write_numbers(twin: Twin, prefix: str, guid: str) -> tuple[str, str]:
    """Return the texts of ``pump_numbers.h`` and ``pump_numbers.c``.

    Parameters
    ----------
    prefix : of the names of FMI functions.
    guid : of the model description.
    """
    scalars = {**_scalars(twin), **_fault_scalars(twin)}
    arrays = {**_arrays(twin), "UNIT_MOTION": _unit_motion(twin)}
    title = (
        f"/* Numbers of {_comment(repr(twin))}, in SI units; written by swashtwin.\n"
        "   SPDX-License-Identifier: BSD-3-Clause */\n"
    )
    fault = "NO_FAULT" if twin.fault is None else FAULTS[type(twin.fault)]
    severity = "" if twin.fault is None else fields(twin.fault)[0].name
    header = [
        title,
        "#ifndef PUMP_NUMBERS_H",
        "#define PUMP_NUMBERS_H",
        "",
        f"#define FMI2_FUNCTION_PREFIX {prefix}_",
        f'#define MODEL_GUID "{guid}"',
        f"#define FAULT {fault}",
        f'#define FAULT_SEVERITY_NAME "{severity}"',
        f'#define OR_LOWER_SEVERITY "{severity and f" or {severity}"}"',
    ]
    header += [f"#define {name} {_number(value)}" for name, value in scalars.items()]
    header.append("")
    source = [title, '#include "pump_twin.h"', ""]
    for name, array in arrays.items():
        declaration = f"const double {name}{''.join(f'[{size}]' for size in array.shape)}"
        header.append(f"extern {declaration};")
        source.append(f"{declaration} = {_braces(array)};\n")
    header += ["", "#endif", ""]
    return "\n".join(header), "\n".join(source)


def _comment(text: str) -> str:
    return text.replace("*/", "* /").encode("ascii", "replace").decode()


def _number(value: float | int) -> str:
    if isinstance(value, bool | int):
        return str(int(value))
    if math.isinf(value):
        value = sys.float_info.max
    text = repr(float(value))
    return f"({text})" if text.startswith("-") else text


def _braces(array: np.ndarray) -> str:
    if array.ndim == 1:
        return "{" + ", ".join(repr(float(value)) for value in array) + "}"
    return "{\n" + ",\n".join(_braces(row) for row in array) + "}"


def _scalars(twin: Twin) -> dict[str, float | int]:
    """Return the numbers of the pump and of the operating point."""
    pump = twin.port_timing.apply(twin.pump)
    group = pump.rotating_group
    plate = pump.valve_plate
    oil = pump.oil
    condition = twin.condition
    ranges = Ranges.of(twin)
    viscosity = oil.viscosity_at(condition.oil_temperature)
    hole_area = math.pi / 4 * group.orifice_diameter**2
    values = twin.values.tolist()
    return {
        "START_SPEED": condition.speed,
        "START_DISCHARGE_PRESSURE": condition.discharge_pressure,
        "START_SEVERITY": 0.0 if twin.fault is None else twin.fault.severity,
        "MIN_SPEED": ranges.min_speed,
        "MAX_SPEED": ranges.max_speed,
        "MAX_PRESSURE": MAX_PRESSURE,
        "MAX_SEVERITY": ranges.max_severity,
        "BANDWIDTH": twin.bandwidth,
        "MAX_ORDERS": _max_orders(twin),
        "LINE_ORDERS": line_orders(pump),
        "SENSORS": len(pump.sensors),
        "PATH_MODES": 0 if twin.path is None else len(twin.path.frequency),
        "EXCITATION_FACTOR": twin.scales.excitation,
        # chambers
        "MIN_STEPS": DEFAULT_STEPS,
        "PISTONS": group.piston_count,
        "PISTON_AREA": group.piston_area,
        "PITCH_RADIUS": group.pitch_radius,
        "SWASH_ANGLE": group.swash_angle,
        "DEAD_VOLUME": group.dead_volume,
        "DISPLACEMENT": group.displacement,
        "PISTON_CLEARANCE": group.piston_clearance,
        "PISTON_GUIDE_LENGTH": group.piston_guide_length,
        "PISTON_SLIPPER_MASS": pump.masses.piston_slipper,
        "SPRING_PRELOAD": pump.coupling.spring_preload,
        "SLIPPER_FILM": group.slipper_film,
        "SLIPPER_LEAKAGE": slipper_leakage(pump, group.slipper_film, viscosity),
        "SLIPPER_LOG_RATIO": math.log(group.slipper_diameter / group.pocket_diameter),
        "SLIPPER_HOLE_AREA": oil.discharge_coefficient * hole_area,
        "VALVE_PLATE_FILM": plate.film,
        "VALVE_PLATE_LANDS": valve_plate_lands(pump),
        "PISTON_LEAKAGE": piston_leakage(pump, viscosity),
        "ORIFICE": oil.discharge_coefficient * math.sqrt(2 / oil.density),
        "PORT_AREA": plate.port_area_ratio * group.piston_area,
        "PORT_RAMP": plate.port_ramp,
        "SUCTION_OPEN": plate.suction_open,
        "SUCTION_CLOSE": plate.suction_close,
        "DISCHARGE_OPEN": plate.discharge_open,
        "DISCHARGE_CLOSE": plate.discharge_close,
        "GROOVE_ANGLE": plate.groove_angle,
        "GROOVE_SLOPE": plate.groove_slope,
        "GROOVE_FLANK": plate.groove_flank,
        "SUCTION_PRESSURE": condition.suction_pressure,
        "CASE_PRESSURE": condition.case_pressure,
        "VISCOSITY": viscosity,
        "OIL_DENSITY": oil.density,
        "BULK_MODULUS": oil.bulk_modulus,
        "OIL_SOFTNESS": 1 / oil.bulk_modulus,
        "FREE_AIR": oil.air_fraction * ATMOSPHERE,
        "LINE_VOLUME": pump.line.volume,
        "RELIEF_OVERRIDE": pump.line.relief_override,
        "CRACKING_SHARE": CRACKING_SHARE,
        "SMOOTHING": SMOOTHING,
        "PRESSURE_FLOOR": FLOOR,
        "AIR_FLOOR": AIR_FLOOR,
        "NEWTON_ITERATIONS": ITERATIONS,
        "NEWTON_TOLERANCE": TOLERANCE,
        # motion
        "ROTOR_UNBALANCE": pump.masses.rotor * pump.masses.rotor_eccentricity,
        "C_SLIPPER_SWASH": values[Value.SLIPPER_SWASH_DAMPING],
        "K_SLIPPER_SWASH": values[Value.SLIPPER_SWASH_STIFFNESS],
        "C_BLOCK_VALVE": values[Value.BLOCK_VALVE_DAMPING],
        "K_BLOCK_VALVE": values[Value.BLOCK_VALVE_STIFFNESS],
        "C_PISTON_BORE": values[Value.PISTON_BORE_DAMPING],
        "K_PISTON_BORE": values[Value.PISTON_BORE_STIFFNESS],
    }


def _max_orders(twin: Twin) -> int:
    """Return how many shaft orders lie within the bandwidth at the lowest speed, rounded up."""
    return int(twin.bandwidth / (Ranges.of(twin).min_speed / (2 * math.pi))) + 1


def _fault_scalars(twin: Twin) -> dict[str, float | int]:
    """Return the fixed dimensions of the fault; zero if it does not have them."""
    fault = twin.fault
    numbers: dict[str, float | int] = {
        "FAULT_PISTON": 0,
        "FAULT_WIDTH": 0.0,
        "FAULT_AREA_FACTOR": 0.0,
        "FAULT_STIFFNESS_EXPONENT": 0.0,
        "FAULT_PULSE": 0.0,
        "FAULT_DAMPING_RATIO": 0.0,
        "FAULT_DEPTH_SHARE": 0.0,
        "FAULT_RISE_ANGLE": 0.0,
        "FAULT_TOTAL_ANGLE": 0.0,
        "FAULT_ANGLE": 0.0,
        "FAULT_CORNER": 0.0,
        "FAULT_FALL": 0.0,
        "FAULT_GAIN": 0.0,
        "FAULT_LEAKAGE": 0.0,
        "FAULT_IS_HALF_SINE": 0,
        "RECESS_STRAINS_FILMS": 0,
        "RECESS_LIFTS_OFF": 0,
        "CONTACT_CUTOFF": CONTACT_CUTOFF,
    }

    if isinstance(fault, SwashPlateDefect):
        # the depth is an input: what is in proportion to it is written per unit
        stage = stages(twin.pump, replace(fault, depth=_UNIT_SEVERITY))
        numbers |= {
            "FAULT_DEPTH_SHARE": stage.depth / _UNIT_SEVERITY,
            "FAULT_RISE_ANGLE": stage.rise,
            "FAULT_TOTAL_ANGLE": stage.total,
            "FAULT_ANGLE": fault.angle,
            "FAULT_CORNER": fault.corner,
            "FAULT_FALL": fault.fall,
            "FAULT_GAIN": fault.gain,
            "FAULT_LEAKAGE": fault.leakage,
            "FAULT_IS_HALF_SINE": int(fault.edge == "half_sine"),
            "RECESS_STRAINS_FILMS": int(fault.strains_films),
            "RECESS_LIFTS_OFF": int(fault.contact == "lift_off"),
        }
    elif isinstance(fault, PistonWear):
        numbers["FAULT_PISTON"] = fault.piston
    elif isinstance(fault, SealingLandScratch):
        numbers["FAULT_PISTON"] = fault.bore
    elif isinstance(fault, ValvePlateWear):
        numbers["FAULT_STIFFNESS_EXPONENT"] = fault.stiffness_exponent
    elif isinstance(fault, DamScratch):
        numbers["FAULT_WIDTH"] = fault.width
    elif isinstance(fault, GrooveErosion):
        numbers["FAULT_AREA_FACTOR"] = fault.area_factor
    elif isinstance(fault, LooseSlipper):
        numbers |= {
            "FAULT_PISTON": fault.slipper,
            "FAULT_PULSE": fault.pulse,
            "FAULT_DAMPING_RATIO": stop_damping_ratio(fault.restitution),
        }

    return numbers


def _arrays(twin: Twin) -> dict[str, np.ndarray]:
    """Return matrices and vectors of the 13 degrees of freedom, and the sensors."""
    pump = twin.port_timing.apply(twin.pump)
    structure = twin.drive.structure
    action = twin.drive.action

    # The block-valve interface is left out, because wear of the valve plate changes it.
    rest = twin.values.clone()
    rest[[Value.BLOCK_VALVE_DAMPING, Value.BLOCK_VALVE_STIFFNESS]] = 0.0
    scales = torch.tensor(twin.scales.values(), dtype=torch.float64)
    supports = (scales[0], scales[1], scales[SUPPORTS])

    path = twin.path
    n_sensors = len(pump.sensors)
    gain = np.ones(n_sensors) if path is None else np.array(path.gain)
    modes = np.zeros(0) if path is None else np.array(path.frequency)
    damping_ratio = np.zeros(0) if path is None else np.array(path.damping_ratio)
    residue = np.zeros((n_sensors, 0))
    if path is not None and path.residue:
        residue = np.array(path.residue)

    return {
        "MASS": structure.mass.diagonal().numpy(),
        "STIFFNESS": structure.stiffness(rest, *supports).numpy(),
        "DAMPING": structure.damping(rest, *supports).numpy(),
        "BLOCK_VALVE_SHAPE": block_valve_shape(pump),
        "TURNING_STIFFNESS": _turning_stiffness(twin),
        "PRESSURE_SHARES": _with_topology(pressure_shares(pump), twin.topology),
        "SLIPPER_SHARES": _with_topology(slipper_shares(pump), twin.topology),
        "SLIPPER_VECTOR": structure.slipper_vector.numpy(),
        "FILM_VECTOR": action.film[0].numpy(),
        "BORE_VECTOR": action.bore[0].numpy(),
        "SENSOR_ROWS": structure.sensor_rows[:, SHELL].numpy(),
        "SENSOR_GAIN": twin.scales.sensor * gain,
        "PATH_FREQUENCY": _not_empty(modes),
        "PATH_DAMPING_RATIO": _not_empty(damping_ratio),
        "PATH_RESIDUE": _not_empty(residue),
    }


def _not_empty(array: np.ndarray) -> np.ndarray:
    """Return the array with a column of zeros if it has none: C has no empty arrays."""
    return array if array.shape[-1] else np.zeros((*array.shape[:-1], 1))


def _turning_stiffness(twin: Twin) -> Float[np.ndarray, "13 13 2"]:
    """Return real and imaginary parts of the stiffness that turns with the shaft per severity."""
    if not isinstance(twin.fault, TiltedBlockFace):
        return np.zeros((N_DOF, N_DOF, 2))
    unit_fault = replace(twin.fault, variation=_UNIT_SEVERITY)
    (term,) = turning_terms(unit_fault, twin.pump, twin.values)
    amplitude = term.stiffness.numpy() / _UNIT_SEVERITY
    return np.stack([amplitude.real, amplitude.imag], axis=-1)


def _with_topology(shares: Float[np.ndarray, "13 3"], topology: str) -> Float[np.ndarray, "13 3"]:
    """Return the shares of topology T1 in a force and its moments as those of a topology."""
    if topology == "T2":
        shares[Dof.ROTOR_Z] += shares[Dof.RETAINER_Z]
        shares[Dof.RETAINER_Z] = 0.0
    return shares


def _unit_motion(twin: Twin) -> Float[np.ndarray, "order 2"]:
    """Return real and imaginary parts of the lines of a displacement per severity, from order 0."""
    fault = twin.fault
    n_lines = _max_orders(twin)
    lines: Complex[np.ndarray, " line"]
    if isinstance(fault, SwashPlateDefect) and fault.contact != "lift_off":
        unit_fault = replace(canonical_recess(fault), depth=_UNIT_SEVERITY)
        lines = displacement_lines(twin.pump, twin.condition, unit_fault, n_lines)
    elif isinstance(fault, BoreDefect):
        lines = bore_lines(twin.pump, replace(fault, depth=_UNIT_SEVERITY), n_lines)
    else:
        return np.zeros((1, 2))
    unit_lines = np.concatenate([[0.0], lines / _UNIT_SEVERITY])
    return np.stack([unit_lines.real, unit_lines.imag], axis=-1)
