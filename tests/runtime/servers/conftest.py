"""DServer with one connection, unless a test brings its own."""

from __future__ import annotations

import pytest

from tests.kit.data import DataStage
from tests.kit.node_stage import Caller


@pytest.fixture
def stage() -> DataStage:
    return DataStage()


@pytest.fixture
def ada(stage: DataStage) -> Caller:
    return stage.connect()
