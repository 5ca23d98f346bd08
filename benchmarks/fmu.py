"""FMUs of three pumps against their twins: validation, lines, and speed.

    python benchmarks/fmu.py --out docs/figures/fmu.png

A healthy pump of 7 pistons, one of 9 with a worn piston, and one of 7 with a loose slipper, whose
motion takes longest. FMPy validates and simulates the FMUs; their lines are compared with those of
the twin, over four operating points each. Speed is measured by a program in C, because a tool in
Python takes longer for a step than the FMU does: with constant inputs, and with a speed that rises
all the time, so that each revolution needs another solution. Each FMU prints one line of JSON.
Requires FMPy and a C compiler (``cc``).
"""

import argparse
import json
import os
import platform
import subprocess
import tempfile
import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.validation import validate_fmu

import swashtwin.physics
from swashtwin.foundation import MPa, mm, rpm, um
from swashtwin.physics import FMU, Twin, export_fmu
from swashtwin.physics.fmu.c_numbers import line_orders
from swashtwin.plot.style import CALIBRATED, NOMINAL, create_panels, figure_style, label_log_axis
from swashtwin.pump import (
    LooseSlipper,
    OperatingCondition,
    PistonWear,
    load_pump,
    new_pump,
    read_nameplate,
)

STEPS_PER_SECOND = 25600
"""Communication steps, at each of which the accelerations are read: a usual sample rate."""
REPEATS = 3
"""Measurements of a time, of which the shortest counts."""
RAMP = 5.0
"""Rise of the speed [rad/s^2]."""
FACTORS = ((1.0, 1.0), (1.3, 0.6), (0.7, 0.8), (0.5, 0.4))
"""Speed and pressure of the compared operating points, over those of the first."""


def build_twins(folder: Path) -> dict[str, Twin]:
    """Return the twins by the name of their panel."""
    plate = read_nameplate(
        displacement="45 cm3/rev", pistons=9, speed="1500 rpm", pressure="280 bar", mass=None
    )
    nine = load_pump(new_pump("nine", like="25scy14-1b", nameplate=plate, folder=folder))
    seven = load_pump("25scy14-1b")
    return {
        "7 pistons, healthy": Twin(seven, OperatingCondition(rpm(860), MPa(15))),
        "9 pistons, one worn by 60 µm": Twin(
            nine, OperatingCondition(rpm(1500), MPa(28)), PistonWear(um(60))
        ),
        "7 pistons, one loose by 0.1 mm in its slipper": Twin(
            seven, OperatingCondition(rpm(860), MPa(15)), LooseSlipper(mm(0.1))
        ),
    }


def simulated_lines(fmu: FMU, twin: Twin) -> np.ndarray:
    """Return the amplitudes (sensor, order) that FMPy reads from the FMU."""
    start_values = {
        "speed": twin.condition.speed,
        "discharge_pressure": twin.condition.discharge_pressure,
    }
    if twin.fault is not None:
        start_values[fields(twin.fault)[0].name] = twin.fault.severity
    result = fmpy.simulate_fmu(str(fmu.path), start_values=start_values, stop_time=0.01)
    orders = range(1, line_orders(twin.pump) + 1)
    return np.array(
        [[result[f"line.{name}[{order}]"][-1] for order in orders] for name in twin.pump.channels]
    )


def twin_lines(twin: Twin) -> np.ndarray:
    """Return the same of the twin in Python."""
    amplitudes = np.zeros((len(twin.pump.channels), line_orders(twin.pump) + 1))
    is_output = twin.orders <= line_orders(twin.pump)
    lines = np.abs(twin.acceleration().detach().numpy())
    amplitudes[:, twin.orders[is_output]] = lines[:, is_output]
    return amplitudes[:, 1:]


