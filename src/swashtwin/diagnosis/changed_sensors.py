"""Sentences on sensors, or a specified speed, that do not fit the healthy recordings of a prior.

No fault lowers the noise floor of a sensor, and none changes all bands of a sensor alike. A dead
sensor, a filter, a loose mounting, another gain and an exchanged cable do. No fault lowers the
lines of the piston passes either: they lie elsewhere if the pump ran at another speed. A speed is
named only if the lines at it are as strong as the healthy ones, since lines of shaft orders can lie
there too.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from swashtwin.diagnosis.prior_head import OrderSpectrum
from swashtwin.learning import common_shift
from swashtwin.signals import OrderBands

# Fall of a noise floor that no fault causes [dB], and in healthy standard deviations. On version 1
# of the rig, no floor of 150 healthy and faulty recordings fell by more than 2.7 dB.
_MIN_FALL_DB = 6.0
_MIN_FALL_SPREADS = 5.0

# First piston passes whose lines are compared, and their mean fall [dB] that no fault causes. On
# version 1 of the rig, that of 150 healthy and faulty recordings was up to 3 dB, and that of
# recordings at another speed 8 dB or more. At the speed that the lines show it is up to 1 dB if
# that is the true one, and 7 dB or more if only lines of shaft orders lie there.
_N_PASSES = 5
_MIN_PASS_FALL_DB = 6.0


@dataclass(frozen=True, eq=False)
class HealthyComparison:
    """A recording beside the healthy ones of its machine and operating point."""

    change: Float64[np.ndarray, "channel level"]
    """Change of each band power [log10]; 0 for one that the healthy recordings lack."""
    spectrum: OrderSpectrum
    """Order spectrum of the recording."""
    healthy_mean: Float64[np.ndarray, "channel level"]
    """Mean band powers of the healthy recordings [log10 of the squared unit]."""
    n_references: int
    """Number of these."""


def describe_mismatch(
    comparison: HealthyComparison,
    scatter: Float64[np.ndarray, "channel level"],
    channels: tuple[str, ...],
    specified_rpm: float,
) -> tuple[str, ...]:
    """Return why a recording cannot be compared with the healthy ones; nothing if it can.

    Parameters
    ----------
    scatter : healthy standard deviation of each band power [log10]; 0 for one that is not used.
    specified_rpm : specified speed [rev/min].
    """
    # At a wrong speed, other lines lie in each band, as if sensors had changed. So the speed that
    # the lines show comes first.
    return (
        _describe_other_speed(comparison, scatter, specified_rpm)
        or _describe_changed_sensors(
            comparison.change, scatter, comparison.spectrum.bands, channels
        )
        or _describe_lost_passes(comparison.change, scatter, comparison.spectrum.bands)
    )


def _describe_other_speed(
    comparison: HealthyComparison,
    scatter: Float64[np.ndarray, "channel level"],
    specified_rpm: float,
) -> tuple[str, ...]:
    """Return a sentence on the speed that the piston passes show, if they are all there."""
    spectrum = comparison.spectrum
    speed_ratio = spectrum.find_other_speed()
    if speed_ratio is None:
        return ()

    change = spectrum.band_powers(speed_ratio) - comparison.healthy_mean
    if _pass_fall(change, scatter, spectrum.bands) >= _MIN_PASS_FALL_DB:
        return ()
    sentence = (
        f"The lines of the piston passes are those of {speed_ratio * specified_rpm:.4g} rev/min, "
        "not of the specified speed. Correct the specified speed or sample rate."
    )
    return (sentence,)


def _describe_changed_sensors(
    change: Float64[np.ndarray, "channel level"],
    scatter: Float64[np.ndarray, "channel level"],
    bands: OrderBands,
    channels: tuple[str, ...],
) -> tuple[str, ...]:
    """Return a sentence for each channel whose sensor changed."""
    sentences = []
    for name, channel_change, channel_scatter in zip(channels, change, scatter, strict=True):
        is_used = channel_scatter > 0
        shift = float(common_shift(10 * channel_change[is_used])) if is_used.any() else 0.0
        if shift:
            sentences.append(
                f"All bands of channel {name} changed by {shift:+.0f} dB alike, which no fault "
                "does. Check its gain, its unit and its mounting."
            )
        else:
            n_floors = bands.n_floors
            sentences += _describe_fallen_floor(
                name, channel_change[-n_floors:], channel_scatter[-n_floors:], bands
            )
    return tuple(sentences)


def _describe_fallen_floor(
    name: str,
    change: Float64[np.ndarray, " floor"],
    scatter: Float64[np.ndarray, " floor"],
    bands: OrderBands,
) -> tuple[str, ...]:
    """Return a sentence on the noise floor of a channel that fell most, if one fell."""
    is_used = scatter > 0
    spreads = np.divide(change, scatter, out=np.zeros(change.shape), where=is_used)
    has_fallen = (10 * change <= -_MIN_FALL_DB) & (spreads <= -_MIN_FALL_SPREADS)
    if not has_fallen.any():
        return ()

    index = int(np.where(has_fallen, change, 0.0).argmin())
    low, high = bands.edges[-bands.n_floors :][index]
    sentence = (
        f"The noise floor of channel {name} fell by {-10 * change[index]:.0f} dB between shaft "
        f"orders {low:.0f} and {high:.0f}, which no fault does. Check the sensor, its cable, its "
        "mounting and filters."
    )
    return (sentence,)


def _describe_lost_passes(
    change: Float64[np.ndarray, "channel level"],
    scatter: Float64[np.ndarray, "channel level"],
    bands: OrderBands,
) -> tuple[str, ...]:
    """Return a sentence on the lines of the first piston passes, if they fell together.

    They do at a speed too far from the specified one for the passes to show it.
    """
    fall = _pass_fall(change, scatter, bands)
    if fall < _MIN_PASS_FALL_DB:
        return ()
    sentence = (
        f"The lines of the first piston passes fell by {fall:.0f} dB on average, which no fault "
        "does. The pump ran at another speed than specified, or the sample rate is another one: "
        "correct them in the index."
    )
    return (sentence,)


def _pass_fall(
    change: Float64[np.ndarray, "channel level"],
    scatter: Float64[np.ndarray, "channel level"],
    bands: OrderBands,
) -> float:
    """Return the mean fall of the lines of the first piston passes [dB]."""
    first = bands.names.index("pass 1")
    passes = slice(first, first + min(_N_PASSES, bands.passes))
    pass_changes = change[:, passes][scatter[:, passes] > 0]
    return -10 * float(pass_changes.mean()) if pass_changes.size else 0.0
