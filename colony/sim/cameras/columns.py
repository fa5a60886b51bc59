"""The columns of an image of a building, ray by ray, for `colony.sim.cameras.camera`.

These helpers, and those that they import, are part of a compiled function of `camera.py`. Its cached code is
renewed when that file changes, but not when this one does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from colony.sim.cameras.atlas import Atlas, paint_picture
from colony.sim.cameras.bystanders import paint_others
from colony.sim.cameras.rays import Eye, Lens, Ray, level_of, light_at, paint, row_below
from colony.sim.cameras.surfaces import BARE, Scene
from colony.sim.compiled import Floats, Floats2, Ints, called, inlined

MAX_DEPTH_MM = 1.0e6

_EDGE = 1e-9  # fraction by which walls extend beyond their ends, so that rays do not leak between them
_BACK_MM = 1.0  # of two coincident walls, the one that shows its front is visible
_MAX_SPAN_MM = 4000.0  # longest part of a wall that a grazing ray sees
_SIDE_LIGHT = 0.2  # fraction by which walls that run north to south are darker
_FLOOR_SHADE, _FLOOR_TILE_MM, _FLOOR_CONTRAST = 0.42, 600.0, 0.10
_CEILING_SHADE, _CEILING_TILE_MM, _CEILING_CONTRAST = 0.88, 1200.0, 0.06
_COVER_SHIFT_MM = 977.0  # offset between the covers of different walls


class Canvas(NamedTuple):
    """Work space of the renderer.

    It has a picture, (columns, rows), the blurred picture, the present column, and the numbers of the walls
    that may be visible.
    """

    picture: Floats2
    blurred: Floats2
    column: Floats
    near: Ints


def canvas_of(columns: int, rows: int, walls: int) -> Canvas:
    """Return work space for a picture, in a scene with this number of walls."""
    return Canvas(
        picture=np.zeros((columns, rows)),
        blurred=np.zeros((columns, rows)),
        column=np.zeros(rows),
        near=np.zeros(walls, dtype=np.int64),
    )


@inlined
def _checkered(x: float, y: float, tile: float, contrast: float, size: float) -> float:
    """Return a tiled plane's difference from its shade at (x, y), where a pixel covers `size` mm of it."""
    odd = (math.floor(x / tile) + math.floor(y / tile)) % 2.0
    fade = max(0.0, 1.0 - 2.0 * size / tile)
    return contrast * fade * (odd - 0.5)


@inlined
def _floor_shade(x: float, y: float, size: float) -> float:
    """Return the shade of the floor at (x, y), where a pixel covers `size` mm of it."""
    return _FLOOR_SHADE + _checkered(x, y, _FLOOR_TILE_MM, _FLOOR_CONTRAST, size)


@inlined
def _ceiling_shade(x: float, y: float, size: float) -> float:
    """Return the shade of the ceiling at (x, y), likewise."""
    return _CEILING_SHADE + _checkered(x, y, _CEILING_TILE_MM, _CEILING_CONTRAST, size)


@inlined
def _paint_planes(
    column: Floats, top: int, bottom: int, ray: Ray, axis: float, lens: Lens, scene: Scene
) -> None:
    """Paint the ceiling above row `top`, and the floor from row `bottom` on."""
    above = scene.ceiling - lens.above_floor
    for row in range(top):
        depth = above * lens.focal / (axis - row)
        x, y, size = ray.x + depth * ray.dx, ray.y + depth * ray.dy, depth * depth / (lens.focal * above)
        column[row] = level_of(_ceiling_shade(x, y, size), depth * ray.length)
    for row in range(bottom, column.shape[0]):
        depth = lens.above_floor * lens.focal / (row - axis)
        x, y = ray.x + depth * ray.dx, ray.y + depth * ray.dy
        size = depth * depth / (lens.focal * lens.above_floor)
        column[row] = level_of(_floor_shade(x, y, size) * light_at(x, y, scene.lighting), depth * ray.length)


