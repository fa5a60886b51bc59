"""The surfaces of a building: walls with everything on them, floor and ceiling, in shades of gray.

A wall has a material, such as painted blocks, or a uniform shade. On it are panels, rectangles of another
shade such as doors and skirting boards, and on top of them pictures: plates, markers, posters. `scene.py`
puts them on the edges of a map, and `fitting.py` removes or moves them while doors are open.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colony.sim.cameras.atlas import Atlas, AtlasPicture, atlas_of
from colony.sim.compiled import Floats, Floats2, Ints
from colony.sim.hazards.scenery import CeilingLight
from colony.sim.sensors.sonar import wall_table

# --- silhouettes --------------------------------------------------------------------------------------
#
# Pictures of people and fire extinguishers, transparent around their outlines.

PERSON_WIDTH_MM = 620.0
EXTINGUISHER_MM = (190.0, 560.0)
"""Width and height of a fire extinguisher."""

_TEXEL_MM = 5.0
_SHADES = (0.28, 0.34)  # red in shades of gray: the cylinder, and its highlight


class _PersonStyle(NamedTuple):
    height_mm: float
    coat: float
    legs: float
    skin: float
    hair: float
    skirt: bool


_PERSON_STYLES = (
    _PersonStyle(1780.0, 0.16, 0.24, 0.62, 0.12, False),
    _PersonStyle(1650.0, 0.55, 0.12, 0.68, 0.40, True),
    _PersonStyle(1860.0, 0.82, 0.30, 0.45, 0.08, False),
    _PersonStyle(1710.0, 0.36, 0.44, 0.58, 0.25, True),
)
PERSON_STYLES = len(_PERSON_STYLES)
"""Number of different people; each has two pictures, with legs together and apart."""

_Mask = NDArray[np.bool_]


@lru_cache(maxsize=1)
def people() -> tuple[AtlasPicture, ...]:
    """Return the pictures of people, numbered 2 * style + gait."""
    return tuple(_person(style, stride) for style in _PERSON_STYLES for stride in (0.0, 1.0))


def _person(style: _PersonStyle, stride: float) -> AtlasPicture:
    """Draw a person from the front: `stride` is 0 with the legs together, 1 with the legs apart."""
    rows, columns = round(style.height_mm / _TEXEL_MM), round(PERSON_WIDTH_MM / _TEXEL_MM)
    aside = (np.arange(columns) + 0.5) * _TEXEL_MM - PERSON_WIDTH_MM / 2
    x, y = np.meshgrid(aside, (rows - 0.5 - np.arange(rows)) * _TEXEL_MM / style.height_mm)
    shades, opacity = np.zeros_like(x), np.zeros(x.shape, dtype=np.bool_)

    def put(mask: _Mask, shade: float) -> None:
        shades[mask] = shade * (1.0 - 0.25 * np.minimum(np.abs(x[mask]) / 260.0, 1.0))
        opacity[mask] = True

    legs = (y < 0.50) & (np.abs(np.abs(x) - 75.0 - 90.0 * stride * (0.5 - y)) < 62.0 + 30.0 * y)
    put(legs & (y > 0.03), style.legs)
    put((y <= 0.045) & legs, 0.08)  # shoes
    hem = 0.28 if style.skirt else 0.42
    put((y >= hem) & (y < 0.83) & (np.abs(x) < _torso(y)), style.coat)
    arms = (np.abs(np.abs(x) - 245.0 - 20.0 * stride * (0.8 - y)) < 45.0) & (y > 0.42) & (y < 0.80)
    put(arms, style.coat * 0.85)
    hands = (np.abs(np.abs(x) - 250.0 - 8.0 * stride) < 38.0) & (y > 0.385) & (y <= 0.42)
    put(hands, style.skin)
    put((y >= 0.81) & (y < 0.88) & (np.abs(x) < 55.0), style.skin * 0.85)
    head = (x / 80.0) ** 2 + ((y - 0.93) / 0.07) ** 2 < 1.0
    put(head, style.skin)
    put(head & (y > 0.955 - 0.02 * np.abs(x) / 80.0), style.hair)
    return AtlasPicture(
        shades=np.clip(shades, 0.02, 1.0), opacity=opacity.astype(np.float64),
        width_mm=PERSON_WIDTH_MM, height_mm=rows * _TEXEL_MM,
    )  # fmt: skip


def _torso(y: Floats2) -> Floats2:
    """Return half the width of a coat at a fraction of the height: shoulders, waist, hem."""
    return np.interp(y, [0.28, 0.42, 0.62, 0.78, 0.81, 0.83], [215.0, 190.0, 165.0, 220.0, 190.0, 90.0])


@lru_cache(maxsize=1)
def extinguisher() -> AtlasPicture:
    """Draw a red cylinder with a black valve, a hose and a pale label."""
    wide, high = EXTINGUISHER_MM
    columns, rows = round(wide / _TEXEL_MM), round(high / _TEXEL_MM)
    x, y = np.meshgrid(
        (np.arange(columns) + 0.5) * _TEXEL_MM - wide / 2, (rows - 0.5 - np.arange(rows)) * _TEXEL_MM
    )
    roundness = np.sqrt(np.clip(1.0 - (x / 75.0) ** 2, 0.0, 1.0))
    body = (np.abs(x) < 75.0) & (y < 400.0 + 55.0 * roundness)
    shades = np.where(np.abs(x + 25.0) < 12.0, _SHADES[1] + 0.15, _SHADES[0] * (0.45 + 0.55 * roundness))
    shades = np.where((np.abs(x) < 55.0) & (y > 150.0) & (y < 270.0), 0.75 * roundness, shades)
    valve = (np.abs(x) < 28.0) & (y >= 440.0) & (y < 530.0) | (np.abs(x) < 70.0) & (np.abs(y - 525.0) < 14.0)
    hose = (np.abs(x - 84.0) < 9.0) & (y > 120.0) & (y < 500.0) | (x > 20.0) & (np.abs(y - 495.0) < 9.0)
    dark = valve | hose
    return AtlasPicture(
        shades=np.where(dark, 0.07, shades), opacity=(body | dark).astype(np.float64),
        width_mm=wide, height_mm=high,
    )  # fmt: skip


# --- surfaces -----------------------------------------------------------------------------------------

CEILING_MM = 2700.0
WALL_SHADE = 0.78
BARE = -1
"""Material of a wall with a uniform shade."""


class WallPanel(NamedTuple):
    """A rectangle on wall `wall`, from `start` to `end` along it and from `bottom` to `top` in height.

    Lengths are in mm, heights above the floor. `shade` is from 0 (black) to 1.
    """

    wall: int
    start: float
    end: float
    bottom: float
    top: float
    shade: float


class WallPicture(NamedTuple):
    """A picture on wall `wall`, from `start` to `end` along it and from `bottom` to `top` in height.

    This is the visible part; the whole picture begins at `origin` along the wall and reaches up to `top`.
    """

    wall: int
    start: float
    end: float
    bottom: float
    top: float
    picture: int
    origin: float


class Lighting(NamedTuple):
    """The light levels of a building at the corners of a grid, by columns; 1 is normal.

    The first corner is at (x, y); the corners are `cell` mm apart.
    """

    levels: Floats2
    x: float
    y: float
    cell: float


EVEN_LIGHTING = Lighting(levels=np.ones((1, 1)), x=0.0, y=0.0, cell=1.0)
"""Uniform light."""


class RenderedScene(NamedTuple):
    """A building in the renderer's form.

    Attributes:
        walls: (n, 7), from `wall_table`.
        present: (n,), 1 if the wall is present, 0 if an open door has replaced it.
        shades: (n,), from 0 to 1.
        materials: (n,), the index in `atlas` of each wall's material, or `BARE`.
        panels: (m, 5), `WallPanel` without its wall, in the order of the walls; later ones hide earlier ones.
        first_panel: (n + 1,), start of the panels of each wall.
        wall_pictures: (k, 6), `WallPicture` without its wall, in the order of the walls.
        first_wall_picture: (n + 1,), start of the pictures of each wall.
        atlas: the pictures; the first ones are people.
        lighting: the light levels.
        ceiling: height of the ceiling in mm.
        doors, elevators: the indices of the walls that are doors or elevators, which may open.
        room_material: the material of the walls of rooms behind open doors, or `BARE`.
        map_wall_count: number of walls of the map; the walls after them come from open doors.
    """

    walls: Floats2
    present: Ints
    shades: Floats
    materials: Ints
    panels: Floats2
    first_panel: Ints
    wall_pictures: Floats2
    first_wall_picture: Ints
    atlas: Atlas
    lighting: Lighting
    ceiling: float
    doors: Ints
    elevators: Ints
    room_material: int
    map_wall_count: int


def scene(
    walls: ArrayLike,
    panels: Iterable[WallPanel] = (),
    *,
    ceiling_mm: float = CEILING_MM,
    materials: Sequence[int] | None = None,
    wall_pictures: Iterable[WallPicture] = (),
    atlas: Atlas | None = None,
    lighting: Lighting = EVEN_LIGHTING,
    doors: Sequence[int] = (),
    elevators: Sequence[int] = (),
    room_material: int = BARE,
) -> RenderedScene:
    """Return a scene of wall segments, (n, 4) in mm, and everything on them; empty segments are invisible.

    Args:
        walls: the segments.
        panels: the panels on them.
        ceiling_mm: height of the ceiling.
        materials: index of each wall's material in `atlas`; by default all walls are bare.
        wall_pictures: the pictures on the walls.
        atlas: the atlas, from `atlas_with`.
        lighting: the light levels.
        doors: the indices of the walls that are doors, which may open.
        elevators: the indices of the walls that are elevator doors, which may open.
        room_material: the material of the walls of rooms behind doors.
    """
    segments = np.array(walls, dtype=np.float64).reshape(-1, 4)
    visible = np.flatnonzero(np.hypot(*(segments[:, 2:] - segments[:, :2]).T) > 0.0)
    indices = {int(wall): index for index, wall in enumerate(visible)}
    panel_rows, first_panel = _sorted_by_wall(
        ((indices[panel.wall], panel[1:]) for panel in panels if panel.wall in indices), len(visible)
    )
    picture_rows, first_wall_picture = _sorted_by_wall(
        ((indices[picture.wall], picture[1:]) for picture in wall_pictures if picture.wall in indices),
        len(visible),
    )
    material_indices = (
        np.full(len(segments), BARE) if materials is None else np.array(materials, dtype=np.int64)
    )
    return RenderedScene(
        walls=wall_table(segments[visible]),
        present=np.ones(len(visible), dtype=np.int64),
        shades=np.full(len(visible), WALL_SHADE),
        materials=material_indices[visible],
        panels=panel_rows.reshape(-1, 5),
        first_panel=first_panel,
        wall_pictures=picture_rows.reshape(-1, 6),
        first_wall_picture=first_wall_picture,
        atlas=atlas_with(()) if atlas is None else atlas,
        lighting=lighting,
        ceiling=float(ceiling_mm),
        doors=_index_array(indices[door] for door in doors if door in indices),
        elevators=_index_array(indices[elevator] for elevator in elevators if elevator in indices),
        room_material=room_material,
        map_wall_count=len(visible),
    )


def atlas_with(pictures: Sequence[AtlasPicture]) -> Atlas:
    """Return an atlas of people and of `pictures`, whose indices begin at `PEOPLE`."""
    return atlas_of((*people(), *pictures))


PEOPLE = len(people())
"""Number of pictures of people with which an atlas begins."""


def _index_array(indices: Iterable[int]) -> Ints:
    return np.array(list(indices), dtype=np.int64)


def _sorted_by_wall(rows: Iterable[tuple[int, tuple[float, ...]]], walls: int) -> tuple[Floats2, Ints]:
    """Return rows sorted by the index of their wall, and the start of each wall's rows."""
    ordered = sorted(rows, key=lambda row: row[0])
    counts = np.bincount(np.array([wall for wall, _ in ordered], dtype=np.int64), minlength=walls)
    first = np.concatenate([[0], counts.cumsum()]).astype(np.int64)
    return np.array([row for _, row in ordered], dtype=np.float64), first


