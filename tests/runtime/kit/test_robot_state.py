"""The state of a robot as seen from outside."""

from __future__ import annotations

from itertools import chain, repeat

import pytest

from colony.runtime.kit import robot_state
from colony.runtime.kit.robot_state import present_nodes


def test_servers_to_which_the_links_take_long_are_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_state, "PRESENCE_INTERVAL_S", 0.0)
    looks = chain([(), ("Clock",), ("Clock", "DServer", "drive/cruise")], repeat(()))
    assert present_nodes(lambda: next(looks), {"Clock", "DServer"}) == {"Clock", "DServer", "drive/cruise"}


def test_but_not_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_state, "PRESENCE_TIMEOUT_S", 0.0)
    assert present_nodes(lambda: ("Clock",), {"Clock", "DServer"}) == {"Clock"}
