"""What needs torch, numba or ONNX, and so an extra; all else is there in the base install."""

import subprocess
import sys

ROOMS = ("foundation", "pump", "recordings", "signals", "learning", "plot", "diagnosis", "report", "monitoring", "cli")
CODE = f"""
import importlib, sys
class Missing:
    def find_spec(name, path=None, target=None):
        if name in ("torch", "numba", "onnx", "onnxruntime", "onnxscript"):
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Missing)
for room in {ROOMS}:
    door = importlib.import_module("swashtwin." + room)
    for name in door.__all__:
        try:
            getattr(door, name)
        except ImportError:
            print(room, name, sep=".")
"""


def test_the_base_install_lacks_networks_and_nothing_else() -> None:
    printed = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True).stdout
    assert set(printed.split()) == {
        "foundation.TorchStream",
        *(f"learning.{name}" for name in ("BiTCN", "Branch", "Network", "batches")),
        *("report.calibration_blocks", "report.verdict_counts"),  # of a twin
    }
