"""The recordings that the explorer's tests look at, and how its script sends what it changes."""

import re
from pathlib import Path

from httpx2 import Response
from starlette.testclient import TestClient

from swashtwin.explorer import Workspace, build_explorer
from swashtwin.foundation import PressureUnit

HEALTHY = "recordings/A_normal_15MPa_1.h5"
WORN = "recordings/A_swash_plate_15MPa_1.h5"

ADDRESS_TOKEN = "token-of-the-address"


def read_workspace(source: Path) -> Workspace:
    """The explorer's view of a source, after every recording was inspected."""
    workspace = Workspace(source)
    # the first request for the table starts the inspection in a thread
    workspace.table(-1)
    if (worker := workspace._worker) is not None:
        worker.join()
    return workspace


def open_explorer(
    workspace: Workspace, model: Path | None = None, pressure_unit: PressureUnit = "MPa"
) -> TestClient:
    """A browser without scripts that was opened with the address of the explorer."""
    explorer = build_explorer(
        workspace, model, address_token=ADDRESS_TOKEN, pressure_unit=pressure_unit
    )
    client = TestClient(explorer, base_url="http://127.0.0.1:8643")
    assert client.get("/", params={"token": ADDRESS_TOKEN}).status_code == 200
    return client


def token(client: TestClient) -> str:
    """What the page's script sends with each change."""
    match = re.search(r'name="token" content="([\w-]+)"', client.get("/").text)
    assert match
    return match[1]


def send(client: TestClient, path: str, content: object) -> Response:
    """Answer to a change, sent with the page's token."""
    return client.post(path, json=content, headers={"x-explorer": token(client)})
