"""Whether the lines of recordings are fit to calibrate on, beside what `inspection` refuses of any recording."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording, clipped_readings
from swashtwin.signals import OrderSpectrum, order_spectrum

MOST_CLIPPED = 0.01
"""Share of clipped readings from which a recording is refused: on the virtual rig its lines are then 3 % off in the sum
(0.3 % of readings: 0.5 %; 3 %: 17 %)."""
LEAST_CLEARNESS = 4.0
"""Least mean square of a recording's lines over their deviations: noise alone has 2, the virtual rig 1700 and more."""
ODD_LEVEL, ODD_DEVIATIONS = 1.5, 3.0
"""A recording's level is odd where it differs from the others' mean by more than this factor, and by more than so many
of their standard deviations."""
_LEAST_SCATTER = 0.1
"""Standard deviation of ln(level) that repeated recordings of one pump have at least."""


def clipping_note(recording: Recording) -> str | None:
    """What to say of a recording of which a few readings are clipped, or None.

    Raises
    ------
    DataError
        1 % of a channel's readings or more stand at its extremes.
    """
    for name, row in zip(recording.channels, recording.signal, strict=True):
        share = clipped_readings(row) / len(row)
        where = f"{recording.recording_id}, {name}: {share:.2%} of the readings stand in a row at the extreme"
        if share >= MOST_CLIPPED:
            raise DataError(
                f"{where} ({np.abs(row).max():.4g} {recording.unit}): the range was exceeded, and no line is right; "
                "record with a wider range, or pick the other channels with recording.picked([...])."
            )
        if share:
            return f"{where}: the range was exceeded, and peaks are cut off."
    return None


def lines_of(recording: Recording, shaft_frequency: float, orders: Int[np.ndarray, " order"]) -> OrderSpectrum:
    """Lines of a recording at `orders`.

    Raises
    ------
    DataError
        It is too short for them, or holds nothing but noise there.
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
    """What to say of recordings whose level is far from that of the others of the same pump at the same condition.

    Nothing in one recording tells its pressure: pumps of one type differ in level by as much as a pressure changes it.
    Beside at least two others of the same specimen, another pressure shows as another level, and so does another gain.
    """
    level = np.log(np.sqrt((amplitudes**2).sum(axis=(1, 2))))
    notes = []
    for i, recording in enumerate(recordings):
        others = [j for j, one in enumerate(recordings) if j != i and one.specimen == recording.specimen]
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
