"""Measures the severity of each alarm's suspect, apart from the judgment of recordings."""

import logging
import threading
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

from swashtwin.foundation import ChildProcess
from swashtwin.monitoring.alarms.suspect_severity import SeverityRequest, measure_severity
from swashtwin.monitoring.config.settings import Machine, WatchConfig
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.schema import Alarm, Judgment
from swashtwin.monitoring.service.alarm_messages import AlarmPoster, Occasion

N_NEWEST_ALARMS = 200
"""Newest alarms whose severity is measured; older ones that are open wait for a person anyway."""
N_HEALTHY_RECORDINGS = 8
"""Healthy recordings that a severity is measured against; each takes as long as the worn one."""
MEASURE_INTERVAL = timedelta(days=1)
"""Age of a severity after which a newer deviating recording is measured: wear grows in days, and a
measurement takes minutes.
"""
SCORE_GROWTH = 1.5
"""Growth of the score of a recording from which it is measured sooner: the fault grows quickly."""
_log = logging.getLogger("swashtwin.watch")


class SeverityMeasurer:
    """Measures severities, which takes minutes each.

    It runs in another thread than the judgment, so that no alarm waits for it. What a kill or a
    stop interrupts is measured after the next start.
    """

    def __init__(self, config: WatchConfig, history: History) -> None:
        self._config = config
        self._history = history
        self._poster = AlarmPoster(config)
        self._child = ChildProcess()
        self._tried_recordings: dict[int, int] = {}
        """Recording that this process tried to measure last, by alarm. A failure is not tried again
        on the same recording before a restart, since it would most likely fail again.
        """

    def measure_all(self, stop: threading.Event) -> None:
        """Measure the severity of each open alarm's suspect, if it has none or an outdated one.

        It is measured when a suspect is named, when it becomes sure of a class, and again as the
        fault grows: once a day, or when a recording deviates much more than the measured one.

        Raises
        ------
        HistoryError
            The database cannot be reached.
        """
        try:
            self._measure_alarms(stop)
        finally:
            # A measurement leaves hundreds of megabytes in its process.
            self._child.stop()

    def end(self) -> None:
        """End a measurement that is running; `stop` of `measure_all` must be set before."""
        self._child.stop()

    def _measure_alarms(self, stop: threading.Event) -> None:
        for alarm in self._history.reader.alarms(limit=N_NEWEST_ALARMS):
            machine = self._config.machine(alarm.machine)
            if machine is None or machine.calibration is None or not self._needs_severity(alarm):
                continue

            suspect = alarm.evidence["suspect"]
            judgment = self._history.reader.recording(suspect["recording"])
            assert judgment is not None
            request = self._request(machine, alarm, judgment)
            severity = measure_severity(request, self._child, stop)

            # The stop ended the measuring process, and an error is no severity.
            if stop.is_set():
                return
            severity["certainty"] = suspect["certainty"]
            severity["recording"] = judgment.id
            severity["time"] = judgment.time.isoformat()
            self._record(alarm, judgment, severity)

    def _needs_severity(self, alarm: Alarm) -> bool:
        suspect = alarm.evidence.get("suspect")
        if alarm.closed is not None or suspect is None:
            return False

        certainty = suspect["certainty"]
        if certainty not in ("sure", "unsure"):
            return False

        severity = alarm.evidence.get("severity", {})
        tried_recording = self._tried_recordings.get(alarm.id)
        if "verdict" not in severity and tried_recording is None:
            return True

        was_sure_of_this_class = (
            severity.get("certainty") != "unsure" and severity.get("label") == suspect["label"]
        )
        if certainty == "sure" and not was_sure_of_this_class:
            return True
        return self._has_grown(tried_recording or severity["recording"], suspect["recording"])

    def _has_grown(self, measured: int, newest: int) -> bool:
        """Return whether a recording is much newer than the measured one, or deviates more."""
        if newest == measured:
            return False

        reader = self._history.reader
        measured_judgment = reader.recording(measured)
        newest_judgment = reader.recording(newest)
        assert measured_judgment is not None
        assert newest_judgment is not None
        if newest_judgment.time - measured_judgment.time >= MEASURE_INTERVAL:
            return True

        measured_score = measured_judgment.reasons["score"]
        newest_score = newest_judgment.reasons["score"]
        return bool(newest_score >= SCORE_GROWTH * measured_score)

    def _request(self, machine: Machine, alarm: Alarm, judgment: Judgment) -> SeverityRequest:
        folder = self._history.waveforms.folder
        recording = None
        if judgment.waveform:
            recording = folder / judgment.waveform
        healthy_files = self._history.reader.healthy_files(judgment, N_HEALTHY_RECORDINGS)
        return SeverityRequest(
            machine,
            alarm.evidence["suspect"]["label"],
            recording=recording,
            time=judgment.time,
            healthy=tuple(folder / name for name in healthy_files.values()),
            course=tuple(alarm.evidence.get("severity", {}).get("course", ())),
        )

    def _record(self, alarm: Alarm, judgment: Judgment, severity: Mapping[str, Any]) -> None:
        previous = alarm.evidence.get("severity", {})
        with self._history.machine(alarm.machine) as transaction:
            stored = transaction.record_severity(alarm.id, severity)
            self._tried_recordings[alarm.id] = judgment.id
            if stored is None or stored.closed is not None:
                return
            if _is_confirmed(previous, severity):
                return

            # The first message about an alarm reports the severity too, if it is known by then.
            was_reported = stored not in transaction.unreported_alarms()
            if was_reported and not transaction.silenced(datetime.now(UTC)):
                notes = stored.evidence["severity"]["notes"]
                occasion = Occasion(judgment.time, judgment.received, judgment.content)
                self._poster.post(transaction, "measured", stored, occasion, notes)


def _life_state(severity: Mapping[str, Any]) -> str:
    """Return what is known of the remaining time."""
    life = severity.get("remaining_life")
    if life is None or life["days"] is None:
        return "unknown"
    return "reached" if life["days"] == 0 else "known"


def _is_confirmed(previous: Mapping[str, Any], severity: Mapping[str, Any]) -> bool:
    """Return whether a severity only confirms the previous one, so that no message is due."""
    names = ("label", "certainty", "verdict")
    if any(previous.get(name) != severity.get(name) for name in names):
        return False
    if _life_state(previous) != _life_state(severity):
        return False
    if "interval" not in previous:
        return False
    low, high = previous["interval"]
    return bool(low <= severity["value"] <= high)
