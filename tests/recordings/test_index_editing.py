"""Facts of an index that are edited by several at once."""

import threading
from pathlib import Path

import pytest

from swashtwin.foundation import InputError, SwashTwinError
from swashtwin.recordings import FactChange, change_facts, read_index

INDEX = """# our test bench
format = 1
classes = ["normal", "piston"]  # as agreed

[defaults]
unit = "g"

[[recording]]
file = "a.csv"  # Monday
label = "normal"
speed = "860 rpm"

[[recording]]
file = "b.csv"
id = "second"
label = "piston"
"""


@pytest.fixture
def index(tmp_path: Path) -> Path:
    """An index that somebody wrote by hand."""
    path = tmp_path / "recordings.toml"
    path.write_text(INDEX, encoding="utf-8")
    return path


def test_changed_lines_change_and_comments_stay(index: Path) -> None:
    change_facts(
        index,
        [
            FactChange("a.csv", "speed", "860 rpm", "1500 rpm"),
            FactChange("second", "pressure", None, "9 MPa"),
        ],
    )
    expected = INDEX.replace("860", "1500").replace(
        'file = "b.csv"\n', 'file = "b.csv"\npressure = "9 MPa"\n'
    )
    assert index.read_text() == expected


def test_a_new_class_is_declared_and_an_undone_one_leaves_again(index: Path) -> None:
    change_facts(index, [FactChange("second", "label", "piston", "valve_plate")])
    assert read_index(index)["classes"] == ["normal", "piston", "valve_plate"]
    change_facts(index, [FactChange("second", "label", "valve_plate", "piston")], undo=True)
    assert read_index(index)["classes"] == ["normal", "piston"]
    assert "# our test bench" in index.read_text()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (FactChange("a.csv", "label", "piston", "normal"), "is 'normal' now"),
        (FactChange("c.csv", "label", None, "normal"), "0 entries"),
        (FactChange("a.csv", "speed", "860 rpm", "1500"), "unit"),
        (FactChange("a.csv", "speed", "860 rpm", "0 rpm"), "above zero"),
        (FactChange("a.csv", "unit", "g", None), "\\[defaults\\]"),
        (FactChange("a.csv", "color", None, "red"), "unknown key"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(
    index: Path, change: FactChange, reason: str
) -> None:
    with pytest.raises(SwashTwinError, match=reason):
        change_facts(index, [FactChange("second", "speed", None, "900 rpm"), change])
    assert index.read_text() == INDEX


def test_an_index_written_in_another_way_is_written_anew(tmp_path: Path) -> None:
    path = tmp_path / "recordings.toml"
    path.write_text('format = 1\nrecording = [{ file = "a.csv" }]\n', encoding="utf-8")
    change_facts(path, [FactChange("a.csv", "label", None, "normal")])
    assert read_index(path) == {"format": 1, "recording": [{"file": "a.csv", "label": "normal"}]}


def test_an_index_edited_by_many_at_once_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "recordings.toml"
    proposed = {"format": 1, "recording": [{"file": f"{n}.csv"} for n in range(24)]}
    refused = []

    def edit(n: int) -> None:
        change_facts(path, [FactChange(f"{n}.csv", "label", None, f"class {n}")], proposed=proposed)
        try:
            change_facts(
                path, [FactChange("0.csv", "specimen", None, f"machine {n}")], proposed=proposed
            )
        except InputError:
            refused.append(n)

    threads = [threading.Thread(target=edit, args=(n,)) for n in range(24)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [entry["label"] for entry in read_index(path)["recording"]] == [
        f"class {n}" for n in range(24)
    ]
    assert len(refused) == 23
