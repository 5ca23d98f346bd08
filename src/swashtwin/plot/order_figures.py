"""Spectra that change: over the turns of one recording, and from recording to recording."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from swashtwin.foundation import InputError
from swashtwin.plot.signal_figures import unit_words
from swashtwin.plot.style import CALIBRATED, LIGHT, MEASURED, figure_style, panels, words
from swashtwin.recordings import Recording
from swashtwin.signals import ShaftAngle, resampled_by_angle, spectrum_of, stated_angle, tapered_transform

_RANGE_DB = 60.0
"""Levels are shown so far below the greatest [dB]."""
_STRETCHES = 12
"""Stretches that a single recording is cut into for a waterfall."""
_MOST_POINTS = 1500


@figure_style()
def order_map(
    recording: Recording,
    *,
    channel: str | None = None,
    angle: ShaftAngle | None = None,
    pistons: int | None = None,
    turns: int = 16,
    top: float | None = None,
) -> Figure:
    """Level of each order of the shaft [dB] over time [s], one channel; for run-ups and speeds that wander.

    The samples are resampled along the shaft's angle, so that what turns with the shaft stays at its order and what
    does not, such as a resonance, moves. Hann taper, amplitudes of half-overlapping stretches of whole turns.

    Parameters
    ----------
    channel : name of the channel; the first by default.
    angle : shaft angle from a tachometer or a followed line; by default from the recording's own or stated speed.
    pistons : number of pistons z, to mark z, 2 z, ...
    turns : turns of the shaft in each stretch; lines are 1 / turns of an order apart.
    top : highest order shown; by default a little above five times the pistons, or 40.

    Raises
    ------
    InputError
        No speed is stated, the recording covers fewer turns than two stretches, or it has no such channel.

    Examples
    --------
    >>> from swashtwin.foundation import MPa, rpm
    >>> from swashtwin.pump import OperatingCondition
    >>> at = OperatingCondition(rpm(600), MPa(10))
    >>> wave = np.sin(2 * np.pi * 70 * np.arange(20000) / 2000)[None]
    >>> order_map(Recording(wave, 2000.0, "a", condition=at), turns=8, top=20).axes[0].get_xlabel()
    'order of the shaft'
    """
    name = channel or recording.channels[0]
    if name not in recording.channels:
        raise InputError(f"{recording.recording_id} has no channel {name!r}; it has {', '.join(recording.channels)}.")
    shaft_angle = stated_angle(recording) if angle is None else angle
    highest = float(top or (5.4 * pistons if pistons else 40))
    per_turn = 2 * math.ceil(min(highest / 0.8, recording.sample_rate * math.pi / float(shaft_angle.speed.max())))
    turned = resampled_by_angle(recording, shaft_angle, max(per_turn, 4))
    length = turns * max(per_turn, 4)
    starts = np.arange(0, turned.n_samples - length + 1, length // 2)
    if len(starts) < 2:
        raise InputError(
            f"{recording.recording_id} covers {shaft_angle.turns:.3g} turns, and a map takes {2 * turns} at least; "
            f"record longer, or give fewer turns (now {turns})."
        )
    samples = turned.signal[recording.channels.index(name)]
    parts = np.stack([samples[start : start + length] for start in starts])
    level = _decibel(np.abs(tapered_transform(parts)) * 4 / length)
    order = np.arange(level.shape[1]) / turns
    time = np.interp((starts + length / 2) / max(per_turn, 4), _turn_of(shaft_angle), recording.time)
    shown = order <= highest
    figure, axes = panels(1, 1, 4.4)
    panel = axes[0, 0]
    peak = float(level[:, shown].max())
    image = panel.pcolormesh(order[shown], time, level[:, shown], cmap="viridis", vmin=peak - _RANGE_DB, vmax=peak)
    image.set_rasterized(True)
    panel.grid(False)
    for line in range(pistons, int(highest) + 1, pistons) if pistons else ():
        panel.axvline(line, color="white", linewidth=0.8, linestyle=":")
    panel.set(xlabel="order of the shaft", ylabel="time [s]", title=f"{words(name)}, {recording.recording_id}")
    figure.colorbar(image, ax=panel, label=f"level [dB re 1 {unit_words(recording.unit)}]")
    return figure


def _turn_of(angle: ShaftAngle) -> Float[np.ndarray, " time"]:
    """Turns of the shaft since the first whole one, at each sample."""
    first = math.ceil(angle.angle[0] / (2 * math.pi) - 1e-9)
    return angle.angle / (2 * math.pi) - first


def _decibel(amplitude: np.ndarray) -> np.ndarray:
    return np.asarray(20 * np.log10(np.maximum(amplitude, 1e-12)))


@figure_style()
def waterfall(
    recordings: Recording | Sequence[Recording],
    *,
    channel: str | None = None,
    labels: Sequence[str] | None = None,
    top: float | None = None,
    resolution: float | None = None,
) -> Figure:
    """Amplitude spectra above one another, the first at the bottom: of recordings, or of stretches of one.

    Parameters
    ----------
    recordings : several, such as those of a series or of a run-up in steps; or one, which is cut into 12 stretches.
    channel : name of the channel; the first by default.
    labels : text beside each spectrum; by default the recording's name, or where a stretch begins.
    top : end of the axis [Hz]; by default a tenth of the sample rate.
    resolution : spacing of the lines [Hz]; by default 1/1000 of `top`.

    Raises
    ------
    InputError
        There is no recording, one has no such channel, or there are other labels than spectra.

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(size=(1, 24000))
    >>> len(waterfall(Recording(noise, 2000.0, "a")).axes[0].lines)
    12
    """
    series, names = _series(recordings)
    texts = list(labels) if labels is not None else names
    if len(texts) != len(series):
        raise InputError(f"{len(texts)} labels for {len(series)} spectra; give one for each.")
    end = float(top or series[0].sample_rate / 10)
    figure, axes = panels(1, 1, 1.4 + 0.34 * len(series))
    panel = axes[0, 0]
    curves = [_curve(recording, channel, end, resolution) for recording in series]
    step = 0.45 * max(float(np.ptp(level)) for _, level in curves)
    for index, (text, (frequency, level)) in enumerate(zip(texts, curves, strict=True)):
        lift, height = index * step, level - np.median(curves[0][1])
        front = len(curves) - index
        panel.fill_between(
            frequency, lift + height, height.min() + lift - step, color="white", linewidth=0, zorder=front
        )
        shade = CALIBRATED if index == len(curves) - 1 else MEASURED
        panel.plot(frequency, lift + height, color=shade, linewidth=0.8, zorder=front)
        panel.annotate(text, (1.01, lift), xycoords=("axes fraction", "data"), va="center", fontsize=8)
    name = channel or series[0].channels[0]
    panel.set(xlabel="frequency [Hz]", xlim=(0, end), yticks=[], title=f"{words(name)}, {step:.0f} dB between spectra")
    panel.grid(axis="x", color=LIGHT)
    return figure


def _series(recordings: Recording | Sequence[Recording]) -> tuple[list[Recording], list[str]]:
    """(recordings or stretches of one, a text for each)."""
    if not isinstance(recordings, Recording):
        series = list(recordings)
        if not series:
            raise InputError("a waterfall needs a recording at least.")
        return series, [recording.recording_id for recording in series]
    length = recordings.n_samples // _STRETCHES
    starts = [index * length for index in range(_STRETCHES)]
    parts = [recordings.slice(start, start + length) for start in starts]
    return parts, [f"{start / recordings.sample_rate:.3g} s" for start in starts]


def _curve(
    recording: Recording, channel: str | None, end: float, resolution: float | None
) -> tuple[Float[np.ndarray, " line"], Float[np.ndarray, " line"]]:
    """(frequency [Hz], level [dB]) of one channel up to `end`."""
    name = channel or recording.channels[0]
    if name not in recording.channels:
        raise InputError(f"{recording.recording_id} has no channel {name!r}; it has {', '.join(recording.channels)}.")
    spacing = max(resolution or end / 1000, 1 / recording.duration)
    lines = spectrum_of(recording.picked([name]), resolution=spacing)
    shown = (lines.position > 0) & (lines.position <= end)
    frequency, amplitude = lines.position[shown], lines.amplitude[0, shown]
    group = max(1, math.ceil(len(frequency) / _MOST_POINTS))
    starts = np.arange(0, len(frequency), group)
    return frequency[starts], _decibel(np.maximum.reduceat(amplitude, starts))
