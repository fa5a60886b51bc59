"""A plan to another floor, driven by the compiled Navigator into a simulated elevator and out of it again."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from colony.nav.maps.building import Building
from colony.nav.maps.signs import markers_of
from colony.nav.maps.stickrep.model import Map
from colony.nav.missions.clerk import clerk
from colony.nav.plan.plan import Plan
from colony.nav.plan.planner import planner
from colony.nav.plan.route import plan
from colony.nav.shared import GoalKind
from colony.runs.behavior import behavior_of
from colony.runtime.kit.script import Script, do
from colony.runtime.library import robot
from colony.runtime.protocol.images import Shot
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.scene import scene_of
from colony.sim.hazards.hazards import Hazards
from colony.sim.hazards.scenery import Scenery
from colony.sim.shots import CeilingShot, LevelShot
from colony.sim.world.elevators import CABIN_DEPTH_MM, cabin_of
from colony.sim.world.operator import operator
from colony.sim.world.site import SimulatedSite
from colony.vision.lights.tracker import light_tracker
from colony.vision.markers.finder import marker_finder
from tests.experiment.loops import loop_of
from tests.nav.floors import two_floors
from tests.paths import ROOT
from tests.sampling import long
from tests.sim.robots import FRONT_CAMERA

NAVIGATOR = ROOT / "behaviors" / "navigator.colony"


class Ride:
    """The building, the robot, and an operator who presses the buttons. Mutable: all of it.

    Args:
        aside_mm: how far east of where it is the robot believes to be.
        eyes: whether it has a camera ahead, and looks for the marker on the doors.
    """

    def __init__(
        self, building: Building, planned: Plan, seed: int, *, aside_mm: float = 0.0, eyes: bool = False
    ) -> None:
        self.begun: list[GoalKind] = []
        self.deepest = 0.0
        self.in_doors: list[float] = []  # how far from their middle
        self.site = SimulatedSite(building, planned.floors, Hazards.none(), poses=[planned.start], seed=seed)
        self._cabins = {floor.name: cabin_of(floor, "liftL") for floor in building.maps}
        world = self.site.world
        above = self.site.ceiling
        sight: dict[str, Callable[[int], Shot]] = {
            "CServerUp": lambda now_ns: CeilingShot(above(), world, 0, now_ns)
        }
        scripts = {
            "misleader": _mislead(aside_mm),
            "clerk": clerk(),
            "tracker": light_tracker(),
            "planner": planner(planned, on_segment=lambda _, segment: self.begun.append(segment.kind)),
            "operator": operator(self.site.elevators, seed=seed),
        }
        if eyes:
            ahead = self.site.camera_per_floor(_camera_ahead)
            sight["CServerFront"] = lambda now_ns: LevelShot(ahead(), world, 0, now_ns)
            scripts["markers"] = marker_finder({floor.name: markers_of(floor) for floor in building.maps})
        self.loop = loop_of(
            behavior_of(NAVIGATOR),
            world,
            scripts,
            cameras=sight,
            seed=seed,
            moving=[self.site.elevators.advance],
        )

    def run(self, seconds: float) -> None:
        """Until the Planner has ended, or for so long."""
        while not self.loop.scripts.has_ended("planner") and self.loop.now_ns < seconds * 1e9:
            self.loop.frame()
            pose, cabin = self.site.world.true_pose(0), self._cabins[self.site.floor]
            along, deep = cabin.coordinates(pose.x_mm, pose.y_mm)
            self.deepest = max(self.deepest, deep)
            if abs(deep) < 100.0:
                self.in_doors.append(along)
        self.loop.close()


def _mislead(aside_mm: float) -> Script:
    yield from do("RServer", robot.adjust_position(aside_mm, 0.0, 0.0))


def _camera_ahead(floor: Map, scenery: Scenery) -> Camera:
    return Camera(scene_of(floor, scenery), FRONT_CAMERA, robot_radius_mm=400.0, seed=1)


def test_the_robot_rides_to_another_floor_and_goes_on_there(tmp_path: Path) -> None:
    here = two_floors(tmp_path)
    planned = plan(here, "A", "upper:C")
    ride = Ride(here, planned, seed=3)
    ride.run(200.0)
    assert "".join(chr(kind) for kind in ride.begun) == "DVD"
    assert ride.site.floor == "upper"
    assert ride.deepest == pytest.approx(CABIN_DEPTH_MM / 2, abs=100.0)
    goal, pose = planned.segments[-1].end, ride.site.world.true_pose(0)
    assert math.hypot(pose.x_mm - goal.x_mm, pose.y_mm - goal.y_mm) < 300.0


@pytest.mark.parametrize(("seed", "aside_mm"), [(1, 350.0), long(2, -350.0)])
def test_a_robot_that_is_aside_of_the_doors_goes_in_by_their_marker(
    seed: int, aside_mm: float, tmp_path: Path
) -> None:
    here = two_floors(tmp_path)
    ride = Ride(here, plan(here, "A", "upper:C"), seed, aside_mm=aside_mm, eyes=True)
    ride.run(200.0)
    assert ride.site.floor == "upper"
    assert ride.site.world.bumps(0) == 0
    assert max(map(abs, ride.in_doors)) < 100.0  # there are 150 mm on each side


def test_without_the_marker_it_does_not_get_in_from_there(tmp_path: Path) -> None:
    here = two_floors(tmp_path)
    ride = Ride(here, plan(here, "A", "upper:C"), 1, aside_mm=350.0)
    ride.run(80.0)
    assert ride.begun[-1] is GoalKind.ELEVATOR
    assert ride.in_doors == []
