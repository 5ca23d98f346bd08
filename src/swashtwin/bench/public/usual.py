"""Units as they are usually cut and described: windows, statistics and logarithmic bands."""

from collections.abc import Callable, Sequence

import numpy as np

from swashtwin.bench.public.question import Units
from swashtwin.learning import cut_windows, extract_features
from swashtwin.recordings import Recording


def usual_windows(recordings: Sequence[Recording], length: int, group: Callable[[Recording], str]) -> Units:
    """Windows of `length` readings with the features of `extract_features` of every channel, as ``"usual"``."""
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
