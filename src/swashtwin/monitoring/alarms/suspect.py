"""The suspect of an alarm: the fault that a pump prior finds most similar to a recording.

Another process adapts the prior to what the watch learned, since that takes seconds, and memory
that would not be returned to the system.
"""

import logging
import math
import time
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Literal

import numpy as np
from jaxtyping import Float64

from swashtwin.diagnosis import (
    ChangeLibrary,
    Diagnosis,
    PriorClassifier,
    add_provenance,
    order_band_powers,
    weigh_library,
)
from swashtwin.foundation import DataError, SwashTwinError, run_in_child
from swashtwin.monitoring.alarms.baseline import OperatingPointBaseline
from swashtwin.monitoring.alarms.operating_point import OperatingPoint
from swashtwin.monitoring.config.settings import Machine
from swashtwin.pump import is_healthy, load_pump
from swashtwin.recordings import Recording
from swashtwin.signals import OrderBands

SURE_PROBABILITY = 0.8
"""Probability from which on a suspect is named without the second candidate."""
N_CACHED_PRIORS = 128
"""Adapted priors that are kept in memory; one takes 0.2 MB."""
ADAPT_TIMEOUT_S = 600.0
"""Time limit for adapting a prior, which takes some seconds, or half a minute with a library."""
RETRY_DELAY_S = 3600.0
"""Time after which adapting is tried again if the process failed."""
_log = logging.getLogger("swashtwin.watch")


@dataclass(frozen=True)
class Suspect:
    """What a pump prior concludes from a recording that deviates far."""

    certainty: Literal["sure", "unsure", "unknown", "none"]
    """``unknown``: the recording fits no class of the prior; ``none``: the prior cannot be used."""
    sentence: str
    """Which fault it is and how sure, or why no fault is named."""
    label: str | None = None
    """Most similar fault; a guess unless ``sure``."""
    probabilities: Mapping[str, float] = field(default_factory=dict)
    """Probability of each class of the prior, calibrated on virtual pumps."""
    p_value: float | None = None
    """Share of the prior's own recordings that fit its classes as badly."""

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> "Suspect":
        """Return the suspect of an adapted prior's diagnosis."""
        if diagnosis.label is None:
            return cls.none(diagnosis.no_verdict or "")

        probabilities = diagnosis.probabilities
        p_value = diagnosis.p_value
        if diagnosis.unknown:
            sentence = f"Suspect unknown. {diagnosis.reasons[0]}"
            return cls("unknown", sentence, diagnosis.label, probabilities, p_value)

        ranked_labels = sorted(probabilities, key=lambda label: -probabilities[label])

        first, second = (
            f"{describe_class(label)} ({100 * probabilities[label]:.0f} %)"
            for label in ranked_labels[:2]
        )

        # The alarm contradicts a healthy diagnosis, so the likeliest fault is named, as a guess.
        if is_healthy(diagnosis.label):
            sentence = f"Suspect, unsure: {second}; the prior still finds {first} likelier."
            return cls("unsure", sentence, ranked_labels[1], probabilities, p_value)
        if probabilities[ranked_labels[0]] >= SURE_PROBABILITY:
            return cls("sure", f"Suspect: {first}.", diagnosis.label, probabilities, p_value)
        sentence = f"Suspect, unsure: {first}, or {second}."
        if diagnosis.separation:
            sentence = f"{sentence} {diagnosis.separation}"
        return cls("unsure", sentence, diagnosis.label, probabilities, p_value)

    @classmethod
    def none(cls, reason: str) -> "Suspect":
        """Return the absence of a suspect, with its reason."""
        return cls("none", f"No suspect is named: {reason}")


def describe_class(label: str) -> str:
    """Return a class of a prior as a reader should see it."""
    if label == "other":
        return "another fault"
    return label.replace("_", " ")


