"""`AnomalyDetector`: alarms at a stated false-alarm rate, learned from healthy recordings alone."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from swashtwin.diagnosis.healthy_spectrum import HealthySpectrum, detector_spectrum
from swashtwin.diagnosis.layout import require_layout
from swashtwin.diagnosis.level_change import LevelChange, level_changes
from swashtwin.foundation import DataError, InputError, load_artifact, save_artifact
from swashtwin.learning import (
    USUAL_ERROR_RATE,
    Deviation,
    HealthyLevels,
    Level,
    LevelLayout,
    allowed_error_rate,
    least_validation,
    measure_healthy,
)
from swashtwin.pump import is_healthy
from swashtwin.recordings import (
    Manifest,
    Recording,
    RecordingFacts,
    facts_of,
    manifest_of,
    seen_recordings,
    stated_speed,
)

_VERSION = 2
_MAY_BE_NAN = ("healthy.speed", "healthy.pressure")


@dataclass(frozen=True, eq=False)
class AnomalyVerdict:
    """Whether a recording deviates from the healthy ones of its machine."""

    recording_id: str
    """The recording that was judged."""
    alarm: bool | None
    """Whether it is further from the healthy recordings than the false-alarm rate allows; None without a verdict."""
    p_value: float
    """Chance that a healthy recording is as far, 1 / (n + 1) at least; NaN without a verdict."""
    error_rate: float
    """False-alarm rate: an alarm is raised where `p_value` is at most this."""
    n_healthy: int
    """Number of healthy recordings that it was compared with."""
    shifts: tuple[str, ...]
    """Channels that moved as a whole, in words."""
    changes: tuple[LevelChange, ...]
    """Levels that moved, furthest first; also without an alarm."""
    notes: tuple[str, ...]
    """What a reader should know before trusting it."""
    no_verdict: str | None = None
    """Why there is no verdict; None where there is one."""
    deviation: Deviation | None = None
    """All levels' changes; None without a verdict."""
    levels: tuple[Level, ...] = ()
    """What each level is."""
    facts: RecordingFacts = field(default_factory=RecordingFacts)
    """Machine, date, condition and file of the recording, as far as it states them."""
    spectrum: HealthySpectrum | None = None
    """Its levels over those of the healthy recordings; None without a verdict."""

    def __repr__(self) -> str:
        return f"<AnomalyVerdict on {self.recording_id}: {self.sentence()}>"

    def sentence(self) -> str:
        """The verdict in one sentence."""
        if self.alarm is None:
            return f"no verdict. {self.no_verdict}"
        rate, least = f"{100 * self.error_rate:.3g} %", 1 / (self.n_healthy + 1)
        less = "or less" if self.p_value <= least * (1 + 1e-9) else ""
        p_value = f"p = {self.p_value:.3g} {less}".rstrip()
        moved = "; ".join((*self.shifts, *(change.sentence for change in self.changes[:3])))
        moved = f" Moved: {moved}." if moved else ""
        if self.alarm:
            return f"alarm at a false-alarm rate of {rate} ({p_value}, {self.n_healthy} healthy recordings).{moved}"
        return f"no alarm at a false-alarm rate of {rate} ({p_value}, {self.n_healthy} healthy recordings)."

    def to_dict(self) -> dict[str, Any]:
        """Numbers, words and lists that JSON can hold."""
        deviation = self.deviation
        return {
            "recording_id": self.recording_id,
            "alarm": self.alarm,
            "p_value": None if deviation is None else self.p_value,
            "score": None if deviation is None else deviation.score,
            "error_rate": self.error_rate,
            "n_healthy": self.n_healthy,
            "point": None if deviation is None else deviation.point,
            "shifts": list(self.shifts),
            "changes": [change.to_dict() for change in self.changes],
            "notes": list(self.notes),
            "no_verdict": self.no_verdict,
        }


