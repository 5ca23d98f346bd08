"""Pump with a throttled suction, one speed held out: the motor's slip says how much the pump still delivers."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from joblib import delayed

from swashtwin.foundation import parallel, parse
from swashtwin.learning import band_energies
from swashtwin.recordings import Recording
from swashtwin.signals import order_spectrum
from swashtwin_bench.public.motor_slip import motor_slip
from swashtwin_bench.public.question import Fold, Question, Setting, Split, units_of, usual_windows

_WINDOW = 3281
_ORDERS = np.array([1, 2, 3, 6, 12, 18])
"""Lines compared with the rest of the signal; the pump has six vanes, as its strongest line says."""


def cavitation_splits(recordings: Sequence[Recording]) -> list[Split]:
    """The split ``pump_cavitation/speed``: each nominal speed in turn."""
    speeds = sorted({_speed(recording) for recording in recordings}, key=lambda text: parse(text, "rad/s"))
    folds = tuple(Fold(speed, frozenset(speeds) - {speed}, frozenset({speed})) for speed in speeds)
    return [Split("pump_cavitation/speed", tuple(recordings), _speed, folds)]


def cavitation_questions(recordings: Sequence[Recording], jobs: int) -> list[Question]:
    """The question ``pump_cavitation/speed``."""
    (split,) = cavitation_splits(recordings)
    described = parallel(jobs)(delayed(_slip_and_shape)(recording) for recording in recordings)
    slip, shape = np.array([pair[0] for pair in described])[:, None], np.array([pair[1] for pair in described])
    features = {"load by slip": slip, "shape of spectrum": shape, "both": np.concatenate([slip, shape], axis=1)}
    units = units_of(recordings, _speed, _speed, features)
    estimators = ("linear discriminant", "logistic 1", "extra trees")
    settings = [Setting("load by slip", name) for name in estimators]
    settings += [
        Setting(name, est) for name in ("shape of spectrum", "both") for est in ("logistic 0.1", "extra trees")
    ]
    windows = usual_windows(recordings, _WINDOW, _speed)
    return [Question(split.name, units, tuple(settings), split.folds, windows)]


def _speed(recording: Recording) -> str:
    return recording.attributes["speed_nominal"]


def _slip_and_shape(recording: Recording) -> tuple[float, Float[np.ndarray, " feature"]]:
    """(load coefficient by slip [1e-6 s/rad], lines and bands relative to each channel's whole power)."""
    slip = motor_slip(recording.signal, recording.sample_rate, parse(_speed(recording), "rad/s"))
    shaft = slip.speed / (2 * np.pi)
    lines = order_spectrum(recording.signal, recording.sample_rate, shaft, _ORDERS).amplitude
    power = recording.signal.var(axis=1, keepdims=True)
    relative = np.log10(np.maximum(lines**2 / power, 1e-6))
    bands = band_energies(recording.signal, 12) - np.log10(power)
    return 1e6 * slip.load_coefficient, np.concatenate([relative, bands], axis=1).ravel()
