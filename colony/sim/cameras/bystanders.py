"""Robots and people in front of a level camera.

Robots are upright cylinders; people are upright pictures that face the camera.
"""

from __future__ import annotations

import math

from colony.sim.cameras.atlas import paint_picture
from colony.sim.cameras.rays import Eye, Lens, Ray, level_of, light_at, paint, row_below
from colony.sim.cameras.silhouettes import PERSON_STYLES, PERSON_WIDTH_MM
from colony.sim.cameras.surfaces import Scene
from colony.sim.compiled import Floats, Floats2, inlined

_ROBOT_SHADE, _ROBOT_TOP_SHADE, _ROBOT_RIM = 0.30, 0.18, 0.4
_STEP_MM = 400.0  # distance after which the picture of a person changes
_MIN_DEPTH_MM = 200.0


@inlined
def _robot_depth(ray: Ray, x: float, y: float, radius: float) -> tuple[float, float]:
    """Return the depths at which a ray enters and leaves a robot's hull at (x, y); infinite if it misses."""
    ox, oy, squared = x - ray.x, y - ray.y, ray.length * ray.length
    ahead = ox * ray.dx + oy * ray.dy
    under_root = ahead * ahead - squared * (ox * ox + oy * oy - radius * radius)
    near = far = math.inf
    if under_root > 0.0 and ahead > 0.0:
        root = math.sqrt(under_root)
        near, far = (ahead - root) / squared, (ahead + root) / squared
    return near, far


@inlined
def _person_depth(eye: Eye, ray: Ray, x: float, y: float) -> float:
    """Return the depth of the person at (x, y) along a ray; infinite if the ray misses.

    A person is flat.
    """
    ox, oy = x - eye.x, y - eye.y
    depth, right = oy * eye.cosine - ox * eye.sine, ox * eye.cosine + oy * eye.sine
    hit = depth > _MIN_DEPTH_MM and abs(right - ray.right * depth) < PERSON_WIDTH_MM / 2.0 + ray.half * depth
    return depth if hit else math.inf


@inlined
def _paint_robot(column: Floats, near: float, far: float, ray: Ray, axis: float, lens: Lens) -> None:
    """Paint an upright cylinder, darker at the rim, and its top."""
    rows = column.shape[0]
    thickness = (far - near) * ray.length / (2.0 * lens.robot_radius)
    shade = _ROBOT_SHADE * (_ROBOT_RIM + (1.0 - _ROBOT_RIM) * thickness)
    rear = row_below(lens.robot_height, far, axis, lens, rows)
    top, bottom = row_below(lens.robot_height, near, axis, lens, rows), row_below(0.0, near, axis, lens, rows)
    paint(column, rear, top, level_of(_ROBOT_TOP_SHADE, near * ray.length))
    paint(column, top, bottom, level_of(shade, near * ray.length))


@inlined
def _paint_person(
    column: Floats,
    number: int,
    x: float,
    y: float,
    depth: float,
    ray: Ray,
    eye: Eye,
    lens: Lens,
    scene: Scene,
) -> None:
    """Paint the person at (x, y); `number` selects the style, the position that of the legs."""
    picture = 2 * (number % PERSON_STYLES) + int(math.floor((x + y) / _STEP_MM) % 2.0)
    center = (x - eye.x) * eye.cosine + (y - eye.y) * eye.sine
    left = (ray.right - ray.half) * depth - center + PERSON_WIDTH_MM / 2.0
    right = left + 2.0 * ray.half * depth
    high = scene.atlas.pictures[picture, 2] * scene.atlas.pictures[picture, 4]
    step = depth / lens.focal
    above = high - lens.above_floor - (eye.axis + 0.5) * step
    first = int(min(max(math.floor(-above / step), 0.0), column.shape[0] + 0.0))
    last = int(min(max(math.ceil((high - above) / step), 0.0), column.shape[0] + 0.0))
    start, end = max(left, 0.0), min(right, PERSON_WIDTH_MM)
    if first < last and start < end:
        gain = level_of(light_at(x, y, scene.lighting), depth * ray.length)
        paint_picture(
            column, scene.atlas, picture, start, end, right - left, first, last, above, step, 0.0, high, gain
        )


@inlined
def paint_bystanders(
    column: Floats, robot: int, poses: Floats2, people: Floats2, depth: float, ray: Ray, eye: Eye, lens: Lens,
    scene: Scene,
) -> None:  # fmt: skip
    """Paint the robots and people nearer than `depth`, from far to near."""
    limit, robots = depth, poses.shape[0]
    has_more = robots > 1 or people.shape[0] > 0
    while has_more:
        selected, nearest, farthest = -1, 0.0, 0.0
        for other in range(robots):
            if other != robot:
                near, far = _robot_depth(ray, poses[other, 0], poses[other, 1], lens.robot_radius)
                if near > nearest and near < limit:
                    selected, nearest, farthest = other, near, far
        for person in range(people.shape[0]):
            near = _person_depth(eye, ray, people[person, 0], people[person, 1])
            if near > nearest and near < limit:
                selected, nearest = robots + person, near
        has_more, limit = selected >= 0, nearest
        if selected >= robots:
            x, y = people[selected - robots, 0], people[selected - robots, 1]
            _paint_person(column, selected - robots, x, y, nearest, ray, eye, lens, scene)
        elif has_more:
            _paint_robot(column, nearest, farthest, ray, eye.axis, lens)
