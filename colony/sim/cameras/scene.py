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
from colony.sim.cameras.atlas import Atlas, Picture
from colony.sim.cameras.fitting import scene_with_walls
from colony.sim.cameras.lettering import marker, plate
from colony.sim.cameras.lighting import lighting_of
from colony.sim.cameras.posters import SIGN_MM, extinguisher_sign, posters
from colony.sim.cameras.silhouettes import EXTINGUISHER_MM, extinguisher
from colony.sim.cameras.surfaces import CEILING_MM, PEOPLE, Panel, Scene, WallPicture, atlas_with, scene
from colony.sim.hazards.premises import premises_of
from colony.sim.hazards.scenery import Extinguisher, Poster, Scenery

_SKIRTING_MM, _SKIRTING_SHADE = 100.0, 0.35
_FRAME_MM, _FRAME_SHADE = 60.0, 0.30
_DOOR_MM = 2100.0
_LEAF_SHADES = {EdgeKind.DOOR: 0.48, EdgeKind.ELEVATOR: 0.62}
_GAP_MM, _GAP_SHADE = 4.0, 0.12  # half the gap between the leaves of an elevator
_CACHED_FLOORS = 4  # number of floors whose pictures are cached, 10 to 40 MB each
_CYLINDER_BOTTOM_MM, _SIGN_BOTTOM_MM = 560.0, 1320.0

_Painter = Callable[[float], Picture]

