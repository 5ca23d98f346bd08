"""The inspection reports what a careful person would see in a measurement, and nothing else."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError, MPa, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import (
    Finding,
    Recording,
    RecordingReport,
    inspect_recordings,
    load_recording,
    require_usable,
)

RATE = 6400.0
N_SAMPLES = 38_400
SHAFT_SPEED_RPM = 860.0

# Multiples of the shaft's frequency that stand out of a pump's spectrum, the pistons' among them.
LINE_ORDERS = (1, 2, 3, 4, 5, 7, 9, 14)


def healthy_recording(
    seed: int = 0,
    *,
    seconds: float = 6.0,
    specified_rpm: float = SHAFT_SPEED_RPM,
    has_lines: bool = True,
) -> Recording:
    """Return noise with lines at multiples of the shaft's frequency, which is that of 860 rpm."""
    generator = np.random.default_rng(seed)
    time = np.arange(int(seconds * RATE)) / RATE
    signal = generator.standard_normal(len(time))
    if has_lines:
        for order in LINE_ORDERS:
            frequency = order * SHAFT_SPEED_RPM / 60
            signal += 0.4 * np.sin(2 * np.pi * frequency * time + order)

    return Recording(
        signal=signal[None],
        sample_rate=RATE,
        recording_id=f"r{seed}",
        label="normal",
        specimen="A",
        condition=OperatingCondition(speed=rpm(specified_rpm), discharge_pressure=MPa(15.0)),
    )


def overwrite_samples(recording: Recording, start: int, stop: int, value: float) -> Recording:
    signal = recording.signal.copy()
    signal[0, start:stop] = value
    return replace(recording, signal=signal)


def smooth_sine() -> np.ndarray:
    """Return a sine of 50 Hz whose amplitude swells from 2.1 to 3.9, three times a second."""
    time = np.arange(N_SAMPLES) / RATE
    return 3 * np.sin(2 * np.pi * 50 * time) * (1 + 0.3 * np.sin(2 * np.pi * 3 * time))


def inspect_recording(recording: Recording) -> RecordingReport:
    return inspect_recordings([recording]).recordings[0]


def kinds(report: RecordingReport) -> list[str]:
    return [finding.kind for finding in report.findings]


def findings_between(recordings: list[Recording], kind: str) -> list[Finding]:
    """Return the findings of a kind that concern several recordings."""
    return [finding for finding in inspect_recordings(recordings).findings if finding.kind == kind]


# ---- one recording


def test_a_healthy_recording_has_no_finding() -> None:
    recording = healthy_recording()

    assert inspect_recording(recording).findings == ()
    require_usable(recording)


def test_a_report_states_the_statistics_of_each_channel() -> None:
    signal = healthy_recording().signal[0]

    report = inspect_recording(healthy_recording())

    (channel,) = report.channels
    assert (channel.minimum, channel.maximum) == (signal.min(), signal.max())
    assert channel.rms == pytest.approx(np.sqrt((signal**2).mean()))
    assert (report.duration, report.sample_rate, report.unit) == (6.0, RATE, "m/s^2")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_few_missing_samples_are_an_error_with_their_time(value: float) -> None:
    broken = overwrite_samples(healthy_recording(), 640, 642, value)

    report = inspect_recording(broken)

    assert "nan" in kinds(report)
    message = report.findings[0].message
    assert "2 of 38400 samples are missing or infinite, the first at 0.1 s" in message
    with pytest.raises(DataError, match="r0, acceleration: 2 of 38400 samples"):
        require_usable(broken)

    # the statistics are those of the other samples
    assert np.isfinite(report.channels[0].maximum)


