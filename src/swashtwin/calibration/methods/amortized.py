"""The same network trained once, over many twins: each new recording is then calibrated in one pass."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
import scipy.stats
import torch
from jaxtyping import Float

from swashtwin.calibration.archive import twin_to_dict
from swashtwin.calibration.methods.amortized_inputs import measured, noise_level
from swashtwin.calibration.methods.amortized_training import AmortizedTraining, Trained, trained
from swashtwin.calibration.methods.gauss_newton import GaussNewton
from swashtwin.calibration.methods.search import History, Progress, Search, one_thread
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.foundation import InputError

Refinement = Literal["none", "gauss_newton"]

DEFAULT_TRAINING = AmortizedTraining()
_WITHIN = 1e-6
"""A point keeps this share of the bounds' width away from them, where a search could not start."""


@dataclass(frozen=True, eq=False)
class AmortizedReading:
    """What one pass of the network says of a measurement; nothing is simulated for it."""

    names: tuple[str, ...]
    """Of the coordinates, as in `Unknowns.names`."""
    point: Float[np.ndarray, " unknown"]
    """Median of each coordinate."""
    deviation: Float[np.ndarray, " unknown"]
    """Standard deviation of each: near that of the prior where the measurement says nothing."""
    lower: Float[np.ndarray, " unknown"]
    """Each coordinate lies above with a probability of 95 %."""
    upper: Float[np.ndarray, " unknown"]
    """Each coordinate lies below with a probability of 95 %."""
    strangeness: float
    """How far the lines are from those trained on, over what one twin in 1000 exceeds; out of range above 1."""
    notes: tuple[str, ...]
    """Warnings in words."""


