"""A genuine ROS 2 for the tests that want one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.ros2.ros import Ros


@pytest.fixture
def ros(tmp_path: Path) -> Iterator[Ros]:
    found = None
    try:
        found = Ros(tmp_path)
        yield found
    finally:
        if found is not None:
            found.close()
