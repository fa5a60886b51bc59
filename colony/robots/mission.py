"""The scripts that lead a robot through a building, among its servers in virtual time."""

from __future__ import annotations

import math
from collections.abc import Mapping

from colony.ir.servers import DSERVER, PROXIMITY, RSERVER
from colony.nav.missions.goal_verification import GoalVerdict
from colony.robots.mission_result import Ending, mission_result
from colony.robots.navigation import (
    CEILING_CAMERA,
    FRONT_CAMERA,
    PLANNER,
    SIDE_CAMERA,
    navigation_scripts,
)
from colony.robots.request import MissionResult, RunRequest
from colony.robots.route import Route
from colony.robots.run_cameras import run_cameras
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.protocol.messages import Node
from colony.runtime.servers.drivers import CameraDriver
from colony.sim.drivers import Plant
from colony.sim.hazards.hazards import Hazards
from colony.sim.world.operator import operator
from colony.sim.world.site import SimulatedSite

_CAMERAS = (CEILING_CAMERA, SIDE_CAMERA, FRONT_CAMERA)
_SERVERS = (DSERVER.name, RSERVER.name, PROXIMITY, *_CAMERAS)
_DELAY_NS = 1_000_000
"""Delay of the scripts after each frame in nanoseconds, so that they know the frame's readings."""


class Mission:
    """The scripts that drive a route, with the simulated building. Mutable."""

    def __init__(self, route: Route, request: RunRequest) -> None:
        self._route, self.plan = route, route.plan
        self.site = SimulatedSite(
            route.building,
            route.plan.floors,
            Hazards.none() if request.hazards is None else Hazards(),
            poses=[route.plan.start],
            seed=request.hazards or 0,
            noise_seed=request.seed,
        )
        self._seed = request.seed
        self._verdict = GoalVerdict.UNSEEN
        scripts = {
            **navigation_scripts(
                route.plan, self.site.building, cameras=frozenset(_CAMERAS), on_verdict=self._on_verdict
            ),
            "operator": operator(self.site.elevators, seed=request.seed),
        }
        self._scripts = {
            name: ScriptNode(name, script, _SERVERS, delay_ns=_DELAY_NS) for name, script in scripts.items()
        }

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The scripts as nodes."""
        return tuple(self._scripts.values())

    def cameras(self, plant: Plant) -> Mapping[str, CameraDriver]:
        """Return the cameras that the scripts use."""
        return run_cameras(plant, self.site, _CAMERAS, seed=self._seed)

    @property
    def problem(self) -> str:
        """The error that a script raised; "" for none."""
        for script in self._scripts.values():
            if script.problem is not None:
                return f"{script.address}: {type(script.problem).__name__}: {script.problem}"
        return ""

    def is_over(self) -> bool:
        """Return True if the planner is done, or a script has failed."""
        return self._scripts[PLANNER].ended or bool(self.problem)

    def mission_result(self, t_ns: int) -> MissionResult:
        """Return the result of the mission."""
        pose, goal = self.site.world.true_pose(0), self.plan.segments[-1].end
        return mission_result(
            self._route,
            Ending(
                is_done=self._scripts[PLANNER].ended,
                problem=self.problem,
                duration_s=t_ns / 1e9,
                floor=self.site.floor,
                goal_error_mm=math.hypot(pose.x_mm - goal.x_mm, pose.y_mm - goal.y_mm),
                verdict=self._verdict,
            ),
        )

    def _on_verdict(self, verdict: GoalVerdict) -> None:
        self._verdict = verdict
