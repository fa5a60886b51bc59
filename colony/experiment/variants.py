"""What is run: the behavior and the scripts around it, in our version or as printed in the thesis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from colony.nav.clerk import clerk
from colony.nav.local_mapper import local_mapper
from colony.nav.plan import Plan
from colony.nav.planner import OnSegment, planner
from colony.nav.walls import Walls
from colony.runtime.kit.script import Script
from colony.sim.config import RobotConfig
from colony.vision.light_tracker import light_tracker

VariantName = Literal["ours", "thesis"]

BEHAVIORS = Path(__file__).parents[2] / "behaviors"
CEILING_CAMERA = "CServerUp"
PLANNER = "planner"


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A way to navigate.

    Attributes:
        name: "ours", or "thesis" for the algorithms as printed.
        behavior: the Navigator.
        mm_s: how fast its robot is expected to be in the mean, where nothing goes wrong.
        robot: what it drives.
    """

    name: VariantName
    behavior: Path
    mm_s: float
    robot: RobotConfig = field(default_factory=RobotConfig)

    def scripts(
        self, plan: Plan, walls: Walls, on_segment: OnSegment | None = None, *, compensate: bool = True
    ) -> Mapping[str, Script]:
        """The clients around the Navigator, in the order in which they run in a moment.

        Args:
            compensate: as printed, take the overshoot of lights off the distance that follows.
        """
        thesis = self.name == "thesis"
        return {
            "clerk": clerk(),
            "tracker": light_tracker(thesis=thesis),
            "mapper": local_mapper(walls, thesis=thesis),
            PLANNER: planner(
                plan,
                positions="reckoning" if thesis else "pose",
                compensate=compensate,
                on_segment=on_segment,
            ),
        }


OURS = Variant(name="ours", behavior=BEHAVIORS / "navigator.colony", mm_s=250.0)

# As printed, a corridor of two lights or of none is driven, and its corner turned, by the odometry's heading
# alone. That needs wheels that were calibrated: an eighth of a degree a meter is what these drift, where the
# robot that ours drives drifts by nearly one.
THESIS = Variant(
    name="thesis",
    behavior=BEHAVIORS / "thesis_navigator.colony",
    mm_s=100.0,
    robot=RobotConfig(wheel_scale=0.0005),
)
VARIANTS: Mapping[str, Variant] = {variant.name: variant for variant in (OURS, THESIS)}
