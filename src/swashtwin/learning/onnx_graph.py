"""The graph of a network that numpy computes, in operations of ONNX; no torch is needed to build it."""

import math
from typing import Any

import numpy as np

from swashtwin.learning.networks import window_levels as levels_of
from swashtwin.learning.networks.level_network import LevelNetwork
from swashtwin.learning.training.classifier import FittedClassifier
from swashtwin.signals import band_shares, hann_taper

OPSET = 18


class Graph:
    """Operations one after another; each is named by its number."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: Any, dtype: Any = np.float32) -> str:
        """Name of an array that the file holds."""
        from onnx import numpy_helper

        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value, dtype=dtype), name))
        return name

    def __call__(self, kind: str, *inputs: Any, **attributes: Any) -> str:
        """Name of the result of an operation; numbers and arrays among its inputs become constants."""
        from onnx import helper

        names = [item if isinstance(item, str) else self.constant(item) for item in inputs]
        name = f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, names, [name], **attributes))
        return name

    def mean(self, x: str) -> str:
        """Mean over the last axis, which stays as one entry."""
        return self("ReduceMean", x, self.constant([-1], np.int64), keepdims=1)

    def part(self, x: str, first: int, last: int | None = None, axis: int = -1) -> str:
        """Entries `first` to `last` of an axis."""
        end = np.iinfo(np.int64).max if last is None else last
        return self("Slice", x, *(self.constant([value], np.int64) for value in (first, end, axis)))

    def log10(self, x: str) -> str:
        """Decadic logarithm."""
        return self("Mul", self("Log", x), 1 / math.log(10))

    def transform(self, x: str) -> str:
        """One-sided transform over the last axis; the real and imaginary parts are a further axis."""
        return self("DFT", self("Unsqueeze", x, self.constant([-1], np.int64)), axis=2, onesided=1)


def onnx_model(classifier: FittedClassifier) -> Any:
    """The ONNX model of a classifier on levels, without metadata; see `export_onnx` for its inputs and output."""
    from onnx import TensorProto, helper

    layout, network, graph = classifier.layout, classifier.network, Graph()
    assert isinstance(network, LevelNetwork)
    x = _scaled(graph, classifier)
    inputs = [
        helper.make_tensor_value_info("windows", TensorProto.FLOAT, ["window", len(layout.channels), layout.length])
    ]
    turns = None
    if network.uses_speed:
        inputs.append(helper.make_tensor_value_info("speed", TensorProto.FLOAT, ["window"]))
        stated = graph("Mul", "speed", 1 / (2 * math.pi * layout.sample_rate))
        turns = graph("Where", graph("IsNaN", stated), network.settings["turns"], stated)
    features = _levels(graph, network, x, layout.length, turns)
    weights = network.weights
    encoded = graph("Div", graph("Sub", features, weights["mean"]), weights["deviation"])
    answers = []
    for head in network.settings["heads"]:
        inner = graph("Gemm", encoded, weights[head], weights[f"{head}.bias"], transB=1)
        if head == "hidden":
            inner = graph("Gemm", graph("Relu", inner), weights["output"], weights["output.bias"], transB=1)
        answers.append(graph("Softmax", inner, axis=-1))
    graph.nodes.append(helper.make_node("Mean", answers, ["probability"]))
    output = helper.make_tensor_value_info("probability", TensorProto.FLOAT, ["window", len(classifier.classes)])
    whole = helper.make_graph(graph.nodes, "classifier", inputs, [output], graph.constants)
    return helper.make_model(whole, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=9)


def _scaled(graph: Graph, classifier: FittedClassifier) -> str:
    """Samples as the classifier's normalization scales them."""
    from onnx import TensorProto

    normalization = classifier.normalization
    if normalization.kind not in ("window", "set"):
        return "windows"
    samples = graph("Cast", "windows", to=TensorProto.DOUBLE)
    if normalization.kind == "set":
        mean = graph.constant(normalization.mean[:, None], np.float64)
        deviation = graph.constant(normalization.deviation[:, None], np.float64)
    else:
        mean = graph.mean(samples)
        moving = graph("Sub", samples, mean)
        deviation = graph("Sqrt", graph.mean(graph("Mul", moving, moving)))
        is_still = graph("Equal", deviation, graph.constant(0.0, np.float64))
        deviation = graph("Where", is_still, graph.constant(1.0, np.float64), deviation)
    return graph("Cast", graph("Div", graph("Sub", samples, mean), deviation), to=TensorProto.FLOAT)


