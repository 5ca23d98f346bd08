"""The pump prior: swashtwin twin prior and model adapt."""

from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli.console import note, progress, say, tell
from swashtwin.cli.exits import resumable
from swashtwin.cli.options import Index, Json, PumpName, Seed
from swashtwin.cli.outputs import Force, artifact_marks, require_output
from swashtwin.foundation import plural

_FEW = 200
"""Virtual pumps for which no further processes are worth their start."""

_PRIOR = artifact_marks("prior classifier")


def prior(
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("prior.safetensors"),
    pump: PumpName = "25scy14-1b",
    count: Annotated[int, typer.Option(min=10, help="Virtual pumps; 30,000 take about 20 minutes of a core.")] = 10_000,
    speed: Annotated[str | None, typer.Option(help='Speeds of the pumps, such as "800 rpm to 1200 rpm".')] = None,
    pressure: Annotated[str | None, typer.Option(help='Their discharge pressures, such as "4 MPa to 17 MPa".')] = None,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Simulate virtual pumps of a design with every fault, and train on them what model adapt adapts to a machine."""
    from swashtwin.diagnosis import fit_prior
    from swashtwin.pump import load_pump
    from swashtwin.synthesis import PumpPrior, simulate_changes

    require_output(out, suffixes=[".safetensors"], inputs=[Path(pump)], own=_PRIOR, force=force)
    drawing = PumpPrior(
        pump=load_pump(pump),
        speed=_range(speed, "rad/s", "--speed") or PumpPrior.speed,
        pressure=_range(pressure, "Pa", "--pressure") or PumpPrior.pressure,
    )
    with resumable("nothing is half-written"), progress("simulating virtual pumps") as bar:
        changes = simulate_changes(drawing, count, seed=seed, jobs=-1 if count > _FEW else 1, progress=bar)
    n_pumps = len(set(changes.pump.tolist()))
    model = fit_prior(
        changes.bands,
        changes.change,
        changes.label,
        pump=drawing.pump,
        speed=drawing.speed,
        pressure=drawing.pressure,
        n_pumps=n_pumps,
        seed=seed,
    )
    model.save(out)

    def show() -> None:
        say(f"{out}: {model!r}")
        if n_pumps < count:
            note(f"note: {plural(count - n_pumps, 'pump')} had chamber pressures that do not converge.")
        say(f"Next: swashtwin model adapt {out} HEALTHY")

    result = {"model": out, "pump": model.pump, "pumps": n_pumps, "classes": model.classes, "seed": seed}
    tell(result, as_json, show)


def _range(text: str | None, unit: str, option: str) -> tuple[float, float] | None:
    """Two quantities with "to" between them."""
    from swashtwin.foundation import parse

    if text is None:
        return None
    ends = [part.strip() for part in text.split(" to ")]
    if len(ends) != 2:
        raise typer.BadParameter(f'{text!r} is no range; write two quantities: "A to B".', param_hint=option)
    return parse(ends[0], unit, name=option), parse(ends[1], unit, name=option)


def adapt(
    design: Annotated[str, typer.Argument(metavar="PRIOR", help="25scy14-1b, or a prior's file (twin prior).")],
    source: Index,
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("pump.safetensors"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Adapt a pump prior to a machine, from healthy recordings alone; measured faults in the index teach it further."""
    from swashtwin.diagnosis import PriorClassifier
    from swashtwin.recordings import load_recordings

    require_output(out, suffixes=[".safetensors"], inputs=[Path(design), source], own=_PRIOR, force=force)
    shipped, recordings = PriorClassifier.load(design), load_recordings(source)
    unlabeled = sum(recording.label is None for recording in recordings)
    with progress("measuring levels"):
        model = shipped.fit(recordings)
    model.save(out)
    result = {
        "model": out, "kind": "prior classifier", "prior": design, "pump": model.pump, "classes": model.classes,
        "healthy": len(model.specimen), "faults": dict(model.taught), "recordings": sorted(model.manifest),
    }  # fmt: skip

    def show() -> None:
        say(f"{out}: {model!r}")
        if unlabeled:
            note(
                f"note: {plural(unlabeled, 'recording')} without a class counted as healthy; label or leave out faults."
            )
        note(f"note: its faults were simulated for {model.pump}; on another design its answers mean nothing.")
        say(f"Next: swashtwin diagnose {out} FILE")

    tell(result, as_json, show)
