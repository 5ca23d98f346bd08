"""Requests generated from the page's OpenAPI description.

None ends in an error of the server, and the answers are as described.
"""

from typing import Any

import pytest
from fastapi import FastAPI
from hypothesis import HealthCheck, given, settings

schemathesis = pytest.importorskip("schemathesis", reason="schemathesis is not installed")

pytestmark = pytest.mark.nightly
# The page refuses requests under a name that is not its own.
HOST = {"host": "127.0.0.1"}
MIN_OPERATIONS = 13


def test_every_address_answers_generated_requests_as_described(application: FastAPI) -> None:
    schema = schemathesis.openapi.from_asgi("/api/openapi.json", application, headers=HOST)
    operations = [result.ok() for result in schema.get_all_operations()]
    # A description that lost its addresses would pass all that follows.
    assert len(operations) >= MIN_OPERATIONS

    def check(case: Any) -> None:
        answer = case.call(headers=HOST)
        # Most generated requests are invalid, and refused with a code below 500.
        assert answer.status_code < 500, answer.text
        if answer.status_code < 300:
            case.validate_response(answer, checks=[schemathesis.checks.response_schema_conformance])

    few_examples = settings(
        max_examples=25,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    for operation in operations:
        generated_requests = given(case=operation.as_strategy())
        few_examples(generated_requests(check))()
