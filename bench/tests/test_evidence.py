"""The page of evidence is made of its files, and a study's answer can be added to them."""

import json

import pytest

from swashtwin_bench import evidence


def test_the_page_is_up_to_date() -> None:
    assert evidence.PAGE.read_text(encoding="utf-8") == evidence.build_page(
        evidence.load_evidence()
    ), "run python -m swashtwin_bench.evidence page"


@pytest.mark.parametrize("entry", evidence.load_evidence(), ids=lambda entry: entry.question)
def test_every_table_is_whole(entry: evidence.Evidence) -> None:
    assert entry.n
    assert entry.interval
    assert entry.command
    assert {len(row) for row in entry.rows} == {len(entry.columns)}


def test_rows_of_a_study_become_a_table() -> None:
    rows = json.loads(
        '[{"split": "L2", "accuracy": {"mean": 0.95, "std": 0.01, "values": []}, "matrix": [[1]]}]'
    )
    assert evidence.tabulate_rows(rows) == (["split", "accuracy"], [["L2", "0.950 ± 0.010"]])
