"""What `--from`, `--to` and `--map` of `colony run` mean: a way through a building."""

from __future__ import annotations

from dataclasses import dataclass

from colony.cli.run.options import Misuse, Options
from colony.nav.maps.building import Building, load_building
from colony.nav.missions.goal_verification import Verdict
from colony.nav.plan.plan import Plan
from colony.nav.plan.route import NoPlan, plan

TOLD_OF_PLATE = {
    Verdict.UNSEEN: "",
    Verdict.RIGHT: "; the goal's plate was read",
    Verdict.WRONG: "; another plate was read at the goal",
}
"""What to say of the plate at the end of a way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """A building, and the plan that leads through it."""

    building: Building
    plan: Plan

    @property
    def start(self) -> tuple[float, float, float]:
        """Where it begins: x and y in mm, and the heading in degrees."""
        first = self.plan.segments[0]
        return first.start.x_mm, first.start.y_mm, first.heading_deg

    @property
    def name(self) -> str:
        """For people: "from 350R to 250R of msu_engineering_2 (ldvld)"."""
        ends = [self.plan.segments[0].start.floor, self.plan.segments[-1].end.floor]
        floor = f" of {ends[1]}" if ends[0] != ends[1] else ""
        return f"from {self.plan.origin} to {self.plan.goal}{floor} ({self.plan.modes})"


def way_of(options: Options) -> Way:
    """The way that the options ask for.

    Raises:
        Misuse: there is no such way.
        Failure: the map, or one to which its elevators lead, is bad.
    """
    assert options.map_path is not None
    assert options.origin is not None
    assert options.goal is not None
    building = load_building(options.map_path)
    try:
        return Way(building=building, plan=plan(building, options.origin, options.goal))
    except NoPlan as problem:
        raise Misuse(f"{options.map_path}: error: {problem}") from None
