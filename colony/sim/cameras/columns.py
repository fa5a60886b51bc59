"""The columns of an image of a building, ray by ray, for `colony.sim.cameras.camera`.

These helpers, and those that they import, are compiled into a function of `camera.py`. Its cached machine
code is rebuilt when that file changes, but not when this one does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from colony.sim.cameras.atlas import Atlas, paint_picture
from colony.sim.cameras.surfaces import BARE, PERSON_STYLES, PERSON_WIDTH_MM, Lighting, RenderedScene
from colony.sim.compiled import Floats, Floats2, Ints, called, inlined

# --- rays ---------------------------------------------------------------------------------------------
#
# Rays of a level camera, and the gray levels of the pixels that they paint.

_HALF_LIGHT_MM = 12_000.0  # distance at which brightness is halved


class Lens(NamedTuple):
    """A level camera in the renderer's form.

    It has the focal length in pixels, heights in mm, the yaw in radians, the hull of other robots, the rays
    per column, and the exposure in seconds.
    """

    focal: float
    above_floor: float
    yaw: float
    robot_radius: float
    robot_height: float
    rays: int
    exposure: float


class Eye(NamedTuple):
    """A camera at one moment: its position, its heading (sine and cosine), and the row of its optical axis.

    The row is relative to the first row drawn.
    """

    x: float
    y: float
    sine: float
    cosine: float
    axis: float


class Ray(NamedTuple):
    """A ray: its start, and its direction in the world's frame per mm of depth.

    `right` is its slope to the right of the optical axis. The ray represents everything up to `half` to
    either side.
    """

    x: float
    y: float
    dx: float
    dy: float
    length: float
    right: float
    half: float


@inlined
def level_of(shade: float, distance: float) -> float:
    """Return the gray level of a shade at a distance."""
    return 255.0 * shade / (1.0 + distance / _HALF_LIGHT_MM)


@inlined
def light_at(x: float, y: float, lighting: Lighting) -> float:
    """Return the light level at (x, y)."""
    columns, rows = lighting.levels.shape
    across = min(max((x - lighting.x) / lighting.cell, 0.0), columns - 1.0)
    along = min(max((y - lighting.y) / lighting.cell, 0.0), rows - 1.0)
    column, row = int(across), int(along)
    right, above = min(column + 1, columns - 1), min(row + 1, rows - 1)
    across, along = across - column, along - row
    low: float = lighting.levels[column, row] * (1.0 - across) + lighting.levels[right, row] * across
    high: float = lighting.levels[column, above] * (1.0 - across) + lighting.levels[right, above] * across
    level: float = low * (1.0 - along) + high * along
    return level


@inlined
def row_below(height: float, depth: float, axis: float, lens: Lens, rows: int) -> int:
    """Return the first row that sees points below `height` at `depth`, clamped to 0 to `rows`."""
    row = axis - lens.focal * (height - lens.above_floor) / depth
    return int(min(max(math.ceil(row), 0.0), rows + 0.0))


@inlined
def paint(column: Floats, start: int, end: int, level: float) -> None:
    """Set the pixels from `start` up to `end` of a column to a level."""
    for row in range(start, end):
        column[row] = level


# --- bystanders ---------------------------------------------------------------------------------------
#
# Robots and people in front of a level camera.
#
# Robots are upright cylinders; people are upright pictures that face the camera.

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
    scene: RenderedScene,
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
    scene: RenderedScene,
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


# --- columns ------------------------------------------------------------------------------------------

MAX_DEPTH_MM = 1.0e6

_EDGE = 1e-9  # fraction by which walls extend beyond their ends, so that rays do not leak between them
_BACK_MM = 1.0  # depth added to a wall seen from behind, so that a coincident front face wins
_MAX_SPAN_MM = 4000.0  # maximum length of wall that a grazing ray covers
_SIDE_LIGHT = 0.2  # fraction by which walls that run north to south are darker
_FLOOR_SHADE, _FLOOR_TILE_MM, _FLOOR_CONTRAST = 0.42, 600.0, 0.10
_CEILING_SHADE, _CEILING_TILE_MM, _CEILING_CONTRAST = 0.88, 1200.0, 0.06
_MATERIAL_SHIFT_MM = 977.0  # offset between the materials of different walls


class Canvas(NamedTuple):
    """Work space of the renderer.

    Attributes:
        picture, blurred: (columns, rows), the picture before and after blurring.
        column: (rows,), the column being drawn.
        candidates: (walls,), the indices of the walls that may be visible.
    """

    picture: Floats2
    blurred: Floats2
    column: Floats
    candidates: Ints


def canvas_of(columns: int, rows: int, walls: int) -> Canvas:
    """Return work space for a picture, in a scene with this number of walls."""
    return Canvas(
        picture=np.zeros((columns, rows)),
        blurred=np.zeros((columns, rows)),
        column=np.zeros(rows),
        candidates=np.zeros(walls, dtype=np.int64),
    )


@inlined
def _checkered(x: float, y: float, tile: float, contrast: float, size: float) -> float:
    """Return the deviation of a checkered plane from its mean shade at (x, y).

    A pixel covers `size` mm of the plane; the pattern fades out as that approaches half a tile.
    """
    odd = (math.floor(x / tile) + math.floor(y / tile)) % 2.0
    fade = max(0.0, 1.0 - 2.0 * size / tile)
    return contrast * fade * (odd - 0.5)


@inlined
def _floor_shade(x: float, y: float, size: float) -> float:
    """Return the shade of the floor at (x, y), where a pixel covers `size` mm of it."""
    return _FLOOR_SHADE + _checkered(x, y, _FLOOR_TILE_MM, _FLOOR_CONTRAST, size)


@inlined
def _ceiling_shade(x: float, y: float, size: float) -> float:
    """Return the shade of the ceiling at (x, y), where a pixel covers `size` mm of it."""
    return _CEILING_SHADE + _checkered(x, y, _CEILING_TILE_MM, _CEILING_CONTRAST, size)


@inlined
def _paint_planes(
    column: Floats, top: int, bottom: int, ray: Ray, axis: float, lens: Lens, scene: RenderedScene
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
def _gather(eye: Eye, tan_half_fov: float, scene: RenderedScene, candidates: Ints) -> int:
    """Collect the indices of the walls that may be in view into `candidates`; return their count.

    A wall may be in view unless it is completely behind the camera, or completely to one side of the view.
    `tan_half_fov` is the tangent of half the field of view.
    """
    count = 0
    for wall in range(scene.walls.shape[0]):
        ax, ay = scene.walls[wall, 0] - eye.x, scene.walls[wall, 1] - eye.y
        bx, by = scene.walls[wall, 2] - eye.x, scene.walls[wall, 3] - eye.y
        a_depth, b_depth = ay * eye.cosine - ax * eye.sine, by * eye.cosine - bx * eye.sine
        a_right, b_right = ax * eye.cosine + ay * eye.sine, bx * eye.cosine + by * eye.sine
        hidden = (a_depth <= 0.0) & (b_depth <= 0.0)
        hidden |= (a_right > tan_half_fov * a_depth) & (b_right > tan_half_fov * b_depth)
        hidden |= (-a_right > tan_half_fov * a_depth) & (-b_right > tan_half_fov * b_depth)
        if scene.present[wall] == 1 and not hidden:
            candidates[count] = wall
            count += 1
    return count


@inlined
def _cast_ray(ray: Ray, walls: Floats2, candidates: Ints, count: int) -> tuple[int, float]:
    """Return the first wall that a ray hits, -1 for none, and its depth."""
    hit, nearest, nearest_biased = -1, MAX_DEPTH_MM, MAX_DEPTH_MM
    for number in range(count):
        wall = candidates[number]
        ax, ay, length = walls[wall, 0] - ray.x, walls[wall, 1] - ray.y, walls[wall, 6]
        ex, ey = walls[wall, 4] * length, walls[wall, 5] * length
        across = ray.dx * ey - ray.dy * ex
        side = 1.0 if across >= 0.0 else -1.0
        across *= side
        depth = side * (ax * ey - ay * ex)
        along = side * (ax * ray.dy - ay * ray.dx)
        biased = depth + (_BACK_MM * across if side > 0.0 else 0.0)
        is_nearest = (depth > 0.0) & (biased < nearest_biased * across)
        is_nearest &= (along >= -_EDGE * across) & (along <= (1.0 + _EDGE) * across)
        if is_nearest:
            hit, nearest, nearest_biased = wall, depth / across, biased / across
    return hit, nearest


@inlined
def _along(wall: int, walls: Floats2, eye: Eye, right: float) -> float:
    """Return the distance along a wall's line, in mm, at which the ray of lateral slope `right` hits it."""
    dx, dy = right * eye.cosine - eye.sine, right * eye.sine + eye.cosine
    ax, ay = walls[wall, 0] - eye.x, walls[wall, 1] - eye.y
    along: float = (ax * dy - ay * dx) / (dx * walls[wall, 5] - dy * walls[wall, 4])
    return along


