"""The page of evidence is generated from its files, and a study's rows can be added to them."""

import pytest

from swashtwin_bench import evidence


def test_the_page_is_up_to_date() -> None:
    page = evidence.PAGE.read_text(encoding="utf-8")
    expected = evidence.build_page(evidence.load_evidence())
    assert page == expected, "run python -m swashtwin_bench.evidence page"


@pytest.mark.parametrize("entry", evidence.load_evidence(), ids=lambda entry: entry.question)
def test_each_entry_has_its_count_interval_command_and_a_full_table(
    entry: evidence.Evidence,
) -> None:
    assert entry.n
    assert entry.interval
    assert entry.command
    assert {len(row) for row in entry.rows} == {len(entry.columns)}


def test_rows_of_a_study_become_a_table() -> None:
    accuracy = {"mean": 0.95, "std": 0.01, "values": []}
    rows = [{"split": "L2", "accuracy": accuracy, "matrix": [[1]]}]

    # a matrix does not fit in a cell of the page
    columns, cells = evidence.tabulate_rows(rows)
    assert columns == ["split", "accuracy"]
    assert cells == [["L2", "0.950 ± 0.010"]]
