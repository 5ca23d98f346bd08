"""The graph of a network that numpy computes, in operations of ONNX; no torch is needed to build
it.
"""

import math
from typing import Any

import numpy as np

from swashtwin.foundation import InputError
from swashtwin.learning import features as features_of
from swashtwin.learning.networks import window_features
from swashtwin.learning.networks.band_power_network import BandPowerNetwork
from swashtwin.learning.networks.tree_network import ExtraTrees
from swashtwin.learning.training.classifier import FittedClassifier
from swashtwin.signals import TIME_STATISTICS, band_shares, hann_taper

OPSET = 18


class Graph:
    """Operations one after another; each is named by its number."""

    def __init__(self, dtype: Any = np.float32) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.dtype = dtype

    def constant(self, value: Any, dtype: Any = None) -> str:
        """Name of an array that the file holds."""
        from onnx import numpy_helper

        name = f"constant_{len(self.constants)}"
        self.constants.append(
            numpy_helper.from_array(np.asarray(value, dtype=dtype or self.dtype), name)
        )
        return name

    def __call__(self, kind: str, *inputs: Any, **attributes: Any) -> str:
        """Name of the result of an operation; numbers and arrays among its inputs become
        constants.
        """
        from onnx import helper

        names = [item if isinstance(item, str) else self.constant(item) for item in inputs]
        name = f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, names, [name], **attributes))
        return name

    def mean(self, x: str) -> str:
        """Mean over the last axis, which stays as one entry."""
        return self.reduced("Mean", x)

    def reduced(self, kind: str, x: str, keep: int = 1) -> str:
        """Mean, sum or greatest entry over the last axis, which stays as one entry where it is to
        be kept.
        """
        return self(f"Reduce{kind}", x, self.constant([-1], np.int64), keepdims=keep)

    def part(self, x: str, first: int, last: int | None = None, axis: int = -1) -> str:
        """Entries `first` to `last` of an axis."""
        end = np.iinfo(np.int64).max if last is None else last
        return self("Slice", x, *(self.constant([value], np.int64) for value in (first, end, axis)))

    def log10(self, x: str) -> str:
        """Decadic logarithm."""
        return self("Mul", self("Log", x), 1 / math.log(10))

    def analytic(self, spectrum: str, length: int, first: int, last: int) -> str:
        """Analytic signal of the lines `first` to `last` of a transform; its two parts are a
        further axis.
        """
        n_lines = length // 2 + 1
        line = np.arange(n_lines)
        weight = np.where((line >= first) & (line <= last), 2.0, 0.0)
        if length % 2 == 0:
            weight[-1] /= 2  # the line at half the rate stands for itself alone
        gap = self.constant([0, 0, 0, 0, 0, 0, length - n_lines, 0], np.int64)
        return self(
            "DFT", self("Pad", self("Mul", spectrum, weight[:, None]), gap), axis=2, inverse=1
        )

    def transform(self, x: str) -> str:
        """One-sided transform over the last axis; the real and imaginary parts are a further
        axis.
        """
        return self("DFT", self("Unsqueeze", x, self.constant([-1], np.int64)), axis=2, onesided=1)


def onnx_model(classifier: FittedClassifier) -> Any:
    """The ONNX model of a classifier on levels or of trees (see `export_onnx`); an `InputError` for
    others.
    """
    from onnx import TensorProto, helper

    layout, network = classifier.layout, classifier.network
    shape: list[str | int] = ["window", len(layout.channels), layout.length]
    inputs = [helper.make_tensor_value_info("windows", TensorProto.FLOAT, shape)]
    domains = [helper.make_opsetid("", OPSET)]
    if isinstance(network, BandPowerNetwork):
        graph = Graph()
        if network.uses_speed:
            inputs.append(helper.make_tensor_value_info("speed", TensorProto.FLOAT, ["window"]))
        _answer_of_levels(graph, classifier, network)
    elif isinstance(network, ExtraTrees):
        graph = Graph(np.float64)
        domains.append(helper.make_opsetid("ai.onnx.ml", 3))
        _answer_of_trees(graph, classifier, network)
    else:
        raise InputError(f"the network {network.name!r} cannot be written as ONNX.")
    output = helper.make_tensor_value_info(
        "probability", TensorProto.FLOAT, ["window", len(classifier.classes)]
    )
    whole = helper.make_graph(graph.nodes, "classifier", inputs, [output], graph.constants)
    return helper.make_model(whole, opset_imports=domains, ir_version=9)


