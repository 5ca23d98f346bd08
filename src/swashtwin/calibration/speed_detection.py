"""The speed that a recording's piston-pass lines show.

The lines of a pump stand at multiples of the piston count times the shaft frequency. They form a
comb: only at the true speed do all its teeth meet lines and all gaps between them none. So a speed
that was specified wrongly can be detected.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, InputError
from swashtwin.pump import is_healthy
from swashtwin.recordings import Recording, specified_shaft_frequency
from swashtwin.signals import power_density

SPEED_TOLERANCE = 0.0125
"""Relative difference of speed within which the comb counts as that of the specified speed."""
SEARCH_FACTOR = 3.2
"""Other speeds are searched from the specified one divided by this to the one times this."""
MIN_CONTRAST = 0.8
"""Minimum contrast at which a comb is trusted, in natural logarithms of power: a tooth is 3.5 dB
higher.
"""
MIN_CONTRAST_SHARE = 0.6
"""The specified speed is refused if its comb has less than this share of the clearest one's
contrast. On the virtual rig (`docs/explanation/calibration.md`) correct speeds have 0.9 and more,
wrong ones 0.46 and less.
"""

PISTON_COUNTS = range(5, 12)
"""Numbers of pistons that axial piston pumps usually have."""

# Recordings whose lines are examined for the piston count, healthy ones first.
_MAX_EXAMINED = 3

# Turns of the shaft that a recording needs for its lines to be separated.
_MIN_TURNS = 12

# Combs of at least this share of the greatest contrast are as clear as the clearest one.
_TIE_SHARE = 0.8

_TEETH = 10

# Half width of a tooth, relative to its frequency: as much as the speed may wander.
_TOOTH_HALF_WIDTH = 0.004

# Positions at which power is compared, in teeth: a tooth, and where the combs of a half or a third
# of the speed have teeth between it and the next.
_TOOTH_OFFSETS = np.array([0, 1 / 3, 1 / 2, 2 / 3])


@dataclass(frozen=True)
class DetectedSpeed:
    """Which speed a recording's piston-pass lines show."""

    specified: float
    """Shaft frequency that was specified [Hz]."""
    detected: float
    """Shaft frequency whose comb is clearest [Hz]; the lowest of several that are as clear."""
    specified_contrast: float
    """How far lines at the teeth of the specified speed's comb rise above what lies between, mean
    of ln power.
    """
    detected_contrast: float
    """The same of the clearest comb."""

    @property
    def is_clear(self) -> bool:
        """Whether the lines show a speed at all."""
        return self.detected_contrast > MIN_CONTRAST

    @property
    def contradicts(self) -> bool:
        """Whether the lines clearly show another speed than the specified one."""
        return (
            self.is_clear and self.specified_contrast < MIN_CONTRAST_SHARE * self.detected_contrast
        )


