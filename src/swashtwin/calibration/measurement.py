"""What a calibration takes from recordings: amplitudes and phases of lines.

The paper drops the phase on purpose, for nobody knows the shaft's position at the first reading.
But one unknown position turns all lines of all channels together, order k by k times the angle;
what is left of the phases says as much as the amplitudes do. The shaft's angle comes from the lines
themselves (`signals.piston_pass_angle`), and the position that suits best is computed anew for
every point, so that it costs no coordinate (variable projection, Golub and Pereyra 2003,
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
    check_clipping,
    describe_level_outliers,
    measure_lines,
)
from swashtwin.calibration.speed_detection import require_consistent_speed
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
cannot follow: if measured lines above 1 kHz are far off for any values, ``band=(0, 1000)`` is the
honest choice, at the price of C_v and C_Hz three times less certain.
"""

LINE_SPEED_TOLERANCE = 0.01
"""Relative difference of speed up to which a recording agrees with a twin: less than elsewhere,
since lines that lie 1 % apart meet another part of a mode's peak.
"""
GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s^2]."""
Lines = Literal["piston", "shaft", "spectrum"]
"""Which lines are compared: multiples of the piston count, or all multiples of the shaft
frequency.
"""
MAX_SHAFT_ORDER = 75
"""Higher shaft orders blend with their neighbors if the speed wanders by 0.6 %, as
`order_spectrum` allows for.
"""
MAX_RESOLVED_SHARE = 0.49
"""Highest frequency of a band, as a share of the sample rate."""


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
    """Recordings that were measured."""
    excluded_recordings: tuple[tuple[str, str], ...]
    """Id of each recording that does not agree with the twin, and the reason."""
    band: tuple[float, float]
    """Frequencies [Hz] within which the orders lie."""
    lines: Lines = "piston"
    """Which lines they are."""
    notes: tuple[str, ...] = ()
    """Notes on the recordings that the user should read."""
    phasor: Complex[np.ndarray, "channel order"] | None = None
    """Mean complex peak amplitude [m/s^2] along the shaft's angle, its position arbitrary; `None`
    if phases are not measured.
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
    """Return the line amplitudes of those recordings that agree with the twin.

    They agree if they have its label, its speed (within 1 %) and its pressure (within 6 %).

    Parameters
    ----------
    band : frequencies [Hz] whose lines are taken.
    lines : ``"piston"``: multiples of the piston count, the only lines of equal pistons;
        ``"shaft"``: every order up to 75, for twins of a fault that sets one piston apart;
        ``"spectrum"``: every order of the band, the twin being silent between its lines: the
        paper's L_freq over the whole spectrum.
    phases : measure the lines' phases too, along the shaft's angle (`measure_phased_lines`).

    Raises
    ------
    DataError
        No recording agrees; a recording is unfit (missing samples, too short, clipped, nothing but
        noise), shows another speed than specified, or has a channel for which the pump has no
        sensor.
    UnitError
        A recording is not in m/s^2.
    InputError
        The band holds no such line, or the twin has piston-pass lines only although all shaft
        orders are requested.
    """
    used, excluded = select_matching_recordings(twin, recordings)
    clipping_notes = _check_recordings(twin, used)
    piston_count = twin.pump.rotating_group.piston_count

    _check_band(band, used)
    orders = line_orders(twin, band, lines)
    spectra = []
    for recording in used:
        shaft_frequency = _shaft_frequency(recording)
        require_consistent_speed(recording, shaft_frequency, piston_count)
        spectra.append(measure_lines(recording, shaft_frequency, orders))

    amplitudes = np.stack([spectrum.amplitude for spectrum in spectra])
    within = np.sqrt(np.sum([spectrum.deviation**2 for spectrum in spectra], axis=0)) / len(used)
    # a single recording shows no scatter between recordings
    if len(used) > 1:
        between = amplitudes.std(axis=0, ddof=1) / math.sqrt(len(used))
    else:
        between = np.zeros_like(within)

    phasor = phasor_deviation = None
    if phases:
        phased = [measure_phased_lines(recording, orders, piston_count) for recording in used]
        phasor, phasor_deviation = average_phased_lines(phased, orders)

    return Measurement(
        channels=used[0].channels,
        orders=orders,
        amplitude=amplitudes.mean(axis=0),
        deviation=np.maximum(within, between),
        recordings=tuple(used),
        excluded_recordings=tuple(excluded),
        band=(float(band[0]), float(band[1])),
        lines=lines,
        notes=(*clipping_notes, *describe_level_outliers(used, amplitudes)),
        phasor=phasor,
        phasor_deviation=phasor_deviation,
    )


def _check_recordings(twin: Twin, recordings: Sequence[Recording]) -> list[str]:
    """Refuse recordings that are unfit to measure; return notes on those with clipped samples."""
    notes = []
    for recording in recordings:
        require_usable(recording)
        if recording.unit != "m/s^2":
            raise UnitError(
                f"{recording.recording_id} is in {recording.unit!r}, but a calibration needs "
                "m/s^2.",
                field="unit",
                remedy="Specify {unit='g'} or {sensitivity='99.7 mV/g'} when it is read.",
            )
        _require_channels(twin, recording, recordings[0])
        note = check_clipping(recording)
        if note is not None:
            notes.append(note)
    return notes


