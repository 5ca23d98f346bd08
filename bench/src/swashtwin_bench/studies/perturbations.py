"""Test recordings as in a plant: with noise, other gains, another speed."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from swashtwin.foundation import random_stream
from swashtwin.learning import WindowSet, with_gains, with_speed_changes
from swashtwin.recordings import Recording
from swashtwin.signals import NoiseKind, add_noise
from swashtwin_bench.studies.dataset import StudyDataset, cut_again


@dataclass(frozen=True)
class Perturbation:
    """A change of whole recordings, before windows are cut."""

    kind: NoiseKind | Literal["gain", "speed"]
    """Spectrum of noise (`add_noise`); ``"gain"``: each channel louder or quieter, uniform in dB;
    ``"speed"``: time stretched, uniform, while the specified speed stays.
    """
    size: float
    """Signal-to-noise ratio of noise [dB]; largest gain and loss [dB]; largest relative change of
    speed.
    """

    def __str__(self) -> str:
        """Return the name of its row.

        Examples
        --------
        >>> str(Perturbation("white", 5.0)), str(Perturbation("hum", 0.0))
        ('5 dB', 'hum 0 dB')
        >>> str(Perturbation("gain", 12.0)), str(Perturbation("speed", 0.02))
        ('gain 12 dB', 'speed 2 %')
        """
        if self.kind == "speed":
            return f"speed {100 * self.size:g} %"
        if self.kind == "white":
            return f"{self.size:g} dB"
        return f"{self.kind} {self.size:g} dB"

    def of_recording(self, recording: Recording, repeat: int) -> Recording:
        """Return the changed recording; draws are seeded by recording, kind, size and repeat."""
        signal = recording.signal
        name = recording.recording_id
        rng = random_stream(repeat, self.kind, self.size, name)

        if self.kind == "gain":
            changed = with_gains(signal[None].astype(np.float32), self.size, rng)[0]
        elif self.kind == "speed":
            changed = with_speed_changes(signal[None].astype(np.float32), self.size, rng)[0]
        else:
            changed = add_noise(
                signal, self.size, repeat, name, kind=self.kind, sample_rate=recording.sample_rate
            )
        return recording.replace(signal=changed)

    def of_test(self, dataset: StudyDataset, split: str, repeat: int) -> WindowSet:
        """Return the test windows of a split, cut from the changed recordings.

        See docs/explanation/method.md, "Noise".
        """
        changed = [
            self.of_recording(recording, repeat) for recording in dataset.test_recordings[split]
        ]
        return cut_again(changed, dataset.tests[split])


def noises(kind: NoiseKind, *snrs: float) -> tuple[Perturbation, ...]:
    """Return noise of one spectrum at several signal-to-noise ratios [dB]."""
    return tuple(Perturbation(kind, snr) for snr in snrs)
