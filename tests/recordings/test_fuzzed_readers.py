"""Mutated files of every format are refused in one line or read, and never with a wrong rate (see
benchmarks).
"""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

import hostile_files as hostile


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # pyuff leaves damaged files open
@pytest.mark.parametrize("name", hostile.FORMATS)
def test_mutated_files_are_refused_in_one_line_or_read_with_the_right_rate(
    name: str, tmp_path: Path
) -> None:
    kinds = [hostile.tried(name, number, 1, tmp_path) for number in range(40)]
    assert [kind for kind in kinds if kind[0] in hostile.FAILURES] == []
    assert sum(kind == "refused" for kind, _ in kinds) > 10
