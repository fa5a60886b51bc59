"""Random positions of posters and fire extinguishers: on walls, clear of plates and of each other."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from colony.nav.maps.signs import plates_of
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import walls_of
from colony.sim.cameras.atlas import BLACK_KINDS, OTHER_KINDS, POSTERS_MM
from colony.sim.cameras.surfaces import EXTINGUISHER_MM
from colony.sim.hazards.scenery import Extinguisher, Poster

_CLEARANCE_MM = 120.0
_POSTER_CENTER_MM = (1250.0, 1550.0)
_DOOR_POSTER_CENTER_MM = (1300.0, 1450.0)
_MAX_TRIES = 8

_PANE = re.compile(r"\b(glass|window)", re.IGNORECASE)  # nothing hangs on glass

_Span = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Spacings:
    """The mean length of wall in mm per black poster, other poster and fire extinguisher.

    `door_poster_probability` is that of a black poster on a door.
    """

    black_poster_mm: float
    poster_mm: float
    extinguisher_mm: float
    door_poster_probability: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Edge:
    """An edge on which posters and extinguishers may hang: its length and its occupied spans."""

    index: int
    length_mm: float
    occupied: tuple[_Span, ...]
    is_door: bool


def draw_furnishings(
    floor: Map, spacings: Spacings, stream: Callable[[int], np.random.Generator]
) -> tuple[tuple[Poster, ...], tuple[Extinguisher, ...]]:
    """Draw the posters and fire extinguishers of a floor; `stream` returns the generator of an edge."""
    posters: list[Poster] = []
    extinguishers: list[Extinguisher] = []
    for edge in _edges(floor):
        rng = stream(edge.index)
        if edge.is_door:
            posters += _door_posters(edge, spacings, rng)
            continue
        occupied = list(edge.occupied)
        extinguishers += _extinguishers(edge, spacings.extinguisher_mm, occupied, rng)
        for kinds, spacing in ((BLACK_KINDS, spacings.black_poster_mm), (OTHER_KINDS, spacings.poster_mm)):
            for _ in range(rng.poisson(edge.length_mm / spacing)):
                kind, center = int(rng.choice(kinds)), float(rng.uniform(*_POSTER_CENTER_MM))
                start = _reserve_span(edge.length_mm, POSTERS_MM[kind][0], occupied, rng)
                if start is not None:
                    posters.append(Poster(edge=edge.index, start_mm=start, center_mm=center, kind=kind))
    return tuple(posters), tuple(extinguishers)


@lru_cache(maxsize=16)
def _edges(floor: Map) -> tuple[_Edge, ...]:
    walls, plates = walls_of(floor), plates_of(floor)
    lengths = np.hypot(*(walls.segments[:, 2:] - walls.segments[:, :2]).T).tolist()
    return tuple(
        _Edge(
            index=index,
            length_mm=length,
            occupied=tuple((plate.start_mm, plate.end_mm) for plate in plates if plate.edge == index),
            is_door=kind is EdgeKind.DOOR,
        )
        for index, (kind, attribute, length) in enumerate(
            zip(walls.kinds, walls.attributes, lengths, strict=True)
        )
        if kind is not EdgeKind.ELEVATOR and not _PANE.search(attribute)
    )


def _door_posters(edge: _Edge, spacings: Spacings, rng: np.random.Generator) -> Iterator[Poster]:
    draw, center = rng.random(), float(rng.uniform(*_DOOR_POSTER_CENTER_MM))
    kind = int(rng.choice(BLACK_KINDS))
    free_mm = edge.length_mm - POSTERS_MM[kind][0]
    if draw < spacings.door_poster_probability and free_mm > 2 * _CLEARANCE_MM:
        yield Poster(edge=edge.index, start_mm=free_mm / 2, center_mm=center, kind=kind)


def _extinguishers(
    edge: _Edge, spacing: float, occupied: list[_Span], rng: np.random.Generator
) -> Iterator[Extinguisher]:
    width = EXTINGUISHER_MM[0]
    for _ in range(rng.poisson(edge.length_mm / spacing)):
        start = _reserve_span(edge.length_mm, width, occupied, rng)
        if start is not None:
            yield Extinguisher(edge=edge.index, along_mm=start + width / 2)


def _reserve_span(
    length: float, width: float, occupied: list[_Span], rng: np.random.Generator
) -> float | None:
    """Reserve a free span of this width, and return its start; None if a few tries find none."""
    free_mm = length - width - 2 * _CLEARANCE_MM
    if free_mm <= 0.0:
        return None
    for start in (_CLEARANCE_MM + free_mm * rng.random(_MAX_TRIES)).tolist():
        end = start + width
        if all(end + _CLEARANCE_MM <= low or high + _CLEARANCE_MM <= start for low, high in occupied):
            occupied.append((start, end))
            return float(start)
    return None
