"""Candidates that training chooses from."""

from dataclasses import dataclass

import numpy as np

from swashtwin.learning.networks.band_power_network import BandPowerNetwork
from swashtwin.learning.networks.feature_network import FeatureNetwork
from swashtwin.learning.networks.line_prominence_network import LineProminenceNetwork
from swashtwin.learning.training.training_settings import TrainingSettings
from swashtwin.learning.windows.window_set import WindowSet

DISTURBED_TRAINING = TrainingSettings(
    epochs=4,
    normalization="set",
    noise_snr=-2.5,
    noise_kinds=("white", "pink", "hum"),
    noise_share=1.0,
    gain=12.0,
    stretch=0.02,
)
"""Training on the windows and four disturbed copies: noise down to -2.5 dB on every window, gains
up to 12 dB per channel on half of the windows, and speed changes up to 2 % on half of them.
"""


@dataclass(frozen=True)
class Candidate:
    """An untrained network with both heads, which is trained by `DISTURBED_TRAINING`."""

    name: str
    """``band_shapes``, ``band_powers`` or ``line_prominences``."""

    @property
    def features(self) -> str:
        """What its features are measured by: candidates with the same name share them."""
        return "line_prominences" if self.name == "line_prominences" else "band_powers"

    def network(self, windows: WindowSet) -> FeatureNetwork:
        """Return its untrained network for windows."""
        n_channels = windows.n_channels
        n_classes = len(windows.classes)
        if self.name != "line_prominences":
            shape = self.name == "band_shapes"
            return BandPowerNetwork(n_channels, n_classes, shape=shape)

        turns = windows.turns_per_sample
        # Orders need every speed, and a whole turn in each window.
        if not np.isfinite(turns).all() or turns.min() * windows.length < 1:
            return LineProminenceNetwork(n_channels, n_classes)
        median_turns = float(np.median(turns))
        return LineProminenceNetwork(n_channels, n_classes, axis="order", turns=median_turns)


CANDIDATES = (
    Candidate("band_shapes"),
    Candidate("band_powers"),
    Candidate("line_prominences"),
)
"""The candidates; of the first two the more invariant one stands first.

Prominences of lines are for rolling bearings and motors. They stand last, so that they are not
chosen by a tie.

There are three because a trial among many chooses by chance. That happened with 24 kinds (lines at
orders or in hertz, trained clean or disturbed, by each head or both) on two training pumps, and on
four bearings. On rig fleets 100 and 101 of version 2 the choice among 24 classified 0.67 and 0.64
of the recordings of new pumps right, the first two 0.66 to 0.67 and 0.82 to 0.83.
"""
