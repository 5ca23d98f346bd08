"""Mutated files of every format are refused in one line or read, and never with a wrong rate (see benchmarks)."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

import fuzz_readers as fuzzer


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves damaged files open
@pytest.mark.parametrize("name", fuzzer.FORMATS)
def test_mutated_files_are_refused_in_one_line_or_read_with_the_right_rate(name: str, tmp_path: Path) -> None:
    kinds: list[str] = []
    failures: list[tuple[int, str, str]] = []

    def report(number: int, kind: str, message: str) -> None:
        kinds.append(kind)
        if kind in fuzzer.FAILURES:
            failures.append((number, kind, message))

    fuzzer.fuzz(name, 0, 40, 1, tmp_path, report)
    assert not failures
    assert len(kinds) == 40
    assert kinds.count("refused") > 10


def test_a_wrong_rate_would_be_seen(tmp_path: Path) -> None:
    path = fuzzer.FORMATS["wav"](tmp_path)
    content = path.read_bytes()
    slower = np.uint32([12800, 12800 * 8]).tobytes()  # rate and bytes per second, which agree
    path.write_bytes(content[:24] + slower + content[32:])
    assert fuzzer.outcome("wav", path, content, in_blocks=False)[0] == "wrong_rate"
    path.write_bytes(content[:24] + slower[:4] + content[28:])
    kind, message = fuzzer.outcome("wav", path, content, in_blocks=False)
    assert kind == "refused"
    assert "12800 Hz of 2 channels with 32 bits are not the 204800 bytes per second" in message
