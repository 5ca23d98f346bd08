"""From a file in the spool to its verdict in the history, in one transaction."""

import logging
from dataclasses import dataclass
from datetime import timedelta

from swashtwin.foundation import DataError, sha256_of
from swashtwin.monitoring.alarms import (
    AlarmMessage,
    Change,
    OperatingPoint,
    PointJudgment,
    PointMonitor,
    PointState,
)
from swashtwin.monitoring.alarms.messages import Event, Kind
from swashtwin.monitoring.config import Machine, WatchConfig
from swashtwin.monitoring.history import History, HistoryError, Judgment, MachineTransaction, Rejection
from swashtwin.monitoring.service.addresses import page_address
from swashtwin.monitoring.service.models import Models, Verdict
from swashtwin.monitoring.service.points import bounded_point
from swashtwin.monitoring.service.rejected import RejectedFiles
from swashtwin.monitoring.sources import Contents, SpoolFile, Tags, UnfitError, read_contents

_LATE = timedelta(minutes=5)
"""How much older than the machine's newest recording one may be: sources deliver side by side."""
_log = logging.getLogger("swashtwin.watch")


@dataclass(frozen=True)
class Outcome:
    """What became of a recording."""

    machine: str
    """Machine that it was stated to be of; empty where none was."""
    file: str
    """Name of its file."""
    state: str
    """``learning``, ``normal``, ``unusual``, ``alarm``, ``sensor``, or ``rejected``."""
    sentence: str
    """The same for a person, in one line."""
    has_failed: bool = False
    """Whether an error of ours stopped it."""


