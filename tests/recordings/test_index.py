"""An index describes every file of a folder, and its entries are checked, not trusted."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from recording_files import noise
from scipy import io as scipy_io

from swashtwin.foundation import (
    DataError,
    InputError,
    MissingFileError,
    MPa,
    SwashTwinError,
    UnitError,
    spell_for_python,
)
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import (
    Recording,
    fact_extraction,
    load_recording,
    load_recordings,
    propose_index,
    save_index,
    specified_pressure,
    specified_shaft_frequency,
    write_index,
    write_recording,
)

TEXT = st.text(
    st.characters(codec="utf-8", exclude_categories=("Cc", "Cs", "Zl", "Zp")),
    min_size=1,
    max_size=12,
)


def recording_named(name: str, label: str | None = "normal") -> Recording:
    return noise(name, ("acceleration",), 64, label=label)


def write_index_text(folder: Path, text: str) -> Path:
    """Write an index with this text and the tables a.csv and b.csv that it may name."""
    for name in ("a", "b"):
        (folder / f"{name}.csv").write_text("x,y\n1.5,2.5\n3.5,4.5\n")

    path = folder / "recordings.toml"
    path.write_text(text)
    return path


CONDITIONS = st.builds(
    OperatingCondition,
    speed=st.floats(1.0, 800.0),
    discharge_pressure=st.floats(0.2e6, 1e8),
    suction_pressure=st.floats(1e4, 1.9e5),
    oil_temperature=st.floats(240.0, 420.0),
)
RECORDINGS = st.builds(
    Recording,
    signal=st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=6).map(
        lambda values: np.array([values])
    ),
    sample_rate=st.floats(0.5, 1e6),
    recording_id=TEXT,
    channels=st.tuples(TEXT),
    unit=st.sampled_from(["m/s^2", "Pa", "1", "mm/s"]),
    label=st.none() | TEXT,
    condition=st.none() | CONDITIONS,
    speed=st.none(),
    specimen=st.none() | TEXT,
    synthetic=st.booleans(),
    attributes=st.dictionaries(
        TEXT.filter(lambda key: key not in ("file", "sha256")), TEXT, max_size=3
    ),
    samples=st.none(),
)


# the type checker of the tests draws the elements that it checks
@pytest.mark.filterwarnings("ignore:Do not use the `random` module")
@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(recording=RECORDINGS, suffix=st.sampled_from(["h5", "mat"]))
# A blank name was once written as names = [""], which no index may hold.
@example(recording=Recording(np.ones((1, 2)), 1.0, "a", channels=(" ",)), suffix="mat")
def test_a_written_index_loads_the_same_recordings(
    recording: Recording, suffix: str, tmp_path: Path
) -> None:
    path = write_recording(recording, tmp_path / f"one.{suffix}")

    (loaded,) = load_recordings(write_index([recording], [path], tmp_path))

    np.testing.assert_array_equal(loaded.signal, recording.signal)
    for name in ("recording_id", "channels", "unit", "label", "specimen", "synthetic"):
        assert getattr(loaded, name) == getattr(recording, name)
    assert loaded.sample_rate == pytest.approx(recording.sample_rate, rel=1e-14)

    attributes = {key: loaded.attributes[key] for key in recording.attributes}
    assert attributes == dict(recording.attributes)

    loaded_condition = vars(loaded.condition) if loaded.condition else {}
    condition = vars(recording.condition) if recording.condition else {}
    assert loaded_condition == pytest.approx(condition, rel=1e-12)


def test_defaults_apply_unless_an_entry_overrides_them(tmp_path: Path) -> None:
    path = write_index_text(
        tmp_path,
        """
        format = 1
        defaults = { sample_rate = "1 kHz", unit = "g", label = "normal" }
        [[recording]]
        file = "a.csv"
        channels = [1]
        [[recording]]
        file = "b.csv"
        label = "piston"
        unit = "m/s^2"
        """,
    )

    a, b = load_recordings(path)

    assert (a.label, b.label) == ("normal", "piston")
    assert (a.channels, b.channels) == (("y",), ("x", "y"))
    np.testing.assert_allclose(a.signal, np.array([[2.5, 4.5]]) * 9.80665)
    np.testing.assert_array_equal(b.signal, [[1.5, 3.5], [2.5, 4.5]])


def test_an_index_may_lie_outside_its_data_folder(tmp_path: Path) -> None:
    write_index_text(tmp_path, "")

    index = tmp_path / "elsewhere" / "mine.toml"
    entry = {"file": "a.csv", "unit": "1", "sample_rate": "1 Hz"}
    save_index({"format": 1, "root": "..", "recording": [entry]}, index)

    assert load_recordings(index)[0].attributes["file"] == "a.csv"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_an_index_written_by_hand_on_windows_is_read_on_every_system(
    tmp_path: Path, encoding: str
) -> None:
    (tmp_path / "May" / "pump A").mkdir(parents=True)
    write_index_text(tmp_path / "May" / "pump A", "")

    text = f"format = 1\nroot = '.\\May'\n[[recording]]\nfile = 'pump A\\a.csv'\n{FACTS}"
    (tmp_path / "mine.toml").write_bytes(text.replace("\n", "\r\n").encode(encoding))

    assert load_recordings(tmp_path / "mine.toml")[0].recording_id == "a"


FACTS = 'unit = "1"\nsample_rate = "1 kHz"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format = 1", r"no \[\[recording\]\] entry"),
        ("recording = [1]", "format = None"),
        ("format = 2", "format = 2 cannot be read"),
        ("format = ", "not valid TOML"),
        ("format = 1\nclases = []\n[[recording]]\nfile = 'a.csv'", "no entry 'clases'; did you mean 'classes'"),
        ("format = 1\nclasses = 'normal'\n[[recording]]\nfile = 'a.csv'", "classes: expected a list, got text"),
        ("format = 1\n[fault_of]\nKolben = 3\n[[recording]]\nfile = 'a.csv'", "fault_of.*: expected text"),
        ("format = 1\nrecording = [1]", r"recording\[0\]: expected a table"),
        ('format = 1\n[[recording]]\nunit = "g"', 'needs file = "..."'),
        (f'format = 1\n[[recording]]\nfile = "a.csv"\nsamplerate = "1 kHz"\n{FACTS}', "did you mean 'sample_rate'"),
        ('format = 1\n[[recording]]\nfile = "a.csv"\nunit = "1"\nsample_rate = 25600', "bare number 25600"),
        (f'format = 1\n[[recording]]\nfile = "a.csv"\nchannels = "x"\n{FACTS}', "channels: expected a list, got text"),
        (f'format = 1\n[[recording]]\nfile = "c.csv"\n{FACTS}', "c.csv does not exist"),
        (f'format = 1\nclasses = ["normal", "swash_plate"]\n[[recording]]\nfile = "a.csv"\nlabel = "swashplate"\n{FACTS}',
         "unknown class 'swashplate'; did you mean 'swash_plate'"),
        (f'format = 1\nclasses = ["normal"]\n[[recording]]\nfile = "a.csv"\nlabel = "xyz"\n{FACTS}', "classes = "),
        (f'format = 1\n[[recording]]\nfile = "a.csv"\n{FACTS}[[recording]]\nfile = "./a.csv"\n{FACTS}', "have the same id"),
        ("format = 1\nclasses = [1, 2]\n[[recording]]\nfile = 'a.csv'", r"classes\[0\]: .*whole number: 1"),
        ("format = 1\nx = " + "[" * 5000, "is not valid TOML: "),
        ("format = " + "9" * 1_000_000, "is not valid TOML: .*digits"),
        ("format = true", "format = True cannot be read"),
        ("format = 1\ndefaults = 'normal'\n[[recording]]\nfile = 'a.csv'", "defaults: expected a table"),
        ("format = 1\nroot = 3\n[[recording]]\nfile = 'a.csv'", "root: expected text"),
        ('format = 1\nroot = "C:\\data"', "write / between folders, or put a text with"),
        ('format = 1\nroot = "C:\\Users\\me"', "hex value.*; write / between folders, or put a text with"),
        *(
            (f'format = 1\n[[recording]]\nfile = "a.csv"\n{fact}\n{FACTS}', message)
            for fact, message in {
                "channels = []": "channels: expected a list of length >= 1",
                "channels = [true]": r"channels\[0\]: expected a whole number or text",
                "channels = [-1]": "a whole number >= 0",
                "names = []": "names: expected a list of length",
                "header_lines = -1": "header_lines: expected a whole number >= 0, got -1",
                "header_lines = true": "header_lines: expected a whole number, got true",
                "header_lines = " + "9" * 4000: r"header_lines: expected a whole number <= \d+, got 9+\.\.\.9+\.",
                "time_column = 1.5": "time_column: expected a whole number or text",
                'separator = ""': "separator: expected text of length >= 1, got ''",
                'decimal = "x"': "decimal: 'x' is invalid; choose one of",
                'label = ""': "label: expected text of length >= 1",
                "label = 2020-01-01": "label: expected text, got date",
                "sensitivity = 3": "sensitivity: expected text or a list",
                "sensitivity = [1]": r"sensitivity\[0\]: expected text",
                "attributes = {a = {b = 1}}": "attributes.*: expected text",
                "attributes = 3": "attributes: expected a table",
                "speed = nan": "speed is the bare number nan",
                'speed = "0 rpm"': r"speed \(0 rpm\) must be above zero",
                'speed = "1e999 rpm"': "is not finite",
            }.items()
        ),
    ],
)  # fmt: skip
def test_an_invalid_index_is_refused_in_one_line(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(SwashTwinError, match=message) as raised:
        load_recordings(write_index_text(tmp_path, text))

    assert "\n" not in str(raised.value)


def test_a_folder_without_an_index_names_the_command_that_makes_one(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="swashtwin index"):
        load_recordings(tmp_path)

    write_index_text(tmp_path, "")
    with pytest.raises(DataError, match="does not state its sample rate"):
        load_recordings(tmp_path / "a.csv")


# ---- proposals


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    for name in (
        "A01/normal_15MPa_860rpm_1",
        "A01/swash_plate_15MPa_860rpm_1",
        "B02/normal_10MPa_860rpm_1",
    ):
        path = tmp_path / f"{name}.csv"
        path.parent.mkdir(exist_ok=True)
        path.write_text("x,y\n1.5,2.5\n3.5,4.5\n")
    return tmp_path


def test_a_proposal_reads_label_speed_and_pressure_from_names(rig: Path) -> None:
    proposal = propose_index(rig, sample_rate="25.6 kHz", unit="g")
    save_index(proposal.index, rig / "recordings.toml")

    loaded = load_recordings(rig)
    assert [recording.label for recording in loaded] == ["normal", "swash_plate", "normal"]
    pressures = [
        recording.condition.discharge_pressure for recording in loaded if recording.condition
    ]
    assert pressures == [15e6, 15e6, 10e6]

    assert proposal.index["defaults"]["speed"] == "860 rpm"
    assert proposal.skipped == ()


def test_a_proposal_takes_facts_from_a_label_pattern(rig: Path) -> None:
    pattern = r"(?P<specimen>\w+)/(?P<label>[a-z_]+?)_(?P<pressure>\d+)MPa_(?P<speed>\d+)rpm_(?P<repeat>\d)"

    proposal = propose_index(
        rig, label_pattern=pattern, sample_rate="25.6 kHz", unit="g", include=["A01/*"]
    )
    save_index(proposal.index, rig / "recordings.toml")

    loaded = load_recordings(rig)
    facts = [
        (recording.label, recording.specimen, recording.attributes["repeat"])
        for recording in loaded
    ]
    assert facts == [("normal", "A01", "1"), ("swash_plate", "A01", "1")]

    with pytest.raises(DataError, match="does not match label_pattern"):
        propose_index(rig, label_pattern="(?P<label>x{9})", sample_rate="1 Hz", unit="g")
    with pytest.raises(InputError, match="not a regular expression"):
        propose_index(rig, label_pattern="(", sample_rate="1 Hz", unit="g")


def test_a_proposal_reports_the_origin_of_each_fact(rig: Path) -> None:
    for name in ("swash_plate", "normal"):
        (rig / name).mkdir()
        write_recording(recording_named(name, None), rig / name / f"{name}.mat")
    write_recording(recording_named("own", "piston"), rig / "own.h5")

    sentences = propose_index(rig, sample_rate="25.6 kHz", unit="m/s^2", include=["A01/*"]).facts
    assert sentences == (
        "label: normal (1), swash_plate (1), from its name",
        "specimen: A01 (2), from its name",
        "speed: 860 rpm (2), from its name",
        "pressure: 15 MPa (2), from its name",
        "sample_rate: 25.6 kHz (2), from the settings",
        "unit: m/s^2 (2), from the settings",
        "channels: x, y (2), from the file",
    )

    sentences = propose_index(rig, include=["normal/*", "own.h5"]).facts
    assert sentences[0] == "label: normal (1), from the folder's name; piston (1), from the file"
    assert sentences[1] == "sample_rate: 1000 Hz (2), from the file"

    pattern = r"(?P<label>normal|swash_plate|own)(_(?P<pressure>\d+)MPa)?.*?_?(?P<repeat>\d?)\."
    proposal = propose_index(
        rig,
        sample_rate="25.6 kHz",
        unit="g",
        label_pattern=pattern,
        speed="860 rpm",
        include=["A01/*"],
    )
    assert "attribute repeat: 1 (2), from the pattern" in proposal.facts
    assert "speed: 860 rpm (2), from its name" in proposal.facts


def test_a_proposal_asks_for_missing_facts(rig: Path) -> None:
    questions = []

    def ask(key: str, question: str) -> str | None:
        questions.append((key, question))
        return {"sample_rate": "25.6 kHz", "unit": "g"}[key]

    proposal = propose_index(rig, ask=ask)

    assert [key for key, _ in questions] == ["sample_rate", "unit"]
    assert questions[0][1].startswith(
        "The sample_rate of 3 files is missing, such as that of A01/normal_15MPa_860rpm_1.csv."
    )

    assert proposal.index["defaults"] == {
        "sample_rate": "25.6 kHz",
        "unit": "g",
        "speed": "860 rpm",
    }

    with pytest.raises(
        DataError, match="neither the files nor the settings state sample_rate of 3 files"
    ):
        propose_index(rig, ask=lambda key, question: None)


def test_a_pressure_without_a_speed_is_stored_and_noted(tmp_path: Path) -> None:
    rows = "\n".join(f"{value:.6f}" for value in np.random.default_rng(0).standard_normal(400))
    (tmp_path / "normal_15MPa.csv").write_text(f"x\n{rows}\n")

    proposal = propose_index(tmp_path, sample_rate="1 kHz", unit="g")
    notes = [note.describe(spell_for_python) for note in proposal.notes]
    assert notes == [
        "files state a pressure and no speed, which calibration and shaft orders require. "
        "Set speed='860 rpm' if it is known."
    ]

    recordings = load_recordings(save_index(proposal.index, tmp_path / "recordings.toml"))
    assert recordings[0].condition is None
    assert specified_pressure(recordings[0]) == MPa(15)

    write_index(recordings, ["normal_15MPa.csv"], tmp_path / "again.toml")
    assert specified_pressure(load_recordings(tmp_path / "again.toml")[0]) == MPa(15)

    assert propose_index(tmp_path, sample_rate="1 kHz", unit="g", speed="860 rpm").notes == ()


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"holds no file to index: supported are \.csv"):
        propose_index(tmp_path)
    with pytest.raises(MissingFileError, match="not a folder"):
        propose_index(tmp_path / "nowhere")


def test_a_pattern_adds_attributes_to_those_of_a_table(rig: Path) -> None:
    (rig / "files.csv").write_text("file,label,n\nA01/normal_15MPa_860rpm_1.csv,ok,7\n")

    index = propose_index(
        rig,
        table=rig / "files.csv",
        columns={"serial": "n"},
        label_pattern=r"(?P<serial>A01)/.*_(?P<repeat>\d)\.csv$",
        sample_rate="1 kHz",
        unit="g",
    ).index

    assert index["recording"][0]["attributes"] == {"repeat": "1", "serial": "7"}


def test_a_proposal_takes_facts_from_a_table(rig: Path) -> None:
    (rig / "files.csv").write_text("path,class,n\nA01/normal_15MPa_860rpm_1.csv,ok,1797\n")
    columns = {"file": "path", "label": "class", "speed": "n", "serial": "n"}

    index = propose_index(
        rig, table=rig / "files.csv", columns=columns, sample_rate="1 kHz", unit="g"
    ).index
    assert index["recording"][0]["label"] == "ok"
    assert index["recording"][0]["speed"] == "1797 rpm"
    assert index["recording"][0]["attributes"] == {"serial": "1797"}

    with pytest.raises(DataError, match="no column 'label' for label; it has path, class, n"):
        propose_index(rig, table=rig / "files.csv", columns={"file": "path"})

    table_and_pattern = {
        "table": rig / "files.csv",
        "label_pattern": r"(?P<specimen>A\d+)/(?P<label>[a-z]+)_(?P<pressure>\d+MPa)",
    }
    index = propose_index(
        rig, **table_and_pattern, columns=columns, sample_rate="1 kHz", unit="g"
    ).index
    entry = index["recording"][0]
    assert (entry["label"], entry["specimen"], entry["pressure"]) == ("ok", "A01", "15 MPa")


def test_files_with_the_same_name_in_two_folders_get_different_ids(tmp_path: Path) -> None:
    for folder in ("normal", "piston"):
        write_recording(recording_named(folder, None), tmp_path / folder / "1.mat")

    index = propose_index(tmp_path).index
    assert [entry["id"] for entry in index["recording"]] == ["normal_1.mat", "piston_1.mat"]
    assert index["classes"] == ["normal", "piston"]


# ---- public data


def test_the_bearing_data_set_is_indexed_from_its_table(public_data: Path, tmp_path: Path) -> None:
    folder = public_data / "cwru"
    columns = {
        "specimen": "bearing_id",
        "speed": "rpm_nominal",
        "sample_rate": "fs_hz",
        "sha256": "sha256",
    }

    proposal = propose_index(
        folder,
        table=folder / "files.csv",
        columns=columns,
        include=["drive_end_12k/*load0*", "normal_48k/*"],
        unit="g",
        channels=["*_DE_time"],
        names=["drive_end"],
        resample="12 kHz",
        index_folder=tmp_path,
    )

    loaded = load_recordings(save_index(proposal.index, tmp_path / "cwru.toml"))

    assert {recording.sample_rate for recording in loaded} == {12000.0}
    labels = {recording.label for recording in loaded}
    assert labels == {"normal", "ball", "inner_race", "outer_race"}

    normal = next(recording for recording in loaded if recording.label == "normal")
    assert normal.signal.shape == (1, 60985)
    assert "from 48000 Hz to 12000 Hz" in normal.attributes["resampled"]
    assert (normal.specimen, normal.attributes["speed"]) == ("DE-healthy", "1797 rpm")


@pytest.mark.parametrize(
    ("fact", "message"),
    [
        ({"sample_rate": "25600"}, "sample_rate = '25600' has no unit"),
        ({"unit": "gg"}, "unit = 'gg' must be one of"),
        ({"pressure": "15 MNa"}, "pressure = '15 MNa'"),
    ],
)
def test_an_unreadable_fact_is_refused_before_an_index_is_made(
    fact: dict[str, str], message: str, tmp_path: Path
) -> None:
    (tmp_path / "normal_1.csv").write_text("x\n1\n2\n")

    facts = {"sample_rate": "10 Hz", "unit": "g", **fact}

    with pytest.raises(UnitError, match=message):
        propose_index(tmp_path, **facts)


def test_labels_are_one_class_in_any_unicode_form_and_hold_no_control_characters(
    tmp_path: Path,
) -> None:
    path = write_index_text(
        tmp_path,
        f"""
        format = 1
        classes = ["Gerausch", "unbesch\u00e4digt"]
        [[recording]]
        file = "a.csv"
        label = " unbescha\u0308digt "
        {FACTS}
        [[recording]]
        file = "b.csv"
        label = "Ger\\u001b\\u202eausch"
        names = ["x\\u0007", "y"]
        {FACTS}
        """,
    )

    first, second = load_recordings(path)

    assert first.label == "unbesch\u00e4digt"
    assert (second.label, second.channels) == ("Gerausch", ("x", "y"))
    assert len(load_recordings(path).where(label="unbescha\u0308digt")) == 1


def write_tables(
    folder: Path, *names: str, text: str = "x,y\n1.5,2.5\n3.5,4.5\n"
) -> dict[str, str]:
    """Write small tables with these names; return the facts that they do not state."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return {"sample_rate": "1 kHz", "unit": "g", "speed": "860 rpm"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"unit": "m/s^2"}, "states that 'x' is in g, but m/s\\^2 is specified"),
        ({"sensitivity": "0.1 g"}, "'x' is in g already, according to the file"),
        (
            {"sample_rate": "1 kHz"},
            "a sample rate of 2000 Hz, but 1000 Hz is specified. Correct sample_rate\\.",
        ),
        ({"sample_rate": "2 MHz"}, "or, if the times are in ms, set time_unit='ms' instead"),
    ],
)
def test_an_option_that_a_file_contradicts_is_refused_before_an_index_is_made(
    options: dict[str, str], message: str, tmp_path: Path
) -> None:
    rows = "".join(f"{number / 2000:.4f},{number % 7}.5\n" for number in range(40))
    (tmp_path / "normal_1.csv").write_text("time [s],x [g]\n" + rows)

    with pytest.raises(DataError, match=message):
        propose_index(tmp_path, **options)