@pytest.mark.parametrize(
    ("recording", "kind", "message"),
    [
        pytest.param(
            replace(healthy_recording(), signal=np.full((1, 6400), np.nan)),
            "nan",
            "6400 of 6400 samples are missing or infinite",
            id="no sample",
        ),
        # a sensor that was not connected
        pytest.param(
            overwrite_samples(healthy_recording(), 0, N_SAMPLES, 2.5),
            "constant",
            "every sample is 2.5",
            id="constant",
        ),
        pytest.param(
            healthy_recording(seconds=0.06),
            "short",
            "shorter than one revolution at 860 rev/min",
            id="short by its operating point",
        ),
        # a speed without a pressure is no operating point, and so an attribute
        pytest.param(
            replace(
                healthy_recording(seconds=0.06), condition=None, attributes={"speed": "860 rpm"}
            ),
            "short",
            "shorter than one",
            id="short by the speed in its attributes",
        ),
    ],
)
def test_a_recording_that_nothing_can_be_learned_from_is_refused(
    recording: Recording, kind: str, message: str
) -> None:
    (finding,) = inspect_recording(recording).findings

    assert (finding.kind, finding.severity) == (kind, "error")
    assert message in finding.message
    with pytest.raises(DataError, match=message):
        require_usable(recording)


@pytest.mark.parametrize(
    ("recording", "kind", "message"),
    [
        pytest.param(
            overwrite_samples(healthy_recording(), 5000, 5001, 1e20).replace(condition=None),
            "spikes",
            "to 1e+20 m/s^2: spikes",
            id="spike",
        ),
        # a transmission that repeats the last value until it is up again
        pytest.param(
            overwrite_samples(healthy_recording(), 6400, 6480, 0.25),
            "flat",
            "the longest is 0.0125 s at 1 s",
            id="flat part",
        ),
        # a sensor for static acceleration, which also measures gravity
        pytest.param(
            healthy_recording().replace(signal=healthy_recording().signal + 9.81),
            "offset",
            "times the vibration's std",
            id="offset",
        ),
    ],
)
def test_a_doubtful_channel_is_a_warning_and_stays_usable(
    recording: Recording, kind: str, message: str
) -> None:
    (finding,) = inspect_recording(recording).findings

    assert (finding.kind, finding.severity) == (kind, "warning")
    assert message in finding.message
    require_usable(recording)


# 1.5 clips every period, 2.5 only those of the swell
@pytest.mark.parametrize("limit", [1.5, 2.5])
def test_clipping_is_a_warning_with_the_share_of_clipped_samples(limit: float) -> None:
    signal = np.clip(smooth_sine(), -limit, limit)
    clipped = replace(healthy_recording(), signal=signal[None], condition=None)

    (finding,) = inspect_recording(clipped).findings

    clipped_share = np.mean(np.abs(signal) == limit)
    assert (finding.kind, finding.severity) == ("clipping", "warning")
    assert f"({clipped_share:.2%})" in finding.message
    require_usable(clipped)


def test_a_coarsely_quantized_sine_is_not_clipped() -> None:
    # Its extremes repeat since a slow sine changes by less than a step there.
    time = np.arange(N_SAMPLES) / RATE
    signal = np.round(200 * np.sin(2 * np.pi * 14.3 * time)) / 10
    quantized = replace(healthy_recording(), signal=signal[None], condition=None)

    assert inspect_recording(quantized).findings == ()


def pulse_recordings(value: float) -> list[Recording]:
    """Return two recordings of zeros in which every seventh sample has a value."""
    signal = np.zeros((1, N_SAMPLES))
    signal[0, ::7] = value
    return [
        replace(healthy_recording(), signal=signal, condition=None, recording_id=name)
        for name in "ab"
    ]


def error_kinds(report: RecordingReport) -> list[str]:
    return [finding.kind for finding in report.findings if finding.severity == "error"]


# The squares of both exceed the greatest double; of the second also the sum of two samples.
@pytest.mark.parametrize("value", [1e300, 1.7e308])
def test_samples_whose_squares_overflow_are_an_error(value: float) -> None:
    recordings = pulse_recordings(value)

    report = inspect_recordings(recordings).recordings[0]

    assert error_kinds(report) == ["too_large"]
    with pytest.raises(DataError, match="larger than a window can hold"):
        require_usable(recordings[0])


