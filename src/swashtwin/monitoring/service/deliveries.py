"""What is wrong with the deliveries of a machine: refused ones, and ones with a wrong clock.

A machine of which nothing can be used is not normal, so several such deliveries in a row are an
alarm of the machine.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from hashlib import sha256
from typing import Literal

from swashtwin.foundation import from_table, to_table
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.schema import Alarm
from swashtwin.monitoring.history.transaction import MachineTransaction
from swashtwin.monitoring.service.alarm_messages import AlarmPoster, Occasion
from swashtwin.monitoring.sources.delivery import REJECTION_REASONS, Delivery

MAX_DELAY = timedelta(minutes=5)
"""How much older than the machine's newest recording one may be: sources deliver in parallel, so
recordings of one machine may arrive in another order than they were measured.
"""
CLOCK_JUMP = timedelta(minutes=15)
"""How much older than the newest recording one is whose clock was set back. Daylight saving time
sets clocks back by an hour, which the time between two recordings hides in part; a lost battery by
years.
"""
MAX_LATE = 2
"""Late deliveries in a row that are refused: if more come, the clock was set back."""
N_IN_A_ROW = 3
"""Deliveries in a row with a finding that are an alarm: one alone may be an accident."""
UNCOUNTED_REASONS = ("double", "rest", "machine")
"""Reasons of a rejection that are no finding: a delivery may be repeated, a pump may stand still,
and an unknown machine has no alarms.
"""
FINDING_NAMES = {
    **REJECTION_REASONS,
    "clock": "wrong clock",
    "double": "the same samples again",
}
ALARM_KIND = "delivery"


@dataclass(frozen=True)
class DeliveryFinding:
    """What is wrong with one delivery."""

    kind: str
    """``clock``, or the code of a reason of `REJECTION_REASONS`."""
    sentence: str
    """The finding in words."""


@dataclass(frozen=True)
class DeliveryState:
    """What is remembered of the deliveries of a machine."""

    newest: datetime | None = None
    """Date of the newest recording that was filed by its date (UTC)."""
    n_findings: int = 0
    """Deliveries in a row that had a finding."""
    n_late: int = 0
    """Late deliveries in a row that were refused."""
    wrong_date: datetime | None = None
    """Date of the previous delivery if it was filed by its arrival since its clock was set back."""
    wrong_received: datetime | None = None
    """When that delivery arrived."""
    counted: str = ""
    """Identity of the delivery that was counted last: a kill may repeat it."""


Placement = Literal["date", "late", "clock"]
"""Where a recording is filed: at its date, not at all, or at its time of arrival."""


def place(state: DeliveryState, date: datetime, received: datetime) -> Placement:
    """Return where a recording belongs by its date.

    Dates that rise are right, however old they are: an archive is delivered long after it was
    recorded. A date far before that of the newest recording is one of a clock that was set back.

    Examples
    --------
    >>> from datetime import UTC
    >>> noon = datetime(2026, 11, 23, 12, tzinfo=UTC)
    >>> state = DeliveryState(newest=noon)
    >>> place(state, noon - timedelta(minutes=4), noon + timedelta(days=9))
    'date'
    >>> place(state, noon - timedelta(minutes=10), noon + timedelta(minutes=1))
    'late'
    >>> place(state, noon - timedelta(hours=1), noon + timedelta(minutes=1))
    'clock'
    """
    if state.wrong_date is not None and state.wrong_received is not None:
        # A clock that was set back stays behind by the same time.
        change = (received - date) - (state.wrong_received - state.wrong_date)
        if abs(change) <= MAX_DELAY:
            return "clock"

    # A newest recording from the future was stored before this computer's clock was set back.
    if state.newest is None or state.newest > received:
        return "date"
    if date >= state.newest - MAX_DELAY:
        return "date"
    is_far = date < state.newest - CLOCK_JUMP
    if is_far or state.wrong_date is not None or state.n_late >= MAX_LATE:
        return "clock"
    return "late"


def identity_of(delivery: Delivery) -> str:
    """Return a text that tells a delivery from all others."""
    text = f"{delivery.source} {delivery.file} {delivery.received.isoformat()}"
    return sha256(text.encode(errors="replace")).hexdigest()


class DeliveryMonitor:
    """Counts deliveries with a finding, and raises and clears the alarm of a machine."""

    def __init__(self, config: WatchConfig) -> None:
        self._poster = AlarmPoster(config)

    def load(self, transaction: MachineTransaction) -> DeliveryState:
        """Return what is remembered of the machine's deliveries."""
        table = transaction.delivery_state()
        if table is None:
            return DeliveryState(newest=transaction.newest())
        return from_table(table, DeliveryState)

    def count(
        self,
        transaction: MachineTransaction,
        state: DeliveryState,
        delivery: Delivery,
        findings: Sequence[DeliveryFinding],
    ) -> str | None:
        """Save the state after a delivery, and return what is wrong with the deliveries.

        Parameters
        ----------
        state : state with the times of this delivery, but not its findings.
        findings : what is wrong with it; empty if it could be used.
        """
        identity = identity_of(delivery)
        n_findings = 0
        if findings:
            n_findings = state.n_findings + (identity != state.counted)
        state = replace(state, n_findings=n_findings, counted=identity)
        transaction.save_delivery_state(to_table(state))

        alarm = _stored_alarm(transaction)
        if findings and n_findings >= N_IN_A_ROW:
            return self.report(transaction, delivery, findings, n_findings)
        if not findings and alarm is not None and alarm.cleared is None:
            self._clear(transaction, alarm, delivery)
            return None
        return active_problem(alarm)

    def report(
        self,
        transaction: MachineTransaction,
        delivery: Delivery,
        findings: Sequence[DeliveryFinding],
        count: int,
    ) -> str:
        """Raise the alarm of a machine, or renew its reasons, and return them in one sentence."""
        latest = findings[0]
        headline = (
            f"{count} deliveries in a row have a problem; the last one is {delivery.file} "
            f"({FINDING_NAMES.get(latest.kind, latest.kind)})."
        )
        reasons = [headline, *(finding.sentence for finding in findings)]
        evidence = {"reasons": reasons, "findings": to_table(findings), "deliveries": count}

        alarm = _stored_alarm(transaction)
        is_new = alarm is None or alarm.cleared is not None
        if alarm is None:
            alarm = transaction.open_alarm(ALARM_KIND, None, delivery.received, evidence, None)
        alarm.evidence = evidence
        alarm.cleared = None

        occasion = _occasion(delivery)
        if is_new and not transaction.silenced(delivery.received):
            self._poster.post(transaction, "opened", alarm, occasion, reasons)
        self._poster.post_unreported(transaction, occasion)
        return " ".join(reasons)

    def _clear(self, transaction: MachineTransaction, alarm: Alarm, delivery: Delivery) -> None:
        event = "closed" if alarm.state == "acknowledged" else "cleared"
        transaction.clear_alarm(alarm.id, delivery.received)
        if not transaction.silenced(delivery.received):
            self._poster.post(transaction, event, alarm, _occasion(delivery), ())


def active_problem(alarm: Alarm | None) -> str | None:
    """Return the reasons of an alarm of deliveries in one sentence; None if its cause is gone."""
    if alarm is None or alarm.kind != ALARM_KIND or alarm.cleared is not None:
        return None
    return " ".join(alarm.evidence["reasons"])


def _stored_alarm(transaction: MachineTransaction) -> Alarm | None:
    alarms = [alarm for alarm in transaction.alarms() if alarm.kind == ALARM_KIND]
    return next(reversed(alarms), None)


def _occasion(delivery: Delivery) -> Occasion:
    return Occasion(delivery.received, delivery.received, identity_of(delivery))
