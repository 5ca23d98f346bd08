"""From a file in the spool to its verdict in the history, in one transaction."""

import logging
import threading
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swashtwin.foundation import DataError, SwashTwinError, sha256_of, to_table
from swashtwin.monitoring.alarms.baseline import OperatingPoint, match_operating_point
from swashtwin.monitoring.alarms.channels import AlarmMessage
from swashtwin.monitoring.alarms.monitor import (
    AlarmChange,
    OperatingPointJudgment,
    OperatingPointMonitor,
    OperatingPointState,
)
from swashtwin.monitoring.alarms.suspect import (
    PriorNotAdaptedError,
    SeverityRequest,
    Suspects,
    measure_severity,
)
from swashtwin.monitoring.config.settings import Machine, WatchConfig
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.schema import Alarm, Judgment, Rejection
from swashtwin.monitoring.history.transaction import MachineTransaction
from swashtwin.monitoring.sources.contents import Contents, Tags, read_contents
from swashtwin.monitoring.sources.delivery import RejectionError
from swashtwin.monitoring.sources.spool import RejectedFiles, SpoolFile
from swashtwin.recordings import Recording

if TYPE_CHECKING:
    from swashtwin.diagnosis import AnomalyDetector, FaultClassifier, PriorClassifier

    Model = FaultClassifier | AnomalyDetector | PriorClassifier