def detect_speed(recording: Recording, shaft_frequency: float, piston_count: int) -> DetectedSpeed:
    """Return the speed that the recording's lines show, compared with the specified one.

    The contrast of a comb is the mean over its first ten teeth of the level there (ln of the power
    over the median of its surroundings, averaged over channels) less the highest level at a third,
    a half and two thirds of the way to the next tooth. It is taken over the odd and over the even
    teeth, and the smaller of both counts: half of the teeth of the combs of half and of three
    halves of the true speed meet lines.

    Parameters
    ----------
    shaft_frequency : as specified [Hz].
    piston_count : number of pistons.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        step, level = _compute_levels(recording, shaft_frequency * piston_count)
    if not np.isfinite(level).all():
        # Samples that are not finite, or far too large, show no lines.
        return DetectedSpeed(shaft_frequency, shaft_frequency, 0.0, 0.0)

    near_specified = shaft_frequency * np.linspace(1 - SPEED_TOLERANCE, 1 + SPEED_TOLERANCE, 26)
    log_reach = np.log(SEARCH_FACTOR)
    wide = shaft_frequency * np.exp(np.arange(-log_reach, log_reach, 0.001))
    frequencies = np.concatenate([near_specified, wide])
    contrast = _compute_contrast(step, level, piston_count * frequencies)

    # five times the true speed has a comb as clear: the lowest clear one is the speed
    lowest_clear = frequencies[contrast >= _TIE_SHARE * contrast.max()].min()
    is_near_lowest = frequencies < lowest_clear * (1 + 2 * SPEED_TOLERANCE)
    detected = frequencies[np.argmax(np.where(is_near_lowest, contrast, -np.inf))]

    return DetectedSpeed(
        specified=shaft_frequency,
        detected=float(detected),
        specified_contrast=float(contrast[: len(near_specified)].max()),
        detected_contrast=float(contrast.max()),
    )


def require_consistent_speed(
    recording: Recording, shaft_frequency: float, piston_count: int
) -> None:
    """Refuse a recording whose lines show another speed than the specified one.

    A recording whose speed was measured with it, or whose lines show no speed clearly, passes.

    Raises
    ------
    DataError
        The lines contradict the speed; the message names both.
    """
    if recording.speed is not None:
        return

    speed = detect_speed(recording, shaft_frequency, piston_count)
    if speed.contradicts:
        other_count = _find_piston_count(speed, piston_count)
        alternative = ""
        if other_count is not None:
            alternative = f", or with {other_count} pistons at the specified speed"
        raise DataError(
            f"{recording.recording_id}: the specified speed is {60 * speed.specified:.4g} rev/min, "
            f"but the piston-pass lines are those of a pump with {piston_count} pistons at "
            f"{60 * speed.detected:.4g} rev/min{alternative}. Correct the speed (or the sample "
            f"rate of {recording.sample_rate:g} Hz, or the pump's piston count).",
            field="speed",
        )


def require_piston_count(
    recordings: Sequence[Recording], piston_count: int, *, remedy: str
) -> None:
    """Refuse a piston count if the lines of one machine's recordings clearly show another one.

    The first recordings that specify a speed and have enough turns are examined, healthy ones
    first. They pass if the lines of one agree, or if none clearly shows another count.

    Parameters
    ----------
    remedy : sentence on what to correct; fields stand in braces.

    Raises
    ------
    InputError
        The lines show another piston count; the message names it.
    """
    contradiction: tuple[Recording, int] | None = None
    n_examined = 0
    for recording in sorted(recordings, key=lambda item: not is_healthy(item.label or "normal")):
        shaft_frequency = specified_shaft_frequency(recording)
        if not shaft_frequency or recording.duration * shaft_frequency < _MIN_TURNS:
            continue

        speed = detect_speed(recording, shaft_frequency, piston_count)
        if speed.is_clear and not speed.contradicts:
            return
        other_count = _find_piston_count(speed, piston_count)
        if speed.contradicts and other_count is not None and contradiction is None:
            contradiction = (recording, other_count)
        n_examined += 1
        if n_examined == _MAX_EXAMINED:
            break

    if contradiction is None:
        return
    recording, other_count = contradiction
    raise InputError(
        f"{recording.recording_id} has the piston-pass lines of a pump with {other_count} pistons "
        f"at the specified speed, not of one with {piston_count}.",
        remedy=remedy,
    )


def _find_piston_count(speed: DetectedSpeed, piston_count: int) -> int | None:
    """Return the number of pistons whose lines would stand where those of the detected speed do, if
    the specified speed is right; `None` if there is no other such number.
    """
    exact_count = piston_count * speed.detected / speed.specified
    count = round(exact_count)
    if count == piston_count or count not in PISTON_COUNTS:
        return None
    if abs(exact_count / count - 1) > SPEED_TOLERANCE:
        return None
    return count


def _compute_levels(
    recording: Recording, spacing: float
) -> tuple[float, Float[np.ndarray, " frequency"]]:
    """Return the step of the frequencies [Hz], and ln of the power over the median around,
    averaged over the channels.
    """
    rate = recording.sample_rate
    frequency, power = power_density(recording.signal, rate)
    step = float(frequency[1])
    power = power[:, frequency <= min(0.45 * rate, (_TEETH + 6) * spacing)]

    # blocks of one tooth spacing: their medians follow the noise, not the lines
    width = max(8, round(spacing / step))
    indices = np.arange(power.shape[1])
    blocks = np.array_split(indices, max(1, power.shape[1] // width))
    middles = [block.mean() for block in blocks]
    medians = np.stack([np.median(power[:, block], axis=1) for block in blocks], axis=1)
    base = np.stack([np.interp(indices, middles, row) for row in medians])
    # a silent or noiseless stretch has no median to divide by
    base = np.maximum(base, 1e-12 * power.max(axis=1, keepdims=True) + 1e-300)

    return step, np.log(np.maximum(power / base, 1.0)).mean(axis=0)


def _compute_contrast(
    step: float, level: Float[np.ndarray, " frequency"], spacing: Float[np.ndarray, " comb"]
) -> Float[np.ndarray, " comb"]:
    """Return the contrast of the combs with teeth at the multiples of each `spacing` [Hz]."""
    center = (np.arange(1, _TEETH + 1)[:, None] + _TOOTH_OFFSETS) * spacing[:, None, None]
    half_width = np.maximum(1.5 * step, _TOOTH_HALF_WIDTH * center)
    first = np.rint((center - half_width) / step).astype(int)
    last = np.rint((center + half_width) / step).astype(int) + 1
    is_within = (last <= len(level)).all(axis=2)

    # mean level of each tooth and gap, from cumulative sums
    first = np.minimum(first, len(level) - 1)
    last = np.minimum(last, len(level))
    sums = np.concatenate([[0.0], np.cumsum(level)])
    mean = (sums[last] - sums[first]) / np.maximum(last - first, 1)
    rise = np.where(is_within, mean[..., 0] - mean[..., 1:].max(axis=-1), 0.0)

    def mean_rise(teeth: slice) -> np.ndarray:
        total: np.ndarray = rise[:, teeth].sum(axis=1)
        return total / np.maximum(is_within[:, teeth].sum(axis=1), 1)

    # every other tooth of the combs of half and of three halves of the speed meets a line
    contrast = np.minimum(mean_rise(slice(0, None, 2)), mean_rise(slice(1, None, 2)))
    return np.where(is_within[:, 1], contrast, 0.0)
