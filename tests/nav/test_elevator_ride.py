"""A plan to another floor, driven by the compiled Navigator into a simulated elevator and out of it again."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from colony.experiment.behavior import behavior_of
from colony.experiment.local_cameras import CeilingShot, LocalCamera
from colony.experiment.loop import Loop
from colony.nav.building import Building, load_building
from colony.nav.clerk import clerk
from colony.nav.plan import Plan
from colony.nav.planner import planner
from colony.nav.route import plan
from colony.nav.shared import GoalKind
from colony.sim.ceiling import CeilingCamera
from colony.sim.elevators import CABIN_DEPTH_MM, Elevators, cabin_of
from colony.sim.hazards import Hazards, draw
from colony.sim.world import World
from colony.vision.light_tracker import light_tracker

NAVIGATOR = Path(__file__).resolve().parents[2] / "behaviors" / "navigator.colony"
FRAME_S = 0.05
FLOOR = """stickrep 1
map    {name}
floor  {floor}
unit   m
start  1 1 270
ring outline 0 0 0
-270 A      W 0 {width}
-270 B      W 0 {length}
-270 C      W 0 {width}
-270 D      W 0 {rest}
 180 liftL  E 0 1.1
 180 liftR  W 0 5
elevator liftL {other}.stickrep liftL
"""


def building(folder: Path) -> Building:
    """Two corridors from west to east, the one above wider, with an elevator in the south wall of each."""
    floors = (("ground", 1, 2.2, 11.0, "upper"), ("upper", 2, 3.0, 13.0, "ground"))
    for name, floor, width, length, other in floors:
        text = FLOOR.format(
            name=name, floor=floor, width=width, length=length, rest=round(length - 6.1, 1), other=other
        )
        (folder / f"{name}.stickrep").write_text(text)
    return load_building(folder / "ground.stickrep")


class Ride:
    """The building, the robot, and somebody who presses the buttons. Mutable: all of it."""

    def __init__(self, building: Building, planned: Plan) -> None:
        floors = {floor.name: draw(Hazards.none(), floor, 1) for floor in building.maps}
        ceilings = {name: CeilingCamera(scenery) for name, scenery in floors.items()}
        first = planned.segments[0]
        pose = (first.start.x_mm, first.start.y_mm, first.heading_deg)
        self.begun: list[GoalKind] = []
        self.deepest = 0.0
        self.world = World(walls=floors["ground"], poses=[pose], seed=3)
        self.elevators = Elevators(self.world, building, floors, "ground")
        self._cabins = {floor.name: cabin_of(floor, "liftL") for floor in building.maps}

        def shot(now_ns: int) -> CeilingShot:
            return CeilingShot(ceilings[self.elevators.floor], self.world, now_ns)

        scripts = {
            "clerk": clerk(),
            "tracker": light_tracker(),
            "planner": planner(planned, on_segment=lambda _, segment: self.begun.append(segment.kind)),
        }
        camera = LocalCamera("CServerUp", shot)
        self.loop = Loop(behavior_of(NAVIGATOR), self.world, scripts, cameras=[camera], seed=3)

    def run(self, seconds: float) -> None:
        """Until the Planner has ended, or for so long."""
        while not self.loop.scripts.ended("planner") and self.loop.now_ns < seconds * 1e9:
            self.loop.frame()
            self.elevators.advance(FRAME_S)
            self._press_buttons()
        self.loop.close()

    def _press_buttons(self) -> None:
        """Open the doors before a robot that looks at them; take it along when it has turned in the cabin."""
        pose, cabin = self.world.true_pose(0), self._cabins[self.elevators.floor]
        _, deep = cabin.inside(pose.x_mm, pose.y_mm)
        self.deepest = max(self.deepest, deep)
        turned = abs(math.remainder(pose.heading_deg - cabin.heading_deg, 360.0))
        if self.elevators.floor == "upper" or (deep < 0.0 and turned < 3.0):
            self.elevators.open("liftL")
        elif deep > 0.0 and turned > 175.0:
            self.elevators.close("liftL")
            if self.elevators.opening("liftL") == 0.0:
                self.elevators.ride("liftL", "upper")


def test_the_robot_rides_to_another_floor_and_goes_on_there(tmp_path: Path) -> None:
    here = building(tmp_path)
    planned = plan(here, "A", "upper:C")
    ride = Ride(here, planned)
    ride.run(150.0)
    assert "".join(chr(kind) for kind in ride.begun) == "DVD"
    assert ride.elevators.floor == "upper"
    assert ride.deepest == pytest.approx(CABIN_DEPTH_MM / 2, abs=100.0)
    goal, pose = planned.segments[-1].end, ride.world.true_pose(0)
    assert math.hypot(pose.x_mm - goal.x_mm, pose.y_mm - goal.y_mm) < 300.0
