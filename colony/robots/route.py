"""The route of a run through a building."""

from __future__ import annotations

from dataclasses import dataclass

from colony.body.model import Body
from colony.body.shipped import ROME, shipped_body
from colony.nav.maps.building import Building, load_building
from colony.nav.plan.plan import Plan
from colony.nav.plan.route import NoPlanError, plan
from colony.robots.request import MisuseError, RunRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """A building, and a plan that leads through it."""

    building: Building
    plan: Plan

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


def expect_rome(body: Body) -> None:
    """Raise MisuseError unless a simulated robot has the body of RoME, which missions are made for."""
    rome = shipped_body(ROME)
    if (body.chassis, body.servers) != (rome.chassis, rome.servers):
        problem = f"`{body.robot.name}` has another body: missions are for the sensors and cameras of RoME"
        raise MisuseError(f"--from and --to: error: {problem}")
