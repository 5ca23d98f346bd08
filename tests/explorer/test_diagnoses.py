"""The room of diagnoses."""

import re

import pytest
from explored import WORN, open_explorer, send, token
from plant import Plant
from starlette.testclient import TestClient

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


@pytest.mark.nightly
def test_the_shipped_prior_is_adapted_to_the_healthy_recordings(client: TestClient) -> None:
    answer = send(client, "/api/prior", {}).json()

    assert re.search(r"adapted to \d+ healthy recordings", answer.get("model", "")), answer
    assert client.get("/api/diagnosis", params={"name": WORN}).json()["kind"] == "prior"