@pytest.mark.parametrize(
    ("name", "pressure"),
    [
        ("swash_plate_15MPa_3", "15 MPa"), ("normal_120bar_1", "120 bar"), ("normal_120_BAR_1", "120 bar"),
        ("normal_2000psi", "2000 psi"), ("normal_bar_120", "120 bar"), ("normal_12,5MPa", "12.5 MPa"),
    ],
)  # fmt: skip
def test_a_number_in_a_name_takes_the_adjacent_unit(
    name: str, pressure: str, tmp_path: Path
) -> None:
    facts = write_tables(tmp_path, f"{name}.csv")
    pattern = r"(?P<label>[a-z]+?)[_a-zA-Z]*_(?P<pressure>\d+(,\d+)?)"

    index = propose_index(tmp_path, label_pattern=pattern, **facts).index
    assert index["recording"][0]["pressure"] == pressure


def test_a_pressure_without_a_unit_requires_one(tmp_path: Path) -> None:
    facts = write_tables(tmp_path, "normal_p120_1.csv")
    arguments = {**facts, "label_pattern": r"(?P<label>[a-z]+)_p(?P<pressure>\d+)"}

    with pytest.raises(
        DataError, match=r"state pressure_unit of 1 file \(such as .*\)\. Set pressure_unit='bar'\."
    ):
        propose_index(tmp_path, **arguments)

    from_setting = propose_index(tmp_path, **arguments, pressure_unit="bar")
    from_answer = propose_index(
        tmp_path, **arguments, ask=lambda key, question: {"pressure_unit": "bar"}[key]
    )
    for proposal in (from_setting, from_answer):
        assert proposal.index["recording"][0]["pressure"] == "120 bar"

    with pytest.raises(UnitError, match="pressure_unit"):
        propose_index(tmp_path, **arguments, pressure_unit="furlong")


