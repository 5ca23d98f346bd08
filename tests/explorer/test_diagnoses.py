"""The room of diagnoses."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from explored import HEALTHY, WORN, open_explorer, read_workspace, send, token
from plant import Plant
from starlette.testclient import TestClient
from tiny_prior import write_prior

from swashtwin.diagnosis import load_model
from swashtwin.explorer import Workspace


def test_the_verdict_is_that_of_the_diagnose_command_with_its_evidence(
    workspace: Workspace, plant: Plant
) -> None:
    client = open_explorer(workspace, plant.model)

    answer = client.get("/api/diagnosis", params={"name": WORN}).json()

    diagnosis = load_model(plant.model).diagnose(workspace.recording(WORN))
    assert answer["verdict"] == diagnosis.verdict
    assert answer["sentence"] == diagnosis.sentence()
    assert answer["model"] == "model.safetensors"
    assert answer["checks"]
    assert answer["evidence"]


def test_a_dropped_model_diagnoses(client: TestClient, plant: Plant) -> None:
    # there is no model yet
    assert client.get("/api/diagnosis", params={"name": WORN}).status_code == 422

    answer = client.post(
        "/api/drop?name=mine.safetensors",
        content=plant.model.read_bytes(),
        headers={"x-explorer": token(client)},
    )

    assert answer.json() == {"model": "mine.safetensors"}
    assert client.get("/api/diagnosis", params={"name": WORN}).json()["verdict"]


def test_a_dropped_file_that_is_no_model_is_refused_by_name(client: TestClient) -> None:
    answer = client.post(
        "/api/drop?name=mine.safetensors",
        content=b"nothing",
        headers={"x-explorer": token(client)},
    )

    assert answer.status_code == 422
    assert "mine.safetensors" in answer.json()["detail"]


def test_a_model_from_another_page_is_refused(client: TestClient, plant: Plant) -> None:
    # without the token of the explorer's page
    answer = client.post("/api/drop?name=x", content=plant.model.read_bytes())
    assert answer.status_code == 403


@pytest.fixture
def prior(workspace: Workspace, tmp_path: Path) -> Path:
    """A small pump prior for the recordings of the folder."""
    healthy, worn = workspace.recording(HEALTHY), workspace.recording(WORN)
    return write_prior(tmp_path / "prior.safetensors", healthy, worn)


def request_verdict(client: TestClient) -> dict[str, Any]:
    answer = client.get("/api/diagnosis", params={"name": WORN})
    assert answer.status_code == 200, answer.text
    return dict(answer.json())


def adapted_to(count: str) -> str:
    return f"prior.safetensors, adapted to {count} here"


def test_a_prior_is_adapted_before_the_table_is_shown(folder: Path, prior: Path) -> None:
    # the unreadable recording of the folder is labeled as healthy, too
    client = open_explorer(Workspace(folder), prior)
    assert request_verdict(client)["model"] == adapted_to("4 healthy recordings")


def relabel(index: str, name: str) -> str:
    """Return the index with another class for a healthy recording."""
    before, after = index.split(f'file = "{name}"')
    return f'{before}file = "{name}"' + after.replace('"normal"', '"valve_plate"', 1)


def delete(index: str, name: str) -> str:
    """Return the index without a recording."""
    parts = index.split("[[recording]]")
    return "[[recording]]".join(part for part in parts if f'file = "{name}"' not in part)


def rename(index: str, name: str) -> str:
    """Return the index with an id for a recording, by which its row is named."""
    return index.replace(f'file = "{name}"', f'id = "renamed"\nfile = "{name}"')


@pytest.mark.parametrize(
    ("edit", "count"),
    [
        (relabel, "3 healthy recordings"),
        (delete, "3 healthy recordings"),
        (rename, "4 healthy recordings"),
    ],
)
def test_a_prior_is_adapted_again_if_the_index_changes(
    workspace: Workspace, folder: Path, prior: Path, edit: Callable[[str, str], str], count: str
) -> None:
    client = open_explorer(workspace, prior)
    assert request_verdict(client)["model"] == adapted_to("4 healthy recordings")

    index = folder / "recordings.toml"
    index.write_text(edit(index.read_text(encoding="utf-8"), HEALTHY), encoding="utf-8")
    client.get("/api/rows")  # as the page does every few seconds

    renewed = request_verdict(client)
    assert renewed["model"] == adapted_to(count)
    assert client.get("/api/model").json()["model"] == adapted_to(count)
    restarted = open_explorer(read_workspace(folder), prior)
    assert renewed == request_verdict(restarted)


def test_a_prior_without_healthy_recordings_says_so(
    workspace: Workspace, folder: Path, prior: Path
) -> None:
    client = open_explorer(workspace, prior)
    index = folder / "recordings.toml"
    original = index.read_text(encoding="utf-8")
    index.write_text(original.replace('"normal"', '"piston"'), encoding="utf-8")

    answer = client.get("/api/diagnosis", params={"name": WORN})
    assert answer.status_code == 422
    assert "The prior needs healthy recordings" in answer.json()["detail"]

    index.write_text(original, encoding="utf-8")
    assert request_verdict(client)["model"] == adapted_to("4 healthy recordings")


@pytest.mark.nightly
def test_the_shipped_prior_is_adapted_to_the_healthy_recordings(client: TestClient) -> None:
    answer = send(client, "/api/prior", {}).json()

    assert re.search(r"adapted to \d+ healthy recordings", answer.get("model", "")), answer
    assert client.get("/api/diagnosis", params={"name": WORN}).json()["kind"] == "prior"
