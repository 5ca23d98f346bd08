"""The page of evidence is what its files say, and a study's answer can be added to them."""

import json

import pytest

from swashtwin_bench import evidence


def test_the_page_is_up_to_date() -> None:
    assert evidence.PAGE.read_text(encoding="utf-8") == evidence.page(evidence.load()), (
        "run python -m swashtwin_bench.evidence page"
    )


@pytest.mark.parametrize("one", evidence.load(), ids=lambda one: one.question)
def test_every_table_is_whole(one: evidence.Evidence) -> None:
    assert one.n
    assert one.interval
    assert one.command
    assert {len(row) for row in one.rows} == {len(one.columns)}


def test_rows_of_a_study_become_a_table() -> None:
    rows = json.loads(
        '[{"split": "L2", "accuracy": {"mean": 0.95, "std": 0.01, "values": []}, "matrix": [[1]]}]'
    )
    assert evidence.table_of(rows) == (["split", "accuracy"], [["L2", "0.950 ± 0.010"]])
