"""The route of a run through a building."""

from __future__ import annotations

from dataclasses import dataclass

from colony.nav.maps.building import Building, load_building
from colony.nav.missions.goal_verification import Verdict
from colony.nav.plan.plan import Plan
from colony.nav.plan.route import NoPlanError, plan
from colony.robots.request import MisuseError, RunRequest

PLATE_TEXTS = {
    Verdict.UNSEEN: "",
    Verdict.RIGHT: "; the goal's plate was read",
    Verdict.WRONG: "; another plate was read at the goal",
}
"""Texts about the door plate at the goal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """A building, and a plan that leads through it."""

    building: Building
    plan: Plan

    @property
    def start(self) -> tuple[float, float, float]:
        """The beginning of the route: x and y in mm, and the heading in degrees."""
        first = self.plan.segments[0]
        return first.start.x_mm, first.start.y_mm, first.heading_deg

    @property
    def name(self) -> str:
        """The name for people: "from 350R to 250R of msu_engineering_2 (ldvld)"."""
        ends = [self.plan.segments[0].start.floor, self.plan.segments[-1].end.floor]
        floor = f" of {ends[1]}" if ends[0] != ends[1] else ""
        return f"from {self.plan.origin} to {self.plan.goal}{floor} ({self.plan.modes})"


def planned_route(request: RunRequest) -> Route:
    """Return the requested route.

    Raises:
        MisuseError: the route does not exist.
        DiagnosticError: the map, or one that its elevators lead to, is invalid.
    """
    assert request.map_path is not None
    assert request.origin is not None
    assert request.goal is not None
    building = load_building(request.map_path)
    try:
        return Route(building=building, plan=plan(building, request.origin, request.goal))
    except NoPlanError as problem:
        raise MisuseError(f"{request.map_path}: error: {problem}") from None
