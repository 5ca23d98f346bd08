"""Test recordings as a plant would give them: with noise, other gains, another speed."""

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
    """One change of whole recordings, before windows are cut from them."""

    kind: NoiseKind | Literal["gain", "speed"]
    """Spectrum of noise (`add_noise`); ``"gain"``: each channel louder or quieter, uniform in dB;
    ``"speed"``: time stretched, uniform, while the stated speed stays.
    """
    size: float
    """Signal-to-noise ratio of noise [dB]; largest gain and loss [dB]; largest relative change of
    speed.
    """

    def __str__(self) -> str:
        """Name of its row.

        Examples
        --------
        >>> [str(Perturbation(*each)) for each in (("white", 5.0), ("hum", 0.0), ("gain", 12.0), ("speed", 0.02))]
        ['5 dB', 'hum 0 dB', 'gain 12 dB', 'speed 2 %']
        """
        if self.kind == "speed":
            return f"speed {100 * self.size:g} %"
        return f"{'' if self.kind == 'white' else f'{self.kind} '}{self.size:g} dB"

    def of_recording(self, recording: Recording, repeat: int) -> Recording:
        """The recording so changed; what is drawn is drawn by recording, size and repeat."""
        signal, name = recording.signal, recording.recording_id
        rng, window = (
            random_stream(repeat, self.kind, self.size, name),
            signal[None].astype(np.float32),
        )
        if self.kind == "gain":
            changed = with_gains(window, self.size, rng)[0]
        elif self.kind == "speed":
            changed = with_speed_changes(window, self.size, rng)[0]
        else:
            changed = add_noise(
                signal, self.size, repeat, name, kind=self.kind, sample_rate=recording.sample_rate
            )
        return recording.replace(signal=changed)

    def of_test(self, dataset: StudyDataset, split: str, repeat: int) -> WindowSet:
        """The test windows of a split, cut from recordings so changed (docs/explanation/method.md,
        "Noise").
        """
        changed = [
            self.of_recording(recording, repeat) for recording in dataset.test_recordings[split]
        ]
        return cut_again(changed, dataset.tests[split])


def noises(kind: NoiseKind, *snrs: float) -> tuple[Perturbation, ...]:
    """Noise of one spectrum at several signal-to-noise ratios [dB]."""
    return tuple(Perturbation(kind, snr) for snr in snrs)
