"""The forms of answers to programs: what ``/api`` promises, whatever the history looks like inside."""

from datetime import datetime
from typing import Any

from pydantic import BaseModel, Field

from swashtwin.monitoring.history import Alarm, Event, MachineOverview, Rejection, StoredRecording
from swashtwin.monitoring.page.content.machine_states import state_of


class AlarmAnswer(BaseModel):
    """An alarm."""

    id: int
    machine: str
    point: str | None = Field(description="operating point")
    kind: str = Field(description="`pump` or `sensor`")
    state: str = Field(description="`open`, `acknowledged` or `closed`")
    opened: datetime
    cleared: datetime | None
    closed: datetime | None
    acknowledged: datetime | None
    who: str | None
    note: str | None
    recording: int | None
    evidence: dict[str, Any]


class RecordingAnswer(BaseModel):
    """A recording that was judged."""

    id: int
    machine: str
    time: datetime
    received: datetime
    source: str
    file: str | None
    content: str = Field(description="SHA-256 of the content")
    state: str = Field(description="`learning`, `normal`, `unusual`, `alarm` or `sensor`")
    point: str | None
    speed: float | None = Field(description="rad/s")
    pressure: float | None = Field(description="Pa")
    sample_rate: float = Field(description="Hz")
    duration: float = Field(description="s")
    label: str | None
    probability: float | None
    confidence: float | None
    ood_p: float | None
    model: str | None
    alarm_p: float | None
    capital: float | None = Field(description="evidence; an alarm needs 1 / false_alarm_rate")
    reasons: dict[str, Any]
    has_samples: bool


class MachineAnswer(BaseModel):
    """A machine."""

    name: str
    state: str = Field(description="`alarm`, `sensor`, `acknowledged`, `unusual`, `normal`, `learning` or `empty`")
    recordings: int
    silenced_until: datetime | None
    last: RecordingAnswer | None
    alarms: list[AlarmAnswer]


class TrendAnswer(BaseModel):
    """One indicator over time."""

    recordings: list[int]
    times: list[datetime]
    values: list[float | None]


class LevelAnswer(BaseModel):
    """An indicator that a machine has."""

    channel: str
    name: str


class EventAnswer(BaseModel):
    """What happened to a machine."""

    id: int
    machine: str
    time: datetime
    kind: str
    who: str
    note: str


class RejectionAnswer(BaseModel):
    """A recording that was not judged."""

    received: datetime
    source: str
    file: str
    machine: str | None
    reason: str
    detail: str
    times: int = Field(description="how often it came")


class Note(BaseModel):
    """A remark of the one who acts."""

    note: str = Field("", max_length=500)


class SilenceRequest(Note):
    """How long no messages are sent."""

    hours: float = Field(gt=0, le=24 * 366)


class EventRequest(Note):
    """An event to add."""

    kind: str = Field("note", pattern="^(note|maintenance)$")


def alarm_answer(alarm: Alarm) -> AlarmAnswer:
    """An alarm for programs."""
    return AlarmAnswer(**{name: getattr(alarm, name) for name in AlarmAnswer.model_fields})


def recording_answer(stored: StoredRecording) -> RecordingAnswer:
    """A recording for programs."""
    judgment = {name: value for name, value in vars(stored.judgment).items() if name in RecordingAnswer.model_fields}
    return RecordingAnswer(id=stored.id, machine=stored.machine, has_samples=stored.waveform is not None, **judgment)


def machine_answer(machine: MachineOverview) -> MachineAnswer:
    """A machine for programs."""
    return MachineAnswer(
        name=machine.name,
        state=state_of(machine).code,
        recordings=machine.recordings,
        silenced_until=machine.silenced,
        last=None if machine.last is None else recording_answer(machine.last),
        alarms=[alarm_answer(alarm) for alarm in machine.alarms],
    )


def event_answer(event: Event) -> EventAnswer:
    """An event for programs."""
    return EventAnswer(**{name: getattr(event, name) for name in EventAnswer.model_fields})


def rejection_answer(rejection: Rejection) -> RejectionAnswer:
    """A recording that was not judged, for programs."""
    return RejectionAnswer(**{name: getattr(rejection, name) for name in RejectionAnswer.model_fields})
