"""Rings as spectra: amplitudes that can be made anew, phases that are kept as measured.

A ring has no step where its end meets its beginning, so the lines of its spectrum do not leak into each other, and one
can be changed without the others.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression

from swashtwin.foundation import derive_seed


def log_amplitude(signal: Float[np.ndarray, "window channel angle"]) -> Float64[np.ndarray, "window value"]:
    """Natural logarithm of the amplitudes of each window's spectrum, channel after channel in one row."""
    amplitude = np.abs(np.fft.rfft(signal.astype(float), axis=-1)).reshape(len(signal), -1)
    return np.log(np.maximum(amplitude, 1e-5 * amplitude.max()))


def with_amplitude(
    signal: Float[np.ndarray, "window channel angle"], amplitude: Float[np.ndarray, "window value"]
) -> Float[np.ndarray, "window channel angle"]:
    """`signal` with other amplitudes, whose logarithms stand as `log_amplitude` gives them, and with its own phases."""
    phase = np.angle(np.fft.rfft(signal.astype(float), axis=-1))
    wanted = np.exp(amplitude.reshape(phase.shape) + 1j * phase)
    return np.fft.irfft(wanted, signal.shape[-1], axis=-1)


@dataclass(frozen=True, eq=False)
class SpectralForm:
    """What windows have in common and how they differ, in the logarithms of their amplitudes.

    First what class and pressure add to every line, each by itself; then the principal components of what is left. A
    window is told by few numbers, the scores, so that a generative model of them is small. The rest of its spectrum is
    noise from line to line.
    """

    length: int
    """Readings of each ring."""
    expected: LinearRegression
    """Logarithm of the amplitude at each line of each channel, from the condition."""
    components: Float64[np.ndarray, "component value"]
    """Principal components of what is left, of unit length."""
    deviation: Float64[np.ndarray, " component"]
    """Standard deviation of each component's scores before they are scaled."""

    @classmethod
    def fitted(
        cls,
        rings: Float[np.ndarray, "window channel angle"],
        condition: Float[np.ndarray, "window fact"],
        count: int,
        seed: int,
    ) -> "SpectralForm":
        """The form of training windows with `count` components, or as many as their number allows."""
        points = log_amplitude(rings)
        expected = LinearRegression().fit(condition, points)
        left = points - expected.predict(condition)
        kept = min(count, len(points) - 1, points.shape[1])
        found = PCA(kept, svd_solver="randomized", random_state=derive_seed(seed, "components") % 2**32).fit(left)
        deviation = np.sqrt(np.maximum(found.explained_variance_, 1e-12))
        return cls(rings.shape[-1], expected, found.components_, deviation)

    def scores(
        self, rings: Float[np.ndarray, "window channel angle"], condition: Float[np.ndarray, "window fact"]
    ) -> Float64[np.ndarray, "window component"]:
        """Scores of windows measured under `condition`, of unit variance over the training windows."""
        return (log_amplitude(rings) - self.expected.predict(condition)) @ self.components.T / self.deviation

    def rebuilt(
        self,
        scores: Float[np.ndarray, "window component"],
        asked: Float[np.ndarray, "window fact"],
        rings: Float[np.ndarray, "window channel angle"],
        condition: Float[np.ndarray, "window fact"],
    ) -> Float[np.ndarray, "window channel angle"]:
        """Rings of other scores under the condition `asked`, with the phases and the noise of `rings`.

        Parameters
        ----------
        condition : under which `rings` were measured.
        """
        change = (scores - self.scores(rings, condition)) * self.deviation @ self.components
        change += self.expected.predict(asked) - self.expected.predict(condition)
        return with_amplitude(rings, log_amplitude(rings) + change)
