"""Files a recording in the history: judgment, alarms and messages in one transaction."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import timedelta
from typing import Any

from swashtwin.foundation import DataError, InputError, to_table
from swashtwin.monitoring.alarms.monitor import (
    AlarmChange,
    OperatingPointJudgment,
    OperatingPointMonitor,
    OperatingPointState,
)
from swashtwin.monitoring.alarms.operating_point import OperatingPoint, match_operating_point
from swashtwin.monitoring.alarms.suspect import Suspects
from swashtwin.monitoring.config.settings import Machine, WatchConfig
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.schema import Judgment
from swashtwin.monitoring.history.transaction import MachineTransaction
from swashtwin.monitoring.service.alarm_messages import AlarmPoster
from swashtwin.monitoring.sources.contents import Contents
from swashtwin.monitoring.sources.delivery import Delivery, RejectionError

MAX_DELAY = timedelta(minutes=5)
"""How much older than the machine's newest recording one may be: sources deliver in parallel, so
recordings of one machine may arrive in another order than they were measured.
"""
MAX_OPERATING_POINTS = 200
"""Operating points of a machine; more result from a speed or a pressure that never settles, and
none of them would get enough recordings for a baseline.
"""
N_SENTENCE_REASONS = 2
"""Reasons in the one-line outcome of a recording."""


@dataclass(frozen=True)
class ModelVerdict:
    """What the model of a machine concluded from a recording."""

    model: str | None = None
    """Fingerprint of the model."""
    answer: Mapping[str, Any] = field(default_factory=dict)
    """The whole diagnosis, as JSON can hold it."""
    no_verdict: str | None = None
    """Why there is no verdict."""
    label: str | None = None
    """Class of the verdict."""
    probability: float | None = None
    """Probability of the class."""
    confidence: float | None = None
    """Share of the windows with the same verdict."""
    ood_p: float | None = None
    """p-value of the recording among those of the training."""


@dataclass(frozen=True, eq=False)
class Arrival:
    """A recording that is ready to be filed: all that is known of it without the history."""

    machine: Machine
    delivery: Delivery
    contents: Contents
    verdict: ModelVerdict


@dataclass(frozen=True)
class FiledRecording:
    """What the history now has of a recording."""

    state: str
    """State of the recording, as in `Judgment`."""
    sentence: str
    """The outcome for a person, in one line."""


class RecordingFiler:
    """Files recordings, one by one, in the order of their arrival."""

    def __init__(self, config: WatchConfig, history: History, suspects: Suspects) -> None:
        self._settings = config.alarms
        self._poster = AlarmPoster(config)
        self._waveforms = history.waveforms
        self._suspects = suspects
        # The count may come from a pump file, which is read once and not for each recording.
        self._piston_counts = {machine.name: machine.piston_count for machine in config.machines}

    def file(self, transaction: MachineTransaction, arrival: Arrival) -> FiledRecording:
        """Judge a recording, and write all that follows from it in the transaction.

        The order matters: what may fail comes first, then the samples on the disk, then the rows
        that refer to them. If the transaction is undone, samples without a row remain, which
        `Waveforms.sweep` removes.

        Raises
        ------
        RejectionError
            The recording cannot be judged.
        PriorNotAdaptedError
            A prior has to be adapted first, outside of the transaction.
        OSError
            The disk is full.
        """
        contents = arrival.contents

        _require_order(transaction, arrival)
        point = _find_operating_point(transaction, arrival)
        previous_state = _load_state(transaction, point)
        result = self._monitor(arrival, point, previous_state)
        suspect = self._name_suspect(arrival, point, result)
        judgment = self._build_judgment(arrival, point, result, suspect)

        waveform = self._waveforms.write(
            transaction.name, contents.time, contents.digest, contents.recording
        )
        transaction.add_recording(judgment, result.band_powers, waveform)
        _save_state(transaction, point, previous_state, result)
        self._update_alarms(transaction, judgment, result)
        self._post_unreported_alarms(transaction, judgment)

        return FiledRecording(judgment.state, self._describe(judgment, result))

    def _monitor(
        self, arrival: Arrival, point: OperatingPoint, state: OperatingPointState | None
    ) -> OperatingPointJudgment:
        machine = arrival.machine.name
        monitor = OperatingPointMonitor(
            machine,
            self._settings.false_alarm_rate,
            self._settings.baseline_recordings,
            self._piston_counts[machine],
        )
        try:
            return monitor.judge(arrival.contents.recording, state, point=point.name)
        except DataError as cause:
            raise RejectionError("unfit", str(cause)) from cause

    def _name_suspect(
        self, arrival: Arrival, point: OperatingPoint, result: OperatingPointJudgment
    ) -> dict[str, Any] | None:
        if not result.is_large and result.pump != "raised":
            return None
        suspect = self._suspects.name(
            arrival.machine, point, result.state.baseline, arrival.contents.recording
        )
        table: dict[str, Any] = to_table(suspect)
        return table

    def _build_judgment(
        self,
        arrival: Arrival,
        point: OperatingPoint,
        result: OperatingPointJudgment,
        suspect: dict[str, Any] | None,
    ) -> Judgment:
        contents = arrival.contents
        delivery = arrival.delivery
        recording = contents.recording
        specified_point = OperatingPoint.of(recording)

        verdict = arrival.verdict
        if result.stage == "sensor":
            # Whatever the model concludes from a faulty sensor is no statement about the pump.
            verdict = ModelVerdict(
                no_verdict="No verdict on the pump: a sensor is faulty, or the pump does not run."
            )

        return Judgment(
            content=contents.digest,
            time=contents.time,
            received=delivery.received,
            source=delivery.source,
            file=delivery.file,
            channels=list(recording.channels),
            unit=recording.unit,
            sample_rate=recording.sample_rate,
            duration=recording.duration,
            point=point.name,
            speed=specified_point.speed,
            pressure=specified_point.pressure,
            state=_recording_state(result),
            label=verdict.label,
            probability=verdict.probability,
            confidence=verdict.confidence,
            ood_p=verdict.ood_p,
            model=verdict.model,
            alarm_p=result.p_value,
            capital=result.capital,
            reasons={
                "sentences": list(result.reasons),
                "notes": [*contents.notes, *result.notes],
                "findings": to_table(result.findings),
                "moved": to_table(result.moved),
                "score": result.score,
                "learned": result.learned,
                "learning": self._settings.baseline_recordings,
                "verdict": dict(verdict.answer),
                "no_verdict": verdict.no_verdict,
                "suspect": suspect,
            },
        )

    def _update_alarms(
        self, transaction: MachineTransaction, judgment: Judgment, result: OperatingPointJudgment
    ) -> None:
        """Raise and clear alarms, and let an open alarm of the pump follow the newest recording."""
        if result.pump is not None:
            self._change_alarm(transaction, "pump", result.pump, judgment, result)
        if result.sensor is not None:
            self._change_alarm(transaction, "sensor", result.sensor, judgment, result)
        _update_evidence(transaction, judgment)

    def _change_alarm(
        self,
        transaction: MachineTransaction,
        kind: str,
        change: AlarmChange,
        judgment: Judgment,
        result: OperatingPointJudgment,
    ) -> None:
        alarms = [
            alarm
            for alarm in transaction.alarms()
            if alarm.kind == kind and alarm.point == judgment.point
        ]
        alarm = next(reversed(alarms), None)

        if change == "raised":
            event = "opened"
            if alarm is None:
                alarm = transaction.open_alarm(
                    kind, judgment.point, judgment.time, result.to_dict(), judgment.id
                )
                # The message below names the suspect, so the alarm needs it now.
                _update_evidence(transaction, judgment)
            else:
                # The cause is back before a person acknowledged the alarm.
                alarm.cleared = None
        elif alarm is None:
            return
        else:
            event = "cleared"
            if alarm.state == "acknowledged":
                event = "closed"
            transaction.clear_alarm(alarm.id, judgment.time)

        if not transaction.silenced(judgment.received):
            self._poster.post(transaction, event, alarm, judgment, result.reasons)

    def _post_unreported_alarms(self, transaction: MachineTransaction, judgment: Judgment) -> None:
        """Post the alarms that were raised during a silence, now that it has ended."""
        alarms = [alarm for alarm in transaction.unreported_alarms() if alarm.cleared is None]
        if not alarms or transaction.silenced(judgment.received):
            return
        for alarm in alarms:
            reasons = alarm.evidence.get("reasons", ())
            self._poster.post(transaction, "opened", alarm, judgment, reasons, time=alarm.opened)

    def _describe(self, judgment: Judgment, result: OperatingPointJudgment) -> str:
        """Return the outcome of a recording in one line."""
        parts = [judgment.state]
        if judgment.state == "learning":
            parts = [f"learning {result.learned}/{self._settings.baseline_recordings}"]
        elif result.capital is not None:
            threshold = 1 / self._settings.false_alarm_rate
            parts.append(f"evidence {result.capital:.3g} of {threshold:.3g}")

        if judgment.label is not None:
            parts.append(f"{judgment.label} {judgment.probability:.2f}")
        suspect = judgment.reasons["suspect"]
        if suspect:
            parts.append(suspect["sentence"].rstrip("."))

        if result.pump is not None:
            parts.append(f"pump alarm {result.pump}")
        if result.sensor is not None:
            parts.append(f"sensor alarm {result.sensor}")
        if judgment.state in ("alarm", "unusual", "sensor"):
            parts += result.reasons[:N_SENTENCE_REASONS]

        return "; ".join(parts)


def _require_order(transaction: MachineTransaction, arrival: Arrival) -> None:
    """Reject a recording that is older than one that was judged: the test needs their order."""
    newest = transaction.newest()
    time = arrival.contents.time

    # A newest recording from the future was stored before the clock was set back, and rejects none.
    if newest is None or newest > arrival.delivery.received:
        return
    if time < newest - MAX_DELAY:
        raise RejectionError(
            "late",
            f"measured at {time:%Y-%m-%d %H:%M:%S}, but a recording of "
            f"{newest:%Y-%m-%d %H:%M:%S} was already judged.",
        )


def _find_operating_point(transaction: MachineTransaction, arrival: Arrival) -> OperatingPoint:
    points = transaction.operating_points()
    point = match_operating_point(arrival.contents.recording, points)

    is_new = all(stored.name != point.name for stored in points)
    if is_new and len(points) >= MAX_OPERATING_POINTS:
        raise RejectionError(
            "points",
            f"{point.name} would be a new operating point, but {transaction.name} already has the "
            f"maximum of {len(points)}. Record at fewer speeds and pressures, then record a "
            "maintenance, which removes all operating points.",
        )
    return point


def _load_state(
    transaction: MachineTransaction, point: OperatingPoint
) -> OperatingPointState | None:
    stored = transaction.operating_point(point.name)
    baseline = transaction.baseline(point.name)
    if stored is None or not stored.test or baseline is None:
        return None
    try:
        return OperatingPointState.from_tables(baseline, stored.test)
    except InputError as cause:
        raise RejectionError(
            "points",
            f"the history's state of {point.name} does not fit this swashtwin "
            f"({str(cause).rstrip('.')}); another version wrote it. Use the swashtwin that wrote "
            "it, or record a maintenance, which removes all operating points.",
        ) from cause


def _save_state(
    transaction: MachineTransaction,
    point: OperatingPoint,
    previous_state: OperatingPointState | None,
    result: OperatingPointJudgment,
) -> None:
    # A baseline is large: it is written only when it has learned something.
    baseline = result.state.baseline
    changed_baseline = None
    if previous_state is None or baseline is not previous_state.baseline:
        changed_baseline = to_table(baseline)

    transaction.save_operating_point(
        point.name,
        speed=point.speed,
        pressure=point.pressure,
        baseline=changed_baseline,
        test=result.state.test_table(),
    )


def _update_evidence(transaction: MachineTransaction, judgment: Judgment) -> None:
    """Give suspect and reasons of a recording to the pump's open alarm at its operating point.

    The newest recording with a large change decides: the fault has grown since the alarm.
    """
    suspect = judgment.reasons["suspect"]
    if not suspect:
        return

    source = {"recording": judgment.id, "time": judgment.time.isoformat()}
    newest = {"reasons": judgment.reasons["sentences"], **source}
    for alarm in transaction.alarms():
        if alarm.kind == "pump" and alarm.point == judgment.point:
            # A new dictionary: SQLAlchemy does not see a change inside of the old one.
            alarm.evidence = {
                **alarm.evidence,
                "newest": newest,
                "suspect": {**suspect, **source},
            }


def _recording_state(result: OperatingPointJudgment) -> str:
    if result.stage == "sensor":
        return "sensor"
    if result.is_alarm:
        return "alarm"
    if result.stage == "learning":
        return "learning"
    if result.is_large:
        return "unusual"
    return "normal"
