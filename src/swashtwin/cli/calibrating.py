"""The command that teaches a twin: calibrate."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, progress, say, table, tell
from swashtwin.cli.exits import require_target, resumable
from swashtwin.cli.options import (
    Dimensions,
    FaultDepth,
    FaultLength,
    FaultName,
    FaultWidth,
    Freed,
    FreedName,
    Index,
    Json,
    Pressures,
    PumpName,
    Seed,
    Solver,
    SolverName,
    Speed,
    Step,
    Temperature,
    as_folder,
    condition_of,
    fault_of,
    given,
    nuisances_of,
    solver_of,
)

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration, Calibrator, Estimate, LearningRates, Objective
    from swashtwin.physics import SteadySolver, Twin
    from swashtwin.recordings import Recording


class Method(StrEnum):
    """How the six values are searched."""

    ipinn = "ipinn"
    gauss_newton = "gauss-newton"
    lbfgs = "lbfgs"
    cmaes = "cmaes"
    direct_adam = "direct-adam"


class SpectrumLoss(StrEnum):
    """How IPINN measures the distance of two spectra."""

    linear = "linear"
    weighted = "weighted"
    logarithmic = "logarithmic"


class LineSet(StrEnum):
    """Which lines are compared."""

    piston = "piston"
    shaft = "shaft"


_TAKES = {
    Method.ipinn: {"epochs", "learning_rate", "learning_rates", "improved", "spectrum"},
    Method.direct_adam: {"epochs", "learning_rate", "learning_rates", "starts"},
    Method.gauss_newton: {"starts"},
    Method.lbfgs: {"starts"},
    Method.cmaes: set[str](),
}
"""Options that belong to some methods only."""


def calibrate(
    source: Index,
    speed: Speed,
    pressure: Pressures,
    pump: PumpName = "25scy14-1b",
    temperature: Temperature = None,
    fault: FaultName = "normal",
    length: FaultLength = None,
    width: FaultWidth = None,
    depth: FaultDepth = None,
    dimensions: Dimensions = None,
    specimen: Annotated[str | None, typer.Option(help="Use the recordings of this machine only.")] = None,
    method: Annotated[
        Method, typer.Option(help="ipinn is the paper's; gauss-newton takes a tenth of the time.")
    ] = Method.ipinn,
    improved: Annotated[bool, typer.Option("--improved", help="ipinn as we would set it, not as the paper.")] = False,
    epochs: Annotated[int | None, typer.Option(min=1, help="Epochs of ipinn and direct-adam; 500 by default.")] = None,
    learning_rate: Annotated[float | None, typer.Option(help="Step size of ipinn and direct-adam.")] = None,
    learning_rates: Annotated[
        str | None, typer.Option(help='Try these first and take the best: "0.01,0.001", or "paper" for its four.')
    ] = None,
    spectrum: Annotated[
        SpectrumLoss | None, typer.Option(help="Spectrum loss of ipinn: linear amplitudes are the paper's.")
    ] = None,
    starts: Annotated[int | None, typer.Option(min=1, help="Starts of gauss-newton, lbfgs, direct-adam.")] = None,
    band: Annotated[
        tuple[str, str] | None, typer.Option(help='Frequencies whose lines are compared: "0 Hz" "1 kHz".')
    ] = None,
    lines: Annotated[
        LineSet, typer.Option(help="piston-pass lines, or all shaft orders where one piston differs.")
    ] = LineSet.piston,
    phases: Annotated[bool, typer.Option("--phases", help="Compare the lines' phases too.")] = False,
    nuisances: FreedName = Freed.none,
    prior: Annotated[
        Path | None, typer.Option(help="What is known of such pumps: population.json of calibrate-fleet.")
    ] = None,
    solver: SolverName = Solver.harmonic_balance,
    step: Step = None,
    bounds: Annotated[float | None, typer.Option(help="Search each value within this factor of the nominal.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue a calibration that was interrupted.")] = False,
    out: Annotated[
        Path, typer.Option(help="File to write, .json; the values go beside it as NAME-interfaces.toml.")
    ] = Path("calibration.json"),
    report: Annotated[
        Path | None,
        typer.Option(
            help="Folder for a page with figures, and what the recordings can tell at all.", callback=as_folder
        ),
    ] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Find a twin's six interface values from recordings of its class at its condition, and how far to trust them.

    Several --pressure are fitted together, with one set of values. Calibrating is training: the recordings used must
    not test a classifier later (swashtwin split).
    """  # fmt: skip
    from swashtwin.calibration import load_population
    from swashtwin.foundation import parse
    from swashtwin.physics import Twin
    from swashtwin.pump import load_pump
    from swashtwin.recordings import load_recordings

    require_target(out, ".json")
    own = given(epochs=epochs, learning_rate=learning_rate, spectrum=spectrum and spectrum.value, starts=starts)
    searched = _method(method, improved, own, solver_of(solver, step), learning_rates)
    defect, drawing = fault_of(fault, length, width, depth, dimensions), load_pump(pump)
    job = _Job(
        twins=[Twin(drawing, condition_of(speed, one, temperature), defect) for one in pressure],
        recordings=load_recordings(source).where(specimen=specimen),
        told={
            "bounds": bounds,
            "band": None if band is None else tuple(parse(one, "Hz", name="band") for one in band),
            "lines": lines.value,
            "phases": phases,
            "nuisances": nuisances_of(nuisances),
            "prior": None if prior is None else load_population(prior),
        },
        seed=seed,
        out=out,
    )
    if not resume:
        job.clear()
    tried = None if learning_rates is None else job.tried(searched, _rates(learning_rates))
    found = job.searched(searched if tried is None else tried.method)
    page = None if report is None else job.reported(found, report)
    found.save(out)
    values = found.save_interfaces(out.with_name(f"{out.stem}-interfaces.toml"))
    job.clear()
    kept = ("method", "settings", "estimates", "fit_before", "fit_after", "recording_ids", "recording_hashes")
    facts = found.to_dict()
    result = {"calibration": out, "interfaces": values, **{name: facts[name] for name in (*kept, "left_out", "notes")}}
    result |= {"simulations": found.simulations, "wall_s": found.wall_s, "report": page}
    result["learning_rates"] = tried and {"rates": tried.rates, "weighted_losses": tried.weighted_losses}
    tell(result, as_json, lambda: _show(found, tried, out))


