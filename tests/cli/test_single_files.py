"""Commands on one bare file: options state its facts, and the advice of messages works."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from commandline import FACTS, QUICK, TINY, one_line, run, run_json, write_tone
from twin_recordings import recording_of

from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import Recording, load_recording, write_recording, write_store

WINDOW = ("--window", 128)


@pytest.fixture(scope="module")
def folder(tones: Path) -> Path:
    """Six text tables of two classes, their index, and a model trained on them."""
    out = tones / "m.safetensors"
    run("train", tones, "--out", out, *WINDOW, "--test-fraction", 0, *TINY)
    return tones


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Index of two machines, and a model that compares with their healthy recordings."""
    root = tmp_path_factory.mktemp("fleet")
    for machine in "AB":
        for label, frequency in (("normal", 100), ("piston", 300)):
            for number in range(3):
                write_tone(root / machine / f"{machine}_{label}_{number}.csv", frequency, 4200)

    pattern = "(?P<specimen>[AB])_(?P<label>[a-z]+)_"
    run("index", root, *FACTS, "--label-pattern", pattern)
    run("train", root, "--out", root / "m.safetensors", "--test-fraction", 0)
    return root


def usage_error(*arguments: object) -> str:
    """Return the message of a wrong command line, without its box."""
    stderr = run(*arguments, code=2).stderr
    return " ".join(stderr.replace("│", " ").split())


def test_files_of_one_name_are_distinguished_by_their_folders(folder: Path, tmp_path: Path) -> None:
    files = [write_tone(tmp_path / day / "pump" / "run.csv", 100) for day in ("mo", "tu")]
    other = write_tone(tmp_path / "mo" / "other.csv", 100)

    # code 3, as the two files of one name hold the same samples
    answer = run_json("inspect", *files, other, *FACTS, code=3)
    recording_ids = [recording["recording_id"] for recording in answer["recordings"]]
    assert recording_ids == ["mo/pump/run", "tu/pump/run", "other"]

    output = run("diagnose", folder / "m.safetensors", *files, *FACTS).stdout
    assert "mo/pump/run" in output
    assert "tu/pump/run" in output


def test_the_advice_about_another_sample_rate_works_as_printed(
    folder: Path, tmp_path: Path
) -> None:
    file = write_tone(tmp_path / "fast.csv", 300, count=1200, rate=4000)
    facts = ("--sample-rate", "4 kHz", "--unit", "g")
    command = ("diagnose", folder / "m.safetensors", file, *facts)

    refusal = run(*command, code=3)
    advice = 'If 4000 Hz is right, set --resample "2000 Hz"; otherwise correct --sample-rate'
    assert advice in refusal.stdout + refusal.stderr

    answer = run_json(*command, "--resample", "2000 Hz")
    assert answer["diagnoses"][0]["label"] in ("normal", "piston")


@pytest.fixture
def healthy_recording(pump: Pump, at_15: OperatingCondition) -> Recording:
    """Recording of the twin, without its facts, as a user measures it."""
    recording = recording_of(Twin(pump, at_15, bandwidth=2600))
    return replace(recording, condition=None, label=None, synthetic=False)


def test_calibrate_takes_a_bare_file_whose_operating_point_is_an_option(
    healthy_recording: Recording, tmp_path: Path
) -> None:
    file = write_recording(healthy_recording, tmp_path / "pump.csv")
    facts = ("--sample-rate", "6.4 kHz", "--unit", "m/s^2", "--band", "0-1 kHz")
    command = ("calibrate", file, *facts, *QUICK, "--speed", "860 rpm", "--pressure", "15 MPa")

    result = run(*command, "--out", tmp_path / "c.json")

    notes = " ".join(result.stderr.split())
    class_note = "is taken as a recording of the class normal. Specify another class with --fault"
    assert class_note in notes
    assert (tmp_path / "c.json").is_file()

    # one file cannot be measured at two pressures
    assert "is one recording" in usage_error(*command, "--pressure", "10 MPa")


