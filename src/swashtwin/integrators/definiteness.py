"""Refusal of matrices that no pump can have."""

import torch
from jaxtyping import Float
from torch import Tensor

from swashtwin.errors import InputError

SLACK = 1e3
"""Multiple of the number format's resolution by which an eigenvalue, in units of the diagonal, may be negative."""


def require_definite(name: str, matrix: Float[Tensor, "*batch n n"]) -> None:
    """Nothing, where every `matrix` of the batch is positive semidefinite to rounding.

    Parameters
    ----------
    name : what to call the matrix in the message, such as "stiffness".

    Raises
    ------
    InputError
        One is not, or is not finite: a free value has become negative.
    """
    matrix = matrix.detach()
    resolution = torch.finfo(matrix.dtype)
    root = matrix.diagonal(dim1=-2, dim2=-1).clamp_min(resolution.tiny).sqrt()
    slack = SLACK * resolution.eps * torch.eye(matrix.shape[-1], dtype=matrix.dtype, device=matrix.device)
    failed = torch.linalg.cholesky_ex(matrix / root[..., None] / root[..., None, :] + slack).info != 0
    if bool(failed.any()):
        first = failed.nonzero()[0].tolist()
        where = f" (set {', '.join(map(str, first))} of the batch)" if first else ""
        raise InputError(
            f"{name}{where} is not positive semidefinite: a motion would be pushed on instead of held. Interface "
            "values and scales must be positive; is one of them negative?"
        )