def test_facts_in_headers_are_proposed(tmp_path: Path) -> None:
    head = "Drehzahl;1500 1/min\nDruck [bar];120\nÖltemperatur: 45 °C\nAbtastrate\t20 kHz\n"
    write_tables(tmp_path, "normal_1.csv", text=head + "x;y\n1.5;2.5\n3.5;4.5\n")

    (tmp_path / "bearing").mkdir()
    scipy_io.savemat(
        tmp_path / "bearing" / "a.mat", {"X105_DE_time": np.arange(9.0), "X105RPM": 1797.0}
    )

    proposal = propose_index(tmp_path, sample_rate="20 kHz", unit="g")

    entry = proposal.index["recording"][1]
    assert entry["speed"] == "1500 rpm"
    assert entry["pressure"] == "120 bar"
    assert entry["oil_temperature"] == "45 degC"
    assert proposal.index["recording"][0]["speed"] == "1797 rpm"
    assert "speed: 1797 rpm (1), 1500 rpm (1), from the file" in proposal.facts

    save_index(proposal.index, tmp_path / "recordings.toml")
    conditions = [recording.condition for recording in load_recordings(tmp_path)]
    assert [condition.discharge_pressure for condition in conditions if condition] == [12e6]


@pytest.mark.parametrize(
    ("speed", "speed_and_pressure"),
    # 120,159 bar could also be 120159 bar; only a speed of 980,5 shows that commas are decimal
    [("980,5", ("980.5 rpm", "120.159 bar")), ("980", ("980 rpm", None))],
)
def test_a_comma_before_three_digits_is_decimal_if_another_number_shows_it(
    speed: str, speed_and_pressure: tuple[str, str | None], tmp_path: Path
) -> None:
    write_tables(
        tmp_path,
        "normal_1.csv",
        text=f"Drehzahl;{speed} 1/min\nDruck;120,159 bar\nx;y\n1.5;2.5\n3.5;4.5\n",
    )

    (entry,) = propose_index(tmp_path, sample_rate="1 kHz", unit="g").index["recording"]
    assert (entry["speed"], entry.get("pressure")) == speed_and_pressure