def _answer_of_levels(
    graph: Graph, classifier: FittedClassifier, network: BandPowerNetwork
) -> None:
    """`BandPowerNetwork.probabilities`."""
    from onnx import helper

    layout, turns = classifier.layout, None
    if network.uses_speed:
        stated = graph("Mul", "speed", 1 / (2 * math.pi * layout.sample_rate))
        turns = graph(
            "Where", graph("IsNaN", stated), network.settings["turns"] or math.nan, stated
        )
    features = _band_features(graph, network, _scaled(graph, classifier), layout.length, turns)
    weights = network.weights
    encoded = graph("Div", graph("Sub", features, weights["mean"]), weights["deviation"])
    answers = []
    for head in network.settings["heads"]:
        inner = graph("Gemm", encoded, weights[head], weights[f"{head}.bias"], transB=1)
        if head == "hidden":
            inner = graph(
                "Gemm", graph("Relu", inner), weights["output"], weights["output.bias"], transB=1
            )
        answers.append(graph("Softmax", inner, axis=-1))
    graph.nodes.append(helper.make_node("Mean", answers, ["probability"]))


def _answer_of_trees(graph: Graph, classifier: FittedClassifier, network: ExtraTrees) -> None:
    """`ExtraTrees.probabilities`: features of double precision, rounded as the trees compare
    them.
    """
    from onnx import TensorProto, helper

    x = graph("Cast", _scaled(graph, classifier), to=TensorProto.DOUBLE)
    values = graph("Cast", _features(graph, x, classifier.length), to=TensorProto.FLOAT)
    forest = network.forest
    assert forest is not None
    tree = np.searchsorted(forest.root, np.arange(forest.column.size), side="right") - 1
    first, leaf = forest.root[tree], forest.column < 0
    n_classes = network.n_classes
    leaves = np.flatnonzero(leaf).repeat(n_classes)
    attributes = {
        "nodes_treeids": tree, "nodes_nodeids": np.arange(forest.column.size) - first,
        "nodes_featureids": np.maximum(forest.column, 0), "nodes_truenodeids": np.where(leaf, 0, forest.left - first),
        "nodes_falsenodeids": np.where(leaf, 0, forest.left + 1 - first),
        "class_treeids": tree[leaves], "class_nodeids": leaves - first[leaves],
        "class_ids": np.tile(np.arange(n_classes), int(leaf.sum())),
    }  # fmt: skip
    shares = (forest.probability[leaf] / len(forest.root)).ravel()
    node = helper.make_node(
        "TreeEnsembleClassifier", [values], ["likeliest", "probability"], domain="ai.onnx.ml",
        nodes_modes=np.where(leaf, "LEAF", "BRANCH_LEQ").tolist(), nodes_values=forest.threshold.tolist(),
        class_weights=shares.tolist(), classlabels_int64s=list(range(n_classes)), post_transform="NONE",
        **{name: value.tolist() for name, value in attributes.items()},
    )  # fmt: skip
    graph.nodes.append(node)


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


