"""Messages of the history's outbox, sent at least once and tried again until a channel takes them."""

import logging
import threading
from collections.abc import Callable

from swashtwin.foundation import SwashTwinError
from swashtwin.monitoring.alarms import AlarmMessage, send
from swashtwin.monitoring.config import WatchConfig
from swashtwin.monitoring.history import History, HistoryError, Message

_PAUSE = 0.5
"""Seconds between two looks at the outbox."""
_FIRST_DELAY, _LONGEST_DELAY = 2.0, 600.0
"""Seconds before another attempt at a message; each is twice the one before."""
_log = logging.getLogger("swashtwin.watch")


class Sender:
    """Sends what is in the outbox for the channels of one configuration; others' messages are left to others."""

    def __init__(self, config: WatchConfig, history: History) -> None:
        self._history = history
        self._channels = {channel.name: channel for channel in config.channels}
        self._folder = config.folder
        self.waiting = 0
        """Messages that are not sent yet."""
        self.problem: str | None = None
        """What keeps the messages from being sent, in one line."""

    def run(self, stop: threading.Event, every: Callable[[], None] = lambda: None) -> None:
        """Send messages until `stop` is set; `every` is called at each look."""
        while not stop.wait(_PAUSE):
            self.send_all()
            every()

    def send_all(self) -> None:
        """Send what may be sent now."""
        try:
            while messages := self._history.outbox.claim(tuple(self._channels)):
                for message in messages:
                    self._send(message)
            self.waiting = self._history.outbox.waiting(tuple(self._channels))
            if not self.waiting:
                self.problem = None
        except HistoryError as cause:
            self.problem = str(cause)

    def _send(self, message: Message) -> None:
        try:
            send(AlarmMessage.from_dict(message.body), self._channels[message.channel], folder=self._folder)
        except (SwashTwinError, OSError, ValueError, TypeError, KeyError) as cause:
            self.problem = str(cause)
            _log.warning("%s", self.problem)
            delay = min(_FIRST_DELAY * 2.0 ** min(message.attempts, 20), _LONGEST_DELAY)
            self._history.outbox.failed(message.id, str(cause), delay)
        else:
            self._history.outbox.sent(message.id)
