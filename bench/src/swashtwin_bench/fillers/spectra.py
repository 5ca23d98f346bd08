"""Spectra of windows as periodic signals of whole revolutions: amplitudes that a model can replace,
phases as measured.

A periodic extension has no step where its end meets its beginning. The lines of its spectrum do not
leak into each other, so that one can be changed without the others.
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

# Least share of a window that is used for the seam of its extension.
_SEAM = 0.05

# Greatest share of an extension that the seam takes.
_LONGEST_SEAM = 0.2


def extension_length(windows: WindowSet, index: int) -> int:
    """Samples in a period of a window's extension: the whole revolutions that leave 5 % of the
    window for the seam.

    It is 90 % of the window where no speed is known or the window is shorter than a revolution: the
    seam then joins parts that do not follow each other, still without a step.
    """
    speed = float(windows.speed[index])
    period = 2 * math.pi / speed * windows.sample_rate if speed > 0 else math.inf
    turns = math.floor((1 - _SEAM) * windows.length / period)
    return round(turns * period) if turns else round(0.9 * windows.length)


def close_period(
    window: Float[np.ndarray, "channel time"], length: int
) -> Float[np.ndarray, "channel angle"]:
    """The first `length` samples of a window, their beginning blended with the samples that follow
    their end.

    The samples beyond `length` belong to the same angles of the shaft as the first ones, which they
    fade into: the period repeats without a step.
    """
    extension = window[..., :length].astype(float)
    seam = min(window.shape[-1] - length, int(_LONGEST_SEAM * length))
    fading = (1 + np.cos(np.pi * np.arange(seam) / seam)) / 2
    extension[..., :seam] += fading * (window[..., length : length + seam] - extension[..., :seam])
    return extension


def periodic_extensions(
    windows: WindowSet, indices: Int[np.ndarray, " index"], length: int
) -> Float[np.ndarray, "index channel angle"]:
    """Periodic extensions of the windows at `indices`, each resampled to `length` samples."""
    return np.stack([_with_length(close_period(windows.signal[i], extension_length(windows, i)), length)
                     for i in indices.tolist()])  # fmt: skip


def _with_length(
    extension: Float[np.ndarray, "channel angle"], length: int
) -> Float[np.ndarray, "channel {length}"]:
    return extension if extension.shape[-1] == length else resample(extension, length, axis=-1)


def cut_extensions(
    extensions: Float[np.ndarray, "window channel angle"],
    like: WindowSet,
    sources: Int[np.ndarray, " window"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "window channel time"]:
    """One window of each periodic extension, from a random angle.

    Parameters
    ----------
    like : windows whose length is taken.
    sources : index of the window that each extension is of, whose speed it has.
    """
    signal = np.empty((len(extensions), like.n_channels, like.length))
    for i, source in enumerate(sources.tolist()):
        length = extension_length(like, source)
        angles = (rng.integers(length) + np.arange(like.length)) % length
        signal[i] = _with_length(extensions[i], length)[..., angles]
    return signal


def log_amplitude(
    signal: Float[np.ndarray, "window channel angle"],
) -> Float64[np.ndarray, "window value"]:
    """Natural logarithm of the amplitudes of each window's spectrum, channel after channel in one
    row.
    """
    amplitude = np.abs(transform(signal.astype(float))).reshape(len(signal), -1)
    return np.log(np.maximum(amplitude, 1e-5 * amplitude.max()))


def with_amplitude(
    signal: Float[np.ndarray, "window channel angle"], amplitude: Float[np.ndarray, "window value"]
) -> Float[np.ndarray, "window channel angle"]:
    """`signal` with other amplitudes, whose logarithms stand as `log_amplitude` gives them, and
    with its own phases.
    """
    phase = np.angle(transform(signal.astype(float)))
    spectrum = np.exp(amplitude.reshape(phase.shape) + 1j * phase)
    return inverse_transform(spectrum, signal.shape[-1])


@dataclass(frozen=True, eq=False)
class SpectralForm:
    """Model of the logarithms of windows' amplitudes by few numbers.

    A regression gives what class and pressure add to every line; principal components describe the
    residual. Few numbers, the scores, stand for a window, so that a generative model of them is
    small. The rest of its spectrum is noise from line to line.
    """

    length: int
    """Samples of each extension."""
    expected: LinearRegression
    """Logarithm of the amplitude at each line of each channel, from the condition."""
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
        """The form of training windows with `count` components, or as many as their number
        allows.
        """
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
        """Scores of windows measured under `condition`, of unit variance over the training
        windows.
        """
        return (
            (log_amplitude(extensions) - self.expected.predict(condition))
            @ self.components.T
            / self.deviation
        )

    def rebuild(
        self,
        scores: Float[np.ndarray, "window component"],
        new_condition: Float[np.ndarray, "window fact"],
        extensions: Float[np.ndarray, "window channel angle"],
        condition: Float[np.ndarray, "window fact"],
    ) -> Float[np.ndarray, "window channel angle"]:
        """Extensions of other scores under `new_condition`, with the phases and the noise of
        `extensions`.

        Parameters
        ----------
        condition : under which `extensions` were measured.
        """
        change = (scores - self.scores(extensions, condition)) * self.deviation @ self.components
        change += self.expected.predict(new_condition) - self.expected.predict(condition)
        return with_amplitude(extensions, log_amplitude(extensions) + change)
