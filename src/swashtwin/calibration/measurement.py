"""What a calibration takes from recordings: amplitudes and phases of lines.

The paper drops the phase on purpose, for nobody knows the shaft's position at the first reading.
But one unknown position turns all lines of all channels together, order k by k times the angle;
what is left of the phases says as much as the amplitudes do. The shaft's angle comes from the lines
themselves (`signals.piston_pass_angle`), and the position that suits best is found anew for every
point, so that it costs no coordinate (variable projection, Golub and Pereyra 2003,
doi:10.1088/0266-5611/19/2/201).
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.calibration.recording_checks import (
    clipping_note,
    level_notes,
    lines_of,
    refuse_other_speed,
)
from swashtwin.foundation import DataError, InputError, UnitError
from swashtwin.physics import Twin
from swashtwin.pump import Pump, is_same_class, values_match
from swashtwin.recordings import Recording, require_usable
from swashtwin.signals import hann_taper, piston_pass_angle

DEFAULT_BAND = (0.0, 2500.0)
"""Band [Hz] whose lines are compared.

The upper end lies just above the highest mode of the model (2376 Hz for the paper's pump): beyond
it the model's shell is a free mass, which says little of the interfaces (up to 5 kHz, only C_sw
becomes more than a tenth more certain). A real housing bends from 1 to 2 kHz on, which rigid bodies
cannot follow: where measured lines above 1 kHz are far off for any values, ``band=(0, 1000)`` is
the honest choice, at the price of C_v and C_Hz three times less certain.
"""

LINE_SPEED_TOLERANCE = 0.01
"""Relative difference of speed up to which a recording agrees with a twin: less than elsewhere,
since lines that lie 1 % apart meet another part of a mode's peak.
"""
GRAVITY = 9.80665
Lines = Literal["piston", "shaft", "spectrum"]
"""Which lines are compared: multiples of the piston count, or all multiples of the shaft
frequency.
"""
MOST_SHAFT_ORDER = 75
"""Shaft orders above blend with their neighbors where the speed wanders by 0.6 %, as
`order_spectrum` allows for.
"""


@dataclass(frozen=True, eq=False)
class Measurement:
    """Measured amplitudes of lines, averaged over recordings."""

    channels: tuple[str, ...]
    """Channels, each a sensor of the twin's pump."""
    orders: Int[np.ndarray, " order"]
    """Multiples of the shaft frequency."""
    amplitude: Float[np.ndarray, "channel order"]
    """Mean peak amplitude [m/s^2]."""
    deviation: Float[np.ndarray, "channel order"]
    """Standard deviation of that mean [m/s^2]: within recordings or between them, whichever is
    larger.
    """
    recordings: tuple[Recording, ...]
    """What was measured."""
    excluded_recordings: tuple[tuple[str, str], ...]
    """Id of each recording that does not agree with the twin, and why."""
    band: tuple[float, float]
    """Frequencies [Hz] within which the orders lie."""
    lines: Lines = "piston"
    """Which lines they are."""
    notes: tuple[str, ...] = ()
    """What the user should look at in the recordings, in words."""
    phasor: Complex[np.ndarray, "channel order"] | None = None
    """Mean complex peak amplitude [m/s^2] along the shaft's angle, its position arbitrary; None
    where phases are dropped.
    """
    phasor_deviation: Float[np.ndarray, "channel order"] | None = None
    """Standard deviation of the real and of the imaginary part of that mean [m/s^2]."""

    @property
    def recording_ids(self) -> tuple[str, ...]:
        """Ids of the recordings used."""
        return tuple(recording.recording_id for recording in self.recordings)