# --- lighting -----------------------------------------------------------------------------------------
#
# The lighting of a building: brighter under ceiling lights, darker where one is out.

_CELL_MM = 500.0
_AMBIENT, _LIGHT_GAIN, _REACH_MM, _MAX_LEVEL = 0.90, 0.45, 2500.0, 1.50
_WINDOW_MM = 3.0 * _REACH_MM


def lighting_of(bounds: tuple[float, float, float, float], lights: Iterable[CeilingLight]) -> Lighting:
    """Return the light levels within bounds (minimum x and y, maximum x and y, in mm)."""
    x0, y0, x1, y1 = bounds
    columns, rows = (max(math.ceil(size / _CELL_MM) + 1, 1) for size in (x1 - x0, y1 - y0))
    levels = np.full((columns, rows), _AMBIENT)
    x, y = (np.arange(count, dtype=np.float64) for count in (columns, rows))
    x, y = x * _CELL_MM + x0, y * _CELL_MM + y0
    for light in lights:
        across = _window(x, light.x_mm)
        along = _window(y, light.y_mm)
        dx, dy = x[across] - light.x_mm, y[along] - light.y_mm
        squared = dx[:, None] ** 2 + dy[None, :] ** 2
        levels[across, along] += light.brightness * _LIGHT_GAIN * np.exp(-squared / _REACH_MM**2)
    return Lighting(levels=np.minimum(levels, _MAX_LEVEL), x=x0, y=y0, cell=_CELL_MM)


def _window(coordinates: Floats, center: float) -> slice:
    """Return the range of the coordinates that a light at `center` brightens."""
    first, last = np.searchsorted(coordinates, (center - _WINDOW_MM, center + _WINDOW_MM)).tolist()
    return slice(first, last)