_LATE = timedelta(minutes=5)
"""How much older than the machine's newest recording one may be: sources deliver side by side."""
_MOST_POINTS = 200
"""Operating points of a machine: more come of a speed or a pressure that does not stand still."""
_LOOKED_AT = 200
"""Newest alarms whose severity is measured."""
_HEALTHY = 8
"""Healthy recordings that a severity is measured against."""
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
        self._model, self._suspects = cache(_load), Suspects()
        self._tried: set[int] = set()
        """Alarms whose severity this process tried to measure."""
        self._pistons = {machine.name: machine.piston_count for machine in config.machines}
        self._rejected = RejectedFiles(config.folder / "rejected")
        self._tags = {
            machine.name: Tags(machine.tags)
            for machine in config.machines
            if machine.tags is not None
        }

    def load_models(self) -> list[str]:
        """Load the models of all machines; what is wrong with them, one line each."""
        models = [(machine.name, self._model(machine.model)) for machine in self._config.machines]
        return [f"model of {name}: {model}" for name, model in models if isinstance(model, str)]

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
            verdict = self._diagnosed(machine, contents.recording)
            stored = self._filed(machine, file, contents, verdict)
            if isinstance(stored, Outcome):
                return stored
            delivery = file.delivery
            if (stored.source, stored.received) == (delivery.source, delivery.received):
                # a kill came between the verdict and the removal from the spool
                return Outcome(
                    machine.name, delivery.file, stored.state, "was judged before the restart"
                )
            raise RejectionError("double", f"it holds what recording {stored.id} holds.")
        except RejectionError as cause:
            return self._reject(file, cause.reason, str(cause))
        except (HistoryError, OSError):
            raise
        except Exception as cause:  # nothing in a recording may stop the watch
            _log.exception("judging %s of %s failed", file.delivery.file, file.delivery.machine)
            reason = f"an error of swashtwin ({type(cause).__name__}: {cause}); please report it"
            return self._reject(file, "error", reason)

    def measure_severities(self, stop: threading.Event) -> None:
        """Measure the severity of each alarm's suspect, which takes minutes; where that failed,
        again after a restart. That of an unsure suspect is measured once, of a sure one once a
        class.

        Another thread than that of `judge` may do so, so that no alarm waits for it; what a kill or
        `stop` interrupts is measured after the next start.

        Raises
        ------
        HistoryError
            The database is not reached.
        """
        for alarm in self._history.reader.alarms(limit=_LOOKED_AT):
            suspect, before = alarm.evidence.get("suspect"), alarm.evidence.get("severity", {})
            machine = self._config.machine(alarm.machine)
            if (
                machine is None
                or machine.calibration is None
                or alarm.closed is not None
                or suspect is None
            ):
                continue
            certainty, was_sure = suspect["certainty"], before.get("certainty") != "unsure"
            is_known = "verdict" in before or alarm.id in self._tried
            is_new = certainty == "sure" and not (
                was_sure and before.get("label") == suspect["label"]
            )
            if certainty not in ("sure", "unsure") or (is_known and not is_new):
                continue
            judgment = self._history.reader.recording(suspect["recording"])
            assert judgment is not None
            folder = self._history.waveforms.folder
            healthy = self._history.reader.healthy_files(judgment, _HEALTHY).values()
            worn = folder / judgment.waveform if judgment.waveform else None
            severity = measure_severity(
                SeverityRequest(
                    machine, suspect["label"], worn, tuple(folder / name for name in healthy)
                )
            )
            if stop.is_set():  # which may have ended the process that measures, too
                return
            with self._history.machine(alarm.machine) as transaction:
                stored = transaction.record_severity(
                    alarm.id, {**severity, "certainty": certainty, "recording": judgment.id}
                )
                self._tried.add(alarm.id)
                is_constrained = (
                    stored
                    and stored.closed is None
                    and stored not in transaction.unreported_alarms()
                )
                if stored and is_constrained and not transaction.silenced(datetime.now(UTC)):
                    self._post(
                        transaction,
                        "measured",
                        stored,
                        judgment,
                        stored.evidence["severity"]["notes"],
                    )

    def _machine(self, file: SpoolFile) -> Machine:
        name = file.delivery.machine
        if name is None and len(self._config.machines) == 1:
            return self._config.machines[0]
        machine = None if name is None else self._config.machine(name)
        if machine is None:
            stated = "states no machine" if name is None else f"is of {name!r}"
            raise RejectionError("machine", f"it {stated}; there are {self._config.machine_names}.")
        return machine

    def _diagnosed(self, machine: Machine, recording: Recording) -> dict[str, Any]:
        """What the machine's model says: fields of a `Judgment`, the ``answer``, and why there is
        ``no_verdict``.
        """
        model = self._model(machine.model)
        if model is None or isinstance(model, str):
            return {"no_verdict": model}
        loaded, fingerprint = model
        try:
            verdict = loaded.diagnose(recording)
        except SwashTwinError as cause:
            return {"model": fingerprint, "no_verdict": str(cause)}
        answer = verdict.to_dict()
        answer.pop("window_labels")
        if verdict.label is None:
            return {"model": fingerprint, "answer": answer, "no_verdict": verdict.no_verdict}
        named = {} if verdict.unknown else {"probability": verdict.probabilities.get(verdict.label)}
        if verdict.n_windows and not verdict.unknown:
            named["confidence"] = verdict.agreement
        return {
            "model": fingerprint,
            "answer": answer,
            "label": verdict.verdict,
            **named,
            "ood_p": verdict.p_value,
        }

    def _filed(
        self, machine: Machine, file: SpoolFile, contents: Contents, verdict: dict[str, Any]
    ) -> Outcome | Judgment:
        while True:
            try:
                with self._history.machine(machine.name) as transaction:
                    stored = transaction.recording_of(contents.digest)
                    return (
                        self._file(transaction, machine, file, contents, dict(verdict))
                        if stored is None
                        else stored
                    )
            except (
                PriorNotAdaptedError
            ) as needed:  # which takes seconds, in which nobody else could write
                self._suspects.adapt(needed.healthy)

    def _file(
        self,
        transaction: MachineTransaction,
        machine: Machine,
        file: SpoolFile,
        contents: Contents,
        verdict: dict[str, Any],
    ) -> Outcome:
        recording, delivery = contents.recording, file.delivery
        newest = transaction.newest()
        if newest is not None and newest <= delivery.received and contents.time < newest - _LATE:
            raise RejectionError(
                "late",
                f"it is of {contents.time:%Y-%m-%d %H:%M:%S}, and {newest:%Y-%m-%d %H:%M:%S} was judged already.",
            )
        points = transaction.operating_points()
        point = match_operating_point(recording, points)
        if len(points) >= _MOST_POINTS and all(known.name != point.name for known in points):
            raise RejectionError(
                "points",
                f"{point.name} would be a new operating point, and {transaction.name} has {len(points)} already, which "
                "is the most; record it at fewer speeds and pressures, then note a maintenance, which forgets all "
                "points.",
            )
        stored, baseline = transaction.operating_point(point.name), transaction.baseline(point.name)
        state = (
            OperatingPointState.read(baseline, stored.test)
            if stored and stored.test and baseline is not None
            else None
        )
        settings = self._config.alarms
        pistons = self._pistons[machine.name]
        monitor = OperatingPointMonitor(
            machine.name, settings.false_alarm_rate, settings.baseline_recordings, pistons
        )
        try:
            found = monitor.judge(recording, state, point=point.name)
        except DataError as cause:
            raise RejectionError("unfit", str(cause)) from cause
        stated = OperatingPoint.of(recording)
        if found.stage == "sensor":  # whatever the model says of it, it says nothing of the pump
            verdict = {
                "no_verdict": "A sensor is at fault, or the pump does not run: no verdict on the pump."
            }
        suspect = None
        if found.is_large or found.pump == "raised":
            suspect = to_table(self._suspects.name(machine, point, found.state.baseline, recording))
        judgment = Judgment(
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
            speed=stated.speed,
            pressure=stated.pressure,
            state=_state(found),
            alarm_p=found.p_value,
            capital=found.capital,
            reasons={
                "sentences": list(found.reasons),
                "notes": [*contents.notes, *found.notes],
                "findings": to_table(found.findings),
                "moved": to_table(found.moved),
                "score": found.score,
                "learned": found.learned,
                "learning": settings.baseline_recordings,
                "verdict": verdict.pop("answer", {}),
                "no_verdict": verdict.pop("no_verdict", None),
                "suspect": suspect,
            },
            **verdict,
        )
        path = self._history.waveforms.write(
            transaction.name, contents.time, contents.digest, recording
        )
        transaction.add_recording(judgment, found.band_powers, path)
        is_unchanged = state is not None and found.state.baseline is state.baseline
        transaction.save_operating_point(
            point.name,
            speed=point.speed,
            pressure=point.pressure,
            baseline=None if is_unchanged else to_table(found.state.baseline),
            test=found.state.rest(),
        )
        for kind, change in (("pump", found.pump), ("sensor", found.sensor)):
            if change is not None:
                self._change_alarm(transaction, kind, change, judgment, found)
        _follow_suspect(transaction, judgment)
        untold = [alarm for alarm in transaction.unreported_alarms() if alarm.cleared is None]
        if untold and not transaction.silenced(judgment.received):
            for alarm in untold:
                self._post(
                    transaction, "opened", alarm, judgment, alarm.evidence.get("reasons", ())
                )
        return Outcome(
            transaction.name,
            delivery.file,
            judgment.state,
            _sentence(found, judgment, self._config),
        )

    def _change_alarm(
        self,
        transaction: MachineTransaction,
        kind: str,
        change: AlarmChange,
        judgment: Judgment,
        found: OperatingPointJudgment,
    ) -> None:
        alarms = [
            alarm
            for alarm in transaction.alarms()
            if (alarm.kind, alarm.point) == (kind, judgment.point)
        ]
        alarm = alarms[-1] if alarms else None
        if change == "raised":
            event = "opened"
            if alarm is None:
                alarm = transaction.open_alarm(
                    kind, judgment.point, judgment.time, found.to_dict(), judgment.id
                )
                _follow_suspect(transaction, judgment)
            else:
                alarm.cleared = None  # its cause is back before somebody acknowledged it
        elif alarm is None:
            return
        else:
            event = "closed" if alarm.state == "acknowledged" else "cleared"
            transaction.clear_alarm(alarm.id, judgment.time)
        if not transaction.silenced(judgment.received):
            self._post(transaction, event, alarm, judgment, found.reasons)

    def _post(
        self,
        transaction: MachineTransaction,
        event: str,
        alarm: Alarm,
        judgment: Judgment,
        reasons: Sequence[str],
    ) -> None:
        known, severity = list[str](), alarm.evidence.get("severity", {}).get("sentence", "")
        if event in ("opened", "measured"):
            known = [
                alarm.evidence[name]["sentence"]
                for name in ("suspect", "severity")
                if alarm.evidence.get(name)
            ]
        message = AlarmMessage(
            machine=transaction.name,
            point=alarm.point or "any",
            kind=alarm.kind,
            event=event,
            time=judgment.time.isoformat(),
            identity=f"alarm-{alarm.id}-{event}-{sha256(severity.encode()).hexdigest()[:8]}-{judgment.content[:16]}",
            reasons=(*known, *reasons),
            link=f"{self._config.page.address}/alarms/{alarm.id}",
        )
        for channel in self._config.channels:
            transaction.post(channel.name, asdict(message), alarm.id)

    def _reject(self, file: SpoolFile, reason: str, detail: str) -> Outcome:
        delivery = file.delivery
        rejection = Rejection(
            received=delivery.received,
            source=delivery.source,
            file=delivery.file,
            machine=delivery.machine or "",
            content=sha256_of(file.path),
            reason=reason,
            detail=detail,
            copy=None if reason == "double" else self._rejected.keep(file),
        )
        self._history.reject(rejection)
        sentence = f"filed as {reason}: {detail}"
        return Outcome(
            delivery.machine or "", delivery.file, "rejected", sentence, reason == "error"
        )


