"""The epochs of trainings under way are counted from their checkpoints."""

import threading
from pathlib import Path

import pytest
from tiny_case import tiny_recordings

from swashtwin_bench.studies import epochs
from swashtwin_bench.studies.epochs import epochs_shown
from swashtwin.learning import BiTCN, TrainingSettings, checkpoint_epochs, cut_windows, fit


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training that was interrupted after two epochs."""
    windows = cut_windows(list(tiny_recordings()), length=2048, stride=8192)
    file = tmp_path_factory.mktemp("run") / "training.safetensors"
    network = BiTCN(windows.n_channels, len(windows.classes), channels=(4,), stride=32)
    fit(network, windows, settings=TrainingSettings(epochs=2), checkpoint=file)
    return file


def test_a_checkpoint_says_how_many_epochs_it_holds(checkpoint: Path) -> None:
    assert checkpoint_epochs(checkpoint) == 2


def test_epochs_are_counted_of_running_finished_and_waiting_trainings(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(epochs, "PAUSE", 0.001)
    running, finished, damaged = (tmp_path / name for name in ("running", "finished", "damaged"))
    running.write_bytes(checkpoint.read_bytes())
    damaged.write_text("half")
    reports: list[tuple[str, int, int]] = []
    signal = threading.Event()

    def report(*count: object) -> None:
        reports.append(count)  # type: ignore[arg-type]
        signal.set()

    trainings = {running: 5, finished: 7, damaged: 3, tmp_path / "waiting": 3}
    with epochs_shown(trainings, finished.__eq__, report):
        assert signal.wait(20)
        running.unlink()  # the training ended, and is tested
        signal.clear()
        assert signal.wait(20)
    assert set(reports) == {("epochs", 9, 18)}
    count = len(reports)
    with epochs_shown({}, finished.__eq__, report):
        pass
    assert len(reports) == count
