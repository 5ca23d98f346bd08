"""Command that hands a model to other programs: export."""

from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli.console import note, say, tell
from swashtwin.cli.exits import require_target
from swashtwin.cli.options import Json


def export(
    model: Annotated[Path, typer.Argument(help="Model file that train wrote.")],
    out: Annotated[Path, typer.Option(help="ONNX file to write.")] = Path("model.onnx"),
    as_json: Json = False,
) -> None:
    """Write a model as an ONNX file, which runs without torch and without swashtwin."""
    from swashtwin.diagnosis import export_onnx, load_classifier

    require_target(out, ".onnx")
    classifier = load_classifier(model)
    export_onnx(classifier, out)
    layout, kind = classifier.layout, classifier.normalization.kind
    result = {
        "model": out, "network": classifier.network.name, "classes": classifier.classes,
        "channels": layout.channels, "length": layout.length, "sample_rate": layout.sample_rate,
        "unit": layout.unit, "normalization": kind, "scaled": kind != "recording",
    }  # fmt: skip

    def show() -> None:
        shape = f"(any, {len(layout.channels)}, {layout.length})"
        say(f"{out}: windows {shape} in {layout.unit} at {layout.sample_rate:g} Hz, to one probability a class")
        if kind == "recording":
            note("note: it scales nothing; give it readings scaled by the mean and deviation of their recording.")

    tell(result, as_json, show)
