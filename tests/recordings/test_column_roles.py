"""Which columns of a file are vibrations: a unit goes to them, and to no other column."""

from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
import scipy.io
from numpy.typing import ArrayLike

from swashtwin.foundation import DataError
from swashtwin.recordings import inspect_recordings, load_recording, propose_index

CASES = Path(__file__).parent / "cases"
RATE = 4000.0
N_SAMPLES = 1200
TIME_S = np.arange(N_SAMPLES) / RATE
NOISE = np.random.default_rng(4).standard_normal((4, N_SAMPLES))


def write_table(path: Path, columns: dict[str, ArrayLike]) -> Path:
    """Write columns as a table of the format of the suffix."""
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    if path.suffix == ".parquet":
        polars.DataFrame(arrays).write_parquet(path)
    else:
        polars.DataFrame(arrays).write_csv(path)
    return path


def notes_of(path: Path, **facts: Any) -> str:
    report = inspect_recordings([load_recording(path, **facts)])
    return " ".join(finding.message for finding in report.recordings[0].findings)


# ---- given files


@pytest.mark.parametrize(
    ("file", "channels", "note"),
    [
        ("K04-dbm.csv", ("acc_x", "acc_y"), "other quantities than vibration were skipped: RSSI "),
        ("K04-degF.csv", ("acc_x", "acc_y"), "other quantities than vibration were skipped: T "),
        (
            "K05-imu9.csv",
            ("ax", "ay", "az"),
            "gx (gyroscope?), gy (gyroscope?), gz (gyroscope?), mx (magnetometer?), "
            "my (magnetometer?), mz (magnetometer?), temp (a temperature)",
        ),
        (
            "K06-label_only.csv",
            ("ax", "ay"),
            "a class, a state or pulses were skipped: label (changes within the file: 0, 1, 2, 3)",
        ),
    ],
)
def test_only_vibrations_of_a_given_file_get_the_specified_unit(
    file: str, channels: tuple[str, ...], note: str
) -> None:
    facts = {"unit": "g", "sample_rate": "4 kHz"}

    assert load_recording(CASES / file, **facts).channels == channels
    assert note in notes_of(CASES / file, **facts)


# ---- units of other quantities

OTHER_HEADINGS = [
    *("RSSI (dBm)", "Battery (%)", "lat (deg)", "Mic (Pa/dB)", "Gyroscope x (rad/s)", "B (µT)"),
    *("Q [foo]", "W (kg/h)", "Kraft (daN)", "Licht / lx", "Feuchte (%rH)", "Leitwert (µS/cm)"),
    *("T (°F)", "S (foo)"),
]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("heading", OTHER_HEADINGS)
def test_a_column_with_another_unit_is_left_out_by_name(
    heading: str, suffix: str, tmp_path: Path
) -> None:
    path = write_table(
        tmp_path / f"a{suffix}", {"time (s)": TIME_S, "acc_x": NOISE[0], heading: NOISE[1]}
    )

    recording = load_recording(path, unit="g")

    assert recording.channels == ("acc_x",)
    assert recording.sample_rate == RATE
    assert recording.attributes["other_columns"].startswith(heading)


@pytest.mark.parametrize("heading", ["T (°F)", "p (psi)", "Weg (foo/s)"])
def test_another_quantity_that_rises_evenly_counts_no_samples(heading: str, tmp_path: Path) -> None:
    path = write_table(
        tmp_path / "a.csv", {"time": TIME_S, "acc": NOISE[0], heading: 20 + 5 * TIME_S}
    )

    recording = load_recording(path, unit="g")

    assert recording.channels == ("acc",)
    assert recording.attributes["other_columns"].startswith(heading.partition(" ")[0])
    assert "counter_columns" not in recording.attributes


def test_a_temperature_named_as_the_time_is_no_clock(tmp_path: Path) -> None:
    path = write_table(
        tmp_path / "a.csv", {"Zeit": TIME_S, "acc": NOISE[0], "T [degC]": 20 + TIME_S}
    )

    assert load_recording(path, unit="g").sample_rate == RATE


