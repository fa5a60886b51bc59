"""A plan to another floor, driven by the compiled Navigator into a simulated elevator and out of it again."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from colony.experiment.behavior import behavior_of
from colony.experiment.local_cameras import CeilingShot, LocalCamera
from colony.experiment.loop import Loop
from colony.nav.building import load_building
from colony.nav.clerk import clerk
from colony.nav.plan import Place
from colony.nav.planner import planner
from colony.nav.route import plan
from colony.nav.shared import GoalKind
from colony.sim.ceiling import CeilingCamera
from colony.sim.elevators import CABIN_DEPTH_MM, Elevators, cabin_of
from colony.sim.hazards import Hazards, draw
from colony.sim.world import World
from colony.vision.light_tracker import light_tracker

ROOT = Path(__file__).resolve().parents[2]
THIRD, SECOND, NODE = "msu_engineering_3", "msu_engineering_2", "acs.elev.L"
BUILDING = load_building(ROOT / "maps" / f"{THIRD}.stickrep")
CABINS = {floor.name: cabin_of(floor, NODE) for floor in BUILDING.maps}
FRAME_S = 0.05


def press_buttons(world: World, elevators: Elevators, went: list[float]) -> None:
    """Who is there to help: opens the doors, and takes a robot that has turned around in the cabin along."""
    elevators.advance(FRAME_S)
    pose, cabin = world.true_pose(0), CABINS[elevators.floor]
    _, deep = cabin.inside(pose.x_mm, pose.y_mm)
    turned = math.remainder(pose.heading_deg - cabin.heading_deg, 360.0)
    if elevators.floor == SECOND:
        elevators.open(NODE)
    elif -2000.0 < deep < 0.0 and abs(turned) < 3.0:
        elevators.open(NODE)
    elif deep > CABIN_DEPTH_MM / 4 and abs(turned) > 175.0:
        elevators.close(NODE)
        if elevators.opening(NODE) == 0.0:
            went.append(deep)
            elevators.ride(NODE, SECOND)


def test_the_robot_rides_to_the_other_floor_and_finds_the_room_there() -> None:
    planned = plan(BUILDING, "350R", "2:250L")
    floors = {floor.name: draw(Hazards.none(), floor, 1) for floor in BUILDING.maps}
    first = planned.segments[0]
    world = World(walls=floors[THIRD], poses=[(first.start.x_mm, first.start.y_mm, first.heading_deg)], seed=3)
    elevators = Elevators(world, BUILDING, floors, THIRD)
    ceilings = {name: CeilingCamera(scenery) for name, scenery in floors.items()}
    begun: list[GoalKind] = []
    scripts = {
        "clerk": clerk(),
        "tracker": light_tracker(),
        "planner": planner(planned, on_segment=lambda number, segment: begun.append(segment.kind)),
    }
    camera = LocalCamera("CServerUp", lambda now_ns: CeilingShot(ceilings[elevators.floor], world, now_ns))
    loop = Loop(behavior_of(ROOT / "behaviors" / "navigator.colony"), world, scripts, cameras=[camera], seed=3)
    went: list[float] = []
    while not loop.scripts.ended("planner") and loop.now_ns < 300e9:
        loop.frame()
        press_buttons(world, elevators, went)
    assert "".join(chr(kind) for kind in begun) == "LDVLD"
    assert went and went[0] == pytest.approx(CABIN_DEPTH_MM / 2, abs=300.0)
    assert elevators.floor == SECOND
    goal, pose = planned.segments[-1].end, world.true_pose(0)
    assert goal == Place(*goal[:2], SECOND)
    assert math.hypot(pose.x_mm - goal.x_mm, pose.y_mm - goal.y_mm) < 500.0
    loop.close()