def test_a_pattern_applies_only_to_included_readable_files(tmp_path: Path) -> None:
    facts = write_tables(tmp_path, "a/normal_1.csv", "b/other.csv")
    (tmp_path / "a" / "notes.txt").write_text("measured on Friday")
    (tmp_path / "a" / "empty.csv").write_bytes(b"")
    (tmp_path / "a" / "files.csv").write_text(
        "name,class,number\nnormal_1.csv,ok,1\nnormal_2.csv,ok,2\n"
    )

    proposal = propose_index(
        tmp_path, label_pattern=r"(?P<label>[a-z]+)_\d", include=["a/*"], **facts
    )
    assert [entry["file"] for entry in proposal.index["recording"]] == ["a/normal_1.csv"]

    skipped = [finding.describe(spell_for_python) for finding in proposal.skipped]
    skipped_names = [Path(reason.split()[0]).name.rstrip(":") for reason in skipped]
    assert skipped_names == ["empty.csv", "files.csv", "notes.txt"]
    assert "To take facts from it, specify it as table." in skipped[1]


def test_a_slow_pattern_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    facts = write_tables(tmp_path, "a" * 60 + "!.csv")
    monkeypatch.setattr(fact_extraction, "_PATTERN_TIMEOUT_S", 0.05)

    with pytest.raises(InputError, match="takes too long on 'aaa"):
        propose_index(tmp_path, label_pattern=r"^(?P<label>(a|a|aa)+)+$", **facts)


