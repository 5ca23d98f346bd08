"""Training of `BiTCN` on a CPU: the features of its branches, in few passes over memory.

Plain torch takes 1.3 to 1.75 times as long (batches of 30, three channels, one core). Convolutions
find the features of a step side by side, as the processor multiplies them. Normalization, ReLU and
dropout are compiled to one pass over the features for each mean that they need, and dropout draws
its random numbers within such a pass.
"""

from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from swashtwin.foundation import compiled
from swashtwin.learning.networks.residual_branch import Branch, ResidualUnit, SqueezeExcitation

_U32 = np.uint32
_F32 = np.float32
_ZERO = _F32(0)


def fused_encoding(
    positive: Branch,
    inverse: Branch | None,
    skip: nn.Conv1d,
    windows: Float[Tensor, "window channel time"],
) -> Float[Tensor, "window feature"]:
    """Return what `BiTCN.encode` returns of whole patches in training, up to rounding.

    Dropout follows the same law with other random numbers.
    """
    fused = _branch_features(positive, windows)
    if inverse is not None:
        fused = fused + _branch_features(inverse, windows.flip(-1)).flip(1)
    return (fused + _patch_features(skip, windows)).relu_().mean(dim=1)


def _branch_features(
    branch: Branch, windows: Float[Tensor, "window channel time"]
) -> Float[Tensor, "window step feature"]:
    """Return the features of a branch."""
    features = _patch_features(branch.entry, windows)
    for unit in branch.units:
        assert isinstance(unit, ResidualUnit)
        features = _unit_features(unit, features)
    return _convolve(branch.exit, features)


def _unit_features(
    unit: ResidualUnit, features: Float[Tensor, "window step feature_in"]
) -> Float[Tensor, "window step feature_out"]:
    """Return the features of a residual unit."""
    normalization = unit.normalization
    padded = functional.pad(features, (0, 0, *unit.padding))
    # Without the bias, which `_Activation` only needs for the running mean.
    convolved = _convolve(unit.convolution, padded, with_bias=False)
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
    skipped = features
    if not isinstance(unit.skip, nn.Identity):
        skipped = _convolve(unit.skip, features)
    return (active + skipped).relu_()


def _patch_features(
    convolution: nn.Conv1d, windows: Float[Tensor, "window channel time"]
) -> Float[Tensor, "window step feature"]:
    """Return the convolution of patches that do not overlap."""
    patches = windows.unflatten(-1, (-1, convolution.stride[0])).permute(0, 2, 1, 3).flatten(2)
    return functional.linear(patches, convolution.weight.flatten(1), convolution.bias)


def _convolve(
    convolution: nn.Conv1d, x: Float[Tensor, "window step feature_in"], with_bias: bool = True
) -> Float[Tensor, "window shorter feature_out"]:
    """Return the convolution over the steps."""
    # One row of pixels: torch knows images that hold the features last, but no such signals.
    image = x.transpose(1, 2).unsqueeze(2)
    bias = convolution.bias if with_bias else None
    convolved = functional.conv2d(
        image, convolution.weight.unsqueeze(2), bias, dilation=(1, *convolution.dilation)
    )
    return convolved.squeeze(2).transpose(1, 2)