_COVERS: tuple[tuple[re.Pattern[str], _Painter], ...] = tuple(
    (re.compile(words, re.IGNORECASE), made)
    for words, made in (
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
"""Patterns of the remarks on walls with their materials; the first match applies."""


class _PictureSet(NamedTuple):
    """The pictures of a floor, and their numbers.

    They are the covers of the walls, plates by text, markers by code, the first poster, and others.
    """

    atlas: Atlas
    covers: tuple[int, ...]
    plates: dict[str, int]
    markers: dict[int, int]
    posters: int
    cylinder: int
    sign: int
    rooms: int


def scene_of(floor: Map, scenery: Scenery | None = None) -> Scene:
    """Return the scene of a map in one run, with its posters, lights, and open doors.

    Without a scenery all doors are shut, all lights are on, and there are only plates and markers.
    """
    walls, picture_set = walls_of(floor), _picture_set(floor)
    lights = premises_of(floor).lights if scenery is None else scenery.lights
    kinds = walls.kinds
    made = scene(
        walls.segments,
        _panels_of(walls),
        covers=picture_set.covers,
        wall_pictures=[
            *_signs(floor, picture_set),
            *(_furnishings(scenery, picture_set) if scenery is not None else ()),
        ],
        atlas=picture_set.atlas,
        lighting=lighting_of(walls.bounds, lights),
        doors=[edge for edge, kind in enumerate(kinds) if kind is EdgeKind.DOOR],
        elevators=[edge for edge, kind in enumerate(kinds) if kind is EdgeKind.ELEVATOR],
        rooms=picture_set.rooms,
    )
    if scenery is None:
        return made
    lengths = np.hypot(*(scenery.walls[:, 2:] - scenery.walls[:, :2]).T)
    return scene_with_walls(made, scenery.walls[lengths > 0.0])


@lru_cache(maxsize=_CACHED_FLOORS)
def _picture_set(floor: Map) -> _PictureSet:
    """Return the pictures of a floor only, because covers are large (3 MB each).

    They are cached, because experiments use the same floors repeatedly.
    """
    walls = walls_of(floor)
    pictures: list[Picture] = []

    def put(*more: Picture) -> int:
        pictures.extend(more)
        return PEOPLE + len(pictures) - len(more)

    materials = [_cover(walls, edge) for edge in range(len(walls.kinds))]
    covers = {made: put(made(CEILING_MM)) for made in dict.fromkeys(materials)}
    texts = dict.fromkeys(sign.text for sign in plates_of(floor))
    codes = dict.fromkeys(sign.code for sign in markers_of(floor))
    plates = {text: put(plate(text)) for text in texts}
    markers = {code: put(marker(code)) for code in codes}
    first, cylinder, sign = put(*posters()), put(extinguisher()), put(extinguisher_sign())
    rooms = put(textures.shelves(CEILING_MM))
    return _PictureSet(
        atlas=atlas_with(pictures), covers=tuple(covers[made] for made in materials),
        plates=plates, markers=markers, posters=first, cylinder=cylinder, sign=sign, rooms=rooms,
    )  # fmt: skip


def _cover(walls: Walls, edge: int) -> _Painter:
    """Return the painter of a wall's material.

    The remark on a door describes its leaf, unless the door is of glass; other doors are in plain walls.
    """
    is_leaf = walls.kinds[edge] is EdgeKind.DOOR and not walls.glass[edge]
    attribute = "" if is_leaf else walls.attributes[edge]
    return next(made for pattern, made in _COVERS if pattern.search(attribute))


def _panels_of(walls: Walls) -> Iterator[Panel]:
    lengths = np.hypot(*(walls.segments[:, 2:] - walls.segments[:, :2]).T).tolist()
    for edge, (kind, is_glass, length) in enumerate(zip(walls.kinds, walls.glass, lengths, strict=True)):
        yield from _panels(edge, kind, is_glass, length)


def _panels(wall: int, kind: EdgeKind, is_glass: bool, length: float) -> Iterable[Panel]:
    if kind is EdgeKind.WALL:
        yield Panel(wall, 0.0, length, 0.0, _SKIRTING_MM, _SKIRTING_SHADE)
        return
    if is_glass:
        yield Panel(wall, 0.0, _FRAME_MM, 0.0, _DOOR_MM, _FRAME_SHADE)
        yield Panel(wall, length - _FRAME_MM, length, 0.0, _DOOR_MM, _FRAME_SHADE)
        return
    yield Panel(wall, 0.0, length, 0.0, _DOOR_MM, _FRAME_SHADE)
    yield Panel(wall, _FRAME_MM, length - _FRAME_MM, 0.0, _DOOR_MM - _FRAME_MM, _LEAF_SHADES[kind])
    if kind is EdgeKind.ELEVATOR:
        middle = length / 2
        yield Panel(wall, middle - _GAP_MM, middle + _GAP_MM, 0.0, _DOOR_MM - _FRAME_MM, _GAP_SHADE)


def _signs(floor: Map, picture_set: _PictureSet) -> Iterator[WallPicture]:
    """Yield the plates and markers; a marker extends over both leaves of an elevator's doors."""
    for sign in plates_of(floor):
        yield _at_height(
            sign.edge, sign.start_mm, sign.end_mm, PLATE_HEIGHT_MM, picture_set.plates[sign.text]
        )
    for mark in markers_of(floor):
        yield _at_height(
            mark.edge, mark.start_mm, mark.end_mm, STRIPE_HEIGHT_MM, picture_set.markers[mark.code]
        )


def _at_height(wall: int, start: float, end: float, height_mm: float, picture: int) -> WallPicture:
    bottom, top = SIGN_HEIGHT_MM - height_mm / 2, SIGN_HEIGHT_MM + height_mm / 2
    return WallPicture(wall, start, end, bottom, top, picture, start)


def _furnishings(scenery: Scenery, picture_set: _PictureSet) -> Iterator[WallPicture]:
    for poster in scenery.posters:
        yield _poster(poster, picture_set)
    for item in scenery.extinguishers:
        yield from _extinguisher(item, picture_set)


def _poster(poster: Poster, picture_set: _PictureSet) -> WallPicture:
    picture = posters()[poster.kind]
    start, bottom = poster.start_mm, poster.middle_mm - picture.height_mm / 2
    end, top = start + picture.width_mm, bottom + picture.height_mm
    return WallPicture(poster.edge, start, end, bottom, top, picture_set.posters + poster.kind, start)


def _extinguisher(item: Extinguisher, picture_set: _PictureSet) -> Iterator[WallPicture]:
    for (wide, high), bottom, picture in (
        (EXTINGUISHER_MM, _CYLINDER_BOTTOM_MM, picture_set.cylinder),
        (SIGN_MM, _SIGN_BOTTOM_MM, picture_set.sign),
    ):
        start = item.along_mm - wide / 2
        yield WallPicture(item.edge, start, start + wide, bottom, bottom + high, picture, start)
