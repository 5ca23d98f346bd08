"""Training learns, repeats itself bit for bit (also after an interrupt) and augments windows."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from global_state import global_state

from swashtwin.foundation import ArtifactError, DataError, InputError
from swashtwin.learning import (
    NOISE_SNR_RANGE_DB,
    BiTCN,
    FittedClassifier,
    Normalization,
    TrainingSettings,
    WindowSet,
    build_network,
    cut_windows,
    fit,
)
from swashtwin.learning.networks.registry import BUILT_IN
from swashtwin.learning.training import loop, steps
from swashtwin.learning.training.training_settings import (
    transform_windows,
    with_gains,
    with_speed_changes,
)
from swashtwin.recordings import Recording

CLASSES = ("normal", "piston")
SHORT = TrainingSettings(epochs=4, batch_size=8)


def tones(tag: str = "", *, per_class: int = 2, windows: int = 5, gain: float = 1.0) -> WindowSet:
    """Windows of two classes that differ in the frequency of one tone."""
    recordings = []
    for index, label in enumerate(CLASSES):
        for number in range(per_class):
            name = f"{tag}{label}-{number}"

            # seeded by the name, so that the same recording has the same samples in every set
            draw = np.random.default_rng(list(name.encode()))
            cycles_per_sample = 0.05 + 0.1 * index
            time = np.arange(64 * windows)
            phase = 2 * np.pi * cycles_per_sample * time + draw.uniform(0, 6)
            signal = gain * (np.sin(phase) + 0.3 * draw.normal(size=phase.size))
            recordings.append(Recording(signal[None], 1000.0, name, label=label))

    return cut_windows(recordings, length=64)


def small_network() -> BiTCN:
    return BiTCN(1, 2, channels=(8, 12), kernel_size=3)


def weights(classifier: FittedClassifier) -> dict[str, np.ndarray]:
    return classifier.network.weights


def have_same_bits(first: FittedClassifier, second: FittedClassifier) -> bool:
    if first.history != second.history:
        return False

    second_weights = weights(second)
    return all(np.array_equal(value, second_weights[key]) for key, value in weights(first).items())


def losses(classifier: FittedClassifier) -> list[float]:
    return [epoch.loss for epoch in classifier.history]


def test_training_in_16_bits_has_nearly_the_losses_of_32():
    exact = fit(small_network(), tones(), settings=replace(SHORT, precision="float32"))
    short = fit(small_network(), tones(), settings=replace(SHORT, precision="bfloat16"))

    assert losses(short) == pytest.approx(losses(exact), rel=0.05)
    assert short.history != exact.history
    assert {str(value.dtype) for value in weights(short).values()} <= {
        "float32",
        "int64",
    }
    assert "precision" not in SHORT.to_dict()
    assert short.settings.to_dict()["precision"] == "bfloat16"
    with pytest.raises(InputError, match=r"precision \(float8\) must be one of float32, bfloat16"):
        replace(SHORT, precision="float8")


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_every_network_trains_if_a_single_window_remains_for_the_last_batch(name):
    """The number of windows must not decide whether they can be learned: batch normalization has
    no deviation of one window.
    """
    signal = np.random.default_rng(0).normal(size=(1, 513 * 9))
    recordings = [Recording(signal, 1000.0, label, label=label) for label in CLASSES]
    windows = cut_windows(recordings, length=513)
    two_batches_and_one = windows.subset(np.arange(17))
    settings = TrainingSettings(epochs=1, batch_size=8)

    classifier = fit(build_network(name, 1, 2), two_batches_and_one, settings=settings)

    assert np.isfinite(classifier.history[0].loss)


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_every_network_overfits_twenty_windows(name):
    windows = tones()
    assert len(windows) == 20

    # shuffled labels have no pattern: only a network that can memorize fits them
    shuffled = np.random.default_rng(0).permutation(windows.target)
    windows = replace(windows, target=shuffled)
    settings = TrainingSettings(epochs=80, batch_size=20, learning_rate=3e-3)
    smaller = {}
    if name.startswith("bitcn"):
        smaller = {"channels": (16, 24, 24), "dropout": 0.0}

    classifier = fit(build_network(name, 1, 2, **smaller), windows, settings=settings)

    assert (classifier.predict_proba(windows).argmax(axis=1) == windows.target).all()

    initial_loss = math.log(2)  # of two classes without knowledge
    if name == "bitcn":
        initial_loss = classifier.history[0].loss
    assert classifier.history[-1].loss < 0.4 * initial_loss


def test_only_the_same_seed_gives_the_same_bits():
    first, second, third = (
        fit(small_network(), tones(), settings=SHORT, seed=seed) for seed in (3, 3, 4)
    )
    assert have_same_bits(first, second)
    assert not have_same_bits(first, third)


def test_training_changes_neither_the_given_network_nor_the_callers_random_state():
    network = small_network()
    original = {key: value.clone() for key, value in network.state_dict().items()}
    torch.manual_seed(1)
    expected = torch.rand(2)
    torch.manual_seed(1)
    fit(network, tones(), settings=SHORT)

    assert torch.equal(torch.rand(2), expected)
    assert all(torch.equal(value, network.state_dict()[key]) for key, value in original.items())


@pytest.mark.parametrize(
    "change",
    [
        {"class_weights": True},
        {"noise_snr": 0.0},
        {"gain": 3.0, "stretch": 0.02, "normalization": "set"},
    ],
)
def test_a_resumed_run_has_the_bits_of_an_uninterrupted_one(tmp_path, change):
    settings = replace(SHORT, **change)
    whole = fit(small_network(), tones(), settings=settings, seed=1)

    def interrupt(epoch) -> None:
        if epoch.number == 2:
            raise KeyboardInterrupt

    run = {"settings": settings, "seed": 1, "checkpoint": tmp_path / "run.safetensors"}
    with pytest.raises(KeyboardInterrupt):
        fit(small_network(), tones(), progress=interrupt, **run)

    resumed_epochs = []
    resumed = fit(
        small_network(),
        tones(),
        resume=True,
        progress=lambda epoch: resumed_epochs.append(epoch.number),
        **run,
    )

    assert resumed_epochs == [3, 4]
    assert have_same_bits(whole, resumed)
    assert have_same_bits(whole, fit(small_network(), tones(), resume=True, **run))
    assert [path.name for path in tmp_path.iterdir()] == ["run.safetensors"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"settings": replace(SHORT, batch_size=9)}, "batch_size was 8, now 9"),
        ({"seed": 7}, "seed was 0, now 7"),
        (
            {"network": BiTCN(1, 2, channels=(8, 8), kernel_size=3)},
            "network's channels",
        ),
        ({"windows": tones("other")}, "manifest"),
        ({"manifest": ["calibration 1"]}, "manifest"),
    ],
)
def test_a_checkpoint_of_another_run_is_refused_with_what_differs(tmp_path, change, message):
    run = {
        "network": small_network(),
        "windows": tones(),
        "settings": SHORT,
        "checkpoint": tmp_path / "run.safetensors",
    }
    fit(**run)

    with pytest.raises(InputError, match=message) as caught:
        fit(**{**run, **change}, resume=True)
    assert "\n" not in str(caught.value)


def test_a_checkpoint_that_is_not_resumed_or_missing_or_damaged_is_an_error(tmp_path):
    path = tmp_path / "run.safetensors"
    fit(small_network(), tones(), settings=SHORT, checkpoint=path, resume=True)

    with pytest.raises(InputError, match="Set resume=True"):
        fit(small_network(), tones(), settings=SHORT, checkpoint=path)
    with pytest.raises(InputError, match="needs a checkpoint"):
        fit(small_network(), tones(), settings=SHORT, resume=True)

    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(ArtifactError, match="damaged"):
        fit(small_network(), tones(), settings=SHORT, checkpoint=path, resume=True)


def test_a_full_disk_leaves_the_checkpoint_of_the_previous_epoch(tmp_path, monkeypatch):
    path = tmp_path / "run.safetensors"
    writes = []

    import swashtwin.foundation.artifacts as artifacts

    save_file = artifacts.save_file

    def fail_at_the_third_write(tensors, target, metadata) -> None:
        writes.append(target)
        Path(target).write_bytes(b"half")
        if len(writes) == 3:
            raise OSError(28, "No space left on device")
        save_file(tensors, target, metadata=metadata)

    monkeypatch.setattr(artifacts, "save_file", fail_at_the_third_write)

    with pytest.raises(OSError, match="No space left"):
        fit(small_network(), tones(), settings=SHORT, checkpoint=path)

    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == [path]

    resumed_epochs = []
    fit(
        small_network(),
        tones(),
        settings=SHORT,
        checkpoint=path,
        resume=True,
        progress=lambda epoch: resumed_epochs.append(epoch.number),
    )

    assert resumed_epochs == [3, 4]


def test_the_manifest_names_training_and_calibration_recordings():
    network = build_network("band_powers", 1, 2)
    classifier = fit(network, tones(), settings=SHORT, manifest=["rec 9"])

    expected = ["normal-0", "normal-1", "piston-0", "piston-1", "rec 9"]
    assert list(classifier.manifest) == expected


def test_a_class_without_windows_an_unlabeled_window_and_an_empty_set_are_refused():
    windows = tones()
    with pytest.raises(DataError, match="class piston has no training window"):
        fit(small_network(), windows.subset(windows.target == 0), settings=SHORT)
    with pytest.raises(DataError, match="has no label"):
        fit(
            small_network(),
            replace(windows, target=windows.target * 0 - 1),
            settings=SHORT,
        )
    with pytest.raises(DataError, match="no window"):
        fit(
            small_network(),
            windows.subset(np.array([], dtype=np.int64)),
            settings=SHORT,
        )
    with pytest.raises(InputError, match=r"takes 2 channel\(s\) and 2 classes"):
        fit(BiTCN(2, 2), windows, settings=SHORT)


def test_a_diverging_loss_is_an_error_that_names_the_epoch():
    with pytest.raises(InputError, match="in epoch 1: the learning rate is too high"):
        fit(small_network(), tones(), settings=replace(SHORT, learning_rate=1e30))


def test_class_weights_let_each_class_count_the_same():
    windows = tones(windows=10)
    normal_rows = np.flatnonzero(windows.target == 0)
    piston_rows = np.flatnonzero(windows.target == 1)[:5]
    few = windows.subset(np.r_[normal_rows, piston_rows])
    network = build_network("bitcn", 1, 2, channels=(2,), dropout=0.0)
    first_losses = {
        fit(network, few, settings=replace(SHORT, class_weights=on)).history[0].loss
        for on in (True, False)
    }

    assert len(first_losses) == 2

    # 20 normal and 5 piston windows: each class weighs half of the 25
    class_counts = torch.bincount(torch.as_tensor(few.target))
    assert (class_counts * loop._class_weights(few, "cpu")).tolist() == [12.5, 12.5]


def test_only_normalization_per_window_removes_the_gain():
    quiet = tones()
    loud = tones(gain=1000.0)

    for kind, axes in (("window", (1, 2)), ("set", None)):
        scaled = Normalization.fit(kind, loud).apply(loud).astype(float)
        np.testing.assert_allclose(scaled.mean(axis=axes), 0, atol=1e-5)
        np.testing.assert_allclose(scaled.std(axis=axes), 1, atol=1e-5)

    quiet_scaled = Normalization.fit("window", quiet).apply(quiet)
    loud_scaled = Normalization.fit("window", loud).apply(loud)
    np.testing.assert_allclose(quiet_scaled, loud_scaled, atol=1e-4)
    np.testing.assert_array_equal(Normalization.fit("none", loud).apply(loud), loud.signal)
    assert Normalization.fit("set", quiet).apply(loud).std() > 200, (
        "the scale is that of the training"
    )

    still = replace(quiet, signal=np.zeros_like(quiet.signal))
    for kind in ("window", "set"):
        assert not Normalization.fit(kind, still).apply(still).any()


def test_predictions_are_probabilities_names_and_features():
    windows = tones()
    classifier = fit(small_network(), windows, settings=SHORT)
    probability = classifier.predict_proba(windows)

    np.testing.assert_allclose(probability.sum(axis=1), 1)
    assert classifier.predict(windows).tolist() == [CLASSES[i] for i in probability.argmax(axis=1)]
    assert classifier.embed(windows).shape == (20, 12)

    assert classifier.layout.sample_rate == 1000.0
    assert classifier.layout.length == 64
    assert classifier.layout.channels == ("acceleration",)
    with pytest.raises(InputError, match="sample rate 1000 Hz against 2000 Hz"):
        classifier.predict_proba(replace(windows, sample_rate=2000.0))


def test_eight_parallel_trainings_have_the_bits_of_eight_single_ones():
    """A generator shared between threads once gave each of them other weights and dropout."""
    windows = tones(per_class=1, windows=2)
    settings = TrainingSettings(epochs=2, batch_size=4, noise_snr=5.0, normalization="set")

    def train(seed: int) -> FittedClassifier:
        return fit(
            BiTCN(1, 2, channels=(2,), dropout=0.3),
            windows,
            settings=settings,
            seed=seed,
        )

    with ThreadPoolExecutor(8) as threads:
        parallel = list(threads.map(train, range(8)))

    for seed in (0, 3, 7):
        assert have_same_bits(parallel[seed], train(seed))


def test_training_changes_no_global_state():
    original = global_state()
    classifier = fit(build_network("band_powers", 1, 2), tones(), settings=SHORT)
    classifier.predict_proba(tones())

    assert global_state() == original


NOISY = replace(SHORT, noise_snr=0.0, normalization="set")


def loud_tones(n_windows: int = 10) -> WindowSet:
    """Windows of two channels, the second a hundred times as loud and with a mean of 1,000."""
    time = np.arange(64 * n_windows)
    recordings = []
    for label, step in (("normal", 0.3), ("piston", 0.9)):
        signal = np.stack([np.sin(step * time), 100 * np.sin(step * time + 1) + 1e3])
        for number in range(2):
            name = f"{label}-{number}"
            recordings.append(Recording(signal, 1000.0, name, label=label, channels=("x", "y")))

    return cut_windows(recordings, length=64)


def test_half_the_windows_get_noise_of_the_set_ratios_on_every_channel():
    clean = loud_tones(500)
    original = clean.signal.copy()
    which, noisy = transform_windows(clean, replace(NOISY, noise_snr=5.0), 0, 1)

    assert 0.45 < len(which) / len(clean) < 0.55
    assert np.array_equal(noisy.start, clean.start[which])

    added = noisy.signal - clean.signal[which]
    ratio = 10 * np.log10(clean.signal[which].var(axis=-1) / added.var(axis=-1))

    # the variance of 64 samples is known to about a decibel
    assert 5.0 - 2 < ratio.min() < 7
    assert 3 + NOISE_SNR_RANGE_DB < ratio.max() < 7 + NOISE_SNR_RANGE_DB
    assert np.abs(np.median(ratio, axis=0) - (5 + NOISE_SNR_RANGE_DB / 2)).max() < 1

    # both channels of a window share one ratio
    assert np.abs(ratio[:, 0] - ratio[:, 1]).max() < 6
    assert np.array_equal(clean.signal, original)


def test_channels_have_independent_gains_up_to_the_maximum():
    clean = loud_tones(100).signal
    gained = with_gains(clean, 3.0, np.random.default_rng(0))
    gain = 20 * np.log10(gained.std(axis=-1) / clean.std(axis=-1))

    assert np.abs(gain).max() <= 3.0
    assert gain.min() < -2.8
    assert gain.max() > 2.8
    assert np.abs(np.corrcoef(gain.T)[0, 1]) < 0.2


def test_a_changed_shaft_speed_moves_every_line_by_the_same_factor():
    length = 4096
    line = 200
    phase = 2 * np.pi * line / length * np.arange(length)
    tone = np.sin(phase).astype(np.float32)
    windows = np.tile(tone, (200, 2, 1))

    stretched = with_speed_changes(windows, 0.05, np.random.default_rng(0))

    assert stretched.dtype == np.float32

    # the taper keeps leakage below the line, so that the maximum is the line
    spectrum = np.abs(np.fft.rfft(np.hanning(length) * stretched))
    shift = spectrum.argmax(axis=-1) / line - 1
    assert np.array_equal(shift[:, 0], shift[:, 1])  # both sensors sit on one shaft
    assert np.abs(shift).max() < 0.05 + 0.005  # half a frequency bin of tolerance
    assert shift.min() < -0.04
    assert shift.max() > 0.04
    assert np.abs(stretched).max() < 1.01

    still = with_speed_changes(np.tile(tone, (1, 1, 1)), 0.0, np.random.default_rng(0))
    assert np.allclose(still, tone, atol=1e-5)


def test_each_transform_changes_a_random_half_of_the_windows():
    clean = loud_tones(500)
    original = clean.signal.copy()
    every = replace(NOISY, noise_snr=40.0, gain=1.0, stretch=0.01)
    which, changed = transform_windows(clean, every, 0, 1)

    # each of three transforms leaves half of the windows, so that 7 of 8 change
    assert 0.83 < len(which) / len(clean) < 0.92
    assert (changed.signal != clean.signal[which]).any(axis=(1, 2)).all()
    assert np.array_equal(clean.signal, original)
    assert len(transform_windows(clean, replace(NOISY, noise_snr=None), 0, 1)[0]) == 0

    # which windows get noise does not depend on the other transforms
    noisy_rows = transform_windows(clean, NOISY, 0, 1)[0]
    assert set(noisy_rows.tolist()) <= set(which.tolist())
    assert not np.array_equal(noisy_rows, transform_windows(clean, NOISY, 0, 2)[0])

    few = clean.subset(np.arange(2))
    assert {len(transform_windows(few, every, 0, epoch)[0]) for epoch in range(100)} == {0, 1, 2}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"noise_snr": float("nan")},
            r"noise_snr \(nan\) must be a finite ratio in dB",
        ),
        ({"epochs": 0}, "epochs"),
        ({"batch_size": 1}, "batch_size"),
        ({"learning_rate": 0.0}, "learning_rate"),
        ({"gain": -1.0}, r"gain \(-1\) must be between 0 and 40 dB"),
        ({"gain": float("nan")}, r"gain \(nan\) must be between"),
        (
            {"stretch": 0.5},
            r"stretch \(0\.5\) must be between 0 and 0\.2; 0\.02 is 2 % of the speed",
        ),
        ({"stretch": float("nan")}, r"stretch \(nan\)"),
        ({"gain": 1.0, "normalization": "window"}, "gain would change nothing"),
    ],
)
def test_invalid_settings_are_refused(change: dict[str, Any], message: str):
    with pytest.raises(InputError, match=message):
        TrainingSettings(**change)


@pytest.fixture
def replays(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Let trainings on the processor replay their steps as on a GPU; the list counts the replays.

    A graph reads and writes the memory that it was captured with, so each replay must find all
    tensors at the addresses they had at capture.
    """
    replay_counts: list[int] = []

    def capture(step, generator):
        def tensor_addresses():
            training = step.__closure__[0].cell_contents
            tensors = [
                training._signal,
                training._target,
                training._batch,
                training._sums,
            ]
            tensors.extend(training.network.state_dict().values())
            tensors.extend(group["lr"] for group in training.optimizer.param_groups)
            for moments in training.optimizer.state.values():
                tensors.extend(moments.values())

            return [tensor.data_ptr() for tensor in tensors]

        for _ in range(3):
            step()

        captured = tensor_addresses()

        def replay():
            assert tensor_addresses() == captured
            replay_counts.append(1)
            step()

        return replay

    monkeypatch.setattr(loop, "is_replayed", lambda network, device: True)
    monkeypatch.setattr(steps, "capture", capture)
    return replay_counts


