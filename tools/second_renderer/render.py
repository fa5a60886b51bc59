"""From a scene to a picture of a camera, and where in it the targets are."""

from __future__ import annotations

import math
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from tools.second_renderer.scenes import Scene, View
from tools.second_renderer.stage import Target

FIELD_DEG = 60.0
"""The full angle that the columns see."""

ACROSS_DEG = 48.0
"""The full angle that the rows of the ceiling's camera see; its pixels are no squares."""

_MOMENTS = 3
"""How many times within an exposure a moving camera is asked what it sees."""

_SAMPLES_A_SIDE = 8  # even, so that none is in the gap between the two leaves of a door
Gray = NDArray[np.uint8]


def render(scene: Scene, *, seed: int, samples: int) -> tuple[Gray, list[dict[str, Any]]]:
    """The picture, 8 bits a pixel, and its targets.

    The scene is the same each time, and so is where everything is; the noise of the paths is not, as Mitsuba
    puts the lamps of a scene in an order of its own. A target's corners are columns and rows of the image,
    pixel i reaching from i - 0.5 to i + 0.5; `visible` is the part of it that is inside the image with
    nothing before it.
    """
    view = scene.view
    world = _world(scene)
    light = np.zeros(_film_size(view)[::-1])
    for moment in range(_MOMENTS):
        shift = view.travel * (moment / (_MOMENTS - 1) - 0.5)
        sensor = mi.load_dict(_sensor(view, shift, max(samples // _MOMENTS, 1)))
        traced = np.array(
            mi.render(world, sensor=sensor, seed=mi.UInt32(seed * _MOMENTS + moment)), dtype=np.float64
        )
        # One path in thousands meets a lamp by chance after a mirror: a spark that no camera would see.
        light += np.minimum(traced @ (0.2126, 0.7152, 0.0722), 12.0) / _MOMENTS
    picture = _developed(light, view, np.random.default_rng([seed, 4]))
    return picture, _targets(scene, world)


def truth(scene: Scene) -> list[dict[str, Any]]:
    """The targets of a scene that are in its picture, without rendering it."""
    return _targets(scene, _world(scene))


def _world(scene: Scene) -> Any:
    parts = {**scene.stage.parts, "type": "scene", "integrator": {"type": "path", "max_depth": 3}}
    return mi.load_dict(parts)


def _targets(scene: Scene, world: Any) -> list[dict[str, Any]]:
    described = (_described(target, scene.view, world) for target in scene.stage.targets)
    return [target for target in described if target is not None]


def _film_size(view: View) -> tuple[int, int]:
    columns, rows = view.size
    if view.kind == "ceiling":
        rows = round(columns * math.tan(math.radians(ACROSS_DEG / 2)) / math.tan(math.radians(FIELD_DEG / 2)))
    return columns, rows


def _sensor(view: View, shift: float, samples: int) -> dict[str, Any]:
    columns, rows = _film_size(view)
    x, y, z = view.place
    origin = [x, y + shift, z]
    target = [o + a for o, a in zip(origin, view.ahead, strict=True)]
    return {
        "type": "thinlens", "fov": FIELD_DEG, "fov_axis": "x",
        "aperture_radius": view.aperture, "focus_distance": view.focus, "near_clip": 0.01,
        "to_world": mi.ScalarTransform4f().look_at(origin, target, list(view.up)),
        "film": {"type": "hdrfilm", "width": columns, "height": rows, "pixel_format": "rgb"},
        "sampler": {"type": "multijitter", "sample_count": samples},
    }  # fmt: skip


def _developed(light: NDArray[np.float64], view: View, rng: np.random.Generator) -> Gray:
    """What a camera makes of the light: its exposure, a darker rim, its gamma, noise, 8 bits."""
    from PIL import Image

    rows, columns = light.shape
    across, down = np.meshgrid(
        np.linspace(-1, 1, columns), np.linspace(-rows / columns, rows / columns, rows)
    )
    light = light * (1.0 - rng.uniform(0.0, 0.25) * (across**2 + down**2))
    bright = float(np.percentile(light, 95.0))
    level = 2.0 if view.kind == "ceiling" and bright > 3.0 * np.median(light) else rng.uniform(0.35, 1.1)
    exposed = np.clip(light * level / max(bright, 1e-4), 0.0, 1.0)
    encoded = 255.0 * np.where(exposed <= 0.0031308, 12.92 * exposed, 1.055 * exposed ** (1 / 2.4) - 0.055)
    if view.kind == "ceiling":
        stretched = Image.fromarray(encoded[::-1].astype(np.float32)).resize(view.size, Image.Resampling.BOX)
        encoded = np.asarray(stretched, dtype=np.float64)
    noisy = encoded + rng.normal(0.0, rng.uniform(0.5, 2.5), encoded.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _described(target: Target, view: View, world: Any) -> dict[str, Any] | None:
    """A target as truth.json has it; None where none of it is in the image."""
    corners = [_seen_at(corner, view) for corner in target.corners]
    if any(corner is None for corner in corners):
        return None
    columns, rows = view.size
    top_left, top_right, _, bottom_left = target.corners
    steps = (np.arange(_SAMPLES_A_SIDE) + 0.5) / _SAMPLES_A_SIDE
    visible = 0
    for u in steps:
        for v in steps:
            point = top_left + u * (top_right - top_left) + v * (bottom_left - top_left)
            seen = _seen_at(point, view)
            inside = seen is not None and -0.5 <= seen[0] < columns - 0.5 and -0.5 <= seen[1] < rows - 0.5
            visible += inside and _unhidden(point, view, world)
    if visible == 0:
        return None
    placed = [[round(c, 2), round(r, 2)] for c, r in (corner for corner in corners if corner is not None)]
    key = {"plate": "text", "marker": "code", "light": "on"}[target.kind]
    part = round(visible / _SAMPLES_A_SIDE**2, 3)
    inside = all(-0.5 <= c <= columns - 0.5 and -0.5 <= r <= rows - 0.5 for c, r in placed)
    return {"kind": target.kind, key: target.label, "corners": placed, "visible": part,
            "whole": inside and part == 1.0}  # fmt: skip


def _seen_at(point: NDArray[np.float64], view: View) -> tuple[float, float] | None:
    """In which column and row a point is seen; None where it is beside or behind the camera."""
    ahead, up = np.array(view.ahead), np.array(view.up)
    offset = point - np.array(view.place)
    depth = float(offset @ ahead)
    if depth < 0.05:
        return None
    columns, rows = view.size
    focal = columns / 2.0 / math.tan(math.radians(FIELD_DEG) / 2.0)
    column = (columns - 1) / 2.0 + focal * float(offset @ np.cross(ahead, up)) / depth
    down = -float(offset @ up) / depth
    if view.kind == "ceiling":
        return column, (rows - 1) / 2.0 - rows / 2.0 / math.tan(math.radians(ACROSS_DEG) / 2.0) * down
    return column, (rows - 1) / 2.0 + focal * down


def _unhidden(point: NDArray[np.float64], view: View, world: Any) -> bool:
    """Whether nothing is between the camera and a point of a surface."""
    way = point - np.array(view.place)
    length = float(np.linalg.norm(way))
    hit = world.ray_intersect(mi.Ray3f(mi.Point3f(*view.place), mi.Vector3f(*(way / length))))
    return bool(hit.is_valid()) and abs(float(hit.t) - length) < 0.004