def test_samples_whose_squares_vanish_are_no_error() -> None:
    report = inspect_recordings(pulse_recordings(3e-300)).recordings[0]

    assert error_kinds(report) == []


# ---- speed and rate


@pytest.mark.parametrize("specified_rpm", [800.0, 830.0, 900.0, 930.0])
def test_lines_that_contradict_the_specified_speed_are_a_warning(specified_rpm: float) -> None:
    (finding,) = inspect_recording(healthy_recording(specified_rpm=specified_rpm)).findings

    assert (finding.kind, finding.severity) == ("speed", "warning")
    assert "(860 rev/min)" in finding.message
    assert f"the specified {specified_rpm:.0f} rev/min" in finding.message


@pytest.mark.parametrize("seed", range(5))
def test_noise_without_lines_contradicts_no_speed(seed: int) -> None:
    assert inspect_recording(healthy_recording(seed, has_lines=False)).findings == ()


# The file's name states 700 rpm, but the lines are those of 720.
@pytest.mark.parametrize(
    ("specified", "expected_kinds"),
    [("720 rpm", []), ("700 rpm", ["speed"]), ("680 rpm", ["speed"])],
)
def test_a_cavitating_pump_contradicts_a_speed_it_did_not_run_at(
    public_data: Path, specified: str, expected_kinds: list[str]
) -> None:
    path = public_data / "pump_cavitation" / "recordings" / "05_1_s700_cavitation100.dat.gz"
    recording = load_recording(path, unit="1", channels=["ch 0"], speed=specified)

    assert kinds(inspect_recording(recording)) == expected_kinds


@pytest.mark.parametrize(
    ("rate", "intended"),
    [
        pytest.param(RATE / 1000, "6.4 kHz", id="kHz specified as Hz"),
        pytest.param(RATE * 1000, "6400 Hz", id="Hz specified as kHz"),
    ],
)
@pytest.mark.parametrize("unit", ["m/s^2", "1"])
def test_a_rate_that_is_off_by_a_thousand_is_a_warning_with_the_likely_one(
    rate: float, intended: str, unit: str
) -> None:
    report = inspect_recording(replace(healthy_recording(), sample_rate=rate, unit=unit))

    (finding,) = [finding for finding in report.findings if finding.kind == "rate"]
    assert finding.severity == "warning"
    assert f'If {intended} was meant, set sample_rate = "{intended}".' in finding.describe()


@pytest.mark.parametrize(
    ("rate", "unit"),
    [
        pytest.param(10.0, "1", id="slow, without a unit"),
        pytest.param(1.0, "bar", id="pressure once a second"),
        pytest.param(200.0, "m/s^2", id="slow accelerometer"),
        pytest.param(250e3, "m/s^2", id="fast accelerometer"),
        pytest.param(2e6, "V", id="acoustic emission"),
    ],
)
def test_rates_of_slow_and_fast_sensors_are_not_questioned(rate: float, unit: str) -> None:
    recording = replace(healthy_recording(), sample_rate=rate, unit=unit, condition=None)

    assert inspect_recording(recording).findings == ()


# ---- between recordings


def test_two_classes_with_names_of_healthy_ones_are_reported() -> None:
    # "gut" is German for good
    recordings = [
        replace(healthy_recording(seed, seconds=1.0), label=label)
        for seed, label in enumerate(["normal", "gut"])
    ]

    (finding,) = findings_between(recordings, "several_healthy")

    assert finding.message == "2 classes are healthy by name: gut, normal; relabel one."


# A classifier would tell classes apart by their rate.
def test_rates_that_differ_between_classes_are_an_error() -> None:
    faster = replace(healthy_recording(1), label="piston", sample_rate=2 * RATE, condition=None)

    report = inspect_recordings([healthy_recording(), faster])

    (finding,) = [finding for finding in report.findings if finding.kind == "rate"]
    assert finding.severity == "error"
    assert "6400 Hz: r0 (normal); 12800 Hz: r1 (piston)" in finding.message
    assert report.has_errors


