"""Units, scales and rates come from the file or its entry, which must not contradict each other."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
from recording_files import some_recording
from scipy.io import savemat

from swashtwin.foundation import DataError, MPa, UnitError, celsius, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, load_recording, write_recording

G = 9.80665


# ---- units


@pytest.mark.parametrize(
    ("unit", "factor", "expected"),
    [
        ("g", G, "m/s^2"),
        ("mg", 1e-3 * G, "m/s^2"),
        ("mm/s^2", 1e-3, "m/s^2"),
        ("m/s²", 1.0, "m/s^2"),
        ("Pa", 1.0, "Pa"),
        ("mm/s", 1.0, "mm/s"),
        ("1", 1.0, "1"),
    ],
)
def test_only_accelerations_are_converted_to_si(
    tmp_path: Path, unit: str, factor: float, expected: str
) -> None:
    (tmp_path / "a.csv").write_text("a\n1.5\n2.5\n")

    loaded = load_recording(tmp_path / "a.csv", sample_rate="1 kHz", unit=unit)

    np.testing.assert_allclose(loaded.signal, [[1.5 * factor, 2.5 * factor]])
    assert loaded.unit == expected
    assert loaded.sample_rate == 1000.0


# A logger writes temperature and pressure beside the vibration.
@pytest.mark.parametrize(
    ("heading", "note"),
    [
        ("Temp [°C]", "Temp (in degC)"),
        ("oil_temperature", "oil_temperature (a temperature)"),
        ("Druck", "Druck (a pressure)"),
        ("PT1 [bar]", "PT1 (in bar)"),
    ],
)
def test_a_unit_of_acceleration_applies_to_no_temperature_or_pressure(
    heading: str, note: str, tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_text(f"x,y,{heading}\n1.5,2.5,40\n3.5,4.5,41\n2.5,3.5,42\n")

    loaded = load_recording(tmp_path / "a.csv", sample_rate="1 kHz", unit="g")

    assert loaded.channels == ("x", "y")
    assert loaded.attributes["other_columns"] == note


# ---- sensitivities


@pytest.fixture
def integer_wav(tmp_path: Path) -> Path:
    """Return a WAV file of integers, whose full scale stands for an unknown acceleration."""
    samples = np.array([[0.5, 0.25], [-0.5, 0.125]])
    soundfile.write(tmp_path / "a.wav", samples, 48000, subtype="PCM_16")
    return tmp_path / "a.wav"


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        pytest.param(
            {"unit": "g"},
            "without a scale. Set sensitivity='50 m/s\\^2'",
            id="unit alone",
        ),
        pytest.param(
            {"sensitivity": "100 mV/g", "unit": "V"},
            "100 mV/g is for channels in mV. Set .* sensitivity='50 m/s\\^2'",
            id="sensitivity for volts",
        ),
        pytest.param(
            {"sensitivity": "50 m/s^2", "unit": "g"},
            r"Remove unit, or set it for the other files only, not in \[def",
            id="sensitivity and unit",
        ),
    ],
)
def test_an_integer_wav_without_a_scale_is_refused(
    integer_wav: Path, facts: dict[str, str], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        load_recording(integer_wav, **facts)


def test_an_integer_wav_is_scaled_by_its_sensitivities(integer_wav: Path) -> None:
    loaded = load_recording(integer_wav, sensitivity=["50 m/s^2", "10 g"])

    expected = [[25, -25], [2.5 * G, 1.25 * G]]
    np.testing.assert_allclose(loaded.signal, expected, rtol=1e-12)


def test_an_integer_wav_without_a_unit_keeps_its_share_of_the_full_scale(
    integer_wav: Path,
) -> None:
    assert load_recording(integer_wav, unit="1").signal[0, 0] == 0.5


def assert_scaled(path: Path, facts: Mapping[str, Any], factors: tuple[float, float]) -> None:
    """Check that samples 1, -3 and 2, 4 of two channels have these factors in g."""
    loaded = load_recording(path, sample_rate=1000, **facts)

    in_g = np.array([[1, -3], [2, 4]]) * np.array(factors)[:, None]
    np.testing.assert_allclose(loaded.signal, G * in_g)


@pytest.mark.parametrize(
    ("facts", "factors"),
    [
        ({"sensitivity": "0.5 g"}, (0.5, 0.5)),
        ({"sensitivity": "0.488 mg/count"}, (4.88e-4, 4.88e-4)),
        ({"sensitivity": "256 LSB/g"}, (1 / 256, 1 / 256)),
        ({"sensitivity": ["100 mV/g", "0.05 V/g"], "unit": "V"}, (10, 20)),
        ({"sensitivity": ["10 g/V"], "unit": "mV"}, (0.01, 0.01)),
        ({"sensitivity": ["b=2 g", "a=1 g"], "unit": "1"}, (1, 2)),
    ],
    ids=lambda value: str(value.get("sensitivity")) if isinstance(value, dict) else None,
)
def test_a_sensitivity_gives_the_acceleration_of_a_number(
    facts: dict[str, Any], factors: tuple[float, float], tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1,2\n-3,4\n")

    assert_scaled(tmp_path / "a.csv", {"names": ["a", "b"], **facts}, factors)


# A channel is named by its heading or by its new name, also with a pattern.
def test_sensitivities_by_channel_use_the_names_of_file_and_entry(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("first,b\n1,2\n-3,4\n")
    facts = {
        "sensitivity": ["second=2 g", "fi*=1 g"],
        "unit": "1",
        "names": ["first", "second"],
    }

    assert_scaled(tmp_path / "a.csv", facts, (1, 2))


# ---- invalid facts


def assert_refused(
    folder: Path, facts: Mapping[str, Any], error: type[Exception], message: str
) -> None:
    """Check that a table without rate and unit is refused in one line with these facts."""
    path = folder / "a.csv"
    path.write_text("a,b\n1.5,2.5\n3.5,4.5\n")

    with pytest.raises(error, match=message) as refusal:
        load_recording(path, **facts)

    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("facts", "error", "message"),
    [
        ({"sample_rate": 1000}, DataError, "Set unit='g'"),
        ({"unit": "g"}, DataError, "Set sample_rate='25.6 kHz'"),
        ({"unit": "bananas", "sample_rate": 1000}, UnitError, "Unknown unit"),
        ({"unit": "g", "sample_rate": "1000"}, UnitError, "no unit"),
        ({"unit": "g", "sample_rate": -5}, DataError, "must be positive"),
    ],
    ids=["no unit", "no rate", "unknown unit", "rate without a unit", "negative rate"],
)
def test_a_missing_or_invalid_unit_or_rate_is_refused(
    tmp_path: Path, facts: dict[str, Any], error: type[Exception], message: str
) -> None:
    assert_refused(tmp_path, facts, error, message)


@pytest.mark.parametrize(
    ("fact", "error", "message"),
    [
        ({"channels": ["c"]}, DataError, "it has 0 'a', 1 'b'"),
        ({"channels": [2]}, DataError, "it has 0 'a', 1 'b'"),
        ({"names": ["one"]}, DataError, "1 name for 2 channels"),
        ({"labl": "normal"}, DataError, "did you mean 'label'"),
        ({"label": 3}, DataError, "label: expected text"),
        ({"speed": "14.3 1/s"}, UnitError, "is a frequency; write it as"),
        ({"discharge_pressure": "0 MPa"}, DataError, "must be above zero"),
        # the discharge pressure of a pump exceeds its suction pressure of 0.1 MPa
        ({"speed": "860 rpm", "discharge_pressure": "15 Pa"}, DataError, "must exceed"),
        ({"resample": "333.777 Hz"}, DataError, "ratio of whole numbers"),
        ({"resample": "1e308 Hz"}, DataError, "not a rate of a measurement"),
        ({"sha256": "0" * 64}, DataError, "not the file that was indexed"),
        ({"time_column": "z"}, DataError, "no column 'z' for time_column"),
        ({"separator": ";", "decimal": ","}, DataError, "no table of numbers"),
    ],
    ids=lambda value: ", ".join(value) if isinstance(value, dict) else None,
)
def test_an_invalid_fact_is_refused_in_one_line(
    tmp_path: Path, fact: dict[str, Any], error: type[Exception], message: str
) -> None:
    assert_refused(tmp_path, {"unit": "g", "sample_rate": 1000, **fact}, error, message)


@pytest.mark.parametrize(
    ("facts", "error", "message"),
    [
        pytest.param({"sensitivity": "much"}, UnitError, "number with its unit", id="word"),
        pytest.param(
            {"sensitivity": ["1 g"] * 3},
            DataError,
            "3 sensitivities for 2 channels",
            id="one too many",
        ),
        pytest.param(
            {"sensitivity": "1 furlong/count", "channels": ["a"]},
            UnitError,
            "number with its unit",
            id="unit of length",
        ),
        pytest.param(
            {"sensitivity": "1 mV/g"},
            DataError,
            "Set unit='V' or unit='mV'",
            id="samples without a unit",
        ),
        pytest.param(
            {"sensitivity": "1 mV/g", "unit": "g"},
            DataError,
            "is for channels in mV",
            id="samples in g, not in volts",
        ),
        pytest.param(
            {"sensitivity": "1 g", "unit": "g"},
            DataError,
            "'a' is in g already",
            id="samples in g, not in counts",
        ),
        pytest.param(
            {"sensitivity": ["c=1 g"]}, DataError, "names no channel", id="unknown channel"
        ),
    ],
)
def test_a_sensitivity_that_does_not_fit_the_channels_is_refused(
    tmp_path: Path, facts: dict[str, Any], error: type[Exception], message: str
) -> None:
    assert_refused(tmp_path, {"sample_rate": 1000, **facts}, error, message)


# ---- contradictions between a file and its entry


def test_a_rate_that_contradicts_the_file_is_refused_with_both(tmp_path: Path) -> None:
    path = write_recording(some_recording(), tmp_path / "a.h5")

    with pytest.raises(DataError, match=r"25600 Hz, but 12800 Hz is specified"):
        load_recording(path, sample_rate="12.8 kHz")


def test_a_rate_close_to_that_of_the_file_overrides_it(tmp_path: Path) -> None:
    # The clock of an instrument was measured more accurately than it states.
    path = write_recording(some_recording(), tmp_path / "a.h5")

    assert load_recording(path, sample_rate="25.61 kHz").sample_rate == 25610.0


CONDITION = OperatingCondition(rpm(860), MPa(15))


@pytest.fixture
def file_with_condition(tmp_path: Path) -> Path:
    recording = Recording(np.arange(8.0)[None], 1000.0, "a", condition=CONDITION)
    return write_recording(recording, tmp_path / "a.h5")


def test_an_operating_point_in_a_file_is_completed_and_refined(file_with_condition: Path) -> None:
    loaded = load_recording(file_with_condition, speed="865 rpm", oil_temperature="50 degC")

    expected = replace(CONDITION, speed=rpm(865), oil_temperature=celsius(50))
    assert loaded.condition == expected


def test_an_operating_point_in_another_unit_agrees_with_the_file(
    file_with_condition: Path,
) -> None:
    loaded = load_recording(file_with_condition, discharge_pressure="150 bar")

    assert loaded.condition == CONDITION


def test_an_operating_point_that_contradicts_the_file_is_refused_with_both(
    file_with_condition: Path,
) -> None:
    message = r"an operating point of 860 rpm and 15 MPa, but 860 rpm and 12 MPa is specified"
    with pytest.raises(DataError, match=message):
        load_recording(file_with_condition, discharge_pressure="120 bar")


# ---- vectors and rates


@pytest.fixture
def bearing_file(tmp_path: Path) -> Path:
    """Return a file laid out as those of the bearing data center of Case Western Reserve."""
    variables = {"X105_DE_time": np.ones(10), "X105_FE_time": np.ones(9), "X105RPM": 1797.0}
    savemat(tmp_path / "a.mat", variables)
    return tmp_path / "a.mat"


def test_vectors_of_several_lengths_are_refused_together(bearing_file: Path) -> None:
    with pytest.raises(DataError, match="X105_DE_time: 10, X105_FE_time: 9"):
        load_recording(bearing_file, sample_rate=12000, unit="g")


def test_a_vector_is_selected_by_a_pattern(bearing_file: Path) -> None:
    loaded = load_recording(
        bearing_file, sample_rate=12000, unit="g", channels=["*_DE_time"], speed="1797 rpm"
    )

    assert loaded.channels == ("X105_DE_time",)

    # a speed without a pressure is no operating point
    assert loaded.condition is None
    assert loaded.attributes["speed"] == "1797 rpm"
    assert loaded.attributes["X105RPM"] == "1797"


def test_a_resampling_keeps_a_tone_and_is_recorded(tmp_path: Path) -> None:
    time = np.arange(4800) / 48000
    savemat(tmp_path / "a.mat", {"x": 3 + np.sin(2 * np.pi * 500 * time), "fs": 48000.0})

    loaded = load_recording(tmp_path / "a.mat", unit="1", resample="12 kHz")

    # the filter needs some samples at both ends
    expected = 3 + np.sin(2 * np.pi * 500 * loaded.time)
    np.testing.assert_allclose(loaded.signal[0, 50:-50], expected[50:-50], atol=2e-3)
    assert loaded.sample_rate == 12000.0
    assert "from 48000 Hz to 12000 Hz" in loaded.attributes["resampled"]