def test_diagnose_asks_for_the_machine_of_a_file_and_takes_it(fleet: Path, tmp_path: Path) -> None:
    file = write_tone(tmp_path / "new.csv", 300, 4200)
    command = ("diagnose", fleet / "m.safetensors", file, *FACTS)

    (without,) = run_json(*command)["diagnoses"]
    (with_machine,) = run_json(*command, "--specimen", "A")["diagnoses"]

    question = "does not specify its machine (specimen)"
    assert question in " ".join(without["notes"])
    assert question not in " ".join(with_machine["notes"])
    # An index states the machine of each recording itself.
    refusal = usage_error("diagnose", fleet / "m.safetensors", fleet, "--specimen", "A")
    assert "specifies it for each recording" in refusal


@pytest.mark.parametrize(
    ("specimen", "healthy_specimen", "machines"),
    [
        pytest.param("b", None, "2 machines: A, B", id="another spelling"),
        pytest.param("Q", "Z", "3 machines: A, B, Z", id="machine of other healthy recordings"),
        pytest.param("pump 7", "", "2 machines: A, B", id="machine of no recording"),
    ],
)
def test_diagnose_reports_that_no_healthy_recording_is_of_the_machine(
    fleet: Path, tmp_path: Path, specimen: str, healthy_specimen: str | None, machines: str
) -> None:
    file = write_tone(tmp_path / "new.csv", 300, 4200)
    command = ["diagnose", fleet / "m.safetensors", file, *FACTS, "--specimen", specimen]
    if healthy_specimen is None:
        command += ["--healthy", fleet]
    elif healthy_specimen:
        tones = [write_tone(tmp_path / f"{number}.csv", 100, 4200) for number in range(3)]
        recordings = [
            load_recording(
                tone, sample_rate="2 kHz", unit="g", label="normal", specimen=healthy_specimen
            )
            for tone in tones
        ]
        write_store(recordings, tmp_path / "healthy.h5")
        command += ["--healthy", tmp_path / "healthy.h5"]

    (answer,) = run_json(*command)["diagnoses"]

    absence = f"No healthy recording is of the machine {specimen}, only of {machines}"
    assert absence in " ".join(answer["notes"])


@pytest.mark.parametrize(
    ("name", "n_files"),
    [
        pytest.param("flat", 3, id="files in the folder"),
        pytest.param("days", 2, id="files in folders below"),
    ],
)
def test_diagnose_compares_with_all_files_of_a_folder_without_an_index(
    fleet: Path, tmp_path: Path, name: str, n_files: int
) -> None:
    file = write_tone(tmp_path / "new.csv", 300, 4200)
    healthy = tmp_path / name
    for number in range(n_files):
        day = healthy / f"day {number}" if name == "days" else healthy
        write_tone(day / f"{number}.csv", 100, 4200)
    command = ("diagnose", fleet / "m.safetensors", file, *FACTS, "--healthy", healthy)

    (answer,) = run_json(*command)["diagnoses"]

    assert answer["label"] == "piston"
    notes = " ".join(answer["notes"])
    assert "was not compared" not in notes
    assert "Machine this machine" not in notes


@pytest.mark.parametrize("copy_name", ["new.csv", "renamed.csv"])
def test_diagnose_does_not_take_the_diagnosed_recording_as_healthy(
    fleet: Path, tmp_path: Path, copy_name: str
) -> None:
    for number in range(3):
        write_tone(tmp_path / "data" / f"{number}.csv", 100, 4200)
    file = write_tone(tmp_path / "data" / "new.csv", 300, 4200)
    if copy_name != file.name:
        shutil.move(file, tmp_path / file.name)
        file = tmp_path / file.name
        shutil.copy(file, tmp_path / "data" / copy_name)
    write_tone(tmp_path / "data" / "worn" / "3.csv", 100, 4200)
    command = ("diagnose", fleet / "m.safetensors", file, *FACTS)

    result = run(*command, "--healthy", tmp_path / "data")

    notes = " ".join(result.stderr.split())
    data = tmp_path / "data"
    assert f"taken as healthy: 0.csv, 1.csv, 2.csv in {data}, 3.csv in {data / 'worn'}." in notes
    assert f"not taken as healthy, as it is to be diagnosed: {Path(copy_name).stem}." in notes


