"""What all threads of a process share and a library must leave as it was."""

import os
import warnings
from typing import Any

import matplotlib as mpl
import numpy as np
import torch


def global_state() -> dict[str, Any]:
    """Random states, numbers of threads, flags, filters and settings of the process, to be
    compared.

    Python's own generator is left out: the checker of types that runs beneath the tests draws from
    it.
    """
    cudnn = torch.backends.cudnn
    return {
        "torch's generator": torch.get_rng_state().tolist(),
        "torch's threads": torch.get_num_threads(),
        "torch's default type": torch.get_default_dtype(),
        "torch's gradients": torch.is_grad_enabled(),
        "deterministic": (
            torch.are_deterministic_algorithms_enabled(),
            cudnn.deterministic,
            cudnn.benchmark,
        ),
        "numpy's generator": str(np.random.get_state()),  # noqa: NPY002
        "numpy's errors": np.geterr(),
        "numpy's printing": np.get_printoptions(),
        "warnings": list(warnings.filters),
        "matplotlib": dict(mpl.rcParams),
        "environment": dict(os.environ),
    }
