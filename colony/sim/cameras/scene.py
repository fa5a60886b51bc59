"""The scene of a map's walls, with the doors, signs and furnishings of one run.

Doors have frames, and plates beside them; elevators have markers; walls have posters and fire extinguishers.
The map's remark on a wall gives its material: painted brick, brick, glass brick, plaster, steel, glass,
window, tile. The default is plaster.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from colony.nav.maps.signs import PLATE_HEIGHT_MM, SIGN_HEIGHT_MM, STRIPE_HEIGHT_MM, markers_of, plates_of
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import Walls, walls_of
from colony.sim.cameras import textures
from colony.sim.cameras.atlas import SIGN_MM, Atlas, AtlasPicture, extinguisher_sign, marker, plate, posters
from colony.sim.cameras.fitting import scene_with_walls
from colony.sim.cameras.surfaces import (
    CEILING_MM,
    EXTINGUISHER_MM,
    PEOPLE,
    RenderedScene,
    WallPanel,
    WallPicture,
    atlas_with,
    extinguisher,
    lighting_of,
    scene,
)
from colony.sim.hazards.premises import premises_of
from colony.sim.hazards.scenery import Extinguisher, Poster, Scenery

_SKIRTING_MM, _SKIRTING_SHADE = 100.0, 0.35
_FRAME_MM, _FRAME_SHADE = 60.0, 0.30
_DOOR_MM = 2100.0
_LEAF_SHADES = {EdgeKind.DOOR: 0.48, EdgeKind.ELEVATOR: 0.62}
_GAP_MM, _GAP_SHADE = 4.0, 0.12  # half the gap between the leaves of an elevator
_CACHED_FLOORS = 4  # maximum number of floors whose pictures are cached, 10 to 40 MB each
_CYLINDER_BOTTOM_MM, _SIGN_BOTTOM_MM = 560.0, 1320.0

_Painter = Callable[[float], AtlasPicture]

_MATERIALS: tuple[tuple[re.Pattern[str], _Painter], ...] = tuple(
    (re.compile(words, re.IGNORECASE), painter)
    for words, painter in (
        (r"\bglass[ -]?(brick|block)s?\b", textures.glass_brick),
        (r"\bglass\b", textures.glass),
        (r"\bwindows?\b", textures.window),
        (r"\bpainted[ -]?(brick|block)s?\b", textures.painted_brick),
        (r"\b(brick|block)s?\b", textures.bare_brick),
        (r"\b(steel|metal)\b", textures.steel),
        (r"\b(tiles?|marble|sandstone|stone)\b", textures.tile),
        (r"", textures.plaster),
    )
)
"""Patterns of the map's remarks on walls, with the painters of the materials; the first match applies."""


class _PictureSet(NamedTuple):
    """The pictures of a floor, and their indices in the atlas.

    Attributes:
        atlas: the pictures.
        materials: the material of each wall.
        plates: the plates by text.
        markers: the markers by code.
        first_poster: the first kind of poster; the others follow.
        cylinder, sign: a fire extinguisher, and the sign above it.
        room_material: the material of the walls of rooms.
    """

    atlas: Atlas
    materials: tuple[int, ...]
    plates: dict[str, int]
    markers: dict[int, int]
    first_poster: int
    cylinder: int
    sign: int
    room_material: int


def scene_of(floor: Map, scenery: Scenery | None = None) -> RenderedScene:
    """Return the scene of a map in one run, with its posters, lights, and open doors.

    Without a scenery all doors are shut, all lights are on, and there are only plates and markers.
    """
    walls, picture_set = walls_of(floor), _picture_set(floor)
    lights = premises_of(floor).lights if scenery is None else scenery.lights
    kinds = walls.kinds
    result = scene(
        walls.segments,
        _panels_of(walls),
        materials=picture_set.materials,
        wall_pictures=[
            *_signs(floor, picture_set),
            *(_furnishings(scenery, picture_set) if scenery is not None else ()),
        ],
        atlas=picture_set.atlas,
        lighting=lighting_of(walls.bounds, lights),
        doors=[edge for edge, kind in enumerate(kinds) if kind is EdgeKind.DOOR],
        elevators=[edge for edge, kind in enumerate(kinds) if kind is EdgeKind.ELEVATOR],
        room_material=picture_set.room_material,
    )
    if scenery is None:
        return result
    lengths = np.hypot(*(scenery.walls[:, 2:] - scenery.walls[:, :2]).T)
    return scene_with_walls(result, scenery.walls[lengths > 0.0])