def _band_features(
    graph: Graph, network: BandPowerNetwork, x: str, length: int, turns: str | None
) -> str:
    """`BandPowerNetwork.represent_at`."""
    x = graph("Sub", x, graph.mean(x))
    deviation = graph(
        "Max", graph("Sqrt", graph.mean(graph("Mul", x, x))), window_features.LEAST_DEVIATION
    )
    x = graph("Div", x, deviation)
    counts = window_features.line_counts(turns is not None)
    parts = _spectrum_levels(
        graph, x, length, turns, counts[0], window_features.LINE_SHARE, window_features.BANDS
    )
    spectrum = graph.transform(x)
    for above in window_features.ENVELOPE_FROM:
        analytic = graph.analytic(
            spectrum, length, math.floor(above * (length // 2)) + 1, length // 2
        )
        square = graph.reduced("Sum", graph("Mul", analytic, analytic), keep=0)
        envelope = graph("Sqrt", graph("Add", square, 1e-12))
        mean = graph.mean(envelope)
        moving = graph("Sub", envelope, mean)
        parts += _spectrum_levels(
            graph,
            moving,
            length,
            turns,
            counts[1],
            window_features.ENVELOPE_SHARE,
            window_features.ENVELOPE_BANDS,
        )
        parts.append(graph.log10(graph("Add", mean, window_features.FLOOR)))
    features = graph("Concat", *parts, axis=-1)
    features = graph("Add", features, graph("Mul", graph.log10(deviation), network.response))
    if network.settings["shape"]:
        features = graph(
            "Sub", features, graph("Mul", graph.part(features, 0, 1), network.response)
        )
    return graph("Flatten", features, axis=1)


def _spectrum_levels(
    graph: Graph, x: str, length: int, turns: str | None, n_narrow: int, share: float, n_bands: int
) -> list[str]:
    """Shape of the waveform, levels of narrow lines, levels of logarithmic bands."""
    lines = graph.part(graph.transform(graph("Mul", x, hann_taper(length))), 1, axis=2)
    power = graph("Div", graph.reduced("Sum", graph("Mul", lines, lines), keep=0), float(length))
    n_lines = length // 2
    if turns is None:
        first, last = window_features.narrow_edges(n_lines, n_narrow, share)
        line = np.arange(last[-1])[:, None]
        narrow = graph(
            "MatMul",
            graph.part(power, 0, int(last[-1])),
            ((line >= first) & (line < last)) / (last - first),
        )
    else:
        narrow = _order_powers(graph, power, graph("Mul", turns, float(length)), n_lines, n_narrow)
    banded = graph("MatMul", power, band_shares(n_lines, n_bands))
    features = [graph.log10(graph("Add", part, window_features.FLOOR)) for part in (narrow, banded)]
    deviation = graph("Add", graph("Sqrt", graph.mean(graph("Mul", x, x))), 1e-6)
    z = graph("Div", x, deviation)
    square, magnitude = graph("Mul", z, z), graph("Abs", z)
    return [
        graph.log10(deviation),
        graph.mean(graph("Mul", square, z)),
        graph("Log", graph("Add", graph.mean(graph("Mul", square, square)), 1e-3)),
        graph("Log", graph("Add", graph.reduced("Max", magnitude), 1e-3)),
        graph.mean(magnitude),
        *features,
    ]


def _order_powers(
    graph: Graph, power: str, lines_per_order: str, n_lines: int, n_orders: int
) -> str:
    """Mean power of the lines within half an order of each order; that of the last line beyond the
    spectrum.
    """
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
    return graph(
        "Where",
        graph("Less", width, window_features.NARROWEST),
        graph.part(power, n_lines - 1),
        mean,
    )


def _features(graph: Graph, x: str, length: int) -> str:
    """`feature_values`."""
    moving = graph("Sub", x, graph.mean(x))
    analytic = graph.analytic(graph.transform(moving), length, 1, (length - 1) // 2)
    turned = graph("Squeeze", graph.part(analytic, 1), graph.constant([-1], np.int64))
    envelope = graph(
        "Sqrt", graph("Add", graph("Mul", moving, moving), graph("Mul", turned, turned))
    )
    statistics = [_time_statistics(graph, x), _time_statistics(graph, envelope)]
    parts = [
        *statistics[0].values(), _band_levels(graph, x, length),
        *(statistics[1][name] for name in features_of.ENVELOPE_STATISTICS), _band_levels(graph, envelope, length),
    ]  # fmt: skip
    return graph("Flatten", graph("Concat", *parts, axis=-1), axis=1)


def _time_statistics(graph: Graph, x: str) -> dict[str, str]:
    """`signals.time_statistics` by name."""
    mean, magnitude = graph.mean(x), graph("Abs", x)
    moving = graph("Sub", x, mean)
    deviation = graph("Sqrt", graph.mean(graph("Mul", moving, moving)))
    rms, peak = graph("Sqrt", graph.mean(graph("Mul", x, x))), graph.reduced("Max", magnitude)
    absolute = graph.mean(magnitude)
    standard = graph("Div", moving, graph("Where", graph("Equal", deviation, 0.0), 1.0, deviation))
    square = graph("Mul", standard, standard)
    root = graph.mean(graph("Sqrt", magnitude))

    def ratio(above: str, below: str) -> str:
        is_zero = graph("Equal", below, 0.0)
        return graph(
            "Where", is_zero, 0.0, graph("Div", above, graph("Where", is_zero, 1.0, below))
        )

    columns = (
        mean, deviation, rms, peak, graph("Add", graph.reduced("Max", x), graph.reduced("Max", graph("Neg", x))),
        absolute,
        graph.mean(graph("Mul", square, standard)), graph.mean(graph("Mul", square, square)), ratio(peak, rms),
        ratio(rms, absolute), ratio(peak, absolute), ratio(peak, graph("Mul", root, root)),
    )  # fmt: skip
    return dict(zip(TIME_STATISTICS, columns, strict=True))


def _band_levels(graph: Graph, x: str, length: int) -> str:
    """`features.band_energies`."""
    taper = hann_taper(length)
    moving = graph("Mul", graph("Sub", x, graph.mean(x)), taper)
    lines = graph.part(graph.transform(moving), 1, axis=2)
    power = graph(
        "Mul",
        graph.reduced("Sum", graph("Mul", lines, lines), keep=0),
        2 / (length * np.sum(taper**2)),
    )
    banded = graph("MatMul", power, band_shares(length // 2, features_of.N_BANDS))
    return graph.log10(graph("Max", banded, 1e-30))
