"""An audit of anyone's table names what its roles share, and refuses a table it cannot read in one line."""

import json
from pathlib import Path

import numpy as np
import pytest
from commandline import one_line, run, run_json
from hypothesis import given
from hypothesis import strategies as st

from swashtwin.learning import audit
from swashtwin.learning.leakage.table import AuditRow
from swashtwin.recordings import Recording, write_index, write_recording

CLEAN = """window,recording,specimen,role,start,stop,class,sha256
w1,a,p1,train,0,100,normal,h1
w2,b,p2,train,0,100,leak,h2
w3,c,p3,test,0,100,normal,h3
w4,d,p4,test,0,100,leak,h4
w5,e,p1,train,0,100,leak,h5
w6,f,p3,test,0,100,leak,h6
w7,g,p2,train,0,100,normal,h7
"""


def table(folder: Path, text: str) -> Path:
    path = folder / "windows.csv"
    path.write_text(text, encoding="utf-8")
    return path


def kinds(answer: dict) -> dict[str, str]:
    return {finding["kind"]: finding["severity"] for finding in answer["findings"]}


def test_a_clean_table_has_no_finding_and_strict_ends_with_0(tmp_path):
    answer = run_json("data", "audit", table(tmp_path, CLEAN), "--strict")
    assert answer["findings"] == []
    assert answer["roles"] == {"train": 4, "test": 3}
    assert "No leak was found" in run("data", "audit", table(tmp_path, CLEAN)).stdout


@pytest.mark.parametrize(
    ("row", "kind", "severity"),
    [
        ("x,a,p1,test,50,150,normal,h9", "overlap", "leak"),
        ("x,a,p1,test,100,200,normal,h9", "shared_recording", "leak"),
        ("x,z,p9,test,0,100,normal,h1", "duplicate", "leak"),
        ("w1,z,p9,test,0,100,normal,h9", "shared_window", "leak"),
        ("x,z,p1,test,0,100,normal,h9", "shared_specimen", "warning"),
        ("x,z,p9,test,0,100,crack,h9", "class_in_one_role", "warning"),
        ("x,z,p9,test,0,100,crack,h9", "one_specimen_class", "warning"),
        ("x,c,p3,test,50,150,normal,h9", "test_overlap", "warning"),
        ("x,z,p9,train,0,100,normal,h1", "duplicate_within", "note"),
    ],
)
def test_each_fault_of_a_table_is_found(tmp_path, row, kind, severity):
    path = table(tmp_path, CLEAN + row + "\n")
    assert kinds(run_json("data", "audit", path))[kind] == severity
    run("data", "audit", path, "--strict", code=3 if severity == "leak" else 0)


def test_windows_that_only_touch_do_not_overlap(tmp_path):
    answer = run_json("data", "audit", table(tmp_path, CLEAN + "x,a,p1,test,100,200,normal,h9\n"))
    assert "overlap" not in kinds(answer)


def test_synthetic_windows_in_a_test_are_a_leak(tmp_path):
    head, *rows = CLEAN.splitlines()
    text = "\n".join([f"{head},synthetic", *(f"{row},{'yes' if 'w4' in row else 'no'}" for row in rows)])
    assert kinds(run_json("data", "audit", table(tmp_path, text)))["synthetic"] == "leak"


def test_quoted_names_may_hold_commas_and_breaks(tmp_path):
    answer = run_json("data", "audit", table(tmp_path, 'recording,role\n"a, first\nday",train\n"a, first\nday",test\n'))
    assert answer["findings"][0]["examples"] == ["a, first\nday"]


def test_what_must_stay_whole_is_named_by_the_reader(tmp_path):
    path = table(tmp_path, CLEAN + "x,z,p1,test,0,100,normal,h9\n")
    run("data", "audit", path, "--group", "specimen", "--strict", code=3)
    days = "file_no;fold;day\n1;1;mon\n2;2;mon\n3;2;tue\n"
    answer = run_json("data", "audit", table(tmp_path, days), "--column", "recording=file_no", "--group", "day")
    assert kinds(answer) == {"shared_day": "leak"}
    assert answer["facts"] == ["recording", "day"]


