"""CTracker among the real servers in virtual time: robot, cameras and ceiling are simulated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.walls import Walls
from colony.nav.pose.estimate import pose_estimator
from colony.nav.pose.tracker import Source
from colony.nav.shared import (
    CEILING_LIGHT,
    END_L_MODE,
    GOAL_DIRECTION,
    GOAL_DISTANCE,
    LIGHT_DETECTED,
    LIGHT_OFFSET,
    OVERSHOOT,
    TRACK_DATA,
)
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.library import data, robot
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.drivers import image_of
from colony.sim.hazards.scenery import CeilingLight, bare_scenery
from colony.sim.world.world import World
from colony.vision.lights.tracker import light_tracker
from tests.among_servers import run_among_servers

PROGRAM = """
robot tester {
  frame    50 ms
  sensor   front_bumper : bool    from RServer.front_bumper     within 300 ms
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive       idle drive(velocity = 0, turn = 0)
}
module go { when not front_bumper  do drive(velocity = 400 mm/s, turn = 0 deg/s) }
network { drive = go }
"""

EAST = 270.0
PLACES = (1800.0, 7000.0)
WALLS = np.array(
    [(-3e3, -2e3, 3e4, -2e3), (3e4, -2e3, 3e4, 2e3), (3e4, 2e3, -3e3, 2e3), (-3e3, 2e3, -3e3, -2e3)]
)
BELIEVED_MM = 150.0


def lead(world: World, log: list[tuple[float, int, float]]) -> Script:
    """Gives one goal, by a position that is off, and notes where the robot is at each light, and by how much
    the position is off soon after; at last the overshoot."""
    for name in (TRACK_DATA, END_L_MODE, LIGHT_DETECTED):
        yield from do("DServer", data.create_semaphore(name, 0))
    yield from do("RServer", robot.adjust_position(BELIEVED_MM, 0.0, 0.0))
    here = yield from do("RServer", robot.position())
    offsets = [PLACES[0] - here.x, PLACES[1] - PLACES[0]]
    goal = {GOAL_DISTANCE: 2, GOAL_DIRECTION: EAST, LIGHT_OFFSET: offsets}
    yield from do("DServer", data.set_many(goal))
    yield from do("DServer", data.signal(TRACK_DATA))
    for _ in PLACES:
        yield from do("DServer", data.wait(LIGHT_DETECTED))
        passed = yield from do("DServer", data.get(CEILING_LIGHT, type=int))
        at_mm = world.true_pose(0).x_mm
        yield from sleep(0.3)
        here = yield from do("RServer", robot.position())
        log.append((at_mm, passed, here.x - world.true_pose(0).x_mm))
    yield from do("DServer", data.wait(END_L_MODE))
    overshoot = yield from do("DServer", data.get(OVERSHOOT, type=float))
    log.append((overshoot, -1, 0.0))


def estimator() -> Script:
    """Corrects the position by the lights alone."""
    walls = Walls(segments=WALLS, kinds=(EdgeKind.WALL,) * len(WALLS), attributes=("",) * len(WALLS))
    return pose_estimator({"": walls}, sources=frozenset({Source.LIGHTS}))


@pytest.mark.parametrize("order", [1, 2])
def test_it_counts_and_corrects_among_real_servers(order: int) -> None:
    scenery = replace(
        bare_scenery(WALLS, seed=7),
        lights=tuple(CeilingLight(x_mm=x, y_mm=0.0, heading_deg=EAST) for x in PLACES),
    )
    world, ceiling = World(walls=scenery, poses=[(0.0, 0.0, EAST)], seed=7), CeilingCamera(scenery)
    log: list[tuple[float, int, float]] = []
    run_among_servers(
        PROGRAM,
        world,
        {"tracker": light_tracker(), "estimator": estimator(), "planner": lead(world, log)},
        run_ns=22 * 1_000_000_000,
        seed=7,
        order=order,
        cameras={"CServerUp": lambda now: image_of(ceiling.image(world.true_pose(0), now), now)},
    )
    assert [passed for _, passed, _ in log] == [1, 2, -1]
    for (at, _, off), place in zip(log, PLACES, strict=False):
        assert place - 25.0 <= at <= place + 60.0
        assert abs(off) < 25.0
    assert log[-1][0] == pytest.approx(log[1][0] - PLACES[1], abs=30.0)
