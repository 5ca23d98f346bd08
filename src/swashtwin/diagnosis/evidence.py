"""Which lines, moments and training recordings speak for a verdict."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from swashtwin.diagnosis.attribution import line_shares, mean_gradients
from swashtwin.diagnosis.next_checks import Check, next_checks
from swashtwin.diagnosis.trust import Trust
from swashtwin.diagnosis.verdict import Diagnosis, fit_to_recording
from swashtwin.foundation import DataError, InputError
from swashtwin.learning import FittedClassifier, cut_windows
from swashtwin.recordings import Recording, stated_speed
from swashtwin.signals import line_frequencies

MOST_WINDOWS = 24
"""Windows in a row that evidence is taken from; of more, those that speak most for the verdict."""
ORDERS = 40
"""Orders of the shaft that stand one by one; higher ones, which a wandering speed smears, in third octaves."""
_MOMENTS = 10
_MOST_GAP = 0.1
"""Share of the score that contributions may miss and still be called shares of it."""
_NEIGHBORS = 5


@dataclass(frozen=True)
class Band:
    """One order of the shaft, or one third octave."""

    name: str
    """Such as ``"order 7"`` or ``"1.8-2.2 kHz"``."""
    low: float
    """Lower edge [Hz]."""
    high: float
    """Upper edge [Hz]."""
    order: int | None = None
    """Order of the shaft in its middle, or None for a third octave."""


@dataclass(frozen=True)
class Neighbor:
    """A recording of the training that resembles the one diagnosed."""

    recording_id: str
    """Its id."""
    label: str
    """Its class."""
    distance: float
    """Distance of its mean features (`TrainingReference.distances`)."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the network's answer rests on; all figures but the amplitudes are in the unit of its scores (log-odds)."""

    recording_id: str
    """The recording."""
    label: str
    """The class that was named."""
    rival: str
    """The next likeliest class: evidence is for the one against the other."""
    margin: float
    """Score of `label` less that of `rival`, less the same for silence; mean over the windows looked at."""
    gap: float
    """Share of `margin` that the sums below miss, since gradients were taken at finitely many points."""
    start: float
    """Time of the first sample looked at [s]."""
    channels: tuple[str, ...]
    """Channels."""
    unit: str
    """Unit of the samples."""
    moments: Float64[np.ndarray, "channel moment"]
    """What each moment adds; the moments are of equal length and their sum is `margin`."""
    peaks: Float64[np.ndarray, "channel moment"]
    """Largest magnitude of the samples in each moment."""
    moment: float
    """Length of a moment [s]."""
    bands: tuple[Band, ...]
    """Orders and third octaves, ascending."""
    lines: Float64[np.ndarray, "channel band"]
    """What each band adds; their sum is `margin`."""
    rms: Float64[np.ndarray, "channel band"]
    """Root mean square of the samples in each band."""
    pistons: int | None
    """Number of pistons, where it was said."""
    nearest: tuple[Neighbor, ...]
    """Most similar recordings of the training, nearest first; none where the classifier keeps none."""
    checks: tuple[Check, ...]
    """What to check on the machine."""

    @property
    def total(self) -> float:
        """Sum of all contributions over `margin`: 1 where they add up."""
        return float(self.lines.sum()) / self.margin if self.margin else math.nan

    @property
    def adds_up(self) -> bool:
        """Whether the contributions miss at most 10 % of the score. Otherwise they are no shares of it: only the order
        of the lines is shown, no figure."""
        return self.gap <= _MOST_GAP

    @property
    def remark(self) -> str:
        """Why no shares are shown, where the contributions do not add up; else empty."""
        if self.adds_up:
            return ""
        total = f"{100 * self.total:.0f} % of the score" if math.isfinite(self.total) else "something, the score is 0"
        return f"No shares are shown: the contributions of all lines together add to {total}."

    def strongest(self, count: int = 3) -> list[tuple[str, Band, float]]:
        """(channel, band, share) of what speaks most for the verdict; shares are of all magnitudes together."""
        share = self.lines / max(float(np.abs(self.lines).sum()), 1e-300)
        indices = np.argsort(-share, axis=None)[:count]
        picked = [np.unravel_index(index, share.shape) for index in indices]
        return [(self.channels[c], self.bands[b], float(share[c, b])) for c, b in picked if share[c, b] > 0]

    def describe(self, band: Band) -> str:
        """The band in words, with what a maintenance engineer calls its line."""
        if band.order is None:
            return band.name
        frequency = f"{(band.low + band.high) / 2:.4g} Hz"
        kind = "shaft" if band.order == 1 else ""
        if self.pistons and band.order % self.pistons == 0:
            times = band.order // self.pistons
            kind = "piston-pass line" if times == 1 else f"{times}× the piston-pass line"
        return f"{band.name} ({frequency}{', ' + kind if kind else ''})"

    def sentences(self) -> tuple[str, ...]:
        """The evidence in words."""
        label, rival = self.label.replace("_", " "), self.rival.replace("_", " ")
        lines = [
            f"{self.describe(band)} on {channel}{f' ({100 * share:.0f} %)' if self.adds_up else ''}"
            for channel, band, share in self.strongest()
        ]
        sentences = [f"What speaks most for {label} rather than {rival}: {'; '.join(lines) or 'no single line'}."]
        if self.remark:
            sentences.append(self.remark)
        if self.margin <= 0:
            sentences.append(
                f"The samples as a whole take away from {label}: to silence the network answers {label} even more "
                "firmly. Lines against silence say little of this verdict; lean on the nearest recordings and on the "
                "checks."
            )
        if self.nearest:
            neighbors = [f"{near.recording_id} ({near.label.replace('_', ' ')})" for near in self.nearest[:3]]
            same = sum(near.label == self.label for near in self.nearest)
            sentences.append(
                f"Nearest training recordings: {', '.join(neighbors)}; {same} of the {len(self.nearest)} nearest are "
                f"{label}."
            )
        return tuple(sentences)

    def to_dict(self) -> dict[str, Any]:
        """Numbers, words and lists that JSON can hold."""
        strongest = [
            {
                "channel": channel,
                "band": band.name,
                "low_hz": band.low,
                "high_hz": band.high,
                "share": share if self.adds_up else None,
            }
            for channel, band, share in self.strongest(10)
        ]
        return {
            "recording_id": self.recording_id,
            "label": self.label,
            "rival": self.rival,
            "margin": self.margin,
            "gap": self.gap,
            "total": self.total if math.isfinite(self.total) else None,
            "adds_up": self.adds_up,
            "strongest": strongest,
            "nearest": [
                {"recording_id": n.recording_id, "label": n.label, "distance": n.distance} for n in self.nearest
            ],
            "checks": [{"what": check.what, "why": check.why} for check in self.checks],
            "sentences": list(self.sentences()),
        }


