"""Windows over the healthy spectrum of their own pump: the regime with a healthy reference.

Every classifier of a study then sees how a pump differs from its healthy state, and neither its
gain, its mounting nor its housing. Without a reference it sees band powers as they were measured,
as of a pump that is met for the first time.
"""

from dataclasses import replace

import numpy as np
import scipy
from jaxtyping import Float

from swashtwin.foundation import DataError
from swashtwin.learning import WindowSet
from swashtwin.pump import PRESSURE_TOLERANCE, values_match
from swashtwin.signals import inverse_transform, tapered_transform

SMOOTHED_LINES = 9
"""Lines over which a healthy spectrum is averaged. In windows of 80 ms it is one piston-pass
frequency of version 1 of the rig (100 Hz), so that lines of the pump, whose speed varies, do not
stand out of its reference.
"""


def relative_to_healthy(windows: WindowSet, healthy: WindowSet) -> WindowSet:
    """Return windows whose spectra are divided by the healthy spectrum of their own machine.

    The spectrum is the mean of the healthy windows of the machine at the same pressure, smoothed
    over `SMOOTHED_LINES`. Healthy windows have a mean square of about 1 then, under a Hann taper.

    Parameters
    ----------
    windows : windows of machines, measured or synthetic.
    healthy : healthy windows of the same machines, at least one of each at each pressure.

    Raises
    ------
    DataError
        A machine has no healthy window at a pressure.
    """
    pressures = windows.cell_pressure
    machines = zip(windows.specimen.tolist(), pressures.tolist(), strict=True)
    signal = np.empty_like(windows.signal)

    for specimen, pressure in sorted(set(machines)):
        members = (windows.specimen == specimen) & (pressures == pressure)
        is_at_pressure = values_match(healthy.discharge_pressure, pressure, PRESSURE_TOLERANCE)
        references = healthy.signal[(healthy.specimen == specimen) & is_at_pressure]
        if not len(references):
            raise DataError(
                f"{specimen} has no healthy recording at {pressure / 1e6:g} MPa to compare with."
            )
        signal[members] = _divide_spectra(windows.signal[members], _healthy_spectrum(references))

    return replace(windows, signal=signal)


def _healthy_spectrum(
    signal: Float[np.ndarray, "window channel time"],
) -> Float[np.ndarray, "channel line"]:
    """Return the mean power of each line of healthy windows, smoothed."""
    power = (np.abs(tapered_transform(signal)) ** 2).mean(axis=0)
    return np.asarray(scipy.ndimage.uniform_filter1d(power, SMOOTHED_LINES, mode="nearest"))


def _divide_spectra(
    signal: Float[np.ndarray, "window channel time"], power: Float[np.ndarray, "channel line"]
) -> Float[np.ndarray, "window channel time"]:
    """Return windows with each line over the amplitude of the healthy one, without their mean.

    They are tapered: the step from the end of a window to its start would be louder than the signal
    at frequencies at which the healthy machine is quiet.
    """
    length = signal.shape[-1]
    lines = tapered_transform(signal) * np.sqrt(length / power)
    lines[..., 0] = 0
    return inverse_transform(lines, length).astype(np.float32)
