"""The client that most tests are about."""

from __future__ import annotations

import pytest

from colony.runtime.clients.client import ClientNode
from tests.runtime.clients.test_client import back_off


@pytest.fixture
def node() -> ClientNode:
    return back_off()