@dataclass(frozen=True, eq=False)
class PriorAdaptation:
    """What adapts a prior to a machine at an operating point."""

    machine: Machine
    channels: tuple[str, ...]
    unit: str
    point: OperatingPoint
    rows: Float64[np.ndarray, "recording order_band"]
    """Band powers of `measure_orders` of the healthy recordings."""

    @property
    def key(self) -> str:
        """Digest of all that decides the adapted prior."""
        facts = (self.machine, self.channels, self.unit, self.point)
        return sha256(repr(facts).encode() + self.rows.tobytes()).hexdigest()

    def adapt(self) -> PriorClassifier:
        """Return the prior of the machine, adapted to it.

        Raises
        ------
        SwashTwinError
            The prior or the library cannot be read, or the virtual pumps of the prior lack a
            channel of the machine.
        """
        prior = PriorClassifier.load(self.machine.prior)
        pump = self.machine.pump
        # For another design of pump, the prior uses its piston count.
        pistons = self.machine.piston_count
        if pump is not None and load_pump(pump).name == prior.pump:
            pistons = None
        prior = prior.for_machine(self.channels, self.unit, pistons)

        n_recordings = len(self.rows)
        speed = math.nan if self.point.speed is None else self.point.speed
        pressure = math.nan if self.point.pressure is None else self.point.pressure
        adapted_prior = replace(
            prior,
            band_powers=self.rows.reshape(n_recordings, len(self.channels), -1),
            specimen=(self.machine.name,) * n_recordings,
            point_speed=np.full(n_recordings, speed),
            point_pressure=np.full(n_recordings, pressure),
        )
        if self.machine.library is None:
            return adapted_prior.fit_band_powers()

        use = weigh_library(adapted_prior, ChangeLibrary.load(self.machine.library))
        return add_provenance(adapted_prior.fit_band_powers(library=use.changes), use)


class PriorNotAdaptedError(Exception):
    """A prior has to be adapted first: `Suspects.adapt` does that, outside of any transaction."""

    def __init__(self, request: PriorAdaptation) -> None:
        super().__init__()
        self.request = request


class Suspects:
    """Names suspects by priors that are adapted when they are first needed."""

    def __init__(self) -> None:
        self._adapted: OrderedDict[str, PriorClassifier | str] = OrderedDict()
        """Adapted priors by `PriorAdaptation.key`, or why a prior cannot be adapted."""
        self._failure_times: dict[str, float] = {}
        """When [s] the process that adapts a prior failed, by the same key."""

    def name(
        self,
        machine: Machine,
        point: OperatingPoint,
        baseline: OperatingPointBaseline,
        recording: Recording,
    ) -> Suspect:
        """Return the suspect of a recording that deviates far from a complete baseline.

        Raises
        ------
        PriorNotAdaptedError
            The prior has to be adapted first.
        """
        if machine.piston_count is None:
            return Suspect.none(
                "the piston count of the pump is not known. Add pump or pistons to its "
                "[[machine]], then record a maintenance."
            )
        if point.speed is None:
            return Suspect.none("the speed is not known, but a prior compares orders of the shaft.")

        rows = baseline.orders[np.isfinite(baseline.orders).any(axis=1)]
        if baseline.pistons != machine.piston_count or not len(rows):
            return Suspect.none(_explain_missing_orders(recording, machine.piston_count))

        request = PriorAdaptation(machine, recording.channels, recording.unit, point, rows)
        key = request.key
        if key not in self._adapted or self._may_retry(key):
            raise PriorNotAdaptedError(request)

        prior = self._adapted[key]
        if isinstance(prior, str):
            return Suspect.none(prior)
        return Suspect.of(prior.diagnose(recording.replace(specimen=machine.name)))

    def _may_retry(self, key: str) -> bool:
        failure_time = self._failure_times.get(key, math.inf)
        return time.monotonic() - failure_time > RETRY_DELAY_S

    def adapt(self, request: PriorAdaptation) -> None:
        """Adapt a prior in another process, and keep it, or the reason why that is impossible."""
        key = request.key
        self._failure_times.pop(key, None)
        try:
            self._adapted[key] = run_in_child(
                PriorAdaptation.adapt, request, timeout_s=ADAPT_TIMEOUT_S
            )
        except SwashTwinError as cause:
            self._adapted[key] = str(cause)
        except Exception as cause:  # a suspect is no reason to lose a judgment
            _log.warning("%s: the prior could not be adapted", request.machine.name, exc_info=cause)
            self._adapted[key] = (
                f"the prior could not be adapted ({type(cause).__name__}); see the log of the "
                "watch."
            )
            self._failure_times[key] = time.monotonic()

        # Each restart of a baseline leaves a prior that is never needed again.
        while len(self._adapted) > N_CACHED_PRIORS:
            oldest_key, _ = self._adapted.popitem(last=False)
            self._failure_times.pop(oldest_key, None)


def _explain_missing_orders(recording: Recording, pistons: int) -> str:
    try:
        order_band_powers(recording, OrderBands(pistons))
    except DataError as cause:
        return str(cause)
    return (
        "the healthy recordings were learned without the piston count. Record a maintenance to "
        "learn them again."
    )
