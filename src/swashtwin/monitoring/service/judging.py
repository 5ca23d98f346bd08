"""From a file in the spool to its verdict in the history."""

import logging
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from swashtwin.foundation import SwashTwinError, sha256_of
from swashtwin.monitoring.alarms.suspect import PriorNotAdaptedError, Suspects
from swashtwin.monitoring.config.settings import Machine, WatchConfig
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.schema import Judgment, Rejection
from swashtwin.monitoring.service.filing import (
    Arrival,
    FiledRecording,
    ModelVerdict,
    RecordingFiler,
)
from swashtwin.monitoring.sources.contents import read_contents
from swashtwin.monitoring.sources.delivery import REJECTION_REASONS, RejectionError
from swashtwin.monitoring.sources.spool import RejectedFiles, SpoolFile
from swashtwin.monitoring.sources.tags import Tags
from swashtwin.recordings import Recording

if TYPE_CHECKING:
    from swashtwin.diagnosis import AnomalyDetector, FaultClassifier, PriorClassifier

    Model = FaultClassifier | AnomalyDetector | PriorClassifier

_log = logging.getLogger("swashtwin.watch")


@dataclass(frozen=True)
class Outcome:
    """What became of a recording."""

    machine: str
    """Name of the machine as delivered; empty if none was specified."""
    file: str
    """Name of the recording's file."""
    state: str
    """``learning``, ``normal``, ``unusual``, ``alarm``, ``sensor``, or ``rejected``."""
    sentence: str
    """The outcome for a person, in one line."""
    has_failed: bool = False
    """Whether an internal error stopped the judgment."""


class Pipeline:
    """Judges one recording after the other."""

    def __init__(self, config: WatchConfig, history: History) -> None:
        self._config = config
        self._history = history
        self._load_model = cache(_load_model)
        self._suspects = Suspects()
        self._filer = RecordingFiler(config, history, self._suspects)
        self._rejected = RejectedFiles(config.folder / "rejected")
        self._tags = {
            machine.name: Tags(machine.tags)
            for machine in config.machines
            if machine.tags is not None
        }

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

        Raises
        ------
        HistoryError, OSError
            The database cannot be reached or the disk is full; try again later.
        """
        try:
            machine = self._find_machine(file)
            contents = read_contents(file, machine, self._tags.get(machine.name))
            verdict = self._diagnose(machine, contents.recording)
            filed = self._file(Arrival(machine, file.delivery, contents, verdict))
        except RejectionError as cause:
            return self._reject(file, cause.reason, str(cause))
        except (HistoryError, OSError):
            raise
        except Exception as cause:  # no recording may stop the watch
            _log.exception("judging %s of %s failed", file.delivery.file, file.delivery.machine)
            detail = (
                f"an internal error of swashtwin ({type(cause).__name__}: {cause}); "
                "please report it"
            )
            return self._reject(file, "error", detail)

        if isinstance(filed, FiledRecording):
            return Outcome(machine.name, file.delivery.file, filed.state, filed.sentence)

        return self._report_duplicate(file, filed)

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

    def _report_duplicate(self, file: SpoolFile, stored: Judgment) -> Outcome:
        delivery = file.delivery
        if (stored.source, stored.received) == (delivery.source, delivery.received):
            # The watch was killed between the verdict and the removal from the spool.
            return Outcome(
                stored.machine, delivery.file, stored.state, "was judged before the restart"
            )
        return self._reject(file, "double", f"same content as recording {stored.id}.")

    def _reject(self, file: SpoolFile, reason: str, detail: str) -> Outcome:
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

        return Outcome(
            machine=delivery.machine or "",
            file=delivery.file,
            state="rejected",
            sentence=f"rejected ({REJECTION_REASONS.get(reason, reason)}): {detail}",
            has_failed=reason == "error",
        )


def _load_model(path: Path | None) -> "tuple[Model, str] | str | None":
    """Return a model and its fingerprint, or why it cannot be loaded; None without a path."""
    from swashtwin.diagnosis import load_model

    if path is None:
        return None
    try:
        return load_model(path), sha256_of(path)[:16]
    except (SwashTwinError, OSError) as cause:
        return str(cause)