def measure(
    twin: Twin,
    recordings: Iterable[Recording],
    band: tuple[float, float] = DEFAULT_BAND,
    lines: Lines = "piston",
    *,
    phases: bool = False,
) -> Measurement:
    """Line amplitudes of those `recordings` that agree with the twin in label, speed (1 %) and
    pressure (6 %).

    Parameters
    ----------
    band : frequencies [Hz] whose lines are taken.
    lines : ``"piston"``: multiples of the piston count, the only lines of equal pistons;
        ``"shaft"``: every order up to 75, for twins of a fault that sets one piston apart;
        ``"spectrum"``: every order of the band, the twin being silent between its lines: the
        paper's L_freq over the whole spectrum.
    phases : measure the lines' phases too, along the shaft's angle (`phased_lines`).

    Raises
    ------
    DataError
        None agrees; a recording is unfit (missing samples, too short, clipped, nothing but noise),
        shows another speed than it states, or has a channel for which the pump has no sensor.
    UnitError
        A recording is not in m/s^2.
    InputError
        The band holds no such line, or the twin has none but piston-pass lines although all shaft
        orders are requested.
    """
    used, excluded_recordings = select_agreeing(twin, recordings)
    count, notes = twin.pump.rotating_group.piston_count, []
    for recording in used:
        require_usable(recording)
        if recording.unit != "m/s^2":
            raise UnitError(
                f"{recording.recording_id} is in {recording.unit!r}; a calibration needs m/s^2; state unit "
                '("g") or sensitivity ("99.7 mV/g") where it is read.'
            )
        _require_channels(twin, recording, used[0])
        notes.append(clipping_note(recording))
    orders = _orders_within(twin, band, used, lines)
    spectra = []
    for recording in used:
        refuse_other_speed(recording, _shaft_frequency(recording), count)
        spectra.append(lines_of(recording, _shaft_frequency(recording), orders))
    amplitudes = np.stack([spectrum.amplitude for spectrum in spectra])
    within = np.sqrt(np.sum([spectrum.deviation**2 for spectrum in spectra], axis=0)) / len(used)
    between = (
        amplitudes.std(axis=0, ddof=1) / math.sqrt(len(used))
        if len(used) > 1
        else np.zeros_like(within)
    )
    phasor, phasor_deviation = None, None
    if phases:
        phasor, phasor_deviation = combine_lines(
            [phased_lines(recording, orders, count) for recording in used], orders
        )
    return Measurement(
        channels=used[0].channels,
        orders=orders,
        amplitude=amplitudes.mean(axis=0),
        deviation=np.maximum(within, between),
        recordings=tuple(used),
        excluded_recordings=tuple(excluded_recordings),
        band=(float(band[0]), float(band[1])),
        lines=lines,
        notes=(*(note for note in notes if note is not None), *level_notes(used, amplitudes)),
        phasor=phasor,
        phasor_deviation=phasor_deviation,
    )


def assign_single_channels(
    recordings: Iterable[Recording], pump: Pump
) -> tuple[list[Recording], tuple[str, ...]]:
    """Recordings of one channel that is none of the pump's sensors, as of its first sensor; and the
    names they had.

    Where such a channel sits nobody knows: its way from the shell must be searched freely.
    """
    placed, names = [], dict[str, None]()
    for recording in recordings:
        (name, *others) = recording.channels
        if not others and name not in pump.channels:
            names[name] = None
            recording = recording.replace(channels=pump.channels[:1])
        placed.append(recording)
    return placed, tuple(names)


def select_agreeing(
    twin: Twin, recordings: Iterable[Recording]
) -> tuple[list[Recording], list[tuple[str, str]]]:
    """Recordings that show what the twin models, and the ids of the others, each with the reason.

    Where none is left, a `DataError` names both numbers that differ.
    """
    used, excluded_recordings = [], []
    for recording in recordings:
        reason = _disagreement(twin, recording)
        if reason is None:
            used.append(recording)
        else:
            excluded_recordings.append((recording.recording_id, reason))
    if not used:
        counts = Counter(reason for _, reason in excluded_recordings)
        reasons = (
            "; ".join(f"{count} times {reason}" for reason, count in counts.most_common(4))
            or "none was given"
        )
        raise DataError(
            f"no recording agrees with the twin ({reasons}); give others, or a twin of their class, speed and pressure "
            "(--fault, --speed, --pressure)."
        )
    return used, excluded_recordings


