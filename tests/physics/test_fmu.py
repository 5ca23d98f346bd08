"""A twin as an FMU: its description, its lines against the twin's in Python, and what it refuses.

Tests that compile are nightly, for a compiler takes two seconds.
"""

import math
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from swashtwin.foundation import InputError, MPa, SwashTwinError, celsius, deg, mm, rpm, um
from swashtwin.physics import FMU, PortTiming, Scales, SensorPath, Twin, export_fmu
from swashtwin.physics.fmu import export
from swashtwin.physics.fmu.c_numbers import FAULTS, line_orders
from swashtwin.physics.fmu.model_description import fmu_variables
from swashtwin.pump import (
    FAULT_KINDS,
    Fault,
    OperatingCondition,
    PistonWear,
    Pump,
    SwashPlateDefect,
    load_pump,
    new_pump,
    read_nameplate,
)

ROUNDING = 1e-7
"""Difference of a line over the largest of its sensor that rounding makes: Newton's method may stop
an iteration earlier or later, after which pressures differ by up to 1 Pa.
"""
RECESSES = [
    SwashPlateDefect(depth=mm(0.05)),
    SwashPlateDefect(depth=mm(0.05), contact="literal", edge="raised_cosine", corner=900.0),
    SwashPlateDefect(depth=mm(0.6), contact="physical", width=mm(11)),
    SwashPlateDefect(depth=mm(0.6), contact="lift_off", entry="edge"),
]
OTHERS = [fault for fault in FAULT_KINDS.values() if not isinstance(fault, SwashPlateDefect)]


def fault_name(fault: Fault | None) -> str:
    if isinstance(fault, SwashPlateDefect):
        return f"{fault.contact} recess"
    return type(fault).__name__ if fault else "healthy"


def describe(path: Path) -> ElementTree.Element:
    with zipfile.ZipFile(path) as archive:
        return ElementTree.fromstring(archive.read("modelDescription.xml"))


@pytest.fixture
def pump_25() -> Pump:
    return load_pump("25scy14-1b")


@pytest.fixture
def worn(pump_25: Pump) -> Twin:
    return Twin(pump_25, OperatingCondition(rpm(860), MPa(15)), PistonWear(um(60)))


def test_the_description_states_inputs_with_unit_range_and_start(
    worn: Twin, tmp_path: Path
) -> None:
    fmu = export_fmu(worn, tmp_path / "worn.fmu", sources_only=True)
    root = describe(fmu.path)
    variables = {
        element.attrib["name"]: (element, element[0].attrib)
        for element in root.iter("ScalarVariable")
    }

    assert root.attrib["fmiVersion"] == "2.0"
    assert "quasi-steady" in root.attrib["description"]
    assert root.attrib["guid"] == fmu.guid
    inputs = [name for name, (item, _) in variables.items() if item.attrib["causality"] == "input"]
    assert inputs == ["speed", "discharge_pressure", "clearance"]
    assert [variables[name][0].attrib["valueReference"] for name in inputs] == ["0", "1", "2"]
    assert float(variables["speed"][1]["start"]) == worn.condition.speed
    assert float(variables["speed"][1]["min"]) == worn.condition.speed / 4
    assert float(variables["discharge_pressure"][1]["start"]) == 15e6
    assert variables["clearance"][1] == {
        "unit": "m",
        "displayUnit": "um",
        "start": repr(um(60)),
        "min": "0.0",
        "max": "0.002",
    }
    # three sensors, and five harmonics of seven pistons for each
    assert "acceleration.cover_z" in variables
    assert "line.body_x[35]" in variables
    assert len(variables) == 3 + 1 + 3 + 3 * 35


