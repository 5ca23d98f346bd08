"""Whether recordings are fit to calibrate on, beside what `recordings.checks` refuses of any
recording.

The lines of a pump stand at multiples of the piston count times the shaft frequency. They form a
comb: only at the true speed do all its teeth meet lines and all gaps between them none. So a
wrongly stated speed shows.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording, count_clipped_samples
from swashtwin.signals import OrderSpectrum, order_spectrum, power_density

MOST_CLIPPED = 0.01
"""Share of clipped samples from which a recording is refused: on the virtual rig its lines are then
3 % off in the sum (0.3 % of samples: 0.5 %; 3 %: 17 %).
"""
LEAST_CLEARNESS = 4.0
"""Least mean square of a recording's lines over their deviations: noise alone has 2, the virtual
rig 1700 and more.
"""
ODD_LEVEL, ODD_DEVIATIONS = 1.5, 3.0
"""A recording's level is odd where it differs from the others' mean by more than this factor, and
by more than so many of their standard deviations.
"""
_LEAST_SCATTER = 0.1
"""Standard deviation of ln(level) that repeated recordings of one pump have at least."""


def require_one_machine(recordings: Iterable[Recording], thing: str) -> None:
    """Refuse recordings that state several specimens, with a `DataError` that names them: the thing
    is of one pump.
    """
    specimens = sorted(
        {recording.specimen for recording in recordings if recording.specimen is not None}
    )
    if len(specimens) > 1:
        raise DataError(
            f"recordings of {len(specimens)} machines ({', '.join(specimens[:4])}): {thing} belongs to one pump; "
            f'select its recordings: --specimen "{specimens[0]}", or the method where.'
        )


def clipping_note(recording: Recording) -> str | None:
    """Note on a recording with a few clipped samples, or None; a `DataError` from 1 % of a
    channel's samples on.
    """
    for name, row in zip(recording.channels, recording.signal, strict=True):
        share = count_clipped_samples(row) / len(row)
        where = f"{recording.recording_id}, {name}: {share:.2%} of the samples stand in a row at the extreme"
        if share >= MOST_CLIPPED:
            raise DataError(
                f"{where} ({np.abs(row).max():.4g} {recording.unit}): the range was exceeded, and no line is right; "
                "record with a wider range, or leave these channels out (channels = [...] in the index)."
            )
        if share:
            return f"{where}: the range was exceeded, and peaks are cut off."
    return None


def lines_of(
    recording: Recording, shaft_frequency: float, orders: Int[np.ndarray, " order"]
) -> OrderSpectrum:
    """Lines of a recording at `orders`; a `DataError` where it is too short, or holds nothing but
    noise there.
    """
    try:
        spectrum = order_spectrum(recording.signal, recording.sample_rate, shaft_frequency, orders)
    except InputError as cause:
        raise DataError(
            f"{recording.recording_id} ({recording.duration:.4g} s): {cause} Record longer, or leave it out."
        ) from cause
    ratio = spectrum.amplitude / np.maximum(spectrum.deviation, 1e-300)
    if float(np.mean(ratio**2)) < LEAST_CLEARNESS:
        raise DataError(
            f"{recording.recording_id}: no line stands clear of the noise at multiples of {orders[0]} times "
            f"{shaft_frequency:.4g} Hz (the strongest is {spectrum.amplitude.max():.3g} {recording.unit}); is the pump "
            "running, the sensor plugged in, the speed right? Leave it out."
        )
    return spectrum


def level_notes(
    recordings: Sequence[Recording], amplitudes: Float[np.ndarray, "recording channel order"]
) -> tuple[str, ...]:
    """Notes on recordings whose level is far from that of the others of the same pump at the same
    condition.

    A single recording does not show its pressure: pumps of one type differ in level by as much as a
    pressure changes it. Beside at least two others of the same specimen, another pressure shows as
    another level, and so does another gain."""
    level = np.log(np.sqrt((amplitudes**2).sum(axis=(1, 2))))
    notes = []
    for i, recording in enumerate(recordings):
        others = [
            j
            for j, other in enumerate(recordings)
            if j != i and other.specimen == recording.specimen
        ]
        if len(others) < 2:
            continue
        away = float(level[i] - level[others].mean())
        scatter = max(float(level[others].std(ddof=1)), _LEAST_SCATTER)
        if abs(away) > max(np.log(ODD_LEVEL), ODD_DEVIATIONS * scatter):
            assert recording.condition is not None  # a measurement holds none without
            notes.append(
                f"{recording.recording_id}: its lines are {np.exp(away):.2g} times those of the {len(others)} others "
                f"stated at {recording.condition.discharge_pressure / 1e6:.4g} MPa; another pressure, or another gain?"
            )
    return tuple(notes)


AGREEING = 0.0125
"""Relative difference of speed that is not looked into."""
REACH = 3.2
"""Other speeds are sought down to the stated one over this, and up to it times this."""
CLEAR = 0.8
"""Least contrast of a comb that is believed, in natural logarithms of power: a tooth is 3.5 dB
higher.
"""
SHARE = 0.6
"""The stated speed is refused where its comb has less than this share of the clearest one's
contrast. On the virtual rig (`docs/explanation/calibration.md`) rightly stated speeds have 0.9 and
more, wrong ones 0.46 and less.
"""
_AS_CLEAR = 0.8
_TEETH = 10
_WIDTH = 0.004
"""Half width of a tooth, relative: as much as the speed may wander."""
_BETWEEN = np.array([0, 1 / 3, 1 / 2, 2 / 3])
"""A tooth, and the places between it and the next at which the combs of a half or a third of the
speed have teeth.
"""


@dataclass(frozen=True)
class DetectedSpeed:
    """Which speed a recording's piston-pass lines show."""

    stated: float
    """Shaft frequency that was stated [Hz]."""
    shown: float
    """Shaft frequency whose comb is clearest [Hz]; the lowest where several are."""
    stated_contrast: float
    """How far lines at the teeth of the stated speed's comb rise above what lies between, mean of
    ln power.
    """
    shown_contrast: float
    """The same of the clearest comb."""

    @property
    def is_clear(self) -> bool:
        """Whether the lines show a speed at all."""
        return self.shown_contrast > CLEAR

    @property
    def contradicts(self) -> bool:
        """Whether the lines clearly show another speed than the stated one."""
        return self.is_clear and self.stated_contrast < SHARE * self.shown_contrast


