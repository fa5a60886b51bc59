from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings

from colony.nav.maps.stickrep.geometry import (
    corners,
    direction,
    in_free_space,
    projections,
    shared_lights,
    trace,
)
from colony.nav.maps.stickrep.model import Edge, EdgeKind, Map, MapLight, Ring
from colony.nav.maps.stickrep.reader import read_map
from colony.text.source import Source
from tests.nav.maps.small_maps import ROOM, sound_maps

INCH = 25.4


@pytest.fixture
def room() -> Ring:
    return read_map(Source("room", ROOM)).rings[0]


def with_lights(ring: Ring, **offsets: tuple[float, ...]) -> Ring:
    """The ring with shared lights, offsets in inches by node name."""
    edges = []
    for node, edge in zip(ring.nodes, ring.edges, strict=True):
        lights = tuple(MapLight(offset_mm=d * INCH, shared=True) for d in offsets.get(node.name, ()))
        edges.append(replace(edge, lights=lights))
    return replace(ring, edges=tuple(edges))


def test_headings_count_counterclockwise_from_north() -> None:
    assert [direction(h) for h in (0.0, 90.0, 180.0, 270.0, 360.0, -90.0)] == [
        (0, 1), (-1, 0), (0, -1), (1, 0), (0, 1), (1, 0),
    ]  # fmt: skip
    assert direction(45.0) == pytest.approx((-math.sqrt(0.5), math.sqrt(0.5)))


def test_an_outline_is_walked_clockwise_with_its_walls_on_the_left(room: Ring) -> None:
    walked = trace(room)
    assert walked.headings_deg == (0.0, 270.0, 180.0, 90.0)
    assert walked.total_turn_deg == -360.0
    assert walked.gap == pytest.approx((0.0, 0.0), abs=1e-9)
    assert [(p.x / INCH, p.y / INCH) for p in corners(room)] == [
        pytest.approx(p) for p in ((0, 0), (0, 100), (120, 100), (120, 0))
    ]


def test_the_compass_rule_spreads_a_gap_over_the_ring(room: Ring) -> None:
    longer = replace(room, edges=(*room.edges[:3], replace(room.edges[3], length_mm=130 * INCH)))
    placed = corners(longer)
    # Ten inches too far west over 450 inches of walls: each node moves east in proportion to the way so far.
    moved = [10 * INCH * so_far / 450 for so_far in (0, 100, 220, 320)]
    exact = corners(room)
    assert [p.x - q.x for p, q in zip(placed, exact, strict=True)] == pytest.approx(moved)
    assert [p.y for p in placed] == pytest.approx([p.y for p in exact])


def test_projections_follow_the_ring(room: Ring) -> None:
    (mark,) = projections(room)
    assert (mark.edge, mark.light) == (1, 0)
    assert mark.point == pytest.approx((60 * INCH, 100 * INCH))
    assert mark.along == pytest.approx((1.0, 0.0))


def test_a_shared_light_hangs_where_the_perpendiculars_meet(room: Ring) -> None:
    (light,) = shared_lights(with_lights(room, A=(70,), B=(40,))) or ()
    assert light == pytest.approx((40 * INCH, 70 * INCH))


def test_shared_lights_pair_across_the_beginning_of_the_ring(room: Ring) -> None:
    (light,) = shared_lights(with_lights(room, A=(20,), D=(90,))) or ()
    assert light == pytest.approx((30 * INCH, 20 * INCH))
    four = with_lights(room, A=(20, 70), B=(30, 90), C=(30, 80), D=(30, 90))
    lights = shared_lights(four) or ()
    assert sorted((round(p.x / INCH), round(p.y / INCH)) for p in lights) == [
        (30, 20),
        (30, 70),
        (90, 20),
        (90, 70),
    ]


def test_shared_lights_that_do_not_pair(room: Ring) -> None:
    assert shared_lights(with_lights(room, A=(20,))) is None
    assert shared_lights(with_lights(room, A=(20,), C=(20,))) is None
    assert shared_lights(with_lights(room)) == ()


def test_free_space_is_inside_the_outline_and_outside_the_block(room: Ring) -> None:
    square = [(1000.0, 1000.0), (2000.0, 1000.0), (2000.0, 2000.0), (1000.0, 2000.0)]
    rings = (corners(room), tuple(type(corners(room)[0])(*p) for p in square))
    assert in_free_space(rings, 500.0, 500.0)
    assert not in_free_space(rings, 1500.0, 1500.0)
    assert not in_free_space(rings, -1.0, 500.0)
    assert not in_free_space(rings, 500.0, 1e6)


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(sound_maps())
def test_edges_keep_their_lengths(drawn: Map) -> None:
    for ring in drawn.rings:
        nodes = corners(ring)
        gap = math.hypot(*trace(ring).gap)
        for here, there, edge in zip(nodes, (*nodes[1:], nodes[0]), ring.edges, strict=True):
            length = math.hypot(there.x - here.x, there.y - here.y)
            assert length == pytest.approx(edge.length_mm, abs=gap + 1e-6)


def test_an_edge_is_a_wall_unless_it_says_otherwise() -> None:
    edge = Edge(kind=EdgeKind.WALL, length_mm=1.0)
    assert edge.counted
    assert edge.lights == ()