def test_diagnose_does_not_take_recordings_of_a_diagnosed_index_as_healthy(
    fleet: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "all"
    classes = {"0": "normal", "1": "normal", "2": "piston", "new/3": "piston", "new/4": "normal"}
    recordings = []
    for name, label in classes.items():
        frequency = 100 if label == "normal" else 300
        tone = write_tone(tmp_path / "tones" / f"{name}.csv", frequency, 4200)
        recording = load_recording(tone, sample_rate="2 kHz", unit="g", label=label)
        write_recording(recording, folder / f"{name}.h5")
        recordings.append(recording)
    index = tmp_path / "test.toml"
    run("index", folder / "new", "--out", index)
    stored = [
        recording.replace(recording_id=f"s{recording.recording_id}") for recording in recordings
    ]
    write_store([*stored[:2], stored[4]], folder / "z store.h5")

    result = run("diagnose", fleet / "m.safetensors", index, "--healthy", folder)

    notes = " ".join(result.stderr.split())
    assert f"taken as healthy: 0.h5, 1.h5, z store.h5 in {folder}." in notes
    assert "not taken as healthy, as they are to be diagnosed: 3, 4, s4." in notes


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        pytest.param("events.csv", "event,time\nSTART,0\n", "text and few numbers", id="event log"),
        pytest.param(
            "device.txt", "Device\nmaker: Anders\nplace: hall\n", "text and few", id="device"
        ),
        pytest.param("readme.txt", "Pump notes\n", "holds no table of numbers", id="one line"),
        pytest.param("empty.csv", "", "is empty", id="empty file"),
    ],
)
def test_diagnose_takes_no_file_beside_healthy_recordings_as_healthy(
    fleet: Path, tmp_path: Path, name: str, text: str, reason: str
) -> None:
    file = write_tone(tmp_path / "new.csv", 300, 4200)
    healthy = tmp_path / "healthy"
    for number in range(3):
        write_tone(healthy / f"{number}.csv", 100, 4200)
    (healthy / name).write_text(text)
    command = ("diagnose", fleet / "m.safetensors", file, *FACTS, "--healthy", healthy)

    notes = " ".join(run(*command).stderr.split())

    assert f"taken as healthy: 0.csv, 1.csv, 2.csv in {healthy}." in notes
    left_out = notes.split("not taken as healthy: ")[1]
    assert name in left_out
    assert reason in left_out


@pytest.mark.parametrize(
    ("rate", "count"), [(2000, 600), (4000, 4200)], ids=["too short", "other sample rate"]
)
@pytest.mark.parametrize("indexed", [False, True])
def test_an_error_of_healthy_files_names_their_folder(
    fleet: Path, tmp_path: Path, rate: int, count: int, indexed: bool
) -> None:
    healthy = tmp_path / "healthy"
    for number in range(3):
        tone = write_tone(tmp_path / "tones" / f"{number}.csv", 100, count)
        recording = load_recording(tone, sample_rate=rate, unit="g", label="normal")
        write_recording(recording, healthy / f"{number}.h5")
    if indexed:
        run("index", healthy)

    command = ("diagnose", fleet / "m.safetensors", fleet, "--healthy", healthy)
    message = one_line(run(*command, code=3))

    assert f"Healthy recordings in {healthy}: " in message