def compare(fmu: FMU, twin: Twin) -> dict[str, Any]:
    """Return how far lines of the FMU are from the twin's, over the operating points."""
    relative = 0.0
    of_largest = 0.0
    for speed, pressure in FACTORS:
        condition = OperatingCondition(
            speed * twin.condition.speed, pressure * twin.condition.discharge_pressure
        )
        elsewhere = twin.at(condition)
        expected = twin_lines(elsewhere)
        difference = np.abs(simulated_lines(fmu, elsewhere) - expected)
        largest = expected.max(axis=1, keepdims=True)
        is_line = expected > 1e-7 * largest
        relative = max(relative, float((difference[is_line] / expected[is_line]).max()))
        of_largest = max(of_largest, float((difference / largest).max()))
    return {"largest_relative_difference": relative, "of_largest_line": of_largest}


def measure_speed(fmu: FMU, twin: Twin, folder: Path) -> dict[str, float]:
    """Return simulated time over wall time."""
    source = Path(__file__).with_name("fmu_speed.c")
    headers = Path(swashtwin.physics.__file__).parent / "fmu" / "sources"
    program = folder / "fmu_speed"
    subprocess.run(
        ["cc", "-std=c99", "-O2", f"-I{headers}", "-o", program, source, "-ldl"], check=True
    )
    with zipfile.ZipFile(fmu.path) as archive:
        (name,) = [name for name in archive.namelist() if name.startswith("binaries/")]
        binary = archive.extract(name, folder)

    ratios = {}
    for kind, seconds, ramp in (("constant_inputs", 20.0, 0.0), ("changing_speed", 4.0, RAMP)):
        arguments = (binary, fmu.guid, STEPS_PER_SECOND, seconds, len(twin.pump.sensors), ramp)
        times = [
            float(subprocess.check_output([program, *map(str, arguments)])) for _ in range(REPEATS)
        ]
        ratios[kind] = seconds / min(times)
    return ratios


def draw(twins: dict[str, Twin], fmus: dict[str, FMU], out: Path) -> None:
    """Draw the lines of the first sensor of each pump, side by side."""
    with figure_style():
        figure, panels = create_panels(len(twins), 1, 2.5 * len(twins))
        for axes, (title, twin) in zip(panels[:, 0], twins.items(), strict=True):
            expected = twin_lines(twin)[0]
            found = simulated_lines(fmus[title], twin)[0]
            orders = np.arange(1, expected.size + 1)
            # what is below lies under any sensor's noise
            is_drawn = expected > 1e-6
            axes.bar(
                orders[is_drawn] - 0.2,
                expected[is_drawn],
                0.4,
                color=CALIBRATED,
                label="twin in Python",
            )
            axes.bar(orders[is_drawn] + 0.2, found[is_drawn], 0.4, color=NOMINAL, label="FMU in C")
            axes.set_yscale("log")
            label_log_axis(axes.yaxis)
            axes.set_title(f"{title}: {twin.pump.channels[0]}", loc="left")
            axes.set_ylabel("amplitude [m/s²]")
            pistons = twin.pump.rotating_group.piston_count
            axes.set_xticks([1, *range(pistons, orders[-1] + 1, pistons)])
            axes.set_xlim(0.3, orders[-1] + 0.7)
        panels[0, 0].legend(loc="lower right", ncols=2, bbox_to_anchor=(1, 1))
        panels[-1, 0].set_xlabel("shaft order")
        figure.savefig(out, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="picture to write")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        twins = build_twins(folder)
        fmus = {}
        for number, (title, twin) in enumerate(twins.items()):
            fmu = export_fmu(twin, folder / f"{number}.fmu")
            fmus[title] = fmu
            answer = {
                "fmu": title,
                "problems": validate_fmu(str(fmu.path)),
                **compare(fmu, twin),
                **measure_speed(fmu, twin, folder),
                "load": round(os.getloadavg()[0], 1),
                "machine": platform.machine(),
            }
            print(json.dumps(answer), flush=True)
        if options.out is not None:
            draw(twins, fmus, options.out)


if __name__ == "__main__":
    main()
