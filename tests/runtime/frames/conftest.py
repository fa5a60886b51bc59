"""A Clock without a program, unless a test brings its own."""

from __future__ import annotations

import pytest

from tests.kit.clock import Stage


@pytest.fixture
def stage() -> Stage:
    return Stage()
