"""The scene of a map's walls, with the doors, signs and furnishings of one run.

Doors are in their frames with plates beside them; elevators have their markers; walls have posters and fire
extinguishers. The material of a wall comes from the map's remark on it: painted brick, brick, glass brick,
plaster, steel, glass, window, tile. A remark without a material stands for plaster.
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
from colony.sim.cameras.fitting import fitted
from colony.sim.cameras.lettering import marker, plate
from colony.sim.cameras.lighting import lighting_of
from colony.sim.cameras.posters import SIGN_MM, extinguisher_sign, posters
from colony.sim.cameras.silhouettes import EXTINGUISHER_MM, extinguisher
from colony.sim.cameras.surfaces import CEILING_MM, PEOPLE, Hung, Panel, Scene, atlas_with, scene
from colony.sim.hazards.premises import premises_of
from colony.sim.hazards.scenery import Extinguisher, Poster, Scenery

_SKIRTING_MM, _SKIRTING_SHADE = 100.0, 0.35
_FRAME_MM, _FRAME_SHADE = 60.0, 0.30
_DOOR_MM = 2100.0
_LEAF_SHADES = {EdgeKind.DOOR: 0.48, EdgeKind.ELEVATOR: 0.62}
_GAP_MM, _GAP_SHADE = 4.0, 0.12  # half the gap between the leaves of an elevator
_SHELVES = 4  # floors whose pictures are kept: 10 to 40 MB each
_CYLINDER_BOTTOM_MM, _SIGN_BOTTOM_MM = 560.0, 1320.0

_Made = Callable[[float], Picture]

_COVERS: tuple[tuple[re.Pattern[str], _Made], ...] = tuple(
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
"""Patterns of the remarks on walls, and their materials: the first that fits."""


class _Shelf(NamedTuple):
    """The pictures of a floor, by number.

    The cover of each wall, what hangs there, and the number of the first poster.
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
    """Return the scene of a map in one run: with its posters, its lights, and its doors open or shut.

    Without a scenery all doors are shut, all lights are on, and nothing hangs there but plates and markers.
    """
    walls, shelf = walls_of(floor), _shelf(floor)
    lights = premises_of(floor).lights if scenery is None else scenery.lights
    kinds = walls.kinds
    made = scene(
        walls.segments,
        _panels_of(walls),
        covers=shelf.covers,
        hung=[*_signs(floor, shelf), *(_furnishings(scenery, shelf) if scenery is not None else ())],
        atlas=shelf.atlas,
        lighting=lighting_of(walls.bounds, lights),
        doors=[edge for edge, kind in enumerate(kinds) if kind is EdgeKind.DOOR],
        elevators=[edge for edge, kind in enumerate(kinds) if kind is EdgeKind.ELEVATOR],
        rooms=shelf.rooms,
    )
    if scenery is None:
        return made
    lengths = np.hypot(*(scenery.walls[:, 2:] - scenery.walls[:, :2]).T)
    return fitted(made, scenery.walls[lengths > 0.0])


@lru_cache(maxsize=_SHELVES)
def _shelf(floor: Map) -> _Shelf:
    """Return the pictures of a floor, and no others, as covers are large: 3 MB each.

    They are cached, since experiments ask for the floors of a building again and again.
    """
    walls = walls_of(floor)
    pictures: list[Picture] = []

    def put(*more: Picture) -> int:
        pictures.extend(more)
        return PEOPLE + len(pictures) - len(more)

    looks = [_cover(walls, edge) for edge in range(len(walls.kinds))]
    covers = {made: put(made(CEILING_MM)) for made in dict.fromkeys(looks)}
    texts = dict.fromkeys(sign.text for sign in plates_of(floor))
    codes = dict.fromkeys(sign.code for sign in markers_of(floor))
    plates = {text: put(plate(text)) for text in texts}
    markers = {code: put(marker(code)) for code in codes}
    first, cylinder, sign = put(*posters()), put(extinguisher()), put(extinguisher_sign())
    rooms = put(textures.shelves(CEILING_MM))
    return _Shelf(
        atlas=atlas_with(pictures), covers=tuple(covers[made] for made in looks),
        plates=plates, markers=markers, posters=first, cylinder=cylinder, sign=sign, rooms=rooms,
    )  # fmt: skip


def _cover(walls: Walls, edge: int) -> _Made:
    """Return the painter of a wall's material.

    The remark on a door describes its leaf, unless it is of glass as a whole: other doors hang in plain
    walls.
    """
    is_leaf = walls.kinds[edge] is EdgeKind.DOOR and not walls.glass[edge]
    attribute = "" if is_leaf else walls.attributes[edge]
    return next(made for says, made in _COVERS if says.search(attribute))


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


def _signs(floor: Map, shelf: _Shelf) -> Iterator[Hung]:
    """Return the plates and markers; a marker's halves are on the two leaves, the gap between is shut."""
    for sign in plates_of(floor):
        yield _at_height(sign.edge, sign.start_mm, sign.end_mm, PLATE_HEIGHT_MM, shelf.plates[sign.text])
    for mark in markers_of(floor):
        yield _at_height(mark.edge, mark.start_mm, mark.end_mm, STRIPE_HEIGHT_MM, shelf.markers[mark.code])


def _at_height(wall: int, start: float, end: float, height_mm: float, picture: int) -> Hung:
    bottom, top = SIGN_HEIGHT_MM - height_mm / 2, SIGN_HEIGHT_MM + height_mm / 2
    return Hung(wall, start, end, bottom, top, picture, start)


def _furnishings(scenery: Scenery, shelf: _Shelf) -> Iterator[Hung]:
    for poster in scenery.posters:
        yield _poster(poster, shelf)
    for one in scenery.extinguishers:
        yield from _extinguisher(one, shelf)


def _poster(poster: Poster, shelf: _Shelf) -> Hung:
    picture = posters()[poster.kind]
    start, bottom = poster.start_mm, poster.middle_mm - picture.height_mm / 2
    end, top = start + picture.width_mm, bottom + picture.height_mm
    return Hung(poster.edge, start, end, bottom, top, shelf.posters + poster.kind, start)


def _extinguisher(one: Extinguisher, shelf: _Shelf) -> Iterator[Hung]:
    for (wide, high), bottom, picture in (
        (EXTINGUISHER_MM, _CYLINDER_BOTTOM_MM, shelf.cylinder),
        (SIGN_MM, _SIGN_BOTTOM_MM, shelf.sign),
    ):
        start = one.along_mm - wide / 2
        yield Hung(one.edge, start, start + wide, bottom, bottom + high, picture, start)