class AmortizedIPINN:
    """Network that was trained on twins drawn from the prior, and calibrates any recording of the same kind in a pass.

    `IPINN` trains its network for one recording and throws it away. Here the twins teach it before anything is
    measured: it is shown what they would measure, noise and model error included, and learns to make their values
    likely under a normal density of each coordinate, cut at the bounds. So it gives values with intervals, and says by
    a density as flat as the prior what a recording does not tell. `refine` then lets Gauss-Newton walk from its point.

    It is bound to one pump, fault, condition (or set of conditions), channels, lines and bounds, and refuses others.

    Examples
    --------
    ``network = AmortizedIPINN.train(objective_without_recordings(twin)); calibrate(twin, recordings, method=network)``
    """

    def __init__(
        self,
        trained_network: Trained,
        purpose: Mapping[str, Any],
        training: AmortizedTraining,
        seed: int,
        *,
        refine: Refinement = "gauss_newton",
        most_iterations: int = 20,
    ) -> None:
        if most_iterations < 1:
            raise InputError(f"most_iterations ({most_iterations}) must be at least 1.")
        self.trained, self.purpose, self.training, self.seed = trained_network, purpose, training, seed
        self.refine: Refinement = refine
        self.most_iterations = most_iterations

    @classmethod
    def train(
        cls,
        objective: Objective,
        training: AmortizedTraining = DEFAULT_TRAINING,
        *,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> "AmortizedIPINN":
        """Network for measurements like the objective's: same twin, channels, lines, bounds and nuisances.

        What was measured in `objective` is not looked at; `objective_without_recordings` makes one ahead of any
        measurement. The same seed on the same machine gives the same bits.
        """
        found = trained(objective, training, seed=seed, progress=progress)
        return cls(found, purpose_of(objective), training, seed)

    def with_refinement(self, refine: Refinement, most_iterations: int = 20) -> "AmortizedIPINN":
        """The same network with another way to go on from its point: ``none``, or so many steps of Gauss-Newton."""
        return AmortizedIPINN(
            self.trained, self.purpose, self.training, self.seed, refine=refine, most_iterations=most_iterations
        )

    @property
    def settings(self) -> dict[str, Any]:
        """How it was trained and how it goes on, as JSON can hold it."""
        own = {"training_seed": self.seed, "refine": self.refine, "most_iterations": self.most_iterations}
        return {**asdict(self.training), **own}

    def read(self, objective: Objective) -> AmortizedReading:
        """What the network says of the objective's measurement.

        Raises
        ------
        InputError
            It was trained for something else (the first difference is named), or phases are compared.
        DataError
            It reads a waveform, and the recording is too short.
        """
        objective.require_amplitudes("an amortized network")
        if difference := difference_of(self.purpose, purpose_of(objective)):
            raise InputError(f"the network was trained for something else: {difference}. Train one for this.")
        with one_thread(), torch.no_grad():
            given = measured(objective, self.training.read)
            middle, log_deviation = (row[0].double().numpy() for row in self.trained.network(given))
            lines = objective.measured.float()[None]
            strangeness = float(self.trained.usual.strangeness(lines, noise_level(objective))[0])
        unknowns, deviation = objective.unknowns, np.exp(log_deviation)
        half, center = (unknowns.upper - unknowns.lower) / 2, (unknowns.upper + unknowns.lower) / 2
        cut = scipy.stats.truncnorm((-1 - middle) / deviation, (1 - middle) / deviation, loc=middle, scale=deviation)
        low, median, high = center + half * cut.ppf([[0.05], [0.5], [0.95]])
        return AmortizedReading(
            names=unknowns.names,
            point=np.clip(median, unknowns.lower + _WITHIN * half, unknowns.upper - _WITHIN * half),
            deviation=half * cut.std(),
            lower=low,
            upper=high,
            strangeness=strangeness,
            notes=(_strange(strangeness),) if strangeness > 1 or not math.isfinite(strangeness) else (),
        )

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """Point of one pass, or what Gauss-Newton makes of it; see `Calibrator`.

        The notes say where the lines are unlike any that the network was trained on.
        """
        reading = self.read(objective)
        if self.refine == "gauss_newton":
            begun = replace(objective, unknowns=replace(objective.unknowns, start=reading.point))
            method = GaussNewton(starts=1, most_iterations=self.most_iterations)
            return replace(method.search(begun, seed=seed, progress=progress), notes=reading.notes)
        with torch.no_grad():
            loss = float(objective.weighted_loss(torch.as_tensor(reading.point)))
        if progress is not None:
            progress(1, 1, loss)
        history = History(np.array([loss]), np.zeros(1), reading.point[None], best=0)
        return Search(point=reading.point, history=history, simulations=1, notes=reading.notes)


def _strange(strangeness: float) -> str:
    return (
        f"the measured lines are unlike those of any twin that the network was trained on (distance {strangeness:.3g} "
        "times what 1 in 1000 of them exceeds): values beyond the bounds, a wrong constant of the pump file, another "
        "fault or unit. Do not trust its values; see what GaussNewton with Nuisances finds."
    )


def purpose_of(objective: Objective) -> dict[str, Any]:
    """What a network trained on the objective can be used for, as JSON can hold it.

    The interface values that a twin starts from are no part of it: the bounds are.
    """
    unknowns = objective.unknowns
    rows = zip(unknowns.lower, unknowns.upper, unknowns.center, unknowns.deviation, strict=True)
    names = ("lower", "upper", "center", "deviation")
    purpose: dict[str, Any] = {
        "conditions": {
            str(place): {
                "twin": _fixed(twin_to_dict(one.twin)),
                "channels": list(one.measurement.channels),
                "orders": one.measurement.orders.tolist(),
            }
            for place, one in enumerate(objective.comparisons, start=1)
        },
        "coordinates": {
            name: dict(zip(names, map(float, row), strict=True)) for name, row in zip(unknowns.names, rows, strict=True)
        },
    }
    plain: dict[str, Any] = json.loads(json.dumps(purpose))  # lists for tuples, as a file gives them back
    return plain


def _fixed(twin: dict[str, Any]) -> dict[str, Any]:
    """What of a saved twin a search leaves as it is."""
    pump = {name: value for name, value in twin["pump"].items() if name not in ("name", "interfaces", "sources")}
    return {"pump": pump, **{name: twin[name] for name in ("condition", "fault", "topology", "scales")}}


def difference_of(own: Mapping[str, Any], other: Mapping[str, Any]) -> str | None:
    """First entry in which two purposes differ, in words; None where they agree."""
    mine, theirs = dict(_entries(own)), dict(_entries(other))
    for name in (*mine, *theirs):
        one, two = mine.get(name), theirs.get(name)
        near = isinstance(one, float) and isinstance(two, float) and math.isclose(one, two, rel_tol=1e-9)
        if one != two and not near:
            return f"{name} was {_brief(one)} in training and is {_brief(two)} here"
    return None


def _entries(table: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Name and value of each entry, inner tables unrolled; sensors, whose order counts, by their place."""
    if isinstance(table, list) and any(isinstance(one, dict) for one in table):
        table = {str(place): one for place, one in enumerate(table, start=1)}
    if not isinstance(table, Mapping):
        yield name, table
        return
    for key, value in table.items():
        yield from _entries(value, f"{name}.{key}" if name else key)


def _brief(value: Any) -> str:
    if isinstance(value, list):
        listed = [str(one) for one in value]
        return ", ".join(listed) if len(listed) <= 4 else f"{listed[0]}, {listed[1]}, ... {listed[-1]} ({len(listed)})"
    return f"{value:.6g}" if isinstance(value, float) else "absent" if value is None else str(value)
