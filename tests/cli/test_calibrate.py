"""The command calibrate: its options and what it prints."""

from pathlib import Path

import pytest
from commandline import AT_15, DEFECT, one_line, run, run_json

from swashtwin.calibration import load_calibration
from swashtwin.foundation import MPa
from swashtwin.learning import load_windows
from swashtwin.recordings import load_recordings, write_index, write_recording
from swashtwin.synthesis import synthesize
from swashtwin_bench import rig_recordings
from swashtwin_bench.rigs.writing import RigSize

SIMPLE = ("--set", "nuisances=none", "--set", "phases=false")
QUICK = ("--set", "starts=1", *SIMPLE)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two specimens with a recess, at 10 and 15 MPa."""
    folder = tmp_path_factory.mktemp("rig")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swashtwin_bench.rigs.writing.PRESSURES", (MPa(10), MPa(15)))
        size = RigSize(specimens=2, repeats=1, duration=1.3)
        recordings = [
            recording for recording, _ in rig_recordings(0, size, labels=("swash_plate",))
        ]
    files = [
        write_recording(recording, folder / f"{recording.recording_id}.h5")
        for recording in recordings
    ]
    write_index(recordings, files, folder)
    return folder


def test_several_pressures_are_fitted_together_and_windows_take_turns_among_them(
    rig: Path, tmp_path: Path
) -> None:
    both, out = tmp_path / "both.json", tmp_path / "windows.safetensors"
    points = (*AT_15, "--pressure", "10 MPa", "--specimen", "A")
    quick = ("--set", "starts=1", "--set", "phases=false", "--set", "nuisances=typical")
    run_json("calibrate", rig, *points, *DEFECT, *quick, "--out", both)
    assert [fit.condition.discharge_pressure for fit in load_calibration(both).fits] == [
        MPa(15),
        MPa(10),
    ]
    assert len(load_calibration(both).recording_ids) == 2
    run("synthesize", both, "--like", rig, "--count", 4, "--out", out)
    windows = load_windows(out)
    assert windows.discharge_pressure.tolist() == [MPa(15), MPa(10)] * 2
    assert set(windows.manifest) >= set(load_calibration(both).recording_ids)
    like, calibration = load_recordings(rig), load_calibration(both)
    same = synthesize(calibration, calibration.twin.fault, count=4, like=like)
    assert (windows.signal == same.signal).all()


def test_band_lines_and_starts_reach_the_search(rig: Path, tmp_path: Path) -> None:
    words = (
        "--specimen",
        "A",
        "--band",
        "50-1000 Hz",
        "--set",
        "starts=2",
        "--set",
        "bounds=2",
        *SIMPLE,
    )
    answer = run_json("calibrate", rig, *AT_15, *DEFECT, *words, "--out", tmp_path / "a.json")
    assert answer["settings"]["band"] == [50.0, 1000.0]
    assert answer["settings"]["lines"] == "piston"
    assert answer["settings"]["starts"] == 2
    refused = one_line(
        run(
            "calibrate",
            rig,
            *AT_15,
            *DEFECT,
            *SIMPLE,
            "--set",
            "lines=shaft",
            "--out",
            tmp_path / "b.json",
            code=3,
        )
    )
    assert "multiples of 7 only" in refused


def test_ipinn_takes_its_settings_and_the_page_says_which_combinations_are_known(
    rig: Path, tmp_path: Path
) -> None:
    words = (
        "--specimen",
        "A",
        "--method",
        "ipinn",
        *SIMPLE,
        "--set",
        "epochs=5",
        "--report",
        tmp_path / "page",
    )
    shown = run("calibrate", rig, *AT_15, *DEFECT, *words, "--out", tmp_path / "a.json").stdout
    page = tmp_path / "page" / "report.html"
    assert shown.split()[-1] == str(page)
    assert load_calibration(tmp_path / "a.json").settings["epochs"] == 5
    assert "Independent combinations of the six values" in page.read_text(encoding="utf-8")
    search = (
        (tmp_path / "page" / "figures" / "calibration_search.csv")
        .read_text(encoding="utf-8")
        .splitlines()
    )
    assert len(search) == 6
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "a-interfaces.toml",
        "a.json",
        "page",
    ]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--set", "learning_rate=0.1"), "--method gauss-newton has no setting 'learning_rate'."),
        (("--preset", "paper", "--set", "starts=2"), "--method ipinn has no setting 'starts'."),
        (("--set", "nuisances=all"), "must be one of none, typical, housing, by-axis"),
    ],
)
def test_an_option_that_the_method_does_not_take_is_a_wrong_command_line(
    rig: Path, words: tuple[str, ...], said: str
) -> None:
    stderr = " ".join(
        run("calibrate", rig, *AT_15, *DEFECT, *words, code=2).stderr.replace("│", " ").split()
    )
    assert said in stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "Recordings of 2 machines (A, B): a calibration belongs to one pump"),
        (
            ("--specimen", "A", "--pressure", "20 MPa"),
            "the pressure 20 MPa; there are pressures [MPa] 10, 15.",
        ),
    ],
)
def test_recordings_of_no_one_machine_and_a_pressure_of_none_name_what_there_is(
    rig: Path, words: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    command = ("calibrate", rig, *DEFECT, *QUICK, "--out", tmp_path / "a.json", *words)
    assert said in one_line(run(*command, code=3))
