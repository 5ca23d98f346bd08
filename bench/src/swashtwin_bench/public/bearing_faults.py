"""CWRU bearings, other fault sizes or the other end: which defect order stands out of the envelope."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from joblib import delayed

from swashtwin.foundation import DataError, parallel
from swashtwin.recordings import Recording, stated_speed
from swashtwin.signals import BEARINGS, SEATS, defect_prominences, prewhitened
from swashtwin_bench.public.question import Fold, Question, Setting, Split, units_of, usual_windows

_WINDOW, _RATE = 2048, 12000.0
_SIZES = ("7", "14", "21")
_STRETCH, _STRETCHES = 5.0, 4
"""Length [s] and number of the overlapping stretches of a recording."""
_BEARING = {"DE": "SKF 6205", "FE": "SKF 6203"}
_BANDS = {
    "whole": ((50.0, 5900.0),),
    "octaves": ((250.0, 750.0), (750.0, 1500.0), (1500.0, 3000.0), (3000.0, 4500.0), (4500.0, 5900.0)),
    "kurtogram": None,
}
_ESTIMATORS = ("shared weights 0.01", "shared weights 0.1", "shared weights 1")


def bearing_splits(recordings: Sequence[Recording]) -> list[Split]:
    """The splits ``cwru/size`` (drive end, each size in turn) and ``cwru/drive_to_fan``."""
    selected = tuple(recording for recording in recordings if _is_selected(recording))
    if not selected:
        raise DataError("the CWRU folder holds no recording at 12 kHz with a fault of 7, 14 or 21 mil.")
    drive, fan = (frozenset(f"{end} {size}" for size in _SIZES) for end in ("DE", "FE"))
    sizes = tuple(Fold(f"{size} mil", drive - {f"DE {size}"}, frozenset({f"DE {size}"})) for size in _SIZES)
    ends = (Fold("fan end", drive, fan),)
    return [Split(f"cwru/{name}", selected, _group, folds) for name, folds in (("size", sizes), ("drive_to_fan", ends))]


def bearing_questions(recordings: Sequence[Recording], jobs: int) -> list[Question]:
    """The questions ``cwru/size`` (drive end) and ``cwru/drive_to_fan``."""
    splits = bearing_splits(recordings)
    selected = splits[0].recordings
    described = parallel(jobs)(delayed(_features_of)(recording) for recording in selected)
    features = {name: np.concatenate([table[name] for table in described]) for name in described[0]}
    units = units_of(selected, _group, lambda recording: recording.attributes["fault_size_mil"], features, _STRETCHES)
    windows = usual_windows(selected, _WINDOW, _group)
    settings = tuple(Setting(name, estimator) for name in features for estimator in _ESTIMATORS)
    return [Question(split.name, units, settings, split.folds, windows) for split in splits]


def _is_selected(recording: Recording) -> bool:
    facts = recording.attributes
    opposite = recording.label == "outer_race" and facts["end"] == "DE" and facts["or_position"] != "6"
    return (
        recording.label in SEATS
        and recording.sample_rate == _RATE
        and facts["fault_size_mil"] in _SIZES
        and not opposite
    )


def _group(recording: Recording) -> str:
    return f"{recording.attributes['end']} {recording.attributes['fault_size_mil']}"


def _features_of(recording: Recording) -> dict[str, Float[np.ndarray, "stretch feature"]]:
    """For each way of taking the envelope: greatest and mean prominence over the bands, seat after seat."""
    shaft, orders = stated_speed(recording), BEARINGS[_BEARING[recording.attributes["end"]]]
    length = round(_STRETCH * recording.sample_rate)
    count = recording.signal.shape[1]
    if shaft is None or count < length:
        raise DataError(f"{recording.recording_id} must state its speed and last {_STRETCH:g} s.")
    starts = np.linspace(0, count - length, _STRETCHES).astype(int)
    features: dict[str, list[np.ndarray]] = {}
    for start in starts:
        stretch = recording.signal[:, start : start + length]
        for whitened, signal in (("as measured", stretch), ("prewhitened", prewhitened(stretch))):
            for name, bands in _BANDS.items():
                measures = defect_prominences(signal[0], recording.sample_rate, shaft, orders, bands)
                parts = [measures.max(axis=0)] if len(measures) == 1 else [measures.max(axis=0), measures.mean(axis=0)]
                features.setdefault(f"{name}, {whitened}", []).append(np.concatenate(parts, axis=1).ravel())
    return {name: np.array(rows) for name, rows in features.items()}
