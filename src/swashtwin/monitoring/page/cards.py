"""The cards of the start page: how urgent a machine is, why, and what to do."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import dropwhile
from typing import Any

from markupsafe import Markup

from swashtwin.monitoring.history.reading import MachineOverview, ScoredRecording
from swashtwin.monitoring.history.schema import Alarm, Judgment
from swashtwin.monitoring.page.advice import checks_of_alarm
from swashtwin.monitoring.page.charts import draw_spark
from swashtwin.monitoring.page.formatting import format_duration, format_label, number, percent
from swashtwin.monitoring.page.states import STATES, MachineState, state_of
from swashtwin.pump import is_healthy

MIN_SILENCE = timedelta(days=1)
"""Shortest time without a recording after which a machine counts as silent."""
N_SILENT_INTERVALS = 3
"""Mean intervals of a machine's recordings without one, after which it counts as silent: a machine
that is recorded once a week is not silent on the second day.
"""
N_CHECKS = 2
"""Checks on a card; the page of the recording lists all of them."""
SILENT = MachineState("silent", "No recording", "◌")
"""What the start page counts and filters besides `STATES`: machines that have fallen silent."""

# States in which a machine needs a person.
_URGENT_STATES = frozenset(("alarm", "sensor", "delivery", "acknowledged", "unusual"))

_RANKS = {state.code: rank for rank, state in enumerate(STATES)}

# Kinds of alarms, most urgent first, as in `state_of`.
_ALARM_KINDS = ("pump", "sensor", "delivery")

_FIRST_SENTENCE = re.compile(r".*?\.(?= |$)")


@dataclass(frozen=True)
class Standing:
    """How a machine stands: what the start page sorts, counts and filters by."""

    machine: MachineOverview
    """Summary of the machine."""
    state: MachineState
    """Its most urgent state."""
    site: str
    """Place of the machine; empty if the configuration names none."""
    is_silent: bool
    """Whether it has sent nothing for an unusually long time."""

    @classmethod
    def of(cls, machine: MachineOverview, site: str, now: datetime) -> "Standing":
        """Return the standing of a machine."""
        return cls(machine, state_of(machine), site, _is_silent(machine, now))

    @property
    def shown_state(self) -> MachineState:
        """State on the card: nobody knows whether a silent machine is still normal."""
        if self.is_silent and self.state.code not in _URGENT_STATES:
            return SILENT
        return self.state

    @property
    def needs_attention(self) -> bool:
        """Whether a person should look at the machine."""
        return self.is_silent or self.state.code in _URGENT_STATES

    @property
    def urgency(self) -> tuple[bool, str, int, float, str]:
        """Key by which machines are sorted, the most urgent first.

        Machines that need attention come before all others, whatever their site. In the same state
        the one that deviates most comes first.
        """
        group = self.site
        score = 0.0
        if self.needs_attention:
            group = ""
            if self.machine.last is not None:
                score = self.machine.last.reasons.get("score") or 0.0
        rank = _RANKS[self.state.code]
        return not self.needs_attention, group, rank, -score, self.machine.name

    def matches(self, state: str, text: str) -> bool:
        """Return whether the machine has a state, and a text in its name or site."""
        if state == SILENT.code:
            has_state = self.is_silent
        else:
            has_state = state in ("", self.state.code)
        names = f"{self.machine.name}\n{self.site}".casefold()
        return has_state and text.casefold() in names


def _is_silent(machine: MachineOverview, now: datetime) -> bool:
    if machine.last is None or machine.first is None:
        return False
    span = machine.last.time - machine.first
    mean_interval = span / max(machine.recordings - 1, 1)
    return now - machine.last.time > max(MIN_SILENCE, N_SILENT_INTERVALS * mean_interval)


@dataclass(frozen=True)
class Severity:
    """Estimate of the size of a fault."""

    text: str
    """Dimension, value, interval and verdict."""
    time: datetime
    """When the recording was measured from which it was estimated."""


@dataclass(frozen=True)
class Card:
    """What the start page shows of a machine."""

    standing: Standing
    duration: str
    """How long the machine has been in its state."""
    suspect: str
    """Which part is suspected, in one sentence; empty without a suspect."""
    severity: Severity | None
    """Size of the suspected fault."""
    verdict: str
    """What the machine's model found in the newest recording; empty if that is healthy."""
    why: str
    """What was observed; empty if nothing is wrong."""
    checks: Sequence[str]
    """What to do, in this order; empty if nothing is to be done."""
    spark: Markup
    """Line of the deviation over time; empty if no recording was compared."""
    spark_caption: str
    """Time that the line covers, and its newest value."""


def build_card(standing: Standing, scores: Sequence[ScoredRecording], now: datetime) -> Card:
    """Return the card of a machine.

    Parameters
    ----------
    scores : of its newest recordings, oldest first.
    """
    alarm = _most_urgent_alarm(standing.machine.alarms)
    suspect: dict[str, Any] | None = None
    if alarm is not None:
        suspect = alarm.evidence.get("suspect")

    spark = Markup("")
    caption = ""
    compared = list(dropwhile(lambda recording: recording.score is None, scores))
    if compared:
        opening_times = [alarm.opened for alarm in standing.machine.alarms]
        spark = draw_spark(compared, opening_times)
        period = format_duration(compared[-1].time - compared[0].time)
        newest_score = [row.score for row in compared if row.score is not None][-1]
        caption = f"Deviation over {period}, now {number(newest_score, 2)} times the healthy spread"

    return Card(
        standing,
        duration=_describe_duration(standing, alarm, scores, now),
        suspect=_shorten_suspect(suspect),
        severity=_read_severity(alarm),
        verdict=_describe_verdict(standing.machine.last),
        why=_explain(standing, alarm),
        checks=_advise(standing, alarm),
        spark=spark,
        spark_caption=caption,
    )


