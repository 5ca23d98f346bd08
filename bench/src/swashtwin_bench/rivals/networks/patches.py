"""Windows in whole patches."""

from jaxtyping import Float
from torch import Tensor
from torch.nn import functional


def whole_patches(windows: Float[Tensor, "window channel time"], patch: int) -> Float[Tensor, "window channel longer"]:
    """`windows` with zeros before them, so many that their length is a multiple of `patch`."""
    return functional.pad(windows, (-windows.shape[-1] % patch, 0))
