"""What the cameras of a robot see: an image of the building in shades of gray.

The optical axis is level, and walls are upright. So an image column looks in one direction over the floor,
its ray ends at one wall, and all of the wall in that column is equally far away: a column is the ceiling, the
wall with its panels, the floor, and the robots in front of them, from far to near. Only ceiling and floor are
computed pixel by pixel.

Depths are measured along the optical axis, as projection wants them; what is far away is darker.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from colony.sim.compiled import Bytes2, Floats2, compiled, inlined
from colony.sim.scene import Scene

MOST_PIXELS = 4_000_000

_FARTHEST_MM = 1.0e6
_EDGE = 1e-9  # rays meet walls up to this part beyond their ends: no leak where two walls meet
_HALF_LIGHT_MM = 12_000.0  # what is as far away as this is half as bright
_SIDE_LIGHT = 0.2  # how much darker walls are that run from north to south
_FLOOR_SHADE, _FLOOR_TILE_MM, _FLOOR_CONTRAST = 0.42, 600.0, 0.10
_CEILING_SHADE, _CEILING_TILE_MM, _CEILING_CONTRAST = 0.88, 1200.0, 0.06
_ROBOT_SHADE, _ROBOT_TOP_SHADE, _ROBOT_RIM = 0.30, 0.18, 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig:
    """A camera on the robot's axis, looking along the floor.

    Attributes:
        width, height: of the image in pixels, which are square.
        view_deg: the angle that the image's width sees, below 180.
        yaw_deg: where it looks, counterclockwise from ahead: 90 is to the left.
        above_floor_mm: the height of the lens; below the ceiling.

    Raises:
        ValueError: a number is not finite or not in its range.
    """

    width: int = 240
    height: int = 120
    view_deg: float = 60.0
    yaw_deg: float = 0.0
    above_floor_mm: float = 1350.0

    def __post_init__(self) -> None:
        for field in fields(self):
            if not math.isfinite(getattr(self, field.name)):
                raise ValueError(f"{field.name} is {getattr(self, field.name)!r}; expected a finite number")
        if min(self.width, self.height) < 1 or self.width * self.height > MOST_PIXELS:
            raise ValueError(
                f"an image of {self.width} x {self.height}; expected 1 to {MOST_PIXELS} pixels in all"
            )
        if not 0.0 < self.view_deg < 180.0:
            raise ValueError(f"view_deg is {self.view_deg}; expected an angle above 0 and below 180")
        if self.above_floor_mm <= 0.0:
            raise ValueError(f"above_floor_mm is {self.above_floor_mm}; expected a height above 0")


class Lens(NamedTuple):
    """A camera as the renderer takes it: focal length in pixels, heights in mm, yaw in radians, and the hull
    of the robots that it sees."""

    focal: float
    above_floor: float
    yaw: float
    robot_radius: float
    robot_height: float


class Ray(NamedTuple):
    """The direction of an image column in the world's frame, for one mm of depth, and where it starts."""

    x: float
    y: float
    dx: float
    dy: float
    length: float


def lens_of(config: CameraConfig, *, robot_radius_mm: float, robot_height_mm: float) -> Lens:
    """A camera as the renderer takes it."""
    return Lens(
        focal=config.width / 2.0 / math.tan(math.radians(config.view_deg) / 2.0),
        above_floor=float(config.above_floor_mm),
        yaw=math.radians(config.yaw_deg),
        robot_radius=float(robot_radius_mm),
        robot_height=float(robot_height_mm),
    )


@inlined
def _level(shade: float, distance: float) -> np.uint8:
    """A shade as it comes out from a distance."""
    light = 1.0 / (1.0 + distance / _HALF_LIGHT_MM)
    return np.uint8(min(max(255.0 * shade * light, 0.0), 255.0))


@inlined
def _checkered(x: float, y: float, tile: float, contrast: float, size: float) -> float:
    """By how much a tiled plane differs from its shade at (x, y), where a pixel covers `size` mm of it."""
    odd = (math.floor(x / tile) + math.floor(y / tile)) % 2.0
    fade = max(0.0, 1.0 - 2.0 * size / tile)
    return contrast * fade * (odd - 0.5)