def test_units_convert_to_those_of_the_trade(worn: Twin, tmp_path: Path) -> None:
    root = describe(export_fmu(worn, tmp_path / "worn.fmu", sources_only=True).path)
    factors = {
        (unit.attrib["name"], display.attrib["name"]): float(display.attrib["factor"])
        for unit in root.iter("Unit")
        for display in unit.iter("DisplayUnit")
    }

    assert factors["rad/s", "rpm"] * rpm(860) == pytest.approx(860)
    assert factors["Pa", "MPa"] * 15e6 == pytest.approx(15)
    assert factors["m", "um"] * 60e-6 == pytest.approx(60)


def test_an_fmu_holds_its_sources_and_two_exports_are_equal(worn: Twin, tmp_path: Path) -> None:
    first = export_fmu(worn, tmp_path / "first.fmu", sources_only=True)
    second = export_fmu(worn, tmp_path / "second.fmu", sources_only=True)
    other = export_fmu(worn.with_fault(None), tmp_path / "other.fmu", sources_only=True)

    assert first.path.read_bytes() == second.path.read_bytes()
    assert first.platform is None
    assert first.guid != other.guid
    with zipfile.ZipFile(first.path) as archive:
        names = archive.namelist()
        listed = [file.attrib["name"] for file in describe(first.path).iter("File")]
        assert [f"sources/{name}" for name in listed] == [
            name for name in names if name.endswith(".c")
        ]
        assert not [name for name in names if name.startswith("binaries/")]
        for name in ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"):
            assert "2-Clause BSD" in archive.read(f"sources/{name}").decode()


def test_a_healthy_pump_has_no_input_of_a_fault(worn: Twin) -> None:
    variables = fmu_variables(worn.with_fault(None))

    # value references stay those of the C source
    assert variables[2] is None
    assert variables[3] is not None
    assert variables[3].name == "shaft_angle"


def test_channel_names_that_are_no_identifiers_are_quoted(worn: Twin) -> None:
    sensors = (replace(worn.pump.sensors[0], name="cover z's"), *worn.pump.sensors[1:])
    twin = replace(worn, pump=replace(worn.pump, sensors=sensors))

    names = [variable.name for variable in fmu_variables(twin) if variable is not None]

    assert "acceleration.'cover z\\'s'" in names


def test_each_fault_of_swashtwin_can_be_exported() -> None:
    assert set(FAULTS) == {type(fault) for fault in FAULT_KINDS.values() if fault is not None}


@pytest.mark.parametrize(
    ("compiler", "message"),
    [
        ("no-such-cc", "No C compiler: 'no-such-cc' is not on the PATH. Install one"),
        ('"cc', "No C compiler: '\"cc' is not on the PATH. Install one"),
        ("false", "The C compiler 'false' failed: exit code 1"),
    ],
)
def test_a_compiler_that_is_missing_or_fails_is_named_and_nothing_is_written(
    compiler: str, message: str, worn: Twin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", compiler)

    with pytest.raises(SwashTwinError, match=message) as error:
        export_fmu(worn, tmp_path / "worn.fmu")

    assert "sources_only" in str(error.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("variable", "options"), [("{}", []), ('"{}" -m64', ["-m64"])], ids=["path", "with an option"]
)
def test_a_compiler_may_lie_in_a_folder_with_blanks(
    variable: str, options: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler = tmp_path / "of mine" / "cc"
    compiler.parent.mkdir()
    compiler.touch(mode=0o755)
    monkeypatch.setenv("CC", variable.format(compiler))

    assert export._find_compiler() == [str(compiler), *options]


def test_a_pump_that_cannot_run_is_not_exported(worn: Twin, tmp_path: Path) -> None:
    slow = worn.at(worn.condition.replace(speed=rpm(60), oil_temperature=celsius(90)))

    with pytest.raises(InputError, match="leaks all it displaces"):
        export_fmu(slow, tmp_path / "slow.fmu", sources_only=True)
    assert not list(tmp_path.iterdir())


def test_a_fault_of_the_user_is_refused(worn: Twin, tmp_path: Path) -> None:
    class OwnFault(PistonWear):
        pass

    with pytest.raises(InputError, match="cannot simulate OwnFault, a fault of your own"):
        export_fmu(worn.with_fault(OwnFault(um(60))), tmp_path / "own.fmu", sources_only=True)


# What follows compiles.


@pytest.fixture
def fmpy() -> Any:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    pytest.importorskip("fmpy.validation")
    return pytest.importorskip("fmpy")


def instantiate(fmpy: Any, path: Path, folder: Path) -> tuple[Any, dict[str, int], list[str]]:
    """Return an instance of an FMU, its value references, and the list of its messages."""
    description = fmpy.read_model_description(str(path))
    fmpy.extract(str(path), unzipdir=str(folder))
    instance = fmpy.fmi2.FMU2Slave(
        guid=description.guid,
        unzipDirectory=str(folder),
        modelIdentifier=description.coSimulation.modelIdentifier,
    )
    messages: list[str] = []

    def log(_environment: Any, _name: bytes, _status: int, _category: bytes, text: bytes) -> None:
        messages.append(text.decode())

    callbacks = fmpy.fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(log)
    callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.fmi2.calloc)
    callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.fmi2.free)
    instance.instantiate(callbacks=callbacks)
    references = {variable.name: variable.valueReference for variable in description.modelVariables}
    return instance, references, messages