def test_a_unit_that_an_attribute_states_is_heeded_though_unknown(tmp_path: Path) -> None:
    scipy.io.savemat(
        tmp_path / "a.mat",
        {"x": NOISE[0], "s": NOISE[1], "s_unit": "dBm", "q": NOISE[2], "q_unit": "foo"},
    )

    recording = load_recording(tmp_path / "a.mat", unit="g", sample_rate=RATE)

    assert recording.channels == ("x",)
    assert recording.attributes["other_columns"] == "s (in dBm), q (in foo)"


def test_a_unit_of_tdms_that_is_unknown_is_heeded(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    channels = [
        nptdms.ChannelObject("g", "a", NOISE[0], properties={"wf_increment": 1 / RATE}),
        nptdms.ChannelObject(
            "g", "b", NOISE[1], properties={"wf_increment": 1 / RATE, "unit_string": "sone"}
        ),
    ]
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment(channels)

    assert load_recording(tmp_path / "a.tdms", unit="g").channels == ("a",)


def test_a_specified_unit_of_another_quantity_goes_to_columns_without_a_unit(
    tmp_path: Path,
) -> None:
    path = write_table(
        tmp_path / "a.csv", {"time": TIME_S, "p1": NOISE[0], "p2": NOISE[1], "T (°C)": NOISE[2]}
    )

    recording = load_recording(path, unit="bar")

    assert recording.channels == ("p1", "p2")
    assert recording.unit == "bar"


@pytest.mark.parametrize("heading", ["T (°F)", "RSSI (dBm)"])
def test_a_selected_column_keeps_its_own_unit(heading: str, tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", {"time": TIME_S, "acc": NOISE[0], heading: NOISE[1]})

    with pytest.raises(DataError, match=r"is in .*, but g is specified\. Set unit='1' to read"):
        load_recording(path, unit="g", channels=(heading,))
    assert load_recording(path, unit="1", channels=(heading,)).channels == (heading,)


# ---- names of other quantities

OTHER_NAMES = [
    *("gx", "my", "gyro_x", "gyr y", "GyroZ", "rotationRate.x", "mag_x", "MagY", "lat", "lon"),
    *("altitude", "Höhe", "Breitengrad", "battery", "Akku", "mic", "Mikrofon", "tacho", "temp"),
    *("Öltemperatur", "Drehzahl", "pressure", "heading", "roll", "vbat", "humidity", "setpoint"),
]


@pytest.mark.parametrize("name", OTHER_NAMES)
def test_a_column_named_as_another_quantity_is_left_out(name: str, tmp_path: Path) -> None:
    path = write_table(
        tmp_path / "a.csv", {"time": TIME_S, "ax": NOISE[0], "ay": NOISE[1], name: NOISE[2]}
    )

    recording = load_recording(path, unit="g")

    assert recording.channels == ("ax", "ay")
    assert recording.attributes["other_columns"].startswith(f"{name} (")


@pytest.mark.parametrize(
    "names",
    [
        ("Motor (DE)", "Motor (NDE)", "Pumpe"),
        ("DE", "FE", "BA"),
        ("load side", "Druckseite", "bearing 2"),
        ("gFx", "gFy", "gFz"),
        ("vib_pump", "Lager 1", "left"),
        ("acc (links)", "acc (rechts)"),
        ("X", "Y", "magnitude"),
    ],
)
def test_names_of_places_and_axes_are_those_of_vibrations(
    names: tuple[str, ...], tmp_path: Path
) -> None:
    columns = {"time": TIME_S} | dict(zip(names, NOISE, strict=False))

    recording = load_recording(write_table(tmp_path / "a.csv", columns), unit="g")

    assert recording.channels == names


PLACES_NAMED_AS_QUANTITIES = [
    *(("Position 1", "Position 2"), ("Hub left", "Hub right"), ("Level 1", "Level 2")),
    *(("Phase A", "Phase B"), ("Charge pump", "Main pump"), ("Power unit", "Main pump")),
    *(("lat", "vert", "long"), ("lat", "axial"), ("Hub", "Rotor", "Blade"), ("Roll 1", "Roll 2")),
    *(("Pitch bearing", "Main bearing"), ("Yaw drive", "Tower"), ("Gas turbine", "Generator")),
    *(("Strecke 1", "Strecke 2"), ("Höhe", "quer", "längs"), ("Supply pump", "Motor")),
    *(("Position links", "Position rechts"), ("Encoder flange", "Fan"), ("Depth 1", "Depth 2")),
]


@pytest.mark.parametrize("unit", ["g", "mm/s"])
@pytest.mark.parametrize("names", PLACES_NAMED_AS_QUANTITIES, ids=" ".join)
def test_places_whose_names_are_also_quantities_are_vibrations(
    names: tuple[str, ...], unit: str, tmp_path: Path
) -> None:
    columns = {"time": TIME_S} | dict(zip(names, NOISE, strict=False))

    recording = load_recording(write_table(tmp_path / "a.csv", columns), unit=unit)

    assert recording.channels == names


@pytest.mark.parametrize(
    ("names", "channels"),
    [
        (("ax", "ay", "position 1"), ("ax", "ay")),
        (("ax", "ay", "phase A"), ("ax", "ay")),
        (("CH1", "CH2", "level 1"), ("CH1", "CH2")),
        (("Motor", "Pumpe", "Druck A"), ("Motor", "Pumpe")),
        (("Motor", "Pumpe", "Temperatur links"), ("Motor", "Pumpe")),
        (("Motor", "charge pump pressure", "battery 1"), ("Motor",)),
        (("x", "y", "z", "roll"), ("x", "y", "z")),
        (("ax", "lat", "long"), ("ax",)),
        (("ax", "hub"), ("ax",)),
        (("acc_DE", "lat", "long"), ("acc_DE",)),
        (("vib_DE", "load", "level"), ("vib_DE",)),
    ],
)
def test_quantities_are_left_out_beside_vibrations(
    names: tuple[str, ...], channels: tuple[str, ...], tmp_path: Path
) -> None:
    columns = {"time": TIME_S} | dict(zip(names, NOISE, strict=False))

    recording = load_recording(write_table(tmp_path / "a.csv", columns), unit="g")

    assert recording.channels == channels


PARTS_BESIDE_VIBRATIONS = [
    *(("vib_DE", "Fan", "Compressor"), ("Vibration X", "Vibration Y", "Wheel")),
    *(("vib", "Stator", "Rotor"), ("acc1", "Turbine", "Impeller"), ("acc1", "Spindle", "Rollers")),
    *(("vib", "Kupplung", "Lüfter"), ("vib", "Kegelrad", "Ritzel"), ("acc", "Kolben", "Zylinder")),
    *(("acc", "blade", "tower", "nacelle"), ("acc", "Antriebsseite", "Abtriebslager")),
    *(("acc1", "Gearbox_HSS", "Gearbox_LSS"), ("acc", "planet", "sun"), ("vib", "Dach", "Wand")),
    *(("vib_DE", "Position 1", "Position 2"), ("acc Motor", "Hub left"), ("acc", "Schwungrad")),
    *(("vib", "Lagerbock", "Tisch"), ("vib NDE", "Level A", "Charge pump")),
]


@pytest.mark.parametrize("names", PARTS_BESIDE_VIBRATIONS, ids=" ".join)
def test_parts_of_machines_beside_vibrations_are_vibrations(
    names: tuple[str, ...], tmp_path: Path
) -> None:
    columns = {"time": TIME_S} | dict(zip(names, NOISE, strict=False))

    recording = load_recording(write_table(tmp_path / "a.csv", columns), unit="g")

    assert recording.channels == names


# ---- questions


@pytest.mark.parametrize(
    ("names", "unclear"),
    [
        (("gx", "gy", "gz"), "gx .gyroscope.., gy .gyroscope.., gz .gyroscope.."),
        (("x", "y", "mx"), "mx .magnetometer.."),
        (("acc_x", "foo", "quality"), "foo, quality"),
        (("vib", "X", "residual"), "residual"),
        (("vib", "Motor", "Wirkungsgrad"), "Wirkungsgrad"),
        (("Motor", "Pumpe", "load"), "load .a load."),
        (("Antrieb", "Last"), "Last .a load."),
    ],
)
def test_columns_that_may_be_something_else_are_asked_about(
    names: tuple[str, ...], unclear: str, tmp_path: Path
) -> None:
    columns = {"time": TIME_S} | dict(zip(names, NOISE, strict=False))
    path = write_table(tmp_path / "a.csv", columns)

    with pytest.raises(DataError, match=rf"are vibrations: {unclear}\. .* '\*' selects") as caught:
        load_recording(path, unit="g")
    assert caught.value.field == "channels"

    assert load_recording(path, unit="g", channels=("*",)).channels == names
    assert load_recording(path, unit="g", channels=names[:1]).channels == names[:1]


@pytest.mark.parametrize("names", [("T (°F)",), ("lat", "lon"), ("Gyroscope x (rad/s)", "tacho")])
def test_a_file_of_other_quantities_only_gets_no_unit_of_acceleration(
    names: tuple[str, ...], tmp_path: Path
) -> None:
    columns = {"time": TIME_S} | dict(zip(names, NOISE, strict=False))
    path = write_table(tmp_path / "a.csv", columns)

    with pytest.raises(DataError, match=r"holds no column that may be in g: .*") as caught:
        load_recording(path, unit="g")
    assert caught.value.field == "channels"


def test_an_index_skips_files_of_other_sensors_by_name(tmp_path: Path) -> None:
    write_table(tmp_path / "Accelerometer.csv", {"Time (s)": TIME_S, "X": NOISE[0]})
    write_table(tmp_path / "Gyroscope.csv", {"Time (s)": TIME_S, "X (rad/s)": NOISE[0]})
    write_table(tmp_path / "Location.csv", {"Time (s)": TIME_S, "Latitude (°)": 48 + NOISE[0]})

    proposal = propose_index(tmp_path, label_pattern="(?P<label>[A-Z][a-z]+)", unit="g")

    files = [entry["file"] for entry in proposal.index["recording"]]
    assert files == ["Accelerometer.csv"]
    skipped = [finding.message for finding in proposal.skipped]
    assert len(skipped) == 2
    assert "Gyroscope.csv holds no column that may be in g: X (rad/s)" in skipped[0]


# ---- classes, states and pulses

STATES: dict[str, np.ndarray] = {
    "label": np.arange(N_SAMPLES) // 300,
    "Klasse": np.full(N_SAMPLES, 2),
    "state": np.arange(N_SAMPLES) // 500,
    "column_7": np.arange(N_SAMPLES) // 200,
    "activity": np.where(TIME_S > 0.29, 12.0, 0.0),
    "flag": (np.arange(N_SAMPLES) % 3 == 0).astype(int),
    "digital_in": np.where(np.arange(N_SAMPLES) % 40 < 3, 5.0, 0.0),
    "TTL": np.where(np.arange(N_SAMPLES) % 40 < 20, 3.3, 0.0),
}


@pytest.mark.parametrize("name", STATES)
def test_a_column_of_few_values_is_left_out_as_a_state(name: str, tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", {"x": NOISE[0], "y": NOISE[1], name: STATES[name]})

    recording = load_recording(path, unit="g", sample_rate=RATE)

    n_values = len(np.unique(STATES[name]))
    text = "changes within the file: 0, " if n_values > 1 else "2 in the whole file"
    assert recording.channels == ("x", "y")
    assert recording.attributes["state_columns"].startswith(f"{name} ({text}")


COARSE_SIGNALS: dict[str, np.ndarray] = {
    "many counts": np.rint(2000 + 300 * NOISE[2]).astype(int),
    "few counts": np.rint(6 + 1.2 * NOISE[2]).astype(int),
    "counts around zero": np.rint(0.7 * NOISE[2]).astype(int),
    "dead": np.zeros(N_SAMPLES),
}


@pytest.mark.parametrize("kind", COARSE_SIGNALS)
@pytest.mark.parametrize("name", ["x2", "ch_b", "column_7"])
def test_samples_of_a_coarse_converter_are_no_states(kind: str, name: str, tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", {"x1": NOISE[0], name: COARSE_SIGNALS[kind]})

    assert load_recording(path, unit="g", sample_rate=RATE).channels == ("x1", name)


def test_a_file_of_states_only_is_read(tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", {"value": np.arange(N_SAMPLES) // 300})

    assert load_recording(path, unit="1", sample_rate=RATE).channels == ("value",)


# ---- units of voltages and other quantities

SENSITIVITY = "100 mV/g"


@pytest.mark.parametrize(
    ("names", "options", "channels"),
    [
        (("CH1", "CH2", "oil temp"), {"sensitivity": SENSITIVITY, "unit": "V"}, ("CH1", "CH2")),
        (("ai0", "Druck", "Drehzahl"), {"sensitivity": SENSITIVITY, "unit": "mV"}, ("ai0",)),
        (("DE [V]", "tacho [V]", "p [V]"), {"sensitivity": SENSITIVITY}, ("DE", "p")),
        (("CH1", "velocity", "Drehzahl"), {"sensitivity": "10 mV/(mm/s)", "unit": "V"}, None),
        (("CH1", "CH2", "Öltemperatur"), {"unit": "mm/s"}, ("CH1", "CH2")),
        (("vel_x", "vib_y", "accel"), {"unit": "mm/s"}, ("vel_x", "vib_y")),
        (("CH1", "displacement", "velocity"), {"unit": "um"}, ("CH1", "displacement")),
        (("p1", "Druck 2", "oil temp"), {"unit": "bar"}, ("p1", "Druck 2")),
        (("acc_x", "CH2", "battery"), {"unit": "mV"}, ("acc_x", "CH2")),
        (("load",), {"unit": "kN"}, ("load",)),
        (("accel", "T (°C)"), {"unit": "mm/s"}, ("accel",)),
    ],
)
def test_a_unit_goes_to_no_column_of_another_quantity(
    names: tuple[str, ...],
    options: dict[str, str],
    channels: tuple[str, ...] | None,
    tmp_path: Path,
) -> None:
    columns = {"time_s": TIME_S} | dict(zip(names, NOISE, strict=False))

    recording = load_recording(write_table(tmp_path / "a.csv", columns), **options)

    expected = names[:-1] if channels is None else channels
    assert recording.channels == expected
    assert ("other_columns" in recording.attributes) == (len(expected) < len(names))


@pytest.mark.parametrize(
    ("names", "options", "unit"),
    [
        (("oil temp", "Druck"), {"sensitivity": SENSITIVITY, "unit": "V"}, "g"),
        (("oil temp",), {"sensitivity": SENSITIVITY}, "g"),
        (("Drehzahl", "battery"), {"unit": "mm/s"}, "mm/s"),
        (("oil temp",), {"unit": "bar"}, "bar"),
    ],
)
def test_a_file_of_other_quantities_only_gets_no_other_unit(
    names: tuple[str, ...], options: dict[str, str], unit: str, tmp_path: Path
) -> None:
    columns = {"time_s": TIME_S} | dict(zip(names, NOISE, strict=False))
    path = write_table(tmp_path / "a.csv", columns)

    with pytest.raises(DataError, match=f"holds no column that may be in {unit}: {names[0]}"):
        load_recording(path, **options)


# ---- quaternions, actual values and noisy pulses


@pytest.mark.parametrize(
    "components",
    [("qw", "qx", "qy", "qz"), ("q_w", "q_x", "q_y", "q_z"), ("q0", "q1", "q2", "q3")],
)
def test_quaternions_are_no_vibrations(components: tuple[str, ...], tmp_path: Path) -> None:
    columns = {"time": TIME_S, "ax": NOISE[0], **dict(zip(components, NOISE, strict=True))}
    path = write_table(tmp_path / "a.csv", columns)

    recording = load_recording(path, unit="g")

    assert recording.channels == ("ax",)
    assert f"{components[0]} (quaternion?)" in recording.attributes["other_columns"]


def test_three_numbered_sensors_are_no_quaternion(tmp_path: Path) -> None:
    columns = {"time": TIME_S, "q1": NOISE[0], "q2": NOISE[1], "q3": NOISE[2]}
    path = write_table(tmp_path / "a.csv", columns)

    assert load_recording(path, unit="g").channels == ("q1", "q2", "q3")


@pytest.mark.parametrize("name", ["Istwert", "p_ist", "actual value"])
def test_an_actual_value_is_asked_about(name: str, tmp_path: Path) -> None:
    columns = {"time": TIME_S, "AI0": NOISE[0], "Sollwert": 15 + NOISE[1], name: 15 + NOISE[2]}
    path = write_table(tmp_path / "a.csv", columns)

    with pytest.raises(DataError, match=rf"are vibrations: {name} \(an actual value\?\)"):
        load_recording(path, unit="g")

    assert load_recording(path, unit="g", channels=("AI0",)).channels == ("AI0",)


@pytest.mark.parametrize("name", ["Istwert", "actual"])
def test_an_actual_value_alone_is_a_channel(name: str, tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", {"time": TIME_S, name: NOISE[0]})

    assert load_recording(path, unit="g").channels == (name,)


def noisy_pulses(height: float, noise: float) -> np.ndarray:
    is_high = np.sin(2 * np.pi * 30 * TIME_S) > 0.9
    return np.asarray(height * is_high + noise * NOISE[2])


@pytest.mark.parametrize(("height", "noise"), [(4.8, 0.02), (-24.0, 0.1), (3.3, 0.05)])
def test_noisy_pulses_are_left_out(height: float, noise: float, tmp_path: Path) -> None:
    columns = {"time": TIME_S, "acc": NOISE[0], "ch2": noisy_pulses(height, noise)}
    path = write_table(tmp_path / "a.csv", columns)

    recording = load_recording(path, unit="g")

    assert recording.channels == ("acc",)
    assert "ch2 (pulses with a height of" in recording.attributes["state_columns"]


NOT_PULSES: dict[str, np.ndarray] = {
    "impacts": NOISE[2] * 0.05 + 5 * (TIME_S * 20 % 1 < 0.1) * np.exp(-(TIME_S * 20 % 1) * 30),
    "clipped": np.clip(20 * np.sin(2 * np.pi * 30 * TIME_S), -5, 5) + 0.01 * NOISE[2],
    "step": 5.0 * (TIME_S > 0.1) + 0.01 * NOISE[2],
    "marks of missing values": np.where(TIME_S * 20 % 1 < 0.1, -9999.0, NOISE[2]),
    "vibration on pulses": noisy_pulses(4.8, 1.0),
}


@pytest.mark.parametrize("kind", NOT_PULSES)
def test_a_signal_with_levels_is_a_channel(kind: str, tmp_path: Path) -> None:
    columns = {"time": TIME_S, "acc": NOISE[0], "ch2": NOT_PULSES[kind]}
    path = write_table(tmp_path / "a.csv", columns)

    assert load_recording(path, unit="g").channels == ("acc", "ch2")


# ---- names in structures of MATLAB


def write_named_structures(path: Path, names: list[str]) -> Path:
    """Write structures in cells, each with its name in a field, as test rigs export them."""
    channels = np.empty(len(names), dtype=object)
    for number, name in enumerate(names):
        channels[number] = {"Name": name, "Data": NOISE[number]}
    scipy.io.savemat(path, {"N15": {"Y": channels, "Info": "rig"}})
    return path


@pytest.mark.parametrize("other", ["temp", "force", "speed"])
def test_a_vector_has_the_name_of_its_structure(other: str, tmp_path: Path) -> None:
    path = write_named_structures(tmp_path / "a.mat", ["vibration_1", other])

    recording = load_recording(path, unit="g", sample_rate=RATE)

    assert recording.channels == ("N15.Y.vibration_1.Data",)
    assert recording.attributes["other_columns"].startswith(f"N15.Y.{other}.Data")


def test_structures_of_equal_names_keep_their_numbers(tmp_path: Path) -> None:
    path = write_named_structures(tmp_path / "a.mat", ["acc", "acc"])

    recording = load_recording(path, unit="g", sample_rate=RATE)

    assert recording.channels == ("N15.Y(1).Data", "N15.Y(2).Data")