@pytest.mark.parametrize(
    "change", [{"decay": "cosine"}, {"noise_snr": 0.0, "normalization": "set"}]
)
def test_replayed_steps_learn_what_single_steps_learn(replays, change, monkeypatch):
    settings = replace(SHORT, **change)
    replayed = fit(small_network(), tones(), settings=settings)

    # 20 windows fill two batches of 8; the 4 remaining ones are never replayed
    assert len(replays) == 2 * settings.epochs

    monkeypatch.setattr(loop, "is_replayed", steps.is_replayed)
    single = fit(small_network(), tones(), settings=settings)

    assert losses(replayed) == pytest.approx(losses(single), rel=1e-4)
    np.testing.assert_allclose(
        replayed.predict_proba(tones()), single.predict_proba(tones()), atol=1e-3
    )


def test_a_resumed_run_of_replayed_steps_has_the_bits_of_an_uninterrupted_one(replays, tmp_path):
    def interrupt(epoch):
        if epoch.number == 2:
            raise KeyboardInterrupt

    whole = fit(small_network(), tones(), settings=SHORT)
    file = tmp_path / "training.safetensors"

    with pytest.raises(KeyboardInterrupt):
        fit(
            small_network(),
            tones(),
            settings=SHORT,
            checkpoint=file,
            progress=interrupt,
        )
    assert have_same_bits(
        whole,
        fit(small_network(), tones(), settings=SHORT, checkpoint=file, resume=True),
    )


