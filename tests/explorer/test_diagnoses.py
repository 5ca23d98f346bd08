"""The room of diagnoses, and the comparison of recordings."""

import re

import pytest
from explored import HEALTHY, WORN, send, token
from plant import Plant
from starlette.testclient import TestClient

from swashtwin.diagnosis import load_model
from swashtwin.explorer import Workspace, build_explorer


def test_the_verdict_is_that_of_the_command_with_its_evidence(
    workspace: Workspace, plant: Plant
) -> None:
    client = TestClient(build_explorer(workspace, plant.model), base_url="http://127.0.0.1")
    found = client.get("/api/diagnosis", params={"name": WORN}).json()
    verdict = load_model(plant.model).diagnose(workspace.recording(WORN))
    assert found["verdict"] == verdict.verdict
    assert found["sentence"] == verdict.sentence()
    assert found["model"] == "model.safetensors"
    assert found["checks"]
    assert found["evidence"]


def test_a_model_is_dropped_and_anything_else_refused_by_name(
    client: TestClient, plant: Plant
) -> None:
    headers = {"x-explorer": token(client)}
    assert client.get("/api/diagnosis", params={"name": WORN}).status_code == 422
    refused = client.post("/api/drop?name=mine.safetensors", content=b"nothing", headers=headers)
    assert refused.status_code == 422
    assert "mine.safetensors" in refused.json()["detail"]
    assert client.post("/api/drop?name=x", content=plant.model.read_bytes()).status_code == 403
    answer = client.post(
        "/api/drop?name=mine.safetensors", content=plant.model.read_bytes(), headers=headers
    )
    assert answer.json() == {"model": "mine.safetensors"}
    assert client.get("/api/diagnosis", params={"name": WORN}).json()["verdict"]


@pytest.mark.nightly
def test_the_shipped_prior_is_adapted_to_the_healthy_recordings(client: TestClient) -> None:
    answer = send(client, "/api/prior", {}).json()
    assert re.search(r"adapted to \d+ healthy recordings", answer.get("model", "")), answer
    assert client.get("/api/diagnosis", params={"name": WORN}).json()["kind"] == "prior"


def test_what_differs_most_between_two_classes_is_ranked_in_spreads(client: TestClient) -> None:
    healthy = [HEALTHY, HEALTHY.replace("_1.h5", "_2.h5")]
    worn = [WORN, WORN.replace("_1.h5", "_2.h5")]
    found = client.get("/api/comparison", params={"first": healthy, "second": worn}).json()
    spreads = [abs(row["spreads"]) for row in found["rows"]]
    assert spreads == sorted(spreads, reverse=True)
    assert spreads[0] > 3
    swapped = client.get("/api/comparison", params={"first": worn, "second": healthy}).json()
    assert swapped["rows"][0]["change"] == pytest.approx(-found["rows"][0]["change"])
    assert client.get("/api/comparison", params={"first": healthy, "second": []}).status_code == 422