@dataclass(frozen=True)
class _Job:
    """What is calibrated on what."""

    twins: Sequence["Twin"]
    recordings: Sequence["Recording"]
    told: Mapping[str, Any]
    seed: int
    out: Path

    @property
    def checkpoint(self) -> Path:
        """Where a search is kept until it is done."""
        return self.out.with_name(f"{self.out.name}.checkpoint")

    @property
    def study(self) -> Path:
        """Where the learning rates tried are kept until all is done."""
        return self.out.with_name(f"{self.out.name}.rates")

    def clear(self) -> None:
        """Remove what is kept only until all is done."""
        self.checkpoint.unlink(missing_ok=True)
        self.study.unlink(missing_ok=True)

    def objective(self) -> "Objective":
        """The objective of the search."""
        from swashtwin.calibration import build_objective

        return build_objective(self.twins, self.recordings, **self.told)

    def tried(self, method: Any, rates: Sequence[float]) -> "LearningRates":
        """What each learning rate leads to."""
        from swashtwin.calibration import choose_learning_rate

        hint = f"{self.study} holds the rates tried so far: the same command with --resume goes on"
        self.out.parent.mkdir(parents=True, exist_ok=True)
        with resumable(hint), progress("trying learning rates") as bar:
            return choose_learning_rate(
                self.objective(),
                method,
                rates,
                seed=self.seed,
                storage=self.study,
                progress=lambda done, total, loss: bar(done, total, f"trying learning rates, loss {loss:.4g}"),
            )

    def searched(self, method: "Calibrator") -> "Calibration":
        """What the search finds; one in epochs goes on where an interrupted one was."""
        from swashtwin.calibration import ResumableCalibrator, calibrate

        hint = "it keeps no checkpoint: the same command again ends at the same result"
        kept: dict[str, Any] = {}
        if isinstance(method, ResumableCalibrator):
            kept = {"checkpoint": self.checkpoint, "resume": True}
            hint = f"{self.checkpoint} holds every 25th epoch: the same command with --resume goes on"
        with resumable(hint), progress("calibrating") as bar:
            return calibrate(
                self.twins,
                self.recordings,
                method=method,
                seed=self.seed,
                progress=lambda done, total, loss: bar(done, total, f"calibrating, loss {loss:.4g}"),
                **self.told,
                **kept,
            )

    def reported(self, found: "Calibration", folder: Path) -> Path:
        """Page of the calibration and of what the recordings can tell."""
        from swashtwin.calibration import identifiability
        from swashtwin.report import write_report

        return write_report(found, identifiability(self.objective(), found.posterior.point), folder=folder)


