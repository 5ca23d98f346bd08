"""Requests made up from the page's OpenAPI description: none ends in an error of ours, and answers
are as described.
"""

from typing import Any

import pytest
from fastapi import FastAPI
from hypothesis import HealthCheck, given, settings

schemathesis = pytest.importorskip("schemathesis", reason="schemathesis is not installed")

pytestmark = pytest.mark.nightly
HOST = {"host": "127.0.0.1"}


def test_every_address_answers_made_up_requests_as_described(application: FastAPI) -> None:
    schema = schemathesis.openapi.from_asgi("/api/openapi.json", application, headers=HOST)
    operations = [result.ok() for result in schema.get_all_operations()]
    assert len(operations) > 12

    def check(case: Any) -> None:
        answer = case.call(headers=HOST)
        assert answer.status_code < 500, answer.text
        if answer.status_code < 300:
            case.validate_response(answer, checks=[schemathesis.checks.response_schema_conformance])

    for operation in operations:
        made_up = settings(
            max_examples=25, deadline=None, database=None, suppress_health_check=list(HealthCheck)
        )
        made_up(given(case=operation.as_strategy())(check))()