@inlined
def _gather(eye: Eye, reach: float, scene: Scene, near: Ints) -> int:
    """Collect the numbers of the walls that may be in view into `near`; return their count.

    A wall is in view unless it is completely behind the camera or beside the view, which is `reach` wide to
    either side per mm of depth.
    """
    count = 0
    for wall in range(scene.walls.shape[0]):
        ax, ay = scene.walls[wall, 0] - eye.x, scene.walls[wall, 1] - eye.y
        bx, by = scene.walls[wall, 2] - eye.x, scene.walls[wall, 3] - eye.y
        a_depth, b_depth = ay * eye.cosine - ax * eye.sine, by * eye.cosine - bx * eye.sine
        a_right, b_right = ax * eye.cosine + ay * eye.sine, bx * eye.cosine + by * eye.sine
        hidden = (a_depth <= 0.0) & (b_depth <= 0.0)
        hidden |= (a_right > reach * a_depth) & (b_right > reach * b_depth)
        hidden |= (-a_right > reach * a_depth) & (-b_right > reach * b_depth)
        if scene.standing[wall] == 1 and not hidden:
            near[count] = wall
            count += 1
    return count


@inlined
def _meet_wall(ray: Ray, walls: Floats2, near: Ints, count: int) -> tuple[int, float]:
    """Return the wall at which a ray ends, -1 if there is none, and its depth."""
    met, nearest, behind = -1, MAX_DEPTH_MM, MAX_DEPTH_MM
    for number in range(count):
        wall = near[number]
        ax, ay, length = walls[wall, 0] - ray.x, walls[wall, 1] - ray.y, walls[wall, 6]
        ex, ey = walls[wall, 4] * length, walls[wall, 5] * length
        across = ray.dx * ey - ray.dy * ex
        side = 1.0 if across >= 0.0 else -1.0
        across *= side
        depth = side * (ax * ey - ay * ex)
        along = side * (ax * ray.dy - ay * ray.dx)
        apart = depth + (_BACK_MM * across if side > 0.0 else 0.0)
        first = (depth > 0.0) & (apart < behind * across)
        first &= (along >= -_EDGE * across) & (along <= (1.0 + _EDGE) * across)
        if first:
            met, nearest, behind = wall, depth / across, apart / across
    return met, nearest


@inlined
def _along(wall: int, walls: Floats2, eye: Eye, right: float) -> float:
    """Return the place along a wall's line, in mm, where the ray that looks `right` to the right ends."""
    dx, dy = right * eye.cosine - eye.sine, right * eye.sine + eye.cosine
    ax, ay = walls[wall, 0] - eye.x, walls[wall, 1] - eye.y
    along: float = (ax * dy - ay * dx) / (dx * walls[wall, 5] - dy * walls[wall, 4])
    return along


@inlined
def _span(wall: int, along: float, walls: Floats2, eye: Eye, ray: Ray) -> tuple[float, float]:
    """Return the range along a wall that is covered by a ray, which meets the wall at `along`."""
    start, end = (
        _along(wall, walls, eye, ray.right - ray.half),
        _along(wall, walls, eye, ray.right + ray.half),
    )
    left, right = min(start, end), max(start, end)
    if not (left <= along and along <= right and right - left < _MAX_SPAN_MM):  # beyond the horizon
        left, right = along - _MAX_SPAN_MM / 2.0, along + _MAX_SPAN_MM / 2.0
    return left, right


@inlined
def _paint_wall_picture(
    column: Floats, place: Floats, left: float, right: float, depth: float, axis: float, lens: Lens,
    atlas: Atlas, gain: float,
) -> None:  # fmt: skip
    """Paint a picture on a wall between `left` and `right`; `place` is a row of `Scene.wall_pictures`."""
    step = depth / lens.focal
    above = place[3] - lens.above_floor - (axis + 0.5) * step
    clip = place[3] - place[2]
    first = int(min(max(math.floor(-above / step), 0.0), column.shape[0] + 0.0))
    last = int(min(max(math.ceil((clip - above) / step), 0.0), column.shape[0] + 0.0))
    start, end = max(left, place[0]), min(right, place[1])
    if first < last and start < end:
        paint_picture(
            column, atlas, int(place[4]), start - place[5], end - place[5], right - left,
            first, last, above, step, 0.0, clip, gain,
        )  # fmt: skip