@dataclass(frozen=True, eq=False)
class AnomalyDetector:
    """Levels of healthy recordings, and the false-alarm rate; `fit` makes it."""

    KIND: ClassVar[str] = "anomaly detector"
    """Kind of its file."""

    healthy: HealthyLevels
    """What a recording is compared with."""
    error_rate: float
    """False-alarm rate."""
    notes: tuple[str, ...] = ()
    """What was left out, and what so many recordings cannot give."""

    def __post_init__(self) -> None:
        require_allowed(self.healthy.n_recordings, self.error_rate)

    def __repr__(self) -> str:
        return (
            f"<AnomalyDetector: {self.healthy.n_recordings} healthy recordings at {len(self.healthy.points)} operating "
            f"point(s), false-alarm rate {self.error_rate:g}>"
        )

    @classmethod
    def fit(
        cls,
        recordings: Sequence[Recording],
        *,
        error_rate: float | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> "AnomalyDetector":
        """Detector of deviations from healthy recordings, with a stated false-alarm rate.

        Levels in bands, at shaft orders, and of the envelope are compared with those of the same machine at the same
        operating point; how much they scatter is learned from all points together (docs/explanation/diagnosis.md).

        Parameters
        ----------
        recordings : healthy ones, labeled so or not at all; 20 allow a rate of 0.05, n of them 1 / (n + 1).
        error_rate : false-alarm rate by recording; 0.05 by default, or the least that the recordings allow.
        progress : called with the number of recordings that are done, and of all.

        Raises
        ------
        DataError
            A recording has a label that is not healthy, or they are unfit, do not fit together, or are too few.
        InputError
            A false-alarm rate that the recordings are too few for.
        """
        for recording in recordings:
            if recording.label is not None and not is_healthy(recording.label):
                raise DataError(
                    f"{recording.recording_id} is labeled {recording.label!r}; an anomaly detector learns from healthy "
                    "recordings alone: leave the others out, or train a classifier on two classes or more."
                )
        if error_rate is not None:
            require_allowed(len(recordings), error_rate)
        healthy, notes = measure_healthy(recordings, progress=progress)
        allowed = allowed_error_rate(healthy.n_recordings, USUAL_ERROR_RATE) if error_rate is None else error_rate
        if error_rate is None and allowed > USUAL_ERROR_RATE:
            few = (
                f"{healthy.n_recordings} healthy recordings allow no false-alarm rate below {allowed:g}; "
                f"{USUAL_ERROR_RATE:g} takes {least_validation(USUAL_ERROR_RATE)}."
            )
            notes = (*notes, few)
        return cls(healthy, allowed, notes)

    @property
    def layout(self) -> LevelLayout:
        """What recordings must have in common with the healthy ones, and which levels are compared."""
        return self.healthy.layout

    @property
    def manifest(self) -> Manifest:
        """The healthy recordings, by id and content."""
        return self.healthy.manifest

    def diagnose(self, recording: Recording, *, error_rate: float | None = None) -> AnomalyVerdict:
        """Whether a recording deviates from the healthy ones of its machine at its operating point, and in what.

        A recording that cannot be used, or of a machine or operating point without healthy recordings, has no verdict.

        Parameters
        ----------
        error_rate : false-alarm rate; the detector's own by default.

        Raises
        ------
        DataError
            The recording has another sample rate, other channels or another unit.
        InputError
            A false-alarm rate that the healthy recordings are too few for.
        """
        rate = self.error_rate if error_rate is None else error_rate
        require_allowed(self.healthy.n_recordings, rate)
        require_layout(self.layout, recording)
        try:
            deviation = self.healthy.deviation(recording)
            seen = seen_recordings(self.manifest, manifest_of([recording]))
        except DataError as cause:
            return self._no_verdict(recording, rate, str(cause))
        if not math.isfinite(deviation.score):
            reason = "its levels are no finite numbers: a sample is far too large; cut it out or repair the file."
            return self._no_verdict(recording, rate, reason)
        notes = deviation.notes
        if seen:
            notes = (
                "It is one of the healthy recordings that made the detector; this proves nothing.",
                *notes,
            )
        shifts, changes = level_changes(deviation, self.layout.levels, stated_speed(recording))
        return AnomalyVerdict(
            recording_id=recording.recording_id,
            alarm=deviation.p_value <= rate * (1 + 1e-9),
            p_value=deviation.p_value,
            error_rate=rate,
            n_healthy=self.healthy.n_recordings,
            shifts=shifts,
            changes=changes,
            notes=notes,
            deviation=deviation,
            levels=self.layout.levels,
            facts=facts_of([recording]),
            spectrum=detector_spectrum(self.layout, deviation, self.healthy.members(recording)),
        )

    def _no_verdict(self, recording: Recording, rate: float, reason: str) -> AnomalyVerdict:
        count, facts = self.healthy.n_recordings, facts_of([recording])
        return AnomalyVerdict(recording.recording_id, None, math.nan, rate, count, (), (), (), reason, facts=facts)

    def save(self, path: Path | str) -> Path:
        """`path`, after the detector was written to it whole."""
        return save_artifact(path, self.KIND, _VERSION, self, may_be_nan=_MAY_BE_NAN)

    @classmethod
    def load(cls, path: Path | str) -> "AnomalyDetector":
        """The detector that `save` wrote.

        Raises
        ------
        MissingFileError
            There is no such file.
        ArtifactError
            It is damaged, no detector, or of another version.
        """
        advice = "swashtwin train, or its method save, writes a detector"
        return load_artifact(path, cls, cls.KIND, _VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)


def require_allowed(n_healthy: int, error_rate: float) -> None:
    """Refuse a false-alarm rate that so many healthy recordings cannot state."""
    needed = least_validation(error_rate)
    if n_healthy < needed:
        raise InputError(
            f"a false-alarm rate of {error_rate:g} needs {needed} healthy recordings at least, there are {n_healthy}; "
            f"record more, or allow {allowed_error_rate(n_healthy, error_rate):g}."
        )
