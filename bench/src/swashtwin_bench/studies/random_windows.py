"""Windows dealt to training and test at random, as many papers do: level L0, a diagnosis of the leak."""

import numpy as np

from swashtwin.foundation import stream
from swashtwin.learning import WindowSet


def deal_windows(measured: WindowSet, test: WindowSet, seed: int) -> tuple[WindowSet, WindowSet]:
    """(training windows, test windows): the same windows, dealt anew in each cell of the test.

    A cell is a class at a discharge pressure. Each keeps its numbers of training and of test windows; only which window
    is which is drawn. So the scores differ from those of the split by recording by the leak alone.

    Parameters
    ----------
    measured : measured training windows.
    test : test windows of other recordings, cut like them.
    """
    pool = measured + test
    label, pressure = pool.label, pool.cell_pressure
    in_training = np.arange(len(pool)) < len(measured)
    rng = stream(seed, "random windows")
    tested = zip(label[len(measured) :].tolist(), pressure[len(measured) :].tolist(), strict=True)
    for name, value in sorted(set(tested)):
        cell = np.flatnonzero((label == name) & (pressure == value))
        dealt = rng.permutation(cell)
        in_training[dealt] = np.arange(len(dealt)) < np.count_nonzero(in_training[cell])
    return pool.subset(in_training), pool.subset(~in_training)
