"""What classifiers and training sets are called where a person reads of them."""

TRAINING_SETS = {
    "measured": "measured only",
    "nominal": "with nominal twin",
    "calibrated": "with calibrated twin",
    "posterior": "with draws of calibrated twins",
    "default_prior": "with draws of calibrated twins, default severities",
    "every_class": "with calibrated twin, every class",
    "class_weights": "class weights",
}
"""What each training set is called in sentences, tables and figures."""

CLASSIFIERS = {
    "spectral_bitcn": "BiTCN on levels (ours)",
    "spectral_noise": "BiTCN on levels (ours), new noise in every epoch",
    "chosen": "chosen in training (ours)",
    "band_powers": "band-power network (ours)",
    "levels": "band-power network (ours)",  # its name in studies up to evidence-0.2
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
"""What classifiers are called in sentences, tables and figures; others by their own name."""


def format_factor(factor: str, value: str) -> str:
    """A factor's value in words.

    Examples
    --------
    >>> format_factor("classifier", "spectral_bitcn"), format_factor("classifier", "random_forest")
    ('BiTCN on levels (ours)', 'random forest')
    """
    names = {"classifier": CLASSIFIERS, "training_set": TRAINING_SETS}.get(factor, {})
    return names.get(value, value.replace("_", " "))
