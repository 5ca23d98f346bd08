"""A fitted classifier as an ONNX file, for other languages and runtimes."""

import json
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swashtwin.foundation import VERSION, atomic_write, load_extra
from swashtwin.learning import FittedClassifier, SolvedNetwork, onnx_model

if TYPE_CHECKING:
    from swashtwin.learning import Network


def export_onnx(classifier: FittedClassifier, path: Path | str) -> Path:
    """Write a classifier to `path` as an ONNX file and return the path.

    The input ``windows`` (window, channel, time) takes any number of windows of the classifier's
    layout in its unit, float32. A network on orders of the shaft has a second input, ``speed``
    (window) [rad/s], NaN for that of the training. The only output, ``probability`` (window,
    class), equals `FittedClassifier.predict_proba` without the contribution of heads on whole
    recordings (`FittedClassifier.recordings`). The scaling is part of the file. Its metadata hold
    JSON: ``classes``, ``layout``, ``normalization``, ``temperature`` and ``dependence`` (by which
    `diagnose` calibrates the probabilities, or null), ``manifest``, ``network`` and ``swashtwin``
    (version).

    Raises
    ------
    MissingExtraError
        The packages that write ONNX are not installed.
    """
    load_extra("onnx", "onnx", "an ONNX file")
    network = classifier.network
    model: Any
    if isinstance(network, SolvedNetwork):
        model = onnx_model(classifier)
    else:
        load_extra("onnxscript", "onnx", "an ONNX file of a network of torch")
        model = torch_model(classifier, network)

    for name, value in _metadata(classifier).items():
        model.metadata_props.add(key=name, value=json.dumps(value))
    with atomic_write(Path(path)) as temporary:
        temporary.write_bytes(model.SerializeToString())
    return Path(path)


def _metadata(classifier: FittedClassifier) -> dict[str, object]:
    confidence = classifier.confidence
    return {
        "classes": classifier.classes,
        "layout": asdict(classifier.layout),
        "normalization": classifier.normalization.kind,
        "temperature": None if confidence is None else confidence.temperature,
        "dependence": None if confidence is None else confidence.dependence,
        "manifest": sorted(classifier.manifest),
        "network": classifier.network.name,
        "swashtwin": VERSION,
    }


def torch_model(classifier: FittedClassifier, network: "Network") -> Any:
    """Return the ONNX model of a network of torch: scaling, network and softmax.

    It computes in the order and precision of `FittedClassifier`.
    """
    import torch

    layout = classifier.layout
    normalization = classifier.normalization
    turns_per_speed = 1 / (2 * np.pi * layout.sample_rate)

    class ScaledNetwork(torch.nn.Module):
        mean: torch.Tensor
        deviation: torch.Tensor

        def __init__(self) -> None:
            super().__init__()
            self.network = network
            self.register_buffer("mean", torch.from_numpy(normalization.mean)[:, None])
            self.register_buffer("deviation", torch.from_numpy(normalization.deviation)[:, None])

        def forward(self, windows: torch.Tensor, speed: torch.Tensor | None = None) -> torch.Tensor:
            samples = windows.double()
            mean = self.mean
            deviation = self.deviation
            if normalization.kind == "window":
                mean = samples.mean(dim=-1, keepdim=True)
                deviation = (samples - mean).square().mean(dim=-1, keepdim=True).sqrt()
                deviation = torch.where(deviation > 0, deviation, 1.0)
            if normalization.kind in ("window", "set"):
                windows = ((samples - mean) / deviation).float()

            if speed is None:
                return torch.softmax(network(windows), dim=-1)
            represented = network.represent_at(windows, speed * turns_per_speed)
            return torch.softmax(network.head(network.encode(represented)), dim=-1)

    # Two windows, since the exporter takes a size of one for a constant.
    names = ["windows"]
    examples = [torch.zeros(2, len(layout.channels), layout.length)]
    if network.uses_speed:
        names.append("speed")
        examples.append(torch.full((2,), torch.nan))

    with _without_export_warnings():
        program = torch.onnx.export(
            ScaledNetwork().eval(),
            tuple(examples),
            dynamo=True,
            dynamic_shapes=({0: torch.export.Dim("window")},) * len(names),
            input_names=names,
            output_names=["probability"],
            verbose=False,
        )
    assert program is not None
    return program.model_proto


@contextmanager
def _without_export_warnings() -> Iterator[None]:
    """Silence torch's remarks on packages that are not needed and on its deprecated functions."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            for kind in (FutureWarning, DeprecationWarning):
                warnings.simplefilter("ignore", kind)
            # Windows and speed share their first axis.
            warnings.filterwarnings("ignore", ".*axis name: window will not be used")
            yield
    finally:
        logger.setLevel(level)