class Pipeline:
    """Judges one recording after the other."""

    def __init__(self, config: WatchConfig, history: History) -> None:
        self._config = config
        self._history = history
        self._models = Models()
        self._rejected = RejectedFiles(config.folder / "rejected")
        self._tags = {machine.name: Tags(machine.tags) for machine in config.machines if machine.tags is not None}
        self._monitors = {
            machine.name: PointMonitor(
                machine.name, false_alarm_rate=config.alarms.false_alarm_rate, learning=config.alarms.learning
            )
            for machine in config.machines
        }

    def load_models(self) -> list[str]:
        """Load the models of all machines; what is wrong with them, one line each."""
        return [problem for machine in self._config.machines if (problem := self._models.problem(machine))]

    def judge(self, file: SpoolFile) -> Outcome:
        """What became of a recording, which is now in the history as judged or as rejected.

        Raises
        ------
        HistoryError, OSError
            The database is not reached or the disk is full: to be tried again.
        """
        try:
            machine = self._machine(file)
            contents = read_contents(file, machine, self._tags.get(machine.name))
            verdict = self._models.diagnose(machine, contents.recording)
            return self._file(file, machine, contents, verdict)
        except UnfitError as cause:
            return self._reject(file, cause.reason, str(cause))
        except (HistoryError, OSError):
            raise
        except Exception as cause:  # nothing in a recording may stop the watch
            _log.exception("judging %s of %s failed", file.delivery.file, file.delivery.machine)
            reason = f"an error of swashtwin ({type(cause).__name__}: {cause}); please report it"
            return self._reject(file, "error", reason)

    def _machine(self, file: SpoolFile) -> Machine:
        name = file.delivery.machine
        if name is None and len(self._config.machines) == 1:
            return self._config.machines[0]
        machine = None if name is None else self._config.machine(name)
        if machine is None:
            listed = ", ".join(machine.name for machine in self._config.machines[:20])
            stated = (
                "states no machine" if name is None else f"is of {name!r}, which is no machine of the configuration"
            )
            raise UnfitError("machine", f"it {stated}; there are {listed}.")
        return machine

    def _file(self, file: SpoolFile, machine: Machine, contents: Contents, verdict: Verdict) -> Outcome:
        with self._history.machine(machine.name) as transaction:
            number = transaction.recording_id(contents.digest)
            if number is None:
                return self._judge(transaction, file, machine, contents, verdict)
        stored = self._history.read.recording(number)
        same = stored is not None and (stored.judgment.source, stored.judgment.received) == (
            file.delivery.source,
            file.delivery.received,
        )
        if same and stored is not None:  # a kill came between the verdict and the removal from the spool
            return Outcome(machine.name, file.delivery.file, stored.judgment.state, "was judged before the restart")
        raise UnfitError("double", f"it holds what recording {number} holds.")

    def _judge(
        self, transaction: MachineTransaction, file: SpoolFile, machine: Machine, contents: Contents, verdict: Verdict
    ) -> Outcome:
        recording = contents.recording
        newest = transaction.newest()
        if newest is not None and newest <= file.delivery.received and contents.time < newest - _LATE:
            raise UnfitError(
                "late",
                f"it is of {contents.time:%Y-%m-%d %H:%M:%S}, and {newest:%Y-%m-%d %H:%M:%S} was judged already.",
            )
        point = bounded_point(recording, transaction)
        name = point.name
        stored = transaction.point(name)
        state = None
        if stored is not None and stored.baseline is not None and stored.test is not None:
            state = PointState(stored.baseline, stored.test)
        try:
            point_judgment = self._monitors[machine.name].judge(recording, state, point=name)
        except DataError as cause:
            raise UnfitError("unfit", str(cause)) from cause
        judgment = self._judgment(file, contents, verdict, point_judgment, point)
        path = self._history.waveforms.write(machine.name, contents.time, contents.digest, recording)
        number = transaction.add_recording(judgment, point_judgment.levels, path)
        is_unchanged = state is not None and point_judgment.state.baseline is state.baseline
        transaction.save_point(
            name,
            speed=point.speed,
            pressure=point.pressure,
            baseline=None if is_unchanged else point_judgment.state.baseline,
            test=point_judgment.state.test,
        )
        changes: tuple[tuple[Kind, Change | None], ...] = (
            ("pump", point_judgment.pump),
            ("sensor", point_judgment.sensor),
        )
        for kind, change in changes:
            if change is not None:
                self._change_alarm(transaction, kind, change, judgment, point_judgment, number)
        self._tell_after_silence(transaction, judgment)
        sentence = _sentence(point_judgment, verdict, judgment.state, self._config)
        return Outcome(machine.name, file.delivery.file, judgment.state, sentence)

    def _judgment(
        self,
        file: SpoolFile,
        contents: Contents,
        verdict: Verdict,
        point_judgment: PointJudgment,
        point: OperatingPoint,
    ) -> Judgment:
        recording = contents.recording
        stated = OperatingPoint.of(recording)
        return Judgment(
            content=contents.digest,
            time=contents.time,
            received=file.delivery.received,
            source=file.delivery.source,
            file=file.delivery.file,
            channels=recording.channels,
            unit=recording.unit,
            sample_rate=recording.sample_rate,
            duration=recording.duration,
            point=point.name,
            speed=stated.speed,
            pressure=stated.pressure,
            state=_state(point_judgment),
            label=verdict.label,
            probability=verdict.probability,
            confidence=verdict.confidence,
            ood_p=verdict.ood_p,
            model=verdict.model,
            alarm_p=point_judgment.p_value,
            capital=point_judgment.capital,
            reasons={
                "sentences": list(point_judgment.reasons),
                "notes": [*contents.notes, *point_judgment.notes],
                "findings": [finding.to_dict() for finding in point_judgment.findings],
                "moved": [change.to_dict() for change in point_judgment.moved],
                "score": point_judgment.score,
                "learned": point_judgment.learned,
                "learning": self._config.alarms.learning,
                "verdict": verdict.answer,
                "probabilities": verdict.probabilities,
                "is_unknown": verdict.is_unknown,
                "no_verdict": verdict.note,
            },
        )

    def _change_alarm(
        self,
        transaction: MachineTransaction,
        kind: Kind,
        change: Change,
        judgment: Judgment,
        point_judgment: PointJudgment,
        recording: int,
    ) -> None:
        """Open, raise again or clear an alarm, and post the messages about it."""
        point = judgment.point or "any"
        alarms = [alarm for alarm in transaction.alarms() if (alarm.kind, alarm.point) == (kind, point)]
        number = alarms[-1].id if alarms else None
        if change == "raised":
            event: Event = "opened"
            if number is None:
                number = transaction.open_alarm(kind, point, judgment.time, point_judgment.to_dict(), recording)
            else:
                transaction.raise_alarm(number)
        elif number is None:
            return
        else:
            transaction.clear_alarm(number, judgment.time)
            event = "closed" if alarms[-1].state == "acknowledged" else "cleared"
        if not transaction.silenced(judgment.received):
            self._post(transaction, kind, event, point, number, judgment, point_judgment.reasons)

    def _tell_after_silence(self, transaction: MachineTransaction, judgment: Judgment) -> None:
        """Post the alarms that were raised in a silence and still stand after it."""
        untold = [alarm for alarm in transaction.untold_alarms() if alarm.cleared is None]
        if untold and not transaction.silenced(judgment.received):
            for alarm in untold:
                reasons = tuple(alarm.evidence.get("reasons", ()))
                kind: Kind = "pump" if alarm.kind == "pump" else "sensor"
                self._post(transaction, kind, "opened", alarm.point or "any", alarm.id, judgment, reasons)

    def _post(
        self,
        transaction: MachineTransaction,
        kind: Kind,
        event: Event,
        point: str,
        number: int,
        judgment: Judgment,
        reasons: tuple[str, ...],
    ) -> None:
        message = AlarmMessage(
            machine=transaction.name,
            point=point,
            kind=kind,
            event=event,
            time=judgment.time.isoformat(),
            identity=f"alarm-{number}-{event}-{judgment.content[:16]}",
            reasons=reasons,
            link=f"{page_address(self._config.page)}/alarms/{number}",
        )
        for channel in self._config.channels:
            transaction.post(channel.name, message.to_dict(), number)

    def _reject(self, file: SpoolFile, reason: str, detail: str) -> Outcome:
        delivery = file.delivery
        copy = None if reason == "double" else self._rejected.keep(file)
        self._history.reject(
            Rejection(
                received=delivery.received,
                source=delivery.source,
                file=delivery.file,
                machine=delivery.machine,
                content=sha256_of(file.path),
                reason=reason,
                detail=detail,
                copy=copy,
            )
        )
        return Outcome(
            delivery.machine or "", delivery.file, "rejected", f"filed as {reason}: {detail}", reason == "error"
        )


def _state(point_judgment: PointJudgment) -> str:
    if point_judgment.stage == "sensor":
        return "sensor"
    if point_judgment.is_alarm:
        return "alarm"
    if point_judgment.stage == "learning":
        return "learning"
    return "unusual" if point_judgment.is_large else "normal"


def _sentence(point_judgment: PointJudgment, verdict: Verdict, state: str, config: WatchConfig) -> str:
    words = [state]
    if state == "learning":
        words = [f"learning {point_judgment.learned}/{config.alarms.learning}"]
    elif point_judgment.capital is not None:
        words.append(f"evidence {point_judgment.capital:.3g} of {1 / config.alarms.false_alarm_rate:.3g}")
    if verdict.label is not None:
        words.append(f"{verdict.label} {verdict.probability:.2f}")
    changes = (("pump", point_judgment.pump), ("sensor", point_judgment.sensor))
    words += [f"{kind} alarm {change}" for kind, change in changes if change is not None]
    if state in ("alarm", "unusual", "sensor"):
        words += point_judgment.reasons[:2]
    return "; ".join(words)