@pytest.fixture
def running(fmpy: Any, worn: Twin, tmp_path: Path) -> Iterator[tuple[Any, dict[str, int], Any]]:
    """An FMU of a worn pump after its initialization."""
    path = export_fmu(worn, tmp_path / "worn.fmu").path
    instance, references, messages = instantiate(fmpy, path, tmp_path / "unpacked")
    instance.setupExperiment()
    instance.enterInitializationMode()
    instance.exitInitializationMode()
    yield instance, references, messages
    instance.freeInstance()


def start_values(twin: Twin) -> dict[str, float]:
    values = {
        "speed": twin.condition.speed,
        "discharge_pressure": twin.condition.discharge_pressure,
    }
    if twin.fault is not None:
        values[fields(twin.fault)[0].name] = twin.fault.severity
    return values


def require_equal_lines(fmpy: Any, fmu: FMU, twin: Twin) -> None:
    """Require that an FMU has the lines and the waveform of a twin."""
    result = fmpy.simulate_fmu(
        str(fmu.path),
        start_values=start_values(twin),
        stop_time=twin.condition.period,
        output_interval=twin.condition.period / 8,
    )
    lines = twin.acceleration().detach().numpy()
    orders = twin.orders
    is_output = orders <= line_orders(twin.pump)
    for sensor, name in enumerate(twin.pump.channels):
        expected = np.zeros(line_orders(twin.pump))
        expected[orders[is_output] - 1] = np.abs(lines[sensor, is_output])
        line_amplitudes = np.array(
            [result[f"line.{name}[{k + 1}]"][0] for k in range(expected.size)]
        )
        rounding = ROUNDING * np.abs(lines[sensor]).max()
        np.testing.assert_allclose(line_amplitudes, expected, rtol=1e-6, atol=rounding)

        angle = result["shaft_angle"]
        waveform = np.real(lines[sensor] @ np.exp(1j * np.outer(orders, angle)))
        largest = np.abs(lines[sensor]).sum()
        fmu_waveform = result[f"acceleration.{name}"]
        np.testing.assert_allclose(fmu_waveform, waveform, rtol=0, atol=ROUNDING * largest)


@pytest.mark.nightly
@pytest.mark.parametrize("fault", [*RECESSES, *OTHERS], ids=fault_name)
def test_the_lines_of_each_fault_are_those_of_the_twin(
    fault: Fault | None, fmpy: Any, worn: Twin, tmp_path: Path
) -> None:
    at_start = worn.with_fault(fault)
    fmu = export_fmu(at_start, tmp_path / "pump.fmu")
    elsewhere = at_start.at(OperatingCondition(rpm(1111), MPa(9)))
    if fault is not None:
        elsewhere = elsewhere.with_fault(fault.scaled(0.5))

    assert not fmpy.validation.validate_fmu(str(fmu.path))
    require_equal_lines(fmpy, fmu, at_start)
    require_equal_lines(fmpy, fmu, elsewhere)


