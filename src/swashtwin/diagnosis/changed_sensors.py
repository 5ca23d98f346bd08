"""Sentences on sensors, or a specified speed, that do not fit the healthy recordings of a prior.

No fault lowers the noise floor of a sensor, and none changes all bands of a sensor alike. A dead
sensor, a filter, a loose mounting, another gain and an exchanged cable do. No fault lowers the
lines of the piston passes either: they lie elsewhere if the pump ran at another speed.
"""

import numpy as np
from jaxtyping import Float64

from swashtwin.learning import common_shift
from swashtwin.signals import OrderBands

# Fall of a noise floor that no fault causes [dB], and in healthy standard deviations. On version 1
# of the rig, no floor of 150 healthy and faulty recordings fell by more than 2.7 dB.
_MIN_FALL_DB = 6.0
_MIN_FALL_SPREADS = 5.0

# First piston passes whose lines are compared, and their mean fall [dB] that no fault causes. On
# version 1 of the rig, that of 150 healthy and faulty recordings was up to 3 dB, and that of
# recordings at another speed 8 dB or more.
_N_PASSES = 5
_MIN_PASS_FALL_DB = 6.0


def describe_changed_sensors(
    change: Float64[np.ndarray, "channel level"],
    scatter: Float64[np.ndarray, "channel level"],
    bands: OrderBands,
    channels: tuple[str, ...],
) -> tuple[str, ...]:
    """Return a sentence for each channel that its sensor changed; else one for a wrong speed.

    Parameters
    ----------
    change : change of each band power against the healthy recordings [log10].
    scatter : healthy standard deviation of each [log10]; 0 for one that is not used.
    """
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
    if sentences:
        return tuple(sentences)
    return _describe_lost_passes(change, scatter, bands)


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
    """Return a sentence on the lines of the first piston passes, if they fell together."""
    first = bands.names.index("pass 1")
    passes = slice(first, first + min(_N_PASSES, bands.passes))
    pass_changes = change[:, passes][scatter[:, passes] > 0]
    if not pass_changes.size or 10 * pass_changes.mean() > -_MIN_PASS_FALL_DB:
        return ()
    sentence = (
        f"The lines of the first piston passes fell by {-10 * pass_changes.mean():.0f} dB on "
        "average, which no fault does. The pump ran at another speed than specified, or the "
        "sample rate is another one: correct them in the index."
    )
    return (sentence,)
