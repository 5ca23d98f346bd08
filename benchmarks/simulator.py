"""Time, memory and accuracy of one value and gradient of a spectrum loss: our engines and their
peers.

    pip install -r benchmarks/requirements.txt
    python benchmarks/simulator.py --json

One revolution of the paper's pump at 860 rev/min and 15 MPa with the paper's defect, in float64, on
one core, each row in a process of its own. Peers step through it with the fourth-order Runge-Kutta
method; stability asks for steps of 1 us, and the revolution is cut into 72,000. They are given what
costs time and is not theirs: the forces, computed beforehand, and the settled motion to start from,
where the paper's way drops start-up revolutions first. Compilation is not counted. `error` is that
of the sensors' accelerations against the Runge-Kutta method at a quarter of the step,
`error_gradient` that of the slopes against other code. A peer that is not installed is named with
what installs it. At the commit 3b268ae3 the table has torchdiffeq, other settings of JAX and
diffrax, Radau, and 20,000 steps too.
"""

import argparse
import math
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from peers import throughput
from peers.measuring import Entry, alone, measured
from peers.problem import STEPS_PER_REVOLUTION
from peers.reference import references

from swashtwin.foundation import json_text

ENTRIES = (
    Entry("steady", "ours: harmonic balance (default)", "ours", "Steady"),
    Entry("steady_rk4", "ours: RK4 in steady state", "ours", "SteadyRungeKutta"),
    Entry("numba", "numba RK4, discrete adjoint", "numba_adjoint", "Numba"),
    Entry("jax", "JAX lax.scan RK4, reverse", "jax_side", "JaxScan", "jax"),
    Entry(
        "diffrax", "diffrax RK4, RecursiveCheckpointAdjoint", "diffrax_side", "Diffrax", "diffrax"
    ),
    Entry("eager", "PyTorch eager RK4, autograd", "eager", "Eager"),
)
FINE = Entry(
    "steady_rk4_fine",
    "ours: RK4 in steady state, quarter step",
    "ours",
    "SteadyRungeKutta",
    refine=4,
)
BATCH = 200
PACKAGES = ("swashtwin", "torch", "numpy", "scipy", "numba", "jax", "diffrax")
FLAT_MB = 2.0
"""Memory may differ by so much and still be called flat."""


def relative(values: np.ndarray, target: np.ndarray) -> float:
    """Largest difference over the largest of `target`, as far as both reach."""
    length = min(len(values), len(target))
    target = target[:length]
    return float(np.abs(values[:length] - target).max() / np.abs(target).max())


def judged() -> list[dict[str, Any]]:
    """The table: each contender's row with its errors, and without the motion from which these
    came.
    """
    truth = alone(references, STEPS_PER_REVOLUTION)
    rows = [alone(measured, entry, STEPS_PER_REVOLUTION) for entry in ENTRIES]
    for row in rows:
        if "missing" not in row:
            wanted = truth["steady_slopes" if row["key"].startswith("steady") else "slopes"]
            row["error"] = relative(row.pop("gains"), truth["quarter"])
            row["error_gradient"] = relative(np.array(row.pop("slopes")), wanted)
    return rows


def ratios_of(rows: list[dict[str, Any]]) -> dict[str, float]:
    """How many times longer the peers take than ours; NaN where one was not measured."""
    times = {row["key"]: row.get("gradient_s", math.nan) for row in rows}
    ratios = {name: times[name] / times["steady"] for name in ("eager", "diffrax", "jax")}
    return {**ratios, "steady_rk4_eager": times["eager"] / times["steady_rk4"]}


def memory_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Peak memory [MB] of the gradient in steady state, at the step and at a quarter of it."""
    memory = {
        row["key"]: row["memory_mb"] for row in rows if row["key"] in ("steady", "steady_rk4")
    }
    fine = alone(measured, FINE, STEPS_PER_REVOLUTION)["memory_mb"]
    flat = bool(abs(fine - memory["steady_rk4"]) <= FLAT_MB)
    return {
        "harmonic_balance_mb": memory["steady"],
        "rk4_mb": memory["steady_rk4"],
        "rk4_four_times_the_steps_mb": fine,
        "flat": flat,
    }


def batch_times() -> dict[str, float]:
    """Value and gradient of one and of many sets of values."""
    alone_time, many = alone(throughput.ours, 1), alone(throughput.ours, BATCH)
    return {"one_s": alone_time, "two_hundred_s": many, "ratio": many / alone_time}


def bars_of(report: dict[str, Any]) -> list[dict[str, Any]]:
    """Each target with its measured value, and whether it is met; None where it was not
    measured.
    """
    ratios, memory = report["ratios"], report["memory"]
    bars = (
        ("eager RK4 over steady state", ratios["eager"], "at least", 3000),
        ("diffrax over steady state", ratios["diffrax"], "at least", 300),
        ("JAX scan over steady state", ratios["jax"], "at least", 40),
        (
            "memory of the gradient in steady state [MB]",
            memory["harmonic_balance_mb"],
            "at most",
            50,
        ),
        (
            "what four times the steps change of it [MB]",
            abs(memory["rk4_four_times_the_steps_mb"] - memory["rk4_mb"]),
            "at most",
            FLAT_MB,
        ),
        (f"{BATCH} sets in one batch over one set", report["batch"]["ratio"], "at most", 40),
        ("1,000 synthetic windows on two cores [s]", report["windows_s"], "at most", 10),
    )
    return [
        {
            "bar": name,
            "value": value,
            "wanted": f"{word} {bound}",
            "passed": None
            if math.isnan(value)
            else bool(value >= bound if word == "at least" else value <= bound),
        }
        for name, value, word, bound in bars
    ]


def machine() -> dict[str, Any]:
    """Where it was measured."""
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = None
    return {"cores": os.cpu_count(), "python": platform.python_version(), "versions": versions}


def everything() -> dict[str, Any]:
    """All that is measured."""
    rows = judged()
    report = {
        "rows": rows,
        "ratios": ratios_of(rows),
        "batch": batch_times(),
        "windows_s": alone(throughput.windows),
        "memory": memory_of(rows),
        "machine": machine(),
    }
    return {**report, "bars": bars_of(report)}


def show(report: dict[str, Any]) -> None:
    """Print the table and the bars."""
    print(f"{'':44}{'steps':>8}{'value s':>10}{'gradient s':>12}{'MB':>8}{'error':>9}{'slopes':>9}")
    for row in report["rows"]:
        if "missing" in row:
            print(f"{row['name']:44}not installed: {row['missing']}")
            continue
        times = f"{row['steps']:8d}{row['value_s']:10.3g}{row['gradient_s']:12.3g}"
        memory = f"{row['memory_mb']:8.3g}"
        print(f"{row['name']:44}{times}{memory}{row['error']:9.1e}{row['error_gradient']:9.1e}")
    for bar in report["bars"]:
        verdict = {True: "met", False: "MISSED", None: "not measured"}[bar["passed"]]
        print(f"{bar['bar']:48}{bar['value']:10.3g}  {bar['wanted']:16}{verdict}")


def main() -> None:
    """Print the tables, as JSON with ``--json``."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    report = everything()
    if arguments.json:
        print(json_text(report, indent=1))
    else:
        show(report)


if __name__ == "__main__":
    main()
