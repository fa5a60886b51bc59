"""The state of a robot as seen from outside."""

from __future__ import annotations

from itertools import chain, repeat

import pytest

from colony.runtime.kit import robot_state
from colony.runtime.kit.robot_state import ServerState, present_nodes, watched_by_clock
from colony.runtime.library.clock import Participants, ServerParticipant


def test_servers_to_which_the_links_take_long_are_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_state, "PRESENCE_INTERVAL_S", 0.0)
    looks = chain([(), ("Clock",), ("Clock", "DServer", "drive/cruise")], repeat(()))
    assert present_nodes(lambda: next(looks), {"Clock", "DServer"}) == {"Clock", "DServer", "drive/cruise"}


def test_but_not_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_state, "PRESENCE_TIMEOUT_S", 0.0)
    assert present_nodes(lambda: ("Clock",), {"Clock", "DServer"}) == {"Clock"}


def test_a_server_without_an_answer_at_the_clock_is_unheard_or_down() -> None:
    states = {name: ServerState(server=name, state="up", process=7) for name in ("RServer", "Lidar", "Busy")}
    states["Busy"] = ServerState(server="Busy", state="silent", process=7)
    watched = {"RServer": True, "Lidar": False, "Busy": False, "Gone": False, "DServer/activity/m": False}
    known = Participants(
        k=1,
        t_ns=0,
        start=0,
        frame_ns=1,
        run="",
        program="",
        leader=None,
        begun=False,
        restarts=0,
        servers=tuple(ServerParticipant(server=name, up=up) for name, up in watched.items()),
        clients=(),
    )
    found = {state.server: state for state in watched_by_clock(states, known, {"Gone": 8})}
    assert {name: state.state for name, state in found.items()} == {"Lidar": "unheard", "Gone": "down"}
    assert found["Lidar"].problem == "the Clock does not hear it"
    assert found["Gone"].process == 8
