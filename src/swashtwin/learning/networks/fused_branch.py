"""Training of `BiTCN` on a CPU: the same numbers as its branches give, in few passes over the
features.

Convolutions find the features of a step side by side, as the processor multiplies them.
Normalization, ReLU and dropout are compiled to one pass over the features for each mean that they
need, and dropout draws its numbers within such a pass.
"""

from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.foundation import compiled
from swashtwin.learning.networks.bitcn import Branch, ResidualUnit, SqueezeExcitation

_ZERO = np.float32(0)
_U32, _F32 = np.uint32, np.float32


def fused_encoding(
    positive: Branch,
    inverse: Branch | None,
    skip: nn.Conv1d,
    windows: Float[Tensor, "window channel time"],
) -> Float[Tensor, "window feature"]:
    """What `BiTCN.encode` gives of whole patches in training, to rounding.

    Dropout follows the same law with other random numbers.
    """
    fused = _features(positive, windows)
    if inverse is not None:
        fused = fused + _features(inverse, windows.flip(-1)).flip(1)
    return (fused + _patch_features(skip, windows)).relu_().mean(dim=1)


def _features(
    branch: Branch, windows: Float[Tensor, "window channel time"]
) -> Float[Tensor, "window step feature"]:
    """Features of a branch."""
    features = _patch_features(branch.entry, windows)
    for unit in branch.units:
        assert isinstance(unit, ResidualUnit)
        normalization = unit.normalization
        convolved = _convolve(
            unit.convolution, functional.pad(features, (0, 0, *unit.padding)), with_bias=False
        )
        active, mean = _Activation.apply(
            convolved,
            unit.convolution.bias,
            normalization.weight,
            normalization.bias,
            normalization,
            unit.dropout.p,
        )
        if isinstance(unit.attention, SqueezeExcitation):
            active = active * unit.attention.weights(mean).unsqueeze(1)
        features = (
            active
            + (features if isinstance(unit.skip, nn.Identity) else _convolve(unit.skip, features))
        ).relu_()
    return _convolve(branch.exit, features)


def _patch_features(
    convolution: nn.Conv1d, windows: Float[Tensor, "window channel time"]
) -> Float[Tensor, "window step feature"]:
    """The convolution of patches that do not overlap."""
    patches = windows.unflatten(-1, (-1, convolution.stride[0])).permute(0, 2, 1, 3).flatten(2)
    return functional.linear(patches, convolution.weight.flatten(1), convolution.bias)


def _convolve(
    convolution: nn.Conv1d, x: Float[Tensor, "window step feature_in"], with_bias: bool = True
) -> Float[Tensor, "window shorter feature_out"]:
    """The convolution over the steps."""
    image = x.transpose(1, 2).unsqueeze(
        2
    )  # one row of pixels, which torch knows to hold the features last
    bias = convolution.bias if with_bias else None
    convolved = functional.conv2d(
        image, convolution.weight.unsqueeze(2), bias, dilation=(1, *convolution.dilation)
    )
    return convolved.squeeze(2).transpose(1, 2)


class _Activation(torch.autograd.Function):
    """Dropout of the ReLU of what batch normalization makes of a convolution, and its mean over the
    steps.

    The bias of the convolution only shifts the running mean: normalization takes it away.
    """

    @staticmethod
    def forward(
        ctx: Any,
        x: Tensor,
        bias: Tensor,
        gamma: Tensor,
        beta: Tensor,
        normalization: nn.BatchNorm1d,
        dropout: float,
    ) -> tuple[Tensor, Tensor]:
        x = x.contiguous()
        mean, variance = _moments(_array(x))
        _update(
            normalization,
            torch.from_numpy(mean) + bias,
            torch.from_numpy(variance),
            x.shape[0] * x.shape[1],
        )
        inverse = 1 / np.sqrt(variance + normalization.eps)
        gain = 1 / (1 - dropout)
        scale = gain * inverse * gamma.numpy()
        shift = gain * beta.numpy() - mean * scale
        active, mean_active = torch.empty_like(x), torch.empty(x.shape[0], x.shape[2])
        seed = int(torch.randint(2**32, ()))
        arrays = scale.astype(_F32), shift.astype(_F32), _array(active), mean_active.numpy()
        _activate(_array(x), *arrays, _U32(seed), _U32(dropout * 2**32))
        ctx.save_for_backward(x, active, gamma)
        ctx.factors = mean.astype(_F32), inverse.astype(_F32), _F32(gain)
        return active, mean_active

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        x, active, gamma = ctx.saved_tensors
        grad_x = torch.empty_like(x)
        arrays = (
            _array(part) for part in (grads[0].contiguous(), grads[1], x, active, gamma, grad_x)
        )
        of_bias, of_gamma, of_beta = _activate_backward(*arrays, *ctx.factors)
        return (
            grad_x,
            torch.from_numpy(of_bias),
            torch.from_numpy(of_gamma),
            torch.from_numpy(of_beta),
            None,
            None,
        )


