"""Indicators of a recording that is too long to be transformed at once, from stretches of it."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float64

from swashtwin.recordings import Recording, refuse_unfit
from swashtwin.signals.indicators.statistics import power_sums, shape_statistics
from swashtwin.signals.indicators.table import IndicatorTable

LONGEST = 1 << 23
"""Samples of all channels up to which a recording is described as a whole."""
_STRETCHES, _STRETCH = 16, 1 << 20
"""Number of stretches of a longer one, and the samples of all channels in each."""
_LEVELS = ("velocity_rms", "band_rms", "order_amplitude", "envelope_amplitude")


def long_indicators(recording: Recording, describe: Callable[[Recording], IndicatorTable]) -> IndicatorTable:
    """What `describe` gives of a recording, or a table of its stretches where it is longer than `LONGEST`.

    A long recording is read in blocks. Its rms, peak, crest factor, kurtosis and skewness are those of all samples. The
    others come from 16 stretches that are spread evenly over it: levels and amplitudes are the root mean square over
    the stretches, everything else is their median.

    Raises
    ------
    DataError
        The recording is unfit.
    """
    if recording.n_samples * recording.n_channels <= LONGEST:
        return describe(recording)
    refuse_unfit(recording)
    length = _STRETCH // recording.n_channels
    starts = np.linspace(0, recording.n_samples - length, _STRETCHES).astype(int).tolist()
    tables = [describe(recording.slice(start, start + length)) for start in starts]
    shared = [column for column in tables[0].columns if all(column in table.columns for table in tables)]
    values = np.stack([table.values[:, [table.columns.index(column) for column in shared]] for table in tables])
    joined = np.median(values, axis=0)
    statistics = _statistics(recording, tables[0]) if any(column.name == "rms" for column in shared) else {}
    for index, column in enumerate(shared):
        if column.name.startswith(_LEVELS):
            joined[:, index] = np.sqrt(np.mean(values[:, :, index] ** 2, axis=0))
        elif column.name in statistics:
            joined[:, index] = statistics[column.name]
    return IndicatorTable(tables[0].rows, tuple(shared), joined)


def _statistics(recording: Recording, table: IndicatorTable) -> dict[str, Float64[np.ndarray, " channel"]]:
    """Statistics of all samples of the channels that a table describes."""
    picked = recording.picked([row.channel for row in table.rows])
    mean = sum(block.signal.sum(axis=1) for block in picked.blocks()) / picked.n_samples
    sums = np.zeros((4, picked.n_channels))
    for block in picked.blocks():
        part = power_sums(block.signal - mean[:, None])
        sums = np.concatenate([sums[:3] + part[:3], np.maximum(sums[3:], part[3:])])
    return shape_statistics(sums, picked.n_samples)
