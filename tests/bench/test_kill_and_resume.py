"""Commands that are killed go on to the same bytes; the benchmark kills more of them."""

from pathlib import Path

import pytest

from swashtwin.bench.questions import tuning
from swashtwin.foundation import stream
from swashtwin.recordings import Recording, write_index, write_recording

FOLDER = Path(__file__).parents[2] / "benchmarks"


def test_killed_commands_go_on_to_the_same_bytes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(str(FOLDER))
    import kill_and_resume

    monkeypatch.setattr(kill_and_resume, "_PRELOADED", ("swashtwin.cli.app", "h5py", "swashtwin.recordings.store"))
    recordings = [
        Recording(stream(0, i).normal(size=(4, 60_000)), 1000.0, f"r{i}", channels=tuple("wxyz")) for i in range(4)
    ]
    files = [write_recording(recording, tmp_path / f"{recording.recording_id}.h5") for recording in recordings]
    write_index(recordings, files, tmp_path)
    rows = kill_and_resume.kill_and_resume(2, seed=0, commands=("convert",), recordings=tmp_path)
    assert sum(row.kills for row in rows) == 2
    assert [row for row in rows if not row.is_sound] == []


def test_a_search_goes_on_after_a_kill_in_the_middle_of_a_line(tmp_path: Path) -> None:
    journal = tmp_path / "tune" / "search.journal"
    search = tuning._open_search(journal, "search", 0)
    for _ in range(2):
        search.tell(search.ask(), 1.0)
    journal.write_bytes(journal.read_bytes()[:-17])
    for _ in range(2):  # the second time reads what was written after the half line
        search = tuning._open_search(journal, "search", 0)
        search.tell(search.ask(), 1.0)
    assert [trial.state.name for trial in search.trials].count("COMPLETE") == 3
    assert list(tmp_path.rglob("*.*")) == [journal]
