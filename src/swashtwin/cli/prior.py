"""The pump prior: swashtwin twin prior and model adapt."""

from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli.console import note, progress, say, tell
from swashtwin.cli.exits import resumable
from swashtwin.cli.options import Index, Json, PumpName, Seed
from swashtwin.cli.outputs import Force, artifact_marks, require_output
from swashtwin.foundation import InputError, plural

_FEW = 200
"""Virtual pumps for which no further processes are worth their start."""

_PRIOR = artifact_marks("prior classifier")


def prior(
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("prior.safetensors"),
    pump: PumpName = "25scy14-1b",
    count: Annotated[int, typer.Option(min=10, help="Virtual pumps; 2,000 take about 4 minutes of a core.")] = 2_000,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Simulate virtual pumps of a design with every fault, and train on them what model adapt adapts to a machine."""
    from swashtwin.diagnosis import make_prior
    from swashtwin.pump import load_pump
    from swashtwin.synthesis import PumpPrior, operating_range, simulate_changes

    require_output(out, suffixes=[".safetensors"], inputs=[Path(pump)], own=_PRIOR, force=force)
    drawing = PumpPrior(pump=load_pump(pump))
    speed, pressure = operating_range(drawing.pump, drawing)
    with resumable("nothing is half-written"), progress("simulating virtual pumps") as bar:
        changes = simulate_changes(drawing, count, seed=seed, jobs=-1 if count > _FEW else 1, progress=bar)
    n_pumps = len(changes.drawn)
    model = make_prior(
        changes.change,
        changes.label,
        changes.pump,
        changes.scatter,
        changes.drawn,
        pump=drawing.pump,
        speed=speed,
        pressure=pressure,
    )
    model.save(out)

    def show() -> None:
        say(f"{out}: {model!r}")
        if n_pumps < count:
            note(f"note: {plural(count - n_pumps, 'pump')} had chamber pressures that do not converge.")
        say(f"Next: swashtwin model adapt {out} HEALTHY")

    result = {"model": out, "pump": model.pump, "pumps": n_pumps, "classes": model.classes, "seed": seed}
    tell(result, as_json, show)


def adapt(
    design: Annotated[str, typer.Argument(metavar="PRIOR", help="25scy14-1b, or a prior's file (twin prior).")],
    source: Index,
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("pump.safetensors"),
    pistons: Annotated[
        int | None, typer.Option(min=5, help="Pistons of the machine where it is of another design than the prior's.")
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Adapt a pump prior to a machine, from healthy recordings alone; measured faults in the index teach it further."""
    from swashtwin.diagnosis import PriorClassifier
    from swashtwin.recordings import declared_faults, load_recordings

    require_output(out, suffixes=[".safetensors"], inputs=[Path(design), source], own=_PRIOR, force=force)
    if Path(design).is_dir() or Path(design).suffix == ".toml":
        raise InputError(f"{design} holds recordings; the prior stands first: swashtwin model adapt PRIOR {design}")
    shipped, recordings = PriorClassifier.load(design), load_recordings(source)
    unlabeled = sum(recording.label is None for recording in recordings)
    with progress("measuring levels"):
        model = shipped.fit(recordings, pistons=pistons, fault_of=declared_faults(source))
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
        if pistons is None:
            note(f"note: its faults were simulated for {model.pump}; of a pump of another design name the --pistons.")
        say(f"Next: swashtwin diagnose {out} FILE")

    tell(result, as_json, show)