def _update(normalization: nn.BatchNorm1d, mean: Tensor, variance: Tensor, count: int) -> None:
    """Move the running means as `torch.nn.BatchNorm1d` does."""
    assert normalization.momentum is not None
    for name, value in (("running_mean", mean), ("running_var", variance * count / (count - 1))):
        normalization.get_buffer(name).lerp_(value.float(), normalization.momentum)
    normalization.get_buffer("num_batches_tracked").add_(1)


def _array(tensor: Tensor) -> np.ndarray:
    """The numbers of a tensor, in place."""
    return tensor.detach().numpy()


@compiled
@no_type_check
def _moments(x):
    """(mean, variance) of each feature."""
    windows, steps, features = x.shape
    pivot = np.empty(features, _F32)
    for c in range(features):
        pivot[c] = x[0, 0, c]
    total, square = np.zeros(features), np.zeros(features)
    for n in range(windows):
        first, second = np.zeros(features, _F32), np.zeros(features, _F32)
        for t in range(steps):
            for c in range(features):
                deviation = x[n, t, c] - pivot[c]
                first[c] += deviation
                second[c] += deviation * deviation
        total += first
        square += second
    mean = total / (windows * steps)
    return mean + pivot, square / (windows * steps) - mean * mean


@compiled
@no_type_check
def _activate(x, scale, shift, active, mean, seed, least):
    """Fill in what is active after ReLU and dropout, and its mean over the steps.

    The random number of an entry is a hash of its place and the seed (the multipliers are of C.
    Wellons, "Prospecting for hash functions", 2018); an entry below `least` is dropped.
    """
    windows, steps, features = x.shape
    for n in range(windows):
        total = np.zeros(features, _F32)
        for t in range(steps):
            row = _U32((n * steps + t) * features)
            for c in range(features):
                draw = _U32(_U32(_U32(row + _U32(c)) * _U32(0x9E3779B9)) ^ seed)
                draw = _U32(_U32(draw ^ _U32(draw >> _U32(16))) * _U32(0x21F0AAAD))
                draw = _U32(_U32(draw ^ _U32(draw >> _U32(15))) * _U32(0xD35A2D97))
                draw = _U32(draw ^ _U32(draw >> _U32(15)))
                value = x[n, t, c] * scale[c] + shift[c]
                value = value if value > _ZERO and draw >= least else _ZERO
                active[n, t, c] = value
                total[c] += value
        for c in range(features):
            mean[n, c] = total[c] / _F32(steps)


@compiled
@no_type_check
def _activate_backward(grad, grad_mean, x, active, gamma, grad_x, mean, inverse, gain):
    """Fill in the gradient of `x`; those of the convolution's bias (rounding only), of gamma and of
    beta come back.
    """
    windows, steps, features = x.shape
    of_beta, of_gamma, of_bias = np.zeros(features), np.zeros(features), np.zeros(features)
    for n in range(windows):
        plain, weighted = np.zeros(features, _F32), np.zeros(features, _F32)
        for t in range(steps):
            for c in range(features):
                passed = (grad[n, t, c] + grad_mean[n, c] / _F32(steps)) * gain
                passed = passed if active[n, t, c] > _ZERO else _ZERO
                plain[c] += passed
                weighted[c] += passed * ((x[n, t, c] - mean[c]) * inverse[c])
        of_beta += plain
        of_gamma += weighted
    constant, slope = (
        (of_beta / (windows * steps)).astype(_F32),
        (of_gamma / (windows * steps)).astype(_F32),
    )
    scale = gamma * inverse
    for n in range(windows):
        total = np.zeros(features, _F32)
        for t in range(steps):
            for c in range(features):
                passed = (grad[n, t, c] + grad_mean[n, c] / _F32(steps)) * gain
                passed = passed if active[n, t, c] > _ZERO else _ZERO
                value = scale[c] * (
                    passed - constant[c] - (x[n, t, c] - mean[c]) * inverse[c] * slope[c]
                )
                grad_x[n, t, c] = value
                total[c] += value
        of_bias += total
    return of_bias.astype(_F32), of_gamma.astype(_F32), of_beta.astype(_F32)
