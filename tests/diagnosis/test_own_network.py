"""A user's `nn.Module` is registered, trained, saved, loaded and used without a change here."""

import numpy as np
import pytest
from torch import nn

from swashtwin import FaultClassifier, register_network
from swashtwin.diagnosis import load_classifier
from swashtwin.foundation import ArtifactError, InputError
from swashtwin.learning import NETWORKS, build_network, network_class
from swashtwin.recordings import Recording


class Convolution(nn.Module):
    """A plain module: convolution, mean power over time, linear layer."""

    def __init__(self, n_channels: int, n_classes: int, length: int, width: int = 6) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(n_channels, width, min(31, length))
        self.linear = nn.Linear(width, n_classes)

    def forward(self, windows):
        return self.linear(self.convolution(windows).square().mean(dim=-1))


def recordings(tag: str) -> list[Recording]:
    measured = []
    for index, label in enumerate(("normal", "piston")):
        for number in range(3):
            draw = np.random.default_rng([index, number, *tag.encode()])
            phase = 2 * np.pi * (0.05 + 0.1 * index) * np.arange(640) + draw.uniform(0, 6)
            signal = np.sin(phase) + 0.3 * draw.normal(size=640)
            measured.append(Recording(signal[None], 1000.0, f"{tag} {label} {number}", label=label))

    return measured


@pytest.fixture
def registered():
    """The registry as it is, restored after the test."""
    original_networks = dict(NETWORKS)
    yield
    NETWORKS.clear()
    NETWORKS.update(original_networks)


def test_a_registered_module_is_trained_saved_and_loaded_and_refused_if_not_registered(
    registered, tmp_path
):
    register_network("convolution", Convolution)
    classifier = FaultClassifier(
        "convolution",
        window=128,
        epochs=40,
        learning_rate=0.01,
        network_settings={"width": 8},
    ).fit(recordings("train"))
    new = recordings("new")

    assert classifier.score(new) == 1

    path = classifier.save(tmp_path / "own.safetensors")
    loaded = FaultClassifier.load(path)

    np.testing.assert_array_equal(loaded.predict_proba(new), classifier.predict_proba(new))
    assert loaded.get_params()["network_settings"] == {"width": 8}
    assert loaded.diagnose(new[4]).label == "piston"

    del NETWORKS["convolution"]
    with pytest.raises(ArtifactError, match=r"not registered here; register the same network"):
        load_classifier(path)

    register_network(
        "convolution",
        lambda n_channels, n_classes, length: Convolution(n_channels, n_classes, length),
    )

    with pytest.raises(ArtifactError, match="does not fit"):  # another width
        load_classifier(path)


def test_an_entry_point_registers_a_network_for_the_command_line(registered, monkeypatch):
    class EntryPoint:
        def load(self):
            return Convolution

    monkeypatch.setattr(
        "swashtwin.learning.networks.registry.entry_points",
        lambda group, name: [EntryPoint()],
    )

    assert build_network("from_a_package", 2, 3, length=64).n_classes == 3


def test_wrong_registrations_and_wrong_modules_are_refused(registered):
    with pytest.raises(InputError, match="'bitcn' belongs to a network of swashtwin"):
        register_network("bitcn", Convolution)
    with pytest.raises(InputError, match="a name that is not empty"):
        register_network("", Convolution)
    with pytest.raises(InputError, match=r"BiTCN\.name is 'bitcn'"):
        register_network("mine", network_class("bitcn"))
    with pytest.raises(
        InputError, match=r"takes \(n_channels, depth\): too many positional arguments"
    ):
        register_network("short", lambda n_channels, depth: nn.Flatten())

    register_network("number", lambda n_channels, n_classes, length: 7)
    with pytest.raises(InputError, match=r"was built as a int; it must be an nn\.Module"):
        build_network("number", 1, 2, length=64)
    with pytest.raises(InputError, match="specify that length"):
        build_network("number", 1, 2)

    register_network("flat", lambda n_channels, n_classes, length: nn.Flatten())
    with pytest.raises(InputError, match="'flat' has no weight to train"):
        build_network("flat", 1, 2, length=64)

    register_network(
        "steps",
        lambda n_channels, n_classes, length: nn.Conv1d(n_channels, n_classes, 3),
    )

    with pytest.raises(
        InputError,
        match=r"gives the shape \(\d+, 2, 126\) .*one score per class, \(\d+, 2\)",
    ):
        FaultClassifier("steps", window=128, epochs=1).fit(recordings("train"))

    register_network("convolution", Convolution)
    with pytest.raises(InputError, match="has no setting 'depth'; it has width"):
        build_network("convolution", 1, 2, length=64, depth=3)
