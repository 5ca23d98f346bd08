"""A file that is recorded anew, with its old size and date, shows new figures and a new verdict."""

import os
import re
import shutil
from pathlib import Path
from typing import Any

import h5py
import pytest
from explored import HEALTHY, WORN, open_explorer, read_workspace, send
from plant import Plant
from starlette.testclient import TestClient


@pytest.fixture
def rewritable_folder(folder: Path) -> Path:
    """The folder with an index that states no checksums, so that its files may change."""
    index = folder / "recordings.toml"
    index.write_text(re.sub(r"sha256 = .*\n", "", index.read_text(encoding="utf-8")))
    return folder


def overwrite(path: Path, content: bytes) -> None:
    """Replace the content of a file by as many bytes, and keep its date."""
    status = path.stat()
    assert len(content) == status.st_size
    path.write_bytes(content)
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


def record_anew(path: Path, source: Path, folder: Path) -> None:
    """Write the samples of another recording into a file, and keep its facts, size and date."""
    anew = Path(shutil.copy(path, folder / "anew.h5"))
    with h5py.File(source) as other, h5py.File(anew, "r+") as file:
        file["signal"][...] = other["signal"][...]
    overwrite(path, anew.read_bytes())


REQUESTS = {
    "the waveform": ("samples", {"name": HEALTHY, "start": 0, "count": 9, "width": 1024}),
    "samples": ("samples", {"name": HEALTHY, "start": 0, "count": 9}),
    "a spectrum": ("spectrum", {"name": HEALTHY}),
    "an order spectrum": ("spectrum", {"name": HEALTHY, "kind": "order"}),
    "an envelope spectrum": ("spectrum", {"name": HEALTHY, "kind": "envelope"}),
    "the range of healthy recordings": ("spectrum", {"name": WORN, "healthy": True}),
    "the root mean square": ("rms", {"name": HEALTHY}),
    "a waterfall": ("waterfall", {"name": HEALTHY}),
    "a comparison": ("comparison", {"first": HEALTHY, "second": WORN}),
    "a verdict": ("diagnosis", {"name": HEALTHY}),
}
"""What the page requests of a recording: addresses and their values."""


@pytest.mark.parametrize(("address", "values"), REQUESTS.values(), ids=REQUESTS)
def test_what_is_cached_of_a_recording_is_renewed(
    rewritable_folder: Path, plant: Plant, tmp_path: Path, address: str, values: dict[str, Any]
) -> None:
    def answer(client: TestClient) -> bytes:
        response = client.get(f"/api/{address}", params=values)
        assert response.status_code == 200
        return response.content

    client = open_explorer(read_workspace(rewritable_folder), plant.model)
    original = answer(client)
    assert answer(client) == original

    record_anew(rewritable_folder / HEALTHY, rewritable_folder / WORN, tmp_path)

    renewed = answer(client)
    assert renewed != original
    restarted = open_explorer(read_workspace(rewritable_folder), plant.model)
    assert renewed == answer(restarted)


def request_lines(client: TestClient, start: str = "25scy14-1b") -> dict[str, Any]:
    """Return the lines of a twin and those of the healthy recording."""
    answer = send(client, "/api/twin_lines", {"start": start, "recording": HEALTHY})
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_the_measured_lines_beside_a_twin_are_renewed(
    rewritable_folder: Path, tmp_path: Path
) -> None:
    client = open_explorer(read_workspace(rewritable_folder))
    original = request_lines(client)

    record_anew(rewritable_folder / HEALTHY, rewritable_folder / WORN, tmp_path)

    assert request_lines(client)["measured"]["amplitude"] != original["measured"]["amplitude"]


def test_a_twin_is_renewed_with_the_file_of_its_pump(rewritable_folder: Path) -> None:
    pump = rewritable_folder / "mine.toml"
    pump.write_text('format = 1\nname = "mine"\nlike = "25scy14-1b"\n')
    client = open_explorer(read_workspace(rewritable_folder))
    original = request_lines(client, "mine.toml")

    overwrite(pump, pump.read_bytes().replace(b'"mine"', b'"ours"'))

    assert (original["pump"], request_lines(client, "mine.toml")["pump"]) == ("mine", "ours")


def test_the_table_inspects_a_recording_again(rewritable_folder: Path, tmp_path: Path) -> None:
    workspace = read_workspace(rewritable_folder)
    original = workspace.rows[HEALTHY].to_dict()

    record_anew(rewritable_folder / HEALTHY, rewritable_folder / WORN, tmp_path)
    table = workspace.table(workspace.revision)
    assert [row["name"] for row in table["rows"]] == [HEALTHY]
    if (worker := workspace._worker) is not None:
        worker.join()

    renewed = workspace.rows[HEALTHY].to_dict()
    assert renewed["state"] == "ready"
    assert renewed["rms"] != original["rms"]
    # the page draws its figures again
    assert renewed["stamp"] != original["stamp"]


def test_the_table_shows_a_file_that_is_gone_and_one_that_is_back(rewritable_folder: Path) -> None:
    workspace = read_workspace(rewritable_folder)
    path = rewritable_folder / HEALTHY
    hidden = path.rename(path.with_suffix(".hidden"))

    for state in ("broken", "ready"):
        workspace.table()
        if (worker := workspace._worker) is not None:
            worker.join()
        assert workspace.rows[HEALTHY].state == state
        shutil.copy(hidden, path)


def test_a_file_without_an_index_is_read_again(rewritable_folder: Path, tmp_path: Path) -> None:
    path = rewritable_folder / HEALTHY
    client = open_explorer(read_workspace(path))
    (row,) = client.get("/api/rows").json()["rows"]
    request = {"name": row["name"]}
    original = client.get("/api/rms", params=request).json()

    record_anew(path, rewritable_folder / WORN, tmp_path)

    assert client.get("/api/rms", params=request).json()["amplitude"] != original["amplitude"]


@pytest.mark.nightly
def test_a_prior_is_adapted_to_a_healthy_recording_again(
    rewritable_folder: Path, tmp_path: Path
) -> None:
    client = open_explorer(read_workspace(rewritable_folder))
    send(client, "/api/prior", {})
    original = client.get("/api/diagnosis", params={"name": WORN}).json()

    record_anew(rewritable_folder / HEALTHY, rewritable_folder / WORN, tmp_path)

    renewed = client.get("/api/diagnosis", params={"name": WORN}).json()
    assert renewed["probabilities"] != original["probabilities"]
