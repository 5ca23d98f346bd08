"""Memory that is given back."""

import ctypes
import sys

import pytest

from swashtwin.foundation import return_memory


@pytest.mark.skipif(sys.platform != "linux", reason="other systems give freed memory back by themselves")
def test_freed_memory_is_given_back_by_the_c_library(monkeypatch: pytest.MonkeyPatch) -> None:
    class Library:
        def __init__(self, name: str | None) -> None:
            self.malloc_trim = trims.append

    trims: list[int] = []
    return_memory()
    monkeypatch.setattr(ctypes, "CDLL", Library)
    return_memory()
    assert trims == [0]


def test_nothing_happens_on_other_systems(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.delattr(ctypes, "CDLL")
    return_memory()
