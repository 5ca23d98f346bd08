"""Recordings are known by their content, whatever their files are called."""

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


def measured(name: str = "a", *, seed: int = 0, count: int = 500) -> Recording:
    signal = np.random.default_rng(seed).normal(size=(2, count)).round(6)
    return Recording(signal, 1000.0, name, channels=("x", "y"))


def written(recording: Recording, path: Path) -> Path:
    write_recording(recording, path)
    return path


@pytest.mark.parametrize("suffix", [".h5", ".csv", ".npz", ".parquet"])
def test_a_renamed_copy_in_another_format_is_the_same_recording(tmp_path, suffix):
    again = load_recording(written(measured(), tmp_path / f"renamed{suffix}")).replace(
        recording_id="renamed"
    )
    assert find_copies(build_manifest([measured()]), build_manifest([again])) == {"renamed": "a"}


def test_a_resampled_file_a_picked_channel_and_a_slice_are_the_recording_they_were_made_of(
    tmp_path,
):
    path = written(measured(), tmp_path / "a.h5")
    hashes = measured().content_hashes()
    assert load_recording(path, resample="500 Hz").content_hashes() == hashes
    assert load_recording(path).select_channels(["y"]).content_hashes() == hashes[1:]
    assert measured().select_channels(["y"]).content_hashes() == hashes[1:]
    assert (
        load_recording(path, resample="500 Hz").select_channels(["y"]).content_hashes()
        == hashes[1:]
    )
    loaded = load_recording(path, resample="500 Hz")
    assert loaded.select_channels(["y"]).signal.tolist() == loaded.signal[1:].tolist()
    assert loaded.select_channels(["y"]).content_hashes() == hashes[1:]
    assert measured().slice(10, 90).content_hashes() == hashes
    filtered = measured().replace(signal=2 * measured().signal)
    assert pickle.loads(pickle.dumps(filtered)).content_hashes() == hashes
    assert (
        measured().replace(signal=2 * measured().signal, recording_id="b").content_hashes()
        != hashes
    )


def test_a_store_of_resampled_or_filtered_recordings_knows_what_was_recorded(tmp_path):
    resampled = load_recording(written(measured(), tmp_path / "a.h5"), resample="500 Hz")
    filtered = measured().replace(signal=2 * measured().signal, recording_id="b")
    first = write_store([resampled, filtered], tmp_path / "first.h5")
    again = write_store(load_recordings(first), tmp_path / "again.h5")
    hashes = [recording.content_hashes() for recording in (resampled, filtered)]
    assert [recording.content_hashes() for recording in load_recordings(again)] == hashes


def test_blocks_do_not_change_a_hash_nor_does_the_sign_of_zero():
    signal = np.zeros((1, BLOCK_SAMPLES + 7))
    signal[0, 5] = 1.0
    negative = np.where(signal == 0, -0.0, signal)
    assert (
        Recording(signal, 1.0, "a").content_hashes()
        == Recording(negative, 1.0, "b").content_hashes()
    )


def test_a_channel_that_never_changes_makes_no_two_recordings_one():
    first, second = (
        Recording(np.stack([np.zeros(9), np.arange(9.0) ** 2 + n]), 1.0, "a", ("x", "y"))
        for n in (0, 1)
    )
    assert len(first.content_hashes()) == 1
    assert not set(first.content_hashes()) & set(second.content_hashes())


@pytest.mark.parametrize("step", [1.0, -3.0, 1 / 25600])
def test_a_counter_or_a_time_makes_no_two_recordings_one(step):
    ramp = np.round(step * np.arange(BLOCK_SAMPLES + 9.0), 6)
    noise = np.random.default_rng(0).normal(size=(2, ramp.size))
    first, second = (Recording(np.stack([ramp, row]), 1.0, "a", ("n", "y")) for row in noise)
    assert len(first.content_hashes()) == 1
    assert not set(first.content_hashes()) & set(second.content_hashes())
    assert not [finding for finding in inspect_recordings([first, second.replace(recording_id="b")]).findings
                if finding.kind == "duplicate"]  # fmt: skip


def test_one_name_for_two_contents_is_two_recordings_and_a_name_alone_is_believed():
    first, other = build_manifest([measured("a")]), build_manifest([measured("a", seed=1)])
    assert find_copies(first, other) == {}
    assert find_copies(["a"], other) == {"a": "a"}
    assert find_copies(first, {"a": ()}) == {"a": "a"}
    assert find_duplicates(join_manifests([first, build_manifest([measured("b")])])) == {"b": "a"}
