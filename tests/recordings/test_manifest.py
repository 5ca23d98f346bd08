"""Recordings are identified by their content, whatever their files are called."""

import base64
import pickle
import random
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

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
from swashtwin.recordings.manifest import describe_content
from swashtwin.recordings.sample_patterns import find_shared_patterns


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


# ---- altered and overlapping copies within one data set


def long_recording(name: str, seed: int, label: str = "normal") -> Recording:
    signal = np.random.default_rng(seed).normal(size=(2, 4000)).round(5)
    return Recording(signal, 2000.0, name, channels=("x", "y"), label=label)


def reorder(signal: np.ndarray) -> np.ndarray:
    order = np.random.default_rng(0).permutation(20)
    return signal.reshape(2, 20, 200)[:, order].reshape(2, -1)


@pytest.mark.parametrize(
    "alter",
    [
        pytest.param(lambda x: x.round(1), id="rounded"),
        pytest.param(lambda x: 1 - 3 * x, id="scaled"),
        pytest.param(lambda x: x[:, ::-1], id="reversed"),
        pytest.param(lambda x: np.diff(x, prepend=0.0), id="filtered"),
        pytest.param(lambda x: x[:, 1500:2700], id="cut"),
        pytest.param(lambda x: x[::-1], id="exchanged channels"),
        pytest.param(reorder, id="reordered"),
    ],
)
def test_inspect_names_an_altered_copy_in_another_class(
    alter: Callable[[np.ndarray], np.ndarray],
) -> None:
    recordings = [long_recording(f"n{seed}", seed) for seed in range(3)]
    signal = 1.5 * alter(recordings[1].signal)
    recordings.append(Recording(signal, 2000.0, "copy", channels=("x", "y"), label="fault"))

    report = inspect_recordings(recordings)

    (finding,) = [finding for finding in report.findings if "copy" in finding.kind]
    assert finding.severity == "error"
    assert finding.message.startswith(
        "n1, copy hold samples of one measurement, altered or overlapping (fault, normal)"
    )
    assert "It stands in 2 classes" in finding.message
    assert find_duplicates(report.manifest) == {"n1": "copy"}


def test_two_parts_that_overlap_are_reported_and_two_that_do_not_are_not() -> None:
    whole = long_recording("whole", 0).signal
    parts = {"a": whole[:, :1500], "b": whole[:, 1000:2500], "c": whole[:, 2500:]}
    recordings = [
        Recording(signal, 2000.0, name, channels=("x", "y"), label="normal")
        for name, signal in parts.items()
    ]

    findings = inspect_recordings(recordings).findings

    (message,) = [finding.message for finding in findings if finding.kind == "altered_copy"]
    assert message.startswith("a, b hold samples of one measurement")
    assert "classes" not in message


@pytest.mark.parametrize("gain", [10, 1000, 1e6])
@pytest.mark.parametrize("length", [40, 120])
def test_two_recordings_of_one_strong_transient_are_not_copies(gain: float, length: int) -> None:
    transient = np.zeros(4000)
    transient[2000 : 2000 + length] = gain * np.random.default_rng(9).normal(size=length)
    recordings = [
        Recording(long_recording(name, seed).signal + transient, 2000.0, name, channels=("x", "y"))
        for seed, name in enumerate("ab")
    ]
    altered = recordings[0].replace(signal=1 - 2 * recordings[0].signal, recording_id="copy")

    assert not find_duplicates(build_manifest(recordings))
    assert find_duplicates(build_manifest([*recordings, altered])) == {"copy": "a"}


def test_a_mixture_of_many_recordings_is_named_with_each_of_them() -> None:
    parts = [long_recording(f"n{seed}", seed) for seed in range(8)]
    mixed = np.concatenate([part.signal[:, 500:1500] for part in parts], axis=1)
    mixture = Recording(mixed, 2000.0, "a mixture", channels=("x", "y"), label="fault")

    copies = find_duplicates(build_manifest([mixture, *parts]))

    assert copies == {part.recording_id: "a mixture" for part in parts}


def parts(starts: Sequence[int], length: int) -> list[Recording]:
    """Return parts of one long measurement, called r0, r1, ..."""
    signal = np.random.default_rng(0).normal(size=(2, 30_000)).round(5)
    return [
        Recording(
            signal[:, start : start + length],
            2000.0,
            f"r{number}",
            channels=("x", "y"),
            label="normal",
        )
        for number, start in enumerate(starts)
    ]


@pytest.mark.parametrize(
    ("starts", "length", "duplicates"),
    [
        pytest.param(
            [2250 * number for number in range(10)],
            3000,
            {"r1": "r0", "r3": "r2", "r5": "r4", "r7": "r6", "r9": "r8"},
            id="neighbors",
        ),
        pytest.param([6000, 3000, 0], 4000, {"r1": "r0"}, id="in reverse order"),
        pytest.param([0, 0, 8000, 8000], 4000, {"r1": "r0", "r3": "r2"}, id="exact copies"),
    ],
)
def test_a_part_that_overlaps_only_duplicates_is_kept(
    starts: Sequence[int], length: int, duplicates: dict[str, str]
) -> None:
    assert find_duplicates(build_manifest(parts(starts, length))) == duplicates


def low_pass(channel: np.ndarray) -> np.ndarray:
    """Return a channel without its upper half band, which has none of its patterns."""
    return sosfilt(butter(4, 500, fs=2000, output="sos"), channel)


