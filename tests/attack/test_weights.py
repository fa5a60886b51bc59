"""No message, whatever its size, keeps a server from answering or from stopping."""

from __future__ import annotations

import pytest

from colony.runtime.kit.emergency import StopButton
from colony.runtime.transport.live.network import local_user
from tests.waiting import until
from tools.attack.lab import Lab
from tools.attack.weights import SERVERS, bear, weights


@pytest.mark.long
def test_whatever_comes_is_answered_and_a_stop_behind_it(lab: Lab) -> None:
    pids = dict(lab.machine.directory.running())
    with lab.machine.session() as home, StopButton(home, timeout_s=60.0) as button:
        until(lambda: {*SERVERS} <= set(home.servers()), "the servers are there")
        borne = [bear(home, weight, button) for weight in weights(local_user())]
    assert {one.weight.server for one in borne} == set(SERVERS)
    assert len(borne) > 40
    assert dict(lab.machine.directory.running()) == pids, "nobody died of it"
