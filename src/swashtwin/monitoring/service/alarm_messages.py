"""Posts messages of alarms to the outbox, one for each channel."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from hashlib import sha256
from typing import Any

from swashtwin.monitoring.alarms.channels import AlarmMessage
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.schema import Alarm, Judgment
from swashtwin.monitoring.history.transaction import MachineTransaction


class AlarmPoster:
    """Words messages of alarms, and posts them with the transaction that changes the alarm."""

    def __init__(self, config: WatchConfig) -> None:
        self._channels = config.channels
        self._page_address = config.page.address

    def post(
        self,
        transaction: MachineTransaction,
        event: str,
        alarm: Alarm,
        judgment: Judgment,
        reasons: Sequence[str],
        *,
        time: datetime | None = None,
    ) -> None:
        """Post a message about an alarm to every channel.

        Parameters
        ----------
        event : what happened to the alarm, as in `AlarmMessage`.
        judgment : the recording that caused the event.
        reasons : sentences that follow the suspect and its severity.
        time : time of the event, by default that of the recording.
        """
        if time is None:
            time = judgment.time

        known_facts = []
        if event in ("opened", "measured"):
            for name in ("suspect", "severity"):
                fact = alarm.evidence.get(name)
                if fact:
                    known_facts.append(_with_date(fact, time))

        message = AlarmMessage(
            machine=transaction.name,
            point=alarm.point or "any",
            kind=alarm.kind,
            event=event,
            time=time.isoformat(),
            identity=_message_identity(event, alarm, judgment),
            reasons=(*known_facts, *reasons),
            link=f"{self._page_address}/alarms/{alarm.id}",
        )
        for channel in self._channels:
            transaction.post(channel.name, asdict(message), alarm.id)


def _with_date(fact: Mapping[str, Any], time: datetime) -> str:
    """Return the sentence of a fact, with the time of its recording if the message has another."""
    measured = datetime.fromisoformat(fact["time"])
    if measured == time:
        return str(fact["sentence"])
    return f"Recording of {measured:%Y-%m-%d %H:%M} UTC: {fact['sentence']}"


def _message_identity(event: str, alarm: Alarm, judgment: Judgment) -> str:
    """Return a name that is equal for a message that is sent twice, and for no other message.

    The severity is part of it because the same recording may be measured again after a restart.
    """
    severity = alarm.evidence.get("severity", {}).get("sentence", "")
    severity_digest = sha256(severity.encode()).hexdigest()[:8]
    return f"alarm-{alarm.id}-{event}-{severity_digest}-{judgment.content[:16]}"
