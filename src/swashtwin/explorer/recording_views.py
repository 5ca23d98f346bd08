"""Figures of recordings as numbers that the page draws: spectra, waterfalls, levels, and what tells
them apart.
"""

import base64
import math
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from fastapi import Query
from jaxtyping import Float
from starlette.responses import Response

from swashtwin.explorer.workspace import BIN, Name, Workspace, level_track
from swashtwin.foundation import DataError, InputError, SwashTwinError
from swashtwin.recordings import specified_shaft_frequency
from swashtwin.signals import (
    LineSpectrum,
    LineSpectrumKind,
    defect_orders,
    resample_by_angle,
    specified_angle,
    spectrum_of,
    tapered_transform,
)

RESOLUTION = 0.5
"""Spacing of a spectrum's lines [Hz], at least."""
ORDER_RESOLUTION = 0.05
"""Spacing of lines over the shaft's orders, at least."""
MOST_LINES = 1 << 16
"""Lines of a spectrum that are sent; each is the greatest of its group."""
FRAMES, BANDS = 360, 400
"""Moments and lines of a waterfall, at most."""
RANGE = 80.0
"""Levels of a waterfall [dB] below its greatest that differ in color."""
MOST_VALUES = 1 << 22
"""Samples that one answer holds, at most."""
MOST_HEALTHY = 8
"""Healthy recordings that a spectrum is compared with."""
LEAST_CHANGE = 1.0
"""Spread [dB] that every level has at least: mounting and temperature move it so much."""
SHARED = 0.5
"""Shortest healthy recording over the one compared with it."""

Names = Annotated[list[str], Query(max_length=50)]
Key = tuple[str, str, LineSpectrumKind, tuple[float, float] | None]
"""Recording by name and facts, kind of spectrum, band of the envelope [Hz]."""


def packed(values: np.ndarray) -> str:
    """Numbers as text for the page: float32, little endian, base 64."""
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()