def assign_single_channels(
    recordings: Iterable[Recording], pump: Pump
) -> tuple[list[Recording], tuple[str, ...]]:
    """Return the recordings, each single channel that is not a sensor of the pump assigned to its
    first sensor; and the original names of these channels.

    The position of such a channel is unknown: its path from the shell must be searched freely.
    """
    assigned = []
    original_names = dict[str, None]()
    for recording in recordings:
        name = recording.channels[0]
        if len(recording.channels) == 1 and name not in pump.channels:
            original_names[name] = None
            recording = recording.replace(channels=pump.channels[:1])
        assigned.append(recording)
    return assigned, tuple(original_names)


def select_matching_recordings(
    twin: Twin, recordings: Iterable[Recording]
) -> tuple[list[Recording], list[tuple[str, str]]]:
    """Return the recordings that show what the twin models, and the ids of the others, each with
    the reason.

    Raises
    ------
    DataError
        No recording matches; the message names both numbers that differ.
    """
    used, excluded = [], []
    for recording in recordings:
        reason = _describe_mismatch(twin, recording)
        if reason is None:
            used.append(recording)
        else:
            excluded.append((recording.recording_id, reason))

    if not used:
        counts = Counter(reason for _, reason in excluded).most_common(4)
        reasons = "; ".join(f"{count} times {reason}" for reason, count in counts)
        raise DataError(
            f"No recording agrees with the twin ({reasons or 'there are no recordings'}).",
            remedy="Select other recordings, or a twin with their {fault}, {speed} and {pressure}.",
        )
    return used, excluded


def _describe_mismatch(twin: Twin, recording: Recording) -> str | None:
    """Return why a recording does not show what the twin models, or `None` if it does."""
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
    assert recording.condition is not None  # `select_matching_recordings` excludes those without
    return recording.condition.shaft_frequency


def _require_channels(twin: Twin, recording: Recording, first: Recording) -> None:
    """Refuse channels that are not sensors of the pump, or not those of the first recording."""
    for name in recording.channels:
        if name not in twin.pump.channels:
            raise DataError(
                f"{recording.recording_id}: the pump {twin.pump.name} has no sensor for channel "
                f"{name!r}, only {', '.join(twin.pump.channels)}. Name the channels as these "
                "sensors (names = [...] in the index), add the sensor to the pump file, or "
                "exclude the channel (channels = [...])."
            )
    if recording.channels != first.channels:
        raise DataError(
            f"{recording.recording_id} has the channels {', '.join(recording.channels)}, but "
            f"{first.recording_id} has {', '.join(first.channels)}. Select the same channels of "
            "both (channels = [...] in the index)."
        )


def _check_band(band: tuple[float, float], recordings: Sequence[Recording]) -> None:
    """Refuse a band that is not ordered, or that a recording does not resolve."""
    low, high = band
    if not 0 <= low < high:
        raise InputError(f"band ({low:g}, {high:g}) must be two frequencies [Hz], the lower first.")
    for recording in recordings:
        limit = MAX_RESOLVED_SHARE * recording.sample_rate
        if high > limit:
            raise InputError(
                f"band ends at {high:g} Hz, above what {recording.recording_id} resolves at "
                f"{recording.sample_rate:g} samples per second: end it at {limit:.0f} Hz.",
                field="band",
            )


def line_orders(twin: Twin, band: tuple[float, float], lines: Lines) -> Int[np.ndarray, " order"]:
    """Return the shaft orders of the lines within `band` [Hz] at the twin's speed.

    Raises
    ------
    InputError
        There is no such line, or the twin has piston-pass lines only although all shaft orders are
        requested.
    """
    low, high = band
    piston_count = twin.pump.rotating_group.piston_count
    shaft_frequency = twin.condition.shaft_frequency

    step = 1
    spacing_name = "shaft"
    if lines == "piston":
        step = piston_count
        spacing_name = "piston-pass"
    spacing = step * shaft_frequency
    n_lines = int(high / spacing)

    if lines == "shaft":
        # the first order is unbalance, which every pump has
        has_shaft_lines = ((twin.orders % piston_count > 0) & (twin.orders > 1)).any()
        if not has_shaft_lines:
            raise InputError(
                "Lines of the shaft need a fault that sets one piston apart: a twin of "
                f"{twin.label} has lines at multiples of {piston_count} only. Use the piston-pass "
                "lines."
            )
        n_lines = min(MAX_SHAFT_ORDER, n_lines)

    orders = step * np.arange(1, n_lines + 1)
    orders = orders[orders * shaft_frequency >= low]
    if not len(orders):
        raise InputError(
            f"band ({low:g}, {high:g}) Hz contains no multiple of the {spacing_name} frequency "
            f"({spacing:.1f} Hz)."
        )
    return orders


SEGMENTS = 4
"""Number of parts of a recording between which a line scatters; the scatter gives its deviation."""
_GRID_POINTS_PER_ORDER = 16
_NEWTON_STEPS = 4


