"""Joints that are commanded by velocity."""

from __future__ import annotations

import math

import pytest

from tests.sim.devices.stage import Stage
from tests.sim.devices.test_devices import PAN

WINCH = """
[server.Winch.simulated]
device  = "joint"
control = "velocity"
range   = "100 mm .. 300 mm"
speed   = "50 mm/s"
load    = "2 kg"
"""


def state(stage: Stage) -> tuple[object, ...]:
    return tuple(stage.read("Winch", field) for field in ("position", "velocity", "moving"))


def run(stage: Stage, velocity: float) -> None:
    stage.devices[0]["Winch"].command("run", {"velocity": velocity}, stage.world.elapsed_ns)


def test_a_joint_runs_until_it_is_stopped_or_at_an_end() -> None:
    stage = Stage(WINCH)
    assert state(stage) == (100.0, 0.0, False)
    run(stage, 20.0)
    assert state(stage) == (100.0, 20.0, True)
    stage.advance(2.0)
    assert state(stage) == (pytest.approx(140.0), 20.0, True)
    run(stage, 0.0)
    stage.advance(1.0)
    assert state(stage) == (pytest.approx(140.0), 0.0, False)
    run(stage, -30.0)
    stage.advance(1.0)
    assert state(stage) == (pytest.approx(110.0), -30.0, True)
    stage.advance(1.0)
    assert state(stage) == (100.0, 0.0, False)
    run(stage, -30.0)
    assert state(stage) == (100.0, 0.0, False)


def test_end_switches_are_pressed_at_the_ends() -> None:
    stage = Stage(WINCH)

    def switches() -> tuple[object, ...]:
        return tuple(stage.read("Winch", field) for field in ("lower_end", "upper_end"))

    assert switches() == (True, False)
    run(stage, 50.0)
    stage.advance(1.0)
    assert switches() == (False, False)
    stage.advance(4.0)
    assert switches() == (False, True)


@pytest.mark.parametrize("velocity", [1000.0, math.inf])
def test_a_joint_runs_at_most_at_its_speed(velocity: float) -> None:
    stage = Stage(WINCH)
    run(stage, velocity)
    stage.advance(1.0)
    assert state(stage) == (pytest.approx(150.0), 50.0, True)
    stage.advance(10.0)
    assert state(stage) == (300.0, 0.0, False)
    run(stage, -velocity)
    stage.advance(1.0)
    assert state(stage) == (pytest.approx(250.0), -50.0, True)


def test_a_command_that_is_repeated_in_every_frame_changes_nothing() -> None:
    often, once = Stage(WINCH), Stage(WINCH)
    run(once, 40.0)
    for _ in range(60):
        run(often, 40.0)
        often.advance(0.05)
        once.advance(0.05)
    assert state(often) == pytest.approx(state(once))


def test_a_joint_that_is_made_safe_stops() -> None:
    stage = Stage(WINCH)
    run(stage, 50.0)
    stage.advance(1.0)
    stage.devices[0]["Winch"].safe(stage.world.elapsed_ns)
    stage.advance(1.0)
    assert state(stage) == (pytest.approx(150.0), 0.0, False)


def test_a_joint_takes_the_commands_of_its_control_alone() -> None:
    with pytest.raises(ValueError, match="no command `move`; it has `run`"):
        Stage(WINCH).devices[0]["Winch"].command("move", {"position": 1.0}, 0)
    assert Stage(WINCH).read("Winch", "load") == Stage(WINCH.replace('"velocity"', '"position"')).read(
        "Winch", "load"
    )
    with pytest.raises(ValueError, match="no command `run`; it has `move`"):
        Stage(PAN).devices[0]["Pan"].command("run", {"velocity": 1.0}, 0)
