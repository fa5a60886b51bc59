"""What most tests of arbitration begin with."""

from __future__ import annotations

import pytest

from colony.runtime.arbitration.arbiter import Arbiter
from colony.runtime.arbitration.outside import LockQueue
from tests.runtime.arbitration.drive import arbiter


@pytest.fixture
def one() -> Arbiter:
    return arbiter()


@pytest.fixture
def lock() -> LockQueue:
    return LockQueue()
