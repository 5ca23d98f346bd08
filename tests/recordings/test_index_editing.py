"""Facts of an index are edited line by line, also by several programs at once."""

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
    """Return an index that somebody wrote by hand."""
    path = tmp_path / "recordings.toml"
    path.write_text(INDEX, encoding="utf-8")
    return path


def test_only_the_changed_lines_change(index: Path) -> None:
    changes = [
        FactChange("a.csv", "speed", "860 rpm", "1500 rpm"),
        FactChange("second", "pressure", None, "9 MPa"),
    ]

    change_facts(index, changes)

    expected = INDEX.replace("860", "1500").replace(
        'file = "b.csv"\n', 'file = "b.csv"\npressure = "9 MPa"\n'
    )
    assert index.read_text() == expected


def test_a_new_class_is_declared_until_its_change_is_undone(index: Path) -> None:
    change_facts(index, [FactChange("second", "label", "piston", "valve_plate")])
    assert read_index(index)["classes"] == ["normal", "piston", "valve_plate"]

    change_facts(index, [FactChange("second", "label", "valve_plate", "piston")], undo=True)
    assert read_index(index)["classes"] == ["normal", "piston"]
    assert "# our test bench" in index.read_text()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        pytest.param(
            FactChange("a.csv", "label", "piston", "normal"), "is 'normal' now", id="outdated"
        ),
        pytest.param(FactChange("c.csv", "label", None, "normal"), "0 entries", id="no entry"),
        pytest.param(FactChange("a.csv", "speed", "860 rpm", "1500"), "unit", id="no unit"),
        pytest.param(
            FactChange("a.csv", "speed", "860 rpm", "0 rpm"), "above zero", id="invalid value"
        ),
        pytest.param(
            FactChange("a.csv", "unit", "g", None), "\\[defaults\\]", id="default of all entries"
        ),
        pytest.param(FactChange("a.csv", "color", None, "red"), "unknown key", id="unknown key"),
    ],
)
def test_an_invalid_change_is_refused_with_the_valid_ones_beside_it(
    index: Path, change: FactChange, reason: str
) -> None:
    valid_change = FactChange("second", "speed", None, "900 rpm")

    with pytest.raises(SwashTwinError, match=reason):
        change_facts(index, [valid_change, change])

    assert index.read_text() == INDEX


def test_an_index_without_a_line_for_each_fact_is_written_anew(tmp_path: Path) -> None:
    path = tmp_path / "recordings.toml"
    path.write_text('format = 1\nrecording = [{ file = "a.csv" }]\n', encoding="utf-8")

    change_facts(path, [FactChange("a.csv", "label", None, "normal")])

    assert read_index(path) == {"format": 1, "recording": [{"file": "a.csv", "label": "normal"}]}


def test_an_index_edited_by_many_at_once_loses_no_change(tmp_path: Path) -> None:
    path = tmp_path / "recordings.toml"
    n_editors = 24
    proposal = {"format": 1, "recording": [{"file": f"{n}.csv"} for n in range(n_editors)]}
    refused = []

    def edit(number: int) -> None:
        """Change an entry of this editor's own, and one that all of them want to change."""
        own_change = FactChange(f"{number}.csv", "label", None, f"class {number}")
        change_facts(path, [own_change], proposed=proposal)

        contested_change = FactChange("0.csv", "specimen", None, f"machine {number}")
        try:
            change_facts(path, [contested_change], proposed=proposal)
        except InputError:
            refused.append(number)

    threads = [threading.Thread(target=edit, args=(number,)) for number in range(n_editors)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    labels = [entry["label"] for entry in read_index(path)["recording"]]
    assert labels == [f"class {number}" for number in range(n_editors)]
    assert len(refused) == n_editors - 1