def test_rates_that_differ_within_a_class_are_an_error() -> None:
    faster = replace(healthy_recording(1), sample_rate=2 * RATE, condition=None)

    findings = findings_between([healthy_recording(), faster], "rate")

    assert [finding.severity for finding in findings] == ["error"]


def test_classes_too_small_to_be_split_are_reported() -> None:
    recordings = [
        healthy_recording(),
        healthy_recording(1),
        replace(healthy_recording(2), label="piston"),
        replace(healthy_recording(3), label=None),
    ]

    report = inspect_recordings(recordings)

    severities = {finding.kind: finding.severity for finding in report.findings}
    assert severities == {"one_specimen": "note", "one_recording": "warning", "unlabeled": "note"}
    assert not report.has_errors


def test_a_level_far_from_that_of_its_class_is_a_warning() -> None:
    recordings = []
    for seed in range(4):
        recording = healthy_recording(seed)
        both_channels = np.repeat(recording.signal, 2, axis=0)
        recordings.append(replace(recording, signal=both_channels, channels=("x", "y")))
    recordings[3] = replace(recordings[3], signal=100 * recordings[3].signal)

    # as loud, but alone in its class
    lone_recording = replace(recordings[3], recording_id="b", label="piston")

    (finding,) = findings_between([*recordings, lone_recording], "level")

    assert finding.severity == "warning"
    assert re.fullmatch(
        r"the level of r3 is not that of normal: [\d.]+ m/s\^2 in x "
        r"\(\S+ times the median \S+\), [\d.]+ m/s\^2 in y .*",
        finding.message,
    )


# ---- long recordings


def recordings_with_findings() -> list[Recording]:
    """Return recordings that each have a finding, around sample 6400 if it is of some samples."""
    # a converter of 12 bits that clips, with steps of 3.98 mm/s^2
    counts = np.clip(np.round(healthy_recording(has_lines=False).signal * 700), -2048, 2047)

    return [
        healthy_recording(specified_rpm=900.0),
        replace(healthy_recording(1), signal=np.clip(smooth_sine(), -2.5, 2.5)[None]),
        replace(healthy_recording(2), signal=counts * 0.00398),
        overwrite_samples(healthy_recording(3), 6390, 6480, 0.25),
        overwrite_samples(healthy_recording(4), 6390, 6480, np.nan),
        replace(healthy_recording(5), signal=healthy_recording(5).signal + 9.81),
        replace(healthy_recording(), recording_id="copy"),
    ]


def test_a_copy_of_a_recording_is_reported() -> None:
    (finding,) = findings_between(recordings_with_findings(), "duplicate")

    assert "hold the same samples" in finding.message


def test_a_recording_inspected_in_parts_has_the_findings_of_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recordings = recordings_with_findings()
    whole = inspect_recordings(recordings)

    # the border between two parts lies within the flat part and the gap
    for module in ("channel_statistics", "channel_checks"):
        monkeypatch.setattr(f"swashtwin.recordings.{module}.PART_SAMPLES", 6401)
    in_parts = inspect_recordings(recordings)

    assert in_parts.findings == whole.findings
    for report, expected in zip(in_parts.recordings, whole.recordings, strict=True):
        assert kinds(report) == kinds(expected)
        for name in ("minimum", "maximum", "rms", "std"):
            value = getattr(report.channels[0], name)
            expected_value = getattr(expected.channels[0], name)
            assert value == pytest.approx(expected_value, rel=1e-12)


def test_many_findings_of_one_kind_about_the_set_are_counted() -> None:
    unreadable = [Finding("unreadable", "error", None, f"{n}.csv is empty.") for n in range(30)]
    report = inspect_recordings([healthy_recording()], unreadable=unreadable)

    texts = [text for severity, text in report.merged(by_kind=False) if severity == "error"]

    assert texts == ["0.csv is empty.", "1.csv is empty.", "2.csv is empty. (Similar: 27 more.)"]
    # The full report has them all.
    assert len(report.findings) >= len(unreadable)
