"""Saved calibrations, read back."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.calibration.archive import twin_from_dict
from swashtwin.calibration.methods.search import History
from swashtwin.calibration.objective.agreement import Agreement, Fit, Spectra, Waveforms
from swashtwin.calibration.result import FORMAT, Calibration
from swashtwin.calibration.uncertainty.identifiability_report import Estimate
from swashtwin.calibration.uncertainty.posterior import Posterior
from swashtwin.foundation import ArtifactError, MissingFileError
from swashtwin.pump import OperatingCondition


def load_calibration(path: Path | str) -> Calibration:
    """Calibration that `Calibration.save` wrote.

    Raises
    ------
    MissingFileError
        No such file.
    ArtifactError
        It is damaged, or of another version.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: no such calibration.")
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        if table["format"] != FORMAT:
            raise ArtifactError(f"its format is {table['format']!r}; this version reads {FORMAT!r}: calibrate again")
        return _calibration(table)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as cause:
        raise ArtifactError(f"{path}: not a calibration, or a damaged one: {cause!s}.") from cause


def _calibration(table: dict[str, Any]) -> Calibration:
    history = {**table["history"]}
    best = int(history.pop("best"))
    return Calibration(
        twin=twin_from_dict(table["twin"]),
        nominal=twin_from_dict(table["nominal"]),
        estimates=tuple(_estimate(entry) for entry in table["estimates"]),
        posterior=Posterior.from_dict(table["posterior"]),
        fits=tuple(_fit(entry) for entry in table["fits"]),
        history=History(best=best, **{name: np.array(value, dtype=float) for name, value in history.items()}),
        recording_ids=tuple(table["recording_ids"]),
        recording_hashes=dict(table["recording_hashes"]),
        left_out=tuple((name, reason) for name, reason in table["left_out"]),
        notes=tuple(table["notes"]),
        method=table["method"],
        settings=table["settings"],
        simulations=table["simulations"],
        wall_s=table["wall_s"],
        version=table["version"],
    )


def _fit(table: dict[str, Any]) -> Fit:
    spectra = table["spectra"]
    return Fit(
        condition=OperatingCondition(**table["condition"]),
        recording_ids=tuple(table["recording_ids"]),
        before=Agreement(**table["before"]),
        after=Agreement(**table["after"]),
        spectra=Spectra(
            channels=tuple(spectra["channels"]),
            orders=np.array(spectra["orders"], dtype=int),
            **{n: np.array(v, dtype=float) for n, v in spectra.items() if n not in ("channels", "orders")},
        ),
        waveforms=Waveforms(**{name: np.array(value, dtype=float) for name, value in table["waveforms"].items()}),
    )


def _estimate(table: dict[str, Any]) -> Estimate:
    pairs = {name: tuple(table[name]) for name in ("interval", "bounds")}
    return Estimate(**{**table, **pairs})