def detect_speed(recording: Recording, shaft_frequency: float, piston_count: int) -> DetectedSpeed:
    """The speed that the recording's lines show beside the one that is stated.

    The contrast of a comb is the mean over its first ten teeth of the level there (ln of the power
    over the median of its surroundings, averaged over channels) less the highest level at a third,
    a half and two thirds of the way to the next tooth. It is taken over the odd and over the even
    teeth, and the lesser of both counts: half of the teeth of the combs of half and of three halves
    of the true speed meet lines.

    Parameters
    ----------
    shaft_frequency : as stated [Hz].
    piston_count : number of pistons.
    """
    step, level = _levels(recording, shaft_frequency * piston_count)
    near = shaft_frequency * np.linspace(1 - AGREEING, 1 + AGREEING, 26)
    wide = shaft_frequency * np.exp(np.arange(-np.log(REACH), np.log(REACH), 0.001))
    frequencies = np.concatenate([near, wide])
    contrast = _contrast(step, level, piston_count * frequencies)
    clear = frequencies[
        contrast >= _AS_CLEAR * contrast.max()
    ].min()  # five times the true speed has a comb as clear
    shown = frequencies[
        np.argmax(np.where(frequencies < clear * (1 + 2 * AGREEING), contrast, -np.inf))
    ]
    return DetectedSpeed(
        shaft_frequency, float(shown), float(contrast[: len(near)].max()), float(contrast.max())
    )


def refuse_other_speed(recording: Recording, shaft_frequency: float, piston_count: int) -> None:
    """Refuse a recording whose lines show another speed than it states with a `DataError` that
    names both.

    A recording whose speed was measured along with it, or whose lines show nothing clearly, passes.
    """
    if recording.speed is not None:
        return
    speed = detect_speed(recording, shaft_frequency, piston_count)
    if speed.contradicts:
        raise DataError(
            f"{recording.recording_id}: stated at {60 * speed.stated:.4g} rev/min, but its piston-pass lines are "
            f"those of a pump with {piston_count} pistons at {60 * speed.shown:.4g} rev/min; correct the speed (or the "
            f"sample rate of {recording.sample_rate:g} Hz, or the pump's piston count)."
        )


def _levels(recording: Recording, spacing: float) -> tuple[float, Float[np.ndarray, " frequency"]]:
    """Step of the frequencies [Hz], and ln of the power over the median around, averaged over the
    channels.
    """
    rate = recording.sample_rate
    frequency, power = power_density(recording.signal, rate)
    power = power[:, frequency <= min(0.45 * rate, (_TEETH + 6) * spacing)]
    width = max(8, round(spacing / frequency[1]))
    blocks = np.array_split(np.arange(power.shape[1]), max(1, power.shape[1] // width))
    middles = [block.mean() for block in blocks]
    medians = np.stack([np.median(power[:, block], axis=1) for block in blocks], axis=1)
    indices = np.arange(power.shape[1])
    base = np.stack([np.interp(indices, middles, row) for row in medians])
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
    odd, even = (
        rise[:, start::2].sum(axis=1) / np.maximum(within[:, start::2].sum(axis=1), 1)
        for start in (0, 1)
    )
    return np.where(within[:, 1], np.minimum(odd, even), 0.0)