def _disagreement(twin: Twin, recording: Recording) -> str | None:
    if not is_same_class(recording.label, twin.label):
        return f"the recording's label is {recording.label}, the twin's {twin.label}"
    if recording.condition is None:
        return "it lacks speed or pressure; add them to the index"
    if recording.condition.matches(twin.condition, speed=LINE_SPEED_TOLERANCE):
        return None
    measured, simulated = (
        condition.speed * 30 / math.pi for condition in (recording.condition, twin.condition)
    )
    if not values_match(measured, simulated, LINE_SPEED_TOLERANCE):
        return f"the recording is at {measured:.4g} rev/min, the twin at {simulated:.4g} rev/min"
    measured, simulated = (
        condition.discharge_pressure / 1e6 for condition in (recording.condition, twin.condition)
    )
    return f"the recording is at {measured:.4g} MPa, the twin at {simulated:.4g} MPa"


def _shaft_frequency(recording: Recording) -> float:
    assert recording.condition is not None  # `select_agreeing` lets none pass
    return recording.condition.shaft_frequency


def _require_channels(twin: Twin, recording: Recording, first: Recording) -> None:
    for name in recording.channels:
        if name not in twin.pump.channels:
            raise DataError(
                f"{recording.recording_id}: the pump {twin.pump.name} has no sensor for channel {name!r}; it has "
                f"{', '.join(twin.pump.channels)}. Name the channels as these sensors (names = [...] in "
                "the index), add the sensor to the pump file, or leave the channel out (channels = [...])."
            )
    if recording.channels != first.channels:
        raise DataError(
            f"{recording.recording_id} has the channels {', '.join(recording.channels)}, {first.recording_id} has "
            f"{', '.join(first.channels)}; pick the same from both (channels = [...] in the index)."
        )


def _orders_within(
    twin: Twin, band: tuple[float, float], used: Sequence[Recording], lines: Lines
) -> Int[np.ndarray, " order"]:
    low, high = band
    if not 0 <= low < high:
        raise InputError(f"band ({low:g}, {high:g}) must be two frequencies [Hz], the lower first.")
    for recording in used:
        if high > 0.49 * recording.sample_rate:
            raise InputError(
                f"band ends at {high:g} Hz, above what {recording.recording_id} holds at {recording.sample_rate:g} "
                f"samples per second; end it at {0.49 * recording.sample_rate:.0f} Hz.",
                field="band",
            )
    return line_orders(twin, band, lines)


def line_orders(twin: Twin, band: tuple[float, float], lines: Lines) -> Int[np.ndarray, " order"]:
    """Shaft orders of the lines within `band` [Hz] at the twin's speed; an `InputError` where there
    is none.

    So it is where a twin has none but piston-pass lines although all shaft orders are requested.
    """
    low, high = band
    count, shaft = twin.pump.rotating_group.piston_count, twin.condition.shaft_frequency
    if lines == "shaft":
        if not ((twin.orders % count > 0) & (twin.orders > 1)).any():  # the first is unbalance
            raise InputError(
                f"lines of the shaft need a fault that sets one piston apart: a twin of {twin.label} has lines at "
                f"multiples of {count} only; use the piston-pass lines."
            )
        orders = np.arange(1, min(MOST_SHAFT_ORDER, int(high / shaft)) + 1)
    else:
        step = 1 if lines == "spectrum" else count
        orders = step * np.arange(1, int(high / (step * shaft)) + 1)
    orders = orders[orders * shaft >= low]
    if not len(orders):
        raise InputError(
            f"band ({low:g}, {high:g}) Hz holds no multiple of the {'piston-pass' if lines == 'piston' else 'shaft'} "
            f"frequency ({(count if lines == 'piston' else 1) * shaft:.1f} Hz)."
        )
    return orders


SEGMENTS = 4
"""The scatter of a line between so many parts of a recording gives its deviation."""
_FINENESS = 16
_NEWTON_STEPS = 4