@pytest.mark.parametrize(
    ("earlier", "later"),
    [
        pytest.param(["-1"], ["0", "1"], id="second channel"),
        pytest.param(["-2"], ["0", "1", "2"], id="third channel"),
        pytest.param(["0", "1"], ["-1"], id="fewer channels later"),
        pytest.param(["-2", "-1"], ["0", "1", "2"], id="two of three channels"),
    ],
)
def test_an_altered_copy_of_some_channels_is_found_in_both_orders(
    earlier: list[str], later: list[str]
) -> None:
    channels = np.random.default_rng(0).normal(size=(3, 4000))
    signals = {str(number): channel for number, channel in enumerate(channels)}
    signals |= {f"-{number}": low_pass(channel) for number, channel in enumerate(channels)}
    recordings = [
        Recording(
            np.stack([signals[name] for name in names]),
            2000.0,
            recording_id,
            channels=tuple(names),
        )
        for recording_id, names in (("a", earlier), ("b", later))
    ]

    assert find_duplicates(build_manifest(recordings)) == {"b": "a"}
    first, second = (build_manifest([recording]) for recording in recordings)
    assert find_copies(first, second) == {"b": "a"}
    assert find_copies(second, first) == {"a": "b"}


def test_a_copy_of_one_channel_beside_another_is_found_within_a_data_set() -> None:
    a, b, c = np.random.default_rng(0).normal(size=(3, 4000))
    recordings = [
        Recording(np.stack(signal), 2000.0, name, channels=("x", "y"))
        for name, signal in (("earlier", [low_pass(b), c]), ("later", [a, b]))
    ]

    assert find_duplicates(build_manifest(recordings)) == {"later": "earlier"}


def pattern_text(numbers: Sequence[int]) -> str:
    """Return the patterns of a channel as `compute_patterns` writes them."""
    packed = b"".join(number.to_bytes(6, "big") for number in sorted(numbers))
    return "=" + base64.b64encode(packed).decode()


@pytest.mark.parametrize(
    ("n_strangers", "n_shared"),
    [
        pytest.param(1, 1, id="one pattern of one recording"),
        pytest.param(1, 4, id="some patterns of one recording"),
        pytest.param(5, 1, id="one pattern of each of some recordings"),
    ],
)
def test_patterns_that_are_shared_by_chance_hide_no_copy(n_strangers: int, n_shared: int) -> None:
    draw = random.Random(0)
    original = sorted(draw.sample(range(1 << 48), 100))
    listed = {"original": [pattern_text(original)]}
    for number in range(n_strangers):
        # A long recording lists the smallest 128 of its many patterns only.
        own_numbers = draw.sample(range(original[4]), 128 - n_shared)
        shared_numbers = original[number : number + n_shared]
        listed[f"stranger {number}"] = [pattern_text([*own_numbers, *shared_numbers])]

    copies = find_shared_patterns(listed, {"copy": [pattern_text(original[:80])]})

    assert copies == {"copy": "original"}


def test_a_mixture_of_a_few_patterns_of_each_of_many_recordings_is_a_copy() -> None:
    draw = random.Random(0)
    listed = {f"n{number}": draw.sample(range(1 << 48), 100) for number in range(30)}
    mixed = [numbers[0] for numbers in listed.values()] + listed["n7"][:4]

    copies = find_shared_patterns(
        {name: [pattern_text(numbers)] for name, numbers in listed.items()},
        {"mixture": [pattern_text(mixed)]},
    )

    assert copies == {"mixture": "n7"}


def test_samples_of_single_precision_are_described_without_warnings() -> None:
    signal = long_recording("a", 0).signal.astype(np.float32)

    content = describe_content(Recording(signal, 2000.0, "a", channels=("x", "y")))

    assert {text[0] for text in content} >= {"~", "="}


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_samples_that_are_not_measured_have_no_patterns(value: float) -> None:
    signal = long_recording("a", 0).signal.copy()
    signal[:, 100] = value

    content = describe_content(Recording(signal[:1], 2000.0, "a"))

    assert all(text[0] not in "~=" for text in content)


@pytest.mark.parametrize(
    "signal",
    [
        pytest.param(np.sin(2 * np.pi * np.arange(4000) / 37), id="sine"),
        pytest.param(np.arange(4000) // 50 % 2, id="square"),
        pytest.param(np.arange(4000) % 64, id="saw tooth"),
    ],
)
def test_signals_that_repeat_have_no_patterns(signal: np.ndarray) -> None:
    first, second = (
        Recording(signal[None, start : start + 3000].astype(float), 2000.0, "a")
        for start in (0, 37 * 64)
    )

    assert not find_duplicates({"a": describe_content(first), "b": describe_content(second)})


# ---- names of classes


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Fault", "fault"),
        ("inner race", "inner_race"),
        ("Kolben-Verschleiß", "kolben verschleiss"),
        ("Schrägscheibe", "schraegscheibe"),
        ("Normal", "normal"),
    ],
)
def test_classes_that_differ_in_spelling_only_are_reported(first: str, second: str) -> None:
    recordings = [
        long_recording(f"{label}{number}", number, label)
        for number, label in enumerate([first, first, second, second, "other", "other"])
    ]

    (finding,) = [
        finding
        for finding in inspect_recordings(recordings).findings
        if finding.kind in ("similar_classes", "several_healthy")
    ]

    assert finding.severity == "warning"
    assert repr(first) in finding.message
    assert repr(second) in finding.message
    assert "are they one class?" in finding.message
