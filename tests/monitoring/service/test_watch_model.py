"""A model of the watch: deliveries, acknowledgments, silences, maintenance, restarts in any order.

The model knows what must hold of alarms and messages. The rule of alarms itself is replaced by one
that obeys the first sample of a recording, so that an alarm does not take forty recordings.
"""

import shutil
import tempfile
from datetime import UTC, datetime, timedelta
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import HealthCheck, settings, strategies
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from watched_pumps import watch_config

from swashtwin.foundation import InputError
from swashtwin.learning import BandPowerLayout
from swashtwin.monitoring import History, record_event
from swashtwin.monitoring.alarms.baseline import OperatingPointBaseline
from swashtwin.monitoring.alarms.monitor import (
    AlarmState,
    ConformalTest,
    OperatingPointJudgment,
    OperatingPointMonitor,
    OperatingPointState,
)
from swashtwin.monitoring.service import judging
from swashtwin.monitoring.service.deliveries import N_IN_A_ROW
from swashtwin.monitoring.sources.contents import Contents
from swashtwin.monitoring.sources.delivery import Delivery
from swashtwin.monitoring.sources.spool import Spool
from swashtwin.recordings import Recording

START = datetime.now(UTC) - timedelta(days=30)


def judge(
    monitor: OperatingPointMonitor,
    recording: Recording,
    state: OperatingPointState | None,
    *,
    point: str,
) -> OperatingPointJudgment:
    """Judge a recording by its first sample only: large or not."""
    condition = state.pump if state is not None else AlarmState()
    is_large = bool(recording.signal[0, 0] > 0)
    next_state, change = condition.update(is_large)
    baseline = OperatingPointBaseline.empty(BandPowerLayout(1.0, ("x",), "", 2, 0))

    state = OperatingPointState(baseline, ConformalTest({}), next_state, AlarmState())
    return OperatingPointJudgment(
        "watching",
        1,
        state,
        is_large=is_large,
        is_alarm=next_state.is_active,
        pump=change,
        capital=1.0,
    )