@inlined
def _span(wall: int, along: float, walls: Floats2, eye: Eye, ray: Ray) -> tuple[float, float]:
    """Return the span along a wall that a ray covers; the ray hits the wall at `along`."""
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
    column: Floats, wall_picture: Floats, left: float, right: float, depth: float, axis: float, lens: Lens,
    atlas: Atlas, gain: float,
) -> None:  # fmt: skip
    """Paint a row of `RenderedScene.wall_pictures`, a picture on a wall, between `left` and `right`."""
    step = depth / lens.focal
    above = wall_picture[3] - lens.above_floor - (axis + 0.5) * step
    clip = wall_picture[3] - wall_picture[2]
    first = int(min(max(math.floor(-above / step), 0.0), column.shape[0] + 0.0))
    last = int(min(max(math.ceil((clip - above) / step), 0.0), column.shape[0] + 0.0))
    start, end = max(left, wall_picture[0]), min(right, wall_picture[1])
    if first < last and start < end:
        paint_picture(
            column, atlas, int(wall_picture[4]), start - wall_picture[5], end - wall_picture[5], right - left,
            first, last, above, step, 0.0, clip, gain,
        )  # fmt: skip


@inlined
def _paint_wall(
    column: Floats, wall: int, depth: float, ray: Ray, eye: Eye, lens: Lens, scene: RenderedScene
) -> None:
    """Paint a wall and everything on it; all of the column has the same distance and brightness."""
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
    material = scene.materials[wall]
    if material != BARE:
        step = depth / lens.focal
        above = scene.ceiling - lens.above_floor - (eye.axis + 0.5) * step
        shift = _MATERIAL_SHIFT_MM * wall
        paint_picture(
            column, scene.atlas, material, left + shift, right + shift, right - left,
            top, bottom, above, step, -MAX_DEPTH_MM, MAX_DEPTH_MM, gain,
        )  # fmt: skip
    for panel in range(scene.first_panel[wall], scene.first_panel[wall + 1]):
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
    poses: Floats2, robot: int, people: Floats2, velocity: float, turn: float, sideways: float,
    scene: RenderedScene, lens: Lens, cx: float, cy: float, canvas: Canvas,
) -> None:  # fmt: skip
    """Draw all columns of a canvas, each as the mean of its rays.

    Args:
        poses: (robots, 3), x and y in mm, heading in degrees.
        robot: index of the robot with the camera.
        people: (people, 2), the positions of the people.
        velocity: speed of the robot, in mm/s.
        turn: turn rate of the robot, in degrees/s.
        sideways: speed of the robot to the left, in mm/s.
        scene: the scene.
        lens: the lens.
        cx: column of the optical axis; it lies between two pixels.
        cy: row of the optical axis.
        canvas: receives the columns.
    """
    columns, rows = canvas.picture.shape
    column, rays = canvas.column, lens.rays
    heading = math.radians(poses[robot, 2])
    half = 0.5 / (rays * lens.focal)
    canvas.picture[:] = 0.0
    for ray_index in range(rays):
        time_slot = (2 * ray_index + 2) % (
            rays + 1
        ) - 1  # rays are assigned to the exposure's time slots in a permuted order
        dt = lens.exposure * ((time_slot + 0.5) / rays - 0.5) if rays > 1 else 0.0
        x = poses[robot, 0] - velocity * dt * math.sin(heading) - sideways * dt * math.cos(heading)
        y = poses[robot, 1] + velocity * dt * math.cos(heading) - sideways * dt * math.sin(heading)
        view_heading = heading + math.radians(turn * dt) + lens.yaw
        eye = Eye(x, y, math.sin(view_heading), math.cos(view_heading), cy)
        count = _gather(eye, max(cx, columns - cx) / lens.focal, scene, canvas.candidates)
        for column_index in range(columns):
            right = (column_index + (ray_index + 0.5) / rays - cx) / lens.focal
            dx, dy = right * eye.cosine - eye.sine, right * eye.sine + eye.cosine
            ray = Ray(x, y, dx, dy, math.sqrt(1.0 + right * right), right, half)
            wall, depth = _cast_ray(ray, scene.walls, canvas.candidates, count)
            top = row_below(scene.ceiling, depth, cy, lens, rows)
            bottom = row_below(0.0, depth, cy, lens, rows)
            _paint_planes(column, top, bottom, ray, cy, lens, scene)
            if wall >= 0:
                _paint_wall(column, wall, depth, ray, eye, lens, scene)
            else:
                paint(column, top, bottom, 0.0)
            paint_bystanders(column, robot, poses, people, depth, ray, eye, lens, scene)
            for row in range(rows):
                canvas.picture[column_index, row] += column[row] / rays