def measure_phased_lines(
    recording: Recording, orders: Int[np.ndarray, " order"], piston_count: int
) -> tuple[Complex[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]:
    """Return the complex peak amplitudes at `orders` along the shaft's angle, and the standard
    deviation of each of their parts.

    Angle 0 is an arbitrary position of the shaft, the same for all channels and orders of the
    recording.

    Raises
    ------
    DataError
        No piston-pass line is clear enough to be followed.
    """
    shaft = piston_pass_angle(recording, piston_count)
    length = recording.signal.shape[1] // SEGMENTS

    segments = []
    for index in range(SEGMENTS):
        samples = slice(index * length, (index + 1) * length)
        angle = shaft.angle[samples]
        # equal weight per angle, not per time, so that a wandering speed leaves orders sharp
        taper = hann_taper(length, symmetric=True) * np.gradient(angle)
        basis = np.exp(-1j * np.outer(angle, orders)) * (2 * taper / taper.sum())[:, None]
        segments.append(recording.signal[:, samples] @ basis)

    lines = np.stack(segments)
    return lines.mean(axis=0), _mean_deviation(lines)


def average_phased_lines(
    phased_lines: Sequence[
        tuple[Complex[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]
    ],
    orders: Int[np.ndarray, " order"],
) -> tuple[Complex[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]:
    """Return the mean of the lines of several recordings, each turned to the first's shaft
    position, and its standard deviation.
    """
    lines, deviations = zip(*phased_lines, strict=True)
    reference = torch.as_tensor(lines[0]).conj()
    order_tensor = torch.as_tensor(orders)

    turned = []
    for recording_lines in lines:
        cross = (torch.as_tensor(recording_lines) * reference).sum(dim=0)
        angle = float(find_shaft_position(cross, order_tensor))
        turned.append(recording_lines * np.exp(1j * orders * angle))
    aligned_lines = np.stack(turned)

    deviation: np.ndarray = np.sqrt(np.sum(np.square(deviations), axis=0)) / len(lines)
    if len(lines) > 1:
        deviation = np.maximum(deviation, _mean_deviation(aligned_lines))
    return aligned_lines.mean(axis=0), deviation


def _mean_deviation(
    lines: Complex[np.ndarray, "draw channel order"],
) -> Float[np.ndarray, "channel order"]:
    """Return the standard deviation of the real and of the imaginary part of the lines' mean."""
    spread: np.ndarray = np.sqrt(
        np.mean([lines.real.var(axis=0, ddof=1), lines.imag.var(axis=0, ddof=1)], axis=0)
    )
    return spread / math.sqrt(len(lines))


def find_shaft_position(
    cross: Complex[Tensor, "*batch order"], orders: Int[Tensor, " order"]
) -> Float[Tensor, "*batch"]:
    """Return the angle a [rad] at which Re sum_k cross_k exp(i k a) is greatest, differentiable.

    With cross_k the weighted sum over channels of simulated times conjugate measured lines, it is
    the shaft position to which the simulated lines must be turned to come nearest to the measured
    ones in the sense of least squares. A grid finds the highest peak, Newton's steps its top; the
    last step carries the exact derivative (that of an implicit function).
    """
    step = math.gcd(*orders.tolist())
    indices = orders // step
    n_points = _GRID_POINTS_PER_ORDER * (1 << int(indices.max()).bit_length())

    with torch.no_grad():
        padded = torch.zeros(*cross.shape[:-1], n_points, dtype=cross.dtype, device=cross.device)
        padded[..., indices] = cross
        score = torch.fft.ifft(padded, dim=-1).real
        angle = score.argmax(dim=-1) * (2 * math.pi / (n_points * step))
        for _ in range(_NEWTON_STEPS):
            slope, curvature = _score_derivatives(cross, orders, angle)
            angle = angle - slope / curvature
        curvature = _score_derivatives(cross, orders, angle)[1]

    return angle - _score_derivatives(cross, orders, angle)[0] / curvature


def _score_derivatives(cross: Tensor, orders: Tensor, angle: Tensor) -> tuple[Tensor, Tensor]:
    """Return the first and second derivative of the score.

    The second is below zero around a peak, and is kept from zero.
    """
    turned = cross * torch.exp(1j * orders * angle[..., None])
    slope = -(orders * turned).imag.sum(dim=-1)
    curvature = -(orders**2 * turned).real.sum(dim=-1)
    return slope, torch.clamp(curvature, max=-1e-30)


def align_lines(
    simulated: Complex[Tensor, "*batch channel order"],
    measured: Complex[Tensor, "channel order"],
    weight: Float[Tensor, "channel order"],
    orders: Int[Tensor, " order"],
) -> Complex[Tensor, "*batch channel order"]:
    """Return the simulated lines at the shaft position at which they come nearest to the measured
    ones, by weighted squares.
    """
    angle = find_shaft_position((simulated * measured.conj() * weight).sum(dim=-2), orders)
    return simulated * torch.exp(1j * orders * angle[..., None])[..., None, :]
