"""Sends the messages of the outbox to their channels, and repeats what failed."""

import logging
import threading
from collections.abc import Callable

from swashtwin.foundation import SwashTwinError
from swashtwin.monitoring.alarms.channels import AlarmMessage, send
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.schema import Message

POLL_INTERVAL_S = 0.5
"""Time between two looks into the outbox."""
FIRST_DELAY_S = 2.0
"""Time before the second attempt at a message; each further delay is twice the previous one."""
MAX_DELAY_S = 600.0
"""Longest delay: a server that is repaired gets what it missed within ten minutes."""
MAX_DOUBLINGS = 20
"""Limit of the exponent, so that a message that failed for weeks does not overflow a float."""
_log = logging.getLogger("swashtwin.watch")


class OutboxSender:
    """Sends messages for the channels of one configuration.

    Messages for other channels are left in the outbox: another watch may share the history.
    """

    def __init__(self, config: WatchConfig, history: History) -> None:
        self._history = history
        self._channels = {channel.name: channel for channel in config.channels}
        self._folder = config.folder
        self.waiting = 0
        """Messages that are not sent yet."""
        self.problem: str | None = None
        """What keeps messages from being sent, in one line."""

    def run(self, stop: threading.Event, after_poll: Callable[[], None]) -> None:
        """Send messages until `stop` is set.

        Parameters
        ----------
        after_poll : called after each look into the outbox.
        """
        while not stop.wait(POLL_INTERVAL_S):
            self.send_all()
            after_poll()

    def send_all(self) -> None:
        """Send all messages that are due."""
        names = tuple(self._channels)
        try:
            while messages := self._history.outbox.claim(names):
                for message in messages:
                    self._send(message)
            self.waiting = self._history.outbox.waiting(names)
        except HistoryError as cause:
            self.problem = str(cause)
            return

        if not self.waiting:
            self.problem = None

    def _send(self, message: Message) -> None:
        channel = self._channels[message.channel]
        try:
            send(AlarmMessage(**message.body), channel, folder=self._folder)
        except (SwashTwinError, OSError, ValueError, TypeError, KeyError) as cause:
            self.problem = str(cause)
            _log.warning("%s", self.problem)
            doublings = min(message.attempts, MAX_DOUBLINGS)
            delay = min(FIRST_DELAY_S * 2.0**doublings, MAX_DELAY_S)
            self._history.outbox.mark_failed(message.id, str(cause), delay)
        else:
            self._history.outbox.mark_sent(message.id)