@inlined
def _paint_wall(
    column: Floats, wall: int, depth: float, ray: Ray, eye: Eye, lens: Lens, scene: Scene
) -> None:
    """Paint a wall and everything on it; a column has one distance, and so one brightness."""
    rows = column.shape[0]
    x, y = ray.x + depth * ray.dx, ray.y + depth * ray.dy
    light = 1.0 - _SIDE_LIGHT * (1.0 - abs(scene.walls[wall, 4]))
    gain = level_of(light * light_at(x, y, scene.lighting), depth * ray.length)
    top = row_below(scene.ceiling, depth, eye.axis, lens, rows)
    bottom = row_below(0.0, depth, eye.axis, lens, rows)
    along = (x - scene.walls[wall, 0]) * scene.walls[wall, 4] + (y - scene.walls[wall, 1]) * scene.walls[
        wall, 5
    ]
    left, right = _span(wall, along, scene.walls, eye, ray)
    paint(column, top, bottom, gain * scene.shades[wall])
    cover = scene.covers[wall]
    if cover != BARE:
        step = depth / lens.focal
        above = scene.ceiling - lens.above_floor - (eye.axis + 0.5) * step
        shift = _COVER_SHIFT_MM * wall
        paint_picture(
            column, scene.atlas, cover, left + shift, right + shift, right - left,
            top, bottom, above, step, -MAX_DEPTH_MM, MAX_DEPTH_MM, gain,
        )  # fmt: skip
    for panel in range(scene.first[wall], scene.first[wall + 1]):
        if scene.panels[panel, 0] <= along and along < scene.panels[panel, 1]:
            start = row_below(min(scene.panels[panel, 3], scene.ceiling), depth, eye.axis, lens, rows)
            end = row_below(scene.panels[panel, 2], depth, eye.axis, lens, rows)
            paint(column, start, end, gain * scene.panels[panel, 4])
    for number in range(scene.first_wall_picture[wall], scene.first_wall_picture[wall + 1]):
        if scene.wall_pictures[number, 0] < right and left < scene.wall_pictures[number, 1]:
            _paint_wall_picture(
                column, scene.wall_pictures[number], left, right, depth, eye.axis, lens, scene.atlas, gain
            )


@called
def draw_columns(
    poses: Floats2, robot: int, people: Floats2, velocity: float, turn: float, scene: Scene, lens: Lens,
    middle: float, axis: float, canvas: Canvas,
) -> None:  # fmt: skip
    """Draw all columns of a canvas, each as the mean of its rays.

    Args:
        poses: (robots, 3), x and y in mm, heading in degrees.
        robot: number of the robot with the camera.
        people: (people, 2), the places of the people.
        velocity: speed of the robot, in mm/s.
        turn: turn rate of the robot, in degrees/s.
        scene: the scene.
        lens: the lens.
        middle: the column, between two pixels, of the optical axis.
        axis: its row.
        canvas: receives the columns.
    """
    columns, rows = canvas.picture.shape
    column, rays = canvas.column, lens.rays
    heading = math.radians(poses[robot, 2])
    half = 0.5 / (rays * lens.focal)
    canvas.picture[:] = 0.0
    for number in range(rays):
        moment = (2 * number + 2) % (rays + 1) - 1  # of the exposure; not in the order of the rays
        dt = lens.exposure * ((moment + 0.5) / rays - 0.5) if rays > 1 else 0.0
        x = poses[robot, 0] - velocity * dt * math.sin(heading)
        y = poses[robot, 1] + velocity * dt * math.cos(heading)
        looking = heading + math.radians(turn * dt) + lens.yaw
        eye = Eye(x, y, math.sin(looking), math.cos(looking), axis)
        count = _gather(eye, max(middle, columns - middle) / lens.focal, scene, canvas.near)
        for place in range(columns):
            right = (place + (number + 0.5) / rays - middle) / lens.focal
            dx, dy = right * eye.cosine - eye.sine, right * eye.sine + eye.cosine
            ray = Ray(x, y, dx, dy, math.sqrt(1.0 + right * right), right, half)
            wall, depth = _meet_wall(ray, scene.walls, canvas.near, count)
            top = row_below(scene.ceiling, depth, axis, lens, rows)
            bottom = row_below(0.0, depth, axis, lens, rows)
            _paint_planes(column, top, bottom, ray, axis, lens, scene)
            if wall >= 0:
                _paint_wall(column, wall, depth, ray, eye, lens, scene)
            else:
                paint(column, top, bottom, 0.0)
            paint_others(column, robot, poses, people, depth, ray, eye, lens, scene)
            for row in range(rows):
                canvas.picture[place, row] += column[row] / rays
