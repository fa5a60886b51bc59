"""The scripts that lead a robot through a building, among its servers in virtual time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

from colony.ir.servers import DSERVER, PROXIMITY, RSERVER
from colony.nav.missions.goal_verification import GoalVerdict
from colony.runs.navigation import (
    CEILING_CAMERA,
    FRONT_CAMERA,
    PLANNER,
    SIDE_CAMERA,
    Ending,
    Route,
    mission_result,
    navigation_scripts,
)
from colony.runs.spec import MissionResult, RunSpec
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.protocol.images import Shot
from colony.runtime.protocol.messages import Node
from colony.runtime.servers.drivers import CameraDriver
from colony.sim.cameras.camera import Camera, CameraConfig
from colony.sim.cameras.scene import scene_of
from colony.sim.drivers import Plant, SimulatedCamera
from colony.sim.hazards.hazards import Hazards
from colony.sim.shots import CeilingShot, LevelShot
from colony.sim.world.operator import operator
from colony.sim.world.site import SimulatedSite
from colony.vision.level_camera import AHEAD, SIDE

_LEVEL_CAMERAS = {SIDE_CAMERA: SIDE, FRONT_CAMERA: AHEAD}


def run_cameras(
    plant: Plant, site: SimulatedSite, names: Iterable[str], *, seed: int
) -> dict[str, CameraDriver]:
    """Return the cameras with these names; a robot has one that looks up, one to the left, and one ahead.

    Args:
        plant: the simulated robot.
        site: the building that the robot is in.
        names: the names of the cameras.
        seed: the seed of the noise of the level cameras.

    Raises:
        ValueError: the robot has no such camera.
    """
    return {name: SimulatedCamera(plant, _shutter(site, name, seed)) for name in sorted(names)}


def _shutter(site: SimulatedSite, name: str, seed: int) -> Callable[[int], Shot]:
    if name == CEILING_CAMERA:
        return lambda now_ns: CeilingShot(site.ceiling(), site.world, 0, now_ns)
    camera = _level_camera(site, name, seed)
    return lambda now_ns: LevelShot(camera(), site.world, 0, now_ns)


def _level_camera(site: SimulatedSite, name: str, seed: int) -> Callable[[], Camera]:
    """Return a function that returns the camera of the robot's current floor."""
    if name not in _LEVEL_CAMERAS:
        raise ValueError(
            f"there is no camera `{name}`; expected {', '.join((CEILING_CAMERA, *_LEVEL_CAMERAS))}"
        )
    geometry = _LEVEL_CAMERAS[name]
    config = CameraConfig(
        width=geometry.columns,
        height=geometry.rows,
        view_deg=geometry.view_deg,
        yaw_deg=geometry.yaw_deg,
        above_floor_mm=geometry.height_mm,
    )
    radius_mm = site.world.configs[0].radius_mm
    return site.camera_per_floor(
        lambda floor, scenery: Camera(scene_of(floor, scenery), config, robot_radius_mm=radius_mm, seed=seed)
    )


_CAMERAS = (CEILING_CAMERA, SIDE_CAMERA, FRONT_CAMERA)
_SERVERS = (DSERVER.name, RSERVER.name, PROXIMITY, *_CAMERAS)
_DELAY_NS = 1_000_000
"""Delay of the scripts after each frame in nanoseconds, so that they know the frame's readings."""


class Mission:
    """The scripts that drive a route, with the simulated building. Mutable."""

    def __init__(self, route: Route, spec: RunSpec) -> None:
        self._route, self.plan = route, route.plan
        self.site = SimulatedSite(
            route.building,
            route.plan.floors,
            Hazards.none() if spec.world.hazards is None else Hazards(),
            poses=[route.plan.start],
            seed=spec.world.hazards or 0,
            noise_seed=spec.world.seed,
        )
        self._seed = spec.world.seed
        self._verdict = GoalVerdict.UNSEEN
        scripts = {
            **navigation_scripts(
                route.plan, self.site.building, cameras=frozenset(_CAMERAS), on_verdict=self._on_verdict
            ),
            "operator": operator(self.site.elevators, seed=spec.world.seed),
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