def _load(path: Path | None) -> "tuple[Model, str] | str | None":
    """A model and its fingerprint, or why there is none; None without a path."""
    from swashtwin.diagnosis import load_model

    try:
        return None if path is None else (load_model(path), sha256_of(path)[:16])
    except (SwashTwinError, OSError) as cause:
        return str(cause)


def _follow_suspect(transaction: MachineTransaction, judgment: Judgment) -> None:
    """Let the pump's alarm at the same point have the suspect of its newest recording whose levels
    moved far.
    """
    if suspect := judgment.reasons["suspect"]:
        for alarm in transaction.alarms():
            if (alarm.kind, alarm.point) == ("pump", judgment.point):
                alarm.evidence = {
                    **alarm.evidence,
                    "suspect": {**suspect, "recording": judgment.id},
                }


def _state(found: OperatingPointJudgment) -> str:
    if found.stage == "sensor":
        return "sensor"
    if found.is_alarm:
        return "alarm"
    if found.stage == "learning":
        return "learning"
    return "unusual" if found.is_large else "normal"


def _sentence(found: OperatingPointJudgment, judgment: Judgment, config: WatchConfig) -> str:
    words = [judgment.state]
    if judgment.state == "learning":
        words = [f"learning {found.learned}/{config.alarms.baseline_recordings}"]
    elif found.capital is not None:
        words.append(f"evidence {found.capital:.3g} of {1 / config.alarms.false_alarm_rate:.3g}")
    if judgment.label is not None:
        words.append(f"{judgment.label} {judgment.probability:.2f}")
    if suspect := judgment.reasons["suspect"]:
        words.append(suspect["sentence"].rstrip("."))
    changes = (("pump", found.pump), ("sensor", found.sensor))
    words += [f"{kind} alarm {change}" for kind, change in changes if change is not None]
    if judgment.state in ("alarm", "unusual", "sensor"):
        words += found.reasons[:2]
    return "; ".join(words)
