"""``swashtwin twin export``: the answer of the command, and what it refuses."""

import zipfile
from pathlib import Path

import pytest
from commandline import one_line, run, run_json

from swashtwin.foundation import MPa, rpm, um

EXPORT = ("twin", "export", "25scy14-1b", "--sources-only")
WORN = ("--fault", "piston:clearance=60um")


def test_the_answer_lists_inputs_and_outputs(tmp_path: Path) -> None:
    out = tmp_path / "new" / "worn.fmu"

    answer = run_json(*EXPORT, *WORN, "--speed", "1000 rpm", "--out", out)

    assert answer["fmu"] == str(out)
    assert answer["fmi_version"] == "2.0"
    assert answer["platform"] is None
    starts = {variable["name"]: variable["start"] for variable in answer["inputs"]}
    # the pressure is the rated one
    assert starts == {
        "speed": pytest.approx(rpm(1000)),
        "discharge_pressure": MPa(15),
        "clearance": pytest.approx(um(60)),
    }
    assert "acceleration.cover_z" in answer["outputs"]
    with zipfile.ZipFile(out) as archive:
        assert "modelDescription.xml" in archive.namelist()


def test_the_table_is_in_units_of_the_trade(tmp_path: Path) -> None:
    text = run(*EXPORT, "--fault", "swash_plate", "--out", tmp_path / "recess.fmu")

    assert "860 rpm" in text.stdout
    assert "109 outputs, no binary, and C sources" in text.stdout
    assert "contact=lift_off, which suits its depth" in text.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param(
            ("--out", "old.fmu"), "old.fmu exists. Overwrite it with --force", id="exists"
        ),
        pytest.param(("--out", "x.zip"), "must end in .fmu", id="suffix"),
        pytest.param(
            ("--fault", "piston:clearance=5mm"), "exceeds 0.002 m", id="dimension out of range"
        ),
        pytest.param(("--fault", "piston:piston=7"), "must be 0 to 6", id="no such piston"),
        pytest.param(("--speed", "9000 rpm"), "above 8000 rev/min", id="speed"),
        pytest.param(("--pressure", "0.5 bar"), "must exceed suction_pressure", id="pressure"),
    ],
)
def test_an_invalid_value_ends_with_one_line_and_writes_nothing(
    options: tuple[str, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("old.fmu").write_text("old")

    assert message in one_line(run(*EXPORT, *options, code=3))
    assert [path.name for path in tmp_path.iterdir()] == ["old.fmu"]
    assert Path("old.fmu").read_text() == "old"


def test_without_a_compiler_the_option_for_sources_is_proposed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-cc")

    line = one_line(run("twin", "export", "25scy14-1b", "--out", tmp_path / "a.fmu", code=3))

    assert "No C compiler: 'no-such-cc' is not on the PATH" in line
    assert line.endswith("or write an FMU of sources with --sources-only.")
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_no_twin_is_named_for_what_it_is(tmp_path: Path) -> None:
    store = tmp_path / "fill.h5"
    store.write_bytes(b"windows")

    line = one_line(run("twin", "export", store, "--out", tmp_path / "a.fmu", code=3))

    assert "fill.h5 is not a twin. A twin is a calibration (.json" in line
    assert not (tmp_path / "a.fmu").exists()
