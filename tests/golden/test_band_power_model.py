"""A saved network on levels answers as it did where torch computed it."""

from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from swashtwin.foundation import MPa
from swashtwin.learning import BandPowerNetwork, Normalization, WindowSet, cut_windows
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

MODEL = Path(__file__).parent / "band_power_model.safetensors"
UNDER_TORCH = [
    [0.712662822, 0.160486053, 0.126851124],
    [0.159156257, 0.710402119, 0.130441624],
    [0.114230297, 0.153797174, 0.731972529],
    [0.681286811, 0.176403961, 0.142309228],
    [0.092985174, 0.74040494, 0.166609885],
    [0.197032768, 0.160464743, 0.642502488],
    [0.81893851, 0.124224815, 0.056836675],
    [0.181628768, 0.733828716, 0.084542516],
    [0.141273732, 0.135556686, 0.723169582],
    [0.774529572, 0.15770524, 0.067765188],
    [0.119370737, 0.785697087, 0.094932177],
    [0.122762358, 0.150230238, 0.727007404],
]
"""Probabilities of every eighth window."""


def windows() -> WindowSet:
    """Windows at two speeds, with a line of their class at order 9 or 4."""
    draw = np.random.default_rng(11)
    time = np.arange(8 * 512)
    recordings = []

    for number in range(12):
        turns = 0.02 * (1 + 0.1 * (number % 2))
        signal = draw.normal(size=(2, time.size)) * [[1.0], [2.0]]
        for channel, (order, loud) in enumerate(
            ((9, 0.6 * (number % 3 == 1)), (4, 0.8 * (number % 3 == 2)))
        ):
            signal[channel] += (1 + loud) * np.cos(
                2 * np.pi * turns * order * time + draw.uniform(0, 6)
            )

        condition = OperatingCondition(speed=2 * np.pi * turns * 1000, discharge_pressure=MPa(15))
        recordings.append(
            Recording(signal, 1000.0, f"r{number}", condition=condition, channels=("x", "y"))
        )

    return cut_windows(recordings, length=512, classes=("normal", "piston", "valve_plate"))


def test_a_saved_network_on_levels_answers_as_under_torch() -> None:
    arrays = load_file(MODEL)
    scaling = Normalization(
        "set", arrays.pop("normalization.mean"), arrays.pop("normalization.deviation")
    )
    network = BandPowerNetwork(2, 3, axis="order", shape=True, turns=0.02, hidden=8).loaded(arrays)
    answer = network.probabilities(scaling.apply(windows()), windows().turns_per_sample)[::8]

    np.testing.assert_allclose(answer, UNDER_TORCH, rtol=0, atol=1e-6)
