"""``modelDescription.xml`` of FMI 2.0: variables of an FMU, with units, ranges and start values.

FMI 2.0 and not 3.0, because more tools read it: in 2026 the released versions of OpenModelica and
Hopsan, which users of hydraulic models have, read no FMI 3.0. The price is one scalar for each line
instead of an array.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType
from xml.etree import ElementTree

from swashtwin.foundation import VERSION
from swashtwin.physics.fmu.c_numbers import Ranges, line_orders
from swashtwin.physics.twin.model import Twin
from swashtwin.pump import MAX_PRESSURE

RATE_SHARE = 2.56
"""Sample rate over the bandwidth, the convention of analyzers: that of the default experiment."""

DESCRIPTION = (
    "Vibration of an axial piston pump, quasi-steady: accelerations are those of the steady state "
    "at the inputs that held when the current revolution of the shaft began. Changed inputs take "
    "effect when the next revolution begins, where the waveform may jump; the shaft angle follows "
    "the speed at once. Transients of pressures and housing (about three revolutions) are not "
    "computed."
)
"""How the FMU behaves, for its users."""

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True)
class _Unit:
    """An SI unit of FMI: exponents of the base units, and the unit of the trade."""

    name: str
    exponents: Mapping[str, int]
    trade: tuple[str, float] | None = None
    """Name of the unit of the trade, and what a value in SI is multiplied by."""


_UNITS = MappingProxyType(
    {
        "rad/s": _Unit("rad/s", {"s": -1, "rad": 1}, ("rpm", 30 / math.pi)),
        "Pa": _Unit("Pa", {"kg": 1, "m": -1, "s": -2}, ("MPa", 1e-6)),
        "m": _Unit("m", {"m": 1}, ("um", 1e6)),
        "m^2": _Unit("m2", {"m": 2}, ("mm2", 1e6)),
        "rad": _Unit("rad", {"rad": 1}, ("deg", 180 / math.pi)),
        "m/s^2": _Unit("m/s2", {"m": 1, "s": -2}),
        "m^3/(s*Pa)": _Unit("m3/(s.Pa)", {"kg": -1, "m": 4, "s": 1}),
        "1": _Unit("1", {}),
    }
)
"""Units of the variables by the name that swashtwin gives them."""


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU. Its value reference is its place in the list, from 0."""

    name: str
    description: str
    unit: str
    """Name in swashtwin."""
    is_input: bool = False
    is_constant_in_a_turn: bool = False
    """Whether it changes at most once in a revolution."""
    start: float | None = None
    minimum: float | None = None
    maximum: float | None = None


def fmu_variables(twin: Twin) -> list[Variable | None]:
    """Return the variables in the order of their value references; None is not in use.

    The order is that of ``sources/fmi2_interface.c``.
    """
    condition = twin.condition
    ranges = Ranges.of(twin)
    variables: list[Variable | None] = [
        Variable(
            "speed",
            "Angular speed of the shaft",
            "rad/s",
            is_input=True,
            start=condition.speed,
            minimum=ranges.min_speed,
            maximum=ranges.max_speed,
        ),
        Variable(
            "discharge_pressure",
            "Absolute pressure at the outlet",
            "Pa",
            is_input=True,
            start=condition.discharge_pressure,
            minimum=condition.suction_pressure,
            maximum=MAX_PRESSURE,
        ),
        _severity_variable(twin, ranges),
        Variable("shaft_angle", "Shaft angle from top dead center of piston 0", "rad"),
    ]

    channels = twin.pump.channels
    for channel in channels:
        name = f"acceleration.{_quote(channel)}"
        variables.append(Variable(name, f"Acceleration of sensor {channel}", "m/s^2"))

    for channel in channels:
        for order in range(1, line_orders(twin.pump) + 1):
            variables.append(
                Variable(
                    f"line.{_quote(channel)}[{order}]",
                    f"Amplitude of sensor {channel} at {order} times the shaft frequency",
                    "m/s^2",
                    is_constant_in_a_turn=True,
                )
            )
    return variables


