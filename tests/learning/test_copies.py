"""Copies are found at any gain, and chance is not mistaken for one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from swashtwin.learning import copied_recordings
from swashtwin.recordings import Recording


def recording(name: str, label: str = "normal", samples: int = 300, rate: float = 1000.0, **facts) -> Recording:
    noise = np.random.default_rng(list(name.encode())).normal(size=(1, samples))
    return Recording(noise, rate, name, label=label, **facts)


@settings(deadline=None, max_examples=30)
@given(
    st.floats(0.01, 100) | st.floats(-100, -0.01),
    st.floats(-50, 50),
    st.integers(0, 4),
    st.sampled_from(["<f8", "<f4"]),
)
def test_a_copy_at_any_gain_sign_and_offset_is_found_and_nothing_else(gain, offset, index, kind):
    recordings = [recording(f"r{number}") for number in range(5)]
    copied = gain * recordings[index].signal + offset * gain
    copied = copied.astype(kind).astype(float)
    assume(not np.array_equal(copied, recordings[index].signal))
    recordings.append(replace(recordings[index], signal=copied, recording_id="copy"))
    result = copied_recordings(recordings)
    assert [(copy.first.recording_id, copy.again.recording_id) for copy in result] == [(f"r{index}", "copy")]
    assert result[0].gain == pytest.approx(gain, rel=1e-3)


def test_a_copy_far_off_zero_is_found_with_its_gain():
    original = recording("one")
    far = replace(original, signal=2 * original.signal + 1e6, recording_id="far")
    assert [round(copy.gain, 6) for copy in copied_recordings([original, far])] == [2.0]


def test_a_copy_in_twelve_bits_is_found_and_an_exact_one_is_left_to_its_hash():
    original = recording("one")
    step = np.ptp(original.signal) / 2**12
    coarse = replace(original, signal=np.round(original.signal / step), recording_id="coarse")
    exact = replace(original, recording_id="exact")
    assert [copy.again.recording_id for copy in copied_recordings([original, exact, coarse])] == ["coarse"]


def test_two_measurements_of_one_sine_with_a_little_noise_are_no_copies():
    time = np.arange(2000) / 1000
    noise = np.random.default_rng(0).normal(size=(2, 2000)) * 0.01
    recordings = [
        Recording(np.sin(2 * np.pi * 25 * time)[None] + noise[index], 1000.0, f"r{index}") for index in range(2)
    ]
    assert copied_recordings(recordings) == ()


def test_constant_samples_are_no_copies():
    flat = [Recording(np.full((1, 50), 2.0), 10.0, name) for name in "ab"]
    assert copied_recordings(flat) == ()
    counted = [recording.replace(signal=np.arange(50.0)[None] + n) for n, recording in enumerate(flat)]
    assert copied_recordings(counted) == ()
