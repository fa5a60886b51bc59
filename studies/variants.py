"""The variants of navigation: a behavior and its scripts, ours or as printed in the thesis."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Protocol

from colony.nav.maps.building import Building
from colony.nav.missions.clerk import clerk
from colony.nav.plan.plan import Plan, Segment
from colony.nav.plan.planner import OnSegment, planner
from colony.nav.pose.tracker import PoseSource
from colony.runs.navigation import CEILING_CAMERA, EXPECTED_MM_S, PLANNER, navigation_scripts
from colony.runtime.kit.script import Script, Step
from colony.shipped import Shipped
from colony.sim.config import RobotConfig, rome_config
from colony.vision.lights.tracker import light_tracker
from studies.thesis.light_track import PERIOD_S, ThesisTrack
from studies.thesis.local_mapper import local_mapper

VariantName = Literal["ours", "thesis"]


class MakeScripts(Protocol):
    """A function that returns the scripts around the Navigator, in their order of execution."""

    def __call__(
        self,
        plan: Plan,
        building: Building,
        on_segment: OnSegment,
        *,
        compensate: bool,
        sources: frozenset[PoseSource],
        cameras: frozenset[str],
    ) -> Mapping[str, Script]:
        """Return the scripts.

        Args:
            plan: the plan to drive.
            building: all floors of the plan, the first one first.
            on_segment: callback at the beginning of each segment.
            compensate: True to subtract the overshoot of lights from the next distance, as printed.
            sources: the sources of the pose estimate.
            cameras: the cameras of the robot.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A variant of navigation.

    Attributes:
        name: "ours", or "thesis" for the algorithms as printed.
        behavior: the file of the Navigator.
        scripts: the function that returns the scripts.
        expected_mm_s: the robot's expected mean speed, without incidents.
        robot: the configuration of the robot.
    """

    name: VariantName
    behavior: Path
    scripts: MakeScripts
    expected_mm_s: float
    robot: RobotConfig = field(default_factory=rome_config)


def _our_scripts(
    plan: Plan,
    building: Building,
    on_segment: OnSegment,
    *,
    compensate: bool,
    sources: frozenset[PoseSource],
    cameras: frozenset[str],
) -> Mapping[str, Script]:
    """Return the product's scripts, which have no use for overshoots."""
    return navigation_scripts(plan, building, on_segment, sources=sources, cameras=cameras)


def _thesis_scripts(
    plan: Plan,
    building: Building,
    on_segment: OnSegment,
    *,
    compensate: bool,
    sources: frozenset[PoseSource],
    cameras: frozenset[str],
) -> Mapping[str, Script]:
    """Return the scripts as printed, which estimate no pose and so have no sources."""

    def reckoned(segment: Segment, overshoot_mm: float) -> Generator[Step, Any, float]:
        yield from ()
        return overshoot_mm if compensate else 0.0

    ceiling_cameras = tuple(cameras & {CEILING_CAMERA})
    return {
        "clerk": clerk(),
        "tracker": light_tracker(cameras=ceiling_cameras, kind=ThesisTrack, period_s=PERIOD_S),
        "mapper": local_mapper(),
        PLANNER: planner(plan, progress=reckoned, on_segment=on_segment),
    }


OURS = Variant(
    name="ours",
    behavior=Shipped.BEHAVIOR.path("navigator"),
    scripts=_our_scripts,
    expected_mm_s=EXPECTED_MM_S,
)

# The printed algorithms rely on the odometry's heading alone along a corridor of at most two lights, and
# around its corner. They need calibrated wheels: with these the heading drifts by an eighth of a degree per
# meter, with our robot's wheels by nearly one degree.
THESIS = Variant(
    name="thesis",
    behavior=Path(__file__).parent / "thesis" / "thesis_navigator.colony",
    scripts=_thesis_scripts,
    expected_mm_s=100.0,
    robot=replace(rome_config(), wheel_scale=0.0005),
)
VARIANTS: Mapping[str, Variant] = {variant.name: variant for variant in (OURS, THESIS)}
