"""Question asked of a public set: units to tell apart, with their features, and groups that must stay apart."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Shaped

from swashtwin.learning import cut_windows, extract_features
from swashtwin.recordings import Recording


@dataclass(frozen=True, eq=False)
class Units:
    """Pieces of recordings that a classifier learns from, with their features."""

    label: Shaped[np.ndarray, " unit"]
    """Class of each."""
    recording: Shaped[np.ndarray, " unit"]
    """Recording each was taken from; it is decided as a whole."""
    group: Shaped[np.ndarray, " unit"]
    """Group of each; the honest split keeps groups apart."""
    inner: Shaped[np.ndarray, " unit"]
    """What settings are chosen by: the like of `group`, kept apart within the training side."""
    features: Mapping[str, Float[np.ndarray, "unit feature"]]
    """Features by name."""

    def __len__(self) -> int:
        return len(self.label)


def usual_windows(recordings: Sequence[Recording], length: int, group: Callable[[Recording], str]) -> Units:
    """Windows of `length` samples with the features of `extract_features` of every channel, as ``"usual"``."""
    windows = cut_windows(recordings, length=length, allow_partial_revolution=True)
    features = extract_features(windows).values
    groups = {recording.recording_id: group(recording) for recording in recordings}
    group_of_window = np.array([groups[name] for name in windows.recording_id.tolist()])
    return Units(windows.label, windows.recording_id, group_of_window, group_of_window, {"usual": features})


def units_of(
    recordings: Sequence[Recording],
    group: Callable[[Recording], str],
    inner: Callable[[Recording], str],
    features: dict[str, np.ndarray],
    pieces: int = 1,
) -> Units:
    """Units of recordings, each of which gave `pieces` rows of each of `features`, one after the other."""
    spread = [recording for recording in recordings for _ in range(pieces)]
    return Units(
        label=np.array([recording.label for recording in spread]),
        recording=np.array([recording.recording_id for recording in spread]),
        group=np.array([group(recording) for recording in spread]),
        inner=np.array([inner(recording) for recording in spread]),
        features=features,
    )


@dataclass(frozen=True)
class Setting:
    """One way to tell the classes apart."""

    features: str
    """Name of the features."""
    estimator: str
    """Name of the classifier (`ESTIMATORS`)."""

    def __str__(self) -> str:
        return f"{self.features} / {self.estimator}"


@dataclass(frozen=True)
class Fold:
    """Groups on either side."""

    name: str
    """What is tested."""
    train: frozenset[str]
    """Groups to learn from."""
    test: frozenset[str]
    """Groups to test on."""

    def sides(self, group: Shaped[np.ndarray, " unit"]) -> tuple[Bool[np.ndarray, " unit"], Bool[np.ndarray, " unit"]]:
        """(training units, test units)."""
        return np.isin(group, sorted(self.train)), np.isin(group, sorted(self.test))


@dataclass(frozen=True, eq=False)
class Split:
    """Recordings of one public set, dealt so that groups stay apart."""

    name: str
    """Its name, such as ``"cwru/size"``."""
    recordings: tuple[Recording, ...]
    """Recordings of either side."""
    group: Callable[[Recording], str]
    """Group of a recording."""
    folds: tuple[Fold, ...]
    """Every pair of sides."""


@dataclass(frozen=True, eq=False)
class Question:
    """One honest split of one public set."""

    split: str
    """Its name, such as ``"cwru/size"``."""
    units: Units
    """Units with the features that are meant to carry over."""
    settings: tuple[Setting, ...]
    """What is chosen from, within each training side."""
    folds: tuple[Fold, ...]
    """Every pair of sides."""
    windows: Units
    """Units as they are usually cut, with the usual features, for the extra trees (``"usual"``)."""