def test_too_few_windows_for_a_batch_are_learned_without_a_replay(replays):
    fit(small_network(), tones(windows=1), settings=SHORT)
    assert not replays


def test_a_step_is_captured_after_a_warm_up_with_its_generator(monkeypatch):
    """torch prescribes this order for a capture; whether a GPU then replays it is for the tests
    that need one.
    """
    events: list[str] = []

    class Graph:
        def register_generator_state(self, generator):
            events.append("generator")

        def replay(self):
            events.append("replay")

    class Context:
        def __init__(self, name):
            self.name = name

        def __enter__(self):
            events.append(self.name)

        def __exit__(self, *error):
            events.append(f"end of {self.name}")

    class Stream:
        def wait_stream(self, stream):
            events.append("wait")

    parts = {
        "device": lambda device: Context("device"),
        "CUDAGraph": Graph,
        "Stream": Stream,
        "current_stream": Stream,
        "stream": lambda side: Context("side"),
        "graph": lambda graph, stream, capture_error_mode: Context("capture"),
    }
    for name, part in parts.items():
        monkeypatch.setattr(torch.cuda, name, part)

    steps.capture(lambda: events.append("step"), torch.Generator())()
    assert events == [
        "device", "generator", "wait", "side", "step", "step", "step", "end of side", "wait",
        "capture", "step", "end of capture", "end of device", "replay",
    ]  # fmt: skip


