"""Labels of classifiers and training sets in sentences, tables and figures."""

TRAINING_SETS = {
    "measured": "measured windows only",
    "nominal": "with nominal twin",
    "calibrated": "with calibrated twin",
    "law": "with calibrated twin and law of the recess",
    "posterior": "with draws of calibrated twins",
    "default_prior": "with draws of calibrated twins, default severities",
    "every_class": "with calibrated twin, every class",
    "class_weights": "class weights",
    "nominal_every_class": "with nominal twin, every class",
    "nominal_everywhere": "with nominal twin, every class and pressure",
    "nominal_few": "with nominal twin, few assemblies",
    "nominal_every_class_few": "with nominal twin, every class, few assemblies",
    "nominal_every_class_alike": "with nominal twin, every class, as many windows as measured",
    "no_gain": "with nominal twin without gain",
    "no_gain_every_class": "with nominal twin without gain, every class",
    "no_gain_everywhere": "with nominal twin without gain, every class and pressure",
    "calibrated_every_class": "with calibrated twin, every class",
    "law_every_class": "with calibrated twin and law of the recess, every class",
    "law_everywhere": "with calibrated twin and law of the recess, every class and pressure",
    "ceiling_true": "ceiling: true values",
    "ceiling_true_every_class": "ceiling: true values, every class",
    "ceiling_true_everywhere": "ceiling: true values, every class and pressure",
    "ceiling_perfect": "ceiling: the rig's own lines",
    "ceiling_perfect_every_class": "ceiling: the rig's own lines, every class",
    "ceiling_perfect_everywhere": "ceiling: the rig's own lines, every class and pressure",
    "ceiling_perfect_few": "ceiling: the rig's own lines, few assemblies",
}
"""Label of each training set; a filler is labeled by its name."""

CLASSIFIERS = {
    "spectral_bitcn": "BiTCN on spectra (ours)",
    "spectral_noise": "BiTCN on spectra (ours), new noise in every epoch",
    "chosen": "default training (ours)",
    "band_powers": "band-power network (ours)",
    "levels": "band-power network (ours)",  # its name in studies up to 3b268ae3
    "bitcn": "BiTCN, stride 16",
    "paper_bitcn": "BiTCN (the paper's)",
    "paper_ordinary": "A: ordinary convolution (the paper's)",
    "paper_no_attention": "B: no squeeze-and-excitation (the paper's)",
    "paper_forward": "C: forward branch only (the paper's)",
    "tcn": "TCN",
    "lstm": "LSTM",
    "bilstm": "BiLSTM",
    "bigru": "BiGRU",
    "wdcnn": "WDCNN",
    "cnn_lstm": "CNN-LSTM",
    "extra_trees": "extra trees",
    "svm": "SVM",
    "logistic": "logistic regression",
    "ridge": "ridge classifier",
    "autoencoder": "sparse autoencoder",
    "sensor_graph": "graph over sensors",
}
"""Label of each classifier; others are labeled by their name."""


def format_factor(factor: str, value: str) -> str:
    """Return the label of a factor's value.

    Examples
    --------
    >>> format_factor("classifier", "spectral_bitcn"), format_factor("classifier", "random_forest")
    ('BiTCN on spectra (ours)', 'random forest')
    """
    labels: dict[str, str] = {}
    if factor == "classifier":
        labels = CLASSIFIERS
    elif factor == "training_set":
        labels = TRAINING_SETS

    return labels.get(value, value.replace("_", " "))
