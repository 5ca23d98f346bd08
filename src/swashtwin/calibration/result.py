"""Results of a calibration: a twin, the law of a recess where one was searched, and their file."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from swashtwin.calibration.fit import ERRORS, Agreement, Fit, average_agreements
from swashtwin.calibration.posterior import LARGE, Estimate, Posterior, is_in_doubt
from swashtwin.calibration.search import History
from swashtwin.calibration.severity.dimensions import FaultSpace, get_severity_search
from swashtwin.foundation import (
    ArtifactError,
    MissingFileError,
    as_path,
    from_table,
    parse_json,
    plural,
    read_text,
    to_table,
    write_text,
)
from swashtwin.physics import Twin
from swashtwin.pump import PARAMETERS, Fault, SwashPlateDefect, fault_type
from swashtwin.recordings import Manifest


@dataclass(frozen=True)
class FaultLaw:
    """What recordings of a recess tell of its law, for the pump that was calibrated beside it."""

    fault: SwashPlateDefect
    """The recess that explains them best."""
    estimates: tuple[Estimate, ...]
    """Its depth, corner and further unknowns; the last is how the noise between the lines rises."""
    evidence: Mapping[str, float]
    """Logarithm of each law's evidence less that of the likeliest, by contact and edge (Laplace's
    approximation).
    """
    misfit: float
    """Root mean square of the lines' differences over what was expected; above 1 the intervals are
    widened by it.
    """
    recording_ids: tuple[str, ...]
    """Recordings of the fault."""

    @property
    def floor(self) -> float:
        """Factor on the noise between the lines at the depth that was recorded (`noise_factor_of`)."""
        return self.estimates[-1].value

    @property
    def corner(self) -> Estimate:
        """Estimate of the corner [Hz]."""
        return next(item for item in self.estimates if item.symbol == "corner")

    def of(self, fault: Fault | None, corner_shift: float = 0.0) -> Fault | None:
        """`fault` under this law, where it is a recess that states no corner; any other fault as it
        is.

        Parameters
        ----------
        corner_shift : of ln corner, in standard deviations of its estimate.
        """
        if not isinstance(fault, SwashPlateDefect) or fault.corner:
            return fault
        names = ("contact", "edge", "fall", "gain", "leakage")
        drawn = self.corner.value * math.exp(self.corner.log_std * corner_shift)
        return replace(fault, corner=drawn, **{name: getattr(self.fault, name) for name in names})

    def space(self, space: FaultSpace) -> FaultSpace:
        """`space` of a severity under this law, its corner searched as far as it is uncertain."""
        lawful = self.of(space.reference)
        if lawful is None or lawful == space.reference:
            return space
        (corner,) = (
            item for item in get_severity_search(lawful).dimensions if item.name == "corner"
        )
        return FaultSpace(lawful, (*space.free, replace(corner, deviation=self.corner.log_std)))

    def noise_factor_of(self, fault: Fault | None) -> float:
        """Factor on the noise with a recess of any depth, of which its logarithm is a multiple; 1
        without one.

        The recess that was recorded has the depth found, or where the recordings do not tell it,
        the one stated.
        """
        if not isinstance(fault, SwashPlateDefect):
            return 1.0
        depth = self.estimates[0]
        recorded = depth.value if depth.is_constrained else depth.nominal
        return float(self.floor ** (fault.depth / recorded))


FORMAT = "swashtwin calibration 9"


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
    """Recordings it was calibrated on. They are training data: windows of `synthesize` name them,
    and no test set may hold them.
    """
    recording_hashes: Manifest
    """Hashes of the content of each of them by id (`Recording.content_hashes`): what was calibrated
    on, whatever a file is called.
    """
    excluded_recordings: tuple[tuple[str, str], ...]
    """Id of each recording given but not used, and why."""
    misfit: float
    """Root mean square of the lines that the calibrated twin misses, in what noise and a model
    error of 5 % explain.
    """
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
    """Where the recordings come from that are of no machine, such as the virtual rig; empty where
    none states it.
    """
    law: FaultLaw | None = None
    """Law of a recess that was identified beside it; None where none was searched."""

    def __repr__(self) -> str:
        identified = ", ".join(
            estimate.symbol for estimate in self.estimates if estimate.verdict == "identified"
        )
        return (
            f"<Calibration of {self.nominal.pump.name} ({self.nominal.label}) by {self.method} on "
            f"{plural(len(self.recording_ids), 'recording')}; identified: {identified or 'nothing'}>"
        )

    def estimate(self, name: str) -> Estimate:
        """Estimate of the parameter with that name or letter."""
        return next(
            estimate for estimate in self.estimates if name in (estimate.name, estimate.symbol)
        )

    @property
    def is_in_doubt(self) -> bool:
        """Whether nothing that rests on it, such as a severity, may be called identified: where the
        misfit is above 1, or the fit strains a bound or a prior (`posterior.is_in_doubt`).
        """
        return self.misfit > LARGE or is_in_doubt(
            self.posterior.unknowns, self.posterior.point, self.misfit
        )

    @property
    def nominal_agreement(self) -> Agreement:
        """Agreement of the nominal twin with the recordings, averaged over the conditions."""
        return average_agreements([fit.before for fit in self.fits])

    @property
    def calibrated_agreement(self) -> Agreement:
        """The same of the calibrated twin."""
        return average_agreements([fit.after for fit in self.fits])

    @property
    def improvement(self) -> dict[str, float]:
        """By what share each error of `nominal_agreement` fell; negative where it rose."""
        before, after = asdict(self.nominal_agreement), asdict(self.calibrated_agreement)
        return {name: 1 - after[name] / before[name] for name in ERRORS}

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it; `load_calibration` reads it back."""
        twins = {"twin": twin_to_dict(self.twin), "nominal": twin_to_dict(self.nominal)}
        means = {
            "nominal_agreement": asdict(self.nominal_agreement),
            "calibrated_agreement": asdict(self.calibrated_agreement),
        }
        return {"format": FORMAT, **to_table(self), **twins, **means}

    def save(self, path: Path | str) -> Path:
        """`path`, after the calibration was written to it as JSON."""
        return write_text(
            Path(path),
            json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n",
        )

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
            lines.append(
                f'{entry} = {{ value = "{estimate.value:.8g} {estimate.unit}", source = {quoted} }}'
            )
        return "\n".join(lines[1:]) + "\n"

    def save_interfaces(self, path: Path | str) -> Path:
        """`path`, after `interfaces_toml` was written to it."""
        return write_text(Path(path), self.interfaces_toml())


