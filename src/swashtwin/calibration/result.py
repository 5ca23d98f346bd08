"""Result of a calibration, and its file."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.calibration.methods.search import History
from swashtwin.calibration.objective.agreement import ERRORS, Agreement, Fit, Spectra, Waveforms, mean_agreement
from swashtwin.calibration.twin_table import twin_from_dict, twin_to_dict
from swashtwin.calibration.uncertainty.posterior import Estimate, Posterior
from swashtwin.foundation import ArtifactError, MissingFileError, parse_json, plural, read_text, write_text
from swashtwin.physics import Twin
from swashtwin.pump import PARAMETERS, OperatingCondition
from swashtwin.recordings import Manifest, join_manifests

FORMAT = "swashtwin calibration 6"


@dataclass(frozen=True, eq=False)
class Calibration:
    """A twin calibrated on recordings, and all that is needed to judge it."""

    twin: Twin
    """The calibrated twin."""
    nominal: Twin
    """The twin before."""
    estimates: tuple[Estimate, ...]
    """The six values, in the order of `pump.PARAMETERS`."""
    posterior: Posterior
    """Posterior of all searched coordinates, with covariances."""
    fits: tuple[Fit, ...]
    """Agreement of both twins with the recordings, one for each condition."""
    history: History
    """How the search went."""
    recording_ids: tuple[str, ...]
    """Recordings it was calibrated on. They are training data: windows of `synthesize` name them, and no test set may
    hold them."""
    recording_hashes: Manifest
    """Hashes of the content of each of them by id (`Recording.content_hashes`): what was calibrated on, whatever a file
    is called."""
    left_out: tuple[tuple[str, str], ...]
    """Id of each recording given but not used, and why."""
    notes: tuple[str, ...]
    """What the user should look at, in words."""
    method: str
    """Name of the method."""
    settings: Mapping[str, Any]
    """Its settings, the band and the seed, as JSON can hold them."""
    simulations: int
    """How many parameter sets were simulated."""
    wall_s: float
    """How long it took [s]."""
    version: str
    """Version of swashtwin that made it."""
    origin: str = ""
    """Where the recordings come from that are of no machine, such as the virtual rig; empty where none states it."""

    def __repr__(self) -> str:
        identified = ", ".join(estimate.letter for estimate in self.estimates if estimate.verdict == "identified")
        return (
            f"<Calibration of {self.nominal.pump.name} ({self.nominal.label}) by {self.method} on "
            f"{plural(len(self.recording_ids), 'recording')}; identified: {identified or 'nothing'}>"
        )

    def estimate(self, name: str) -> Estimate:
        """Estimate of the parameter with that name or letter."""
        return next(estimate for estimate in self.estimates if name in (estimate.name, estimate.letter))

    @property
    def fit_before(self) -> Agreement:
        """Agreement of the nominal twin with the recordings, averaged over the conditions."""
        return mean_agreement([fit.before for fit in self.fits])

    @property
    def fit_after(self) -> Agreement:
        """The same of the calibrated twin."""
        return mean_agreement([fit.after for fit in self.fits])

    @property
    def improvement(self) -> dict[str, float]:
        """By what share each error of `fit_before` fell; negative where it rose."""
        before, after = asdict(self.fit_before), asdict(self.fit_after)
        return {name: 1 - after[name] / before[name] for name in ERRORS}

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it; `load_calibration` reads it back."""
        return {
            "format": FORMAT,
            "version": self.version,
            "method": self.method,
            "settings": dict(self.settings),
            "twin": twin_to_dict(self.twin),
            "nominal": twin_to_dict(self.nominal),
            "estimates": [asdict(estimate) for estimate in self.estimates],
            "posterior": self.posterior.to_dict(),
            "fit_before": asdict(self.fit_before),
            "fit_after": asdict(self.fit_after),
            "fits": [_fit(fit) for fit in self.fits],
            "history": _arrays(self.history),
            "recording_ids": list(self.recording_ids),
            "recording_hashes": dict(self.recording_hashes),
            "origin": self.origin,
            "left_out": [list(pair) for pair in self.left_out],
            "notes": list(self.notes),
            "simulations": self.simulations,
            "wall_s": self.wall_s,
        }

    def save(self, path: Path | str) -> Path:
        """`path`, after the calibration was written to it as JSON."""
        return write_text(Path(path), json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n")

    def interfaces_toml(self) -> str:
        """The calibrated values as the ``[interfaces]`` of a pump file, each with its source."""
        recordings = ", ".join(self.recording_ids[:3])
        more = f" and {len(self.recording_ids) - 3} more" if len(self.recording_ids) > 3 else ""
        lines = []
        for index, name in enumerate(PARAMETERS):
            section, entry = name.split(".")
            estimate = self.estimates[index]
            if entry == "damping":
                lines += ["", f"[interfaces.{section}]"]
            width = math.exp(estimate.log_std)
            source = (
                f"calibrated with {self.method} on {recordings}{more}: {estimate.verdict}, "
                f"standard deviation a factor of {width:.3g} (swashtwin {self.version})"
            )
            quoted = json.dumps(source, ensure_ascii=False)
            lines.append(f'{entry} = {{ value = "{estimate.value:.8g} {estimate.unit}", source = {quoted} }}')
        return "\n".join(lines[1:]) + "\n"

    def save_interfaces(self, path: Path | str) -> Path:
        """`path`, after `interfaces_toml` was written to it."""
        return write_text(Path(path), self.interfaces_toml())


def _fit(fit: Fit) -> dict[str, Any]:
    figures = {name: asdict(getattr(fit, name)) for name in ("condition", "before", "after")}
    return {
        "recording_ids": list(fit.recording_ids),
        **figures,
        "spectra": _arrays(fit.spectra),
        "waveforms": _arrays(fit.waveforms),
        "duration": fit.duration,
    }


def _arrays(record: Any) -> dict[str, Any]:
    items = vars(record).items()
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in items}


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
        table = parse_json(read_text(path))
        if (saved := table["format"]) == FORMAT:
            return _calibration_from(table)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, ArithmeticError, RecursionError) as cause:
        raise ArtifactError(f"{path}: not a calibration, or a damaged one: {str(cause)[:300]}.") from cause
    raise ArtifactError(f"{path}: its format is {saved!r}; this version reads {FORMAT!r}: calibrate again.")