def test_diagnose_refuses_a_folder_of_the_diagnosed_recording_alone(
    fleet: Path, tmp_path: Path
) -> None:
    file = write_tone(tmp_path / "new.csv", 300, 4200)
    command = ("diagnose", fleet / "m.safetensors", file, *FACTS, "--healthy", tmp_path)

    message = one_line(run(*command, code=3))

    assert "has no file besides the recordings to diagnose" in message
    assert "for --healthy" in message


def test_diagnose_refuses_a_folder_without_recordings_to_compare_with(
    fleet: Path, tmp_path: Path
) -> None:
    (tmp_path / "readme.md").write_text("No recording.")
    command = ("diagnose", fleet / "m.safetensors", fleet, "--healthy", tmp_path)

    message = one_line(run(*command, code=3))

    assert "has neither an index (recordings.toml) nor a file that can be read" in message


def test_train_and_diagnose_report_why_a_model_does_not_compare(folder: Path) -> None:
    out = folder / "again.safetensors"

    trained = run("train", folder, "--out", out, *WINDOW, "--test-fraction", 0, *TINY)
    refusal = run("diagnose", out, folder, "--healthy", folder, code=3)

    reason = "does not compare with healthy recordings of a machine: its network was named"
    assert reason in " ".join(trained.stderr.split())
    assert reason in one_line(refusal)


@pytest.mark.parametrize("command", ["train", "data split", "evaluate"])
def test_a_recording_given_as_an_index_is_refused_by_name(folder: Path, command: str) -> None:
    model = (folder / "m.safetensors",) if command == "evaluate" else ()

    message = usage_error(*command.split(), *model, folder / "normal_1.csv")

    assert "normal_1.csv is not an index of labeled recordings" in message


def test_calibrated_confidence_reports_how_many_validation_recordings_it_needs(
    folder: Path, tmp_path: Path
) -> None:
    out = ("--out", tmp_path / "c.safetensors")
    command = ("train", folder, *out, "--force", *WINDOW, "--test-fraction", 0, *TINY)

    # a model without confidence is trained, with a note how to get it
    without_validation = " ".join(run(*command).stderr.split())
    advice = (
        "--validation-fraction 0.5 --error-rate 0.25 holds back about 3 of the 6 recordings for it"
    )
    assert advice in without_validation

    # so is a model for whose default error rate they are too few
    too_few = run(*command, "--validation-fraction", 0.3)
    shortage = "needs 9 validation recordings, and a share of 0.3 is about 2;"
    assert shortage in " ".join(too_few.stderr.split())

    # an error rate that the user gives is required
    refusal = run(*command, "--validation-fraction", 0.3, "--error-rate", 0.1, code=3)
    assert "needs 9 validation recordings" in refusal.stderr


def test_evaluate_excludes_copies_and_reports_the_share_of_unknown_recordings(
    folder: Path, tmp_path: Path
) -> None:
    model = tmp_path / "c.safetensors"
    shares = ("--validation-fraction", 0.5, "--error-rate", 0.25, "--test-fraction", 0)
    run("train", folder, "--out", model, *WINDOW, *shares, *TINY)

    # tones of frequencies far from those of training, 100 and 300 Hz, and a copy
    strange = tmp_path / "strange"
    for number, frequency in enumerate((700, 720, 740)):
        write_tone(strange / f"piston_{number}.csv", frequency)
    (strange / "normal_9.csv").write_bytes((folder / "normal_1.csv").read_bytes())
    run("index", strange, *FACTS)

    notes = " ".join(run("evaluate", model, strange).stderr.split())
    answer = run_json("evaluate", model, strange)
    unknown_share = answer["confidence"]["called_unknown"]
    unknown = answer["confidence"]["unknown"]

    assert "excluded: recording normal_9, of the same measurement as normal_1," in notes
    assert unknown_share > 0
    assert len(unknown) == unknown_share * answer["n_recordings"]
    share_and_names = f"{unknown_share:.0%} of these recordings as unknown ({', '.join(unknown)})"
    assert f"diagnose would report {share_and_names}" in notes
