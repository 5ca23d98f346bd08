"""Results of a calibration and their file."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from swashtwin.calibration.fault_law import FaultLaw
from swashtwin.calibration.fit import ERROR_NAMES, Agreement, Fit, average_agreements
from swashtwin.calibration.posterior import DOUBTFUL_MISFIT, Estimate, Posterior, is_in_doubt
from swashtwin.calibration.search import History
from swashtwin.foundation import (
    ArtifactError,
    InputError,
    MissingFileError,
    as_path,
    data_frame,
    from_table,
    html_table,
    parse_json,
    plural,
    read_text,
    to_table,
    write_text,
)
from swashtwin.physics import PortTiming, Twin
from swashtwin.pump import PARAMETERS, fault_type
from swashtwin.recordings import Manifest

FORMAT = "swashtwin calibration 11"
FORMAT_WITHOUT_MISTAKES = "swashtwin calibration 10"
"""Format of calibrations that name suspected mistakes in their notes only."""
FORMAT_WITHOUT_PORTS = "swashtwin calibration 9"
"""The same of calibrations that took the ports as drawn, too."""
_READABLE_FORMATS = (FORMAT, FORMAT_WITHOUT_MISTAKES, FORMAT_WITHOUT_PORTS)
_DERIVED = ("nominal_agreement", "calibrated_agreement")

# Recordings that the source of a calibrated value names; of more, their number.
_MAX_NAMED_RECORDINGS = 3


@dataclass(frozen=True, eq=False)
class Calibration:
    """A twin calibrated on recordings, and all that is needed to judge it."""

    twin: Twin
    """The calibrated twin."""
    nominal: Twin
    """The nominal twin, before calibration."""
    estimates: tuple[Estimate, ...]
    """The six values, in the order of `pump.PARAMETERS`."""
    posterior: Posterior
    """Posterior of all searched coordinates, with covariances."""
    fits: tuple[Fit, ...]
    """Agreement of both twins with the recordings, one for each operating point."""
    history: History
    """Course of the search."""
    recording_ids: tuple[str, ...]
    """Recordings it was calibrated on. They are training data: windows of `synthesize` name them,
    and no test set may contain them.
    """
    recording_hashes: Manifest
    """Hashes of the content of each of them by id (`Recording.content_hashes`): they identify a
    recording, whatever its file is called.
    """
    excluded_recordings: tuple[tuple[str, str], ...]
    """Id of each recording given but not used, and the reason."""
    misfit: float
    """Root mean square of the lines that the calibrated twin misses, relative to what noise and a
    model error of 5 % explain.
    """
    suspected_mistakes: tuple[str, ...]
    """Mistakes that would explain what the calibrated lines still miss, each as a clause, the
    likeliest first. While one is suspected, no value is called identified.
    """
    notes: tuple[str, ...]
    """Notes that the user should read."""
    method: str
    """Name of the method."""
    settings: Mapping[str, Any]
    """Settings of the method, the band and the seed, as JSON values."""
    simulations: int
    """Number of parameter sets that were simulated."""
    wall_s: float
    """Time taken [s]."""
    version: str
    """Version of swashtwin that made it."""
    origin: str = ""
    """Origin of recordings that are not of a machine, such as the virtual rig; empty if none is
    specified.
    """
    law: FaultLaw | None = None
    """Law of a recess that was identified with it; `None` if no law was searched."""

    def __repr__(self) -> str:
        identified = ", ".join(
            estimate.symbol for estimate in self.estimates if estimate.verdict == "identified"
        )
        return (
            f"<Calibration of {self.nominal.pump.name} ({self.nominal.label}) by {self.method} on "
            f"{plural(len(self.recording_ids), 'recording')}; "
            f"identified: {identified or 'nothing'}>"
        )

    def _repr_html_(self) -> str:
        header = ("value", "calibrated", "90 % interval", "nominal", "unit", "verdict")
        rows = []
        for estimate in self.estimates:
            low, high = estimate.interval
            calibrated = f"{estimate.value:.3g}"
            interval = f"{low:.3g} to {high:.3g}"
            nominal = f"{estimate.nominal:.3g}"
            rows.append(
                (estimate.symbol, calibrated, interval, nominal, estimate.unit, estimate.verdict)
            )
        return html_table(repr(self), header, rows, self.doubt)

    def to_pandas(self) -> Any:
        """Return the estimates as a ``pandas.DataFrame``, one row for each of the six values.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        return data_frame([asdict(estimate) for estimate in self.estimates])

    def estimate(self, name: str) -> Estimate:
        """Return the estimate of the parameter with that name or symbol."""
        return next(
            estimate for estimate in self.estimates if name in (estimate.name, estimate.symbol)
        )

    @property
    def is_in_doubt(self) -> bool:
        """Whether nothing that rests on it, such as a severity, may be called identified: the
        misfit is above 1, a mistake is suspected, or the fit strains a bound or a prior
        (`posterior.is_in_doubt`).
        """
        if self.misfit > DOUBTFUL_MISFIT or self.suspected_mistakes:
            return True
        return is_in_doubt(self.posterior.unknowns, self.posterior.point, self.misfit)

    @property
    def has_improved(self) -> bool:
        """Whether the calibrated twin's lines are nearer to the measured ones than the nominal."""
        return (
            self.calibrated_agreement.spectrum_value_error
            < self.nominal_agreement.spectrum_value_error
        )

    @property
    def doubt(self) -> str:
        """Why windows simulated with the twin are no better than those of the nominal twin; empty
        if nothing is known against it.

        It is a warning: every use of the calibration states it, and none is refused.
        """
        if not self.has_improved:
            return (
                "The calibrated twin's lines are no nearer to the measured ones than those of the "
                "nominal twin. Check speed, pressure, units and the pump's parameters, and "
                "calibrate again."
            )
        if any(estimate.verdict == "identified" for estimate in self.estimates):
            return ""
        warning = (
            "None of the twin's six values is identified, so do not expect its windows to be "
            "better than those of the nominal twin"
        )
        if self.is_in_doubt:
            return (
                f"{warning}. The fit is in doubt: correct what the notes of the calibration name, "
                "and calibrate again."
            )
        return (
            f"{warning}. The recordings do not determine them: swashtwin twin next shows which "
            "further recording would."
        )

    @property
    def n_lines(self) -> int:
        """Number of lines that were compared: channels times orders, over operating points."""
        return sum(fit.spectra.measured.size for fit in self.fits)

    @property
    def n_unknowns(self) -> int:
        """Number of values and constants that were searched."""
        return len(self.posterior.point)

    @property
    def nominal_agreement(self) -> Agreement:
        """Agreement of the nominal twin with the recordings, averaged over operating points."""
        return average_agreements([fit.nominal_agreement for fit in self.fits])

    @property
    def calibrated_agreement(self) -> Agreement:
        """The same of the calibrated twin."""
        return average_agreements([fit.calibrated_agreement for fit in self.fits])

    @property
    def improvement(self) -> dict[str, float]:
        """Share by which each error fell through calibration; negative if it rose."""
        nominal = asdict(self.nominal_agreement)
        calibrated = asdict(self.calibrated_agreement)
        return {name: 1 - calibrated[name] / nominal[name] for name in ERROR_NAMES}

    def to_dict(self) -> dict[str, Any]:
        """Return the calibration as JSON values; `load_calibration` reads them back."""
        table: dict[str, Any] = {"format": FORMAT, **to_table(self)}
        # the kind of a fault is not among its fields
        table["twin"] = twin_to_dict(self.twin)
        table["nominal"] = twin_to_dict(self.nominal)
        for name in _DERIVED:
            table[name] = asdict(getattr(self, name))
        return table

    def save(self, path: Path | str) -> Path:
        """Write the calibration to `path` as JSON; return the path."""
        text = json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
        return write_text(Path(path), text + "\n")

    def interfaces_toml(self) -> str:
        """Return the calibrated values as the ``[interfaces]`` of a pump file, each with its
        source.
        """
        recordings = ", ".join(self.recording_ids[:_MAX_NAMED_RECORDINGS])
        n_more = len(self.recording_ids) - _MAX_NAMED_RECORDINGS
        if n_more > 0:
            recordings += f" and {n_more} more"

        lines = []
        for name, estimate in zip(PARAMETERS, self.estimates, strict=True):
            section, entry = name.split(".")
            if entry == "damping":
                lines += ["", f"[interfaces.{section}]"]
            source = (
                f"calibrated with {self.method} on {recordings}: {estimate.verdict}, standard "
                f"deviation a factor of {math.exp(estimate.log_std):.3g} (swashtwin {self.version})"
            )
            value = f'"{estimate.value:.8g} {estimate.unit}"'
            quoted_source = json.dumps(source, ensure_ascii=False)
            lines.append(f"{entry} = {{ value = {value}, source = {quoted_source} }}")
        return "\n".join(lines[1:]) + "\n"

    def save_interfaces(self, path: Path | str) -> Path:
        """Write `interfaces_toml` to `path`; return the path."""
        return write_text(Path(path), self.interfaces_toml())