@inlined
def _floor_shade(x: float, y: float, size: float) -> float:
    """The shade of the floor at (x, y), where a pixel covers `size` mm of it."""
    return _FLOOR_SHADE + _checkered(x, y, _FLOOR_TILE_MM, _FLOOR_CONTRAST, size)


@inlined
def _ceiling_shade(x: float, y: float, size: float) -> float:
    """The shade of the ceiling at (x, y), likewise."""
    return _CEILING_SHADE + _checkered(x, y, _CEILING_TILE_MM, _CEILING_CONTRAST, size)


@inlined
def _row(above_floor: float, depth: float, lens: Lens, rows: int) -> int:
    """The first row, from 0 to `rows`, that looks below the height `above_floor` at a depth."""
    row = rows / 2.0 - 0.5 - lens.focal * (above_floor - lens.above_floor) / depth
    return int(min(max(math.ceil(row), 0.0), rows + 0.0))


@inlined
def _paint(image: Bytes2, column: int, start: int, end: int, level: np.uint8) -> None:
    for row in range(start, end):
        image[row, column] = level


@inlined
def _paint_planes(
    image: Bytes2, column: int, top: int, bottom: int, ray: Ray, lens: Lens, ceiling: float
) -> None:
    """The ceiling above row `top`, and the floor from row `bottom` on."""
    middle = image.shape[0] / 2.0 - 0.5
    for row in range(top):
        depth = (ceiling - lens.above_floor) * lens.focal / (middle - row)
        size = depth * depth / (lens.focal * (ceiling - lens.above_floor))
        shade = _ceiling_shade(ray.x + depth * ray.dx, ray.y + depth * ray.dy, size)
        image[row, column] = _level(shade, depth * ray.length)
    for row in range(bottom, image.shape[0]):
        depth = lens.above_floor * lens.focal / (row - middle)
        size = depth * depth / (lens.focal * lens.above_floor)
        shade = _floor_shade(ray.x + depth * ray.dx, ray.y + depth * ray.dy, size)
        image[row, column] = _level(shade, depth * ray.length)


@inlined
def _meet_wall(ray: Ray, walls: Floats2) -> tuple[int, float]:
    """The wall at which a ray ends, -1 where there is none, and its depth."""
    met, nearest = -1, _FARTHEST_MM
    for wall in range(walls.shape[0]):
        ax, ay, length = walls[wall, 0] - ray.x, walls[wall, 1] - ray.y, walls[wall, 6]
        ex, ey = walls[wall, 4] * length, walls[wall, 5] * length
        across = ray.dx * ey - ray.dy * ex
        side = 1.0 if across >= 0.0 else -1.0
        across *= side
        depth = side * (ax * ey - ay * ex)
        along = side * (ax * ray.dy - ay * ray.dx)
        first = (depth > 0.0) & (depth < nearest * across)
        first &= (along >= -_EDGE * across) & (along <= (1.0 + _EDGE) * across)
        if first:
            met, nearest = wall, depth / across
    return met, nearest


@inlined
def _paint_wall(
    image: Bytes2, column: int, wall: int, depth: float, ray: Ray, lens: Lens, scene: Scene
) -> None:
    """A wall and its panels; each column of it is equally far away, so equally bright."""
    rows = image.shape[0]
    east, distance = abs(scene.walls[wall, 4]), depth * ray.length
    light = 1.0 - _SIDE_LIGHT * (1.0 - east)
    top, bottom = _row(scene.ceiling, depth, lens, rows), _row(0.0, depth, lens, rows)
    _paint(image, column, top, bottom, _level(scene.shades[wall] * light, distance))
    x, y = ray.x + depth * ray.dx - scene.walls[wall, 0], ray.y + depth * ray.dy - scene.walls[wall, 1]
    along = x * scene.walls[wall, 4] + y * scene.walls[wall, 5]
    for panel in range(scene.first[wall], scene.first[wall + 1]):
        if scene.panels[panel, 0] <= along and along < scene.panels[panel, 1]:
            start = _row(min(scene.panels[panel, 3], scene.ceiling), depth, lens, rows)
            end = _row(scene.panels[panel, 2], depth, lens, rows)
            _paint(image, column, start, end, _level(scene.panels[panel, 4] * light, distance))


