"""Level cameras: images of the building in shades of gray.

The optical axis is level, and walls are upright. A ray of an image column therefore has one direction over
the floor and hits one wall, whose distance is the same for the whole column. A column consists of the
ceiling, the wall with everything on it, the floor, and the robots and people in front, painted from far to
near. It has several rays, spread over its width and over the exposure, for sub-pixel edges and motion blur.

Depths are measured along the optical axis, as the projection requires; distant surfaces are darker.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cache

import numpy as np

from colony.body import devices
from colony.body.shipped import shipped_body
from colony.sim.cameras.atlas import Atlas
from colony.sim.cameras.columns import Canvas, Lens, canvas_of, draw_columns
from colony.sim.cameras.fitting import scene_with_walls
from colony.sim.cameras.optics import Optics, RendererOptics, blur_columns, expose, gain_at, sensor_of
from colony.sim.cameras.surfaces import Lighting, RenderedScene
from colony.sim.compiled import Bytes2, Floats2, compiled
from colony.sim.world.world import STILL, Speed, World

MAX_PIXELS = 4_000_000

_NO_PEOPLE = np.zeros((0, 2))
_RECORDS = (Atlas, Lighting)  # types of a scene's fields, which the compiler looks up in this file


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig:
    """The configuration of a level camera on the robot's axis.

    Attributes:
        width, height: size of the image in square pixels.
        view_deg: horizontal field of view, below 180.
        yaw_deg: direction, counterclockwise from ahead: 90 is to the left.
        above_floor_mm: height of the lens, below the ceiling.
        optics: the lens and the sensor.

    Raises:
        ValueError: a number is not finite, or out of range.
    """

    width: int
    height: int
    view_deg: float
    yaw_deg: float
    above_floor_mm: float
    optics: Optics = field(default_factory=Optics)

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        for parameter in fields(self):
            name = parameter.name
            if name != "optics" and not math.isfinite(getattr(self, name)):
                raise ValueError(f"{name} is {getattr(self, name)!r}; expected a finite number")
        if min(self.width, self.height) < 1 or self.width * self.height > MAX_PIXELS:
            raise ValueError(
                f"an image of {self.width} x {self.height}; expected 1 to {MAX_PIXELS} pixels in all"
            )
        if not 0.0 < self.view_deg < 180.0:
            raise ValueError(f"view_deg is {self.view_deg}; expected an angle above 0 and below 180")
        if self.above_floor_mm <= 0.0:
            raise ValueError(f"above_floor_mm is {self.above_floor_mm}; expected a height above 0")


def camera_config_of(camera: devices.CameraSpec) -> CameraConfig:
    """Return the configuration of a camera of a robot's body."""
    return CameraConfig(
        width=camera.size.columns,
        height=camera.size.rows,
        view_deg=camera.view_deg,
        yaw_deg=camera.pose.bearing_deg,
        above_floor_mm=camera.height_mm,
    )


@cache
def rome_camera() -> CameraConfig:
    """Return the configuration of RoME's camera that looks ahead."""
    return camera_config_of(shipped_body("rome").camera("CServerFront"))


def lens_of(config: CameraConfig, *, robot_radius_mm: float) -> Lens:
    """Return a camera in the renderer's form."""
    return Lens(
        focal=config.width / 2.0 / math.tan(math.radians(config.view_deg) / 2.0),
        above_floor=float(config.above_floor_mm),
        yaw=math.radians(config.yaw_deg),
        robot_radius=float(robot_radius_mm),
        robot_height=shipped_body("rome").chassis.height_mm,
        rays=config.optics.rays,
        exposure=float(config.optics.exposure_s),
    )


@compiled
def render(
    poses: Floats2, robot: int, people: Floats2, velocity: float, turn: float, sideways: float,
    t_ns: int,
    scene: RenderedScene, lens: Lens, sensor: RendererOptics, canvas: Canvas,
    first: int, height: int, image: Bytes2,
) -> None:  # fmt: skip
    """Draw some rows of the image of a robot's camera.

    Args:
        poses: (robots, 3), x and y in mm, heading in degrees.
        robot: index of the robot with the camera.
        people: (people, 2), the positions of the people.
        velocity: speed of the robot, in mm/s.
        turn: turn rate of the robot, in degrees/s.
        sideways: speed of the robot to the left, in mm/s.
        t_ns: time of the image.
        scene: the scene.
        lens: the lens.
        sensor: the sensor.
        canvas: the work space, larger than the image by the radius of the blur on all sides.
        first: index of the first row to draw.
        height: number of rows of the whole image.
        image: (rows, width), receives the rows, from 0 (black) to 255.
    """
    blur_radius = sensor.weights.shape[0] - 1
    cx, cy = image.shape[1] / 2.0 + blur_radius, height / 2.0 - 0.5 - first + blur_radius
    draw_columns(poses, robot, people, velocity, turn, sideways, scene, lens, cx, cy, canvas)
    gain = gain_at(poses[robot, 0], poses[robot, 1], sensor)
    if blur_radius > 0:
        blur_columns(canvas.picture, canvas.blurred, sensor)
        expose(canvas.blurred, t_ns, first, height, gain, sensor, image)
    else:
        expose(canvas.picture, t_ns, first, height, gain, sensor, image)


