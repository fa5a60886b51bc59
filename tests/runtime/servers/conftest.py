"""DServer with one connection, unless a test brings its own."""

from __future__ import annotations

import pytest

from tests.runtime.servers.data_stage import Connection, DataStage


@pytest.fixture
def stage() -> DataStage:
    return DataStage()


@pytest.fixture
def ada(stage: DataStage) -> Connection:
    return stage.connect()