def _most_urgent_alarm(alarms: Sequence[Alarm]) -> Alarm | None:
    """Return the alarm that decides the state of a machine: an open one, of the pump first."""
    ranked = sorted(
        alarms, key=lambda alarm: (alarm.state != "open", _ALARM_KINDS.index(alarm.kind), alarm.id)
    )
    return next(iter(ranked), None)


def _describe_duration(
    standing: Standing,
    alarm: Alarm | None,
    scores: Sequence[ScoredRecording],
    now: datetime,
) -> str:
    machine = standing.machine
    code = standing.state.code
    if alarm is not None:
        begin = alarm.opened if alarm.acknowledged is None else alarm.acknowledged
        return f"for {format_duration(now - begin)}"

    newest = machine.last
    if newest is None:
        return ""
    if standing.shown_state is SILENT:
        return f"for {format_duration(now - newest.time)}"
    if code == "learning":
        # After a maintenance the newest recording is still one of the previous baseline.
        learned = newest.reasons.get("learned", 0) if newest.state == "learning" else 0
        total = newest.reasons.get("learning")
        return f"{learned} of {total} recordings" if total else ""
    if code == "unusual":
        begin, is_complete = _start_of_run(scores)
        over = "" if is_complete else "over "
        return f"for {over}{format_duration(now - begin)}"

    times = [time for time in (machine.closed, machine.maintained, machine.first) if time]
    return f"no alarm for {format_duration(now - max(times))}"


def _start_of_run(scores: Sequence[ScoredRecording]) -> tuple[datetime, bool]:
    """Return the time of the first recording in the newest one's state.

    The second value is false if the state may have begun earlier.
    """
    newest = scores[-1]
    begin = newest.time
    for recording in reversed(scores):
        if recording.state != newest.state:
            return begin, True
        begin = recording.time
    return begin, False


def _shorten_suspect(suspect: dict[str, Any] | None) -> str:
    """Return the suspect without its explanation, which the page of the machine has."""
    if not suspect:
        return ""
    if suspect["certainty"] == "none":
        return "No suspect is named."
    sentence: str = suspect["sentence"]
    match = _FIRST_SENTENCE.match(sentence)
    return sentence if match is None else match[0]


def _read_severity(alarm: Alarm | None) -> Severity | None:
    """Return the severity of an alarm's suspect; `None` if it was not estimated."""
    if alarm is None:
        return None
    severity = alarm.evidence.get("severity") or {}
    suspect = alarm.evidence.get("suspect") or {}
    if "verdict" not in severity or severity["label"] != suspect.get("label"):
        return None

    low, high = (number(end, 2) for end in severity["interval"])
    value = number(severity["value"], 2)
    name = severity["dimension"].replace("_", " ")
    text = f"{name} {value} {severity['unit']} ({low} to {high})"
    # An interval alone states that a severity is identified; any other verdict is a reservation.
    if severity["verdict"] != "identified":
        text += f", {severity['verdict']}"
    return Severity(text, datetime.fromisoformat(severity["time"]))


def _describe_verdict(newest: Judgment | None) -> str:
    if newest is None or newest.label is None or is_healthy(newest.label):
        return ""
    if newest.probability is None:
        return format_label(newest.label)
    return f"{format_label(newest.label)} ({percent(newest.probability)})"


def _explain(standing: Standing, alarm: Alarm | None) -> str:
    """Return what was observed, in one sentence."""
    newest = standing.machine.last
    sentences: Sequence[str] = ()
    if alarm is not None and alarm.kind == "sensor":
        sentences = [finding["sentence"] for finding in alarm.evidence.get("findings", ())]
    elif alarm is not None:
        evidence = alarm.evidence
        sentences = evidence.get("newest", evidence).get("reasons", ())
    elif standing.state.code == "unusual" and newest is not None:
        sentences = newest.reasons.get("sentences", ())
    return next(iter(sentences), "")


def _advise(standing: Standing, alarm: Alarm | None) -> Sequence[str]:
    """Return what to do at the machine, in this order."""
    if alarm is not None and alarm.state == "acknowledged":
        note = f": {alarm.note}" if alarm.note else ""
        return (f"{alarm.who} is on it{note}",)
    if alarm is not None and alarm.cleared is not None:
        return ("Acknowledge the alarm: its cause is gone.",)
    if alarm is not None and alarm.kind == "sensor":
        return ("Check the sensor, its mounting and its cable.",)
    if alarm is not None and alarm.kind == "delivery":
        return ("Check the logger and its files: the machine is not watched.",)
    if alarm is not None:
        checks = checks_of_alarm(alarm, standing.machine.last)
        return [check.what for check in checks[:N_CHECKS]]
    if standing.state.code == "unusual":
        return ("Record it again: one recording alone may be a disturbance.",)
    if standing.is_silent:
        return ("Check the logger, the network and the source.",)
    return ()
