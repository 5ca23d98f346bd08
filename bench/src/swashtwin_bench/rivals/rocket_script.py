"""aeon's convolution kernels, computed here or, as a script, by another Python that has aeon.

    python rocket_script.py minirocket 3 windows.npz columns.npy

Another Python knows nothing of this package, so this file imports none of it.
"""

import sys

import numpy as np

_TOGETHER = 256
"""Windows that are transformed together. Each has its own columns: memory only, no result depends on it."""


def kernel_columns(kind: str, seed: int, training: np.ndarray, windows: np.ndarray) -> np.ndarray:
    """What the kernels drawn by `seed` and fitted to the windows `training` make of `windows` (window, column).

    Kernels take milliseconds to fit and depend on `seed` and `training` alone, so they are fitted anew each time.
    """
    from aeon.transformations.collection import convolution_based

    makers = {
        "minirocket": lambda: convolution_based.MiniRocket(random_state=seed),
        "multirocket": lambda: convolution_based.MultiRocket(random_state=seed),
        "hydra": lambda: convolution_based.HydraTransformer(random_state=seed, output_type="numpy"),
    }
    kernels = makers[kind]().fit(training)
    parts = [windows[first : first + _TOGETHER] for first in range(0, max(1, len(windows)), _TOGETHER)]
    return np.concatenate([np.asarray(kernels.transform(part), dtype=np.float32) for part in parts])


if __name__ == "__main__":
    kind, seed, source, target = sys.argv[1:]
    with np.load(source) as arrays:
        np.save(target, kernel_columns(kind, int(seed), arrays["training"], arrays["windows"]))