def load_calibration(path: Path | str) -> Calibration:
    """Calibration that `Calibration.save` wrote.

    Raises
    ------
    MissingFileError
        No such file.
    ArtifactError
        It is damaged, or of another version.
    """
    path = as_path(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: no such calibration.")
    try:
        table = parse_json(read_text(path))
        saved = table["format"] if isinstance(table, dict) else None
        if saved == FORMAT:
            twins = {name: twin_from_dict(table.pop(name)) for name in ("twin", "nominal")}
            return from_table({**table, **twins}, Calibration)
    except (KeyError, TypeError, ValueError, RecursionError) as cause:
        raise ArtifactError(
            f"{path}: not a calibration, or a damaged one: {str(cause)[:300].rstrip('.')}."
        ) from cause
    raise ArtifactError(
        f"{path}: its format is {saved!r}; this version reads {FORMAT!r}: calibrate again."
    )


def twin_to_dict(twin: Twin) -> dict[str, Any]:
    """Everything that makes the twin, the pump included, as JSON can hold it; its fault with its
    kind.
    """
    table: dict[str, Any] = to_table(twin)
    if twin.fault is not None:
        table["fault"] = {"kind": type(twin.fault).__name__, **table["fault"]}
    return table


def twin_from_dict(table: dict[str, Any]) -> Twin:
    """Twin that `twin_to_dict` wrote.

    Raises
    ------
    InputError
        Something is missing or of another form.
    """
    fault = table["fault"]
    twin = from_table({**table, "fault": None}, Twin)
    return twin if fault is None else twin.with_fault(from_table(fault, fault_type(fault["kind"])))
