"""Posts messages of alarms to the outbox, one for each channel."""

from collections.abc import Sequence
from dataclasses import asdict
from hashlib import sha256

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
    ) -> None:
        """Post a message about an alarm to every channel.

        Parameters
        ----------
        event : what happened to the alarm, as in `AlarmMessage`.
        judgment : the recording that caused the event.
        reasons : sentences that follow the suspect and its severity.
        """
        known_facts = []
        if event in ("opened", "measured"):
            for name in ("suspect", "severity"):
                fact = alarm.evidence.get(name)
                if fact:
                    known_facts.append(fact["sentence"])

        message = AlarmMessage(
            machine=transaction.name,
            point=alarm.point or "any",
            kind=alarm.kind,
            event=event,
            time=judgment.time.isoformat(),
            identity=_message_identity(event, alarm, judgment),
            reasons=(*known_facts, *reasons),
            link=f"{self._page_address}/alarms/{alarm.id}",
        )
        for channel in self._channels:
            transaction.post(channel.name, asdict(message), alarm.id)


def _message_identity(event: str, alarm: Alarm, judgment: Judgment) -> str:
    """Return a name that is equal for a message that is sent twice, and for no other message.

    The severity is part of it because the same recording may be measured again after a restart.
    """
    severity = alarm.evidence.get("severity", {}).get("sentence", "")
    severity_digest = sha256(severity.encode()).hexdigest()[:8]
    return f"alarm-{alarm.id}-{event}-{severity_digest}-{judgment.content[:16]}"
