"""Spectra of windows as periodic signals: amplitudes that a model can replace, measured phases.

A periodic extension covers whole revolutions and has no step between its end and its beginning. The
lines of its spectrum do not leak into each other, so one can be changed without the others.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.signal import resample
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression

from swashtwin.foundation import derive_seed
from swashtwin.learning import WindowSet
from swashtwin.signals import inverse_transform, transform

# Minimum share of a window for the seam of its extension.
_MIN_SEAM = 0.05

# Maximum share of an extension for the seam, which blends two revolutions.
_MAX_SEAM = 0.2

# Share of a window that an extension covers if it has no whole revolution.
_DEFAULT_SHARE = 0.9

# Amplitudes are not below this share of the largest: their logarithm stays finite.
_AMPLITUDE_FLOOR = 1e-5


def extension_length(windows: WindowSet, index: int) -> int:
    """Return the samples of a window's extension: the whole revolutions in 95 % of the window.

    It is 90 % of the window if the speed is unknown or the window is shorter than a revolution. The
    seam then joins parts of the signal that do not follow each other, still without a step.
    """
    speed = float(windows.speed[index])
    n_revolutions = 0
    if speed > 0:
        period = 2 * math.pi / speed * windows.sample_rate
        n_revolutions = math.floor((1 - _MIN_SEAM) * windows.length / period)

    if n_revolutions == 0:
        return round(_DEFAULT_SHARE * windows.length)
    return round(n_revolutions * period)


def close_period(
    window: Float[np.ndarray, "channel time"], length: int
) -> Float[np.ndarray, "channel angle"]:
    """Return the first `length` samples of a window, blended so that they repeat without a step.

    The samples beyond `length` belong to the same shaft angles as the first ones, and fade into
    them.
    """
    extension = window[..., :length].astype(float)
    seam = min(window.shape[-1] - length, int(_MAX_SEAM * length))
    fading = (1 + np.cos(np.pi * np.arange(seam) / seam)) / 2
    extension[..., :seam] += fading * (window[..., length : length + seam] - extension[..., :seam])
    return extension


def periodic_extensions(
    windows: WindowSet, indices: Int[np.ndarray, " index"], length: int
) -> Float[np.ndarray, "index channel angle"]:
    """Return periodic extensions of the windows at `indices`, resampled to `length` samples."""
    extensions = []
    for index in indices.tolist():
        extension = close_period(windows.signal[index], extension_length(windows, index))
        extensions.append(_resample(extension, length))

    return np.stack(extensions)


def _resample(
    extension: Float[np.ndarray, "channel angle"], length: int
) -> Float[np.ndarray, "channel {length}"]:
    if extension.shape[-1] == length:
        return extension
    return resample(extension, length, axis=-1)


def cut_extensions(
    extensions: Float[np.ndarray, "window channel angle"],
    like: WindowSet,
    sources: Int[np.ndarray, " window"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "window channel time"]:
    """Cut one window of each periodic extension, from a random angle.

    Parameters
    ----------
    like : windows that specify the length.
    sources : index in `like` of the window of each extension, which has its speed.
    """
    signal = np.empty((len(extensions), like.n_channels, like.length))
    for i, source in enumerate(sources.tolist()):
        length = extension_length(like, source)
        angles = (rng.integers(length) + np.arange(like.length)) % length
        signal[i] = _resample(extensions[i], length)[..., angles]

    return signal


def log_amplitude(
    signal: Float[np.ndarray, "window channel angle"],
) -> Float64[np.ndarray, "window value"]:
    """Return the natural logarithm of the amplitudes of each window, channel after channel."""
    amplitude = np.abs(transform(signal.astype(float))).reshape(len(signal), -1)
    return np.log(np.maximum(amplitude, _AMPLITUDE_FLOOR * amplitude.max()))


def with_amplitude(
    signal: Float[np.ndarray, "window channel angle"], amplitude: Float[np.ndarray, "window value"]
) -> Float[np.ndarray, "window channel angle"]:
    """Return `signal` with other amplitudes and its phases.

    Parameters
    ----------
    amplitude : natural logarithm, in the layout of `log_amplitude`.
    """
    phase = np.angle(transform(signal.astype(float)))
    spectrum = np.exp(amplitude.reshape(phase.shape) + 1j * phase)
    return inverse_transform(spectrum, signal.shape[-1])


@dataclass(frozen=True, eq=False)
class SpectralForm:
    """Model of the logarithmic amplitudes of windows by few numbers, the scores.

    A regression describes the effect of class and pressure on each line, principal components the
    residual. A generative model of the scores is small. The rest of the spectrum is noise that
    differs from line to line.
    """

    length: int
    """Samples of each extension."""
    expected: LinearRegression
    """Regression of the logarithmic amplitude of each line and channel on the condition."""
    components: Float64[np.ndarray, "component value"]
    """Principal components of the residual, of unit length."""
    deviation: Float64[np.ndarray, " component"]
    """Standard deviation of each component's scores before they are scaled."""

    @classmethod
    def fit(
        cls,
        extensions: Float[np.ndarray, "window channel angle"],
        condition: Float[np.ndarray, "window fact"],
        count: int,
        seed: int,
    ) -> "SpectralForm":
        """Fit the form on training windows, with `count` components or fewer for few windows."""
        points = log_amplitude(extensions)
        expected = LinearRegression().fit(condition, points)
        residual = points - expected.predict(condition)
        n_components = min(count, len(points) - 1, points.shape[1])
        random_state = derive_seed(seed, "components") % 2**32
        pca = PCA(n_components, svd_solver="randomized", random_state=random_state).fit(residual)
        deviation = np.sqrt(np.maximum(pca.explained_variance_, 1e-12))
        return cls(extensions.shape[-1], expected, pca.components_, deviation)

    def scores(
        self,
        extensions: Float[np.ndarray, "window channel angle"],
        condition: Float[np.ndarray, "window fact"],
    ) -> Float64[np.ndarray, "window component"]:
        """Return the scores of windows measured under `condition`.

        Their variance over the training windows is 1.
        """
        residual = log_amplitude(extensions) - self.expected.predict(condition)
        return residual @ self.components.T / self.deviation

    def rebuild(
        self,
        scores: Float[np.ndarray, "window component"],
        new_condition: Float[np.ndarray, "window fact"],
        extensions: Float[np.ndarray, "window channel angle"],
        condition: Float[np.ndarray, "window fact"],
    ) -> Float[np.ndarray, "window channel angle"]:
        """Return extensions with these scores under `new_condition`.

        Parameters
        ----------
        extensions : measured extensions, whose phases and noise are kept.
        condition : condition of `extensions`.
        """
        change = (scores - self.scores(extensions, condition)) * self.deviation @ self.components
        change += self.expected.predict(new_condition) - self.expected.predict(condition)
        return with_amplitude(extensions, log_amplitude(extensions) + change)
