"""Posts messages of alarms to the outbox, one for each channel."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from hashlib import sha256
from typing import Any

from swashtwin.foundation import convert_pressures
from swashtwin.monitoring.alarms.channels import AlarmMessage
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.schema import Alarm
from swashtwin.monitoring.history.transaction import MachineTransaction

IDENTITY_LENGTH = 16
"""Characters of a content's hash in the identity of a message."""


@dataclass(frozen=True)
class Occasion:
    """The recording or delivery about which a message is posted."""

    time: datetime
    """Time of the event: when the recording was measured (UTC)."""
    received: datetime
    """When it arrived (UTC)."""
    content: str
    """Hash by which it is told from others."""


class AlarmPoster:
    """Words messages of alarms, and posts them with the transaction that changes the alarm."""

    def __init__(self, config: WatchConfig) -> None:
        self._channels = config.channels
        self._page_address = config.page.address
        self._pressure_unit = config.pressure_unit

    def post(
        self,
        transaction: MachineTransaction,
        event: str,
        alarm: Alarm,
        occasion: Occasion,
        reasons: Sequence[str],
    ) -> None:
        """Post a message about an alarm to every channel.

        Parameters
        ----------
        event : what happened to the alarm, as in `AlarmMessage`.
        occasion : what caused the event.
        reasons : sentences that follow the suspect and its severity.
        """
        known_facts = []
        if event in ("opened", "measured"):
            for name in ("suspect", "severity"):
                fact = alarm.evidence.get(name)
                if fact:
                    known_facts.append(_with_date(fact, occasion.time))

        message = AlarmMessage(
            machine=transaction.name,
            point=self._convert(alarm.point or "any"),
            kind=alarm.kind,
            event=event,
            time=occasion.time.isoformat(),
            identity=_message_identity(event, alarm, occasion),
            reasons=tuple(self._convert(reason) for reason in (*known_facts, *reasons)),
            link=f"{self._page_address}/alarms/{alarm.id}",
        )
        for channel in self._channels:
            transaction.post(channel.name, asdict(message), alarm.id)

    def _convert(self, text: str) -> str:
        return convert_pressures(text, self._pressure_unit)

    def post_unreported(self, transaction: MachineTransaction, occasion: Occasion) -> None:
        """Post the alarms that were raised during a silence, now that it has ended."""
        alarms = [alarm for alarm in transaction.unreported_alarms() if alarm.cleared is None]
        if not alarms or transaction.silenced(occasion.received):
            return
        for alarm in alarms:
            raised = replace(occasion, time=alarm.opened)
            self.post(transaction, "opened", alarm, raised, alarm.evidence.get("reasons", ()))


def _with_date(fact: Mapping[str, Any], time: datetime) -> str:
    """Return the sentence of a fact, with the time of its recording if the message has another."""
    measured = datetime.fromisoformat(fact["time"])
    if measured == time:
        return str(fact["sentence"])
    return f"Recording of {measured:%Y-%m-%d %H:%M} UTC: {fact['sentence']}"


def _message_identity(event: str, alarm: Alarm, occasion: Occasion) -> str:
    """Return a name that is equal for a message that is sent twice, and for no other message.

    The severity is part of it because the same recording may be measured again after a restart.
    """
    severity = alarm.evidence.get("severity", {}).get("sentence", "")
    severity_digest = sha256(severity.encode()).hexdigest()[:8]
    return f"alarm-{alarm.id}-{event}-{severity_digest}-{occasion.content[:IDENTITY_LENGTH]}"