def _levels(graph: Graph, network: LevelNetwork, x: str, length: int, turns: str | None) -> str:
    """`LevelNetwork.represent_at`."""
    x = graph("Sub", x, graph.mean(x))
    deviation = graph("Max", graph("Sqrt", graph.mean(graph("Mul", x, x))), levels_of.LEAST_DEVIATION)
    x = graph("Div", x, deviation)
    counts = levels_of.line_counts(turns is not None)
    parts = _spectrum_levels(graph, x, length, turns, counts[0], levels_of.LINE_SHARE, levels_of.BANDS)
    spectrum = graph.transform(x)
    n_lines = length // 2 + 1
    for above in levels_of.ENVELOPE_FROM:
        weight = np.where(np.arange(n_lines) > above * (length // 2), 2.0, 0.0)
        if length % 2 == 0:
            weight[-1] /= 2  # the line at half the rate stands for itself alone
        half = graph("Mul", spectrum, weight[:, None])
        gap = graph.constant([0, 0, 0, 0, 0, 0, length - n_lines, 0], np.int64)
        analytic = graph("DFT", graph("Pad", half, gap), axis=2, inverse=1)
        square = graph("ReduceSum", graph("Mul", analytic, analytic), graph.constant([-1], np.int64), keepdims=0)
        envelope = graph("Sqrt", graph("Add", square, 1e-12))
        mean = graph.mean(envelope)
        moving = graph("Sub", envelope, mean)
        parts += _spectrum_levels(
            graph, moving, length, turns, counts[1], levels_of.ENVELOPE_SHARE, levels_of.ENVELOPE_BANDS
        )
        parts.append(graph.log10(graph("Add", mean, levels_of.FLOOR)))
    levels = graph("Concat", *parts, axis=-1)
    levels = graph("Add", levels, graph("Mul", graph.log10(deviation), network.response))
    if network.settings["shape"]:
        levels = graph("Sub", levels, graph("Mul", graph.part(levels, 0, 1), network.response))
    return graph("Flatten", levels, axis=1)


def _spectrum_levels(
    graph: Graph, x: str, length: int, turns: str | None, n_narrow: int, share: float, n_bands: int
) -> list[str]:
    """Shape of the waveform, levels of narrow lines, levels of logarithmic bands."""
    lines = graph.part(graph.transform(graph("Mul", x, hann_taper(length))), 1, axis=2)
    power = graph("ReduceSum", graph("Mul", lines, lines), graph.constant([-1], np.int64), keepdims=0)
    power = graph("Div", power, float(length))
    n_lines = length // 2
    if turns is None:
        first, last = levels_of.narrow_edges(n_lines, n_narrow, share)
        line = np.arange(last[-1])[:, None]
        narrow = graph(
            "MatMul", graph.part(power, 0, int(last[-1])), ((line >= first) & (line < last)) / (last - first)
        )
    else:
        narrow = _order_powers(graph, power, graph("Mul", turns, float(length)), n_lines, n_narrow)
    banded = graph("MatMul", power, band_shares(n_lines, n_bands))
    levels = [graph.log10(graph("Add", part, levels_of.FLOOR)) for part in (narrow, banded)]
    deviation = graph("Add", graph("Sqrt", graph.mean(graph("Mul", x, x))), 1e-6)
    z = graph("Div", x, deviation)
    square, magnitude = graph("Mul", z, z), graph("Abs", z)
    largest = graph("ReduceMax", magnitude, graph.constant([-1], np.int64), keepdims=1)
    return [
        graph.log10(deviation),
        graph.mean(graph("Mul", square, z)),
        graph("Log", graph("Add", graph.mean(graph("Mul", square, square)), 1e-3)),
        graph("Log", graph("Add", largest, 1e-3)),
        graph.mean(magnitude),
        *levels,
    ]


def _order_powers(graph: Graph, power: str, lines_per_order: str, n_lines: int, n_orders: int) -> str:
    """Mean power of the lines within half an order of each order; that of the last line beyond the spectrum."""
    per_order = graph("Unsqueeze", lines_per_order, graph.constant([1, 2], np.int64))
    edges = []
    for offset in (0.5, 1.5):
        edge = graph("Sub", graph("Mul", per_order, np.arange(n_orders)[None, None] + offset), 0.5)
        edges.append(graph("Clip", edge, 0.0, float(n_lines)))
    low, high = edges
    line = np.arange(n_lines)[None, :, None]
    overlap = graph("Relu", graph("Sub", graph("Min", high, line + 1), graph("Max", low, line)))
    width = graph("Sub", high, low)
    mean = graph("Div", graph("MatMul", power, overlap), graph("Max", width, 1e-6))
    return graph("Where", graph("Less", width, levels_of.NARROWEST), graph.part(power, n_lines - 1), mean)
