"""Choice of a learning rate on the paper's grid."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from swashtwin.calibration.methods.gradient import DirectAdam
from swashtwin.calibration.methods.ipinn import IPINN
from swashtwin.calibration.methods.search import Progress, load_extra
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.foundation import DataError, InputError

PAPER_RATES = (0.1, 0.01, 0.001, 0.0001)
"""Learning rates among which the paper chose."""


@dataclass(frozen=True)
class LearningRates:
    """Result of each learning rate."""

    method: IPINN | DirectAdam
    """The method, with the best rate."""
    rates: tuple[float, ...]
    """Learning rates tried."""
    weighted_losses: tuple[float, ...]
    """`Objective.weighted_loss` at the result of each, whatever the method minimizes."""

    @property
    def best(self) -> float:
        """The rate of least loss."""
        return self.rates[int(np.argmin(self.weighted_losses))]


def choose_learning_rate(
    objective: Objective,
    method: IPINN | DirectAdam | None = None,
    rates: Sequence[float] = PAPER_RATES,
    *,
    seed: int = 0,
    storage: Path | str | None = None,
    progress: Progress | None = None,
) -> LearningRates:
    """The learning rate with which `method` comes nearest to the measurement, and what the others led to.

    Needs the extra ``search``, whose Optuna keeps the study.

    Parameters
    ----------
    method : whose rate is chosen; `IPINN` by default, as in the paper.
    storage : file (SQLite) in which the study is stored, for ``optuna-dashboard`` and to continue after an interrupt; a
        study of other settings, recordings or seed in the same file is left alone. It is not stored by default.
    progress : called with (rates done, rates in all, weighted loss of the last).

    Raises
    ------
    MissingExtraError
        Optuna is not installed.
    InputError
        No rate, or one outside 0...1.
    DataError
        `storage` is another file's, or in no folder.
    """
    if not rates or not all(0 < rate < 1 for rate in rates):
        raise InputError(f"rates ({', '.join(f'{rate:g}' for rate in rates)}) must each lie within 0...1.")
    method = IPINN() if method is None else method
    optuna = load_extra("optuna")
    loudness = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        losses = _try_rates(optuna, objective, method, rates, seed, storage, progress)
    finally:
        optuna.logging.set_verbosity(loudness)
    weighted_losses = tuple(losses[rate] for rate in rates)
    return LearningRates(
        replace(method, learning_rate=rates[int(np.argmin(weighted_losses))]), tuple(rates), weighted_losses
    )


def _try_rates(
    optuna: Any,
    objective: Objective,
    method: IPINN | DirectAdam,
    rates: Sequence[float],
    seed: int,
    storage: Path | str | None,
    progress: Progress | None,
) -> dict[float, float]:
    """Weighted loss by rate; only rates that the study does not hold yet are tried."""
    study = _study(optuna, f"learning rate {_fingerprint(objective, method, seed)}", storage)

    def weighted_loss(trial: Any) -> float:
        rate = trial.suggest_float("learning_rate", 0.0, 1.0)
        try:
            search = replace(method, learning_rate=rate).search(objective, seed=seed)
        except InputError:  # a rate at which the loss is no number any more
            return float("inf")
        with torch.no_grad():
            return float(objective.weighted_loss(torch.as_tensor(search.point)))

    def report(study: Any, trial: Any) -> None:
        if progress is not None:
            progress(len(_losses(study)), len(rates), trial.value)

    while missing := [rate for rate in rates if rate not in _losses(study)]:
        study.sampler = optuna.samplers.GridSampler({"learning_rate": missing}, seed=0)
        study.optimize(weighted_loss, n_trials=len(missing), callbacks=[report])
    return _losses(study)


def _study(optuna: Any, name: str, storage: Path | str | None) -> Any:
    try:
        address = None if storage is None else f"sqlite:///{Path(storage)}"
        return optuna.create_study(study_name=name, storage=address, load_if_exists=True)
    except (optuna.exceptions.OptunaError, load_extra("sqlalchemy").exc.SQLAlchemyError) as cause:
        reason = str(cause).splitlines()[0]
        raise DataError(f"{storage}: no study can be stored there ({reason}); name a new file.") from cause


def _losses(study: Any) -> dict[float, float]:
    """Weighted loss by rate of each finished trial; one that was interrupted is none."""
    return {trial.params["learning_rate"]: trial.value for trial in study.trials if trial.value is not None}


def _fingerprint(objective: Objective, method: IPINN | DirectAdam, seed: int) -> str:
    """Hash of all inputs of the search."""
    job = (replace(method, learning_rate=0.5), seed, objective.fingerprint())
    return hashlib.sha256(repr(job).encode()).hexdigest()[:12]
