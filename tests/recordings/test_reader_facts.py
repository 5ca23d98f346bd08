"""Units, scales and rates come from the file or the index, which must not contradict each other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recording_files import some_recording
from scipy.io import savemat

from swashtwin.foundation import DataError, MPa, UnitError, celsius, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, load_recording, write_recording


@pytest.fixture
def recording() -> Recording:
    return some_recording()


@pytest.mark.parametrize(
    ("unit", "factor", "expected"),
    [
        ("g", 9.80665, "m/s^2"),
        ("mg", 9.80665e-3, "m/s^2"),
        ("mm/s^2", 1e-3, "m/s^2"),
        ("m/s²", 1.0, "m/s^2"),
        ("Pa", 1.0, "Pa"),
        ("mm/s", 1.0, "mm/s"),
        ("1", 1.0, "1"),
    ],
)
def test_accelerations_become_si_and_the_rest_stays(
    tmp_path: Path, unit: str, factor: float, expected: str
) -> None:
    (tmp_path / "a.csv").write_text("a\n1.5\n2.5\n")
    loaded = load_recording(tmp_path / "a.csv", sample_rate="1 kHz", unit=unit)
    np.testing.assert_allclose(loaded.signal, [[1.5 * factor, 2.5 * factor]])
    assert (loaded.unit, loaded.sample_rate) == (expected, 1000.0)


def test_integer_wav_needs_to_be_told_its_scale(tmp_path: Path) -> None:
    import soundfile

    soundfile.write(
        tmp_path / "a.wav", np.array([[0.5, 0.25], [-0.5, 0.125]]), 48000, subtype="PCM_16"
    )
    for facts, message in (
        ({"unit": "g"}, "without a scale. Set sensitivity='50 m/s\\^2'"),
        (
            {"sensitivity": "100 mV/g", "unit": "V"},
            "100 mV/g is for channels in mV. Set .* sensitivity='50 m/s\\^2'",
        ),
        (
            {"sensitivity": "50 m/s^2", "unit": "g"},
            r"Remove unit, or set it for the other files only, not in \[def",
        ),
    ):
        with pytest.raises(DataError, match=message):
            load_recording(tmp_path / "a.wav", **facts)
    loaded = load_recording(tmp_path / "a.wav", sensitivity=["50 m/s^2", "10 g"])
    np.testing.assert_allclose(
        loaded.signal, [[25, -25], [2.5 * 9.80665, 1.25 * 9.80665]], rtol=1e-12
    )
    assert load_recording(tmp_path / "a.wav", unit="1").signal[0, 0] == 0.5


@pytest.mark.parametrize(
    ("facts", "error", "message"),
    [
        ({"sample_rate": 1000}, DataError, "Set unit='g'"),
        ({"unit": "g"}, DataError, "Set sample_rate='25.6 kHz'"),
        ({"unit": "bananas", "sample_rate": 1000}, UnitError, "Unknown unit"),
        ({"unit": "g", "sample_rate": "1000"}, UnitError, "no unit"),
        ({"unit": "g", "sample_rate": -5}, DataError, "must be positive"),
        ({"unit": "g", "sample_rate": 1000, "channels": ["c"]}, DataError, "it has 0 'a', 1 'b'"),
        ({"unit": "g", "sample_rate": 1000, "channels": [2]}, DataError, "it has 0 'a', 1 'b'"),
        ({"unit": "g", "sample_rate": 1000, "names": ["one"]}, DataError, "1 name for 2 channels"),
        ({"unit": "g", "sample_rate": 1000, "labl": "normal"}, DataError, "did you mean 'label'"),
        ({"unit": "g", "sample_rate": 1000, "label": 3}, DataError, "label: expected text"),
        (
            {"unit": "g", "sample_rate": 1000, "speed": "14.3 1/s"},
            UnitError,
            "is a frequency; write it as",
        ),
        (
            {"unit": "g", "sample_rate": 1000, "discharge_pressure": "0 MPa"},
            DataError,
            "must be above zero",
        ),
        (
            {"unit": "g", "sample_rate": 1000, "speed": "860 rpm", "discharge_pressure": "15 Pa"},
            DataError,
            "must exceed",
        ),
        ({"sensitivity": "much", "sample_rate": 1000}, UnitError, "number with its unit"),
        (
            {"sensitivity": ["1 g"] * 3, "sample_rate": 1000},
            DataError,
            "3 sensitivities for 2 channels",
        ),
        (
            {"sensitivity": "1 furlong/count", "sample_rate": 1000, "channels": ["a"]},
            UnitError,
            "number with its unit",
        ),
        ({"sensitivity": "1 mV/g", "sample_rate": 1000}, DataError, "Set unit='V' or unit='mV'"),
        (
            {"sensitivity": "1 mV/g", "unit": "g", "sample_rate": 1000},
            DataError,
            "is for channels in mV",
        ),
        (
            {"sensitivity": "1 g", "unit": "g", "sample_rate": 1000},
            DataError,
            "'a' is in g already",
        ),
        ({"sensitivity": ["c=1 g"], "sample_rate": 1000}, DataError, "names no channel"),
        (
            {"unit": "g", "sample_rate": 1000, "resample": "333.777 Hz"},
            DataError,
            "ratio of whole numbers",
        ),
        (
            {"unit": "g", "sample_rate": 1000, "resample": "1e308 Hz"},
            DataError,
            "not a rate of a measurement",
        ),
        (
            {"unit": "g", "sample_rate": 1000, "sha256": "0" * 64},
            DataError,
            "not the file that was indexed",
        ),
        (
            {"unit": "g", "sample_rate": 1000, "time_column": "z"},
            DataError,
            "no column 'z' for time_column",
        ),
        (
            {"unit": "g", "sample_rate": 1000, "separator": ";", "decimal": ","},
            DataError,
            "no table of numbers",
        ),
    ],
)
def test_a_wrong_or_missing_fact_is_refused(
    tmp_path: Path, facts: dict[str, object], error: type[Exception], message: str
) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1.5,2.5\n3.5,4.5\n")
    with pytest.raises(error, match=message) as caught:
        load_recording(tmp_path / "a.csv", **facts)
    assert "\n" not in str(caught.value)


def test_a_rate_that_contradicts_the_file_names_both(recording: Recording, tmp_path: Path) -> None:
    path = write_recording(recording, tmp_path / "a.h5")
    with pytest.raises(DataError, match=r"25600 Hz, but 12800 Hz is specified"):
        load_recording(path, sample_rate="12.8 kHz")
    assert load_recording(path, sample_rate="25.61 kHz").sample_rate == 25610.0


@pytest.mark.parametrize(
    ("sensitivity", "unit", "factors"),
    [
        ("0.5 g", None, (0.5, 0.5)),
        ("0.488 mg/count", None, (4.88e-4, 4.88e-4)),
        ("256 LSB/g", None, (1 / 256, 1 / 256)),
        (["100 mV/g", "0.05 V/g"], "V", (10, 20)),
        (["10 g/V"], "mV", (0.01, 0.01)),
        (["b=2 g", "a=1 g"], "1", (1, 2)),
        (["second=2 g", "fi*=1 g"], "1", (1, 2)),
    ],
)
def test_a_sensitivity_says_what_numbers_stand_for(
    sensitivity: str | list[str], unit: str | None, factors: tuple[float, float], tmp_path: Path
) -> None:
    names = ["first", "second"] if "second" in str(sensitivity) else ["a", "b"]
    (tmp_path / "a.csv").write_text(
        "first,b\n1,2\n-3,4\n" if "second" in str(sensitivity) else "a,b\n1,2\n-3,4\n"
    )
    facts = {"sample_rate": 1000, "sensitivity": sensitivity, "names": names} | (
        {"unit": unit} if unit else {}
    )
    scaled = load_recording(tmp_path / "a.csv", **facts)
    np.testing.assert_allclose(
        scaled.signal, 9.80665 * np.array([[1, -3], [2, 4]]) * np.array(factors)[:, None]
    )


def test_columns_of_several_lengths_must_be_chosen(tmp_path: Path) -> None:
    savemat(
        tmp_path / "a.mat",
        {"X105_DE_time": np.ones(10), "X105_FE_time": np.ones(9), "X105RPM": 1797.0},
    )
    with pytest.raises(DataError, match="X105_DE_time: 10, X105_FE_time: 9"):
        load_recording(tmp_path / "a.mat", sample_rate=12000, unit="g")
    loaded = load_recording(
        tmp_path / "a.mat", sample_rate=12000, unit="g", channels=["*_DE_time"], speed="1797 rpm"
    )
    assert loaded.channels == ("X105_DE_time",)
    assert (loaded.condition, loaded.attributes["speed"], loaded.attributes["X105RPM"]) == (
        None,
        "1797 rpm",
        "1797",
    )


def test_resampling_keeps_a_tone_and_says_so(tmp_path: Path) -> None:
    time = np.arange(4800) / 48000
    savemat(tmp_path / "a.mat", {"x": 3 + np.sin(2 * np.pi * 500 * time), "fs": 48000.0})
    loaded = load_recording(tmp_path / "a.mat", unit="1", resample="12 kHz")
    assert loaded.sample_rate == 12000.0
    np.testing.assert_allclose(
        loaded.signal[0, 50:-50], 3 + np.sin(2 * np.pi * 500 * loaded.time[50:-50]), atol=2e-3
    )
    assert "from 48000 Hz to 12000 Hz" in loaded.attributes["resampled"]


@pytest.mark.parametrize("heading", ["Temp [°C]", "oil_temperature", "Druck", "PT1 [bar]"])
def test_a_unit_of_acceleration_is_given_to_no_temperature(heading: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"x,y,{heading}\n1.5,2.5,40\n3.5,4.5,41\n2.5,3.5,42\n")
    loaded = load_recording(tmp_path / "a.csv", sample_rate="1 kHz", unit="g")
    assert loaded.channels == ("x", "y")
    assert loaded.attributes["other_columns"] == heading.partition(" [")[0]


def test_a_condition_in_a_file_is_completed_and_not_contradicted(tmp_path: Path) -> None:
    condition = OperatingCondition(rpm(860), MPa(15))
    path = tmp_path / "a.h5"
    write_recording(Recording(np.arange(8.0)[None], 1000.0, "a", condition=condition), path)
    assert load_recording(path, speed="865 rpm", oil_temperature="50 degC").condition == replace(
        condition, speed=rpm(865), oil_temperature=celsius(50)
    )
    assert load_recording(path, discharge_pressure="150 bar").condition == condition
    with pytest.raises(
        DataError,
        match=r"an operating point of 860 rpm and 15 MPa, but 860 rpm and 12 MPa is specified",
    ):
        load_recording(path, discharge_pressure="120 bar")
