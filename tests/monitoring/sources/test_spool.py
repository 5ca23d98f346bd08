"""What arrived is on the disk, whole, until it was judged."""

import hashlib
from datetime import UTC, datetime
from pathlib import Path

import pytest

from swashtwin.foundation import InputError
from swashtwin.monitoring.sources import spool
from swashtwin.monitoring.sources.delivery import Delivery, check_facts
from swashtwin.monitoring.sources.spool import Spool, lock_folder

NOW = datetime(2026, 11, 23, 14, tzinfo=UTC)


def delivery(file: str = "a.wav") -> Delivery:
    return Delivery("inbox", file, NOW, "pump-1", {"speed": "1500 rpm"})


def test_recordings_wait_in_the_order_of_their_arrival_also_after_a_restart(tmp_path: Path) -> None:
    first = Spool(tmp_path)
    for name in ("a.wav", "b.csv", "c.json"):
        assert first.add(delivery(name), name.encode()) == hashlib.sha256(name.encode()).hexdigest()
    restarted = Spool(tmp_path)
    waiting = []
    while (file := restarted.next(0.0)) is not None:
        waiting.append((file.delivery, file.path.read_bytes().decode()))
        restarted.remove(file)
    assert waiting == [(delivery(name), name) for name in ("a.wav", "b.csv", "c.json")]
    assert list(tmp_path.iterdir()) == []


def test_what_a_kill_left_half_written_is_removed_at_the_start_and_a_damaged_card_is_a_problem(
    tmp_path: Path,
) -> None:
    Spool(tmp_path).add(delivery(), b"whole")
    (tmp_path / "00001-aa.wav").write_bytes(b"half")
    (tmp_path / ".00001-aa.json").write_bytes(b"{")
    assert len(Spool(tmp_path)) == 1
    assert len(list(tmp_path.iterdir())) == 2
    next(tmp_path.glob("*.json")).write_text("{", encoding="utf-8")
    file = Spool(tmp_path).next(0.0)
    assert file is not None
    assert (file.path.read_bytes(), file.delivery.problem) == (
        b"whole",
        "the card of the file is damaged, or another version of swashtwin wrote it (Input data was "
        "truncated); deliver the file again.",
    )


def test_a_full_spool_takes_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spool, "MAX_WAITING", 1)
    waiting = Spool(tmp_path)
    waiting.add(delivery(), b"1")
    with pytest.raises(OSError, match="wait to be judged"):
        waiting.add(delivery(), b"2")


def test_a_folder_is_held_by_one_watch(tmp_path: Path) -> None:
    with (
        lock_folder(tmp_path),
        pytest.raises(InputError, match="in use by another watch"),
        lock_folder(tmp_path),
    ):
        pass
    with lock_folder(tmp_path):
        pass


@pytest.mark.parametrize(
    "file",
    ["../../etc/passwd", "/etc/shadow", "..", "a\0b.wav", "x" * 5000 + ".wav", "\\\\a\\b.csv"],
)
def test_no_name_leads_out_of_the_spool(tmp_path: Path, file: str) -> None:
    waiting = Spool(tmp_path / "spool")
    waiting.add(delivery(file), b"content")
    assert len(list((tmp_path / "spool").iterdir())) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["spool"]
    assert delivery("a\x00\udcff.wav").file == "a\\x00\\udcff.wav"  # which every database takes


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"color": "red"}, "Unknown fact"),
        ({"speed": "-5 rpm"}, "above zero"),
        ({"unit": "furlong"}, "must be one of"),
        ({"time": "yesterday"}, "ISO 8601"),
        ({"time": "1970-01-01T00:00:00Z"}, "before 1990"),
        ({"unit": ""}, "must be text"),
    ],
)
def test_facts_that_cannot_be_are_refused_with_the_reason(
    facts: dict[str, str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        check_facts(facts)
