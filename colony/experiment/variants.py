"""What is run: the behavior and the scripts around it, in our version or as printed in the thesis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from colony.nav.clerk import clerk
from colony.nav.local_mapper import local_mapper
from colony.nav.plan import Plan
from colony.nav.planner import OnSegment, planner
from colony.nav.walls import Walls
from colony.runtime.kit.script import Script
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
    """

    name: VariantName
    behavior: Path
    mm_s: float

    def scripts(self, plan: Plan, walls: Walls, on_segment: OnSegment | None = None) -> Mapping[str, Script]:
        """The clients around the Navigator, in the order in which they run in a moment."""
        thesis = self.name == "thesis"
        return {
            "clerk": clerk(),
            "tracker": light_tracker(thesis=thesis),
            "mapper": local_mapper(walls, thesis=thesis),
            PLANNER: planner(plan, positions="reckoning" if thesis else "pose", on_segment=on_segment),
        }


OURS = Variant(name="ours", behavior=BEHAVIORS / "navigator.colony", mm_s=250.0)
THESIS = Variant(name="thesis", behavior=BEHAVIORS / "thesis_navigator.colony", mm_s=100.0)
VARIANTS: Mapping[str, Variant] = {variant.name: variant for variant in (OURS, THESIS)}
