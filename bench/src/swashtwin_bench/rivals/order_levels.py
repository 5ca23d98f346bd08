"""Levels of windows at multiples of the shaft frequency, and how far they lie from the machine's own healthy ones.

What a fault changes is a ratio between lines of one machine. A level itself also holds the housing, the sensors and the
mounting, which no twin knows well; the healthy recordings of the same machine hold them too, so that their difference
does not.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64, Shaped

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import FeatureTable, WindowSet
from swashtwin.pump import PRESSURE_TOLERANCE, values_match
from swashtwin.signals import band_limited, power_density, signal_envelope

Extractor = Callable[[WindowSet], FeatureTable]
"""Anything that gives features of windows."""

LEAST_REVOLUTIONS = 3.0
"""A window with fewer revolutions does not tell neighboring orders apart: a Hann taper smears a line over four bins."""

JITTER = 0.006
"""Half-width of the speed's variation [relative] over which a line's power is summed."""

ENVELOPE_FROM = 1000.0
"""Frequency [Hz] above which the envelope is taken."""


def order_lines(windows: WindowSet, count: int) -> FeatureTable:
    """log10 of the mean square of each channel within half an order of each of the shaft orders 1 to `count`.

    Raises
    ------
    InputError
        A window does not know its speed, is too short to tell orders apart, or ends below the highest one.
    """
    return _table(windows, {f"order {order}": (order - 0.5, order + 0.5) for order in range(1, count + 1)})


def order_levels(windows: WindowSet, piston_count: int, passes: int = 20, top: float | None = None) -> FeatureTable:
    """log10 of the mean square of each channel at and between the multiples of the piston-pass frequency.

    Per channel: the shaft orders below the first multiple, one by one; each of the first `passes` multiples, gathered
    as wide as a jittering speed smears it; all between it and the next; eight logarithmic bands above, up to `top`.

    Parameters
    ----------
    piston_count : pistons of the pump, whose multiples are separated from other shaft orders.
    passes : how many multiples.
    top : highest order, the same for every set that is compared (`highest_order`); None takes no bands above.

    Raises
    ------
    InputError
        As `order_lines`.
    """
    bands = {f"order {order}": (order - 0.5, order + 0.5) for order in range(1, piston_count)}
    for number in range(1, passes + 1):
        here, there = number * piston_count, (number + 1) * piston_count
        bands[f"pass {number}"] = (here - _reach(here, piston_count), here + _reach(here, piston_count))
        bands[f"between {number}"] = (here + _reach(here, piston_count), there - _reach(there, piston_count))
    if top is not None and top > (passes + 1) * piston_count + 8:
        edges = np.geomspace((passes + 1) * piston_count, top, 9)
        bands |= {f"above {number}": (edges[number], edges[number + 1]) for number in range(8)}
    return _table(windows, bands)


def highest_order(windows: WindowSet) -> float:
    """Order that all windows reach, also where their speed is up to 2 % higher than that of any of these."""
    return float(0.98 * windows.sample_rate / 2 / (windows.speed.max() / (2 * np.pi)))


def envelope_levels(windows: WindowSet, count: int = 28) -> FeatureTable:
    """log10 of the mean square of each channel's envelope above `ENVELOPE_FROM` at the shaft orders 1 to `count`.

    Raises
    ------
    InputError
        As `order_lines`.
    """
    flat = windows.signal.reshape(-1, windows.length).astype(np.float64)
    high = band_limited(flat, windows.sample_rate, ENVELOPE_FROM, windows.sample_rate / 2)
    envelope = signal_envelope(high).reshape(windows.signal.shape)
    table = order_lines(replace(windows, signal=envelope.astype(np.float32)), count)
    return FeatureTable(table.values, tuple(f"{name} of the envelope" for name in table.names))


def _reach(order: int, piston_count: int) -> float:
    return min(0.5 + JITTER * order, piston_count / 4)


def _levels(windows: WindowSet, bands: list[tuple[float, float]]) -> Float64[np.ndarray, "window channel band"]:
    _require_orders(windows, max(upper for _, upper in bands))
    frequency, density = power_density(windows.signal.astype(np.float64), windows.sample_rate)
    levels = np.empty((len(windows), windows.n_channels, len(bands)))
    for speed in np.unique(windows.speed):
        at_speed = windows.speed == speed
        order = frequency / (speed / (2 * np.pi))
        inside = np.stack([(order >= lower) & (order < upper) for lower, upper in bands], axis=1)
        levels[at_speed] = density[at_speed] @ inside.astype(np.float64) * frequency[1]
    return np.log10(np.maximum(levels, 1e-30))


def _require_orders(windows: WindowSet, highest: float) -> None:
    revolutions = windows.revolutions
    if np.isnan(revolutions).any():
        raise InputError(f"{windows.recording_id[np.isnan(revolutions)][0]} has no speed, so it has no shaft orders.")
    if len(windows) and revolutions.min() < LEAST_REVOLUTIONS:
        raise InputError(
            f"a window of {windows.length} samples holds {revolutions.min():.2g} revolutions; its orders need "
            f"{LEAST_REVOLUTIONS:g}, which are {int(np.ceil(windows.length * LEAST_REVOLUTIONS / revolutions.min()))} "
            "samples."
        )
    top = windows.sample_rate / 2 / (windows.speed.max(initial=0.0) / (2 * np.pi)) if len(windows) else np.inf
    if highest > top * (1 + 1e-9):
        raise InputError(
            f"order {highest:.0f} lies above half the sample rate, which is order {top:.0f}; take fewer orders."
        )


def _table(windows: WindowSet, bands: Mapping[str, tuple[float, float]]) -> FeatureTable:
    levels = _levels(windows, list(bands.values()))
    columns = tuple(f"{channel} {name}" for channel in windows.channels for name in bands)
    return FeatureTable(levels.reshape(len(windows), len(columns)), columns)


class CachedExtractor:
    """An extractor that computes the features of a window once, however often and in whatever set it comes."""

    def __init__(self, extract: Extractor) -> None:
        self._extract = extract
        self._rows: dict[bytes, np.ndarray] = {}
        self._names: tuple[str, ...] = ()

    def __call__(self, windows: WindowSet) -> FeatureTable:
        """Features of each window."""
        keys = [
            hashlib.blake2b(signal.tobytes() + speed.tobytes(), digest_size=16).digest()
            for signal, speed in zip(windows.signal, windows.speed, strict=True)
        ]
        new = {key: index for index, key in enumerate(keys) if key not in self._rows}
        if new or not keys:
            table = self._extract(windows.subset(np.array(list(new.values()), dtype=np.int64)))
            self._rows.update(zip(new, table.values, strict=True))
            self._names = table.names
        return FeatureTable(np.array([self._rows[key] for key in keys], dtype=np.float64), self._names)


@dataclass(frozen=True, eq=False)
class _Healthy:
    values: Float[np.ndarray, "window feature"]
    recording_id: Shaped[np.ndarray, " window"]

    def median(self, without: str) -> Float[np.ndarray, " feature"]:
        """Median over the windows of other recordings, if there are any."""
        is_other = self.recording_id != without
        return np.median(self.values[is_other] if is_other.any() else self.values, axis=0)


@dataclass(frozen=True, eq=False)
class AgainstHealthy:
    """Features less the median of those of the same machine's healthy windows at the same pressure.

    A healthy recording that is a reference itself is compared with the others, or it would look healthier than one
    that comes later.
    """

    extract: Extractor
    """What gives the features."""
    reference: Mapping[tuple[str, float], _Healthy]
    """Healthy features by specimen and discharge pressure [Pa]."""
    recording_ids: tuple[str, ...]
    """Measured recordings among the references. They had a part in whatever uses this: no test set may hold them."""

    def __call__(self, windows: WindowSet) -> FeatureTable:
        """Features of each window against its own machine's.

        Raises
        ------
        DataError
            There is no healthy recording of a machine at a pressure.
        """
        table = self.extract(windows)
        values = table.values.copy()
        medians: dict[tuple[str, float, str], np.ndarray] = {}
        keys = zip(
            windows.specimen.tolist(), windows.cell_pressure.tolist(), windows.recording_id.tolist(), strict=True
        )
        for index, (specimen, pressure, recording) in enumerate(keys):
            references = self._healthy(specimen, pressure)
            if references is None:
                raise DataError(
                    f"{recording}: no healthy recording of {specimen or 'its machine'} at {pressure / 1e6:g} MPa to "
                    "compare it with; record one."
                )
            excluded = recording if recording in references.recording_id else ""
            key = (specimen, pressure, excluded)
            if key not in medians:
                medians[key] = references.median(excluded)
            values[index] -= medians[key]
        return FeatureTable(values, table.names)

    def _healthy(self, specimen: str, pressure: float) -> _Healthy | None:
        for (machine, stated), healthy in self.reference.items():
            if machine == specimen and values_match(pressure, stated, PRESSURE_TOLERANCE):
                return healthy
        return None


def against_healthy(extract: Extractor, healthy: WindowSet) -> AgainstHealthy:
    """Features of `extract` against those of `healthy`, which holds windows of each machine at each pressure.

    Parameters
    ----------
    healthy : measured or synthetic windows of machines without a fault; others in it are left out.
    """
    healthy = healthy.subset(healthy.label == "normal")
    values = extract(healthy).values
    reference = {}
    for specimen, pressure in dict.fromkeys(
        zip(healthy.specimen.tolist(), healthy.cell_pressure.tolist(), strict=True)
    ):
        selected = (healthy.specimen == specimen) & (healthy.cell_pressure == pressure)
        reference[specimen, pressure] = _Healthy(values[selected], healthy.recording_id[selected])
    measured = sorted(set(healthy.recording_id[~healthy.synthetic].tolist()))
    return AgainstHealthy(extract, reference, tuple(measured))