class Camera:
    """A camera of a robot, in a scene.

    Stateful: keeps its canvas, and the scene with the doors as they were in the last shot.

    Args:
        scene: the scene.
        config: the camera.
        robot_radius_mm: the radius of other robots.
        seed: seed of the noise and of the gain.

    Raises:
        ValueError: the lens is not below the ceiling.
    """

    def __init__(
        self, scene: RenderedScene, config: CameraConfig, *, robot_radius_mm: float, seed: int = 0
    ) -> None:
        if config.above_floor_mm >= scene.ceiling:
            found = f"above_floor_mm is {config.above_floor_mm}"
            raise ValueError(f"{found}; expected less than the ceiling's {scene.ceiling}")
        self.config = config
        self._scene = scene
        self._last_walls: Floats2 | None = None
        self._lens = lens_of(config, robot_radius_mm=robot_radius_mm)
        own_seed = seed * 1_000_003 + round(config.yaw_deg * 1000.0) % 360_000
        self._sensor = sensor_of(config.optics, width=config.width, seed=own_seed)
        self._canvas: Canvas | None = None

    def shot(self, world: World, robot: int, t_ns: int) -> Callable[[int, int], Bytes2]:
        """Take a picture of a world in its current state, to be drawn later.

        Returns a function that draws `count` rows from row `first` on, exactly as they are in the whole
        image; it raises `ValueError` for rows that the image does not have.
        """
        if world.walls is not self._last_walls:
            self._scene, self._last_walls = scene_with_walls(self._scene, world.walls), world.walls
        scene, poses, people, speed = self._scene, world.true_poses, world.people, world.speed(robot)
        return lambda first, count: self._draw_rows(scene, poses, robot, t_ns, people, speed, first, count)

    def see(self, world: World, robot: int, t_ns: int) -> Bytes2:
        """Return the image of robot number `robot` of a world, (height, width).

        People and doors are as they are in the world.
        """
        return self.shot(world, robot, t_ns)(0, self.config.height)

    def image(
        self,
        poses: Floats2,
        robot: int,
        t_ns: int = 0,
        *,
        people: Floats2 = _NO_PEOPLE,
        speed: Speed = STILL,
    ) -> Bytes2:
        """Return the image of robot number `robot` among robots at `poses`: (height, width) of uint8.

        Args:
            poses: (robots, 3), x and y in mm, heading in degrees.
            robot: index of the robot with the camera.
            t_ns: time of the image.
            people: (people, 2), the positions of the people, in mm.
            speed: speed of the robot.
        """
        return self._draw_rows(self._scene, poses, robot, t_ns, people, speed, 0, self.config.height)

    def _draw_rows(
        self, scene: RenderedScene, poses: Floats2, robot: int, t_ns: int, people: Floats2,
        speed: Speed, first: int, count: int,
    ) -> Bytes2:  # fmt: skip
        height = self.config.height
        if first < 0 or count < 1 or first + count > height:
            raise ValueError(
                f"{count} rows from row {first} on; expected at least 1 of rows 0 to {height - 1}"
            )
        image = np.empty((count, self.config.width), dtype=np.uint8)
        render(
            np.ascontiguousarray(poses, dtype=np.float64), robot, np.ascontiguousarray(people),
            speed.velocity_mm_s, speed.turn_deg_s, speed.sideways_mm_s, t_ns, scene, self._lens, self._sensor,
            self._canvas_for(count, len(scene.walls)), first, height, image,
        )  # fmt: skip
        return image

    def _canvas_for(self, rows: int, walls: int) -> Canvas:
        """Return a canvas for this number of rows, and for a scene with this number of walls."""
        margin = 2 * (len(self._sensor.weights) - 1)
        size = self.config.width + margin, rows + margin
        canvas = self._canvas
        if canvas is None or canvas.picture.shape != size or len(canvas.candidates) < walls:
            canvas = self._canvas = canvas_of(*size, walls)
        return canvas
