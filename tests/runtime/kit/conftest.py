"""A session with a robot that has a DServer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import pytest

from colony.runtime.kit.connection import Session
from colony.runtime.servers.dserver import DServer
from tests.runtime.transport.live.stage import ROBOT, hosted


@pytest.fixture
def session(environment: Mapping[str, str]) -> Iterator[Session]:
    with hosted(environment, [DServer()]), Session.open(ROBOT, environment=environment) as opened:
        yield opened
