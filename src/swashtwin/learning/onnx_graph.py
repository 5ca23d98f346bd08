"""A classifier as an ONNX graph, from scaled or raw windows to probabilities.

The graph computes the features as `networks.window_features`, `networks.line_prominences` and
`features` do, by the same tables of bands. ONNX is needed to build it.
"""

import math
from typing import Any

import numpy as np

from swashtwin.foundation import InputError
from swashtwin.learning.features import ENVELOPE_STATISTICS, N_BANDS
from swashtwin.learning.networks import line_prominences as prominence
from swashtwin.learning.networks.band_power_network import BandPowerNetwork
from swashtwin.learning.networks.feature_network import FeatureNetwork
from swashtwin.learning.networks.line_prominence_network import LineProminenceNetwork
from swashtwin.learning.networks.tree_network import ExtraTrees
from swashtwin.learning.networks.window_features import (
    ENVELOPE_BANDS,
    ENVELOPES_ABOVE,
    FLOOR,
    MIN_DEVIATION,
    MIN_ORDER_WIDTH,
    SIGNAL_BANDS,
    SpectrumBands,
    first_envelope_line,
)
from swashtwin.learning.training.classifier import FittedClassifier
from swashtwin.signals import MIN_POWER, TIME_STATISTICS, band_shares, equal_bands, hann_taper

OPSET = 18
"""Version of the operations; 17 is the first with a Fourier transform."""


class Graph:
    """A list of operations; the result of each is named by its number."""

    def __init__(self, dtype: Any = np.float32) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.dtype = dtype

    def constant(self, value: Any, dtype: Any = None) -> str:
        """Add an array to the file and return its name."""
        from onnx import numpy_helper

        name = f"constant_{len(self.constants)}"
        array = np.asarray(value, dtype=dtype or self.dtype)
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def __call__(self, operation: str, *inputs: Any, **attributes: Any) -> str:
        """Add an operation and return the name of its result.

        Numbers and arrays among its inputs become constants.
        """
        from onnx import helper

        names = [value if isinstance(value, str) else self.constant(value) for value in inputs]
        result = f"{operation.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operation, names, [result], **attributes))
        return result

    def reduce(self, operation: str, x: str, keep: int = 1) -> str:
        """Return the mean, sum or maximum over the last axis, which may be kept as one entry."""
        return self(f"Reduce{operation}", x, self.constant([-1], np.int64), keepdims=keep)

    def mean(self, x: str) -> str:
        """Return the mean over the last axis, which is kept as one entry."""
        return self.reduce("Mean", x)

    def rms(self, x: str) -> str:
        """Return the root mean square over the last axis, which is kept as one entry."""
        return self("Sqrt", self.mean(self("Mul", x, x)))

    def center(self, x: str) -> str:
        """Return `x` less its mean over the last axis."""
        return self("Sub", x, self.mean(x))

    def slice(self, x: str, start: int, end: int | None = None, axis: int = -1) -> str:
        """Return the entries `start` to `end` (exclusive) of an axis."""
        if end is None:
            end = np.iinfo(np.int64).max
        bounds = [self.constant([value], np.int64) for value in (start, end, axis)]
        return self("Slice", x, *bounds)

    def log10(self, x: str) -> str:
        """Return the decadic logarithm."""
        return self("Mul", self("Log", x), 1 / math.log(10))

    def transform(self, x: str) -> str:
        """Return the one-sided transform over the last axis; a new axis has its two parts."""
        pairs = self("Unsqueeze", x, self.constant([-1], np.int64))
        return self("DFT", pairs, axis=2, onesided=1)

    def power(self, lines: str) -> str:
        """Return the squared magnitude of complex numbers, whose two parts are the last axis."""
        return self.reduce("Sum", self("Mul", lines, lines), keep=0)

    def analytic_signal(self, spectrum: str, length: int, first: int, end: int) -> str:
        """Return the analytic signal of the lines `first` to `end` (included) of a transform.

        Its two parts are the last axis.
        """
        n_lines = length // 2 + 1
        line = np.arange(n_lines)
        weight = np.where((line >= first) & (line <= end), 2.0, 0.0)
        if length % 2 == 0:
            weight[-1] /= 2  # the line at half the rate has no counterpart at negative frequency

        padding = self.constant([0, 0, 0, 0, 0, 0, length - n_lines, 0], np.int64)
        lines = self("Pad", self("Mul", spectrum, weight[:, None]), padding)
        return self("DFT", lines, axis=2, inverse=1)


