"""A folder's files are taken once they stand still, and once only."""

import os
import threading
import time
from pathlib import Path

import pytest

from swashtwin.monitoring.config.settings import FolderSource
from swashtwin.monitoring.sources import folder
from swashtwin.monitoring.sources.folder import FolderWatch


def folder_watch(tmp_path: Path, deliveries, **settings) -> FolderWatch:
    (tmp_path / "inbox").mkdir(exist_ok=True)
    source = FolderSource(
        name="inbox", path=tmp_path / "inbox", **{"settle_time": 0.05, **settings}
    )
    return FolderWatch(source, deliveries.accept, tmp_path)


def put(tmp_path: Path, *names: str) -> None:
    """Write files into the folder, each with its name as content."""
    for name in names:
        path = tmp_path / "inbox" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(path.name.encode())


def taken_files(deliveries) -> list[str]:
    return [delivery.file for delivery, _ in deliveries.items]


def take(watch: FolderWatch) -> None:
    """Let the watch see the files twice, further apart than the settle time."""
    watch.poll()
    time.sleep(0.06)
    watch.poll()


def test_a_file_is_taken_once_it_stands_still(tmp_path: Path, deliveries) -> None:
    watch = folder_watch(tmp_path, deliveries, machine="pump-1")
    path = tmp_path / "inbox" / "a.wav"

    path.write_bytes(b"1")
    watch.poll()
    time.sleep(0.06)

    path.write_bytes(b"12")
    assert watch.poll() == 0
    time.sleep(0.06)
    assert watch.poll() == 1
    assert watch.poll() == 0

    ((delivery, content),) = deliveries.items
    assert (content, delivery.machine, delivery.file) == (b"12", "pump-1", "a.wav")
    assert path.exists()


def test_a_sub_folder_names_the_machine_and_links_hidden_and_unfinished_files_are_ignored(
    tmp_path: Path, deliveries
) -> None:
    watch = folder_watch(tmp_path, deliveries, pattern="*.wav*")

    (tmp_path / "secret.wav").write_bytes(b"secret")
    (tmp_path / "inbox" / "link.wav").symlink_to(tmp_path / "secret.wav")
    put(
        tmp_path,
        "pump-2/today/a.wav",
        "b.wav",
        ".hidden.wav",
        "a.wav.part",
        "~lock.wav",
        "notes.txt",
    )

    take(watch)
    assert {delivery.file: delivery.machine for delivery, _ in deliveries.items} == {
        "a.wav": "pump-2",
        "b.wav": None,
    }


def test_a_full_disk_or_a_missing_folder_is_a_problem_until_it_is_over(
    tmp_path: Path, deliveries
) -> None:
    watch = folder_watch(tmp_path, deliveries)

    (tmp_path / "inbox").rmdir()
    watch.poll()
    assert "cannot be read" in str(watch.status.problem)

    deliveries.failures = 1
    put(tmp_path, "a.wav")

    take(watch)
    assert watch.status.problem == "No space left on device"

    watch.poll()
    assert watch.status.problem is None
    assert len(deliveries.items) == 1


def test_older_files_are_taken_first(tmp_path: Path, deliveries) -> None:
    watch = folder_watch(tmp_path, deliveries)
    for name, age in (("b.wav", 200), ("c.wav", 100), ("a.wav", 150)):
        (tmp_path / "inbox" / name).write_bytes(name.encode())
        os.utime(tmp_path / "inbox" / name, (time.time() - age,) * 2)

    take(watch)
    assert taken_files(deliveries) == ["b.wav", "a.wav", "c.wav"]


def forbid(monkeypatch: pytest.MonkeyPatch, method: str, name: str) -> None:
    """Make a method of `Path` raise an error for files of one name."""
    original = getattr(Path, method)

    def refused(path: Path, *arguments: object, **options: object):
        if path.name == name:
            raise PermissionError(13, "Permission denied")
        return original(path, *arguments, **options)

    monkeypatch.setattr(Path, method, refused)