class _Activation(torch.autograd.Function):
    """Batch normalization of a convolution, ReLU and dropout, and the mean over the steps.

    The bias of the convolution only shifts the running mean: normalization removes it.
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
        n_windows, n_steps, n_features = x.shape
        mean, variance = _moments(_as_array(x))
        _update_running_moments(
            normalization,
            torch.from_numpy(mean) + bias,
            torch.from_numpy(variance),
            n_windows * n_steps,
        )

        # Normalization and the gain of dropout are one multiplication and one addition.
        inverse = 1 / np.sqrt(variance + normalization.eps)
        gain = 1 / (1 - dropout)
        scale = gain * inverse * gamma.numpy()
        shift = gain * beta.numpy() - mean * scale

        active = torch.empty_like(x)
        mean_active = torch.empty(n_windows, n_features)
        seed = int(torch.randint(2**32, ()))
        _activate(
            _as_array(x),
            scale.astype(_F32),
            shift.astype(_F32),
            _as_array(active),
            mean_active.numpy(),
            _U32(seed),
            _U32(dropout * 2**32),
        )
        ctx.save_for_backward(x, active, gamma)
        ctx.factors = mean.astype(_F32), inverse.astype(_F32), _F32(gain)
        return active, mean_active

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        x, active, gamma = ctx.saved_tensors
        grad_x = torch.empty_like(x)
        gradients = _activate_backward(
            _as_array(grads[0].contiguous()),
            _as_array(grads[1]),
            _as_array(x),
            _as_array(active),
            _as_array(gamma),
            _as_array(grad_x),
            *ctx.factors,
        )
        bias_gradient, gamma_gradient, beta_gradient = map(torch.from_numpy, gradients)
        return grad_x, bias_gradient, gamma_gradient, beta_gradient, None, None


def _update_running_moments(
    normalization: nn.BatchNorm1d, mean: Tensor, variance: Tensor, count: int
) -> None:
    """Move the running moments as `torch.nn.BatchNorm1d` does."""
    assert normalization.momentum is not None
    unbiased = variance * count / (count - 1)
    for name, value in (("running_mean", mean), ("running_var", unbiased)):
        normalization.get_buffer(name).lerp_(value.float(), normalization.momentum)
    normalization.get_buffer("num_batches_tracked").add_(1)


def _as_array(tensor: Tensor) -> np.ndarray:
    """Return the numbers of a tensor, which share its memory."""
    return tensor.detach().numpy()


@compiled
@no_type_check
def _moments(x):
    """Return mean and variance of each feature.

    Deviations are from the first entry: squares of a large mean would lose the variance.
    """
    windows, steps, features = x.shape
    pivot = np.empty(features, _F32)
    for c in range(features):
        pivot[c] = x[0, 0, c]

    total = np.zeros(features)
    square = np.zeros(features)
    for n in range(windows):
        first = np.zeros(features, _F32)
        second = np.zeros(features, _F32)
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
def _activate(x, scale, shift, active, mean, seed, threshold):
    """Fill in what is active after ReLU and dropout, and its mean over the steps.

    The random number of an entry is a hash of its index and the seed (the multipliers are of C.
    Wellons, "Prospecting for hash functions", 2018); an entry below `threshold` is dropped.
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
                value = value if value > _ZERO and draw >= threshold else _ZERO
                active[n, t, c] = value
                total[c] += value
        for c in range(features):
            mean[n, c] = total[c] / _F32(steps)


@compiled
@no_type_check
def _activate_backward(grad, grad_mean, x, active, gamma, grad_x, mean, inverse, gain):
    """Fill in the gradient of `x`, and return those of bias, gamma and beta.

    That of the convolution's bias is rounding only.
    """
    windows, steps, features = x.shape
    beta_gradient = np.zeros(features)
    gamma_gradient = np.zeros(features)
    bias_gradient = np.zeros(features)
    for n in range(windows):
        plain = np.zeros(features, _F32)
        weighted = np.zeros(features, _F32)
        for t in range(steps):
            for c in range(features):
                passed = (grad[n, t, c] + grad_mean[n, c] / _F32(steps)) * gain
                passed = passed if active[n, t, c] > _ZERO else _ZERO
                plain[c] += passed
                weighted[c] += passed * ((x[n, t, c] - mean[c]) * inverse[c])
        beta_gradient += plain
        gamma_gradient += weighted

    constant = (beta_gradient / (windows * steps)).astype(_F32)
    slope = (gamma_gradient / (windows * steps)).astype(_F32)
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
        bias_gradient += total
    return bias_gradient.astype(_F32), gamma_gradient.astype(_F32), beta_gradient.astype(_F32)