def test_only_a_network_that_can_be_captured_is_replayed_and_only_on_a_gpu():
    assert steps.is_replayed(small_network(), "cuda:1")
    assert not steps.is_replayed(small_network(), "cpu")
    assert not steps.is_replayed(build_network("tcn", 1, 2), "cuda")


ON_A_GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


@ON_A_GPU
@pytest.mark.parametrize(("precision", "tolerance"), [("float32", 0.01), ("bfloat16", 0.1)])
def test_a_gpu_learns_what_the_processor_learns(precision, tolerance):
    settings = replace(SHORT, precision=precision)
    network = BiTCN(1, 2, channels=(8, 12), kernel_size=3, dropout=0.0)

    on_gpu = fit(network, tones(), settings=settings, device="cuda")
    on_cpu = fit(network, tones(), settings=settings, device="cpu")

    assert losses(on_gpu) == pytest.approx(losses(on_cpu), rel=tolerance)
    np.testing.assert_allclose(
        on_gpu.predict_proba(tones()), on_cpu.predict_proba(tones()), atol=tolerance
    )


@ON_A_GPU
def test_a_gpu_repeats_the_same_bits_also_after_an_interrupt(tmp_path):
    def interrupt(epoch):
        raise KeyboardInterrupt

    whole = fit(small_network(), tones(), settings=SHORT, device="cuda")
    repeated = fit(small_network(), tones(), settings=SHORT, device="cuda")
    assert have_same_bits(whole, repeated)

    file = tmp_path / "training.safetensors"
    with pytest.raises(KeyboardInterrupt):
        fit(
            small_network(),
            tones(),
            settings=SHORT,
            device="cuda",
            checkpoint=file,
            progress=interrupt,
        )
    assert have_same_bits(
        whole,
        fit(
            small_network(),
            tones(),
            settings=SHORT,
            device="cuda",
            checkpoint=file,
            resume=True,
        ),
    )
