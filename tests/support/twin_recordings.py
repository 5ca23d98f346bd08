"""Recordings of a twin whose values are known."""

from dataclasses import replace
from typing import Any

import numpy as np

from swashtwin.calibration import Nuisances, Objective
from swashtwin.physics import Twin
from swashtwin.pump import Interfaces
from swashtwin.recordings import Recording
from swashtwin.signals import add_noise

DAMPER = np.array([1, 1, 1.6, 0.7, 2.5, 1])
"""Truth over nominal: C_v, K_v and C_Hz are off."""
SIX_VALUES: dict[str, Any] = {"nuisances": Nuisances(), "phases": False}
"""Settings of a calibration of the six values alone, from amplitudes, as in the paper."""


def recording_of(
    twin: Twin, factors: np.ndarray = DAMPER, *, seed: int = 0, snr_db: float = 30.0
) -> Recording:
    """Noisy recording of 1.3 s of the twin with its values times `factors`."""
    true = twin.with_interfaces(Interfaces.from_values(twin.values.numpy() * factors))
    recording = true.simulate(1.3, 6400.0, phase=1.0 + seed, recording_id=f"rec-{seed}")
    return replace(recording, signal=add_noise(recording.signal, snr_db, seed))


def with_amplitudes(objective: Objective, amplitudes: np.ndarray) -> Objective:
    """The objective of one comparison without phases, with `amplitudes` as the measured ones."""
    (comparison,) = objective.comparisons
    measurement = replace(
        comparison.measurement, amplitude=amplitudes.reshape(comparison.measured.shape)
    )
    return replace(objective, comparisons=(replace(comparison, measurement=measurement),))
