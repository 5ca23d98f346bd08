"""Recordings are identified by their content, whatever their files are called."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from swashtwin.recordings import (
    BLOCK_SAMPLES,
    Recording,
    build_manifest,
    find_copies,
    find_duplicates,
    inspect_recordings,
    join_manifests,
    load_recording,
    load_recordings,
    write_recording,
    write_store,
)


def noise_recording(name: str = "a", *, seed: int = 0) -> Recording:
    signal = np.random.default_rng(seed).normal(size=(2, 500)).round(6)
    return Recording(signal, 1000.0, name, channels=("x", "y"))


def amplified_recording(name: str = "a") -> Recording:
    """Return the noise with twice its amplitude, as a filter would return it."""
    recording = noise_recording()
    return recording.replace(signal=2 * recording.signal, recording_id=name)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a file of the noise."""
    return write_recording(noise_recording(), tmp_path / "a.h5")


@pytest.mark.parametrize("suffix", [".h5", ".csv", ".npz", ".parquet"])
def test_a_renamed_copy_in_another_format_is_the_same_recording(
    tmp_path: Path, suffix: str
) -> None:
    path = write_recording(noise_recording(), tmp_path / f"renamed{suffix}")
    copy = load_recording(path).replace(recording_id="renamed")

    copies = find_copies(build_manifest([noise_recording()]), build_manifest([copy]))

    assert copies == {"renamed": "a"}


# ---- the hash is that of what was measured


HASHES = noise_recording().content_hashes()


def test_a_resampled_recording_keeps_the_hashes_of_its_file(file: Path) -> None:
    assert load_recording(file, resample="500 Hz").content_hashes() == HASHES


def test_a_slice_keeps_the_hashes_of_the_whole() -> None:
    assert noise_recording().slice(10, 90).content_hashes() == HASHES


def test_a_selected_channel_keeps_its_own_hash(file: Path) -> None:
    for recording in (
        noise_recording(),
        load_recording(file),
        load_recording(file, resample="500 Hz"),
    ):
        assert recording.select_channels(["y"]).content_hashes() == HASHES[1:]


def test_a_channel_selected_after_its_samples_were_read_keeps_its_hash(file: Path) -> None:
    recording = load_recording(file, resample="500 Hz")

    # reading the samples of a recording keeps them in memory
    samples = recording.signal[1:].tolist()

    selected = recording.select_channels(["y"])
    assert selected.signal.tolist() == samples
    assert selected.content_hashes() == HASHES[1:]


def test_a_filtered_recording_of_the_same_name_keeps_its_hashes() -> None:
    pickled = pickle.dumps(amplified_recording())

    assert pickle.loads(pickled).content_hashes() == HASHES


def test_a_filtered_recording_of_another_name_is_another_recording() -> None:
    assert amplified_recording("b").content_hashes() != HASHES


def test_a_store_keeps_the_hashes_of_resampled_and_filtered_recordings(
    file: Path, tmp_path: Path
) -> None:
    recordings = [load_recording(file, resample="500 Hz"), amplified_recording("b")]

    # a store of a store has only the hashes that the first one holds
    first = write_store(recordings, tmp_path / "first.h5")
    second = write_store(load_recordings(first), tmp_path / "again.h5")

    expected = [recording.content_hashes() for recording in recordings]
    assert [recording.content_hashes() for recording in load_recordings(second)] == expected


def test_a_hash_does_not_depend_on_the_sign_of_zero() -> None:
    # longer than a block, since hashes are computed block by block
    signal = np.zeros((1, BLOCK_SAMPLES + 7))
    signal[0, 5] = 1.0
    negative = np.where(signal == 0, -0.0, signal)

    hashes = Recording(signal, 1.0, "a").content_hashes()

    assert Recording(negative, 1.0, "b").content_hashes() == hashes


# ---- channels that do not identify a recording


def assert_different(first: Recording, second: Recording) -> None:
    """Check that the first channel, which both recordings share, has no hash."""
    assert len(first.content_hashes()) == 1
    assert not set(first.content_hashes()) & set(second.content_hashes())


def test_recordings_that_share_a_constant_channel_are_different() -> None:
    first, second = (
        Recording(np.stack([np.zeros(9), np.arange(9.0) ** 2 + offset]), 1.0, "a", ("x", "y"))
        for offset in (0, 1)
    )

    assert_different(first, second)


@pytest.mark.parametrize(
    "step",
    [
        pytest.param(1.0, id="counter"),
        pytest.param(-3.0, id="falling counter"),
        pytest.param(1 / 25600, id="time"),
    ],
)
def test_recordings_that_share_a_counter_or_a_time_are_different(step: float) -> None:
    ramp = np.round(step * np.arange(BLOCK_SAMPLES + 9.0), 6)
    noise = np.random.default_rng(0).normal(size=(2, ramp.size))
    first, second = (Recording(np.stack([ramp, row]), 1.0, "a", ("n", "y")) for row in noise)

    assert_different(first, second)
    report = inspect_recordings([first, second.replace(recording_id="b")])
    assert "duplicate" not in [finding.kind for finding in report.findings]


# ---- copies between manifests


def test_a_name_with_two_contents_is_two_recordings() -> None:
    first = build_manifest([noise_recording("a")])
    second = build_manifest([noise_recording("a", seed=1)])

    assert find_copies(first, second) == {}


def test_a_name_without_a_content_is_matched_by_the_name() -> None:
    # A list of names, and an entry without hashes, state no content.
    manifest = build_manifest([noise_recording("a")])

    assert find_copies(["a"], manifest) == {"a": "a"}
    assert find_copies(manifest, {"a": ()}) == {"a": "a"}


def test_duplicates_are_found_among_joined_manifests() -> None:
    manifests = [build_manifest([noise_recording(name)]) for name in "ab"]

    assert find_duplicates(join_manifests(manifests)) == {"b": "a"}
