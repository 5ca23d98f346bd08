"""Rolling bearings: how often a flaw is run over, and how clearly an envelope beats at that rhythm.

A flaw on a race or a ball rings the housing each time it is run over. Counted in turns of the shaft these rhythms
follow from the bearing's geometry alone, so what stands at them means the same on another bearing at another speed.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.signals.envelope import envelope_spectrum
from swashtwin.signals.spectra import inverse_transform, transform

SEATS = ("ball", "inner_race", "outer_race")
"""Where a flaw can sit, in the order of `defect_prominences`."""

_HARMONICS = (1, 2, 3)
_SLIP = 0.01
"""Rolling bodies slide a little: a line is looked for within this of its place, relative."""


class DefectOrders(NamedTuple):
    """Events per turn of the shaft, the outer race standing still."""

    inner_race: float
    """A rolling body meets a flaw on the inner race (BPFI)."""
    outer_race: float
    """A rolling body meets a flaw on the outer race (BPFO)."""
    ball: float
    """A flaw on a rolling body meets a race: twice in each of its own turns (2 BSF)."""
    cage: float
    """Turns of the cage (FTF)."""


def defect_orders(bodies: int, diameter_ratio: float, contact_angle: float = 0.0) -> DefectOrders:
    """Events per turn of the shaft without sliding.

    With g = (d / D) cos a: cage (1 - g) / 2, outer race Z (1 - g) / 2, inner race Z (1 + g) / 2, ball (1 - g²) D / d
    (a flaw on a body meets both races in each of its turns; Randall and Antoni 2011, doi:10.1016/j.ymssp.2010.07.017).

    Parameters
    ----------
    bodies : number Z of rolling bodies in a row.
    diameter_ratio : diameter d of a body over the pitch diameter D, both in one unit.
    contact_angle : a [rad].

    Examples
    --------
    >>> print(f"{defect_orders(9, 0.3126 / 1.537).inner_race:.4f}")
    5.4152
    """
    ratio = diameter_ratio * math.cos(contact_angle)
    if bodies < 3 or not 0 < ratio < 1:
        raise InputError(
            f"a bearing of {bodies} bodies with d / D = {diameter_ratio:g} is none; it takes 3 or more, and a ratio of "
            "diameters between 0 and 1."
        )
    return DefectOrders(
        inner_race=bodies * (1 + ratio) / 2,
        outer_race=bodies * (1 - ratio) / 2,
        ball=(1 - ratio**2) / diameter_ratio,
        cage=(1 - ratio) / 2,
    )


BEARINGS = {"SKF 6205": defect_orders(9, 0.3126 / 1.537), "SKF 6203": defect_orders(8, 0.2656 / 1.122)}
"""Bearings of the CWRU rig, by the diameters that its page states: drive end and fan end."""


def prewhitened(signal: Float[np.ndarray, "channel time"]) -> Float[np.ndarray, "channel time"]:
    """Signal whose spectrum is made flat while every phase stays (cepstrum prewhitening): impulses outlast tones.

    Borghesani et al. 2013, DOI 10.1016/j.ymssp.2012.11.001. Unit: none.
    """
    spectrum = transform(signal - signal.mean(axis=-1, keepdims=True))
    flat = spectrum / np.maximum(np.abs(spectrum), 1e-300)
    return inverse_transform(flat, signal.shape[-1]) * math.sqrt(signal.shape[-1])


def defect_prominences(
    signal: Float[np.ndarray, " time"],
    sample_rate: float,
    shaft_frequency: float,
    orders: DefectOrders,
    bands: tuple[tuple[float, float], ...] | None = None,
) -> Float[np.ndarray, "band seat measure"]:
    """How far the rhythm of each of `SEATS` stands out of the envelope's spectrum, in each band.

    Two measures, both natural logarithms of power over the median power beside: the lines at 1, 2, 3 times the defect
    order, and their sidebands (one turn of the shaft aside for a race, one turn of the cage for a ball), each averaged.
    Gaussian noise alone gives about 1 to 2, the largest of some lines over their median.

    Parameters
    ----------
    shaft_frequency : [Hz].
    bands : edges [Hz] of the bands whose envelopes are taken; None lets the kurtogram choose one.

    Raises
    ------
    InputError
        A line lies beyond the envelope's spectrum, or the signal is too short to tell it from its sideband.
    """
    top = (max(_HARMONICS) * max(orders) + 1) * shaft_frequency * 1.1
    turns = len(signal) / sample_rate * shaft_frequency
    if top >= sample_rate / 2 or turns * orders.cage < 8:
        raise InputError(
            f"{turns:.0f} turns at {sample_rate:g} Hz are too few or too coarse for a bearing at "
            f"{shaft_frequency:g} Hz; it takes {math.ceil(8 / orders.cage)} turns and {2 * top:.0f} Hz."
        )
    prominences = []
    for band in bands or (None,):
        spectrum = envelope_spectrum(signal[None], sample_rate, band)
        prominences.append(_of_spectrum(spectrum.frequency, spectrum.amplitude[0] ** 2, shaft_frequency, orders))
    return np.array(prominences)


def _of_spectrum(
    frequency: Float[np.ndarray, " line"], power: Float[np.ndarray, " line"], shaft: float, orders: DefectOrders
) -> list[list[float]]:
    rows = []
    for seat in SEATS:
        order = getattr(orders, seat)
        aside = orders.cage if seat == "ball" else 1.0
        lines = [_prominence(frequency, power, k * order * shaft) for k in _HARMONICS]
        sides = [_prominence(frequency, power, (k * order + s * aside) * shaft) for k in _HARMONICS for s in (-1, 1)]
        rows.append([float(np.mean(lines)), float(np.mean(sides))])
    return rows


def _prominence(frequency: Float[np.ndarray, " line"], power: Float[np.ndarray, " line"], at: float) -> float:
    """Logarithm of the largest power near `at` [Hz] over the median power beside it."""
    width = frequency[1]
    half = max(_SLIP * at, 2.5 * width)
    wide = 6 * half + 20 * width
    first, last = np.searchsorted(frequency, [at - wide, at + wide])
    near = np.abs(frequency[first:last] - at) <= half
    around = power[first:last]
    return float(np.log(max(around[near].max(), 1e-300) / max(np.median(around[~near]), 1e-300)))
