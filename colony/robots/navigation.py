"""The scripts around the Navigator, which lead the robot along a plan."""

from __future__ import annotations

from collections.abc import Mapping

from colony.nav.maps.building import Building
from colony.nav.maps.signs import markers_of, plates_of
from colony.nav.maps.walls import walls_of
from colony.nav.missions.clerk import clerk
from colony.nav.missions.goal_verification import plate_at
from colony.nav.plan.plan import Plan
from colony.nav.plan.planner import OnSegment, OnVerdict, planner
from colony.nav.pose.estimate import pose_estimator
from colony.nav.pose.tracker import EVERY_SOURCE, PoseSource
from colony.runtime.kit.script import Script
from colony.vision.lights.tracker import light_tracker

CEILING_CAMERA, SIDE_CAMERA, FRONT_CAMERA = "CServerUp", "CServerSide", "CServerFront"
PLANNER = "planner"

EXPECTED_MM_S = 250.0
"""The robot's expected mean speed in mm/s, without incidents."""


def navigation_scripts(
    plan: Plan,
    building: Building,
    on_segment: OnSegment | None = None,
    *,
    sources: frozenset[PoseSource] = EVERY_SOURCE,
    cameras: frozenset[str] = frozenset({CEILING_CAMERA}),
    on_verdict: OnVerdict | None = None,
) -> Mapping[str, Script]:
    """Return the scripts around the Navigator, in their order of execution.

    Args:
        plan: the plan to drive.
        building: all floors of the plan, the first one first.
        on_segment: callback at the beginning of each segment, with its number, from 0, and the segment.
        sources: the sources of the pose estimate. Without `LIGHTS` the tracker counts lights by the pose
            alone.
        cameras: the cameras of the robot.
        on_verdict: callback for the verdict on the goal's plate, if the robot has a camera for plates.
    """
    has_lights = CEILING_CAMERA in cameras and PoseSource.LIGHTS in sources
    goal = building.map_named(plan.segments[-1].end.floor)
    return {
        "clerk": clerk(),
        "tracker": light_tracker(cameras=(CEILING_CAMERA,) if has_lights else ()),
        **_finders(building, cameras),
        "mapper": pose_estimator({floor.name: walls_of(floor) for floor in building.maps}, sources=sources),
        PLANNER: planner(
            plan,
            on_segment=on_segment,
            goal_plate=plate_at(goal, plan.goal) if SIDE_CAMERA in cameras else None,
            on_verdict=on_verdict,
        ),
    }


def _finders(building: Building, cameras: frozenset[str]) -> Mapping[str, Script]:
    """Return the finders of door plates and elevator markers for which there is a camera."""
    finders: dict[str, Script] = {}
    if SIDE_CAMERA in cameras:
        from colony.vision.plates.finder import plate_finder

        plates = {floor.name: plates_of(floor) for floor in building.maps}
        finders["plates"] = plate_finder(plates, camera=SIDE_CAMERA)
    if FRONT_CAMERA in cameras:
        from colony.vision.markers.finder import marker_finder

        markers = {floor.name: markers_of(floor) for floor in building.maps}
        finders["markers"] = marker_finder(markers, camera=FRONT_CAMERA)
    return finders