@lru_cache(maxsize=_CACHED_FLOORS)
def _picture_set(floor: Map) -> _PictureSet:
    """Return only the pictures that a floor needs, because materials are large (3 MB each).

    They are cached, because experiments use the same floors repeatedly.
    """
    walls = walls_of(floor)
    pictures: list[AtlasPicture] = []

    def add(*new: AtlasPicture) -> int:
        pictures.extend(new)
        return PEOPLE + len(pictures) - len(new)

    painters = [_painter(walls, edge) for edge in range(len(walls.kinds))]
    materials = {painter: add(painter(CEILING_MM)) for painter in dict.fromkeys(painters)}
    texts = dict.fromkeys(sign.text for sign in plates_of(floor))
    codes = dict.fromkeys(sign.code for sign in markers_of(floor))
    plates = {text: add(plate(text)) for text in texts}
    markers = {code: add(marker(code)) for code in codes}
    first_poster, cylinder, sign = add(*posters()), add(extinguisher()), add(extinguisher_sign())
    room_material = add(textures.shelves(CEILING_MM))
    return _PictureSet(
        atlas=atlas_with(pictures), materials=tuple(materials[painter] for painter in painters),
        plates=plates, markers=markers, first_poster=first_poster, cylinder=cylinder, sign=sign,
        room_material=room_material,
    )  # fmt: skip


def _painter(walls: Walls, edge: int) -> _Painter:
    """Return the painter of a wall's material.

    The remark on a door describes the door itself, so the wall around it is plaster; only the remark on a
    glass door gives the material.
    """
    is_solid_door = walls.kinds[edge] is EdgeKind.DOOR and not walls.glass[edge]
    attribute = "" if is_solid_door else walls.attributes[edge]
    return next(painter for pattern, painter in _MATERIALS if pattern.search(attribute))


def _panels_of(walls: Walls) -> Iterator[WallPanel]:
    lengths = np.hypot(*(walls.segments[:, 2:] - walls.segments[:, :2]).T).tolist()
    for edge, (kind, is_glass, length) in enumerate(zip(walls.kinds, walls.glass, lengths, strict=True)):
        yield from _panels(edge, kind, is_glass, length)


def _panels(wall: int, kind: EdgeKind, is_glass: bool, length: float) -> Iterable[WallPanel]:
    if kind is EdgeKind.WALL:
        yield WallPanel(wall, 0.0, length, 0.0, _SKIRTING_MM, _SKIRTING_SHADE)
        return
    if is_glass:
        yield WallPanel(wall, 0.0, _FRAME_MM, 0.0, _DOOR_MM, _FRAME_SHADE)
        yield WallPanel(wall, length - _FRAME_MM, length, 0.0, _DOOR_MM, _FRAME_SHADE)
        return
    yield WallPanel(wall, 0.0, length, 0.0, _DOOR_MM, _FRAME_SHADE)
    yield WallPanel(wall, _FRAME_MM, length - _FRAME_MM, 0.0, _DOOR_MM - _FRAME_MM, _LEAF_SHADES[kind])
    if kind is EdgeKind.ELEVATOR:
        center = length / 2
        yield WallPanel(wall, center - _GAP_MM, center + _GAP_MM, 0.0, _DOOR_MM - _FRAME_MM, _GAP_SHADE)


def _signs(floor: Map, picture_set: _PictureSet) -> Iterator[WallPicture]:
    """Yield the plates and markers; a marker extends over both leaves of an elevator's doors."""
    for sign in plates_of(floor):
        yield _sign_picture(
            sign.edge, sign.start_mm, sign.end_mm, PLATE_HEIGHT_MM, picture_set.plates[sign.text]
        )
    for mark in markers_of(floor):
        yield _sign_picture(
            mark.edge, mark.start_mm, mark.end_mm, STRIPE_HEIGHT_MM, picture_set.markers[mark.code]
        )


def _sign_picture(wall: int, start: float, end: float, height_mm: float, picture: int) -> WallPicture:
    bottom, top = SIGN_HEIGHT_MM - height_mm / 2, SIGN_HEIGHT_MM + height_mm / 2
    return WallPicture(wall, start, end, bottom, top, picture, start)


def _furnishings(scenery: Scenery, picture_set: _PictureSet) -> Iterator[WallPicture]:
    for poster in scenery.posters:
        yield _poster(poster, picture_set)
    for item in scenery.extinguishers:
        yield from _extinguisher(item, picture_set)


def _poster(poster: Poster, picture_set: _PictureSet) -> WallPicture:
    picture = posters()[poster.kind]
    start, bottom = poster.start_mm, poster.center_mm - picture.height_mm / 2
    end, top = start + picture.width_mm, bottom + picture.height_mm
    return WallPicture(poster.edge, start, end, bottom, top, picture_set.first_poster + poster.kind, start)


def _extinguisher(item: Extinguisher, picture_set: _PictureSet) -> Iterator[WallPicture]:
    for (width, height), bottom, picture in (
        (EXTINGUISHER_MM, _CYLINDER_BOTTOM_MM, picture_set.cylinder),
        (SIGN_MM, _SIGN_BOTTOM_MM, picture_set.sign),
    ):
        start = item.along_mm - width / 2
        yield WallPicture(item.edge, start, start + width, bottom, bottom + height, picture, start)
