"""The recordings that the explorer's tests look at, and how its script sends what it changes."""

import re

from httpx import Response
from starlette.testclient import TestClient

HEALTHY = "recordings/A_normal_15MPa_1.h5"
WORN = "recordings/A_swash_plate_15MPa_1.h5"


def token(client: TestClient) -> str:
    """What the page's script sends with each change."""
    match = re.search(r'name="token" content="([\w-]+)"', client.get("/").text)
    assert match
    return match[1]


def send(client: TestClient, path: str, content: object) -> Response:
    """Answer to a change, sent with the page's token."""
    return client.post(path, json=content, headers={"x-explorer": token(client)})
