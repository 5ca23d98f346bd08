"""From a file in the spool to its verdict in the history."""

import logging
from collections import Counter
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from swashtwin.foundation import SwashTwinError, sha256_of
from swashtwin.monitoring.alarms.suspect import PriorNotAdaptedError, Suspects
from swashtwin.monitoring.config.settings import Machine, WatchConfig
from swashtwin.monitoring.config.time_zones import read_zone
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.schema import Judgment, Rejection
from swashtwin.monitoring.history.transaction import MachineTransaction
from swashtwin.monitoring.service.deliveries import (
    N_IN_A_ROW,
    UNCOUNTED_REASONS,
    DeliveryFinding,
    DeliveryMonitor,
    active_problem,
)
from swashtwin.monitoring.service.filing import (
    Arrival,
    FiledRecording,
    ModelVerdict,
    RecordingFiler,
    WrongClockError,
)
from swashtwin.monitoring.sources.contents import read_contents
from swashtwin.monitoring.sources.delivery import (
    GROWN_FACT,
    REJECTION_REASONS,
    Delivery,
    RejectionError,
)
from swashtwin.monitoring.sources.spool import RejectedFiles, SpoolFile
from swashtwin.monitoring.sources.tags import Tags, TagsPendingError
from swashtwin.recordings import Recording

if TYPE_CHECKING:
    from swashtwin.diagnosis import AnomalyDetector, FaultClassifier, PriorClassifier

    Model = FaultClassifier | AnomalyDetector | PriorClassifier

MAX_HELD = 1000
"""Recordings of a machine that wait for its tags; more are rejected, so that other machines have
space.
"""
MAX_STRANGERS = 100
"""Unknown machines whose deliveries are counted."""
WAITING = "waiting"
"""State of a recording that waits for the tags of its machine."""
_log = logging.getLogger("swashtwin.watch")


@dataclass(frozen=True)
class Outcome:
    """What became of a recording."""

    machine: str
    """Name of the machine as delivered; empty if none was specified."""
    file: str
    """Name of the recording's file."""
    state: str
    """``learning``, ``normal``, ``unusual``, ``alarm``, ``sensor``, ``rejected`` or ``waiting``."""
    sentence: str
    """The outcome for a person, in one line."""
    has_failed: bool = False
    """Whether an internal error stopped the judgment."""

    @property
    def is_waiting(self) -> bool:
        """Whether the recording waits to be judged later."""
        return self.state == WAITING


