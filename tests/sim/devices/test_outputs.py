"""Lamps, horns and valves of simulated robots."""

from __future__ import annotations

import math

import pytest

from tests.sim.devices.stage import Stage

OUTPUTS = """
[server.Signals.simulated]
device  = "output"
outputs = { horn = "on", lamp = "level", valve = "on" }
"""


def state(stage: Stage) -> tuple[object, ...]:
    return tuple(stage.read("Signals", field) for field in ("horn", "lamp", "valve"))


def test_outputs_read_back_what_they_are_set_to() -> None:
    stage = Stage(OUTPUTS)
    signals = stage.devices[0]["Signals"]
    assert state(stage) == (False, 0.0, False)
    signals.command("set", {"horn": True, "lamp": 0.25, "valve": False}, 0)
    assert state(stage) == (True, 0.25, False)
    stage.advance(1.0)
    assert state(stage) == (True, 0.25, False)
    signals.command("set", {"valve": True}, 0)
    assert state(stage) == (False, 0.0, True)


@pytest.mark.parametrize(("level", "held"), [(-1.0, 0.0), (2.0, 1.0), (math.inf, 1.0), (1.0, 1.0)])
def test_levels_are_from_0_to_1(level: float, held: float) -> None:
    stage = Stage(OUTPUTS)
    stage.devices[0]["Signals"].command("set", {"lamp": level}, 0)
    assert state(stage) == (False, held, False)


def test_what_is_made_safe_is_off() -> None:
    stage = Stage(OUTPUTS)
    signals = stage.devices[0]["Signals"]
    signals.command("set", {"horn": True, "lamp": 1.0, "valve": True}, 0)
    signals.safe(0)
    assert state(stage) == (False, 0.0, False)
    signals.command("set", {"horn": True}, 0)
    assert state(stage) == (True, 0.0, False)


def test_the_outputs_of_one_robot_are_not_those_of_another() -> None:
    stage = Stage(OUTPUTS, poses=[(0.0, 0.0, 0.0), (2000.0, 0.0, 0.0)])
    stage.devices[1]["Signals"].command("set", {"horn": True}, 0)
    assert stage.read("Signals", "horn") is False
    assert stage.read("Signals", "horn", robot=1) is True


def test_commands_that_outputs_do_not_have_are_refused() -> None:
    stage = Stage(OUTPUTS)
    with pytest.raises(ValueError, match="no command `run`; they have `set`"):
        stage.devices[0]["Signals"].command("run", {}, 0)
    with pytest.raises(ValueError, match="no output `siren`; there are horn, lamp, valve"):
        stage.devices[0]["Signals"].command("set", {"horn": True, "siren": True}, 0)
    assert state(stage) == (False, 0.0, False)
