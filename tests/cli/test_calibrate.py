"""The commands calibrate and compare: their options, how they are interrupted, and what they print."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from commandline import AT_15, DEFECT, one_line, run, run_json
from swashtwin.calibration.methods.checkpoint import Checkpoint

from swashtwin.bench import rig_recordings
from swashtwin.bench.rigs.writing import RigSize
from swashtwin.calibration import difference, load_calibration
from swashtwin.foundation import MPa
from swashtwin.learning import load_windows
from swashtwin.recordings import load_recordings, write_index, write_recording
from swashtwin.synthesis import synthesize

SIMPLE = ("--nuisances", "none", "--no-phases")
QUICK = ("--set", "starts=1", *SIMPLE)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two specimens with a recess, at 10 and 15 MPa."""
    folder = tmp_path_factory.mktemp("rig")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swashtwin.bench.rigs.writing.PRESSURES", (MPa(10), MPa(15)))
        size = RigSize(specimens=2, repeats=1, duration=1.3)
        recordings = [recording for recording, _ in rig_recordings(0, size, labels=("swash_plate",))]
    write_index(
        recordings,
        [write_recording(recording, folder / f"{recording.recording_id}.h5") for recording in recordings],
        folder,
    )
    return folder


@pytest.fixture(scope="module")
def pair(rig: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two calibrations of specimen A: at 15 MPa, and at both pressures together."""
    folder = tmp_path_factory.mktemp("pair")
    single, both = folder / "one.json", folder / "both.json"
    run_json("calibrate", rig, *AT_15, *DEFECT, *QUICK, "--specimen", "A", "--out", single)
    more = ("--pressure", "10 MPa", "--nuisances", "usual")  # the last of an option counts
    run_json("calibrate", rig, *AT_15, *DEFECT, *QUICK, "--specimen", "A", "--out", both, *more)
    return single, both


def test_several_pressures_are_fitted_together(pair: tuple[Path, Path]) -> None:
    assert [fit.condition.discharge_pressure for fit in load_calibration(pair[1]).fits] == [MPa(15), MPa(10)]
    assert len(load_calibration(pair[1]).recording_ids) == 2


@pytest.mark.parametrize("words", [(), ("--no-draws",), ("--nominal",)])
def test_windows_of_a_calibration_at_several_pressures_take_turns_among_them(
    rig: Path, pair: tuple[Path, Path], tmp_path: Path, words: tuple[str, ...]
) -> None:
    out = tmp_path / "windows.safetensors"
    run("synthesize", pair[1], "--like", rig, "--count", 4, "--background", "none", *words, "--out", out)
    windows = load_windows(out)
    assert windows.discharge_pressure.tolist() == [MPa(15), MPa(10)] * 2
    assert set(windows.manifest) >= set(load_calibration(pair[1]).recording_ids)
    if not words:
        like, calibration = load_recordings(rig), load_calibration(pair[1])
        same = synthesize(calibration, calibration.twin.fault, count=4, like=like, background="none")
        assert (windows.signal == same.signal).all()


def test_a_fleet_s_folder_that_cannot_be_written_is_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    words = ("twin", "calibrate-fleet", tmp_path / "nowhere.toml", "--out", tmp_path / "file")
    assert "is a file" in one_line(run(*words, code=3))


def test_band_lines_and_starts_reach_the_search(rig: Path, tmp_path: Path) -> None:
    words = ("--band", "50-1000 Hz", "--set", "starts=2", "--method", "lbfgs", "--bounds", 2, *SIMPLE)
    answer = run_json("calibrate", rig, *AT_15, *DEFECT, *words, "--out", tmp_path / "a.json")
    assert answer["settings"]["band"] == [50.0, 1000.0]
    assert answer["settings"]["lines"] == "piston"
    assert answer["settings"]["starts"] == 2
    refused = one_line(
        run("calibrate", rig, *AT_15, *DEFECT, *SIMPLE, "--lines", "shaft", "--out", tmp_path / "b.json", code=3)
    )
    assert "multiples of 7 only" in refused


def test_ipinn_takes_its_settings_and_the_page_says_what_the_recordings_can_tell(rig: Path, tmp_path: Path) -> None:
    words = (
        "--method",
        "ipinn-improved",
        *SIMPLE,
        "--set",
        "epochs=5",
        "--set",
        "spectrum=logarithmic",
        "--report",
        tmp_path / "page",
    )
    answer = run_json("calibrate", rig, *AT_15, *DEFECT, *words, "--out", tmp_path / "a.json")
    assert answer["settings"]["values"] == "logarithms"
    assert answer["settings"]["spectrum"] == "logarithmic"
    assert "What the measurement can tell" in Path(answer["report"]).read_text(encoding="utf-8")
    losses = (tmp_path / "page" / "figures" / "calibration_losses.csv").read_text(encoding="utf-8").splitlines()
    assert "gradient_norm" in losses[0]
    assert len(losses) == 6
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a-interfaces.toml", "a.json", "page"]


def test_learning_rates_are_tried_and_the_best_is_taken(rig: Path, tmp_path: Path) -> None:
    words = ("--method", "direct-adam", *SIMPLE, "--set", "epochs=10", "--learning-rates", "0.0001,0.1")
    answer = run_json("calibrate", rig, *AT_15, *DEFECT, *words, "--out", tmp_path / "new" / "a.json")
    losses = answer["learning_rates"]["weighted_losses"]
    assert answer["learning_rates"]["rates"] == [0.0001, 0.1]
    assert losses[1] < losses[0]
    assert answer["settings"]["learning_rate"] == 0.1
    assert not list((tmp_path / "new").glob("*.rates"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--set", "learning_rate=0.1"), "--method gauss-newton has no setting 'learning_rate'."),
        (("--preset", "paper", "--set", "starts=2"), "--method ipinn has no setting 'starts'."),
        (("--method", "direct-adam", "--set", "spectrum=linear"), "--method direct-adam has no setting 'spectrum'."),
        (("--set", "start=2"), "Did you mean starts?"),
        (("--set", "starts=2.5"), "starts=2.5 must be a whole number"),
        (("--set", "starts"), "must be NAME=VALUE"),
        (("--learning-rates", "paper"), "gauss-newton has no learning rate"),
        (
            ("--preset", "paper", "--set", "learning_rate=0.1", "--learning-rates", "paper"),
            "leave out --set learning_rate",
        ),
        (("--learning-rates", "fast"), "must be numbers with commas"),
    ],
)
def test_an_option_that_the_method_does_not_take_is_a_wrong_command_line(
    rig: Path, words: tuple[str, ...], said: str
) -> None:
    stderr = " ".join(run("calibrate", rig, *AT_15, *DEFECT, *words, code=2).stderr.replace("│", " ").split())
    assert said in stderr


def test_an_interrupted_calibration_says_how_to_go_on_and_ends_at_the_same_values(
    rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, save = tmp_path / "long.json", Checkpoint.save
    words = ("--preset", "paper", "--set", "epochs=50", "--set", "learning_rate=0.001")

    def save_and_interrupt(*arguments: Any) -> None:
        save(*arguments)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Checkpoint, "save", save_and_interrupt)
        interrupted = run("calibrate", rig, *AT_15, *DEFECT, *words, "--out", out, code=130)
    assert interrupted.stdout == ""
    last = interrupted.stderr.strip().splitlines()[-1]
    assert last.startswith("swashtwin: interrupted; ")
    assert "long.json.checkpoint holds every 25th epoch: the same command with --resume continues" in interrupted.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["long.json.checkpoint"]
    other = one_line(run("calibrate", rig, *AT_15, *DEFECT, *words, "--seed", "1", "--resume", "--out", out, code=3))
    assert "its seed is 0, this run's is 1" in other
    resumed = run_json("calibrate", rig, *AT_15, *DEFECT, *words, "--resume", "--out", out)
    whole = run_json("calibrate", rig, *AT_15, *DEFECT, *words, "--out", tmp_path / "whole.json")
    assert resumed["estimates"] == whole["estimates"]
    assert resumed["simulations"] == whole["simulations"] == 50
    histories = [json.loads(path.read_text())["history"] for path in (out, tmp_path / "whole.json")]
    assert histories[0] == histories[1]
    assert not list(tmp_path.glob("*.checkpoint"))


def test_without_resume_a_checkpoint_that_was_left_is_begun_anew(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.json"
    out.with_name("a.json.checkpoint").write_bytes(b"left")
    answer = run_json("calibrate", rig, *AT_15, *DEFECT, "--preset", "paper", "--set", "epochs=3", "--out", out)
    assert answer["simulations"] == 3


def test_compare_tells_values_fits_settings_and_shared_recordings(pair: tuple[Path, Path]) -> None:
    answer = run_json("twin", "compare", *pair)
    assert [item["letter"] for item in answer["values"]] == ["C_sw", "K_sw", "C_v", "K_v", "C_Hz", "K_Hz"]
    first, second = map(load_calibration, pair)
    for estimate, a, b in zip(answer["values"], first.estimates, second.estimates, strict=True):
        assert estimate["values"] == [a.value, b.value]
        assert estimate["overlap"] == (max(a.interval[0], b.interval[0]) <= min(a.interval[1], b.interval[1]))
        assert (estimate["letter"] in answer["telling"]) == (abs(estimate["deviations"]) > 2)
    assert answer["shared"] == list(first.recording_ids)
    assert answer["alone"] == [[], [name for name in second.recording_ids if name not in first.recording_ids]]
    assert answer["fits"]["rmse"] == [first.fit_after.rmse, second.fit_after.rmse]
    assert set(answer["settings"]) >= {"constants searched", "discharge pressure [Pa]"}
    assert "seed" not in answer["settings"]
    assert [constant["coordinates"][0] for constant in answer["constants"]] == [None] * 4
    assert any("not independent" in note for note in answer["notes"])


def test_values_are_told_apart_in_standard_deviations_of_their_logarithms(pair: tuple[Path, Path]) -> None:
    loaded = load_calibration(pair[0])
    first = replace(loaded, estimates=tuple(replace(estimate, log_std=0.1) for estimate in loaded.estimates))
    estimate = first.estimate("C_v")
    moved = replace(
        estimate, value=2 * estimate.value, interval=(1.9 * estimate.value, 2.1 * estimate.value), log_std=0.2
    )
    estimates = tuple(moved if estimate.letter == "C_v" else estimate for estimate in first.estimates)
    differences = difference(first, replace(first, estimates=estimates, recording_hashes={"else": ("0",)}))
    (telling,) = [value for value in differences.values if value.is_telling]
    assert telling.letter == "C_v"
    assert telling.log_ratio == pytest.approx(math.log(2))
    assert telling.deviations == pytest.approx(math.log(2) / math.hypot(0.1, 0.2))
    assert differences.alone == (first.recording_ids, ("else",))
    assert not any("not independent" in note for note in differences.notes)


def test_a_calibration_does_not_differ_from_itself(pair: tuple[Path, Path]) -> None:
    answer: dict[str, Any] = run_json("twin", "compare", pair[0], pair[0])
    assert answer["settings"] == {}
    assert answer["telling"] == []
    assert all(item["deviations"] == 0 and item["overlap"] for item in answer["values"])


def test_compare_prints_tables_and_writes_a_page(pair: tuple[Path, Path], tmp_path: Path) -> None:
    shown = run("twin", "compare", *pair, "--report", tmp_path).stdout
    assert "recordings: 1 shared, 0 of A only, 1 of B only" in shown
    assert "C_Hz" in shown
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Two calibrations side by side" in page
    assert "intervals overlap" in page
    refused = one_line(run("twin", "compare", pair[0], tmp_path / "none.json", code=3))
    assert "no such calibration" in refused


def test_bounds_are_stated_by_letter_or_parameter_with_or_without_units(rig: Path, tmp_path: Path) -> None:
    words = ("--bounds", "C_sw=1e4..1e8,K_v=0.06..0.6 GN/m", "--bounds", "piston_bore.damping=1e4 .. 1e5", *QUICK)
    answer = run_json("calibrate", rig, *AT_15, *DEFECT, *words, "--out", tmp_path / "a.json")
    bounds = {estimate["letter"]: estimate["bounds"] for estimate in answer["estimates"]}
    assert bounds["C_sw"] == [1e4, 1e8]
    assert bounds["K_v"] == [6e7, 6e8]
    assert bounds["C_Hz"] == [1e4, 1e5]


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("C_sw=1e4", 2, "two limits"),
        ("C_sw=1e4..1e8 N", 3, "is no quantity in N*s/m"),
        ("C_x=1..2", 3, "which is none of"),
        ("ten", 2, "must be numbers"),
        ("C_sw=1..2", 3, "hold the nominal value"),
    ],
)
def test_bounds_that_say_nothing_are_refused(rig: Path, tmp_path: Path, text: str, code: int, words: str) -> None:
    command = ("calibrate", rig, *AT_15, *DEFECT, *QUICK, "--bounds", text, "--out", tmp_path / "a.json")
    assert words in run(*command, code=code).stderr
