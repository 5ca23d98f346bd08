"""Measures the severity of each alarm's suspect, apart from the judgment of recordings."""

import threading
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from swashtwin.monitoring.alarms.suspect_severity import SeverityRequest, measure_severity
from swashtwin.monitoring.config.settings import Machine, WatchConfig
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.schema import Alarm, Judgment
from swashtwin.monitoring.service.alarm_messages import AlarmPoster

N_NEWEST_ALARMS = 200
"""Newest alarms whose severity is measured; older ones that are open wait for a person anyway."""
N_HEALTHY_RECORDINGS = 8
"""Healthy recordings that a severity is measured against; each takes as long as the worn one."""


class SeverityMeasurer:
    """Measures severities, which takes minutes each.

    It runs in another thread than the judgment, so that no alarm waits for it. What a kill or a
    stop interrupts is measured after the next start.
    """

    def __init__(self, config: WatchConfig, history: History) -> None:
        self._config = config
        self._history = history
        self._poster = AlarmPoster(config)
        self._tried_alarms: set[int] = set()
        """Alarms whose severity this process tried to measure; a failure is tried again only after
        a restart, since it would most likely fail again.
        """

    def measure_all(self, stop: threading.Event) -> None:
        """Measure the severity of each open alarm's suspect that has none yet.

        An unsure suspect is measured once, a sure one once for each class.

        Raises
        ------
        HistoryError
            The database cannot be reached.
        """
        for alarm in self._history.reader.alarms(limit=N_NEWEST_ALARMS):
            machine = self._config.machine(alarm.machine)
            if machine is None or machine.calibration is None or not self._needs_severity(alarm):
                continue

            suspect = alarm.evidence["suspect"]
            judgment = self._history.reader.recording(suspect["recording"])
            assert judgment is not None
            severity = measure_severity(self._request(machine, suspect["label"], judgment))

            # The stop may have ended the measuring process too, and an error is no severity.
            if stop.is_set():
                return
            severity["certainty"] = suspect["certainty"]
            severity["recording"] = judgment.id
            self._record(alarm, judgment, severity)

    def _needs_severity(self, alarm: Alarm) -> bool:
        suspect = alarm.evidence.get("suspect")
        if alarm.closed is not None or suspect is None:
            return False

        certainty = suspect["certainty"]
        if certainty not in ("sure", "unsure"):
            return False

        severity = alarm.evidence.get("severity", {})
        was_tried = "verdict" in severity or alarm.id in self._tried_alarms
        was_sure_of_this_class = (
            severity.get("certainty") != "unsure" and severity.get("label") == suspect["label"]
        )
        is_new_sure_suspect = certainty == "sure" and not was_sure_of_this_class
        return is_new_sure_suspect or not was_tried

    def _request(self, machine: Machine, label: str, judgment: Judgment) -> SeverityRequest:
        folder = self._history.waveforms.folder
        recording = None
        if judgment.waveform:
            recording = folder / judgment.waveform
        healthy_files = self._history.reader.healthy_files(judgment, N_HEALTHY_RECORDINGS)
        return SeverityRequest(
            machine,
            label,
            recording=recording,
            healthy=tuple(folder / name for name in healthy_files.values()),
        )

    def _record(self, alarm: Alarm, judgment: Judgment, severity: Mapping[str, Any]) -> None:
        with self._history.machine(alarm.machine) as transaction:
            stored = transaction.record_severity(alarm.id, severity)
            self._tried_alarms.add(alarm.id)
            if stored is None or stored.closed is not None:
                return

            # The first message about an alarm reports the severity too, if it is known by then.
            was_reported = stored not in transaction.unreported_alarms()
            if was_reported and not transaction.silenced(datetime.now(UTC)):
                notes = stored.evidence["severity"]["notes"]
                self._poster.post(transaction, "measured", stored, judgment, notes)