def _severity_variable(twin: Twin, ranges: Ranges) -> Variable | None:
    """Return the input that is the first dimension of the fault; None for a healthy pump."""
    fault = twin.fault
    if fault is None:
        return None
    name = fields(fault)[0].name
    return Variable(
        name,
        f"Severity of {type(fault).__name__}",
        fault.units.get(name, "1"),
        is_input=True,
        start=fault.severity,
        minimum=0.0,
        maximum=ranges.max_severity if math.isfinite(ranges.max_severity) else None,
    )


def _quote(name: str) -> str:
    """Return a name as structured naming of FMI 2.0 requires: other characters in quotes."""
    if _IDENTIFIER.fullmatch(name):
        return name
    escaped = name.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"


def describe_model(
    twin: Twin, identifier: str, guid: str, source_names: Sequence[str]
) -> ElementTree.Element:
    """Return the root of the model description.

    Parameters
    ----------
    identifier : name of the binary, and prefix of the functions in the sources.
    source_names : C files in the folder ``sources``.
    """
    fault = "healthy" if twin.fault is None else f"with {type(twin.fault).__name__}"
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=f"{twin.pump.name}, {fault}",
        guid=guid,
        description=DESCRIPTION,
        generationTool=f"swashtwin {VERSION}",
        variableNamingConvention="structured",
    )
    simulation = ElementTree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=identifier,
        canHandleVariableCommunicationStepSize="true",
        canNotUseMemoryManagementFunctions="true",
    )
    files = ElementTree.SubElement(simulation, "SourceFiles")
    for name in source_names:
        ElementTree.SubElement(files, "File", name=name)

    variables = fmu_variables(twin)
    _add_units(root, variables)
    categories = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(categories, "Category", name="logStatusError")
    ElementTree.SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime="1",
        stepSize=repr(1 / (RATE_SHARE * twin.bandwidth)),
    )
    _add_variables(root, variables)
    ElementTree.indent(root)
    return root


def _add_units(root: ElementTree.Element, variables: Sequence[Variable | None]) -> None:
    used = {variable.unit for variable in variables if variable is not None}
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for name, unit in _UNITS.items():
        if name not in used:
            continue
        element = ElementTree.SubElement(definitions, "Unit", name=unit.name)
        exponents = {base: str(exponent) for base, exponent in unit.exponents.items()}
        ElementTree.SubElement(element, "BaseUnit", exponents)
        if unit.trade is not None:
            trade_name, factor = unit.trade
            ElementTree.SubElement(element, "DisplayUnit", name=trade_name, factor=repr(factor))


def _add_variables(root: ElementTree.Element, variables: Sequence[Variable | None]) -> None:
    listed = ElementTree.SubElement(root, "ModelVariables")
    structure = ElementTree.SubElement(root, "ModelStructure")
    outputs = ElementTree.SubElement(structure, "Outputs")
    unknowns = ElementTree.SubElement(structure, "InitialUnknowns")
    for reference, variable in enumerate(variables):
        if variable is None:
            continue
        scalar = ElementTree.SubElement(
            listed,
            "ScalarVariable",
            name=variable.name,
            valueReference=str(reference),
            description=variable.description,
            causality="input" if variable.is_input else "output",
            variability="discrete" if variable.is_constant_in_a_turn else "continuous",
        )
        unit = _UNITS[variable.unit]
        attributes = {"unit": unit.name}
        if unit.trade is not None:
            attributes["displayUnit"] = unit.trade[0]
        for key, value in (
            ("min", variable.minimum),
            ("max", variable.maximum),
            ("start", variable.start),
        ):
            if value is not None:
                attributes[key] = repr(float(value))
        ElementTree.SubElement(scalar, "Real", attributes)

        if not variable.is_input:
            index = str(len(listed))
            # After the initialization an output follows the inputs by a step only.
            ElementTree.SubElement(outputs, "Unknown", index=index, dependencies="")
            ElementTree.SubElement(unknowns, "Unknown", index=index)