@pytest.mark.parametrize("base", ["folder", "table", "name", "here"])
def test_paths_in_a_table_may_be_relative_to_any_likely_folder(
    base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = tmp_path / "data"
    papers = tmp_path / "papers"
    facts = write_tables(data, "deep/1.csv", "deep/2.csv")
    papers.mkdir()

    paths = {
        "folder": "deep/{}.csv",
        "table": "../data/deep/{}.csv",
        "name": "{}.csv",
        "here": "data/deep/{}.csv",
    }

    rows = "".join(f"{paths[base].format(number)};gut;{number}20\n" for number in (1, 2))
    (papers / "facts.csv").write_text(f"file;label;p [bar]\n{rows}")

    monkeypatch.chdir(tmp_path)
    columns = {"discharge_pressure": "p [bar]"}
    index = propose_index(data, table=papers / "facts.csv", columns=columns, **facts).index
    pressures = [(entry["file"], entry["pressure"]) for entry in index["recording"]]
    assert pressures == [("deep/1.csv", "120 bar"), ("deep/2.csv", "220 bar")]

    (papers / "facts.csv").write_text("file,label\n/elsewhere/9.csv,gut\n")
    with pytest.raises(DataError, match=r"names no file below .*relative to the table"):
        propose_index(data, table=papers / "facts.csv", **facts)


@pytest.mark.parametrize(
    ("names", "hint"),
    [
        (
            ("A_normal_1", "A_piston_1", "B_normal_1"),
            "the classes begin with A, B, which was read as the machine",
        ),
        (("Test_1", "Test_2"), "every file is of the class 'Test'; is that a class?"),
        (
            ("pump_gut_1", "pump_piston_1"),
            "all classes begin with pump. If that is a machine, separate it from the class with "
            "label_pattern='(?P<specimen>pump)[^a-zA-Z]+(?P<label>[a-zA-Z_]+)' and force=True, ",
        ),
        (
            ("test_gut_1", "test_x1_leck"),
            "all classes begin with test. If that is a machine, separate it from the class with "
            "label_pattern.",
        ),
        (("swash_plate_1", "valve_plate_1"), None),
    ],
)
def test_a_note_warns_of_a_machine_name_in_the_classes(
    names: tuple[str, ...], hint: str | None, tmp_path: Path
) -> None:
    facts = write_tables(tmp_path, *(f"{name}.csv" for name in names))
    notes = propose_index(tmp_path, **facts).notes
    texts = [note.describe(spell_for_python) for note in notes]

    if hint is None:
        assert texts == []
    else:
        (text,) = texts
        assert text.startswith(hint)


@pytest.mark.parametrize(
    ("name", "specimen", "label"),
    [
        ("pump 7/normal/1", "pump 7", "normal"), ("C/C_piston_2", "C", "piston"), ("Pumpe_A/Gut_1", "Pumpe_A", "Gut"),
        ("pump_b/Gut_1", "pump_b", "Gut"), ("PumpC/Gut_1", "PumpC", "Gut"), ("PUMPS/Gut_1", None, "PUMPS"),
        ("Pumpe_A_Gut_1", "Pumpe_A", "Gut"), ("Gut_Pumpe_2_15bar", "Pumpe_2", "Gut"), ("pump_1", None, "pump"),
        ("Gut_pumps_1", None, "Gut_pumps"),
    ],
)  # fmt: skip
def test_a_machine_in_names_and_folders_is_the_specimen(
    name: str, specimen: str | None, label: str, tmp_path: Path
) -> None:
    facts = write_tables(tmp_path, f"{name}.csv")
    (entry,) = propose_index(tmp_path, **facts).index["recording"]
    assert (entry.get("specimen"), entry["label"]) == (specimen, label)


def test_facts_outside_the_pattern_are_still_read_from_the_name(tmp_path: Path) -> None:
    facts = write_tables(tmp_path, "Pumpe_A/Gut_100bar_980rpm_x.csv")
    del facts["speed"]  # it would override that of the name

    proposal = propose_index(
        tmp_path, label_pattern="(?P<label>Gut)_(?P<pressure>\\d+).*(?P<place>x)", **facts
    )

    (entry,) = proposal.index["recording"]
    assert entry["specimen"] == "Pumpe_A"
    assert entry["speed"] == "980 rpm"
    assert entry["pressure"] == "100 bar"
    assert entry["attributes"] == {"place": "x"}

    origins = {sentence.split(":")[0]: sentence.split(" from ")[1] for sentence in proposal.facts}
    assert origins["specimen"] == "its name"
    assert origins["pressure"] == "the pattern"
    assert origins["speed"] == "its name"


def test_a_question_is_asked_if_all_files_have_one_class(tmp_path: Path) -> None:
    facts = write_tables(tmp_path, "Test/gut_1.csv", "Test/kolben_1.csv")
    questions = []

    def answer(key: str, question: str) -> str:
        questions.append(question)
        return r"/(?P<label>[a-z]+)_"

    proposal = propose_index(tmp_path, ask=answer, **facts)

    assert "All files are of the class 'Test'" in questions[0]
    assert proposal.index["classes"] == ["gut", "kolben"]


def test_a_speed_in_the_header_overrides_one_in_the_file_name(tmp_path: Path) -> None:
    write_tables(
        tmp_path, "normal_1500rpm.csv", text="Drehzahl;980,0 1/min\nx;y\n1.5;2.5\n3.5;4.5\n"
    )

    proposal = propose_index(tmp_path, sample_rate="1 kHz", unit="g")
    assert proposal.index["recording"][0]["speed"] == "980.0 rpm"
    note = proposal.notes[0].message
    assert "states speed = 1500 rpm, its header 980.0 rpm; the header's counts" in note

    path = tmp_path / "normal_1500rpm.csv"
    without_speed = load_recording(path, sample_rate="1 kHz", unit="g")
    assert specified_shaft_frequency(without_speed) == pytest.approx(980 / 60)

    with_speed = load_recording(path, sample_rate="1 kHz", unit="g", speed="1500 rpm")
    assert specified_shaft_frequency(with_speed) == pytest.approx(25)
    contradiction = with_speed.attributes["contradicted"]
    assert contradiction == "speed = 1500 rpm is specified and counts, the file states 980.0 rpm"


@pytest.mark.parametrize(
    ("name", "head", "origin"),
    [
        ("normal_1500rpm_150bar_1", "", "its name"),
        ("normal_1", "Speed: 1500 rpm\nPressure: 150 bar\n", "the file"),
        ("normal_980rpm", "Drehzahl;1500 1/min\nDruck [bar];150\n", "the file"),
        # It is not asked for the unit of a pressure that does not count.
        ("normal_1", "Speed: 1500 rpm\nPressure: 150\n", "the file"),
    ],
)
def test_a_setting_overrides_name_and_header(
    name: str, head: str, origin: str, tmp_path: Path
) -> None:
    text = f"{head}x;y\n1.5;2.5\n3.5;4.5\n"
    write_tables(tmp_path, f"{name}.csv", text=text)
    facts = {"sample_rate": "1 kHz", "unit": "g"}

    proposal = propose_index(tmp_path, speed="860 rpm", pressure="10 MPa", **facts)

    index = proposal.index
    assert index["defaults"].items() >= {"speed": "860 rpm", "pressure": "10 MPa"}.items()
    assert index["recording"][0].keys().isdisjoint({"speed", "pressure"})
    assert "speed: 860 rpm (1), from the settings" in proposal.facts
    expected = f"{name}.csv: speed = 860 rpm is specified and counts, {origin} states 1500 rpm"
    (note,) = [note for note in proposal.notes if note.kind == "contradicted"]
    assert note.message.startswith(expected)
    assert ("pressure = 10 MPa is specified" in note.message) == (not head.endswith(" 150\n"))


@pytest.mark.parametrize(
    ("head", "stated"),
    [
        ("Label: normal", "Label = normal"),
        ("Klasse;Gleitschuh", "Klasse = Gleitschuh"),
        ("class: piston", None),
        ("Label: Piston", None),
        ("Label: 3", None),
        ("Classification: normal", None),
    ],
)
def test_a_class_in_the_header_that_does_not_count_is_noted(
    head: str, stated: str | None, tmp_path: Path
) -> None:
    facts = write_tables(
        tmp_path, "piston/1.csv", "piston/2.csv", text=f"{head}\nx;y\n1.5;2.5\n3.5;4.5\n"
    )

    proposal = propose_index(tmp_path, **facts)

    assert {entry["label"] for entry in proposal.index["recording"]} == {"piston"}
    messages = [note.message for note in proposal.notes if note.kind == "contradicted_label"]
    assert len(messages) == (2 if stated else 0)
    if stated:
        expected = f"piston/1.csv: the class piston counts, the header states {stated}."
        assert messages[0] == expected


def test_a_setting_of_the_same_value_is_not_noted(tmp_path: Path) -> None:
    facts = write_tables(tmp_path, "normal_150bar_1.csv")

    proposal = propose_index(tmp_path, pressure="15 MPa", **facts)

    assert not proposal.notes
    assert "pressure: 150 bar (1), from its name" in proposal.facts


def test_a_pattern_and_a_table_override_the_setting_with_a_note(tmp_path: Path) -> None:
    facts = write_tables(tmp_path, "normal_1500rpm.csv")
    table = tmp_path.parent / "files.csv"
    table.write_text("file,label,n [rpm]\nnormal_1500rpm.csv,normal,1480\n")

    by_pattern = propose_index(
        tmp_path, label_pattern=r"(?P<label>[a-z]+)_(?P<speed>\d+)rpm", **facts
    )
    by_table = propose_index(tmp_path, table=table, columns={"speed": "n [rpm]"}, **facts)

    assert by_pattern.index["recording"][0]["speed"] == "1500 rpm"
    assert "speed = 1500 rpm of the pattern counts, and not 860 rpm" in by_pattern.notes[0].message
    assert by_table.index["recording"][0]["speed"] == "1480 rpm"
    assert "speed = 1480 rpm of the table counts, and not 860 rpm" in by_table.notes[0].message


def test_one_file_of_two_recordings_gets_two_entries(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    facts = {"wf_increment": 1e-3, "unit_string": "g"}
    starts = {"a": np.datetime64("2026-01-01T10:00:00"), "b": np.datetime64("2026-01-01T11:00:00")}

    channels = [
        nptdms.ChannelObject("g", name, np.sin(np.arange(50.0)), {**facts, "wf_start_time": start})
        for name, start in starts.items()
    ]

    with nptdms.TdmsWriter(str(tmp_path / "normal_1.tdms")) as writer:
        writer.write_segment(channels)

    save_index(propose_index(tmp_path).index, tmp_path / "recordings.toml")
    recordings = load_recordings(tmp_path)
    assert recordings.recording_ids == ("normal_1_1", "normal_1_2")
    assert [recording.n_channels for recording in recordings] == [1, 1]