def onnx_model(classifier: FittedClassifier) -> Any:
    """Return the ONNX model of a classifier on features or of trees (see `export_onnx`).

    Raises
    ------
    InputError
        The classifier has another network.
    """
    from onnx import TensorProto, helper

    layout = classifier.layout
    network = classifier.network
    window_shape: list[str | int] = ["window", len(layout.channels), layout.length]
    inputs = [helper.make_tensor_value_info("windows", TensorProto.FLOAT, window_shape)]
    domains = [helper.make_opsetid("", OPSET)]
    if isinstance(network, FeatureNetwork):
        graph = Graph()
        if network.uses_speed:
            inputs.append(helper.make_tensor_value_info("speed", TensorProto.FLOAT, ["window"]))
        _add_feature_network(graph, classifier, network)
    elif isinstance(network, ExtraTrees):
        # Trees compare features of double precision, so that the same window takes the same path.
        graph = Graph(np.float64)
        domains.append(helper.make_opsetid("ai.onnx.ml", 3))
        _add_trees(graph, classifier, network)
    else:
        raise InputError(f"the network {network.name!r} cannot be written as ONNX.")

    output_shape: list[str | int] = ["window", len(classifier.classes)]
    output = helper.make_tensor_value_info("probability", TensorProto.FLOAT, output_shape)
    onnx_graph = helper.make_graph(graph.nodes, "classifier", inputs, [output], graph.constants)
    return helper.make_model(onnx_graph, opset_imports=domains, ir_version=9)


def _add_scaling(graph: Graph, classifier: FittedClassifier) -> str:
    """Add the classifier's normalization and return the scaled samples."""
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
        deviation = graph.rms(graph("Sub", samples, mean))
        is_constant = graph("Equal", deviation, graph.constant(0.0, np.float64))
        deviation = graph("Where", is_constant, graph.constant(1.0, np.float64), deviation)
    scaled = graph("Div", graph("Sub", samples, mean), deviation)
    return graph("Cast", scaled, to=TensorProto.FLOAT)


def _add_feature_network(
    graph: Graph, classifier: FittedClassifier, network: FeatureNetwork
) -> None:
    """Add `FeatureNetwork.probabilities`."""
    from onnx import helper

    layout = classifier.layout
    turns = None
    if network.uses_speed:
        specified = graph("Mul", "speed", 1 / (2 * math.pi * layout.sample_rate))
        default = network.settings["turns"] or math.nan
        turns = graph("Where", graph("IsNaN", specified), default, specified)
    samples = _add_scaling(graph, classifier)
    if isinstance(network, LineProminenceNetwork):
        features = _add_line_prominences(graph, samples, layout.length, turns)
    else:
        assert isinstance(network, BandPowerNetwork)
        features = _add_window_features(graph, network, samples, layout.length, turns)

    weights = network.weights
    encoded = graph("Div", graph("Sub", features, weights["mean"]), weights["deviation"])
    probabilities = []
    for head in network.settings["heads"]:
        scores = graph("Gemm", encoded, weights[head], weights[f"{head}.bias"], transB=1)
        if head == "hidden":
            active = graph("Relu", scores)
            scores = graph("Gemm", active, weights["output"], weights["output.bias"], transB=1)
        probabilities.append(graph("Softmax", scores, axis=-1))
    graph.nodes.append(helper.make_node("Mean", probabilities, ["probability"]))


