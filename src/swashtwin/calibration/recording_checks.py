"""Whether recordings are fit to calibrate on, beyond what `recordings` checks of any recording."""

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float, Int

from swashtwin.foundation import DataError, InputError, propose_setting
from swashtwin.recordings import Recording, count_clipped_samples
from swashtwin.signals import OrderSpectrum, order_spectrum

MAX_CLIPPED_SHARE = 0.01
"""Share of clipped samples from which a recording is refused: on the virtual rig its lines are then
3 % off in the sum (0.3 % of samples: 0.5 %; 3 %: 17 %).
"""
MIN_CLEARNESS = 4.0
"""Minimum mean square of a recording's lines over their deviations: noise alone has 2, the virtual
rig 1700 and more.
"""
MAX_LEVEL_RATIO = 1.5
"""Factor between a recording's level and the others' mean above which it is reported, if
`MAX_LEVEL_DEVIATIONS` is exceeded as well.
"""
MAX_LEVEL_DEVIATIONS = 3.0
"""The same in standard deviations of the others."""

# Minimum standard deviation of ln(level) of repeated recordings of one pump.
_MIN_LEVEL_SCATTER = 0.1


def require_one_machine(recordings: Iterable[Recording], result: str) -> None:
    """Refuse recordings of several specimens with a `DataError`, as the result is of one pump.

    Parameters
    ----------
    result : what is made of the recordings, for the message, such as "a calibration".
    """
    specimens = sorted(
        {recording.specimen for recording in recordings if recording.specimen is not None}
    )
    if len(specimens) > 1:
        raise DataError(
            f"Recordings of {len(specimens)} machines ({', '.join(specimens[:4])}): {result} "
            "belongs to one pump.",
            field="specimen",
            remedy=f"Select its recordings, such as {propose_setting('specimen', specimens[0])}.",
        )


def check_clipping(recording: Recording) -> str | None:
    """Return a note if a few samples are clipped, or `None`.

    Raises
    ------
    DataError
        At least 1 % of a channel's samples are clipped.
    """
    for name, row in zip(recording.channels, recording.signal, strict=True):
        share = count_clipped_samples(row) / len(row)
        finding = (
            f"{recording.recording_id}, {name}: {share:.2%} of the samples are clipped at the "
            "extreme value"
        )
        if share >= MAX_CLIPPED_SHARE:
            raise DataError(
                f"{finding} ({np.abs(row).max():.4g} {recording.unit}): the signal exceeded the "
                "measuring range, so its lines are wrong. Record with a wider range, or exclude "
                "the channel (channels = [...] in the index)."
            )
        if share:
            return f"{finding}: the signal exceeded the measuring range."
    return None


def measure_lines(
    recording: Recording, shaft_frequency: float, orders: Int[np.ndarray, " order"]
) -> OrderSpectrum:
    """Return the lines of a recording at `orders`.

    Raises
    ------
    DataError
        The recording is too short, or holds nothing but noise at these orders.
    """
    try:
        spectrum = order_spectrum(recording.signal, recording.sample_rate, shaft_frequency, orders)
    except InputError as cause:
        raise DataError(
            f"{recording.recording_id} ({recording.duration:.4g} s): {cause} Record longer, or "
            "exclude it."
        ) from cause

    # lines of a noiseless simulation have no deviation
    ratio = spectrum.amplitude / np.maximum(spectrum.deviation, 1e-300)
    if float(np.mean(ratio**2)) < MIN_CLEARNESS:
        raise DataError(
            f"{recording.recording_id}: no line exceeds the noise at multiples of {orders[0]} "
            f"times {shaft_frequency:.4g} Hz (the strongest is {spectrum.amplitude.max():.3g} "
            f"{recording.unit}). Check that the pump was running, the sensor connected and the "
            "speed right, or exclude the recording."
        )
    return spectrum


def describe_level_outliers(
    recordings: Sequence[Recording], amplitudes: Float[np.ndarray, "recording channel order"]
) -> tuple[str, ...]:
    """Return a note on each recording whose level is far from that of the others of its pump at
    the same operating point.

    A single recording does not show its pressure: pumps of one type differ in level by as much as a
    pressure changes it. Compared with at least two others of the same specimen, another pressure
    shows as another level, and so does another gain.
    """
    level = np.log(np.sqrt((amplitudes**2).sum(axis=(1, 2))))
    notes = []
    for index, recording in enumerate(recordings):
        peers = [
            peer_index
            for peer_index, peer in enumerate(recordings)
            if peer_index != index and peer.specimen == recording.specimen
        ]
        if len(peers) < 2:
            continue

        difference = float(level[index] - level[peers].mean())
        scatter = max(float(level[peers].std(ddof=1)), _MIN_LEVEL_SCATTER)
        if abs(difference) > max(np.log(MAX_LEVEL_RATIO), MAX_LEVEL_DEVIATIONS * scatter):
            assert recording.condition is not None  # a measurement holds no recording without one
            pressure = recording.condition.discharge_pressure / 1e6
            notes.append(
                f"{recording.recording_id}: its lines are {np.exp(difference):.2g} times those of "
                f"the {len(peers)} other recordings specified at {pressure:.4g} MPa. Check its "
                "pressure and gain."
            )
    return tuple(notes)
