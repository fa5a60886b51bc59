"""Random places of posters and fire extinguishers: on walls, clear of plates and of each other."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from colony.nav.maps.signs import plates_of
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import walls_of
from colony.sim.cameras.posters import BLACK_KINDS, OTHER_KINDS, POSTERS_MM
from colony.sim.cameras.silhouettes import EXTINGUISHER_MM
from colony.sim.hazards.scenery import Extinguisher, Poster

_CLEAR_MM = 120.0
_POSTER_MIDDLE_MM = (1250.0, 1550.0)
_ON_DOOR_MIDDLE_MM = (1300.0, 1450.0)
_TRIES = 8

_PANE = re.compile(r"\b(glass|window)", re.IGNORECASE)  # nothing hangs on glass

_Span = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Spacings:
    """The mean length of wall in mm per black poster, other poster and fire extinguisher.

    `on_door` is the probability that a door has a black poster.
    """

    black_poster_mm: float
    poster_mm: float
    extinguisher_mm: float
    on_door: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    """An edge for posters and extinguishers: its length, its occupied spans, and True if it is a door."""

    edge: int
    length_mm: float
    taken: tuple[_Span, ...]
    is_door: bool


def draw_furnishings(
    floor: Map, spacings: Spacings, stream: Callable[[int], np.random.Generator]
) -> tuple[tuple[Poster, ...], tuple[Extinguisher, ...]]:
    """Draw the posters and fire extinguishers of a floor; `stream` returns the generator of an edge."""
    wall_pictures: list[Poster] = []
    extinguishers: list[Extinguisher] = []
    for place in _places(floor):
        rng = stream(place.edge)
        if place.is_door:
            wall_pictures += _on_door(place, spacings, rng)
            continue
        taken = list(place.taken)
        extinguishers += _extinguishers(place, spacings.extinguisher_mm, taken, rng)
        for kinds, spacing in ((BLACK_KINDS, spacings.black_poster_mm), (OTHER_KINDS, spacings.poster_mm)):
            for _ in range(rng.poisson(place.length_mm / spacing)):
                kind, middle = int(rng.choice(kinds)), float(rng.uniform(*_POSTER_MIDDLE_MM))
                start = _take_free_place(place.length_mm, POSTERS_MM[kind][0], taken, rng)
                if start is not None:
                    wall_pictures.append(Poster(edge=place.edge, start_mm=start, middle_mm=middle, kind=kind))
    return tuple(wall_pictures), tuple(extinguishers)


@lru_cache(maxsize=16)
def _places(floor: Map) -> tuple[_Place, ...]:
    walls, plates = walls_of(floor), plates_of(floor)
    lengths = np.hypot(*(walls.segments[:, 2:] - walls.segments[:, :2]).T).tolist()
    return tuple(
        _Place(
            edge=edge,
            length_mm=length,
            taken=tuple((plate.start_mm, plate.end_mm) for plate in plates if plate.edge == edge),
            is_door=kind is EdgeKind.DOOR,
        )
        for edge, (kind, attribute, length) in enumerate(
            zip(walls.kinds, walls.attributes, lengths, strict=True)
        )
        if kind is not EdgeKind.ELEVATOR and not _PANE.search(attribute)
    )


def _on_door(place: _Place, spacings: Spacings, rng: np.random.Generator) -> Iterator[Poster]:
    drawn, middle = rng.random(), float(rng.uniform(*_ON_DOOR_MIDDLE_MM))
    kind = int(rng.choice(BLACK_KINDS))
    room = place.length_mm - POSTERS_MM[kind][0]
    if drawn < spacings.on_door and room > 2 * _CLEAR_MM:
        yield Poster(edge=place.edge, start_mm=room / 2, middle_mm=middle, kind=kind)


def _extinguishers(
    place: _Place, spacing: float, taken: list[_Span], rng: np.random.Generator
) -> Iterator[Extinguisher]:
    width = EXTINGUISHER_MM[0]
    for _ in range(rng.poisson(place.length_mm / spacing)):
        start = _take_free_place(place.length_mm, width, taken, rng)
        if start is not None:
            yield Extinguisher(edge=place.edge, along_mm=start + width / 2)


def _take_free_place(
    length: float, width: float, taken: list[_Span], rng: np.random.Generator
) -> float | None:
    """Occupy a free place of this width and return its start; None if a few tries find none."""
    room = length - width - 2 * _CLEAR_MM
    if room <= 0.0:
        return None
    for start in (_CLEAR_MM + room * rng.random(_TRIES)).tolist():
        end = start + width
        if all(end + _CLEAR_MM <= low or high + _CLEAR_MM <= start for low, high in taken):
            taken.append((start, end))
            return float(start)
    return None
