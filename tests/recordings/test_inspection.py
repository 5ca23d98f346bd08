"""What a careful person would see in a measurement is found, and a good one raises no alarm."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError, MPa, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import (
    Recording,
    RecordingReport,
    inspect_recordings,
    load_recording,
    require_usable,
)

RATE = 6400.0


def inspect_recording(recording: Recording) -> RecordingReport:
    return inspect_recordings([recording]).recordings[0]


def good(
    seed: int = 0, *, seconds: float = 6.0, speed: float = 860.0, lines: bool = True
) -> Recording:
    """Noise with lines at the shaft's and the pistons' multiples."""
    generator = np.random.default_rng(seed)
    time = np.arange(int(seconds * RATE)) / RATE
    signal = generator.standard_normal(len(time))
    if lines:
        for order in (1, 2, 3, 4, 5, 7, 9, 14):
            signal += 0.4 * np.sin(2 * np.pi * order * 860 / 60 * time + order)
    condition = OperatingCondition(speed=rpm(speed), discharge_pressure=MPa(15.0))
    return Recording(
        signal=signal[None],
        sample_rate=RATE,
        recording_id=f"r{seed}",
        label="normal",
        specimen="A",
        condition=condition,
    )


def changed(recording: Recording, start: int, stop: int, value: float) -> Recording:
    signal = recording.signal.copy()
    signal[0, start:stop] = value
    return replace(recording, signal=signal)


def kinds(report: RecordingReport) -> list[str]:
    return [finding.kind for finding in report.findings]


def test_two_healthy_classes_are_named() -> None:
    recordings = [
        replace(good(number, seconds=1.0), label=label)
        for number, label in enumerate(("normal", "gut"))
    ]
    messages = {
        finding.kind: finding.message for finding in inspect_recordings(recordings).findings
    }
    assert messages["several_healthy"] == "2 classes are healthy by name: gut, normal; relabel one."


def test_a_good_recording_raises_no_alarm() -> None:
    report = inspect_recording(good())
    assert report.findings == ()
    (channel,) = report.channels
    signal = good().signal[0]
    assert (channel.minimum, channel.maximum) == (signal.min(), signal.max())
    assert channel.rms == pytest.approx(np.sqrt((signal**2).mean()))
    assert (report.duration, report.sample_rate, report.unit) == (6.0, RATE, "m/s^2")
    require_usable(good())


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_missing_samples_are_errors(value: float) -> None:
    broken = changed(good(), 640, 642, value)
    report = inspect_recording(broken)
    assert "nan" in kinds(report)
    assert (
        "2 of 38400 samples are missing or infinite, the first at 0.1 s"
        in report.findings[0].message
    )
    assert np.isfinite(report.channels[0].maximum)
    with pytest.raises(DataError, match="r0, acceleration: 2 of 38400 samples"):
        require_usable(broken)


@pytest.mark.parametrize(
    ("recording", "kind", "words"),
    [
        (
            replace(good(), signal=np.full((1, 6400), np.nan)),
            "nan",
            "6400 of 6400 samples are missing or infinite",
        ),
        (changed(good(), 0, 38400, 2.5), "constant", "every sample is 2.5"),
        (good(seconds=0.06), "short", "shorter than one revolution at 860 rev/min"),
        (
            replace(good(seconds=0.06), condition=None, attributes={"speed": "860 rpm"}),
            "short",
            "shorter than one",
        ),
        (
            changed(good(), 5000, 5001, 1e20).replace(condition=None),
            "spikes",
            "to 1e+20 m/s^2: spikes",
        ),
        (changed(good(), 6400, 6480, 0.25), "flat", "the longest is 0.0125 s at 1 s"),
        (good().replace(signal=good().signal + 9.81), "offset", "times the vibration's std"),
    ],
)
def test_what_is_wrong_with_a_channel_is_found_and_what_nothing_can_be_learned_from_is_refused(
    recording: Recording, kind: str, words: str
) -> None:
    (finding,) = inspect_recording(recording).findings
    assert (finding.kind, words in finding.message) == (kind, True)
    assert finding.severity == ("error" if kind in ("nan", "constant", "short") else "warning")
    if finding.severity == "warning":
        require_usable(recording)
        return
    with pytest.raises(DataError, match=words):
        require_usable(recording)


@pytest.mark.parametrize("limit", [1.5, 2.5])
def test_clipping_is_a_warning_with_its_share(limit: float) -> None:
    time = np.arange(38400) / RATE
    smooth = 3 * np.sin(2 * np.pi * 50 * time) * (1 + 0.3 * np.sin(2 * np.pi * 3 * time))
    clipped = replace(good(), signal=np.clip(smooth, -limit, limit)[None], condition=None)
    (finding,) = inspect_recording(clipped).findings
    assert (finding.kind, finding.severity) == ("clipping", "warning")
    share = np.mean(np.abs(clipped.signal) == limit)
    assert f"({share:.2%})" in finding.message
    require_usable(clipped)


@pytest.mark.parametrize(
    ("value", "errors"), [(1e300, ["too_large"]), (1.7e308, ["too_large"]), (3e-300, [])]
)
def test_samples_whose_squares_overflow_or_vanish_are_inspected(
    value: float, errors: list[str]
) -> None:
    signal = np.zeros((1, 38400))
    signal[0, ::7] = value
    recordings = [
        replace(good(), signal=signal, condition=None, recording_id=name) for name in "ab"
    ]
    report = inspect_recordings(recordings)
    assert [
        finding.kind for finding in report.recordings[0].findings if finding.severity == "error"
    ] == errors
    if errors:
        with pytest.raises(DataError, match="larger than a window can hold"):
            require_usable(recordings[0])


def test_a_finely_sampled_sine_is_not_called_clipped() -> None:
    time = np.arange(38400) / RATE
    coarse = np.round(200 * np.sin(2 * np.pi * 14.3 * time)) / 10
    assert inspect_recording(replace(good(), signal=coarse[None], condition=None)).findings == ()


@pytest.mark.parametrize("stated", [800.0, 830.0, 900.0, 930.0])
def test_lines_beside_the_stated_speed_are_a_warning(stated: float) -> None:
    (finding,) = inspect_recording(good(speed=stated)).findings
    assert (finding.kind, finding.severity) == ("speed", "warning")
    assert "(860 rev/min)" in finding.message
    assert f"the specified {stated:.0f} rev/min" in finding.message


@pytest.mark.parametrize("seed", range(5))
def test_noise_without_lines_contradicts_no_speed(seed: int) -> None:
    assert inspect_recording(good(seed, lines=False)).findings == ()


@pytest.mark.parametrize(("rate", "meant"), [(RATE / 1000, "6.4 kHz"), (RATE * 1000, "6400 Hz")])
@pytest.mark.parametrize("unit", ["m/s^2", "1"])
def test_a_rate_in_khz_that_was_given_as_hz_or_the_other_way_is_a_warning(
    rate: float, meant: str, unit: str
) -> None:
    findings = inspect_recording(replace(good(), sample_rate=rate, unit=unit)).findings
    (finding,) = [finding for finding in findings if finding.kind == "rate"]
    assert finding.severity == "warning"
    assert f'If {meant} was meant, set sample_rate = "{meant}".' in finding.describe()


@pytest.mark.parametrize(
    ("rate", "unit"), [(10.0, "1"), (1.0, "bar"), (250e3, "m/s^2"), (200.0, "m/s^2"), (2e6, "V")]
)
def test_rates_of_slow_sensors_and_of_fast_ones_are_not_questioned(rate: float, unit: str) -> None:
    recording = replace(good(), sample_rate=rate, unit=unit, condition=None)
    assert inspect_recording(recording).findings == ()


# ---- between recordings


def test_rates_that_differ_between_classes_are_an_error() -> None:
    other = replace(good(1), label="piston", sample_rate=2 * RATE, condition=None)
    report = inspect_recordings([good(), other])
    (rate,) = [finding for finding in report.findings if finding.kind == "rate"]
    assert rate.severity == "error"
    assert "6400 Hz: r0 (normal); 12800 Hz: r1 (piston)" in rate.message
    assert report.has_errors
    same = inspect_recordings([good(), replace(other, label="normal")])
    assert [finding.severity for finding in same.findings if finding.kind == "rate"] == ["error"]


def test_a_class_of_one_recording_or_one_specimen_is_found() -> None:
    report = inspect_recordings(
        [good(), good(1), replace(good(2), label="piston"), replace(good(3), label=None)]
    )
    severities = {finding.kind: finding.severity for finding in report.findings}
    assert severities == {"one_specimen": "note", "one_recording": "warning", "unlabeled": "note"}
    assert not report.has_errors


def test_a_level_far_from_that_of_its_class_is_a_warning() -> None:
    both = [
        replace(good(n), signal=np.repeat(good(n).signal, 2, 0), channels=("x", "y"))
        for n in range(4)
    ]
    both[3] = replace(both[3], signal=100 * both[3].signal)
    report = inspect_recordings([*both, replace(both[3], recording_id="b", label="piston")])
    (level,) = [finding for finding in report.findings if finding.kind == "level"]
    assert level.severity == "warning"
    assert re.fullmatch(
        r"the level of r3 is not that of normal: [\d.]+ m/s\^2 in x \(\S+ times the median \S+\), [\d.]+ m/s\^2 in y .*",
        level.message,
    )


def test_a_recording_looked_at_in_parts_gets_the_findings_of_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    time = np.arange(38400) / RATE
    smooth = 3 * np.sin(2 * np.pi * 50 * time) * (1 + 0.3 * np.sin(2 * np.pi * 3 * time))
    steps = np.clip(np.round(good(lines=False).signal * 700), -2048, 2047) * 0.00398
    recordings = [
        good(speed=900.0),
        replace(good(1), signal=np.clip(smooth, -2.5, 2.5)[None]),
        replace(good(2), signal=steps),
        changed(good(3), 6390, 6480, 0.25),
        changed(good(4), 6390, 6480, np.nan),
        replace(good(5), signal=good(5).signal + 9.81),
        replace(good(), recording_id="copy"),
    ]
    whole = inspect_recordings(recordings)
    (duplicate,) = [finding for finding in whole.findings if finding.kind == "duplicate"]
    assert "hold the same samples" in duplicate.message
    for module in ("channel_statistics", "channel_checks"):
        monkeypatch.setattr(f"swashtwin.recordings.{module}.PART_SAMPLES", 6401)
    parts = inspect_recordings(recordings)
    assert [kinds(report) for report in parts.recordings] == [
        kinds(report) for report in whole.recordings
    ]
    assert parts.findings == whole.findings
    for report, reference in zip(parts.recordings, whole.recordings, strict=True):
        for name in ("minimum", "maximum", "rms", "std"):
            assert getattr(report.channels[0], name) == pytest.approx(
                getattr(reference.channels[0], name), rel=1e-12
            )


# ---- public data


@pytest.mark.parametrize(
    ("stated", "contradicted"), [("720 rpm", False), ("700 rpm", True), ("680 rpm", True)]
)
def test_a_cavitating_pump_contradicts_a_speed_it_did_not_run_at(
    public_data: Path, stated: str, contradicted: bool
) -> None:
    path = public_data / "pump_cavitation" / "recordings" / "05_1_s700_cavitation100.dat.gz"
    report = inspect_recording(load_recording(path, unit="1", channels=["ch 0"], speed=stated))
    assert kinds(report) == (["speed"] if contradicted else [])
