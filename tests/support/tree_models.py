"""Trees on features, fitted for tests."""

from swashtwin.learning import (
    FittedClassifier,
    TrainingSettings,
    WindowSet,
    build_network,
    fit,
)

UNSCALED = TrainingSettings(epochs=1, normalization="none")


def fit_trees(
    windows: WindowSet, trees: int = 5, *, seed: int = 0, kind: str = "extra_trees"
) -> FittedClassifier:
    """So many trees, fitted on the features of windows as they are."""
    network = build_network(kind, windows.n_channels, len(windows.classes), trees=trees)
    return fit(network, windows, settings=UNSCALED, seed=seed)