@pytest.mark.parametrize(
    ("method", "expected_files", "problem"),
    [
        ("rename", ["a.wav", "b.wav"], "a.wav was taken, but cannot be removed: Permission denied"),
        ("open", ["b.wav"], "a.wav cannot be read: Permission denied"),
    ],
)
def test_a_file_that_cannot_be_removed_or_read_is_a_problem_and_does_not_block_the_watch(
    tmp_path: Path,
    deliveries,
    monkeypatch: pytest.MonkeyPatch,
    method: str,
    expected_files: list[str],
    problem: str,
) -> None:
    watch = folder_watch(tmp_path, deliveries, remove=True)
    put(tmp_path, "a.wav", "b.wav")
    forbid(monkeypatch, method, "a.wav")

    # a thread with a time limit: a watch that never gives up would hang the test
    for _ in range(2):
        thread = threading.Thread(target=watch.drain, args=(threading.Event(),), daemon=True)
        thread.start()
        thread.join(5)
        assert not thread.is_alive()

    assert sorted(taken_files(deliveries)) == expected_files
    assert problem in str(watch.status.problem)

    monkeypatch.undo()
    (tmp_path / "inbox" / "a.wav").unlink()
    watch.poll()
    assert watch.status.problem is None


def test_a_file_that_is_too_large_is_not_read_and_stays(
    tmp_path: Path, deliveries, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = folder_watch(tmp_path, deliveries, remove=True)

    monkeypatch.setattr(folder, "MAX_RECORDING_BYTES", 3)
    (tmp_path / "inbox" / "a.wav").write_bytes(b"1234")

    take(watch)
    take(watch)

    ((delivery, content),) = deliveries.items
    assert delivery.problem == "it has 4 bytes; at most 3 are taken. The file stays in its folder."
    assert b"1234" not in content
    assert (tmp_path / "inbox" / "a.wav").exists()


def test_no_taken_file_is_forgotten_while_a_share_is_missing(tmp_path: Path) -> None:

    files = folder.TakenFiles(tmp_path / "taken.txt")
    stamp = folder.Stamp(1, 2, 3)
    for number in range(1100):
        files.add(f"{number}.wav", stamp, b"1")

    # an empty share looks like one that is not mounted
    files.forget_missing(set())
    assert files.has("0.wav", stamp)

    files.forget_missing({"7.wav"})
    assert files.has("7.wav", stamp)
    assert not files.has("0.wav", stamp)


@pytest.mark.parametrize(
    ("seconds", "year"), [(300_000_000_000, 9999), (315_532_800, 1980), (-86_400, 1970)]
)
def test_a_file_is_taken_whatever_its_date(
    tmp_path: Path, deliveries, monkeypatch: pytest.MonkeyPatch, seconds: int, year: int
) -> None:
    monkeypatch.setattr(
        folder, "_stamp", lambda stat: folder.Stamp(stat.st_size, seconds * 10**9, 0)
    )
    watch = folder_watch(tmp_path, deliveries)

    put(tmp_path, "a.wav")
    take(watch)
    ((delivery, _),) = deliveries.items
    assert delivery.facts["time"].startswith(f"{year}-")


def test_a_sub_folder_that_cannot_be_read_or_is_too_deep_is_reported_and_stops_nothing(
    tmp_path: Path, deliveries, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = folder_watch(tmp_path, deliveries)
    (tmp_path / "inbox" / "closed").mkdir()

    put(tmp_path, "a.wav")
    scan = os.scandir

    def refuse(path: Path):
        if Path(path).name == "closed":
            raise PermissionError(13, "Permission denied")
        return scan(path)

    monkeypatch.setattr(folder.os, "scandir", refuse)
    take(watch)
    assert len(deliveries.items) == 1
    assert "closed cannot be read: Permission denied" in str(watch.status.problem)

    (tmp_path / "inbox" / "closed").rmdir()
    (tmp_path / "inbox" / "/".join("abcdefghi")).mkdir(parents=True)
    take(watch)
    assert "deeper than 8 folders" in str(watch.status.problem)


def grow(path: Path) -> None:
    with path.open("ab") as file:
        file.write(b" and more")


def replace_at_equal_size_and_date(path: Path) -> None:
    replacement = path.with_name(".other")
    stat = path.stat()

    replacement.write_bytes(b"other")
    os.utime(replacement, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    replacement.rename(path)


def rewrite_at_equal_size_and_date(path: Path) -> None:
    stat = path.stat()
    path.write_bytes(b"other")

    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


CHANGES = {
    "grows": grow,
    "is replaced": lambda path: (path.unlink(), path.write_bytes(b"another")),
    "is replaced at equal size and date": replace_at_equal_size_and_date,
    "is rewritten at equal size and date": rewrite_at_equal_size_and_date,
    "gets another date": lambda path: os.utime(path, (1e9, 1e9)),
    "gets other rights": lambda path: path.chmod(0o600),
    "gets another name": lambda path: path.rename(path.with_name("b.wav")),
    "is removed": lambda path: path.unlink(),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("moment", ["while it is read", "while it is copied", "once it is copied"])
@pytest.mark.parametrize("remove", [False, True])
def test_whatever_happens_to_a_file_the_content_that_remains_is_taken(
    tmp_path: Path,
    deliveries,
    monkeypatch: pytest.MonkeyPatch,
    remove: bool,
    moment: str,
    change: str,
) -> None:
    path = tmp_path / "inbox" / "a.wav"
    has_changed = []
    stat = Path.stat

    def change_once() -> None:
        if not has_changed:
            has_changed.append(True)
            CHANGES[change](path)

    def accept(delivery, content: bytes) -> str:
        if moment == "while it is copied":
            change_once()
        digest = deliveries.accept(delivery, content)
        if moment == "once it is copied":
            change_once()
        return digest

    def changed_stat(this: Path, **options: bool):
        if moment == "while it is read" and this == path:
            monkeypatch.undo()
            change_once()
        return stat(this, **options)

    watch = folder_watch(tmp_path, deliveries, remove=remove, settle_time=1e-9)

    watch._accept = accept
    path.write_bytes(b"first")
    monkeypatch.setattr(Path, "stat", changed_stat)

    for _ in range(6):
        watch.poll()
    assert has_changed

    contents = [content for _, content in deliveries.items]
    remaining_contents = [file.read_bytes() for file in (tmp_path / "inbox").iterdir()]

    final_content = {
        "grows": b"first and more",
        "is replaced": b"another",
        "is replaced at equal size and date": b"other",
        "is rewritten at equal size and date": b"other",
        "is removed": None,
    }.get(change, b"first")
    if final_content is None:
        assert remaining_contents == []
    else:
        assert final_content in contents
        assert remaining_contents == ([] if remove else [final_content])

    # a file with another date or name may be delivered twice: it is filed as a double
    maximum_count = 2 if change in ("gets another date", "gets another name") else 1
    assert all(contents.count(content) <= maximum_count for content in contents)


def test_a_restart_after_a_power_cut_takes_files_again_that_were_not_recorded_as_taken(
    tmp_path: Path, deliveries
) -> None:
    put(tmp_path, "a.wav", "b.wav")
    take(folder_watch(tmp_path, deliveries, settle_time=1e-9))

    # the last entry is cut, and one file was hidden but not yet removed
    entries = tmp_path / "taken" / "inbox.txt"
    entries.write_bytes(entries.read_bytes()[:-9])
    (tmp_path / "inbox" / ".c.wav.swashtwin-taken").write_bytes(b"left aside")

    watch = folder_watch(tmp_path, deliveries, settle_time=1e-9, remove=True)
    take(watch)
    take(watch)

    assert taken_files(deliveries) == ["a.wav", "b.wav", "b.wav", "c.wav"]


@pytest.mark.parametrize(
    ("settings", "is_late", "name"),
    [
        ({"pattern": "*.csv", "remove": True}, False, ".a.wav.swashtwin-taken"),
        ({"remove": False}, False, ".a.wav.swashtwin-taken"),
        ({"remove": True}, True, ".a.wav.swashtwin-taken"),
        ({"remove": True}, False, ".notes.taken"),
    ],
)
def test_a_file_that_another_source_or_a_user_hid_stays_hidden(
    tmp_path: Path, deliveries, settings, is_late, name
) -> None:
    watch = folder_watch(tmp_path, deliveries, **settings)

    if is_late:
        watch.poll()

    put(tmp_path, name)
    take(watch)
    assert [path.name for path in (tmp_path / "inbox").iterdir()] == [name]


@pytest.mark.parametrize("has_links", [True, False])
def test_a_file_that_is_put_back_replaces_no_other_file(
    tmp_path: Path, deliveries, monkeypatch: pytest.MonkeyPatch, has_links: bool
) -> None:
    def refuse(*_: Path) -> None:
        raise PermissionError(1, "Operation not permitted")

    watch = folder_watch(tmp_path, deliveries, remove=True)
    put(tmp_path, ".a.wav.swashtwin-taken", "a.wav", ".b.wav.swashtwin-taken")
    if has_links:
        # the other file arrives between the check and the change
        monkeypatch.setattr(Path, "exists", lambda path: False)
    else:
        monkeypatch.setattr(folder.os, "link", refuse)

    take(watch)
    take(watch)
    assert sorted(content for _, content in deliveries.items) == [
        b".a.wav.swashtwin-taken",
        b".b.wav.swashtwin-taken",
        b"a.wav",
    ]
    assert "b.wav" in taken_files(deliveries)
