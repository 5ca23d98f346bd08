"""Searches that are interrupted and go on."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, recording_of, worn_twin

from swashtwin.calibration import (
    CMAES,
    IPINN,
    PAPER_CALIBRATION,
    Calibration,
    DirectAdam,
    GaussNewton,
    ResumableCalibrator,
    calibrate,
)
from swashtwin.foundation import ArtifactError, InputError
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import Recording

METHODS = {
    "ipinn": IPINN(epochs=60, channels=(4, 8), learning_rate=0.01),
    "patient": IPINN.improved(epochs=60, channels=(4, 8), patience=30, learning_rate=0.3),
    "direct": DirectAdam(epochs=60, starts=2),
}


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return worn_twin(pump, at_15)


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    return recording_of(twin)


@pytest.fixture(scope="module", params=METHODS)
def uninterrupted(
    request: pytest.FixtureRequest, twin: Twin, recording: Recording
) -> tuple[dict[str, Any], Calibration]:
    """Settings of a calibration, and its result."""
    options: dict[str, Any] = {"method": METHODS[request.param], "seed": 3, **SIX_VALUES}
    return options, calibrate(twin, [recording], **options)


class Stop(Exception):
    """What interrupts."""


def interrupt(after: int, twin: Twin, recording: Recording, **options: Any) -> list[int]:
    """Epochs that a search reports before it is interrupted."""
    seen: list[int] = []

    def stop(epoch: int, total: int, loss: float) -> None:
        seen.append(epoch)
        if epoch == after:
            raise Stop

    with pytest.raises(Stop):
        calibrate(twin, [recording], progress=stop, **options)
    return seen


def same_bits(first: Calibration, second: Calibration) -> bool:
    """Whether two searches went and ended alike."""
    names = ("spectrum_loss", "boundary_loss", "prior_loss", "gradient_norm", "points")
    pairs = [(getattr(first.history, name), getattr(second.history, name)) for name in names]
    pairs.append((first.posterior.point, second.posterior.point))
    return first.history.best == second.history.best and all(np.array_equal(a, b) for a, b in pairs)


@pytest.mark.parametrize("after", [20, 37, 50])
def test_an_interrupted_search_ends_at_the_same_bits(
    twin: Twin, recording: Recording, tmp_path: Path, uninterrupted: tuple[dict[str, Any], Calibration], after: int
) -> None:
    settings, whole = uninterrupted
    options = {**settings, "checkpoint": tmp_path / "search.safetensors"}
    interrupt(after, twin, recording, **options)
    epochs: list[int] = []
    resumed = calibrate(twin, [recording], **options, resume=True, progress=lambda epoch, *_: epochs.append(epoch))
    assert epochs[:1] == ([25 * (after // 25) + 1] if len(whole.history.loss) > 25 * (after // 25) else [])
    assert same_bits(resumed, whole)


def test_a_search_interrupted_twice_ends_at_the_same_bits(twin: Twin, recording: Recording, tmp_path: Path) -> None:
    settings: dict[str, Any] = {"method": METHODS["ipinn"], "seed": 0, **SIX_VALUES}
    options = {**settings, "checkpoint": tmp_path / "search.safetensors", "resume": True}
    assert interrupt(30, twin, recording, **options)[0] == 1
    assert interrupt(55, twin, recording, **options)[0] == 26
    whole = calibrate(twin, [recording], **settings)
    assert same_bits(calibrate(twin, [recording], **options), whole)
    assert same_bits(calibrate(twin, [recording], **options), whole)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 1}, "its seed is 0, this run's is 1"),
        ({"method": DirectAdam(epochs=60)}, "its method is IPINN, this run's is DirectAdam"),
        ({"method": IPINN(epochs=61, channels=(4, 8), learning_rate=0.01)}, "its epochs is 60, this run's is 61"),
        ({"bounds": 3.0}, r"its measurement \(SHA-256\) is"),
        ({"band": (0.0, 1000.0)}, "its band is"),
    ],
)
def test_a_checkpoint_of_another_search_is_refused_with_what_differs(
    twin: Twin, recording: Recording, tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    options: dict[str, Any] = {
        "method": METHODS["ipinn"],
        "seed": 0,
        "checkpoint": tmp_path / "search.safetensors",
        **SIX_VALUES,
    }
    interrupt(25, twin, recording, **options)
    with pytest.raises(InputError, match=words):
        calibrate(twin, [recording], **{**options, **change}, resume=True)


def test_a_checkpoint_of_other_samples_is_refused(twin: Twin, recording: Recording, tmp_path: Path) -> None:
    options: dict[str, Any] = {"method": METHODS["ipinn"], "checkpoint": tmp_path / "search.safetensors", **SIX_VALUES}
    interrupt(25, twin, recording, **options)
    with pytest.raises(InputError, match=r"its measurement \(SHA-256\)"):
        calibrate(twin, [recording_of(twin, seed=1)], **options, resume=True)


def test_a_checkpoint_is_neither_overwritten_nor_invented(twin: Twin, recording: Recording, tmp_path: Path) -> None:
    options: dict[str, Any] = {"method": METHODS["ipinn"], "checkpoint": tmp_path / "search.safetensors", **SIX_VALUES}
    interrupt(25, twin, recording, **options)
    with pytest.raises(InputError, match="exists; continue it with resume=True"):
        calibrate(twin, [recording], **options)
    with pytest.raises(InputError, match="needs checkpoint="):
        calibrate(twin, [recording], resume=True, **PAPER_CALIBRATION)
    options["checkpoint"].write_bytes(options["checkpoint"].read_bytes()[:-9])
    with pytest.raises(ArtifactError, match="damaged"):
        calibrate(twin, [recording], **options, resume=True)


@pytest.mark.parametrize("method", [GaussNewton(), CMAES()])
def test_a_method_of_a_second_keeps_no_checkpoint_and_says_what_to_do(
    twin: Twin, recording: Recording, tmp_path: Path, method: Any
) -> None:
    assert not isinstance(method, ResumableCalibrator)
    with pytest.raises(InputError, match="begun again with the same seed it ends at the same bits"):
        calibrate(twin, [recording], method=method, checkpoint=tmp_path / "none", **SIX_VALUES)
