"""Columns that random convolution kernels make of windows: MiniRocket, MultiRocket and Hydra, by aeon."""

import importlib.util
import os
import signal
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from swashtwin.foundation import InputError, MissingExtraError
from swashtwin.learning.estimators import rocket_script
from swashtwin.learning.features import FeatureTable
from swashtwin.learning.training.normalization import Normalization
from swashtwin.learning.windows.window_set import WindowSet

KERNELS = ("minirocket", "multirocket", "hydra")
"""Kinds of kernels."""

PYTHON = "SWASHTWIN_ROCKET_PYTHON"
"""Environment variable with the path of another Python that has aeon, where it is not to be installed here."""

_SHORTEST = 9  # taps of a kernel


@dataclass(frozen=True, eq=False)
class KernelColumns:
    """Called with windows, the columns of kernels that were fitted to other windows, as `extract_features` would be.

    Windows are scaled one by one before (mean 0, deviation 1 per channel), as networks see them by default: gain and
    mounting differ between machines.
    """

    kind: str
    """One of `KERNELS`."""
    seed: int
    """Seed of the kernels, below 2³²."""
    known: Float32[np.ndarray, "window channel time"]
    """Scaled windows that the kernels' biases are taken from."""

    @classmethod
    def fitted(cls, kind: str, windows: WindowSet, seed: int) -> "KernelColumns":
        """Kernels of that kind for training windows.

        Raises
        ------
        InputError
            A window is shorter than a kernel.
        """
        if windows.length < _SHORTEST:
            raise InputError(f"windows of {windows.length} readings are shorter than a kernel, {_SHORTEST} readings.")
        return cls(kind, seed, _scaled(windows))

    def __call__(self, windows: WindowSet) -> FeatureTable:
        """One column for each kernel and statistic.

        Raises
        ------
        MissingExtraError
            Neither this Python nor the one named by `PYTHON` has aeon.
        """
        given = _scaled(windows)
        if python := os.environ.get(PYTHON):
            values = _elsewhere(python, self, given)
        elif importlib.util.find_spec("aeon") is None:
            raise MissingExtraError(
                f'{self.kind} needs aeon: pip install "swashtwin[rocket]", or, to leave numpy and numba as they are, '
                f"python -m venv rocket && rocket/bin/pip install aeon torch, and {PYTHON}=rocket/bin/python."
            )
        else:
            values = rocket_script.kernel_columns(self.kind, self.seed, self.known, given)
        return FeatureTable(values, tuple(f"{self.kind} {column}" for column in range(values.shape[1])))


def _scaled(windows: WindowSet) -> Float32[np.ndarray, "window channel time"]:
    return Normalization.fitted("window", windows).applied(windows)


def _elsewhere(
    python: str, columns: KernelColumns, windows: Float32[np.ndarray, "window channel time"]
) -> Float32[np.ndarray, "window column"]:
    """The same, by another Python in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "windows.npz", Path(folder) / "columns.npy"
        np.savez(source, known=columns.known, windows=windows)
        command = [python, "-I", rocket_script.__file__, columns.kind, str(columns.seed), str(source), str(target)]
        try:
            subprocess.run(command, check=True, capture_output=True, text=True)
        except OSError as cause:
            raise MissingExtraError(f"{PYTHON} ({python}) cannot be run: {cause.strerror}.") from cause
        except subprocess.CalledProcessError as cause:
            last = (cause.stderr.strip().splitlines() or ["no word"])[-1]
            if cause.returncode < 0:
                why = "most often for want of memory" if cause.returncode == -signal.SIGKILL else last
                last = f"ended by signal {-cause.returncode}, {why}"
            raise MissingExtraError(f"{columns.kind} failed in {PYTHON} ({python}): {last}") from cause
        values: np.ndarray = np.load(target)
    return values
