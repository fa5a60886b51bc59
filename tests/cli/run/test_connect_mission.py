"""`colony drive --map MAP --from ROOM --to ROOM`: a robot that is served is led, and somebody at the
terminal is asked to press the buttons of elevators."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.nav.shared import FLOOR, FLOOR_REACHED, GOAL_TYPE, GoalKind
from colony.runtime.library import data
from tests.cli.machine import ROBOT, Machine, Started, failed
from tests.nav.floors import two_floors
from tests.paths import ROOT
from tests.waiting import until

NAVIGATOR = str(ROOT / "behaviors" / "navigator.colony")


def served(machine: Machine, ground: str, *options: str) -> Started:
    """A simulated robot in place of a real one."""
    serving = machine.start("serve", "all", "--robot", ROBOT, "--map", ground, *options)
    until(lambda: "DServer" in machine.directory.running(), "the servers are there")
    return serving


def led(machine: Machine, ground: str, *options: str) -> Started:
    way = ("--from", "liftR", "--to", "upper:liftR")
    return machine.start("drive", NAVIGATOR, "--robot", ROBOT, "--map", ground, *way, *options)


@pytest.mark.thorough
def test_the_robot_is_led_to_the_elevator_and_somebody_is_asked_to_press_its_buttons(
    machine: Machine, tmp_path: Path
) -> None:
    two_floors(tmp_path)
    ground = str(tmp_path / "ground.stickrep")
    served(machine, ground, "--camera", "CServerUp=up")
    run = led(machine, ground)
    until(lambda: failed(run) or "No answers can be read here" in run.err, "it is asked for the buttons")
    assert "Press the button of the elevator lift on floor 1, up." in run.err
    with machine.session() as session, session.connect("DServer", name="test") as store:
        told = store.do(data.get_many((FLOOR, FLOOR_REACHED, GOAL_TYPE)))
        assert told == {FLOOR: "ground", FLOOR_REACHED: 1, GOAL_TYPE: GoalKind.ELEVATOR}
        assert run.interrupt() == 130
        assert store.do(data.get(GOAL_TYPE)) == GoalKind.NONE
    assert "from liftR to liftR of upper (dvd): not done after" in run.out
    until(machine.stands, "the robot stands")


@pytest.mark.long
def test_a_robot_without_a_camera_that_looks_up_is_not_sent(machine: Machine, tmp_path: Path) -> None:
    two_floors(tmp_path)
    ground = str(tmp_path / "ground.stickrep")
    served(machine, ground)
    run = led(machine, ground)
    assert run.wait() == 2
    assert "serve it with `--camera CServerUp=up`" in run.err
