"""A fitted classifier as an ONNX file, which other languages and runtimes read without torch or swashtwin."""

import json
import logging
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.foundation import VERSION, MissingExtraError, replacing
from swashtwin.learning import FittedClassifier, Network, Normalization


def export_onnx(classifier: FittedClassifier, path: Path | str) -> Path:
    """`path`, after the classifier was written to it as an ONNX file.

    The input ``windows`` (window, channel, time) takes any number of windows of the classifier's layout in its unit,
    float32. A network on orders of the shaft has a second input, ``speed`` (window) [rad/s], NaN for that of the
    training. The one output, ``probability`` (window, class), is what `FittedClassifier.predict_proba` gives. The
    scaling is part of the file, but for the normalization ``"recording"``, which rests on more than one window: there
    the samples must come scaled. The file's metadata hold JSON: ``classes``, ``layout``, ``normalization``, ``scaled``
    (whether the file scales by itself), ``temperature`` and ``dependence`` (by which `diagnose` calibrates the
    probabilities, or null), ``manifest``, ``network`` and ``swashtwin`` (version).

    Raises
    ------
    MissingExtraError
        The packages that write ONNX are not installed.
    """
    _require_packages()
    layout, network = classifier.layout, classifier.network
    whole = _Whole(classifier.normalization, network, layout.sample_rate).eval()
    names, examples = ["windows"], [torch.zeros(2, len(layout.channels), layout.length)]
    if network.uses_speed:
        names, examples = [*names, "speed"], [*examples, torch.full((2,), torch.nan)]
    with _quiet():
        program = torch.onnx.export(
            whole,
            tuple(examples),
            dynamo=True,
            dynamic_shapes=({0: torch.export.Dim("window")},) * len(names),
            input_names=names,
            output_names=["probability"],
            verbose=False,
        )
    assert program is not None
    program.model.metadata_props.update({name: json.dumps(value) for name, value in _facts(classifier).items()})
    with replacing(Path(path)) as temporary:
        program.save(temporary, external_data=False)
    return Path(path)


def _require_packages() -> None:
    try:
        import onnx  # noqa: F401
        import onnxscript  # noqa: F401
    except ImportError as cause:
        raise MissingExtraError(
            'ONNX files need the packages onnx and onnxscript; pip install "swashtwin[onnx]".'
        ) from cause


class _Whole(nn.Module):
    """Scaling, network and softmax in one, computed as `FittedClassifier` computes them."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, normalization: Normalization, network: Network, sample_rate: float) -> None:
        super().__init__()
        self.kind = normalization.kind
        self.turns_of_speed = 1 / (2 * math.pi * sample_rate)
        self.network = network
        self.register_buffer("mean", torch.from_numpy(normalization.mean)[:, None])
        self.register_buffer("deviation", torch.from_numpy(normalization.deviation)[:, None])

    def forward(
        self, windows: Float[Tensor, "window channel time"], speed: Float[Tensor, " window"] | None = None
    ) -> Float[Tensor, "window class"]:
        samples, mean, deviation = windows.double(), self.mean, self.deviation
        if self.kind == "window":
            mean = samples.mean(dim=-1, keepdim=True)
            deviation = (samples - mean).square().mean(dim=-1, keepdim=True).sqrt()
            deviation = torch.where(deviation > 0, deviation, 1.0)
        if self.kind in ("window", "set"):
            windows = ((samples - mean) / deviation).float()
        if speed is None:
            return torch.softmax(self.network(windows), dim=-1)
        represented = self.network.represent_at(windows, speed * self.turns_of_speed)
        return torch.softmax(self.network.head(self.network.encode(represented)), dim=-1)


def _facts(classifier: FittedClassifier) -> dict[str, object]:
    kind = classifier.normalization.kind
    return {
        "classes": classifier.classes,
        "layout": asdict(classifier.layout),
        "normalization": kind,
        "scaled": kind != "recording",
        "temperature": None if classifier.confidence is None else classifier.confidence.temperature,
        "dependence": None if classifier.confidence is None else classifier.confidence.dependence,
        "manifest": sorted(classifier.manifest),
        "network": classifier.network.name,
        "swashtwin": VERSION,
    }


@contextmanager
def _quiet() -> Iterator[None]:
    """Within it, torch does not tell of packages that nobody needs, nor of its own old ways."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            for kind in (FutureWarning, DeprecationWarning):
                warnings.simplefilter("ignore", kind)
            warnings.filterwarnings("ignore", ".*axis name: window will not be used")  # two inputs share it
            yield
    finally:
        logger.setLevel(level)