class Pipeline:
    """Judges one recording after the other."""

    def __init__(self, config: WatchConfig, history: History) -> None:
        self._config = config
        self._history = history
        self._load_model = cache(_load_model)
        self._suspects = Suspects()
        self._filer = RecordingFiler(config, history, self._suspects)
        self._rejected = RejectedFiles(config.folder / "rejected")
        self._deliveries = DeliveryMonitor(config)
        self._tags = _open_tags(config)
        self._n_held = Counter[str]()
        """Recordings of each machine that wait for its tags."""
        self._hold_reasons: dict[str, str] = {}
        """Why the first of them waits."""
        self._n_strange = Counter[tuple[str, str]]()
        """Deliveries for each unknown machine, by source."""
        self._problems = self._stored_problems()
        """What is wrong with the deliveries of each machine."""

    @property
    def delivery_problems(self) -> list[str]:
        """What is wrong with the deliveries of the machines, one line for each."""
        # Copies, since another thread reads them.
        problems = [f"{name}: {problem}" for name, problem in dict(self._problems).items()]
        problems += [
            f"source {source}: {count} recordings are of {name or 'no machine'}, which the "
            "configuration does not have."
            for (source, name), count in dict(self._n_strange).items()
            if count >= N_IN_A_ROW
        ]
        return problems

    def _stored_problems(self) -> dict[str, str]:
        """Return the problems that the history has from before the start."""
        names = {machine.name for machine in self._config.machines}
        problems: dict[str, str] = {}
        try:
            machines = self._history.reader.machines()
        except HistoryError:
            return problems  # each finding is reported again with the next delivery
        for machine in machines:
            for alarm in machine.alarms:
                problem = active_problem(alarm)
                if machine.name in names and problem is not None:
                    problems[machine.name] = problem
        return problems

    def may_resume(self) -> bool:
        """Return whether tags have changed for which recordings wait."""
        return any(self._tags[name].has_changed() for name in self._n_held)

    def resume(self) -> None:
        """Judge recordings again that waited for tags, in the order of their arrival."""
        self._n_held.clear()
        self._hold_reasons.clear()

    def load_models(self) -> list[str]:
        """Load the models of all machines, and return one line for each that cannot be loaded."""
        problems = []
        for machine in self._config.machines:
            model = self._load_model(machine.model)
            if isinstance(model, str):
                problems.append(f"model of {machine.name}: {model}")

        return problems

    def judge(self, file: SpoolFile) -> Outcome:
        """Judge or reject a recording, and return what became of it once the history has it.

        A recording whose operating point may be known later is neither: its state is `WAITING`,
        and those of its machine that follow wait too, until `resume`.

        Raises
        ------
        HistoryError, OSError
            The database cannot be reached or the disk is full; try again later.
        """
        machine = None
        try:
            machine = self._find_machine(file)
            if self._n_held[machine.name]:
                raise TagsPendingError("an earlier recording waits.")
            filed = self._judge_of(machine, file)
        except TagsPendingError as cause:
            assert machine is not None
            if self._n_held[machine.name] < MAX_HELD:
                return self._hold(machine, file, str(cause))
            return self._reject(machine, file, "tags", str(cause))
        except RejectionError as cause:
            return self._reject(machine, file, cause.reason, str(cause))
        except (HistoryError, OSError):
            raise
        except Exception as cause:  # no recording may stop the watch
            _log.exception("judging %s of %s failed", file.delivery.file, file.delivery.machine)
            detail = (
                f"an internal error of swashtwin ({type(cause).__name__}: {cause}); "
                "please report it"
            )
            return self._reject(machine, file, "error", detail)

        if isinstance(filed, FiledRecording):
            change = self._note_problem(machine.name, filed.delivery_problem)
            sentence = f"{filed.sentence}{change}"
            return Outcome(machine.name, file.delivery.file, filed.state, sentence)

        return self._report_duplicate(machine, file, filed)

    def _judge_of(self, machine: Machine, file: SpoolFile) -> FiledRecording | Judgment:
        """File a recording at its date, or at its time of arrival if its clock was set back."""
        self._refuse_growth(machine, file.delivery)
        try:
            return self._file(self._read(machine, file))
        except WrongClockError as cause:
            # The tags of another time hold, so the file is read again.
            facts = {name: text for name, text in file.delivery.facts.items() if name != "time"}
            undated = replace(file, delivery=replace(file.delivery, facts=facts))
            return self._file(self._read(machine, undated, cause))

    def _read(
        self, machine: Machine, file: SpoolFile, wrong_clock: WrongClockError | None = None
    ) -> Arrival:
        contents = read_contents(file, machine, self._tags.get(machine.name))
        wrong_date = None
        if wrong_clock is not None:
            wrong_date = wrong_clock.date
            contents = replace(
                contents,
                notes=(str(wrong_clock), *contents.notes),
                clock_problem=str(wrong_clock),
            )
        verdict = self._diagnose(machine, contents.recording)
        return Arrival(machine, file.delivery, contents, verdict, wrong_date)

    def _refuse_growth(self, machine: Machine, delivery: Delivery) -> None:
        """Refuse a file that was judged before it was complete: its beginning would count twice."""
        times = delivery.facts.get(GROWN_FACT, "").split()
        if not times:
            return
        deliveries = [datetime.fromisoformat(text) for text in times]
        with self._history.machine(machine.name) as transaction:
            was_judged = transaction.was_judged(delivery.source, deliveries)
        if was_judged:
            raise RejectionError(
                "grown",
                f"{delivery.file} was judged before it was complete, and grew later. Increase "
                "settle_time of the source above the pauses of the program that writes it, or let "
                "that program rename the file when it is complete.",
            )

    def _hold(self, machine: Machine, file: SpoolFile, reason: str) -> Outcome:
        """Let a recording wait for the tags of its machine."""
        reason = self._hold_reasons.setdefault(machine.name, reason)
        self._n_held[machine.name] += 1
        n_held = self._n_held[machine.name]
        change = ""
        if n_held <= N_IN_A_ROW:
            with self._history.machine(machine.name) as transaction:
                count = self._deliveries.load(transaction).n_findings + n_held
                if count >= N_IN_A_ROW:
                    finding = DeliveryFinding("tags", reason)
                    problem = self._deliveries.report(transaction, file.delivery, [finding], count)
                    change = self._note_problem(machine.name, problem)
        sentence = f"waits for its tags: {reason}{change}"
        return Outcome(machine.name, file.delivery.file, WAITING, sentence)

    def _note_problem(self, machine: str, problem: str | None) -> str:
        """Keep what is wrong with the deliveries of a machine, and return what changed in words."""
        previous = self._problems.pop(machine, None)
        if problem is not None:
            self._problems[machine] = problem
        if previous is None and problem is not None:
            return "; delivery alarm raised"
        if previous is not None and problem is None:
            return "; delivery alarm cleared"
        return ""

    def _find_machine(self, file: SpoolFile) -> Machine:
        name = file.delivery.machine
        if name is None and len(self._config.machines) == 1:
            return self._config.machines[0]

        problem = "no machine is specified"
        if name is not None:
            machine = self._config.machine(name)
            if machine is not None:
                return machine
            problem = f"unknown machine {name!r}"
        raise RejectionError(
            "machine", f"{problem}; the configuration has {self._config.machine_names}."
        )

    def _diagnose(self, machine: Machine, recording: Recording) -> ModelVerdict:
        """Return the verdict of the machine's model, or why there is none."""
        model = self._load_model(machine.model)
        if model is None or isinstance(model, str):
            return ModelVerdict(no_verdict=model)

        loaded_model, fingerprint = model
        try:
            diagnosis = loaded_model.diagnose(recording)
        except SwashTwinError as cause:
            return ModelVerdict(model=fingerprint, no_verdict=str(cause))

        answer = diagnosis.to_dict()
        answer.pop("window_labels")  # thousands of entries, which no reader of the history shows
        if diagnosis.label is None:
            return ModelVerdict(fingerprint, answer, no_verdict=diagnosis.no_verdict)

        # An unknown fault has no probability among the known classes.
        probability = None
        confidence = None
        if not diagnosis.unknown:
            probability = diagnosis.probabilities.get(diagnosis.label)
            if diagnosis.n_windows:
                confidence = diagnosis.agreement

        return ModelVerdict(
            fingerprint,
            answer,
            label=diagnosis.verdict,
            probability=probability,
            confidence=confidence,
            ood_p=diagnosis.p_value,
        )

    def _file(self, arrival: Arrival) -> FiledRecording | Judgment:
        """File a recording, or return the judgment of one with the same content."""
        while True:
            try:
                with self._history.machine(arrival.machine.name) as transaction:
                    duplicate = transaction.recording_of(arrival.contents.digest)
                    if duplicate is not None:
                        return duplicate
                    return self._filer.file(transaction, arrival)
            except PriorNotAdaptedError as cause:
                # Adapting takes seconds, in which a transaction would keep all others from writing.
                self._suspects.adapt(cause.request)

    def _report_duplicate(self, machine: Machine, file: SpoolFile, stored: Judgment) -> Outcome:
        delivery = file.delivery
        if (stored.source, stored.received) == (delivery.source, delivery.received):
            # The watch was killed between the verdict and the removal from the spool.
            return Outcome(
                stored.machine, delivery.file, stored.state, "was judged before the restart"
            )
        return self._reject(
            machine, file, "double", f"same content as recording {stored.id}.", repeats=stored.id
        )

    def _reject(
        self,
        machine: Machine | None,
        file: SpoolFile,
        reason: str,
        detail: str,
        *,
        repeats: int | None = None,
    ) -> Outcome:
        delivery = file.delivery
        copy = None
        if reason != "double":  # the history has the samples of a duplicate
            copy = self._rejected.keep(file)
        rejection = Rejection(
            received=delivery.received,
            source=delivery.source,
            file=delivery.file,
            machine=delivery.machine or "",
            content=sha256_of(file.path),
            reason=reason,
            detail=detail,
            copy=copy,
        )
        self._history.reject(rejection)
        change = self._count_rejection(machine, delivery, DeliveryFinding(reason, detail), repeats)

        return Outcome(
            machine=delivery.machine or "",
            file=delivery.file,
            state="rejected",
            sentence=f"rejected ({REJECTION_REASONS.get(reason, reason)}): {detail}{change}",
            has_failed=reason == "error",
        )

    def _count_rejection(
        self,
        machine: Machine | None,
        delivery: Delivery,
        finding: DeliveryFinding,
        repeats: int | None,
    ) -> str:
        """Count a rejection as a finding of its machine, and return what changed in words.

        Parameters
        ----------
        repeats : number of the recording that has the same samples.
        """
        if machine is None:
            if len(self._n_strange) < MAX_STRANGERS:
                self._n_strange[delivery.source, delivery.machine or ""] += 1
            return ""

        with self._history.machine(machine.name) as transaction:
            if finding.kind in UNCOUNTED_REASONS and not self._is_stuck(transaction, repeats):
                return ""
            state = self._deliveries.load(transaction)
            if finding.kind == "late":
                state = replace(state, n_late=state.n_late + 1)
            problem = self._deliveries.count(transaction, state, delivery, [finding])
        return self._note_problem(machine.name, problem)

    def _is_stuck(self, transaction: MachineTransaction, repeats: int | None) -> bool:
        """Return whether a delivery repeats the newest recording, as a logger does that hangs."""
        return repeats is not None and transaction.is_newest(repeats)


def _open_tags(config: WatchConfig) -> dict[str, Tags]:
    """Return the tags of each machine that has a file of them."""
    tags = {}
    for machine in config.machines:
        if machine.tags is None:
            continue
        zone = None
        if machine.tags_zone is not None:
            zone = read_zone(machine.tags_zone)
        tags[machine.name] = Tags(machine.tags, zone)
    return tags


def _load_model(path: Path | None) -> "tuple[Model, str] | str | None":
    """Return a model and its fingerprint, or why it cannot be loaded; None without a path."""
    from swashtwin.diagnosis import load_model

    if path is None:
        return None
    try:
        return load_model(path), sha256_of(path)[:16]
    except (SwashTwinError, OSError) as cause:
        return str(cause)
