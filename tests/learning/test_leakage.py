"""Copies are found at any gain, facts that give the class away are named, and chance is not mistaken for one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swashtwin.foundation import DataError
from swashtwin.learning import confounding, copied_recordings, cut_windows
from swashtwin.learning.leakage.copies import copied_windows
from swashtwin.recordings import Recording


def recording(name: str, label: str = "normal", samples: int = 300, rate: float = 1000.0, **facts) -> Recording:
    noise = np.random.default_rng(list(name.encode())).normal(size=(1, samples))
    return Recording(noise, rate, name, label=label, **facts)


def fleet(classes: int = 3, machines: int = 3, repeats: int = 4) -> list[Recording]:
    return [
        recording(f"{label}-{machine}-{repeat}", f"class {label}", specimen=f"pump {label}-{machine}")
        for label in range(classes)
        for machine in range(machines)
        for repeat in range(repeats)
    ]


def warned(recordings: list[Recording], **settings) -> set[str]:
    return {finding.attribute for finding in confounding(recordings, **settings) if finding.is_warning}


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
    recordings.append(replace(recordings[index], signal=copied.astype(kind).astype(float), recording_id="copy"))
    result = copied_recordings(recordings)
    assert [(copy.first.recording_id, copy.again.recording_id) for copy in result] == [(f"r{index}", "copy")]
    assert result[0].gain == pytest.approx(gain, rel=1e-3)


def test_a_copy_far_off_zero_is_found_with_its_gain():
    original = recording("one")
    far = replace(original, signal=2 * original.signal + 1e6, recording_id="far")
    assert [round(copy.gain, 6) for copy in copied_recordings([original, far])] == [2.0]


def test_a_copy_in_twelve_bits_is_found_and_an_exact_one_is_called_so():
    original = recording("one")
    step = np.ptp(original.signal) / 2**12
    coarse = replace(original, signal=np.round(original.signal / step), recording_id="coarse")
    exact = replace(original, recording_id="exact")
    assert [(copy.again.recording_id, copy.exact) for copy in copied_recordings([original, exact, coarse])] == [
        ("exact", True),
        ("coarse", False),
    ]


def test_two_measurements_of_one_sine_with_a_little_noise_are_no_copies():
    time = np.arange(2000) / 1000
    noise = np.random.default_rng(0).normal(size=(2, 2000)) * 0.01
    recordings = [
        Recording(np.sin(2 * np.pi * 25 * time)[None] + noise[index], 1000.0, f"r{index}") for index in range(2)
    ]
    assert copied_recordings(recordings) == ()


def test_copied_windows_say_whether_they_stand_in_two_roles():
    source = recording("a")
    sets = {
        "train": cut_windows([source, replace(source, recording_id="again", signal=source.signal * 3)], length=100),
        "test": cut_windows([replace(source, recording_id="b", signal=source.signal[:, 100:200] - 7)], length=100),
    }
    result = copied_windows(sets)
    assert [copy.again.recording_id for copy in result if copy.across] == ["b"]
    assert [copy.again.start for copy in result if not copy.across] == [0, 100, 200]
    across = next(copy for copy in result if copy.across)
    assert (across.first.role, across.first.start, across.again.role) == ("train", 100, "test")


def test_constant_samples_are_no_copies():
    flat = [Recording(np.full((1, 50), 2.0), 10.0, name) for name in "ab"]
    assert copied_recordings(flat) == ()
    counted = [recording.replace(signal=np.arange(50.0)[None] + n) for n, recording in enumerate(flat)]
    assert copied_recordings(counted) == ()


def test_random_classes_get_a_warning_no_more_often_than_said():
    random = np.random.default_rng(0)
    base = [
        replace(
            recording(f"r{index}", samples=64),
            signal=random.normal(random.normal(), random.lognormal(), (1, 64)),
            attributes={"bench": str(random.integers(3)), "shift": str(random.integers(2))},
        )
        for index in range(36)
    ]
    alarms = 0
    for trial in range(30):
        labels = random.permutation(np.repeat(["a", "b", "c"], 12))
        dealt = [recording.relabeled(str(label)) for recording, label in zip(base, labels, strict=True)]
        alarms += bool(warned(dealt, false_alarms=0.2, seed=trial))
    assert alarms <= 11  # 30 sets at a share of 0.2: more happen by chance in 1 of 50 runs


@pytest.mark.parametrize(
    ("attribute", "confound"),
    [
        ("sample rate", lambda source, hit: replace(source, sample_rate=2000.0 if hit else 1000.0)),
        ("offset of acceleration", lambda source, hit: replace(source, signal=source.signal + (0.5 if hit else 0))),
        ("level of acceleration", lambda source, hit: replace(source, signal=source.signal * (3 if hit else 1))),
        ("sensor", lambda source, hit: replace(source, attributes={"sensor": "new" if hit else "old"})),
        (
            "date",
            lambda source, hit: replace(source, attributes={"date": f"2026-0{1 + hit}-{len(source.label or '') + 10}"}),
        ),
        (
            "oil temperature",
            lambda source, hit: replace(source, attributes={"oil_temperature": f"{40 + 20 * hit} degC"}),
        ),
        ("converter step of acceleration", lambda source, hit: _in_steps(source, 0.2 if hit else 0.1)),
    ],
)
def test_what_gives_one_class_away_is_named_and_nothing_else(attribute, confound):
    recordings = [confound(recording, recording.label == "class 1") for recording in fleet()]
    result = {finding.attribute: finding for finding in confounding(recordings) if finding.is_warning}
    assert attribute in result
    assert set(result) <= {attribute, "length"}
    assert "tells the class" in result[attribute].message


def _in_steps(recording: Recording, step: float) -> Recording:
    return replace(recording, signal=np.round(recording.signal / step) * step)


def test_a_clean_fleet_gets_no_warning():
    assert warned(fleet()) == set()


def test_classes_are_dealt_to_whole_machines_so_their_own_levels_are_no_surprise():
    """Each pump is louder or softer than the next by its make; recordings of one pump are alike."""
    random = np.random.default_rng(3)
    loudness = {recording.specimen: random.lognormal(sigma=1) for recording in fleet(2, 8, 3)}
    recordings = [
        replace(recording, signal=recording.signal * loudness[recording.specimen]) for recording in fleet(2, 8, 3)
    ]
    assert "level of acceleration" not in warned(recordings)


def test_a_class_on_one_machine_of_its_own_is_always_told():
    recordings = [*fleet(2), *(recording(f"x{index}", "crack", specimen="pump x") for index in range(4))]
    answer = next(finding for finding in confounding(recordings) if finding.attribute == "one specimen")
    assert answer.is_warning
    assert answer.message.startswith("crack: measured on one specimen only")


def test_an_attribute_that_is_the_class_by_another_name_is_called_a_label():
    recordings = [replace(recording, attributes={"grade": (recording.label or "")[-1]}) for recording in fleet()]
    answer = next(finding for finding in confounding(recordings) if finding.attribute == "grade")
    assert (answer.kind, answer.is_warning, answer.balanced_accuracy) == ("label", True, 1.0)


def test_one_class_alone_is_refused():
    with pytest.raises(DataError, match=r"1 class\(es\)"):
        confounding(fleet(1))
