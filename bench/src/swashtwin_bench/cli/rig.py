"""Commands on the virtual rig, and the fillers that need no twin: demo, bench rig, bench augment."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli import (
    Index,
    Json,
    Seed,
    Window,
    as_folder,
    note,
    note_done_before,
    progress,
    require_files,
    require_output,
    resumable,
    say,
    table,
    tell,
)
from swashtwin_bench.cli.studies import show_study, typed_command

if TYPE_CHECKING:
    from swashtwin.learning import WindowSet
    from swashtwin_bench import Demo


def demo(
    out: Annotated[
        Path, typer.Option(help="Folder for the rig, the model, the twin and the report.", callback=as_folder)
    ] = Path("swashtwin-demo"),
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Diagnose a fault nobody recorded at this pressure: build a virtual rig, calibrate twins, train, write a page.

    It leaves a model, the twin of a pump and a diagnosis in its folder, runs Case II of the paper, and ends with three
    commands to go on with. A few minutes.
    """
    from swashtwin_bench import QUESTION, answer_of_demo, run_demo

    hint = f"finished recordings and runs in {out} are kept; the same command continues"
    with resumable(hint), progress("demo") as bar:

        def show_activity(activity: str, count: int, total: int) -> None:
            note_done_before(activity, out)
            bar(count, total, activity)

        result = run_demo(out, seed=seed, jobs=2, progress=show_activity, command=typed_command())
    commands = _next_commands(result)

    def show() -> None:
        show_study(result.study)
        say("")
        for text in (QUESTION, *answer_of_demo(result), f"Report: {result.page}", "", "Go on with:"):
            say(text)
        for what, command in commands.items():
            say(f"  {command}    ({what})")

    answer = {
        **result.study.to_dict(), "report": result.page, "model": result.model, "twin": result.twin,
        "question": QUESTION, "demo_answer": answer_of_demo(result), "label": result.label,
        "with_twin": [verdict.to_dict() for verdict in result.with_twin],
        "without_twin": [verdict.to_dict() for verdict in result.without_twin], "next": list(commands.values()),
    }  # fmt: skip
    tell(answer, as_json, show)


def _next_commands(demo: "Demo") -> dict[str, str]:
    """Command lines to go on with, by what they do."""
    out = demo.model.parent
    return {
        "diagnose another recording": _command("diagnose", demo.model, demo.other, "--report", out / "another.html"),
        f"look at the twin of pump {demo.pump}": _command("report", demo.twin, "--out", out / "twin"),
        "train on recordings; name the folder of your own": _command(
            "train", demo.rig, "--budget", "1 min", "--out", out / "own.safetensors"
        ),
    }


def _command(*words: object) -> str:
    """A command line that every shell understands."""
    texts = [word.as_posix() if isinstance(word, Path) else str(word) for word in words]
    return " ".join(["swashtwin", *(f'"{text}"' if " " in text else text for text in texts)])


def rig(
    out: Annotated[Path, typer.Argument(help="New folder for the recordings.")],
    seed: Seed = 0,
    size: Annotated[
        str, typer.Option(help="Number and length of the recordings: tiny, short, small or paper.")
    ] = "small",
    version: Annotated[
        str,
        typer.Option(
            "--rig-version",
            help="1, 2 which shares less with the twin, 3 of another maker, or 1-deep, 2-deep with the paper's recess.",
        ),
    ] = "1",
    sensor_count: Annotated[
        int,
        typer.Option(help="Accelerometers: 3, or 13 as the paper has, where pump 25scy14-1b-13 says; version 1 only."),
    ] = 3,
    as_json: Json = False,
) -> None:
    """Write recordings of a virtual rig, which stands in for a machine, and an index of them."""
    from swashtwin_bench import build_rig

    with resumable("finished recordings are kept; the same command continues"), progress("recording") as bar:
        index_file = build_rig(out, seed=seed, size=size, version=version, sensors=sensor_count, progress=bar)
    result = {"index": index_file, "seed": seed, "size": size, "rig_version": version}
    tell(result, as_json, lambda: say(f"{index_file}\nNext: swashtwin inspect {out}"))