def test_other_names_of_columns_and_roles_are_understood(tmp_path):
    text = "file_id\tsplit\tlabel\tmachine\n1\tTraining\tx\tA\n2\tval\tx\tB\n1\tVALID\tx\tA\n"
    answer = run_json("data", "audit", table(tmp_path, text))
    assert answer["roles"] == {"train": 1, "validation": 2}
    assert {"shared_recording", "shared_specimen"} <= set(kinds(answer))


@pytest.mark.parametrize(
    ("text", "words", "said"),
    [
        ("a,b\n1,2\n", (), r"no column 'recording'; it has a, b. Name its column with --column."),
        (CLEAN, ("--column", "recording=recordin"), "did you mean 'recording'?"),
        (CLEAN, ("--column", "recordin=window"), "'recordin' is no fact of a window; did you mean 'recording'?"),
        (CLEAN, ("--group", "day"), "no column 'day'"),
        ("recording,role\n", (), "no row below its heading"),
        ("", (), "no column 'recording'; it has none"),
        ("recording,role\na,\n", (), "line 2: role is empty"),
        ("recording,role,start,stop\na,x,5,5\n", (), "stop (5) must exceed start (5)"),
        ("recording,role,start\na,x,5s\n", (), "'5s' is no number"),
        ("recording,role,synthetic\na,x,maybe\n", (), "neither true nor false"),
        ("recording,role\na,x\n", ("--group", "specimen"), "does not tell the specimen"),
    ],
)
def test_a_table_that_cannot_be_read_ends_in_one_line_that_says_what_would_be_right(tmp_path, text, words, said):
    assert said in one_line(run("data", "audit", table(tmp_path, text), *words, code=3))


def test_a_missing_or_binary_file_ends_in_one_line(tmp_path):
    assert "does not exist" in one_line(run("data", "audit", tmp_path / "none.csv", code=3))
    (tmp_path / "x.csv").write_bytes(b"\xff\xfe\x00recording")
    assert "is no UTF-8 text" in one_line(run("data", "audit", tmp_path / "x.csv", code=3))


@given(
    st.lists(
        st.tuples(st.sampled_from("ab"), st.sampled_from(["train", "test"]), st.integers(0, 40), st.integers(1, 9)),
        min_size=1,
        max_size=14,
    )
)
def test_an_overlap_is_found_just_where_two_windows_of_both_roles_share_a_moment(spans):
    rows = [AuditRow(name, role, start=start, stop=start + length) for name, role, start, length in spans]
    struck = {
        (position, row.recording)
        for position, row in enumerate(rows)
        if row.role == spans_second(rows)
        for other in rows
        if other.role != row.role and other.recording == row.recording
        and other.start < row.stop and row.start < other.stop
    }  # fmt: skip
    result = [finding for finding in audit(rows).findings if finding.kind == "overlap"]
    assert (result[0].windows if result else 0) == len(struck)


def spans_second(rows: list[AuditRow]) -> str:
    """The role that comes second, of which overlapping rows are counted."""
    return [*dict.fromkeys(row.role for row in rows), "none"][1]


def test_a_folder_that_split_wrote_is_audited_by_its_readings(tmp_path):
    def recording(name: str, source: str, label: str, machine: str) -> Recording:
        noise = np.random.default_rng(list(source.encode())).normal(size=(1, 200))
        return Recording(noise, 1000.0, name, label=label, specimen=machine)

    recordings = [
        recording(f"{label}{number}", f"{label}{number}", label, f"p{number}") for label in "xy" for number in range(4)
    ]
    recordings.append(recording("copy", "x1", "x", "p1"))
    files = [write_recording(each, tmp_path / f"{each.recording_id}.h5") for each in recordings]
    index = write_index(recordings, files, tmp_path)
    run("data", "split", index, "--group", "specimen", "--out", tmp_path / "by_specimen", "--test-fraction", "0.25")
    assert "duplicate" not in kinds(
        run_json("data", "audit", tmp_path / "by_specimen", "--group", "specimen", "--strict")
    )
    (tmp_path / "copied").mkdir()
    for role, ids in (("train", ["x1", "y1", "x2"]), ("test", ["copy", "y2", "y3"])):
        remaining = [position for position, each in enumerate(recordings) if each.recording_id in ids]
        write_index(
            [recordings[at] for at in remaining], [files[at] for at in remaining], tmp_path / "copied" / f"{role}.toml"
        )
    answer = run_json("data", "audit", tmp_path / "copied")
    assert kinds(answer)["duplicate"] == "leak"
    assert json.dumps(answer)
