"""Commands on one bare file: options state its facts, the advice works, and files of a wrong kind
are named.
"""

from dataclasses import replace
from pathlib import Path

import pytest
from commandline import FACTS, QUICK, TINY, run, run_json, write_tone
from twin_recordings import recording_of

from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import write_recording


@pytest.fixture(scope="module")
def folder(tones: Path) -> Path:
    """Six text tables of two classes, their index, and a model trained on them."""
    run(
        "train",
        tones,
        "--out",
        tones / "m.safetensors",
        "--window",
        128,
        "--test-fraction",
        0,
        *TINY,
    )
    return tones


def test_files_of_one_name_are_told_apart_by_their_folders(folder: Path, tmp_path: Path) -> None:
    files = [write_tone(tmp_path / day / "pump" / "run.csv", 100) for day in ("mo", "tu")]
    plain = write_tone(tmp_path / "mo" / "other.csv", 100)
    answer = run_json("inspect", *files, plain, *FACTS, code=3)
    assert [item["recording_id"] for item in answer["recordings"]] == [
        "mo/pump/run",
        "tu/pump/run",
        "other",
    ]
    shown = run("diagnose", folder / "m.safetensors", *files, *FACTS).stdout
    assert "mo/pump/run" in shown
    assert "tu/pump/run" in shown


def message(*words: object) -> str:
    """What a wrong command line is told, without the frame around it."""
    return " ".join(run(*words, code=2).stderr.replace("│", " ").split())


def test_the_advice_about_another_rate_works_as_printed(folder: Path, tmp_path: Path) -> None:
    file = write_tone(tmp_path / "fast.csv", 300, count=1200, rate=4000)
    words = ("diagnose", folder / "m.safetensors", file, "--sample-rate", "4 kHz", "--unit", "g")
    refused = run(*words, code=3)
    advice = 'If 4000 Hz is right, set --resample "2000 Hz"; otherwise correct --sample-rate'
    assert advice in refused.stdout + refused.stderr
    answer = run_json(*words, "--resample", "2000 Hz")
    assert answer["diagnoses"][0]["label"] in ("normal", "piston")


def test_calibrate_takes_a_bare_file_at_the_operating_point_of_its_options(
    pump: Pump, at_15: OperatingCondition, tmp_path: Path
) -> None:
    recording = replace(
        recording_of(Twin(pump, at_15, bandwidth=2600)), condition=None, label=None, synthetic=False
    )
    file = write_recording(recording, tmp_path / "pump.csv")
    words = (
        "calibrate",
        file,
        "--sample-rate",
        "6.4 kHz",
        "--unit",
        "m/s^2",
        "--band",
        "0-1 kHz",
        *QUICK,
    )
    result = run(*words, "--speed", "860 rpm", "--pressure", "15 MPa", "--out", tmp_path / "c.json")
    assert (
        "is taken as a recording of the class normal. Specify another class with --fault"
        in " ".join(result.stderr.split())
    )
    assert (tmp_path / "c.json").is_file()
    two = ("--speed", "860 rpm", "--pressure", "15 MPa", "--pressure", "10 MPa")
    assert "is one recording" in message(*words, *two)


def test_a_recording_in_place_of_an_index_is_named(folder: Path) -> None:
    for words in (("train",), ("data", "split"), ("evaluate", folder / "m.safetensors")):
        assert "normal_1.csv is not an index of labeled recordings" in message(
            *words, folder / "normal_1.csv"
        )


def test_confidence_takes_the_validation_recordings_that_there_are(
    folder: Path, tmp_path: Path
) -> None:
    model = tmp_path / "c.safetensors"
    words = ("train", folder, "--out", model, "--window", 128, "--test-fraction", 0, *TINY)
    plain = " ".join(run(*words).stderr.split())
    assert (
        "--validation-fraction 0.5 --error-rate 0.25 holds back about 3 of the 6 recordings for it"
        in plain
    )
    said = run(*words, "--validation-fraction", 0.3)
    assert "needs 9 validation recordings, and a share of 0.3 is about 2;" in " ".join(
        said.stderr.split()
    )
    assert (
        "needs 9 validation recordings"
        in run(*words, "--validation-fraction", 0.3, "--error-rate", 0.1, code=3).stderr
    )


def test_evaluate_names_copies_and_says_how_many_are_called_unknown(
    folder: Path, tmp_path: Path
) -> None:
    model, strange = tmp_path / "c.safetensors", tmp_path / "strange"
    shares = ("--validation-fraction", 0.5, "--error-rate", 0.25)
    run("train", folder, "--out", model, "--window", 128, "--test-fraction", 0, *shares, *TINY)
    for number, frequency in enumerate((700, 720, 740)):
        write_tone(strange / f"piston_{number}.csv", frequency)
    (strange / "normal_9.csv").write_bytes((folder / "normal_1.csv").read_bytes())
    run("index", strange, *FACTS)
    said = run("evaluate", model, strange)
    assert "excluded: recording normal_9, a copy of normal_1, altered or not," in " ".join(
        said.stderr.split()
    )
    unknown = run_json("evaluate", model, strange)["confidence"]["called_unknown"]
    assert unknown > 0
    assert f"diagnose would report {unknown:.0%} of these recordings as unknown" in " ".join(
        said.stderr.split()
    )