def _require_readable(path: Path | str, file_format: object) -> None:
    """Require a format of calibrations that this version reads."""
    if file_format in _READABLE_FORMATS:
        return

    kind = FORMAT.rsplit(" ", 1)[0]
    if isinstance(file_format, str) and not file_format.startswith(kind):
        raise ArtifactError(
            f"{path}: not a calibration, but a file of format {file_format!r}. Specify a file that "
            "swashtwin calibrate wrote."
        )
    raise ArtifactError(
        f"{path}: its format is {file_format!r}, but this version reads {FORMAT!r}. Calibrate "
        "again."
    )


def load_calibration(path: Path | str) -> Calibration:
    """Return a calibration that `Calibration.save` wrote.

    Raises
    ------
    MissingFileError
        There is no such file.
    ArtifactError
        It is damaged, or of another version.
    """
    path = as_path(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: no such calibration.")

    try:
        table = parse_json(read_text(path))
    except (ValueError, RecursionError) as cause:
        raise ArtifactError(
            f"{path}: not a calibration, or damaged: {str(cause)[:300].rstrip('.')}."
        ) from cause

    file_format = table.pop("format", None) if isinstance(table, dict) else None
    _require_readable(path, file_format)
    try:
        if file_format == FORMAT_WITHOUT_PORTS:
            _add_ports_as_drawn(table)
        if file_format != FORMAT:
            table["suspected_mistakes"] = []
        for name in ("twin", "nominal"):
            if name in table:
                table[name] = twin_from_dict(table[name])
        for name in _DERIVED:
            if name not in table:
                raise InputError(f"{name} is missing")
            from_table(table.pop(name), Agreement, name, complete=True)
        return from_table(table, Calibration, complete=True)
    except (KeyError, TypeError, ValueError, RecursionError) as cause:
        reason = str(cause)[:300].rstrip(".")
        raise ArtifactError(
            f"{path}: a calibration that does not fit this swashtwin ({reason}); it was written by "
            f"swashtwin {table.get('version')}, or edited. Calibrate again."
        ) from cause


def _add_ports_as_drawn(table: dict[str, Any]) -> None:
    """Add what `FORMAT_WITHOUT_PORTS` lacks: ports as in the pump file, which were not searched."""
    for name in ("twin", "nominal"):
        table[name]["port_timing"] = to_table(PortTiming())
    table["posterior"]["unknowns"]["nuisances"]["port_timing"] = 0.0


def twin_to_dict(twin: Twin) -> dict[str, Any]:
    """Return everything that makes the twin, the pump included, as JSON values; its fault with its
    kind.
    """
    table: dict[str, Any] = to_table(twin)
    if twin.fault is not None:
        table["fault"] = {"kind": type(twin.fault).__name__, **table["fault"]}
    return table


def twin_from_dict(table: dict[str, Any]) -> Twin:
    """Return a twin that `twin_to_dict` wrote.

    Raises
    ------
    InputError
        Something is missing or of another form.
    """
    if "fault" not in table:
        raise InputError("fault is missing")
    twin = from_table({**table, "fault": None}, Twin, complete=True)
    if table["fault"] is None:
        return twin

    fault = dict(table["fault"])
    if "kind" not in fault:
        raise InputError("fault.kind is missing")
    kind = fault_type(fault.pop("kind"))
    return twin.with_fault(from_table(fault, kind, complete=True))