def _calibration_from(table: dict[str, Any]) -> Calibration:
    history = {**table["history"]}
    best = int(history.pop("best"))
    return Calibration(
        twin=twin_from_dict(table["twin"]),
        nominal=twin_from_dict(table["nominal"]),
        estimates=tuple(_estimate_from(entry) for entry in table["estimates"]),
        posterior=Posterior.from_dict(table["posterior"]),
        fits=tuple(_fit_from(entry) for entry in table["fits"]),
        history=History(best=best, **{name: np.array(value, dtype=float) for name, value in history.items()}),
        recording_ids=tuple(table["recording_ids"]),
        recording_hashes=join_manifests([table["recording_hashes"]]),
        left_out=tuple((name, reason) for name, reason in table["left_out"]),
        notes=tuple(table["notes"]),
        method=table["method"],
        settings=table["settings"],
        simulations=table["simulations"],
        wall_s=table["wall_s"],
        version=table["version"],
        origin=str(table.get("origin", "")),  # calibrations saved before they kept it have none
    )


def _fit_from(table: dict[str, Any]) -> Fit:
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
        duration=table.get("duration"),  # calibrations saved before recordings were planned have none
    )


def _estimate_from(table: dict[str, Any]) -> Estimate:
    pairs = {name: tuple(table[name]) for name in ("interval", "bounds")}
    return Estimate(**{**table, **pairs})
