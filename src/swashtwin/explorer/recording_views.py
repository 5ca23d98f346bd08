"""Numbers that the page draws: spectra, waterfalls, RMS, samples, and comparisons."""

import base64
import math
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

import numpy as np
from fastapi import Query
from jaxtyping import Float
from starlette.responses import Response

from swashtwin.explorer.excerpts import MAX_TURNED_SAMPLES, describe_excerpts, excerpts, is_long
from swashtwin.explorer.pyramid import BIN
from swashtwin.explorer.workspace import Name, RecordingVersion, Workspace
from swashtwin.foundation import DataError, InputError, SwashTwinError
from swashtwin.recordings import Recording, specified_shaft_frequency
from swashtwin.signals import (
    LineSpectrum,
    LineSpectrumKind,
    defect_orders,
    resample_by_angle,
    specified_angle,
    spectrum_of,
    tapered_transform,
)

MIN_RESOLUTION_HZ = 0.5
"""Smallest distance of a spectrum's lines."""
MIN_ORDER_RESOLUTION = 0.05
"""Smallest distance of lines in orders of the shaft."""
MAX_LINES = 1 << 16
"""Lines of a spectrum that are sent, each the largest of its group."""
WATERFALL_FRAMES = 360
"""Frames of a waterfall along time; about one for two pixels of a figure."""
WATERFALL_BANDS = 400
"""Bands of a waterfall along frequency."""
WATERFALL_RANGE_DB = 80.0
"""Range of a waterfall's colors, below its largest value."""
WATERFALL_WINDOW = 2048
"""Samples of one frame of a waterfall."""
ANSWER_TIME_S = 1.0
"""Time after which an answer holds what was read of a long recording until then."""
KNOWN_HEADER = "x-known"
"""Header with the share of a recording that an answer knows."""
MAX_VALUES = 1 << 22
"""Samples in one answer."""
MAX_HEALTHY = 8
"""Healthy recordings that a spectrum is compared with."""
MIN_SPREAD_DB = 1.0
"""Minimum spread of a band power, as in detectors of deviations; few recordings may agree by
chance.
"""
MIN_HEALTHY_LENGTH = 0.5
"""Shortest healthy recording, relative to the one compared with it."""
COMPARED_ROWS = 20
"""Band powers in the table of a comparison."""
_MARKED_HARMONICS = 5

# Shaft frequencies from which a speed is searched if none is specified; each search covers a third
# to three times its start, together 4 to 90 Hz.
_START_SPEEDS_HZ = (12.0, 30.0)

Names = Annotated[list[str], Query(max_length=50)]


class SpectrumKey(NamedTuple):
    """What a spectrum is cached by."""

    recording: RecordingVersion
    """Facts and file of the recording."""
    kind: LineSpectrumKind
    """Kind of spectrum."""
    band: tuple[float, float] | None
    """Band of the envelope [Hz]; `None` selects it by the kurtogram."""


class ComputedSpectrum(NamedTuple):
    """A spectrum on the grid of the page."""

    spectrum: LineSpectrum
    """Spectrum of the recording, or of one of its excerpts."""
    step: float
    """Distance of its lines, in the unit of its axis."""
    amplitude: Float[np.ndarray, "channel line"]
    """Amplitudes at multiples of the step."""
    excerpts: str
    """What it is of; empty for the whole recording."""


def pack(values: np.ndarray) -> str:
    """Return numbers as text for the page: float32, little endian, base 64."""
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()


