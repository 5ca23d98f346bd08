"""A fault as a change: the twin with the fault less the same twin without, laid over measured healthy windows.

All that the twin does not know of a machine (housing, sensors, noise, reassembly) stays as measured; only what the
fault changes is simulated, line by line with its phase against the healthy lines, side bands of the shaft included. The
twin makes lines only: broadband noise stays at its healthy level.

Where the fault was measured on the same machine at another operating point, it shows how much of the simulated change
the machine follows, octave by octave (`change_share`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float, Int

from swashtwin.foundation import InputError, stream
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin, accelerations
from swashtwin.pump import (
    PRESSURE_TOLERANCE,
    SPEED_TOLERANCE,
    OperatingCondition,
    is_healthy,
    is_same_class,
    values_match,
)
from swashtwin.signals import synchronous_signal
from swashtwin.synthesis.filler import build_windows
from swashtwin.synthesis.shaft_alignment import AlignedWindows, align_windows, pass_lines_of
from swashtwin.synthesis.variation import Variation, draw_twin

_OCTAVES = 200.0 * 2.0 ** np.arange(5)
"""Frequencies [Hz] between the bands in which the share of a change is measured."""
_DOUBT = 0.1
"""Power of the prior on a share, which is 1, over that of the healthy lines in its band."""
_GREATEST_SHARE = 1.5
"""Share at most."""


@dataclass(frozen=True, eq=False)
class _Base:
    """What the windows of one twin are laid over."""

    aligned: Sequence[AlignedWindows]
    """Healthy windows, machine by machine."""
    shares: Sequence[Float[np.ndarray, " band"]]
    """Share of the change that each machine follows."""
    indices: Int[np.ndarray, "window 2"]
    """(machine, window) of every healthy window."""


def change_windows(
    twins: Sequence[Twin],
    draw_values: Callable[[Twin, int], Twin],
    *,
    label: str,
    count: int,
    like: WindowSet,
    seed: int,
    variation: Variation,
    specimens: Sequence[str | None],
    chunk: int,
) -> WindowSet:
    """`count` measured healthy windows with the change of a fault; the twins take turns.

    No healthy window of a machine repeats before all were drawn. The fault's piston is drawn with the shaft's angle,
    which is measured up to whole piston pitches. A window states the speed and the pressure that its healthy one does,
    and windows laid over one recording are one recording.

    Parameters
    ----------
    draw_values : function from a twin and a window's number to the twin with the values drawn for it.
    label : class of the windows.
    specimens : machine that each twin stands for; None takes the windows of all.
    chunk : windows simulated at once.

    Raises
    ------
    InputError
        No healthy window of a machine was measured at its twin's operating point.
    """
    bases = [_base(like, twin, specimen) for twin, specimen in zip(twins, specimens, strict=True)]
    sources = []
    for i in range(count):
        turn, number = divmod(i, len(twins))
        rounds, position = divmod(turn, len(bases[number].indices))
        order = stream(seed, "healthy window", label, number, rounds).permutation(len(bases[number].indices))
        machine, row = bases[number].indices[order[position]]
        sources.append((bases[number].aligned[machine], bases[number].shares[machine], int(row)))
    signal = np.empty((count, like.n_channels, like.length))
    time = np.arange(like.length) / like.sample_rate
    for start in range(0, count, chunk):
        numbers = range(start, min(start + chunk, count))
        varied = []
        for i in numbers:
            twin = draw_twin(draw_values(twins[i % len(twins)], i), variation, seed, i)
            aligned, _, row = sources[i]
            varied.append(twin.at(replace(twin.condition, speed=float(aligned.speed[row]))))
        orders, changes = _changes(varied)
        for i, twin, lines in zip(numbers, varied, changes, strict=True):
            aligned, share, row = sources[i]
            rng = stream(seed, "change", label, i)
            pistons = twin.pump.rotating_group.piston_count
            angle = aligned.angle[row] + 2 * np.pi / pistons * rng.integers(pistons) + twin.condition.speed * time
            gain = np.exp(rng.normal(0, variation.sensor, (like.n_channels, 1)))
            followed = lines * _share_at(orders * twin.condition.shaft_frequency, share)
            signal[i] = aligned.windows.signal[row] + gain * synchronous_signal(followed, orders, angle)
    return build_windows(
        signal,
        like=like,
        name="changed",
        label=label,
        pressure=np.array([aligned.windows.discharge_pressure[row] for aligned, _, row in sources]),
        speed=np.array([aligned.windows.speed[row] for aligned, _, row in sources]),
        specimen=np.array([f"twin of {aligned.windows.specimen[row]}" for aligned, _, row in sources]),
        seed=seed,
        source=[str(aligned.windows.recording_id[row]) for aligned, _, row in sources],
    )


def change_share(windows: WindowSet, twin: Twin) -> Float[np.ndarray, " band"]:
    """How much of the simulated change of a fault one machine follows: 1 is all, in the bands between `_OCTAVES`.

    Where the machine was measured with the fault and without at one operating point, the share of a band is that at
    which the simulated change S comes nearest to the measured one M over the piston-pass lines of all channels,

        share = (Re sum M conj(S) + e) / (sum |S|^2 + e),

    at most 1.5 and not below 0. The prior e is a tenth of the power of the healthy lines in the band, so that a change
    that hardly shows in these lines leaves it at 1, as does a machine that was never measured with the fault. Of
    several operating points the one with most windows of the fault counts, of these that nearest to the twin's
    pressure.

    Parameters
    ----------
    windows : measured windows of one machine.
    twin : twin of it with the fault.
    """
    share = np.ones(len(_OCTAVES) + 1)
    pressure = _shared_pressure(windows, twin)
    if pressure is None:
        return share
    twin = twin.at(twin.condition.replaced(discharge_pressure=pressure))
    near = _is_near(windows, twin.condition)
    measured, simulated = [], []
    for each, is_class in ((twin, _is_of(windows, twin)), (twin.with_fault(None), _is_healthy(windows))):
        aligned = align_windows(windows.subset(near & is_class), each)
        measured.append(aligned.average)
        simulated.append(pass_lines_of(each, np.arange(1, aligned.average.shape[-1] + 1)))
    seen, expected = measured[0] - measured[1], simulated[0] - simulated[1]
    pistons = twin.pump.rotating_group.piston_count
    frequency = pistons * twin.condition.shaft_frequency * np.arange(1, seen.shape[-1] + 1)
    for number in range(share.size):
        band = np.searchsorted(_OCTAVES, frequency) == number
        prior = _DOUBT * np.sum(np.abs(measured[1][:, band]) ** 2)
        match = np.sum((seen[:, band] * expected[:, band].conj()).real)
        power = np.sum(np.abs(expected[:, band]) ** 2)
        if power + prior > 0:
            share[number] = (match + prior) / (power + prior)
    return np.clip(share, 0, _GREATEST_SHARE)


def _base(like: WindowSet, twin: Twin, specimen: str | None) -> _Base:
    """The healthy windows of a twin's machine at its operating point, or of all machines, aligned with the twin."""
    measured = _measured_windows(like, specimen)
    base = _healthy_windows(like, twin.condition, specimen)
    if not len(base):
        healthy = measured.subset(_is_healthy(measured))
        stated = np.unique(healthy.discharge_pressure[~np.isnan(healthy.discharge_pressure)])
        others = f" (there are some at {', '.join(f'{value / 1e6:g}' for value in stated)} MPa)" if stated.size else ""
        of = "" if specimen is None else f" of {specimen}"
        raise InputError(
            f"no measured healthy window{of} at {twin.condition.discharge_pressure / 1e6:g} MPa and "
            f"{twin.condition.shaft_frequency * 60:.4g} rev/min to lay a fault's change on{others}. Record the healthy "
            'machine there, or take background="spectrum".'
        )
    names = np.unique(base.specimen)
    aligned = [align_windows(base.subset(base.specimen == name), twin.with_fault(None)) for name in names]
    shares = [change_share(measured.subset(measured.specimen == name), twin) for name in names]
    indices = [(machine, row) for machine, each in enumerate(aligned) for row in range(len(each.windows))]
    return _Base(aligned, shares, np.array(indices))


