"""Whether a recording shows the speed that is stated for it.

The lines of a pump stand at multiples of the piston count times the shaft frequency: a comb, of which the true speed
alone lets all teeth meet lines and all places between them none.
"""

from dataclasses import dataclass

import numpy as np
import scipy.signal
from jaxtyping import Float

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording

AGREEING = 0.0125
"""Relative difference of speed that is not looked into."""
REACH = 3.2
"""Other speeds are sought down to the stated one over this, and up to it times this."""
CLEAR = 0.8
"""Least contrast of a comb that is believed, in natural logarithms of power: a tooth is 3.5 dB higher."""
SHARE = 0.6
"""The stated speed is refused where its comb has less than this share of the clearest one's contrast. On the virtual
rig (`docs/calibration.md`) rightly stated speeds have 0.9 and more, wrong ones 0.46 and less."""
_AS_CLEAR = 0.8
_TEETH = 10
_WIDTH = 0.004
"""Half width of a tooth, relative: as much as the speed may wander."""
_BETWEEN = np.array([0, 1 / 3, 1 / 2, 2 / 3])
"""A tooth, and the places between it and the next at which the combs of a half or a third of the speed have teeth."""


@dataclass(frozen=True)
class ShownSpeed:
    """Which speed a recording's piston-pass lines show."""

    stated: float
    """Shaft frequency that was stated [Hz]."""
    shown: float
    """Shaft frequency whose comb is clearest [Hz]; the lowest where several are."""
    stated_contrast: float
    """How far lines at the teeth of the stated speed's comb rise above what lies between, mean of ln power."""
    shown_contrast: float
    """The same of the clearest comb."""

    @property
    def contradicts(self) -> bool:
        """Whether the lines clearly show another speed than the stated one."""
        return self.shown_contrast > CLEAR and self.stated_contrast < SHARE * self.shown_contrast


def shown_speed(recording: Recording, shaft_frequency: float, piston_count: int) -> ShownSpeed:
    """The speed that the recording's lines show beside the one that is stated.

    The contrast of a comb is the mean over its first ten teeth of the level there (ln of the power over the median of
    its surroundings, averaged over channels) less the highest level at a third, a half and two thirds of the way to the
    next tooth. It is taken over the odd and over the even teeth, and the lesser of both counts: half of the teeth of
    the combs of half and of three halves of the true speed meet lines.

    Parameters
    ----------
    shaft_frequency : as stated [Hz].
    piston_count : number of pistons.
    """
    step, level = _levels(recording, shaft_frequency * piston_count)
    near = shaft_frequency * np.linspace(1 - AGREEING, 1 + AGREEING, 26)
    wide = shaft_frequency * np.exp(np.arange(-np.log(REACH), np.log(REACH), 0.001))
    tried = np.concatenate([near, wide])
    contrast = _contrast(step, level, piston_count * tried)
    clear = tried[contrast >= _AS_CLEAR * contrast.max()].min()  # five times the true speed has a comb as clear
    shown = tried[np.argmax(np.where(tried < clear * (1 + 2 * AGREEING), contrast, -np.inf))]
    return ShownSpeed(shaft_frequency, float(shown), float(contrast[: len(near)].max()), float(contrast.max()))


def refuse_other_speed(recording: Recording, shaft_frequency: float, piston_count: int) -> None:
    """Nothing, or the error that names the speed stated and the one that the lines show.

    A recording whose speed was measured along with it, or whose lines show nothing clearly, passes.

    Raises
    ------
    DataError
        The piston-pass lines are those of another speed.
    """
    if recording.speed is not None:
        return
    found = shown_speed(recording, shaft_frequency, piston_count)
    if found.contradicts:
        raise DataError(
            f"{recording.recording_id}: stated at {60 * found.stated:.4g} rev/min, but its piston-pass lines are "
            f"those of a pump with {piston_count} pistons at {60 * found.shown:.4g} rev/min; correct the speed (or the "
            f"sample rate of {recording.sample_rate:g} Hz, or the pump's piston count)."
        )


def _levels(recording: Recording, spacing: float) -> tuple[float, Float[np.ndarray, " frequency"]]:
    """Step of the frequencies [Hz], and ln of the power over the median around, averaged over the channels."""
    rate = recording.sample_rate
    frequency, power = scipy.signal.periodogram(recording.signal, rate, "hann", detrend="constant")
    power = power[:, frequency <= min(0.45 * rate, (_TEETH + 6) * spacing)]
    width = max(8, round(spacing / frequency[1]))
    blocks = np.array_split(np.arange(power.shape[1]), max(1, power.shape[1] // width))
    middles = [block.mean() for block in blocks]
    medians = np.stack([np.median(power[:, block], axis=1) for block in blocks], axis=1)
    places = np.arange(power.shape[1])
    base = np.stack([np.interp(places, middles, row) for row in medians])
    base = np.maximum(base, 1e-12 * power.max(axis=1, keepdims=True) + 1e-300)
    return float(frequency[1]), np.log(np.maximum(power / base, 1.0)).mean(axis=0)


def _contrast(
    step: float, level: Float[np.ndarray, " frequency"], spacing: Float[np.ndarray, " comb"]
) -> Float[np.ndarray, " comb"]:
    """Contrast of the combs with teeth at the multiples of each `spacing` [Hz]."""
    sums = np.concatenate([[0.0], np.cumsum(level)])
    center = (np.arange(1, _TEETH + 1)[:, None] + _BETWEEN) * spacing[:, None, None]
    half = np.maximum(1.5 * step, _WIDTH * center)
    first = np.rint((center - half) / step).astype(int)
    last = np.rint((center + half) / step).astype(int) + 1
    within = (last <= len(level)).all(axis=2)
    first, last = np.minimum(first, len(level) - 1), np.minimum(last, len(level))
    mean = (sums[last] - sums[first]) / np.maximum(last - first, 1)
    rise = np.where(within, mean[..., 0] - mean[..., 1:].max(axis=-1), 0.0)
    odd, even = (rise[:, start::2].sum(axis=1) / np.maximum(within[:, start::2].sum(axis=1), 1) for start in (0, 1))
    return np.where(within[:, 1], np.minimum(odd, even), 0.0)
