"""Mutated files of every format are refused in one line or read, and never with a wrong rate (see benchmarks)."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "fuzz_readers.py"
FORMATS = (
    "csv", "csv_gz", "text_gz", "mat5", "mat5_plain", "mat73", "hdf5", "hdf5_foreign", "store", "wav", "tdms", "uff",
    "parquet", "npz", "mdf",
)  # fmt: skip


@pytest.fixture(scope="module")
def fuzzer() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fuzz_readers", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz_readers"] = module
    sys.path.insert(0, str(SCRIPT.parent))
    spec.loader.exec_module(module)
    sys.path.remove(str(SCRIPT.parent))
    return module


def test_every_format_that_the_fuzzer_knows_is_fuzzed_here(fuzzer: ModuleType) -> None:
    assert tuple(fuzzer.FORMATS) == FORMATS


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves damaged files open
@pytest.mark.parametrize("name", FORMATS)
def test_mutated_files_are_refused_in_one_line_or_read_with_the_right_rate(
    fuzzer: ModuleType, name: str, tmp_path: Path
) -> None:
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


def test_a_wrong_rate_would_be_seen(fuzzer: ModuleType, tmp_path: Path) -> None:
    path = fuzzer.FORMATS["wav"](tmp_path)
    content = path.read_bytes()
    slower = np.uint32([12800, 12800 * 8]).tobytes()  # rate and bytes per second, which agree
    path.write_bytes(content[:24] + slower + content[32:])
    assert fuzzer.outcome("wav", path, content, in_blocks=False)[0] == "wrong_rate"
    path.write_bytes(content[:24] + slower[:4] + content[28:])
    kind, message = fuzzer.outcome("wav", path, content, in_blocks=False)
    assert kind == "refused"
    assert "12800 Hz of 2 channels with 32 bits are not the 204800 bytes per second" in message
