"""Sides of rings: what lies between two corners."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.nav.maps.corridors import sides_of
from colony.nav.maps.stickrep.reader import load_map, read_map
from colony.text.source import Source
from tests.paths import MAPS


def test_a_side_goes_from_corner_to_corner_alcoves_aside() -> None:
    sides = sides_of(load_map(MAPS / "hallway.stickrep"))
    assert [len(side.edges) for side in sides] == [1, 11, 1, 7]
    north = sides[1]
    assert north.heading_deg == 270.0
    assert north.inset == pytest.approx(0.0, abs=1.0)
    assert (north.low, north.high) == pytest.approx((0.0, 24_994.0), abs=1.0)
    assert (north.turn_before, north.turn_after) == (-90.0, -90.0)
    assert north.right_of(sides[2].end) == pytest.approx(2997.0, abs=1.0)


def test_rings_without_named_corners_are_cut_where_they_turn() -> None:
    loop = load_map(MAPS / "loop.stickrep")
    unnamed = [
        replace(ring, nodes=tuple(replace(node, corner=False) for node in ring.nodes)) for ring in loop.rings
    ]
    sides = sides_of(replace(loop, rings=tuple(unnamed)))
    assert [sum(side.ring == ring for side in sides) for ring in (0, 1)] == [8, 4]


def test_the_line_of_a_side_is_where_most_of_it_is() -> None:
    text = (
        "stickrep 1\nmap m\nunit mm\nstart 2000 1000 0\nring r 0 0 0\n"
        "-270 a W 0 4000 w\n-270 b W 0 500 w\n270 c W 0 600 w\n"
        "90 d W 0 9000 w\n-270 e W 0 3400 w\n-270 f W 0 9500 w\n"
    )
    top = sides_of(read_map(Source("m", text)))[1]
    assert len(top.edges) == 3
    assert top.inset == pytest.approx(600.0)
    assert top.along(top.end) == pytest.approx(9500.0)
