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

# One start and no further unknown: a calibration in a second, whose values are not tested here.
SIMPLE = ("--set", "nuisances=none", "--set", "phases=false")
QUICK = ("--set", "starts=1", *SIMPLE)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the index of two specimens with a recess, at 10 and 15 MPa."""
    folder = tmp_path_factory.mktemp("rig")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swashtwin_bench.rigs.writing.PRESSURES", (MPa(10), MPa(15)))
        # 1.3 s are 18 turns: just enough to measure lines
        size = RigSize(specimens=2, repeats=1, duration=1.3)
        pairs = rig_recordings(0, size, labels=("swash_plate",))
        recordings = [recording for recording, _ in pairs]

    files = [
        write_recording(recording, folder / f"{recording.recording_id}.h5")
        for recording in recordings
    ]
    write_index(recordings, files, folder)
    return folder


def test_several_pressures_are_fitted_together_and_windows_take_turns_among_them(
    rig: Path, tmp_path: Path
) -> None:
    calibration_file = tmp_path / "both.json"
    windows_file = tmp_path / "windows.safetensors"
    conditions = (*AT_15, "--pressure", "10 MPa", "--specimen", "A")
    quick = ("--set", "starts=1", "--set", "phases=false", "--set", "nuisances=typical")

    run_json("calibrate", rig, *conditions, *DEFECT, *quick, "--out", calibration_file)
    calibration = load_calibration(calibration_file)
    pressures = [fit.condition.discharge_pressure for fit in calibration.fits]
    assert pressures == [MPa(15), MPa(10)]
    assert len(calibration.recording_ids) == 2

    run("synthesize", calibration_file, "--like", rig, "--count", 4, "--out", windows_file)
    windows = load_windows(windows_file)
    assert windows.discharge_pressure.tolist() == [MPa(15), MPa(10)] * 2
    assert set(windows.manifest) >= set(calibration.recording_ids)

    # the shell and Python make the same windows
    like = load_recordings(rig)
    windows_in_python = synthesize(calibration, calibration.twin.fault, count=4, like=like)
    assert (windows.signal == windows_in_python.signal).all()


def test_band_lines_and_starts_reach_the_search(rig: Path, tmp_path: Path) -> None:
    calibrate = ("calibrate", rig, *AT_15, *DEFECT, *SIMPLE)
    band = ("--specimen", "A", "--band", "50-1000 Hz")
    search = ("--set", "starts=2", "--set", "bounds=2")

    answer = run_json(*calibrate, *band, *search, "--out", tmp_path / "a.json")
    assert answer["settings"]["band"] == [50.0, 1000.0]
    assert answer["settings"]["lines"] == "piston"
    assert answer["settings"]["starts"] == 2

    refusal = run(*calibrate, "--set", "lines=shaft", "--out", tmp_path / "b.json", code=3)
    assert "multiples of 7 only" in one_line(refusal)


def test_ipinn_takes_its_settings_and_its_page_lists_independent_combinations(
    rig: Path, tmp_path: Path
) -> None:
    out = tmp_path / "a.json"
    report = tmp_path / "page"
    method = ("--specimen", "A", "--method", "ipinn", *SIMPLE, "--set", "epochs=5")

    printed = run(
        "calibrate", rig, *AT_15, *DEFECT, *method, "--report", report, "--out", out
    ).stdout

    page = report / "report.html"
    assert printed.split()[-1] == str(page)
    assert load_calibration(out).settings["epochs"] == 5
    assert "Independent combinations of the six values" in page.read_text(encoding="utf-8")

    # a heading and five epochs
    search = (report / "figures" / "calibration_search.csv").read_text(encoding="utf-8")
    assert len(search.splitlines()) == 6
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["a-interfaces.toml", "a.json", "page"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--set", "learning_rate=0.1"), "--method gauss-newton has no setting 'learning_rate'."),
        (("--preset", "paper", "--set", "starts=2"), "--method ipinn has no setting 'starts'."),
        (("--set", "nuisances=all"), "must be one of none, typical, housing, by-axis"),
    ],
)
def test_an_option_that_the_method_does_not_take_is_an_invalid_command_line(
    rig: Path, options: tuple[str, ...], message: str
) -> None:
    stderr = run("calibrate", rig, *AT_15, *DEFECT, *options, code=2).stderr

    # the message stands in a box
    assert message in " ".join(stderr.replace("│", " ").split())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "Recordings of 2 machines (A, B): a calibration belongs to one pump"),
        (
            ("--specimen", "A", "--pressure", "20 MPa"),
            "the pressure 20 MPa; there are pressures [MPa] 10, 15.",
        ),
    ],
)
def test_a_selection_that_matches_no_single_machine_lists_what_exists(
    rig: Path, options: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    command = ("calibrate", rig, *DEFECT, *QUICK, "--out", tmp_path / "a.json", *options)
    assert message in one_line(run(*command, code=3))
