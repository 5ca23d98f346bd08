"""The recordings a classifier was trained on, by their vibration features: what a new one is compared with."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.features import extract_features
from swashtwin.windows import WindowSet

MOST = 2000
"""Recordings that a classifier keeps; of more, as many are kept, evenly spaced in the order of their ids."""


@dataclass(frozen=True, eq=False)
class KnownRecordings:
    """One row of mean features for each measured recording of the training; no reading is kept."""

    recording_id: tuple[str, ...]
    """The recordings, in the order of their ids."""
    label: tuple[str, ...]
    """Class of each."""
    features: Float64[np.ndarray, "recording feature"]
    """Mean of each feature over the windows of the recording."""

    def distances(self, features: Float[np.ndarray, " feature"]) -> Float64[np.ndarray, " recording"]:
        """Distance of each known recording from one of these mean features, 0 where they are the same.

        Root mean square over the features, each in units of its standard deviation between the known recordings; a
        feature that does not differ between them counts in its own unit.
        """
        deviation = self.features.std(axis=0)
        apart = (self.features - features) / np.where(deviation > 0, deviation, 1.0)
        return np.asarray(np.sqrt(np.mean(apart**2, axis=1)), dtype=np.float64)


def known_recordings(windows: WindowSet) -> KnownRecordings | None:
    """The measured recordings among training windows, by `extract_features`, or None where all are synthetic."""
    names = np.unique(windows.recording_id[~windows.synthetic])
    if not names.size:
        return None
    names = names[np.unique(np.linspace(0, names.size - 1, min(MOST, names.size)).round().astype(np.int64))]
    own = [windows.subset((windows.recording_id == name) & ~windows.synthetic) for name in names]
    return KnownRecordings(
        recording_id=tuple(names.tolist()),
        label=tuple(str(some.label[0]) for some in own),
        features=np.stack([extract_features(some).values.mean(axis=0) for some in own]),
    )