def _measured_windows(like: WindowSet, specimen: str | None) -> WindowSet:
    """The measured windows of a machine, or of all."""
    return like.subset(~like.synthetic if specimen is None else ~like.synthetic & (like.specimen == specimen))


def _healthy_windows(like: WindowSet, condition: OperatingCondition, specimen: str | None) -> WindowSet:
    """Those of them that are healthy and at an operating point."""
    measured = _measured_windows(like, specimen)
    return measured.subset(_is_healthy(measured) & _is_near(measured, condition))


def _is_healthy(windows: WindowSet) -> Bool[np.ndarray, " window"]:
    return np.isin(windows.label, [name for name in windows.classes if is_healthy(name)])


def _is_of(windows: WindowSet, twin: Twin) -> Bool[np.ndarray, " window"]:
    return np.isin(windows.label, [name for name in windows.classes if is_same_class(name, twin.label)])


def _is_near(windows: WindowSet, condition: OperatingCondition) -> Bool[np.ndarray, " window"]:
    """Which windows are at an operating point, as far as they state one."""
    pressure, speed = windows.discharge_pressure, windows.speed
    at_pressure = np.isnan(pressure) | values_match(pressure, condition.discharge_pressure, PRESSURE_TOLERANCE)
    return at_pressure & (np.isnan(speed) | values_match(speed, condition.speed, SPEED_TOLERANCE))


def _shared_pressure(windows: WindowSet, twin: Twin) -> float | None:
    """Pressure at which a machine was measured both healthy and with the twin's fault; None where there is none."""
    if twin.fault is None:
        return None
    counts = {}
    for pressure in np.unique(windows.cell_pressure[_is_healthy(windows) & ~np.isnan(windows.cell_pressure)]).tolist():
        near = _is_near(windows, twin.condition.replaced(discharge_pressure=pressure))
        counts[pressure] = int((near & _is_of(windows, twin)).sum())
    away = {pressure: abs(pressure - twin.condition.discharge_pressure) for pressure in counts}
    best = min(counts, key=lambda pressure: (-counts[pressure], away[pressure]), default=None)
    return best if best is not None and counts[best] else None


def _share_at(frequency: Float[np.ndarray, " line"], share: Float[np.ndarray, " band"]) -> Float[np.ndarray, " line"]:
    """Share at each frequency [Hz], between the middles of the octaves along the logarithm."""
    middles = _OCTAVES[0] / np.sqrt(2) * 2.0 ** np.arange(share.size)
    return np.interp(np.log(np.maximum(frequency, 1.0)), np.log(middles), share)


def _changes(
    twins: Sequence[Twin],
) -> tuple[Int[np.ndarray, " line"], Complex[np.ndarray, "twin channel line"]]:
    """(shaft orders, lines of each twin less those of the same twin without its fault [m/s^2])."""
    with torch.no_grad():
        faulty, healthy = accelerations(twins), accelerations([twin.with_fault(None) for twin in twins])
    orders = np.union1d(faulty.orders, healthy.orders)
    lines = np.zeros((len(twins), faulty.lines.shape[1], orders.size), dtype=complex)
    lines[..., np.searchsorted(orders, faulty.orders)] += faulty.lines.numpy()
    lines[..., np.searchsorted(orders, healthy.orders)] -= healthy.lines.numpy()
    return orders, lines
