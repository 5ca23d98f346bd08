"""A fitted classifier as an ONNX file, which other languages and runtimes read without torch or swashtwin."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from swashtwin.foundation import VERSION, load_extra, replacing
from swashtwin.learning import FittedClassifier, SolvedNetwork, onnx_model


def export_onnx(classifier: FittedClassifier, path: Path | str) -> Path:
    """`path`, after the classifier was written to it as an ONNX file.

    The input ``windows`` (window, channel, time) takes any number of windows of the classifier's layout in its unit,
    float32. A network on orders of the shaft has a second input, ``speed`` (window) [rad/s], NaN for that of the
    training. The one output, ``probability`` (window, class), is what `FittedClassifier.predict_proba` gives, without
    what heads on whole recordings (`FittedClassifier.recordings`) add. The
    scaling is part of the file. The file's metadata hold JSON: ``classes``, ``layout``, ``normalization``,
    ``temperature`` and ``dependence`` (by which `diagnose` calibrates the probabilities, or null), ``manifest``,
    ``network`` and ``swashtwin`` (version).

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
        from swashtwin.diagnosis.torch_program import torch_model

        model = torch_model(classifier, network)
    for name, value in _facts(classifier).items():
        model.metadata_props.add(key=name, value=json.dumps(value))
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(model.SerializeToString())
    return Path(path)


def _facts(classifier: FittedClassifier) -> dict[str, object]:
    return {
        "classes": classifier.classes,
        "layout": asdict(classifier.layout),
        "normalization": classifier.normalization.kind,
        "temperature": None if classifier.confidence is None else classifier.confidence.temperature,
        "dependence": None if classifier.confidence is None else classifier.confidence.dependence,
        "manifest": sorted(classifier.manifest),
        "network": classifier.network.name,
        "swashtwin": VERSION,
    }