class WatchModel(RuleBasedStateMachine):
    """The watch of one machine, and the state that it must have reached."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        self.config = watch_config(self.folder, '[[channel]]\nkind = "log"')
        self.patches = [
            patch.object(OperatingPointMonitor, "judge", judge),
            patch.object(judging, "read_contents", self._read),
        ]
        for active_patch in self.patches:
            active_patch.start()

        self.count = 0
        self.filed: list[str] = []
        self.rejected: set[str] = set()
        self.alarm_state = AlarmState()
        self.alarm: str | None = None  # open, acknowledged, or None
        self.is_cleared = False
        self.opened = 0
        self.is_silenced = False
        self.repeats = 0
        self.delivery_alarm: str | None = None
        self.is_delivery_cleared = False
        self.delivery_opened = 0

    @initialize()
    def start(self) -> None:
        """Start the watch."""
        self.history = History.open("", self.config.folder, self.config.retention)
        self.spool = Spool(self.config.folder / "spool")
        self.pipeline = judging.Pipeline(self.config, self.history)

    def _read(self, file: object, machine: object, tags: object) -> Contents:
        number, value = file.path.read_text().split()
        recording = Recording(np.full((1, 8), float(value)), 100.0, number, channels=("x",))
        return Contents(recording, START + timedelta(hours=int(number)), number, ())

    def _deliver(self, text: str) -> None:
        self.spool.add(Delivery("inbox", "a.wav", datetime.now(UTC), "pump-1"), text.encode())

    @rule(is_large=strategies.booleans(), is_killed=strategies.booleans())
    def judge_next(self, is_large: bool, is_killed: bool) -> None:
        """Judge a new recording; a kill may come before it leaves the spool."""
        self.count += 1
        self._deliver(f"{self.count} {int(is_large)}")
        file = self.spool.next(0)
        self.pipeline.judge(file)
        self.filed.append(str(self.count))

        self.alarm_state, change = self.alarm_state.update(is_large)
        if change == "raised":
            self.opened += self.alarm is None
            self.alarm = self.alarm or "open"
            self.is_cleared = False
        elif change == "cleared":
            self.is_cleared = self.alarm == "open"
            self.alarm = "open" if self.is_cleared else None

        self.repeats = 0
        if self.delivery_alarm == "acknowledged":
            self.delivery_alarm = None
        self.is_delivery_cleared = self.delivery_alarm is not None

        if is_killed:
            self.restart()
            repeated = self.pipeline.judge(self.spool.next(0))
            assert repeated.sentence == "was judged before the restart"

        self.spool.remove(file)

    @precondition(lambda self: self.count)
    @rule()
    def deliver_again(self) -> None:
        """Deliver the newest recording a second time."""
        self._deliver(f"{self.count} 1")

        file = self.spool.next(0)
        assert self.pipeline.judge(file).state == "rejected"
        self.spool.remove(file)

        self.rejected.add("double")

        # The newest recording again and again is that of a logger that hangs.
        self.repeats += 1
        if self.repeats >= N_IN_A_ROW:
            self.delivery_opened += self.delivery_alarm is None
            self.delivery_alarm = self.delivery_alarm or "open"
            self.is_delivery_cleared = False

    @rule()
    def restart(self) -> None:
        """End the watch and start it again."""
        self.history.close()
        self.start()

    @rule()
    def acknowledge(self) -> None:
        """Acknowledge the alarm, if there is an open one, and try it again."""
        alarms = self.history.reader.alarms(state="open")
        assert len(alarms) == (self.alarm == "open") + (self.delivery_alarm == "open")

        for alarm in alarms:
            with self.history.machine("pump-1") as machine:
                machine.acknowledge(alarm.id, "Ada", "seen")
            if alarm.kind == "delivery":
                self.delivery_alarm = None if self.is_delivery_cleared else "acknowledged"
                self.is_delivery_cleared = False
            else:
                self.alarm = None if self.is_cleared else "acknowledged"
                self.is_cleared = False

            try:
                with self.history.machine("pump-1") as machine:
                    machine.acknowledge(alarm.id, "Bob")
            except InputError:
                continue
            raise AssertionError("an alarm was acknowledged twice")

    @rule(is_on=strategies.booleans())
    def silence(self, is_on: bool) -> None:
        """Begin or end a silence."""
        with self.history.machine("pump-1") as machine:
            machine.end_silence()
            if is_on:
                machine.silence(datetime.now(UTC) + timedelta(hours=1), "Ada")
        self.is_silenced = is_on

    @rule()
    def maintain(self) -> None:
        """Record maintenance, after which learning and alarms start anew."""
        record_event(self.config, self.history, "pump-1", who="Ada", note="", maintenance=True)
        self.alarm_state = AlarmState()
        self.alarm = None
        self.is_cleared = False
        self.delivery_alarm = None
        self.is_delivery_cleared = False

    @invariant()
    def holds(self) -> None:
        """Check that nothing is lost or filed twice, and alarms and messages match the model."""
        if not hasattr(self, "history"):
            return

        reader = self.history.reader
        assert sorted(row.content for row in reader.recordings(limit=1000)) == sorted(self.filed)
        assert {row.reason for row in reader.rejections()} == self.rejected

        alarms = reader.alarms(limit=1000)
        assert len(alarms) == self.opened + self.delivery_opened
        expected_states = {"pump": self.alarm, "delivery": self.delivery_alarm}
        for kind, state in expected_states.items():
            rows = [row for row in alarms if row.kind == kind]
            expected = [state] if state else []
            assert [row.state for row in rows if row.state != "closed"] == expected
        assert all(row.who == "Ada" for row in alarms if row.state != "open")

        with self.history.machine("pump-1") as machine:
            unreported = [
                row
                for row in machine.unreported_alarms()
                if row.cleared is None and row.kind == "pump"
            ]
        assert (
            not unreported
            or self.is_silenced
            or self.count == 0
            or not self.was_reported_since_silence()
        )

        assert len(self.spool) == 0

    def was_reported_since_silence(self) -> bool:
        """Return whether a recording was judged after the last silence.

        Its judgment posts the alarms that were raised during the silence.
        """
        newest = self.history.reader.recordings(limit=1)
        with self.history.machine("pump-1") as machine:
            return not newest or not machine.silenced(newest[0].received)

    def teardown(self) -> None:
        """Remove the folder."""
        for active_patch in self.patches:
            active_patch.stop()
        if hasattr(self, "history"):
            self.history.close()
        shutil.rmtree(self.folder, ignore_errors=True)


_CHECKS = list(HealthCheck)
WatchModel.TestCase.settings = settings(
    max_examples=3, stateful_step_count=12, deadline=None, suppress_health_check=_CHECKS
)
TestWatch = WatchModel.TestCase


@pytest.mark.nightly
def test_long_sequences_of_events_match_the_model() -> None:
    long_run = settings(
        max_examples=30, stateful_step_count=40, deadline=None, suppress_health_check=_CHECKS
    )
    run_state_machine_as_test(WatchModel, settings=long_run)
