"""Small maps, and a hypothesis strategy for sound ones."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import get_args

from hypothesis import strategies as st

from colony.nav.maps.stickrep.fields import LENGTH_UNITS
from colony.nav.maps.stickrep.model import (
    Edge,
    EdgeKind,
    LightOffsets,
    Map,
    MapLight,
    MapNode,
    Pose,
    Ring,
    Travel,
)

HEADER = "stickrep 1\nmap room\nstart 50 50 0\n"
ROOM = HEADER + (
    "ring outline 0 0 0\n"
    "-270 A W 0 100 brick\n"
    "-270 B W 1 60 120 brick\n"
    "-270 C D 0 100 glass\n"
    "-270 D W 0 120 brick\n"
)
"""A room of 120 by 100 inches, its first node in the southwest corner."""

names = st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.'-]{0,8}", fullmatch=True)
attributes = st.lists(st.from_regex(r"[!-\"$-~]{1,8}", fullmatch=True), max_size=3).map(" ".join)


@st.composite
def sound_maps(draw: st.DrawFn) -> Map:
    """An outline, a polygon around a circle, sometimes with a block in it, with doors, lights and remarks.

    Lengths are in millimeters, far more precise than a file, so that closing the rings is not trivial.
    """
    radius = draw(st.floats(3_000.0, 50_000.0))
    sizes = [draw(st.integers(3, 7))]
    if draw(st.booleans()):
        sizes.append(draw(st.integers(3, 5)))
    unique = iter(draw(st.lists(names, min_size=sum(sizes), max_size=sum(sizes), unique=True)))
    rings = [_polygon(draw, unique, size, radius / 8**k, clockwise=k == 0) for k, size in enumerate(sizes)]
    return Map(
        name=draw(names),
        start=Pose(0.0, radius * 0.4, draw(st.floats(0.0, 360.0, exclude_max=True))),
        rings=tuple(replace(ring, name=f"ring{k}") for k, ring in enumerate(rings)),
        tolerance_mm=draw(st.floats(1.0, 100.0)),
        unit=draw(st.sampled_from(sorted(LENGTH_UNITS))),
        light_offsets=draw(st.sampled_from(get_args(LightOffsets))),
        floor=draw(names),
        travel=draw(st.sampled_from(get_args(Travel))),
    )


def _polygon(draw: st.DrawFn, unique: Iterator[str], size: int, radius: float, clockwise: bool) -> Ring:
    """A regular polygon around the origin."""
    side, turn = 2.0 * radius * math.sin(math.pi / size), 360.0 / size
    angle = 180.0 + turn if clockwise else 180.0 - turn
    nodes = tuple(
        MapNode(name=next(unique), angle_deg=angle, corner=draw(st.booleans())) for _ in range(size)
    )
    edges = tuple(_edge(draw, side) for _ in range(size))
    heading = 270.0 - turn / 2 if clockwise else 90.0 + turn / 2
    return Ring(name="", start=Pose(0.0, radius, heading), nodes=nodes, edges=edges)


def _edge(draw: st.DrawFn, length: float) -> Edge:
    offsets = sorted(draw(st.lists(st.floats(0.0, length), max_size=3)))
    return Edge(
        kind=draw(st.sampled_from(EdgeKind)),
        length_mm=length,
        counted=draw(st.booleans()),
        lights=tuple(MapLight(offset_mm=offset) for offset in offsets),
        attribute=draw(attributes),
    )
