"""What a killed process leaves is removed, what a living one writes is not, and pieces are taken
up.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from swashtwin.foundation import (
    ArtifactError,
    DataError,
    InputError,
    atomic_files,
    atomic_write,
    read_text,
    resume_folder,
    write_artifact,
    write_text,
)

WRITER = """
import sys, time
from pathlib import Path
from swashtwin.foundation import atomic_write
with atomic_write(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    print("writing", flush=True)
    time.sleep(60)
"""


@pytest.fixture(autouse=True)
def _new_process() -> None:
    """Forget which folders were searched for leftovers, as a new process does not know either."""
    atomic_files._remove_leftovers.cache_clear()


@pytest.fixture
def writer(tmp_path: Path) -> "subprocess.Popen[bytes]":
    """Process that is in the middle of writing ``a.txt``."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, tmp_path / "a.txt"], stdout=subprocess.PIPE
    )
    with process:
        assert process.stdout is not None

        process.stdout.readline()
        yield process
        process.kill()


def test_the_next_start_removes_the_files_of_a_killed_process(
    tmp_path: Path, writer: "subprocess.Popen[bytes]"
) -> None:
    write_text(tmp_path / "b.txt", "whole")
    assert len(os.listdir(tmp_path)) == 3, "the file of a living process is left alone"

    writer.kill()
    writer.wait()
    atomic_files._remove_leftovers.cache_clear()
    write_text(tmp_path / "c.txt", "whole")

    assert sorted(os.listdir(tmp_path)) == ["b.txt", "c.txt"]


def test_a_leftover_without_its_lock_is_removed_and_other_hidden_files_are_not(
    tmp_path: Path,
) -> None:
    (tmp_path / ".swashtwin-0123456789ab.part.h5").write_text("half")
    hidden_files = {".swashtwin-settings", ".swashtwin-0123456789ab", ".a.h5"}
    for name in hidden_files:
        (tmp_path / name).write_text("mine")

    write_text(tmp_path / "a.txt", "whole")
    assert set(os.listdir(tmp_path)) == {"a.txt", *hidden_files}


def test_a_file_is_replaced_after_windows_has_held_it_briefly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(atomic_files, "_IS_WINDOWS", True)
    monkeypatch.setattr(atomic_files, "_REPLACE_DELAYS_S", (0.0, 0.0))
    replace_file = Path.replace
    refusals = [PermissionError(13, "in use"), PermissionError(13, "in use")]

    def busy(temporary: Path, target: Path) -> Path:
        if refusals:
            raise refusals.pop()
        return replace_file(temporary, target)

    monkeypatch.setattr(Path, "replace", busy)
    assert write_text(tmp_path / "a.txt", "new").read_text() == "new"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("umask", [0o022, 0o027, 0o077])
def test_files_have_the_permissions_of_the_users_umask(tmp_path: Path, umask: int) -> None:
    original_umask = os.umask(umask)
    try:
        write_text(tmp_path / "a.txt", "a")
        write_artifact(tmp_path / "a.safetensors", "kind", 1, {}, {"x": torch.zeros(1)})
        with atomic_write(tmp_path / "a.npz") as temporary:
            np.savez_compressed(temporary, x=np.zeros(1))
    finally:
        os.umask(original_umask)

    names = ("a.txt", "a.safetensors", "a.npz")
    assert {(tmp_path / name).stat().st_mode & 0o777 for name in names} == {0o666 & ~umask}


def test_text_is_the_same_on_every_system_and_read_with_or_without_a_byte_order_mark(
    tmp_path: Path,
) -> None:
    path = write_text(tmp_path / "a.txt", "ä\nb\udcfc\n")
    assert path.read_bytes() == b"\xc3\xa4\nb\\udcfc\n"

    path.write_bytes(b"\xef\xbb\xbf\xc3\xa4")
    assert read_text(path) == "ä"

    path.write_bytes("ä".encode("utf-16"))
    with pytest.raises(
        DataError, match=r"is not UTF-8 text \(byte 0xff at 0\); save it with the encoding UTF-8"
    ):
        read_text(path)


def test_a_folder_is_resumed_with_the_same_settings_only(tmp_path: Path) -> None:
    resume_folder(tmp_path / "rig", "rig.json", {"seed": 1})
    (tmp_path / "rig" / "piece").write_text("whole")
    resume_folder(tmp_path / "rig", "rig.json", {"seed": 1})

    with pytest.raises(InputError, match="seed was 1, now 2"):
        resume_folder(tmp_path / "rig", "rig.json", {"seed": 2})
    with pytest.raises(InputError, match="not empty; choose a new folder"):
        resume_folder(tmp_path, "rig.json", {"seed": 1})

    (tmp_path / "rig" / "rig.json").write_text("{")
    with pytest.raises(ArtifactError, match="damaged"):
        resume_folder(tmp_path / "rig", "rig.json", {"seed": 1})


def test_a_folder_is_resumed_if_the_process_was_killed_while_writing_its_manifest(
    tmp_path: Path, writer: "subprocess.Popen[bytes]"
) -> None:
    writer.kill()
    writer.wait()
    resume_folder(tmp_path, "rig.json", {"seed": 1})

    assert os.listdir(tmp_path) == ["rig.json"]


PARENT = """
import os, sys, time
from swashtwin.foundation import parallel

def work(number):
    print(os.getpid(), flush=True)
    time.sleep(60)

if __name__ == "__main__":
    list(parallel(work, [(0,), (1,)], jobs=2))
"""


def test_workers_end_with_a_killed_parent(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    with subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as parent:
        assert parent.stdout is not None

        for _ in range(2):
            parent.stdout.readline()

        parent.kill()
        parent.communicate(timeout=20)  # until the last worker has closed the pipe
