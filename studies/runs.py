"""A run, from its specification to its result: a plan driven in a building with hazards.

A specification can be pickled and is complete: it gives the same result, bit for bit, in every process and on
every machine of the same kind.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Protocol, TypeVar

from colony.experiment.results import RunKey
from colony.nav.maps.building import Building, load_building
from colony.nav.plan.plan import Plan
from colony.nav.plan.route import plan
from colony.nav.pose.tracker import EVERY_SOURCE, PoseSource
from colony.runs.behavior import behavior_of
from colony.runs.mission import run_cameras
from colony.runs.navigation import CEILING_CAMERA, GOAL_RADIUS_MM, PLANNER, expected_s
from colony.runtime.assembly.loop import Loop, Watch
from colony.runtime.kit.script import Script, ScriptError
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.hazards.hazards import Hazards
from colony.sim.hazards.scenery import Scenery
from colony.sim.world.operator import operator
from colony.sim.world.site import SimulatedSite
from studies.confidence.published_runs import PUBLISHED_RUNS
from studies.hazards_on_route import hazards_on_route
from studies.lists import PUBLISHED
from studies.record import FailureReason, RunResult
from studies.run_monitor import RunMonitor
from studies.variants import VARIANTS, Variant

R_co = TypeVar("R_co", covariant=True)

OPERATOR = "operator"

NO_SCRIPTS: Mapping[str, Script] = MappingProxyType({})


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRun:
    """The specification of a run; `key.variant` names the variant.

    All randomness comes from `key.seed` and `key.number`. `sources` are the sources of the pose estimate,
    `cameras` the names of the robot's camera servers.
    """

    key: RunKey
    map_path: Path
    origin: str
    goal: str
    hazards: Hazards
    sources: frozenset[PoseSource] = EVERY_SOURCE
    cameras: frozenset[str] = frozenset({CEILING_CAMERA})


@lru_cache(maxsize=4)
def building_at(path: Path) -> Building:
    """Return the building of a map, with the floors that its elevators lead to.

    Raises:
        DiagnosticError: one of the maps is invalid.
    """
    return load_building(path)


@lru_cache(maxsize=256)
def _plan(path: Path, origin: str, goal: str) -> Plan:
    return plan(building_at(path), origin, goal)


def plan_of(spec: StudyRun) -> Plan:
    """Return the plan of a run.

    Raises:
        NoPlanError: there is no such path.
        DiagnosticError: the map is invalid.
    """
    return _plan(spec.map_path, spec.origin, spec.goal)


def seed_of(key: RunKey) -> int:
    """Return the seed of a run: different for each number and seed, the same for all variants."""
    return (key.seed * 1_000_003 + key.number * 7_919 + 12_345) % (1 << 31)


def _is_compensated(key: RunKey) -> bool:
    """Return True if overshoots are subtracted from distances, as in all but the earlier published runs."""
    return key.runs != PUBLISHED or PUBLISHED_RUNS[key.number - 1].compensated


class Run:
    """A run that can be driven frame by frame. Mutable.

    Args:
        spec: the specification.
        watch: a callback for every frame.
        extra_scripts: scripts that run after those of the variant, or replace those with the same name.

    Raises:
        NoPlanError, DiagnosticError: see `plan_of`.
    """

    def __init__(
        self, spec: StudyRun, *, watch: Watch | None = None, extra_scripts: Mapping[str, Script] = NO_SCRIPTS
    ) -> None:
        self.spec = spec
        self.variant: Variant = VARIANTS[spec.key.variant.partition("/")[0]]
        self.building = building_at(spec.map_path)
        self.plan = plan_of(spec)
        seed = seed_of(spec.key)
        self.site = SimulatedSite(
            self.building,
            self.plan.floors,
            spec.hazards,
            poses=[self.plan.start],
            seed=seed,
            config=self.variant.robot,
        )
        self.world = self.site.world
        operator_script = {OPERATOR: operator(self.site.elevators, seed=seed)}
        begun_segments: list[int] = []
        clock = VirtualClock()
        plant = Plant(self.world, clock, [self.site.elevators.advance])
        behavior = behavior_of(self.variant.behavior)
        self.loop = Loop(
            behavior.robot,
            behavior.executor(),
            simulated_drivers(plant, cameras=run_cameras(plant, self.site, spec.cameras, seed=seed)),
            {
                **self.variant.scripts(
                    self.plan,
                    self.site.building,
                    lambda number, segment: begun_segments.append(number),
                    compensate=_is_compensated(spec.key),
                    sources=spec.sources,
                    cameras=spec.cameras,
                ),
                **(operator_script if len(self.plan.floors) > 1 else {}),
                **extra_scripts,
            },
            clock=clock,
            advance=plant.catch_up,
            seed=seed,
            watch=watch,
        )
        self.monitor = RunMonitor(self.plan, self.loop, self.world, self.expected_s, begun_segments)
        self.failure: FailureReason | None = None
        self.remark = ""

    @property
    def expected_s(self) -> float:
        """The expected time of the run in seconds, without incidents."""
        return expected_s(self.plan, self.variant.expected_mm_s)

    @property
    def scenery(self) -> Scenery:
        """The scenery of the floor where the run begins."""
        return self.site.sceneries[self.plan.floors[0]]

    def step(self) -> bool:
        """Drive one frame; return False when the run is over."""
        try:
            self.loop.frame()
        except ScriptError as problem:
            self.failure, self.remark = "script", str(problem)
            return False
        failure = self.monitor.update()
        if failure:
            self.failure = failure
        elif self.loop.scripts.has_ended(PLANNER):
            on_goal_floor = self.site.floor == self.plan.segments[-1].end.floor
            self.failure = "" if on_goal_floor and self.goal_error_mm <= GOAL_RADIUS_MM else "astray"
            self.remark = "" if on_goal_floor else f"on {self.site.floor}"
            self.monitor.done = not self.failure
        return self.failure is None

    def close(self) -> None:
        """Stop the robot and end all scripts."""
        self.loop.close()

    @property
    def goal_error_mm(self) -> float:
        """The true distance of the robot from the goal in mm; the floor is ignored."""
        pose, goal = self.world.true_pose(0), self.plan.segments[-1].end
        return math.hypot(pose.x_mm - goal.x_mm, pose.y_mm - goal.y_mm)

    @property
    def overshoot_mm(self) -> float:
        """The true distance of the robot beyond the goal in mm, along the last segment."""
        pose, last = self.world.true_pose(0), self.plan.segments[-1]
        heading = math.radians(last.heading_deg)
        dx, dy = pose.x_mm - last.end.x_mm, pose.y_mm - last.end.y_mm
        return -math.sin(heading) * dx + math.cos(heading) * dy

    def result(self) -> RunResult:
        """Return the result so far."""
        monitor = self.monitor
        return RunResult(
            key=self.spec.key,
            origin=self.plan.origin,
            goal=self.plan.goal,
            failure=self.failure or "",
            failed_mode=monitor.mode if self.failure else "",
            remark=self.remark,
            overshoot_mm=self.overshoot_mm,
            goal_error_mm=self.goal_error_mm,
            distance_mm=self.plan.distance_mm,
            travelled_mm=self.world.distance(0),
            time_s=self.loop.now_ns / 1e9,
            top_mm_s=monitor.top_mm_s,
            mode_counts=monitor.mode_counts(),
            planned_modes=self.plan.modes,
            completed=monitor.completed,
            first_light=monitor.first_light,
            lights=monitor.lights,
            contacts=monitor.contacts,
            hazards=hazards_on_route(self.site, self.plan, monitor.slips),
            path=tuple(monitor.path),
        )


class SteppedRun(Protocol[R_co]):
    """A run that is driven frame by frame, and has a result at the end."""

    def step(self) -> bool:
        """Drive one frame; return False at the end."""
        ...

    def close(self) -> None:
        """End the run."""
        ...

    def result(self) -> R_co:
        """Return the result so far."""
        ...


def run_to_end(stepped_run: SteppedRun[R_co]) -> R_co:
    """Drive a run to its end, and return the result."""
    try:
        while stepped_run.step():
            pass
        return stepped_run.result()
    finally:
        stepped_run.close()


def run(spec: StudyRun) -> RunResult:
    """Drive a run to its end."""
    return run_to_end(Run(spec))