@inlined
def _robot_depth(ray: Ray, x: float, y: float, radius: float) -> tuple[float, float]:
    """Between which depths a ray is in the hull of a robot at (x, y); infinite where it misses it."""
    ox, oy, squared = x - ray.x, y - ray.y, ray.length * ray.length
    ahead = ox * ray.dx + oy * ray.dy
    under_root = ahead * ahead - squared * (ox * ox + oy * oy - radius * radius)
    near = far = math.inf
    if under_root > 0.0 and ahead > 0.0:
        root = math.sqrt(under_root)
        near, far = (ahead - root) / squared, (ahead + root) / squared
    return near, far


@inlined
def _paint_robots(
    image: Bytes2, column: int, robot: int, poses: Floats2, depth: float, ray: Ray, lens: Lens
) -> None:
    """The robots that stand nearer than `depth`, from far to near: upright cylinders, darker at the rim."""
    rows, limit, more = image.shape[0], depth, poses.shape[0] > 1
    while more:
        nearest, farthest = 0.0, 0.0
        for other in range(poses.shape[0]):
            if other != robot:
                near, far = _robot_depth(ray, poses[other, 0], poses[other, 1], lens.robot_radius)
                if near > nearest and near < limit:
                    nearest, farthest = near, far
        more = nearest > 0.0
        if more:
            limit = nearest
            thickness = (farthest - nearest) * ray.length / (2.0 * lens.robot_radius)
            shade = _ROBOT_SHADE * (_ROBOT_RIM + (1.0 - _ROBOT_RIM) * thickness)
            rear = _row(lens.robot_height, farthest, lens, rows)
            top, bottom = _row(lens.robot_height, nearest, lens, rows), _row(0.0, nearest, lens, rows)
            _paint(image, column, rear, top, _level(_ROBOT_TOP_SHADE, nearest * ray.length))
            _paint(image, column, top, bottom, _level(shade, nearest * ray.length))


@compiled
def render(poses: Floats2, robot: int, scene: Scene, lens: Lens, image: Bytes2) -> None:
    """Draw what a camera of a robot sees.

    Args:
        poses: (robots, 3), x and y in mm, heading in degrees.
        robot: whose camera it is.
        image: (height, width), gets the image, from 0, black, to 255.
    """
    x, y, heading = poses[robot, 0], poses[robot, 1], math.radians(poses[robot, 2]) + lens.yaw
    sine, cosine = math.sin(heading), math.cos(heading)
    for column in range(image.shape[1]):
        right = (column + 0.5 - image.shape[1] / 2.0) / lens.focal
        ray = Ray(x, y, -sine + right * cosine, cosine + right * sine, math.sqrt(1.0 + right * right))
        wall, depth = _meet_wall(ray, scene.walls)
        top = _row(scene.ceiling, depth, lens, image.shape[0])
        bottom = _row(0.0, depth, lens, image.shape[0])
        _paint_planes(image, column, top, bottom, ray, lens, scene.ceiling)
        if wall >= 0:
            _paint_wall(image, column, wall, depth, ray, lens, scene)
        else:
            _paint(image, column, top, bottom, np.uint8(0))
        _paint_robots(image, column, robot, poses, depth, ray, lens)


class Camera:
    """A camera of a robot, in a scene. Mutable: the buffer that it draws into.

    Args:
        scene: what there is to be seen; the same walls as the robot's world.
        config: the camera.
        robot_radius_mm, robot_height_mm: the hull of other robots.

    Raises:
        ValueError: the lens would be in the ceiling or above.
    """

    def __init__(
        self, scene: Scene, config: CameraConfig, *, robot_radius_mm: float, robot_height_mm: float = 1000.0
    ) -> None:
        if config.above_floor_mm >= scene.ceiling:
            found = f"above_floor_mm is {config.above_floor_mm}"
            raise ValueError(f"{found}; expected less than the ceiling's {scene.ceiling}")
        self._scene = scene
        self._lens = lens_of(config, robot_radius_mm=robot_radius_mm, robot_height_mm=robot_height_mm)
        self._image = np.zeros((config.height, config.width), dtype=np.uint8)

    def image(self, poses: Floats2, robot: int) -> Bytes2:
        """What robot number `robot` of those at `poses`, (robots, 3), sees; (height, width) of uint8."""
        render(poses, robot, self._scene, self._lens, self._image)
        return self._image.copy()
