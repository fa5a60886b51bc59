"""The marker finder beside a simulated robot, its servers and its camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from colony.nav.maps.signs import Marker, markers_of
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.pose.pose import fix_of
from colony.nav.shared import (
    ELEVATOR_CALL,
    FLOOR,
    GOAL_DIRECTION,
    GOAL_TYPE,
    MARKER_BEARING,
    MARKER_DISTANCE,
    MARKER_FACING,
    MARKER_FIX,
    GoalKind,
)
from colony.runtime.assembly.loop import LocalCamera, LocalServer
from colony.runtime.kit.script import ScriptError
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.servers.base import Base
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.scene import scene_of
from colony.sim.drivers import Plant, SimulatedBase, SimulatedCamera
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.shots import LevelShot
from colony.sim.world.world import World
from colony.vision.level_camera import AHEAD, LevelCamera
from colony.vision.markers.finder import marker_finder
from tests.kit.script_stage import FRAME_NS, ScriptStage
from tests.paths import MAPS
from tests.sim.robots import FRONT_CAMERA

NAME = "msu_engineering_3"
MAP = load_map(MAPS / f"{NAME}.stickrep")
MARKERS = markers_of(MAP)


class Stand(ScriptStage):
    """A robot before the first marker of the map. Mutable: the world, the time, DServer's variables.

    Args:
        variables: set at first.
        ahead_mm, aside_mm, turned_deg: how far before it, to the left of its middle, turned to the left.
        camera: whether there is one.
        markers, geometry: what the finder knows of the map and of the camera.
    """

    def __init__(
        self,
        variables: Mapping[str, Any],
        *,
        ahead_mm: float = 1_100.0,
        aside_mm: float = 0.0,
        turned_deg: float = 0.0,
        camera: bool = True,
        markers: Mapping[str, tuple[Marker, ...]] | None = None,
        geometry: LevelCamera = AHEAD,
    ) -> None:
        scenery, heading = draw(Hazards.none(), MAP, seed=1), math.radians(MARKERS[0].heading_deg)
        x = MARKERS[0].center.x + ahead_mm * math.sin(heading) - aside_mm * math.cos(heading)
        y = MARKERS[0].center.y - ahead_mm * math.cos(heading) - aside_mm * math.sin(heading)
        self.world = World(walls=scenery, poses=[(x, y, MARKERS[0].heading_deg + turned_deg)], seed=1)
        eye = Camera(scene_of(MAP, scenery), FRONT_CAMERA, robot_radius_mm=400.0, seed=1)
        self._plant = Plant(self.world, lambda: self.now_ns)
        base = LocalServer("RServer", Base(SimulatedBase(self._plant, 0)).methods)
        front = SimulatedCamera(self._plant, lambda now_ns: LevelShot(eye, self.world, 0, now_ns))
        shutter = LocalCamera("CServerFront", front)
        known = {NAME: MARKERS} if markers is None else markers
        finder = marker_finder(known, geometry=geometry)
        super().__init__({"markers": finder}, base, cameras=[shutter] if camera else [])
        for name, value in variables.items():
            self.tell(name, value)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / FRAME_NS)):
            self.settle()
            self.now_ns += FRAME_NS
            self._plant.catch_up()


RIDE = {GOAL_TYPE: int(GoalKind.ELEVATOR), GOAL_DIRECTION: MARKERS[0].heading_deg}
EVERYTHING = (MARKER_BEARING, MARKER_FACING, MARKER_DISTANCE, MARKER_FIX)
CALL = [MARKERS[0].node, NAME, "msu_engineering_2"]


def test_it_tells_where_the_marker_is() -> None:
    stand = Stand(RIDE, aside_mm=80.0, turned_deg=-3.0)
    stand.run(1.0)
    assert stand.told(MARKER_FACING) == pytest.approx(3.0, abs=1.0)
    assert stand.told(MARKER_DISTANCE) == pytest.approx(math.hypot(1_100.0, 80.0), rel=0.02)
    assert stand.told(MARKER_BEARING) == pytest.approx(3.0 - math.degrees(math.atan(80 / 1_100)), abs=0.3)


@pytest.mark.parametrize("goal", [None, int(GoalKind.NONE), int(GoalKind.LIGHTS)])
def test_it_looks_for_nothing_on_other_ways(goal: int | None) -> None:
    stand = Stand({} if goal is None else {**RIDE, GOAL_TYPE: goal})
    stand.run(3.0)
    assert [stand.told(name) for name in EVERYTHING] == [None] * 4


def test_what_it_tells_holds_for_the_moment_in_which_it_is_told() -> None:
    stand = Stand(RIDE, turned_deg=-12.0)
    stand.run(0.5)
    stand.world.command(0, 0.0, 30.0)
    worst = 0.0
    for _ in range(14):
        before = stand.told(MARKER_BEARING)
        true = -math.remainder(stand.world.true_pose(0).heading_deg - MARKERS[0].heading_deg, 360.0)
        stand.run(0.05)
        if stand.told(MARKER_BEARING) != before:
            worst = max(worst, abs(stand.told(MARKER_BEARING) - true))
    assert 0.0 < worst < 1.0


def test_it_says_nothing_where_none_is_seen() -> None:
    stand = Stand(RIDE, turned_deg=90.0)
    stand.run(2.0)
    assert [stand.told(name) for name in EVERYTHING] == [None] * 4


def test_the_marker_of_another_elevator_does_not_count() -> None:
    other = next(marker for marker in MARKERS if marker.code != MARKERS[0].code)
    stand = Stand({**RIDE, ELEVATOR_CALL: [other.node, NAME, "x"], FLOOR: NAME})
    stand.run(2.0)
    assert [stand.told(name) for name in EVERYTHING] == [None] * 4
    stand.tell(ELEVATOR_CALL, CALL)
    stand.run(1.0)
    assert stand.told(MARKER_BEARING) == pytest.approx(0.0, abs=0.3)


def test_the_fix_holds_for_the_true_pose() -> None:
    stand = Stand({**RIDE, ELEVATOR_CALL: CALL, FLOOR: NAME}, aside_mm=-60.0, turned_deg=2.0)
    stand.run(1.0)
    fix, pose = fix_of(stand.told(MARKER_FIX)), stand.world.true_pose(0)
    assert 0 <= stand.now_ns - fix.t_ns <= 500_000_000
    assert len(fix.rows) == 3
    for row in fix.rows:
        predicted = row.cx * pose.x_mm + row.cy * pose.y_mm + row.ch * math.radians(pose.heading_deg)
        off = math.remainder(predicted - row.value, math.tau) if row.ch else predicted - row.value
        assert abs(off) < 3.0 * row.sigma, row


@pytest.mark.parametrize(
    "variables", [{FLOOR: "elsewhere"}, {FLOOR: 3}, {FLOOR: NAME, ELEVATOR_CALL: "no list"}, {}]
)
def test_odd_variables_take_nothing_from_what_is_seen(variables: dict[str, Any]) -> None:
    stand = Stand({**RIDE, **variables})
    stand.run(1.0)
    assert stand.told(MARKER_BEARING) == pytest.approx(0.0, abs=0.3)
    assert (stand.told(MARKER_FIX) is None) == (variables.get(FLOOR) == "elsewhere")


def test_without_a_map_there_is_no_fix() -> None:
    stand = Stand(RIDE, markers={})
    stand.run(1.0)
    assert stand.told(MARKER_BEARING) is not None
    assert stand.told(MARKER_FIX) is None


def test_a_marker_elsewhere_is_not_the_maps() -> None:
    far = {NAME: tuple(_moved(marker, 4_000.0) for marker in MARKERS)}
    stand = Stand(RIDE, markers=far)
    stand.run(1.0)
    assert stand.told(MARKER_BEARING) is not None
    assert stand.told(MARKER_FIX) is None


def _moved(marker: Marker, mm: float) -> Marker:
    return replace(marker, center=Point(marker.center.x + mm, marker.center.y))


@pytest.mark.parametrize("call", ["get_many", "set_many"])
def test_while_dserver_is_away_it_goes_on_asking(call: str) -> None:
    stand = Stand(RIDE)
    stand.run(0.1)
    stand.tell(MARKER_BEARING, 99.0)
    stand.run(0.05)
    present, tries = stand.data.handlers, list[str]()

    def away(*_: object) -> object:
        tries.append(call)
        raise RefusedError("away", "it is being restarted")

    stand.data.handlers = {**present, call: away}
    stand.run(2.0)
    assert len(tries) > 2
    assert stand.told(MARKER_BEARING) == 99.0
    stand.data.handlers = present
    stand.run(1.0)
    assert stand.told(MARKER_BEARING) == pytest.approx(0.0, abs=0.3)


def test_a_camera_of_another_size_is_told() -> None:
    stand = Stand(RIDE, geometry=replace(AHEAD, columns=640, rows=480))
    with pytest.raises(ScriptError, match="CServerFront gives images of 240 x 120 pixels; expected 640"):
        stand.run(2.0)


@pytest.mark.parametrize("direction", ["west", math.inf, None])
def test_without_a_direction_nothing_is_looked_for(direction: object) -> None:
    stand = Stand({**RIDE, GOAL_DIRECTION: direction})
    stand.run(1.0)
    assert stand.told(MARKER_BEARING) is None


def test_without_a_camera_it_goes_on_asking() -> None:
    stand = Stand(RIDE, camera=False)
    stand.run(2.0)
    assert stand.told(MARKER_BEARING) is None
