"""Planner and clerk among the real servers in virtual time, with a small network as Navigator."""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import Any

import pytest

from colony.nav.missions.clerk import clerk
from colony.nav.plan.plan import FloorPoint, Plan
from colony.nav.plan.planner import Progress, planner
from colony.nav.shared import (
    CEILING_LIGHT,
    END_L_MODE,
    LIGHT_OFFSET,
    OVERSHOOT,
    TRACK_DATA,
    GoalKind,
)
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data, robot
from colony.sim.world.world import World
from tests.among_servers import run_among_servers
from tests.nav.plan.test_planner import by_overshoot, segment

# Turns to the goal's direction, and drives on until the distance is covered, or the lights are counted.
NAVIGATOR = """
robot tester {
  frame    50 ms
  sensor   x : mm                     from RServer.x                within 300 ms
  sensor   y : mm                     from RServer.y                within 300 ms
  sensor   heading : deg              range 0 .. 360 from RServer.heading within 300 ms
  sensor   kind : number    default 0 from DServer.GoalType
  sensor   direction : deg  range -360 .. 360 from DServer.GoalDirection
  sensor   distance : mm    range 0 .. 1000000 from DServer.GoalDistance
  sensor   given : number   default 0 from DServer.GoalNumber
  sensor   lights : number  range 0 .. 1000000 default 0 from DServer.CeilingLight
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive idle drive(velocity = 0, turn = 0)
  actuator report { number : number } to DServer.GoalReached idle hold
}
let off = angle_difference(direction, heading)
let gone = (y - captured(y, given)) * cos(direction) - (x - captured(x, given)) * sin(direction)
let there = if kind == 76 then lights >= distance / 1 mm else gone >= distance - 30 mm
let wanted = given > 0 and kind > 0 and fresh(distance)
module ahead { when wanted and not there  do drive(velocity = 400 mm/s, turn = 0) }
let rate = clamp(2 s^-1 * off, -60 deg/s, 60 deg/s)
module aside { when wanted and abs(off) > 2 deg  do drive(velocity = 0, turn = rate) }
module reached { when wanted and there and abs(off) <= 2 deg  do report(number = given) }
network {
  drive  = aside suppresses ahead
  report = reached
}
"""


def tracker() -> Script:
    """In place of CTracker: knows the position, and counts the lights that are behind it."""
    for name in (TRACK_DATA, END_L_MODE):
        yield from do("DServer", data.create_semaphore(name, 0))
    while True:
        yield from do("DServer", data.wait(TRACK_DATA))
        yield from do("DServer", data.set(CEILING_LIGHT, 0))
        yield from _count((yield from do("DServer", data.get(LIGHT_OFFSET))))
        yield from do("DServer", data.signal(END_L_MODE))


def _count(offsets: list[float]) -> Generator[Step, Any, None]:
    start = yield from do("RServer", robot.position())
    passed = 0
    while passed < len(offsets):
        yield from sleep(0.05)
        here = yield from do("RServer", robot.position())
        gone = math.hypot(here.x - start.x, here.y - start.y)
        if gone >= sum(offsets[: passed + 1]):
            passed += 1
            yield from do("DServer", data.set(OVERSHOOT, gone - sum(offsets[:passed])))
            yield from do("DServer", data.set(CEILING_LIGHT, passed))


A, B, C, D, E, F = (
    FloorPoint(x, y, "f") for x, y in ((0, 0), (0, 3e3), (0, 4e3), (-1e3, 4e3), (-3e3, 4e3), (-5e3, 4e3))
)
PLAN = Plan(
    origin="a",
    goal="b",
    segments=(
        segment(GoalKind.LIGHTS, 0.0, A, B, 1000.0, 2000.0, 3000.0),
        segment(GoalKind.ENTER_CORNER, 0.0, B, C),
        segment(GoalKind.CORNER, 90.0, C, D),
        # Fewer lights than were counted on the leg before: these must not be taken for the new ones.
        segment(GoalKind.LIGHTS, 90.0, D, E, 1000.0, 2000.0),
        segment(GoalKind.DEAD_RECKONING, 90.0, E, F),
    ),
    distance_mm=9000.0,
    modes="lcld",
)


@pytest.mark.parametrize(("progress", "order"), [(None, 1), (by_overshoot, 2)])
def test_a_plan_is_driven_to_its_end(progress: Progress | None, order: int) -> None:
    begun: list[int] = []
    world = World(walls=[], poses=[(0.0, 0.0, 0.0)], seed=order)
    scripts = {
        "clerk": clerk(),
        "tracker": tracker(),
        "planner": planner(PLAN, progress=progress, on_segment=lambda number, _: begun.append(number)),
    }
    nodes = run_among_servers(NAVIGATOR, world, scripts, run_ns=45_000_000_000, order=order)
    assert [node.ended for node in nodes] == [False, False, True]
    assert begun == [0, 1, 2, 3, 4]
    pose = world.true_pose(0)
    assert pose.x_mm == pytest.approx(F.x_mm, abs=300.0)
    assert pose.y_mm == pytest.approx(F.y_mm, abs=800.0)  # nobody keeps this robot in the middle