def _method(
    name: Method, improved: bool, own: dict[str, Any], solver: "SteadySolver", learning_rates: str | None
) -> "Calibrator":
    """The method with its `own` settings; one that it does not have is a wrong command line."""
    from swashtwin.calibration import CMAES, IPINN, LBFGS, DirectAdam, GaussNewton

    for setting in (*own, *given(improved=improved or None, learning_rates=learning_rates)):
        takers = [one.value for one, takes in _TAKES.items() if setting in takes]
        if name.value not in takers:
            hint = f"--{setting.replace('_', '-')}"
            raise typer.BadParameter(f"belongs to --method {' or '.join(takers)}.", param_hint=hint)
    if learning_rates is not None and "learning_rate" in own:
        raise typer.BadParameter("is what --learning-rates is to find; give one of them.", param_hint="--learning-rate")
    if name is Method.ipinn:
        return (IPINN.improved if improved else IPINN)(solver=solver, **own)
    kinds: dict[Method, Any] = {
        Method.gauss_newton: GaussNewton,
        Method.lbfgs: LBFGS,
        Method.cmaes: CMAES,
        Method.direct_adam: DirectAdam,
    }
    made: Calibrator = kinds[name](solver=solver, **own)
    return made


def _rates(text: str) -> Sequence[float]:
    from swashtwin.calibration import PAPER_RATES

    if text == "paper":
        return PAPER_RATES
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        wanted = f'{text!r} must be numbers with commas between them, or "paper".'
        raise typer.BadParameter(wanted, param_hint="--learning-rates") from None


def _interval(one: "Estimate") -> str:
    """The interval; an end that only the bound sets is said to be none."""
    low, high = (f"{end:.3g}" for end in one.interval)
    open_below, open_above = one.open_sides
    if open_below and open_above:
        return "no limits"
    return f"at most {high}" if open_below else f"at least {low}" if open_above else f"{low} ... {high}"


def _show(found: "Calibration", tried: "LearningRates | None", out: Path) -> None:
    if tried is not None:
        losses = list(zip(tried.rates, tried.weighted_losses, strict=True))
        table(f"Learning rates; {tried.best:g} is taken", ("rate", "loss over the expected"), losses)
    rows = [
        (one.letter, one.name, one.nominal, one.value, _interval(one), one.unit,
         one.verdict)
        for one in found.estimates
    ]  # fmt: skip
    header = ("", "parameter", "nominal", "calibrated", "90 % interval", "unit", "verdict")
    table(f"{found.method} on {len(found.recording_ids)} recordings", header, rows)
    before, after = asdict(found.fit_before), asdict(found.fit_after)
    table("Against the measurement", ("figure", "nominal", "calibrated"), [(n, before[n], after[n]) for n in before])
    for text in found.notes:
        note(f"note: {text}")
    say(str(out))