def _add_window_features(
    graph: Graph, network: BandPowerNetwork, x: str, length: int, turns: str | None
) -> str:
    """Add `BandPowerNetwork.represent_at`."""
    x = graph.center(x)
    deviation = graph("Max", graph.rms(x), MIN_DEVIATION)
    x = graph("Div", x, deviation)
    parts = _add_spectrum(graph, x, length, turns, SIGNAL_BANDS)

    spectrum = graph.transform(x)
    for share in ENVELOPES_ABOVE:
        first = first_envelope_line(share, length)
        analytic = graph.analytic_signal(spectrum, length, first, length // 2)
        envelope = graph("Sqrt", graph("Add", graph.power(analytic), 1e-12))
        mean = graph.mean(envelope)
        moving = graph("Sub", envelope, mean)
        parts += _add_spectrum(graph, moving, length, turns, ENVELOPE_BANDS)
        parts.append(graph.log10(graph("Add", mean, FLOOR)))

    features = graph("Concat", *parts, axis=-1)
    features = graph("Add", features, graph("Mul", graph.log10(deviation), network.response))
    if network.settings["shape"]:
        channel_gain = graph("Mul", graph.slice(features, 0, 1), network.response)
        features = graph("Sub", features, channel_gain)
    return graph("Flatten", features, axis=1)


def _add_spectrum(
    graph: Graph, x: str, length: int, turns: str | None, bands: SpectrumBands
) -> list[str]:
    """Add the shape of the waveform, and log10 powers of narrow and wide bands."""
    lines = graph.slice(graph.transform(graph("Mul", x, hann_taper(length))), 1, axis=2)
    power = graph("Div", graph.power(lines), float(length))

    n_lines = length // 2
    if turns is None:
        first, end = equal_bands(n_lines, bands.n_narrow, bands.narrow_share)
        line = np.arange(end[-1])[:, None]
        weights = ((line >= first) & (line < end)) / (end - first)
        narrow = graph("MatMul", graph.slice(power, 0, int(end[-1])), weights)
    else:
        lines_per_order = graph("Mul", turns, float(length))
        narrow = _add_order_powers(graph, power, lines_per_order, n_lines, bands.n_orders)
    wide = graph("MatMul", power, band_shares(n_lines, bands.n_wide))
    log_powers = [graph.log10(graph("Add", powers, FLOOR)) for powers in (narrow, wide)]
    return [*_add_waveform_shape(graph, x), *log_powers]


def _add_waveform_shape(graph: Graph, x: str) -> list[str]:
    """Add the numbers of the waveform of `x`, whose mean is 0."""
    deviation = graph("Add", graph.rms(x), 1e-6)
    z = graph("Div", x, deviation)
    square = graph("Mul", z, z)
    magnitude = graph("Abs", z)
    fourth = graph.mean(graph("Mul", square, square))
    return [
        graph.log10(deviation),
        graph.mean(graph("Mul", square, z)),
        graph("Log", graph("Add", fourth, 1e-3)),
        graph("Log", graph("Add", graph.reduce("Max", magnitude), 1e-3)),
        graph.mean(magnitude),
    ]


def _add_order_powers(
    graph: Graph, power: str, lines_per_order: str, n_lines: int, n_orders: int
) -> str:
    """Add the mean power of the lines within half an order of each order.

    An order beyond the spectrum has that of the last line. The orders of each window lie at other
    lines, so that the overlap of lines and orders is computed in the graph.
    """
    per_order = graph("Unsqueeze", lines_per_order, graph.constant([1, 2], np.int64))
    order = np.arange(n_orders)[None, None]
    edges = []
    for offset in (0.5, 1.5):
        edge = graph("Sub", graph("Mul", per_order, order + offset), 0.5)
        edges.append(graph("Clip", edge, 0.0, float(n_lines)))
    low, high = edges

    line = np.arange(n_lines)[None, :, None]
    overlap = graph("Sub", graph("Min", high, line + 1), graph("Max", low, line))
    width = graph("Sub", high, low)
    sums = graph("MatMul", power, graph("Relu", overlap))
    mean = graph("Div", sums, graph("Max", width, 1e-6))
    is_beyond = graph("Less", width, MIN_ORDER_WIDTH)
    return graph("Where", is_beyond, graph.slice(power, n_lines - 1), mean)


def _add_line_prominences(graph: Graph, x: str, length: int, turns: str | None) -> str:
    """Add `line_prominences`, with the features of each channel one after another."""
    x = graph.center(x)
    x = graph("Div", x, graph("Max", graph.rms(x), prominence.MIN_DEVIATION))
    lines_per_order = None if turns is None else graph("Mul", turns, float(length))

    power = _add_line_powers(graph, x, length)
    parts = [
        _add_band_shape(graph, power, length // 2),
        _add_most_prominent(graph, _add_prominences(graph, power, length // 2, lines_per_order)),
    ]
    spectrum = graph.transform(x)
    last_line = length // 2
    for low, high in prominence.ENVELOPE_BANDS:
        first, end, count = prominence.envelope_lines(last_line, low, high)
        envelope = _add_squared_envelope(graph, spectrum, first, end, count)
        power = _add_line_powers(graph, envelope, count)
        prominences = _add_prominences(graph, power, count // 2, lines_per_order)
        parts.append(_add_most_prominent(graph, prominences))
        if turns is not None:
            parts += _add_comb_signature(graph, prominences)
    return graph("Flatten", graph("Concat", *parts, axis=-1), axis=1)


def _add_line_powers(graph: Graph, x: str, length: int) -> str:
    """Add the power of each spectral line above the mean, of the signal with a Hann taper."""
    lines = graph.slice(graph.transform(graph("Mul", x, hann_taper(length))), 1, axis=2)
    return graph("Div", graph.power(lines), float(length))


def _add_band_shape(graph: Graph, power: str, n_lines: int) -> str:
    """Add log10 of the power in each logarithmic band less the mean over the bands."""
    bands = graph("MatMul", power, band_shares(n_lines, prominence.N_SHAPE_BANDS))
    return graph.center(graph.log10(graph("Add", bands, prominence.FLOOR)))


def _add_squared_envelope(graph: Graph, spectrum: str, first: int, end: int, count: int) -> str:
    """Add the squared envelope of the lines `first` to `end` (exclusive) over its mean, less 1."""
    padding = graph.constant([0, 0, 0, 0, 0, 0, count - (end - first), 0], np.int64)
    lines = graph("Pad", graph.slice(spectrum, first, end, axis=2), padding)
    square = graph.power(graph("DFT", lines, axis=2, inverse=1))
    mean = graph("Max", graph.mean(square), 1e-30)
    return graph("Sub", graph("Div", square, mean), 1.0)


def _add_prominences(graph: Graph, power: str, n_lines: int, lines_per_order: str | None) -> str:
    """Add log10 of the power of each line less the mean over its neighbors.

    The lines of each window lie elsewhere in its spectrum if its speed is used, so that the overlap
    of spectral lines and lines is computed in the graph.
    """
    per_order: Any = float(prominence.LINES_PER_UNIT)
    if lines_per_order is not None:
        per_order = graph("Unsqueeze", lines_per_order, graph.constant([1, 2], np.int64))
    position = (np.arange(prominence.N_LINES)[None, None] + 0.5) * prominence.LINE_SPACING
    low = graph("Mul", per_order, position)
    width = graph("Mul", per_order, prominence.LINE_SPACING)
    low = graph("Max", 0.5, graph("Min", low, graph("Sub", n_lines + 0.5, width)))
    high = graph("Add", low, width)

    line = np.arange(1, n_lines + 1)[None, :, None]
    overlap = graph("Sub", graph("Min", high, line + 0.5), graph("Max", low, line - 0.5))
    mean_power = graph("Div", graph("MatMul", power, graph("Relu", overlap)), width)
    logarithm = graph.log10(graph("Add", mean_power, prominence.FLOOR))
    floor = graph("MatMul", logarithm, prominence.neighbor_weights())
    return graph("Sub", logarithm, floor)


def _add_most_prominent(graph: Graph, prominences: str) -> str:
    """Add the most prominent line of each cell."""
    shape = graph.constant([0, 0, prominence.N_CELLS, prominence.LINES_PER_CELL], np.int64)
    return graph.reduce("Max", graph("Reshape", prominences, shape), keep=0)


def _add_comb_signature(graph: Graph, prominences: str) -> list[str]:
    """Add the numbers of the most prominent comb."""
    harmonic = np.arange(1.0, prominence.N_HARMONICS + 1)
    fundamentals = prominence.FUNDAMENTALS[:, None]
    combs = graph.reduce(
        "Mean", _add_prominences_at(graph, prominences, fundamentals * harmonic), 0
    )
    excluded = np.where(prominence.is_of_shaft(), -1e9, 0.0)
    combs = graph("Add", combs, excluded)
    best = graph("ArgMax", combs, axis=-1, keepdims=1)

    numbers = [graph.reduce("Max", combs)]
    for spacing in prominence.SIDEBAND_SPACINGS:
        orders = prominence.sideband_orders(spacing)
        sidebands = _add_prominences_at(graph, prominences, orders)
        by_fundamental = graph.reduce("Mean", sidebands, keep=0)
        numbers.append(graph("GatherElements", by_fundamental, best, axis=-1))
    numbers.append(graph.mean(_add_prominences_at(graph, prominences, harmonic)))
    return numbers


def _add_prominences_at(graph: Graph, prominences: str, order: np.ndarray) -> str:
    """Add the highest prominence within one line of each order; 0 beyond the last line."""
    inner, is_covered = prominence.nearest_lines(order)
    near = []
    for offset in (-1, 0, 1):
        index = graph.constant(inner + offset, np.int64)
        near.append(graph("Gather", prominences, index, axis=2))
    return graph("Mul", graph("Max", *near), is_covered)


def _add_trees(graph: Graph, classifier: FittedClassifier, network: ExtraTrees) -> None:
    """Add `ExtraTrees.probabilities`, with features rounded as the trees compare them."""
    from onnx import TensorProto, helper

    x = graph("Cast", _add_scaling(graph, classifier), to=TensorProto.DOUBLE)
    features = _add_feature_values(graph, x, classifier.layout.length)
    features = graph("Cast", features, to=TensorProto.FLOAT)

    forest = network.forest
    assert forest is not None
    n_nodes = forest.column.size
    n_classes = network.n_classes
    tree = np.searchsorted(forest.root, np.arange(n_nodes), side="right") - 1
    root = forest.root[tree]
    is_leaf = forest.column < 0
    leaves = np.flatnonzero(is_leaf).repeat(n_classes)
    leaf_shares = (forest.probability[is_leaf] / len(forest.root)).ravel()

    node = helper.make_node(
        "TreeEnsembleClassifier",
        [features],
        ["likeliest", "probability"],
        domain="ai.onnx.ml",
        nodes_treeids=tree.tolist(),
        nodes_nodeids=(np.arange(n_nodes) - root).tolist(),
        nodes_featureids=np.maximum(forest.column, 0).tolist(),
        nodes_modes=np.where(is_leaf, "LEAF", "BRANCH_LEQ").tolist(),
        nodes_values=forest.threshold.tolist(),
        nodes_truenodeids=np.where(is_leaf, 0, forest.left - root).tolist(),
        nodes_falsenodeids=np.where(is_leaf, 0, forest.left + 1 - root).tolist(),
        class_treeids=tree[leaves].tolist(),
        class_nodeids=(leaves - root[leaves]).tolist(),
        class_ids=np.tile(np.arange(n_classes), int(is_leaf.sum())).tolist(),
        class_weights=leaf_shares.tolist(),
        classlabels_int64s=list(range(n_classes)),
        post_transform="NONE",
    )
    graph.nodes.append(node)


def _add_feature_values(graph: Graph, x: str, length: int) -> str:
    """Add `feature_values`."""
    moving = graph.center(x)
    analytic = graph.analytic_signal(graph.transform(moving), length, 1, (length - 1) // 2)
    quadrature = graph("Squeeze", graph.slice(analytic, 1), graph.constant([-1], np.int64))
    square = graph("Add", graph("Mul", moving, moving), graph("Mul", quadrature, quadrature))
    envelope = graph("Sqrt", square)

    envelope_statistics = _add_time_statistics(graph, envelope)
    parts = [
        *_add_time_statistics(graph, x).values(),
        _add_band_energies(graph, x, length),
        *(envelope_statistics[name] for name in ENVELOPE_STATISTICS),
        _add_band_energies(graph, envelope, length),
    ]
    return graph("Flatten", graph("Concat", *parts, axis=-1), axis=1)


def _add_time_statistics(graph: Graph, x: str) -> dict[str, str]:
    """Add `signals.time_statistics`, by name."""
    mean = graph.mean(x)
    magnitude = graph("Abs", x)
    moving = graph("Sub", x, mean)
    deviation = graph.rms(moving)
    rms = graph.rms(x)
    peak = graph.reduce("Max", magnitude)
    negative_peak = graph.reduce("Max", graph("Neg", x))
    mean_absolute = graph.mean(magnitude)

    divisor = graph("Where", graph("Equal", deviation, 0.0), 1.0, deviation)
    standardized = graph("Div", moving, divisor)
    square = graph("Mul", standardized, standardized)
    mean_root = graph.mean(graph("Sqrt", magnitude))

    columns = (
        mean,
        deviation,
        rms,
        peak,
        graph("Add", graph.reduce("Max", x), negative_peak),
        mean_absolute,
        graph.mean(graph("Mul", square, standardized)),
        graph.mean(graph("Mul", square, square)),
        _add_ratio(graph, peak, rms),
        _add_ratio(graph, rms, mean_absolute),
        _add_ratio(graph, peak, mean_absolute),
        _add_ratio(graph, peak, graph("Mul", mean_root, mean_root)),
    )
    return dict(zip(TIME_STATISTICS, columns, strict=True))


def _add_ratio(graph: Graph, numerator: str, denominator: str) -> str:
    """Add a ratio that is 0 if its denominator is 0."""
    is_zero = graph("Equal", denominator, 0.0)
    ratio = graph("Div", numerator, graph("Where", is_zero, 1.0, denominator))
    return graph("Where", is_zero, 0.0, ratio)


def _add_band_energies(graph: Graph, x: str, length: int) -> str:
    """Add `features.band_energies`."""
    taper = hann_taper(length)
    lines = graph.slice(graph.transform(graph("Mul", graph.center(x), taper)), 1, axis=2)
    power = graph("Mul", graph.power(lines), 2 / (length * np.sum(taper**2)))
    powers = graph("MatMul", power, band_shares(length // 2, N_BANDS))
    return graph.log10(graph("Max", powers, MIN_POWER))
