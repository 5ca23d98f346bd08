"""The command that fills a scarce cell from measured windows alone: augment."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, say, table, tell
from swashtwin.cli.exits import require_target
from swashtwin.cli.options import Index, Json, Length, Seed

if TYPE_CHECKING:
    from swashtwin.learning import WindowSet


def augment(
    source: Index,
    method: Annotated[
        str,
        typer.Option(
            help="duplicate, noisy_duplicate, jitter, smote, smote_spectrum, adasyn, adasyn_spectrum, cvae, wgan_gp, "
            "or diffusion (docs/augmentation.md)."
        ),
    ],
    label: Annotated[str, typer.Option(help="Class of the windows.")],
    count: Annotated[int, typer.Option(help="How many.")],
    out: Annotated[Path, typer.Option(help="File of windows to write, for train --add.")],
    pressure: Annotated[
        str | None, typer.Option(help='Discharge pressure of the cell, "15 MPa"; leave it out where none is stated.')
    ] = None,
    held_out: Annotated[
        Path | None, typer.Option(help="Index of recordings kept from training, to compare the windows with.")
    ] = None,
    length: Length = 2048,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Fill a scarce class, or class and pressure, with windows made from measured ones alone, without any twin.

    The recordings of the index are training data from then on: give train.toml of a split. Where the cell has no window
    those of its class at other pressures are drawn from. What is printed of likeness is explained in
    docs/augmentation.md.
    """
    from swashtwin.bench import FILLERS
    from swashtwin.foundation import DataError, InputError, parse
    from swashtwin.learning import check_disjoint, cut_windows, save_windows
    from swashtwin.recordings import declared_classes, load_recordings
    from swashtwin.synthesis import in_cell

    if method not in FILLERS:
        raise typer.BadParameter(f"{method!r} is none of {', '.join(FILLERS)}.", param_hint="--method")
    require_target(out)
    train = cut_windows(load_recordings(source), length=length, classes=declared_classes(source))
    at = math.nan if pressure is None else parse(pressure, "Pa", name="pressure")
    if pressure is None and not math.isnan(float(train.discharge_pressure.max(initial=-math.inf))):
        raise InputError('the recordings state their pressures; say which cell is to be filled: --pressure "15 MPa".')
    stated = train.discharge_pressure[train.label == label]
    if pressure is not None and len(stated) and all(map(math.isnan, stated.tolist())):
        raise InputError(
            f"no recording of {label} states its pressure, so none is known to be at {pressure}; leave out --pressure "
            f"or state pressures in {source}."
        )
    own = in_cell(train, label, at)
    compared, role = train.subset(own), "training windows of the cell"
    if held_out is not None:
        other = cut_windows(load_recordings(held_out), like=train)
        check_disjoint(train, other)
        compared, role = other.subset(in_cell(other, label, at)), "held-out windows of the cell"
        if not len(compared):
            raise DataError(f"{held_out} has no window of {label} at that pressure to compare with.")
    elif not own.any():
        compared, role = train.subset(train.label == label), "training windows of the class at other pressures"
    made = FILLERS[method](train, label=label, pressure=at, count=count, seed=seed)
    save_windows(made, out)
    likeness = _likeness(train, compared, made, seed)
    result: dict[str, Any] = {
        "windows": out, "method": method, "label": label, "pressure_pa": at, "count": len(made),
        "length": made.length, "seed": seed, "measured_in_cell": int(own.sum()), "compared_with": role,
        "compared_windows": len(compared), "likeness": likeness,
    }  # fmt: skip

    def show() -> None:
        say(f"{out}: {len(made)} windows of {label}, beside {own.sum()} measured ones of the cell")
        say(f"compared with {len(compared)} {role}:")
        table("Distance of the mean spectra", ("channel", "dB"), [*likeness["spectral_distance_db"].items()])
        say(f"told from them with an AUROC of {_word(likeness['discriminative_auroc'])}; 0.5 is not at all")
        say(f"nearer to a training window than its nearest neighbor: {likeness['copied_share']:.0%}; copies are 100%")
        say(f"Next: swashtwin train {source} --add {out} --test-fraction 0 --out model.safetensors")

    if likeness["discriminative_auroc"] is None and not as_json:
        note("note: the measured windows are of one recording, which anything would be told from; give --held-out.")
    tell(result, as_json, show)


def _likeness(train: "WindowSet", compared: "WindowSet", made: "WindowSet", seed: int) -> dict[str, Any]:
    from swashtwin.synthesis import copied_share, discriminative_score, spectral_distance

    distance = dict(zip(made.channels, spectral_distance(compared, made).tolist(), strict=True))
    told = len(set(compared.recording_id.tolist())) > 1 and len(made) > 1
    return {
        "spectral_distance_db": distance,
        "discriminative_auroc": discriminative_score(compared, made, seed=seed) if told else None,
        "copied_share": copied_share(train, made),
    }


def _word(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