@pytest.mark.nightly
@pytest.mark.parametrize("topology", ["T1", "T2"])
@pytest.mark.parametrize(
    "fault", [replace(FAULT_KINDS["loose_slipper"], slipper=4), RECESSES[0]], ids=fault_name
)
def test_all_that_a_calibration_finds_is_in_the_fmu(
    fault: Fault, topology: Any, fmpy: Any, worn: Twin, tmp_path: Path
) -> None:
    calibrated = replace(
        worn,
        fault=fault,
        topology=topology,
        bandwidth=3000.0,
        condition=OperatingCondition(rpm(1000), MPa(12), oil_temperature=330.0),
        scales=Scales(mount=1.2, bearing=0.9, excitation=1.3, sensor=0.8, mount_y=1.1, bearing_2=2),
        path=SensorPath(
            gain=(1.1, 0.9, 1.0),
            frequency=(1500.0, 2400.0),
            damping_ratio=(0.02, 0.05),
            residue=((0.3, -0.1), (0.2, 0.0), (-0.4, 0.5)),
            cross_talk=((0.0, 0.02, 0.01), (0.03, 0.0, 0.0), (0.0, 0.05, 0.0)),
        ),
        port_timing=PortTiming(deg(0.4), deg(-0.3)),
    )

    require_equal_lines(fmpy, export_fmu(calibrated, tmp_path / "pump.fmu"), calibrated)


@pytest.mark.nightly
def test_a_pump_of_nine_pistons_beside_one_of_seven(fmpy: Any, worn: Twin, tmp_path: Path) -> None:
    plate = read_nameplate(
        displacement="45 cm3/rev", pistons=9, speed="1500 rpm", pressure="280 bar", mass=None
    )
    nine = Twin(
        load_pump(new_pump("nine", like="25scy14-1b", nameplate=plate, folder=tmp_path)),
        OperatingCondition(rpm(1500), MPa(28)),
        FAULT_KINDS["piston"],
    )
    fmus = [export_fmu(twin, tmp_path / f"{index}.fmu") for index, twin in enumerate((nine, worn))]

    # both are loaded at a time, and neither calls a function of the other
    instances = [
        instantiate(fmpy, fmu.path, tmp_path / f"unpacked-{index}")[0]
        for index, fmu in enumerate(fmus)
    ]
    require_equal_lines(fmpy, fmus[0], nine)
    require_equal_lines(fmpy, fmus[1], worn)
    for instance in instances:
        instance.freeInstance()


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(12))
def test_random_pumps_have_the_lines_of_their_twins(seed: int, fmpy: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    plate = read_nameplate(
        displacement=f"{rng.uniform(10, 250):.3g} cm3/rev",
        pistons=int(rng.integers(5, 12)),
        speed=f"{rng.uniform(800, 3000):.0f} rpm",
        pressure=f"{rng.uniform(60, 350):.0f} bar",
        mass=None,
    )
    pump = load_pump(new_pump("random", like="25scy14-1b", nameplate=plate, folder=tmp_path))
    assert pump.rated is not None
    faults = [*RECESSES, *OTHERS]
    fault = faults[rng.integers(len(faults))]
    condition = OperatingCondition(
        pump.rated.speed, pump.rated.discharge_pressure, oil_temperature=rng.uniform(290, 350)
    )
    at_start = Twin(pump, condition, fault, bandwidth=rng.uniform(4000, 12000))
    fmu = export_fmu(at_start, tmp_path / "pump.fmu")

    for _ in range(3):
        elsewhere = at_start.at(
            condition.replace(
                speed=condition.speed * rng.uniform(0.3, 1.3),
                discharge_pressure=condition.discharge_pressure * rng.uniform(0.2, 1.3),
            )
        )
        if fault is not None:
            elsewhere = elsewhere.with_fault(fault.scaled(rng.uniform(0.0, 2.0)))
        require_equal_lines(fmpy, fmu, elsewhere)


@pytest.mark.nightly
def test_changed_inputs_take_effect_at_the_next_revolution(running: Any, worn: Twin) -> None:
    instance, references, _ = running
    line = [references["line.cover_z[7]"]]
    before = instance.getReal(line)[0]
    period = worn.condition.period

    instance.setReal([references["discharge_pressure"]], [8e6])
    instance.doStep(0.0, 0.6 * period)
    assert instance.getReal(line)[0] == before
    assert instance.getReal([references["shaft_angle"]])[0] == pytest.approx(1.2 * math.pi)

    # the shaft angle follows the speed at once
    instance.setReal([references["speed"]], [2 * worn.condition.speed])
    instance.doStep(0.6 * period, 0.1 * period)
    assert instance.getReal([references["shaft_angle"]])[0] == pytest.approx(1.6 * math.pi)
    assert instance.getReal(line)[0] == before

    instance.doStep(0.7 * period, 0.2 * period)
    expected = worn.at(OperatingCondition(2 * worn.condition.speed, 8e6))
    index = int(np.flatnonzero(expected.orders == 7)[0])
    amplitude = abs(complex(expected.acceleration()[0, index]))
    assert instance.getReal(line)[0] == pytest.approx(amplitude, rel=1e-6)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("speed", 0.0, "speed (0 rad/s) must lie in 22.5147...837.758 rad/s."),
        ("speed", math.nan, "must lie in"),
        ("discharge_pressure", 1e5, "must lie above the suction pressure (110000 Pa)"),
        ("clearance", -1e-6, "clearance (-1e-06) must not be negative."),
        ("clearance", 0.06, "clearance (0.06, in SI units) exceeds 0.002."),
    ],
)
def test_an_input_that_no_pump_can_have_ends_the_simulation_with_one_sentence(
    name: str, value: float, message: str, running: Any, fmpy: Any
) -> None:
    instance, references, messages = running

    instance.setReal([references[name]], [value])
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.doStep(0.0, 1e-3)

    assert len(messages) == 1
    assert message in messages[0]

    # reset, it runs again
    instance.reset()
    instance.setupExperiment()
    instance.enterInitializationMode()
    instance.exitInitializationMode()
    instance.doStep(0.0, 1e-3)


