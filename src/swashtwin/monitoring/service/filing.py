"""Files a recording in the history: judgment, alarms and messages in one transaction."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
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
from swashtwin.monitoring.service.alarm_messages import AlarmPoster, Occasion
from swashtwin.monitoring.service.deliveries import (
    DeliveryFinding,
    DeliveryMonitor,
    DeliveryState,
    place,
)
from swashtwin.monitoring.sources.contents import Contents
from swashtwin.monitoring.sources.delivery import Delivery, RejectionError

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
    wrong_date: datetime | None = None
    """Specified time if it counts by its arrival since its clock was set back."""


class WrongClockError(DataError):
    """A recording has to be filed at its time of arrival, at which other tags may hold."""

    def __init__(self, detail: str, date: datetime) -> None:
        super().__init__(detail)
        self.date = date


@dataclass(frozen=True)
class FiledRecording:
    """What the history now has of a recording."""

    state: str
    """State of the recording, as in `Judgment`."""
    sentence: str
    """The outcome for a person, in one line."""
    delivery_problem: str | None = None
    """What is wrong with the deliveries of the machine."""


class RecordingFiler:
    """Files recordings, one by one, in the order of their arrival."""

    def __init__(self, config: WatchConfig, history: History, suspects: Suspects) -> None:
        self._settings = config.alarms
        self._poster = AlarmPoster(config)
        self._deliveries = DeliveryMonitor(config)
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
        WrongClockError
            The recording has to be filed at its time of arrival.
        PriorNotAdaptedError
            A prior has to be adapted first, outside of the transaction.
        OSError
            The disk is full.
        """
        contents = arrival.contents

        deliveries = _place(self._deliveries.load(transaction), arrival)
        point = _find_operating_point(transaction, arrival)
        previous_state = _load_state(transaction, point)
        result = self._monitor(arrival, point, previous_state)
        suspect = self._name_suspect(arrival, point, result)
        findings = _delivery_findings(contents)
        judgment = self._build_judgment(arrival, point, result, suspect, findings)

        waveform = self._waveforms.write(
            transaction.name, contents.time, contents.digest, contents.recording
        )
        # A wrong date in an archive must not stay the newest one for years.
        is_newest = contents.clock_problem is not None or deliveries.newest == contents.time
        transaction.add_recording(judgment, result.band_powers, waveform, is_newest=is_newest)
        _save_state(transaction, point, previous_state, result)
        self._update_alarms(transaction, judgment, result)
        self._poster.post_unreported(transaction, _occasion(judgment))
        problem = self._deliveries.count(transaction, deliveries, arrival.delivery, findings)

        sentence = self._describe(judgment, result)
        for finding in findings:
            sentence += f"; {finding.kind}: {finding.sentence}"
        return FiledRecording(judgment.state, sentence, problem)

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
        findings: Sequence[DeliveryFinding],
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
                "delivery": to_table(findings),
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
            self._poster.post(transaction, event, alarm, _occasion(judgment), result.reasons)

    def _describe(self, judgment: Judgment, result: OperatingPointJudgment) -> str:
        """Return the outcome of a recording in one line."""
        parts = [judgment.state]
        if judgment.state == "learning":
            parts = [f"learning {result.learned}/{self._settings.baseline_recordings}"]
            # Why the count does not rise.
            parts += [note.rstrip(".") for note in result.notes]
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


def _place(state: DeliveryState, arrival: Arrival) -> DeliveryState:
    """Return the state with the time of a recording, or refuse the time."""
    contents = arrival.contents
    received = arrival.delivery.received
    if arrival.wrong_date is not None:
        return replace(state, n_late=0, wrong_date=arrival.wrong_date, wrong_received=received)
    if contents.clock_problem is not None:
        return replace(state, n_late=0)

    placement = place(state, contents.time, received)
    if placement == "date":
        newest = contents.time
        # One from the future was stored before this computer's clock was set back.
        if state.newest is not None and state.newest <= received:
            newest = max(newest, state.newest)
        return replace(state, newest=newest, n_late=0, wrong_date=None, wrong_received=None)

    assert state.newest is not None
    order = (
        f"measured at {contents.time:%Y-%m-%d %H:%M:%S}, but a recording of "
        f"{state.newest:%Y-%m-%d %H:%M:%S} was already judged"
    )
    if placement == "clock":
        raise WrongClockError(
            f"{order}; its time of arrival is used. Check the clock of the logger.",
            contents.time,
        )
    raise RejectionError("late", f"{order}.")


def _delivery_findings(contents: Contents) -> tuple[DeliveryFinding, ...]:
    """Return what is wrong with a delivery that is judged nevertheless."""
    findings = []
    if contents.clock_problem is not None:
        findings.append(DeliveryFinding("clock", contents.clock_problem))
    if contents.tags_problem is not None:
        findings.append(DeliveryFinding("tags", contents.tags_problem))
    return tuple(findings)


def _occasion(judgment: Judgment) -> Occasion:
    return Occasion(judgment.time, judgment.received, judgment.content)


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