def explain(
    classifier: FittedClassifier,
    recording: Recording,
    diagnosis: Diagnosis,
    *,
    pistons: int | None = None,
) -> Evidence:
    """What the verdict on a recording rests on, by integrated gradients over the windows that speak most for it.

    It says what the network looks at, which is not yet why the pump vibrates so: docs/diagnosis.md has the limits.

    Parameters
    ----------
    diagnosis : of this recording, by this classifier.
    pistons : number of pistons, to name the piston-pass line.

    Raises
    ------
    InputError
        The diagnosis is of another recording or without a verdict, or there is one class only.
    """
    if diagnosis.label is None:
        raise InputError(f"{diagnosis.recording_id} has no verdict to explain: {diagnosis.no_verdict}")
    if diagnosis.recording_id != recording.recording_id or set(diagnosis.probabilities) != set(classifier.classes):
        raise InputError(f"the diagnosis is of {diagnosis.recording_id}, or by another classifier; diagnose this one.")
    if len(classifier.classes) < 2:
        raise InputError("a classifier of one class has nothing to decide.")
    scaled_classifier, parts = fit_to_recording(classifier, recording)
    answers = [scaled_classifier.answer(windows) for windows in parts()]
    probability, features = (np.concatenate(part) for part in zip(*answers, strict=True))
    ranked = sorted(diagnosis.probabilities, key=lambda name: (name != diagnosis.label, -diagnosis.probabilities[name]))
    label, rival = (classifier.classes.index(name) for name in ranked[:2])
    logarithm = np.log(np.maximum(probability, 1e-12))
    first = _best_run(logarithm[:, label] - logarithm[:, rival])
    count, length = min(MOST_WINDOWS, len(probability)), classifier.length
    piece = recording.relabeled(None).slice(first * length, (first + count) * length)
    windows = cut_windows([piece], length=length, classes=classifier.classes, allow_partial_revolution=True)
    scaled = scaled_classifier.normalization.apply(windows)
    gradient, change = mean_gradients(scaled_classifier.network, scaled, label, rival)
    if not np.isfinite(gradient).all():
        raise DataError(f"{recording.recording_id}: the network's gradients are not finite; is a sample too large?")
    x, g, samples = (
        part.transpose(1, 0, 2).reshape(part.shape[1], -1).astype(np.float64)
        for part in (scaled, gradient, windows.signal)
    )
    bands = _bands(classifier.sample_rate, stated_speed(recording), x.shape[1])
    edges = np.linspace(0, x.shape[1], _MOMENTS * count + 1).astype(np.int64)[:-1]
    margin = float(change.mean())
    return Evidence(
        recording_id=recording.recording_id,
        label=ranked[0],
        rival=ranked[1],
        margin=margin,
        gap=abs(float((x * g).sum()) / count - margin) / max(abs(margin), 1e-12),
        start=first * length / classifier.sample_rate,
        channels=classifier.channels,
        unit=classifier.layout.unit,
        moments=np.add.reduceat(x * g, edges, axis=1) / count,
        peaks=np.maximum.reduceat(np.abs(samples), edges, axis=1),
        moment=x.shape[1] / classifier.sample_rate / edges.size,
        bands=bands,
        lines=_band_sums(line_shares(x, g), bands, classifier.sample_rate, x.shape[1]) / count,
        rms=np.sqrt(_band_sums(_powers(samples), bands, classifier.sample_rate, x.shape[1])),
        pistons=pistons,
        nearest=_nearest(classifier, features),
        checks=_checks(diagnosis.label, diagnosis.trust),
    )


