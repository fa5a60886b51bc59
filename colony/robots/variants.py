"""The variants of navigation: a behavior and its scripts, ours or as printed in the thesis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from colony.nav.mapping.local_mapper import local_mapper
from colony.nav.maps.building import Building
from colony.nav.maps.signs import markers_of, plates_of
from colony.nav.maps.walls import walls_of
from colony.nav.missions.clerk import clerk
from colony.nav.missions.goal_verification import plate_at
from colony.nav.plan.plan import Plan
from colony.nav.plan.planner import OnSegment, OnVerdict, planner
from colony.nav.pose.estimate import pose_estimator
from colony.nav.pose.tracker import EVERY_SOURCE, Source
from colony.runtime.kit.script import Script
from colony.shipped import Shipped
from colony.sim.config import RobotConfig, rome_config
from colony.vision.lights.tracker import light_tracker

if TYPE_CHECKING:
    from colony.vision.plates.finder import OnPlate

VariantName = Literal["ours", "thesis"]

CEILING_CAMERA, SIDE_CAMERA, FRONT_CAMERA = "CServerUp", "CServerSide", "CServerFront"
PLANNER = "planner"


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A variant of navigation.

    Attributes:
        name: "ours", or "thesis" for the algorithms as printed.
        behavior: the file of the Navigator.
        expected_mm_s: the robot's expected mean speed, without incidents.
        robot: the configuration of the robot.
    """

    name: VariantName
    behavior: Path
    expected_mm_s: float
    robot: RobotConfig = field(default_factory=rome_config)

    def scripts(
        self,
        plan: Plan,
        building: Building,
        on_segment: OnSegment | None = None,
        *,
        compensate: bool = True,
        sources: frozenset[Source] = EVERY_SOURCE,
        cameras: frozenset[str] = frozenset({CEILING_CAMERA}),
        on_plate: OnPlate | None = None,
        on_verdict: OnVerdict | None = None,
    ) -> Mapping[str, Script]:
        """Return the scripts around the Navigator, in their order of execution.

        Args:
            plan: the plan to drive.
            building: all floors of the plan, the first one first.
            on_segment: callback at the beginning of each segment, with its number, from 0, and the segment.
            compensate: True to subtract the overshoot of lights from the next distance, as printed.
            sources: the sources of the pose estimate. Without `LIGHTS` the tracker counts lights by the pose
                alone.
            cameras: the cameras of the robot.
            on_plate: callback for each plate that is found.
            on_verdict: callback for the verdict on the goal's plate, if the robot has a camera for plates.
        """
        thesis = self.name == "thesis"
        lights = thesis or Source.LIGHTS in sources
        ceiling_cameras = (CEILING_CAMERA,) if CEILING_CAMERA in cameras and lights else ()
        scripts = {
            "clerk": clerk(),
            "tracker": light_tracker(cameras=ceiling_cameras, thesis=thesis),
            **_finders(building, cameras, thesis, on_plate),
        }
        walls = {floor.name: walls_of(floor) for floor in building.maps}
        scripts["mapper"] = local_mapper() if thesis else pose_estimator(walls, sources=sources)
        goal = building.map_named(plan.segments[-1].end.floor)
        scripts[PLANNER] = planner(
            plan,
            positions="reckoning" if thesis else "pose",
            compensate=compensate,
            on_segment=on_segment,
            goal_plate=plate_at(goal, plan.goal) if SIDE_CAMERA in cameras and not thesis else None,
            on_verdict=on_verdict,
        )
        return scripts


def _finders(
    building: Building, cameras: frozenset[str], thesis: bool, on_plate: OnPlate | None
) -> Mapping[str, Script]:
    """Return the finders of door plates and elevator markers for which there is a camera."""
    finders: dict[str, Script] = {}
    if SIDE_CAMERA in cameras:
        from colony.vision.plates.finder import plate_finder

        plates = None if thesis else {floor.name: plates_of(floor) for floor in building.maps}
        finders["plates"] = plate_finder(plates, camera=SIDE_CAMERA, thesis=thesis, on_plate=on_plate)
    if FRONT_CAMERA in cameras and not thesis:
        from colony.vision.markers.finder import marker_finder

        markers = {floor.name: markers_of(floor) for floor in building.maps}
        finders["markers"] = marker_finder(markers, camera=FRONT_CAMERA)
    return finders


OURS = Variant(name="ours", behavior=Shipped.BEHAVIOR.path("navigator"), expected_mm_s=250.0)

# The printed algorithms rely on the odometry's heading alone along a corridor of at most two lights, and
# around its corner. They need calibrated wheels: with these the heading drifts by an eighth of a degree per
# meter, with our robot's wheels by nearly one degree.
THESIS = Variant(
    name="thesis",
    behavior=Shipped.BEHAVIOR.path("thesis_navigator"),
    expected_mm_s=100.0,
    robot=replace(rome_config(), wheel_scale=0.0005),
)
VARIANTS: Mapping[str, Variant] = {variant.name: variant for variant in (OURS, THESIS)}
