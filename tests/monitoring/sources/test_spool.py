"""The spool: what arrived is on the disk, whole, until it is judged."""

import hashlib
from datetime import UTC, datetime
from pathlib import Path

import pytest

from swashtwin.foundation import InputError
from swashtwin.monitoring.sources import spool as spool_module
from swashtwin.monitoring.sources.delivery import Delivery, check_facts
from swashtwin.monitoring.sources.spool import Spool, lock_folder

NOW = datetime(2026, 11, 23, 14, tzinfo=UTC)


def delivery(file: str = "a.wav") -> Delivery:
    return Delivery("inbox", file, NOW, "pump-1", {"speed": "1500 rpm"})


def test_recordings_wait_in_the_order_of_their_arrival_also_after_a_restart(tmp_path: Path) -> None:
    # A recording in JSON must not be taken for the card of another one.
    names = ["a.wav", "b.csv", "c.json"]
    spool = Spool(tmp_path)
    for name in names:
        content = name.encode()
        assert spool.add(delivery(name), content) == hashlib.sha256(content).hexdigest()

    restarted = Spool(tmp_path)
    waiting = []
    while (file := restarted.next(0.0)) is not None:
        waiting.append((file.delivery, file.path.read_bytes().decode()))
        restarted.remove(file)

    assert waiting == [(delivery(name), name) for name in names]
    assert list(tmp_path.iterdir()) == []


def test_what_a_kill_left_half_written_is_removed_at_the_start(tmp_path: Path) -> None:
    Spool(tmp_path).add(delivery(), b"whole")
    # A card is renamed once it is complete, so this recording has none.
    (tmp_path / "00001-aa.wav").write_bytes(b"half")
    (tmp_path / ".00001-aa.json").write_bytes(b"{")

    assert len(Spool(tmp_path)) == 1
    # the whole recording and its card
    assert len(list(tmp_path.iterdir())) == 2


def test_a_recording_with_a_damaged_card_is_kept_with_its_problem(tmp_path: Path) -> None:
    Spool(tmp_path).add(delivery(), b"whole")
    next(tmp_path.glob("*.json")).write_text("{", encoding="utf-8")

    file = Spool(tmp_path).next(0.0)

    assert file is not None
    assert file.path.read_bytes() == b"whole"
    assert file.delivery.problem == (
        "the card of the file is damaged, or another version of swashtwin wrote it (Input data was "
        "truncated); deliver the file again."
    )


def test_a_full_spool_takes_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spool_module, "MAX_WAITING", 1)
    spool = Spool(tmp_path)
    spool.add(delivery(), b"1")

    # An OSError, so that the source offers the recording again.
    with pytest.raises(OSError, match="wait to be judged"):
        spool.add(delivery(), b"2")


def test_a_folder_is_held_by_one_watch(tmp_path: Path) -> None:
    with (
        lock_folder(tmp_path),
        pytest.raises(InputError, match="in use by another watch"),
        lock_folder(tmp_path),
    ):
        pass

    # The lock ends with its watch.
    with lock_folder(tmp_path):
        pass


@pytest.mark.parametrize(
    "file",
    [
        pytest.param("../../etc/passwd", id="relative path"),
        pytest.param("/etc/shadow", id="absolute path"),
        pytest.param("..", id="parent folder"),
        pytest.param("a\0b.wav", id="zero byte"),
        pytest.param("x" * 5000 + ".wav", id="longer than a file system allows"),
        pytest.param("\\\\a\\b.csv", id="path of Windows"),
    ],
)
def test_no_name_leads_out_of_the_spool(tmp_path: Path, file: str) -> None:
    spool = Spool(tmp_path / "spool")
    spool.add(delivery(file), b"content")

    # the file and its card, and nothing beside the spool
    assert len(list((tmp_path / "spool").iterdir())) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["spool"]


def test_characters_that_a_database_does_not_take_are_escaped_in_a_name() -> None:
    # the zero byte, and half of a surrogate pair
    assert delivery("a\x00\udcff.wav").file == "a\\x00\\udcff.wav"


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        pytest.param({"color": "red"}, "Unknown fact", id="unknown name"),
        pytest.param({"speed": "-5 rpm"}, "above zero", id="negative speed"),
        pytest.param({"unit": "furlong"}, "must be one of", id="unknown unit"),
        pytest.param({"time": "yesterday"}, "ISO 8601", id="no time"),
        # the time of a clock that was never set
        pytest.param({"time": "1970-01-01T00:00:00Z"}, "before 1990", id="impossible time"),
        pytest.param({"unit": ""}, "must be text", id="empty"),
    ],
)
def test_invalid_facts_are_refused_with_the_reason(facts: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_facts(facts)
