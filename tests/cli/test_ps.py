"""What `colony ps` says of limits that hold without a program."""

from __future__ import annotations

import pytest

from colony.cli.ps import _resident
from colony.runtime.arbitration.motion import STILL
from colony.runtime.kit.robot_state import RobotState
from colony.runtime.library.clock import Participants
from colony.runtime.library.robot import BaseArbitration
from colony.runtime.protocol.deployment import LIMITS_RUN


@pytest.mark.parametrize(
    ("leader", "expected"),
    [
        ("limits", ", but the limits of rome hold"),
        (None, ", but the limits of rome hold; NOT at RServer, so nothing is commanded there"),
    ],
)
def test_a_server_that_the_limits_have_not_reached_is_named(leader: str | None, expected: str) -> None:
    participants = Participants(
        k=1,
        t_ns=0,
        start=0,
        frame_ns=1,
        run=LIMITS_RUN,
        program="rome",
        leader="limits",
        begun=True,
        restarts=0,
        servers=(),
        clients=(),
    )
    arbitration = BaseArbitration(
        run="",
        leader=leader,
        acting=None,
        actuators=(),
        outside=(),
        lock_holder=None,
        lock_waiting=(),
        stopped=None,
        sent=STILL,
        low=STILL,
        high=STILL,
    )
    state = RobotState(robot="rome", servers=(), run=None, arbitration=arbitration, participants=participants)
    assert _resident(state, participants) == expected
