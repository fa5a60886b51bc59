"""CTracker among the real servers in virtual time: robot, cameras and ceiling are simulated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
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
from colony.runtime.assembly.virtual import Session
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.library import data, robot
from colony.runtime.servers.cserver import CServer
from colony.runtime.servers.images import Image
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.hazards.scenery import CeilingLight, bare
from colony.sim.world.world import World
from colony.vision.lights.looks import camera_child
from colony.vision.lights.tracker import light_tracker, parent

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
FRAME_NS = 50_000_000
BELIEVED_MM = 150.0


class Camera:
    """The driver of a camera that looks up. Mutable: how many images it gave."""

    def __init__(self, plant: Plant, ceiling: CeilingCamera) -> None:
        self._plant, self._ceiling = plant, ceiling

    def grab(self) -> Image:
        now = self._plant.catch_up()
        image = self._ceiling.image(self._plant.world.true_pose(0), now)
        height, width = image.shape
        return Image(t_ns=now, height=height, width=width, channels=1, pixels=image.tobytes())


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


@pytest.mark.parametrize("children", [False, True], ids=["one script", "child and parent"])
@pytest.mark.parametrize("order", [1, 2])
def test_it_counts_and_corrects_among_real_servers(order: int, children: bool) -> None:
    scenery = replace(
        bare(WALLS, seed=7), lights=tuple(CeilingLight(x_mm=x, y_mm=0.0, heading_deg=EAST) for x in PLACES)
    )
    world, clock = World(walls=scenery, poses=[(0.0, 0.0, EAST)], seed=7), VirtualClock()
    plant = Plant(world, lambda: clock() // FRAME_NS * FRAME_NS)
    log: list[tuple[float, int, float]] = []
    trackers = (
        {"child": camera_child("CServerUp"), "parent": parent()} if children else {"t": light_tracker()}
    )
    scripts = [
        ScriptNode(name, script, ("DServer", "RServer", "CServerUp"), delay_ns=1)
        for name, script in {**trackers, "estimator": estimator(), "planner": lead(world, log)}.items()
    ]
    program = load_text(PROGRAM)
    session = Session(
        program,
        compile_program(program).clients,
        simulated_drivers(plant),
        clock=clock,
        seed=7,
        order_seed=order,
        nodes=(CServer(Camera(plant, CeilingCamera(scenery)), keep=40, address="CServerUp"), *scripts),
    )
    session.run(22 * 1_000_000_000)
    assert [script.problem for script in scripts] == [None] * len(scripts)
    assert [passed for _, passed, _ in log] == [1, 2, -1]
    for (at, _, off), place in zip(log, PLACES, strict=False):
        assert place - 25.0 <= at <= place + 60.0
        assert abs(off) < 25.0
    assert log[-1][0] == pytest.approx(log[1][0] - PLACES[1], abs=30.0)