@pytest.mark.nightly
def test_a_step_without_an_end_is_refused_and_does_no_harm(running: Any, fmpy: Any) -> None:
    instance, references, messages = running

    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.doStep(0.0, math.inf)
    assert messages == ["The communication step must be finite."]

    instance.doStep(0.0, 1e-3)
    assert math.isfinite(instance.getReal([references["shaft_angle"]])[0])


@pytest.mark.nightly
def test_an_output_cannot_be_set(running: Any, fmpy: Any) -> None:
    instance, references, messages = running

    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.setReal([references["acceleration.cover_z"]], [1.0])
    assert messages == ["Only inputs can be set."]


@pytest.mark.nightly
def test_an_fmu_of_sources_can_be_compiled_by_another_tool(
    fmpy: Any, worn: Twin, tmp_path: Path
) -> None:
    fmu = export_fmu(worn, tmp_path / "sources.fmu", sources_only=True)

    subprocess.run([sys.executable, "-m", "fmpy", "compile", str(fmu.path)], check=True)

    require_equal_lines(fmpy, fmu, worn)


@pytest.mark.nightly
def test_the_c_source_is_strict_c99(worn: Twin, fmpy: Any, tmp_path: Path) -> None:
    fmu = export_fmu(worn, tmp_path / "sources.fmu", sources_only=True)
    with zipfile.ZipFile(fmu.path) as archive:
        archive.extractall(tmp_path)

    sources = sorted((tmp_path / "sources").glob("*.c"))
    options = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only")
    subprocess.run(["cc", *options, "-DFMI2_OVERRIDE_FUNCTION_PREFIX", *sources], check=True)
