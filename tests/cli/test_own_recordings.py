"""From a folder of somebody's recordings to verdicts, on the command line."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from commandline import TINY, one_line, run, run_json

ROOT = Path(__file__).parents[2]


CWRU = ("label=label", "sample_rate=fs_hz", "speed=rpm_nominal", "specimen=bearing_id", "channels=variables")


@pytest.mark.parametrize(
    ("name", "facts", "length", "classes"),
    [
        (
            "pump_cavitation",
            ("--include", "recordings/06_[12]_*", "--include", "recordings/10_[12]_*", "--column",
             "speed=speed_rpm_nominal", "--unit", "1"),
            1024,
            {"healthy", "cavitation100"},
        ),
        (
            "cwru",
            (
                *(word for pattern in ("B007", "IR007", "OR007at6") for load in (0, 1)
                  for word in ("--include", f"drive_end_12k/*_{pattern}_load{load}_*")),
                *(word for column in CWRU for word in ("--column", column)),
                "--unit", "g", "--names", "drive_end",
            ),
            2048,
            {"ball", "inner_race", "outer_race"},
        ),
    ],
)  # fmt: skip
def test_public_recordings_go_the_whole_way(
    public_data: Path, tmp_path: Path, name: str, facts: tuple[str, ...], length: int, classes: set[str]
) -> None:
    folder = public_data / name
    index = tmp_path / "recordings.toml"
    answer = run_json("index", folder, "--table", folder / "files.csv", "--out", index, *facts)
    assert set(answer["classes"]) == classes
    model = tmp_path / "m.safetensors"
    run("train", index, "--out", model, "--test-fraction", 0.4, "--window", length, *TINY)
    scores = run_json("evaluate", model, index)
    assert set(scores["classes"]) == classes
    assert scores["n_recordings"] >= len(classes)
    for verdict in run_json("diagnose", model, index)["diagnoses"]:
        assert verdict["label"] in classes
        warned = "proves nothing" in " ".join(verdict["notes"])
        assert warned == (verdict["recording_id"] not in scores["recordings"])


def test_the_readme_s_way_to_one_s_own_recordings_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files named by class and pressure, as the README says."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "my-recordings"
    folder.mkdir()
    rng = np.random.default_rng(0)
    time = np.arange(25600) / 25600
    tones = {
        f"{label}_A_15MPa_{repeat}": tone for label, tone in (("normal", 100), ("swash_plate", 400)) for repeat in "123"
    }
    files = {**{folder / f"{name}.csv": tone for name, tone in tones.items()}, tmp_path / "new-recording.csv": 400}
    for path, tone in files.items():
        samples = np.sin(2 * np.pi * tone * time) + 0.1 * rng.standard_normal(time.size)
        np.savetxt(path, samples, header="acceleration_z", comments="", fmt="%.5f")
    lines = [
        line.removeprefix("swashtwin ")
        for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("swashtwin ") and ("my-recordings" in line or "new-recording" in line)
    ]
    assert [line.split()[0] for line in lines] == ["index", "inspect", "train", "evaluate", "diagnose"]
    for line in lines:
        run(*shlex.split(line))
    assert (tmp_path / "diagnosis" / "report.html").is_file()


def test_an_index_of_no_matching_file_says_so(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x\n1\n2\n")
    assert "no file whose path matches" in one_line(run("index", tmp_path, "--include", "*.wav", code=3))
