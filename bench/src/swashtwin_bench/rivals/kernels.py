"""MiniRocket, MultiRocket and Hydra, by aeon: a ridge classifier on columns of random convolution kernels."""

import importlib.util
import os
import subprocess
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32
from sklearn.linear_model import RidgeClassifierCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler

from swashtwin_bench.rivals import rocket_script
from swashtwin.foundation import InputError, MissingExtraError
from swashtwin.learning import (
    BASELINES,
    RIDGE_PENALTIES,
    Baseline,
    DecisionSoftmax,
    FeatureTable,
    Normalization,
    WindowSet,
)

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
    """``"minirocket"``, ``"multirocket"`` or ``"hydra"``."""
    seed: int
    """Seed of the kernels, below 2³²."""
    training: Float32[np.ndarray, "window channel time"]
    """Scaled training windows, from which the kernels take their biases."""

    @classmethod
    def fitted(cls, kind: str, windows: WindowSet, seed: int) -> "KernelColumns":
        """Kernels of that kind for training windows.

        Raises
        ------
        InputError
            A window is shorter than a kernel.
        """
        if windows.length < _SHORTEST:
            raise InputError(f"windows of {windows.length} samples are shorter than a kernel of {_SHORTEST}.")
        return cls(kind, seed, _scaled(windows))

    def __call__(self, windows: WindowSet) -> FeatureTable:
        """One column for each kernel and statistic.

        Raises
        ------
        MissingExtraError
            Neither this Python nor the one named by `PYTHON` has aeon.
        """
        scaled = _scaled(windows)
        if python := os.environ.get(PYTHON):
            values = _run_elsewhere(python, self, scaled)
        elif importlib.util.find_spec("aeon") is None:
            raise MissingExtraError(
                f'{self.kind} needs aeon: pip install "swashtwin[rocket]", or, to leave numpy and numba as they are, '
                f"python -m venv rocket && rocket/bin/pip install aeon torch, and {PYTHON}=rocket/bin/python."
            )
        else:
            values = rocket_script.kernel_columns(self.kind, self.seed, self.training, scaled)
        return FeatureTable(values, tuple(f"{self.kind} {column}" for column in range(values.shape[1])))


def _scaled(windows: WindowSet) -> Float32[np.ndarray, "window channel time"]:
    return Normalization.fit("window", windows).apply(windows)


def _run_elsewhere(
    python: str, columns: KernelColumns, windows: Float32[np.ndarray, "window channel time"]
) -> Float32[np.ndarray, "window column"]:
    """The same, by another Python in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "windows.npz", Path(folder) / "columns.npy"
        np.savez(source, training=columns.training, windows=windows)
        command = [python, "-I", rocket_script.__file__, columns.kind, str(columns.seed), str(source), str(target)]
        try:
            subprocess.run(command, check=True, capture_output=True, text=True)
        except OSError as cause:
            raise MissingExtraError(f"{PYTHON} ({python}) cannot be run: {cause.strerror}.") from cause
        except subprocess.CalledProcessError as cause:
            last = (cause.stderr.strip().splitlines() or ["no word"])[-1]
            if cause.returncode < 0:
                why = "most often for want of memory" if cause.returncode == -9 else last  # SIGKILL
                last = f"ended by signal {-cause.returncode}, {why}"
            raise MissingExtraError(f"{columns.kind} failed in {PYTHON} ({python}): {last}") from cause
        values: np.ndarray = np.load(target)
    return values


def _kernel_ridge(seed: int) -> Any:
    ridge = DecisionSoftmax(RidgeClassifierCV(alphas=RIDGE_PENALTIES))
    return make_pipeline(StandardScaler(with_mean=False, copy=False), ridge)


def _counted_ridge(seed: int) -> Any:
    return make_pipeline(FunctionTransformer(_root_of_counts), _kernel_ridge(seed))


def _root_of_counts(columns: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(columns, 0))


def _baseline(kind: str, title: str, doi: str, estimator: Any) -> Baseline:
    return Baseline(title, doi, estimator, partial(KernelColumns.fitted, kind))


KERNELS: dict[str, Baseline] = {
    "minirocket": _baseline("minirocket", "MiniRocket", "10.1145/3447548.3467231", _kernel_ridge),
    "multirocket": _baseline("multirocket", "MultiRocket", "10.1007/s10618-022-00844-1", _kernel_ridge),
    "hydra": _baseline("hydra", "Hydra", "10.1007/s10618-023-00939-3", _counted_ridge),
}
"""The classifiers on kernels by name; they join `BASELINES`."""

BASELINES.update(KERNELS)
