"""Spectra, recordings, windows, calibrated values and probabilities are those of the golden
files.
"""

from pathlib import Path

import pytest
from golden_files import differences, load_golden
from golden_values import TOLERANCES, VALUES

from swashtwin.recordings import Recording


@pytest.mark.parametrize("name", VALUES)
def test_a_value_is_the_golden_one(name: str, rig: list[Recording], tmp_path: Path) -> None:
    rtol, atol = TOLERANCES[name]
    assert (
        list(differences(VALUES[name](rig, tmp_path), load_golden(name), rtol=rtol, atol=atol))
        == []
    )


def test_a_number_beyond_the_tolerance_a_missing_key_and_another_word_are_differences() -> None:
    golden = {"a": [1.0, 2.0], "b": "word", "c": 3}
    assert not list(differences({"a": [1.0, 2.0 + 1e-12], "b": "word", "c": 3}, golden, rtol=1e-9))

    changed = {"a": [1.0, 2.1], "b": "words", "d": 3}
    assert [line.split()[0] for line in differences(changed, golden, rtol=1e-9)] == [
        ".a[1]",
        ".b",
        ".c",
        ".d",
    ]
