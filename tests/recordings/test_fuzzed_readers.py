"""Mutated files of every format are refused in one line or read, and never with a wrong rate (see benchmarks)."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

import hostile_files as hostile


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves damaged files open
@pytest.mark.parametrize("name", hostile.FORMATS)
def test_mutated_files_are_refused_in_one_line_or_read_with_the_right_rate(name: str, tmp_path: Path) -> None:
    kinds = [hostile.tried(name, number, 1, tmp_path) for number in range(40)]
    assert [kind for kind in kinds if kind[0] in hostile.FAILURES] == []
    assert sum(kind == "refused" for kind, _ in kinds) > 10


def test_a_wrong_rate_would_be_seen(tmp_path: Path) -> None:
    path = hostile.FORMATS["wav"](tmp_path)
    content = path.read_bytes()
    slower = np.uint32([12800, 12800 * 8]).tobytes()  # rate and bytes per second, which agree
    path.write_bytes(content[:24] + slower + content[32:])
    assert hostile.outcome("wav", path, content, in_blocks=False)[0] == "wrong_rate"
    path.write_bytes(content[:24] + slower[:4] + content[28:])
    kind, message = hostile.outcome("wav", path, content, in_blocks=False)
    assert kind == "refused"
    assert "12800 Hz of 2 channels with 32 bits are not the 204800 bytes per second" in message
