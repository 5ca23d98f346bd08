"""Candidates that training chooses from."""

from dataclasses import dataclass

from swashtwin.learning.networks.band_power_network import BandPowerNetwork
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
    """A `BandPowerNetwork` with lines in hertz and both heads, trained by `DISTURBED_TRAINING`."""

    shape: bool
    """Whether each channel's overall level is subtracted, so that no gain changes anything."""

    @property
    def name(self) -> str:
        """Its name in a table: ``band_shapes`` or ``band_powers``."""
        return "band_shapes" if self.shape else "band_powers"

    def network(self, windows: WindowSet) -> BandPowerNetwork:
        """Return its untrained network for windows."""
        return BandPowerNetwork(windows.n_channels, len(windows.classes), shape=self.shape)


CANDIDATES = (Candidate(shape=True), Candidate(shape=False))
"""The candidates, the more invariant one first.

There are only two because a trial among more chooses by chance. That happened with 24 kinds (lines
at orders or in hertz, trained clean or disturbed, by each head or both) on two training pumps, and
on four bearings. On rig fleets 100 and 101 of version 2 the choice among 24 classified 0.67 and
0.64 of the recordings of new pumps right, these two 0.66 to 0.67 and 0.82 to 0.83.
"""