class RecordingViews:
    """Views of the recordings of one workspace; the last spectra are cached."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._spectrum = lru_cache(maxsize=64)(self._compute_spectrum)

    def _compute_spectrum(self, key: SpectrumKey) -> ComputedSpectrum:
        """Return a spectrum, averaged over excerpts of a long recording."""
        recording = self._workspace.recording(key.recording.name)
        if key.kind == "order":
            parts = excerpts(recording, max_samples=MAX_TURNED_SAMPLES)
        elif key.kind == "envelope" and key.band is None:
            # The kurtogram selects one band of one excerpt.
            parts = excerpts(recording, 1)
        else:
            parts = excerpts(recording)

        step = max(
            MIN_RESOLUTION_HZ,
            recording.sample_rate / 2 / MAX_LINES,
            recording.sample_rate / parts[0].n_samples,
        )
        resolution = 0.0  # the finest
        if key.kind == "amplitude":
            resolution = step
        spectra = _usable_spectra(parts, key.kind, key.band, resolution)
        if key.kind == "order":
            step = max(
                MIN_ORDER_RESOLUTION,
                *(float(spectrum.position[1]) for spectrum in spectra),
                float(spectra[0].position[-1]) / MAX_LINES,
            )

        amplitudes = [_amplitude_on_grid(spectrum, step) for spectrum in spectra]
        # Order spectra end at slightly different orders if the speed varies.
        n_lines = min(amplitude.shape[1] for amplitude in amplitudes)
        powers = [amplitude[:, :n_lines] ** 2 for amplitude in amplitudes]
        mean = np.sqrt(np.mean(powers, axis=0))
        source = describe_excerpts(parts, recording, len(spectra))
        return ComputedSpectrum(spectra[0], step, mean, source)

    def _key(
        self, name: str, kind: LineSpectrumKind, band: tuple[float, float] | None = None
    ) -> SpectrumKey:
        return SpectrumKey(self._workspace.version(name), kind, band)

    def spectrum(
        self,
        name: Name,
        kind: LineSpectrumKind = "amplitude",
        low: float | None = None,
        high: float | None = None,
        pistons: Annotated[int | None, Query(ge=1, le=100)] = None,
        bodies: Annotated[int | None, Query(ge=1, le=1000)] = None,
        ratio: float | None = None,
        healthy: bool = False,
    ) -> dict[str, Any]:
        """Return the spectrum of each channel with its marks.

        Parameters
        ----------
        low, high : edges [Hz] of the band for the envelope; without them the kurtogram selects it.
        pistons : number of pistons, whose harmonics are marked.
        bodies, ratio : of a bearing: number of rolling bodies, and their diameter over the pitch
            diameter; its defect frequencies are marked.
        healthy : whether to add the range of healthy recordings at the same operating point.
        """
        band = None
        if low is not None and high is not None:
            band = (low, high)
        spectrum, step, amplitude, source = self._spectrum(self._key(name, kind, band))
        shaft_hz = specified_shaft_frequency(self._workspace.recording(name))

        marks = [
            (mark.position, mark.name.replace("x", "×"), mark.of_pistons) for mark in spectrum.marks
        ]
        order_length = shaft_hz
        if kind == "order":
            order_length = 1.0
        if order_length:
            marks += _piston_marks(order_length, pistons)
            marks += _bearing_marks(order_length, bodies, ratio)
        end = step * amplitude.shape[1]

        content: dict[str, Any] = {
            "step": step,
            "amplitude": pack(amplitude),
            "lines": amplitude.shape[1],
            "excerpts": source,
            "unit": spectrum.unit,
            "channels": spectrum.channels,
            "shaft": shaft_hz,
            "bands": spectrum.bands,
            "marks": [mark for mark in marks if mark[0] <= end],
        }
        if healthy:
            content |= self._healthy_range(name, kind, amplitude.shape)
        return content

    def _healthy_range(
        self, name: str, kind: LineSpectrumKind, shape: tuple[int, ...]
    ) -> dict[str, Any]:
        """Return minimum, median and maximum of the spectra of comparable healthy recordings."""
        min_duration = MIN_HEALTHY_LENGTH * self._workspace.recording(name).duration
        names = []
        spectra = []
        for healthy_name in self._workspace.comparable(name, healthy=True)[:MAX_HEALTHY]:
            recording = self._workspace.rows[healthy_name].recording
            if recording is None or recording.duration < min_duration:
                continue
            try:
                amplitude = self._spectrum(self._key(healthy_name, kind)).amplitude
            except (SwashTwinError, OSError):
                continue  # the comparison goes on with the others

            # Order spectra end at slightly different orders, as the speeds differ.
            lines = min(amplitude.shape[1], shape[1])
            if amplitude.shape[0] == shape[0] and lines > 0.9 * shape[1]:
                padded = np.full(shape, np.nan)
                padded[:, :lines] = amplitude[:, :lines]
                spectra.append(padded)
                names.append(healthy_name)

        if not spectra:
            return {"healthy": []}
        low, middle, high = np.quantile(spectra, (0, 0.5, 1), axis=0)
        return {"healthy": names, "low": pack(low), "middle": pack(middle), "high": pack(high)}

    def waterfall(self, name: Name, channel: int = 0, orders: bool = False) -> dict[str, Any]:
        """Return a channel's spectrum over time as one byte each, 255 for the largest value.

        Parameters
        ----------
        orders : whether the axes are turns and orders of the shaft, instead of time [s] and
            frequency [Hz].
        """
        recording = self._workspace.recording(name)
        if not 0 <= channel < recording.n_channels:
            raise InputError(
                f"Invalid channel number {channel}: {name} has {recording.n_channels} channels,"
                " counted from 0."
            )

        recording = recording.select_channels(recording.channels[channel : channel + 1])
        rate = recording.sample_rate
        source = ""
        if orders:
            parts = excerpts(recording, 1, max_samples=MAX_TURNED_SAMPLES)
            source = describe_excerpts(parts, recording)
            recording = _resample_to_turns(parts[0])
            rate = float(recording.attributes["samples_per_turn"])

        length = min(WATERFALL_WINDOW, recording.n_samples)
        last_start = recording.n_samples - length
        starts = np.unique(np.linspace(0, last_start, WATERFALL_FRAMES).astype(int))
        if not source and len(starts) * length < recording.n_samples:
            source = f"{len(starts)} excerpts of {length / rate:.3g} s each"

        if not is_long(recording):
            recording.signal  # noqa: B018 - reads all at once, instead of each frame
        frames = []
        for start in starts.tolist():
            signal = recording.samples.signal_part(start, start + length)[0]
            frames.append(np.abs(tapered_transform(signal)) * 4 / length)

        lines = np.stack(frames)
        lines_per_band = max(1, math.ceil(lines.shape[1] / WATERFALL_BANDS))
        band_starts = np.arange(0, lines.shape[1], lines_per_band)
        bands = np.maximum.reduceat(lines, band_starts, axis=1)

        # The floor keeps silence finite: 240 dB below the largest value, far below any color.
        floor = 1e-12 * max(float(bands.max()), 1e-300)
        level = 20 * np.log10(np.maximum(bands, floor))
        shades = 255 * (1 + (level - level.max()) / WATERFALL_RANGE_DB)
        return {
            "frames": len(starts),
            "excerpts": source,
            "bands": bands.shape[1],
            "top": float(level.max()),
            "range": WATERFALL_RANGE_DB,
            "end": float((starts[-1] + length) / rate),
            "high": lines_per_band * bands.shape[1] * rate / length,
            "unit": recording.unit,
            "shades": base64.b64encode(np.clip(shades, 0, 255).astype(np.uint8).tobytes()).decode(),
        }

    def rms(self, name: Name) -> dict[str, Any]:
        """Return the root mean square of each channel along what was read of a recording."""
        recording = self._workspace.recording(name)
        pyramid = self._workspace.pyramid(name)
        known = pyramid.wait(ANSWER_TIME_S)
        track = pyramid.rms()
        return {
            "known": known,
            "step": recording.duration / track.shape[1],
            "lines": track.shape[1],
            "amplitude": pack(track),
            "unit": recording.unit,
        }

    def samples(
        self,
        name: Name,
        start: Annotated[int, Query(ge=0)],
        count: Annotated[int, Query(ge=1)],
        width: Annotated[int, Query(ge=1)] = 1,
        channel: Annotated[int | None, Query(ge=0)] = None,
    ) -> Response:
        """Return float32 values: the extremes of bins, or the samples of one channel.

        Bins of a long recording that were not read yet are NaN; a header states the known share.

        Parameters
        ----------
        start, count : first bin and number of bins, or of samples if a channel is given.
        width : samples of a bin.
        channel : number of a channel whose samples are returned; otherwise, channel by channel, the
            smallest and largest sample of each bin.
        """
        recording = self._workspace.recording(name)
        if width >= BIN and width % BIN:
            raise InputError(f"Invalid width {width}: use less than {BIN} or a multiple of {BIN}.")

        n_channels = 1
        if channel is None:
            n_channels = recording.n_channels
        if count * min(width, BIN) * n_channels > MAX_VALUES:
            raise InputError(f"Too many values: one request returns at most {MAX_VALUES}.")

        known = 1.0
        if channel is None:
            pyramid = self._workspace.pyramid(name)
            if width >= BIN:
                known = pyramid.wait(ANSWER_TIME_S)
            values = pyramid.extremes(width, start, count)
        elif channel >= recording.n_channels or start >= recording.n_samples:
            raise InputError(
                f"Channel {channel}, sample {start} does not exist: {name} has"
                f" {recording.n_channels} channels of {recording.n_samples} samples."
            )
        else:
            end = min(start + count, recording.n_samples)
            values = recording.slice(start, end).signal[channel]
        content = np.ascontiguousarray(values, "<f4").tobytes()
        headers = {KNOWN_HEADER: f"{known:.4f}"}
        return Response(content, media_type="application/octet-stream", headers=headers)

    def speed(self, name: Name, pistons: Annotated[int, Query(ge=1, le=100)]) -> dict[str, Any]:
        """Return the speed that the piston-pass lines indicate, and its contrast.

        Raises
        ------
        DataError
            No comb of lines is clear of the noise.
        """
        from swashtwin.calibration import detect_speed

        recording = self._workspace.recording(name)
        parts = excerpts(recording, 1)
        shaft_hz = specified_shaft_frequency(recording)
        start_speeds: tuple[float, ...] = _START_SPEEDS_HZ
        if shaft_hz is not None:
            start_speeds = (shaft_hz,)
        speeds = [detect_speed(parts[0], start, pistons) for start in start_speeds]
        clearest = max(speeds, key=lambda speed: speed.detected_contrast)
        if not clearest.is_clear:
            raise DataError(
                f"{name}: no lines of {pistons} pistons are clear of the noise, so the speed cannot"
                " be determined."
            )

        contrast = clearest.detected_contrast
        clarity = 1 - math.exp(-contrast)
        return {
            "rpm": 60 * clearest.detected,
            "contrast": contrast,
            "clarity": clarity,
            "excerpts": describe_excerpts(parts, recording),
        }

    def comparison(self, first: Names, second: Names) -> dict[str, Any]:
        """Return the band powers that differ most between two groups of recordings.

        They are ranked by their change in spreads. The spread is the pooled standard deviation
        within both groups, but at least `MIN_SPREAD_DB`.

        Raises
        ------
        InputError
            A group is empty.
        DataError
            The recordings differ in sample rate, channels or unit, or one cannot be measured.
        """
        from swashtwin.learning import band_power_layout

        if not first or not second:
            raise InputError("Select at least one recording on each side.")

        recordings = {
            name: self._workspace.recording(name).unloaded() for name in {*first, *second}
        }
        formats = {
            (recording.sample_rate, recording.channels, recording.unit)
            for recording in recordings.values()
        }
        if len(formats) > 1:
            raise DataError(
                "The recordings differ in sample rate, channels or unit and cannot be compared."
            )

        layout, notes = band_power_layout(list(recordings.values()))
        powers = {}
        for name, recording in recordings.items():
            parts = excerpts(recording)
            decibels = [layout.measure(part) for part in parts]
            powers[name] = 10 * np.log10(np.mean(10 ** (np.array(decibels) / 10), axis=0))
            if source := describe_excerpts(parts, recording):
                notes += (f"{recording.recording_id}: {source} are compared.",)
        groups = [np.stack([powers[name] for name in names]) for names in (first, second)]
        change = groups[1].mean(axis=0) - groups[0].mean(axis=0)

        freedom = sum(len(group) - 1 for group in groups)
        scatter = sum(((group - group.mean(axis=0)) ** 2).sum(axis=0) for group in groups)
        spread = np.maximum(np.sqrt(scatter / max(freedom, 1)), MIN_SPREAD_DB)

        shaft_hz = specified_shaft_frequency(recordings[second[0]])
        rows = []
        for index in np.argsort(-np.abs(change / spread))[:COMPARED_ROWS].tolist():
            band_power = layout.band_powers[index]
            rows.append(
                {
                    "band": band_power.describe(shaft_hz),
                    "channel": band_power.channel,
                    "change": float(change[index]),
                    "spreads": float(change[index] / spread[index]),
                    "edges": band_power.edges(shaft_hz),
                }
            )
        return {"rows": rows, "notes": notes, "freedom": freedom}


def _usable_spectra(
    parts: list[Recording],
    kind: LineSpectrumKind,
    band: tuple[float, float] | None,
    resolution: float,
) -> list[LineSpectrum]:
    """Return the spectra of excerpts, without those that are unfit: the machine may pause.

    Raises
    ------
    DataError
        All are unfit.
    """
    spectra = []
    for part in parts:
        try:
            spectra.append(spectrum_of(part, kind, band=band, resolution=resolution))
        except DataError:
            if part is parts[-1] and not spectra:
                raise
    return spectra


def _amplitude_on_grid(spectrum: LineSpectrum, step: float) -> Float[np.ndarray, "channel line"]:
    """Return amplitudes at multiples of a step: the largest of the lines that round to each."""
    multiples = np.floor(spectrum.position / step + 0.5).astype(int)
    starts = np.flatnonzero(np.diff(multiples, prepend=-1))
    return np.maximum.reduceat(spectrum.amplitude, starts, axis=1)


def _piston_marks(order_length: float, pistons: int | None) -> list[tuple[float, str, bool]]:
    """Return marks at the harmonics of the piston-pass frequency."""
    if not pistons:
        return []
    orders = [pistons * harmonic for harmonic in range(1, _MARKED_HARMONICS + 1)]
    return [(order_length * order, f"{order}×", True) for order in orders]


def _bearing_marks(
    order_length: float, bodies: int | None, ratio: float | None
) -> list[tuple[float, str, bool]]:
    """Return marks at the defect frequencies of a bearing and at twice them."""
    if not bodies or ratio is None:
        return []
    marks = []
    names = ("BPFI", "BPFO", "2 BSF", "FTF")
    for name, order in zip(names, defect_orders(bodies, ratio), strict=True):
        marks.append((order_length * order, name, False))
        marks.append((2 * order_length * order, f"2 {name}", False))
    return marks


def _resample_to_turns(recording: Recording) -> Recording:
    """Return a recording over the shaft angle, without aliasing at its highest speed."""
    angle = specified_angle(recording)
    max_speed = float(angle.speed.max())
    samples_per_turn = 2 * math.ceil(recording.sample_rate * math.pi / max_speed)
    return resample_by_angle(recording, angle, samples_per_turn)
