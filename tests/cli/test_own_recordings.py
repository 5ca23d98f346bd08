"""From a folder of somebody's recordings to verdicts, on the command line."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from commandline import one_line, run

ROOT = Path(__file__).parents[2]


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