def phased_lines(
    recording: Recording, orders: Int[np.ndarray, " order"], piston_count: int
) -> tuple[Complex[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]:
    """Complex peak amplitudes at `orders` along the shaft's angle, and the standard deviation of
    each of their parts.

    Angle 0 is an arbitrary position of the shaft, the same for all channels and orders of the
    recording. A `DataError` where no piston-pass line stands clear enough to be followed.
    """
    shaft = piston_pass_angle(recording, piston_count)
    length = recording.signal.shape[1] // SEGMENTS
    parts = []
    for number in range(SEGMENTS):
        part = slice(number * length, (number + 1) * length)
        angle = shaft.angle[part]
        taper = hann_taper(length, symmetric=True) * np.gradient(angle)
        basis = np.exp(-1j * np.outer(angle, orders)) * (2 * taper / taper.sum())[:, None]
        parts.append(recording.signal[:, part] @ basis)
    segments = np.stack(parts)
    return segments.mean(axis=0), _part_deviation(segments)


def combine_lines(
    pairs: Sequence[
        tuple[Complex[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]
    ],
    orders: Int[np.ndarray, " order"],
) -> tuple[Complex[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]:
    """Mean of the `phased_lines` of several recordings, each turned to the first's shaft position;
    its deviation.
    """
    lines, deviations = zip(*pairs, strict=True)
    first, numbers = torch.as_tensor(lines[0]), torch.as_tensor(orders)
    rows = []
    for row in lines:
        angle = best_position((torch.as_tensor(row) * first.conj()).sum(dim=0), numbers)
        rows.append(row * np.exp(1j * orders * float(angle)))
    stack = np.stack(rows)
    within = np.sqrt(np.sum(np.square(deviations), axis=0)) / len(lines)
    return stack.mean(axis=0), np.maximum(within, _part_deviation(stack)) if len(
        lines
    ) > 1 else within


def _part_deviation(
    lines: Complex[np.ndarray, "draw channel order"],
) -> Float[np.ndarray, "channel order"]:
    """Standard deviation of the real and of the imaginary part of the lines' mean."""
    spread: np.ndarray = np.sqrt(
        np.mean([lines.real.var(axis=0, ddof=1), lines.imag.var(axis=0, ddof=1)], axis=0)
    )
    return spread / math.sqrt(len(lines))


def best_position(
    cross: Complex[Tensor, "*batch order"], orders: Int[Tensor, " order"]
) -> Float[Tensor, "*batch"]:
    """Angle a [rad] at which Re sum_k cross_k exp(i k a) is greatest, differentiable.

    With cross_k the sum over channels of simulated times conjugate measured lines, weighed, it is
    the shaft position to which the simulated lines must be turned to come nearest to the measured
    ones in the sense of least squares. A grid finds the highest peak, Newton's steps its top; the
    last step carries the exact derivative (that of an implicit function).
    """
    step = math.gcd(*orders.tolist())
    numbers = orders // step
    points = _FINENESS * (1 << int(numbers.max()).bit_length())
    with torch.no_grad():
        padded = torch.zeros(*cross.shape[:-1], points, dtype=cross.dtype, device=cross.device)
        padded[..., numbers] = cross
        score = torch.fft.ifft(padded, dim=-1).real  # on the device of the search
        angle = score.argmax(dim=-1) * (2 * math.pi / (points * step))
        for _ in range(_NEWTON_STEPS):
            slope, bend = _slopes(cross, orders, angle)
            angle = angle - slope / bend
        bend = _slopes(cross, orders, angle)[1]
    return angle - _slopes(cross, orders, angle)[0] / bend


def _slopes(cross: Tensor, orders: Tensor, angle: Tensor) -> tuple[Tensor, Tensor]:
    """First and second derivative of the score; the second is below zero around a peak, and never
    zero.
    """
    turned = cross * torch.exp(1j * orders * angle[..., None])
    bend = -(orders**2 * turned).real.sum(dim=-1)
    return -(orders * turned).imag.sum(dim=-1), torch.clamp(bend, max=-1e-30)


def turn_lines(
    simulated: Complex[Tensor, "*batch channel order"],
    measured: Complex[Tensor, "channel order"],
    weight: Float[Tensor, "channel order"],
    orders: Int[Tensor, " order"],
) -> Complex[Tensor, "*batch channel order"]:
    """Simulated lines at the shaft position at which they come nearest to the measured ones, by
    weighed squares.
    """
    angle = best_position((simulated * measured.conj() * weight).sum(dim=-2), orders)
    return simulated * torch.exp(1j * orders * angle[..., None])[..., None, :]
