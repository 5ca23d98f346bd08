"""The machine that is watched."""

import pytest
from small_machine import Machine


@pytest.fixture(scope="session")
def machine() -> Machine:
    """The machine."""
    return Machine()