class RecordingViews:
    """Figures of one workspace; the last spectra are kept."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._spectrum = lru_cache(maxsize=64)(self._computed)

    def _computed(self, key: Key) -> tuple[LineSpectrum, float, Float[np.ndarray, "channel line"]]:
        name, _, kind, band = key
        recording = self._workspace.recording(name)
        step = max(
            RESOLUTION,
            recording.sample_rate / 2 / MOST_LINES,
            recording.sample_rate / recording.n_samples,
        )
        spectrum = spectrum_of(
            recording, kind, band=band, resolution=step if kind == "amplitude" else 0.0
        )
        if kind == "order":
            step = max(
                ORDER_RESOLUTION,
                float(spectrum.position[1]),
                float(spectrum.position[-1]) / MOST_LINES,
            )
        group = np.floor(spectrum.position / step + 0.5).astype(int)
        starts = np.flatnonzero(np.diff(group, prepend=-1))
        return spectrum, step, np.maximum.reduceat(spectrum.amplitude, starts, axis=1)

    def key(
        self, name: str, kind: LineSpectrumKind, band: tuple[float, float] | None = None
    ) -> Key:
        """What a spectrum is kept by."""
        row = self._workspace.rows.get(name)
        return name, repr(row and row.stated), kind, band

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
        """Spectrum of each channel with its marks, and the range of healthy recordings of the same
        point.

        Parameters
        ----------
        low, high : edges [Hz] of the band for the envelope; without them the kurtogram chooses.
        bodies, ratio : of a bearing: number of rolling bodies, and their diameter over the pitch
        diameter.
        healthy : whether healthy recordings are asked for.
        """
        band = None if low is None or high is None else (low, high)
        spectrum, step, amplitude = self._spectrum(self.key(name, kind, band))
        recording = self._workspace.recording(name)
        shaft = specified_shaft_frequency(recording)
        marks = [
            (mark.position, mark.name.replace("x", "×"), mark.of_pistons) for mark in spectrum.marks
        ]
        unit = 1.0 if kind == "order" else shaft
        if unit and pistons:
            marks += [(unit * pistons * k, f"{pistons * k}×", True) for k in range(1, 6)]
        if unit and bodies and ratio is not None:
            orders = defect_orders(bodies, ratio)
            for letters, order in zip(("BPFI", "BPFO", "2 BSF", "FTF"), orders, strict=True):
                marks += [(unit * order, letters, False), (2 * unit * order, f"2 {letters}", False)]
        result: dict[str, Any] = {
            "step": step,
            "amplitude": packed(amplitude),
            "lines": amplitude.shape[1],
        }
        result |= {
            "unit": spectrum.unit,
            "channels": spectrum.channels,
            "shaft": shaft,
            "bands": spectrum.bands,
        }
        result |= {"marks": [mark for mark in marks if mark[0] <= step * amplitude.shape[1]]}
        if healthy:
            result |= self._healthy(name, kind, amplitude.shape)
        return result

    def _healthy(self, name: str, kind: LineSpectrumKind, shape: tuple[int, ...]) -> dict[str, Any]:
        names, spectra = [], []
        least = SHARED * self._workspace.recording(name).duration
        for other in self._workspace.alike(name, healthy=True)[:MOST_HEALTHY]:
            try:
                row = self._workspace.rows[other].recording
                if row is None or row.duration < least:
                    continue
                amplitude = self._spectrum(self.key(other, kind))[2]
            except (SwashTwinError, OSError):
                continue
            lines = min(amplitude.shape[1], shape[1])
            if amplitude.shape[0] == shape[0] and lines > 0.9 * shape[1]:
                spectra.append(
                    np.pad(
                        amplitude[:, :lines],
                        ((0, 0), (0, shape[1] - lines)),
                        constant_values=np.nan,
                    )
                )
                names.append(other)
        if not spectra:
            return {"healthy": []}
        low, middle, high = np.quantile(spectra, (0, 0.5, 1), axis=0)
        return {
            "healthy": names,
            "low": packed(low),
            "middle": packed(middle),
            "high": packed(high),
        }

    def waterfall(self, name: Name, channel: int = 0, orders: bool = False) -> dict[str, Any]:
        """Level [dB] over time (or turns) and frequency (or order) as one byte each, 255 the
        greatest.
        """
        recording = self._workspace.recording(name)
        if not 0 <= channel < recording.n_channels:
            raise InputError(
                f"{name} has {recording.n_channels} channels; there is no number {channel}."
            )
        recording = recording.select_channels(recording.channels[channel : channel + 1])
        rate = recording.sample_rate
        if orders:
            angle = specified_angle(recording)
            recording = resample_by_angle(
                recording, angle, 2 * math.ceil(rate * math.pi / float(angle.speed.max()))
            )
            rate = float(recording.attributes["samples_per_turn"])
        signal = recording.signal[0]
        length = min(2048, signal.size)
        starts = np.unique(np.linspace(0, signal.size - length, FRAMES).astype(int))
        lines = np.stack(
            [
                np.abs(tapered_transform(signal[start : start + length])) * 4 / length
                for start in starts
            ]
        )
        group = max(1, math.ceil(lines.shape[1] / BANDS))
        lines = np.maximum.reduceat(lines, np.arange(0, lines.shape[1], group), axis=1)
        level = 20 * np.log10(np.maximum(lines, 1e-12 * max(float(lines.max()), 1e-300)))
        shades = np.clip(255 * (1 + (level - level.max()) / RANGE), 0, 255).astype(np.uint8)
        result = {
            "frames": len(starts),
            "bands": lines.shape[1],
            "top": float(level.max()),
            "range": RANGE,
        }
        result |= {
            "end": float((starts[-1] + length) / rate),
            "high": group * lines.shape[1] * rate / length,
        }
        return {
            **result,
            "unit": recording.unit,
            "shades": base64.b64encode(shades.tobytes()).decode(),
        }

    def levels(self, name: Name) -> dict[str, Any]:
        """Root mean square of each channel along a recording."""
        recording = self._workspace.recording(name)
        level = level_track(recording, 120)
        step = recording.duration / level.shape[1]
        return {
            "step": step,
            "lines": level.shape[1],
            "amplitude": packed(level),
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
        """Float32: channel by channel the least and greatest of each bin, or the samples of one
        channel.
        """
        recording = self._workspace.recording(name)
        if width >= BIN and width % BIN:
            raise InputError(
                f"bins have less than {BIN} samples, or a multiple of them; {width} is none."
            )
        if count * min(width, BIN) * (recording.n_channels if channel is None else 1) > MOST_VALUES:
            raise InputError(f"at most {MOST_VALUES} values are sent at once.")
        if channel is None:
            values = self._workspace.extremes(name, width, start, count)
        elif channel >= recording.n_channels or start >= recording.n_samples:
            raise InputError(
                f"{name} has {recording.n_channels} channels of {recording.n_samples} samples."
            )
        else:
            values = recording.slice(start, min(start + count, recording.n_samples)).signal[channel]
        return Response(
            np.ascontiguousarray(values, "<f4").tobytes(), media_type="application/octet-stream"
        )

    def speed(self, name: Name, pistons: Annotated[int, Query(ge=1, le=100)]) -> dict[str, Any]:
        """Speed that the piston-pass lines show, and how clearly.

        Raises
        ------
        DataError
            No comb of lines stands clear.
        """
        from swashtwin.calibration import detect_speed

        recording = self._workspace.recording(name)
        stated = specified_shaft_frequency(recording)
        starts = (
            (12.0, 30.0) if stated is None else (stated,)
        )  # each looks from a third of it to three times it
        best = max(
            (detect_speed(recording, start, pistons) for start in starts),
            key=lambda speed: speed.shown_contrast,
        )
        if not best.is_clear:
            raise DataError(
                f"{name}: no lines of {pistons} pistons stand clear of the noise, so it shows no speed."
            )
        sure = 1 - math.exp(-best.shown_contrast)
        return {"rpm": 60 * best.shown, "contrast": best.shown_contrast, "sure": sure}

    def comparison(self, first: Names, second: Names) -> dict[str, Any]:
        """What differs between two groups of recordings: the levels that changed most, in spreads
        within the groups.

        The spread of a level is the pooled standard deviation within both groups, `LEAST_CHANGE` at
        least.

        Raises
        ------
        InputError
            A group is empty.
        DataError
            The recordings differ in rate, channels or unit, or one is unfit.
        """
        from swashtwin.learning import band_power_layout

        if not first or not second:
            raise InputError("a comparison takes a recording on either side; choose them.")
        recordings = {
            name: self._workspace.recording(name).unloaded() for name in {*first, *second}
        }
        if len({(item.sample_rate, item.channels, item.unit) for item in recordings.values()}) > 1:
            raise DataError(
                "these recordings differ in sample rate, channels or unit; compare alike ones."
            )
        layout, notes = band_power_layout(list(recordings.values()))
        levels = {name: layout.measure(recording) for name, recording in recordings.items()}
        groups = [np.stack([levels[name] for name in names]) for names in (first, second)]
        freedom = sum(len(group) - 1 for group in groups)
        scatter = sum(((group - group.mean(axis=0)) ** 2).sum(axis=0) for group in groups)
        spread = np.maximum(np.sqrt(scatter / max(freedom, 1)), LEAST_CHANGE)
        change = groups[1].mean(axis=0) - groups[0].mean(axis=0)
        shaft = specified_shaft_frequency(recordings[second[0]])
        ranked = np.argsort(-np.abs(change / spread))[:20]
        rows = [
            {"band": layout.band_powers[n].words(shaft), "channel": layout.band_powers[n].channel, "change": float(change[n]),
             "spreads": float(change[n] / spread[n]), "edges": layout.band_powers[n].edges(shaft)}
            for n in ranked.tolist()
        ]  # fmt: skip
        return {"rows": rows, "notes": notes, "freedom": freedom}
