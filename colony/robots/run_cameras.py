"""The simulated cameras of a robot."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from colony.robots.navigation import CEILING_CAMERA, FRONT_CAMERA, SIDE_CAMERA
from colony.runtime.protocol.images import Shot
from colony.runtime.servers.drivers import CameraDriver
from colony.sim.cameras.camera import Camera, CameraConfig
from colony.sim.cameras.scene import scene_of
from colony.sim.drivers import Plant, SimulatedCamera
from colony.sim.shots import CeilingShot, LevelShot
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