def augment(
    source: Index,
    filler: Annotated[
        str,
        typer.Option(
            help="duplicate, noisy_duplicate, jitter, smote, adasyn, cvae or wgan_gp "
            "(docs/explanation/augmentation.md)."
        ),
    ],
    label: Annotated[str, typer.Option(help="Class of the windows.")],
    count: Annotated[int, typer.Option(help="Number of windows.")],
    out: Annotated[Path, typer.Option(help="File of windows to write, for train --add.")],
    pressure: Annotated[
        str | None,
        typer.Option(help='Absolute discharge pressure of the cell, "15 MPa"; leave it out where none is stated.'),
    ] = None,
    held_out: Annotated[
        Path | None, typer.Option(help="Index of recordings kept from training, to compare the windows with.")
    ] = None,
    window: Window = 2048,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Fill a scarce class, or class and pressure, with windows made from measured ones alone, without any twin.

    The recordings of the index are training data from then on: give train.toml of a split. Where the cell has no window
    the filler uses those of its class at other pressures. docs/explanation/augmentation.md explains the figures of
    fidelity.
    """
    from swashtwin.foundation import DataError, InputError, parse
    from swashtwin.learning import check_disjoint, cut_windows, save_windows
    from swashtwin.recordings import declared_classes, load_recordings
    from swashtwin.synthesis import has_filler, in_cell
    from swashtwin_bench import FILLERS

    if not has_filler(filler):
        raise typer.BadParameter(f"{filler!r} is none of {', '.join(FILLERS)}.", param_hint="--filler")
    require_output(out, inputs=[source, held_out], force=True)
    require_files([held_out])
    pascals = math.nan if pressure is None else parse(pressure, "Pa", name="--pressure")
    train = cut_windows(load_recordings(source), length=window, classes=declared_classes(source))
    if pressure is None and not math.isnan(float(train.discharge_pressure.max(initial=-math.inf))):
        raise InputError('the recordings state their pressures; say which cell is to be filled: --pressure "15 MPa".')
    stated = train.discharge_pressure[train.label == label]
    if pressure is not None and len(stated) and all(map(math.isnan, stated.tolist())):
        raise InputError(
            f"no recording of {label} states its pressure, so none is known to be at {pressure}; leave out --pressure "
            f"or state pressures in {source}."
        )
    cell = in_cell(train, label, pascals)
    compared, role = train.subset(cell), "training windows of the cell"
    if held_out is not None:
        other = cut_windows(load_recordings(held_out), like=train)
        check_disjoint(train, other)
        compared, role = other.subset(in_cell(other, label, pascals)), "held-out windows of the cell"
        if not len(compared):
            raise DataError(f"{held_out} has no window of {label} at that pressure to compare with.")
    elif not cell.any():
        compared, role = train.subset(train.label == label), "training windows of the class at other pressures"
    with progress(f"filling by {filler}"):
        synthetic = FILLERS[filler](train, label=label, pressure=pascals, count=count, seed=seed)
        fidelity = _fidelity(compared, synthetic, seed)
    save_windows(synthetic, out)
    result: dict[str, Any] = {
        "windows": out, "filler": filler, "label": label, "pressure_pa": pascals, "count": len(synthetic),
        "length": synthetic.length, "seed": seed, "measured_in_cell": int(cell.sum()), "compared_with": role,
        "compared_windows": len(compared), "fidelity": fidelity,
    }  # fmt: skip

    def show() -> None:
        say(f"{out}: {len(synthetic)} windows of {label}, beside {cell.sum()} measured ones of the cell")
        say(f"compared with {len(compared)} {role}:")
        table("Distance of the mean spectra", ("channel", "dB"), [*fidelity["spectral_distance_db"].items()])
        auroc = fidelity["discriminative_auroc"]
        say(f"AUROC of telling both apart: {'-' if auroc is None else f'{auroc:.2f}'}; 0.5 is not at all")
        say(f"Next: swashtwin train {source} --add {out} --test-fraction 0 --out model.safetensors")

    if fidelity["discriminative_auroc"] is None and not as_json:
        note("note: the measured windows are of one recording, which anything can be told from; give --held-out.")
    tell(result, as_json, show)


def _fidelity(compared: "WindowSet", synthetic: "WindowSet", seed: int) -> dict[str, Any]:
    from swashtwin.synthesis import discriminative_score, spectral_distance

    distances = dict(zip(synthetic.channels, spectral_distance(compared, synthetic).tolist(), strict=True))
    several = len(set(compared.recording_id.tolist())) > 1 and len(synthetic) > 1
    return {
        "spectral_distance_db": distances,
        "discriminative_auroc": discriminative_score(compared, synthetic, seed=seed) if several else None,
    }