def _checks(label: str, trust: Trust | None) -> tuple[Check, ...]:
    """Those of the class named, and of the next where that one cannot be ruled out."""
    if trust is None:
        return next_checks(label)
    return next_checks(*trust.prediction_set[:2], unknown=trust.unknown)


def _best_run(margin: Float64[np.ndarray, " window"]) -> int:
    """First of the windows in a row with the greatest margin together."""
    if margin.size <= MOST_WINDOWS:
        return 0
    together = np.convolve(margin, np.ones(MOST_WINDOWS), mode="valid")
    return int(together.argmax())


def _bands(sample_rate: float, shaft: float | None, n_samples: int) -> tuple[Band, ...]:
    """Orders as far as the samples resolve them, and third octaves above; they cover all frequencies, without gap."""
    nyquist, bands = sample_rate / 2, list[Band]()
    edge, resolution = max(sample_rate / n_samples, 1.0), sample_rate / n_samples
    if shaft is not None and resolution < shaft / 4 and 1.5 * shaft < nyquist:
        edge = 0.5 * shaft
        bands.append(Band("below order 0.5", 0.0, edge))
        for order in range(1, ORDERS + 1):
            if (order + 0.5) * shaft > nyquist:
                break
            edge = (order + 0.5) * shaft
            bands.append(Band(f"order {order}", (order - 0.5) * shaft, edge, order))
    else:
        bands.append(Band(f"below {hertz(edge)}", 0.0, edge))
    while edge < nyquist:
        above = min(edge * 2 ** (1 / 3), nyquist)
        if above * 2 ** (1 / 6) > nyquist:
            above = nyquist
        bands.append(Band(f"{hertz(edge)} to {hertz(above)}", edge, above))
        edge = above
    return tuple(bands)


def hertz(frequency: float) -> str:
    """Frequency in words, with two digits of kHz or three of Hz."""
    return f"{frequency / 1000:.2g} kHz" if frequency >= 1000 else f"{frequency:.3g} Hz"


def _band_sums(
    lines: Float64[np.ndarray, "channel line"], bands: tuple[Band, ...], sample_rate: float, n_samples: int
) -> Float64[np.ndarray, "channel band"]:
    """Sum of the lines in each band; the last holds the last line too."""
    frequency = line_frequencies(n_samples, sample_rate)
    band = np.clip(np.searchsorted([band.high for band in bands], frequency, side="right"), 0, len(bands) - 1)
    return np.stack([np.bincount(band, weights=row, minlength=len(bands)) for row in lines])


def _powers(samples: np.ndarray) -> Float64[np.ndarray, "channel line"]:
    """Mean square of each line, mean removed."""
    moving = samples - samples.mean(axis=1, keepdims=True)
    return np.asarray(np.maximum(line_shares(moving, moving), 0.0) / samples.shape[1], dtype=np.float64)


def _nearest(classifier: FittedClassifier, features: np.ndarray) -> tuple[Neighbor, ...]:
    reference = classifier.training_reference
    if reference is None:
        return ()
    distance = reference.distances(features.mean(axis=0))
    return tuple(
        Neighbor(reference.recording_id[index], reference.label[index], float(distance[index]))
        for index in np.argsort(distance, kind="stable")[:_NEIGHBORS]
        if math.isfinite(distance[index])
    )
