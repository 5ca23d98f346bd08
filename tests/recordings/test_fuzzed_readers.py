"""Damaged files of every format are refused in one line, or read without a wrong rate.

The mutations and their kinds of failure are those of ``benchmarks/hostile_files.py``.
"""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

import hostile_files

N_MUTATIONS = 40


# pyuff leaves damaged files open
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", hostile_files.FORMATS)
def test_mutated_files_are_refused_in_one_line_or_read_with_the_right_rate(
    name: str, tmp_path: Path
) -> None:
    outcomes = [hostile_files.tried(name, number, 1, tmp_path) for number in range(N_MUTATIONS)]

    failures = [outcome for outcome in outcomes if outcome[0] in hostile_files.FAILURES]
    assert failures == []

    # mutations that damage nothing would test nothing
    n_refused = sum(kind == "refused" for kind, _ in outcomes)
    assert n_refused > 10
