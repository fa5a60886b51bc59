"""Connections that never finish their handshake are closed, and harm no session that stands."""

from __future__ import annotations

import pytest

from colony.runtime.transport.live.gateway import whoami
from colony.runtime.transport.live.run_directory import UnreachableError
from tests.sampling import long
from tests.waiting import until
from tools.attack.handshakes import HalfOpen
from tools.attack.lab import Lab

COUNT = 20


@pytest.mark.parametrize("hello", [True, long(False)], ids=["stalled", "silent"])
def test_half_open_connections_are_closed(hello: bool, lab: Lab) -> None:
    with lab.session("ada") as ada, ada.connect("Gateway") as gateway:
        with HalfOpen(lab.port, count=COUNT, rate=0, hello=hello) as half:
            assert half.standing() > 0
            asked = 0
            while half.standing():
                assert gateway.do(whoami()).user == "ada", "a session that stands goes on"
                asked += 1
            assert asked > 0
        until(lambda: _logs_in(lab), "the door is open again")


def _logs_in(lab: Lab) -> bool:
    try:
        lab.session("guard").close()
    except UnreachableError:
        return False
    return True
