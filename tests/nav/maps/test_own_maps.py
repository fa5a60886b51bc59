"""The maps that come along: whole, joined, lit, and true to what is published."""

from __future__ import annotations

import numpy as np
import pytest

from colony.nav.maps.building import load_building
from colony.nav.maps.corridors import corridors_of
from colony.nav.maps.stickrep.checks import linked_rings
from colony.nav.maps.stickrep.geometry import corners
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.stickrep.reader import load_map, read_map, write_map
from colony.nav.maps.walls import lights_of, walls_of
from colony.text.source import Source
from studies.confidence.published_runs import PUBLISHED_RUNS
from tests.paths import MAPS

PATHS = sorted((MAPS).glob("*.stickrep"))
MAP_BY_NAME = {path.stem: load_map(path) for path in PATHS}
MSU = MAP_BY_NAME["msu_engineering_3"]

every_map = pytest.mark.parametrize("name", MAP_BY_NAME)


def test_these_come_along() -> None:
    here = {"atrium", "hallway", "loop", "msu_engineering_2", "msu_engineering_3", "narrow"}
    assert here <= set(MAP_BY_NAME)


@every_map
def test_a_map_is_called_as_its_file_and_survives_being_written(name: str) -> None:
    assert MAP_BY_NAME[name].name == name
    again = read_map(Source("again.stickrep", write_map(MAP_BY_NAME[name])))
    assert write_map(again) == write_map(MAP_BY_NAME[name])
    assert (again.links, again.elevators) == (MAP_BY_NAME[name].links, MAP_BY_NAME[name].elevators)


@every_map
def test_from_every_ring_every_other_can_be_reached(name: str) -> None:
    assert len(linked_rings(MAP_BY_NAME[name])) == 1


@every_map
def test_every_door_has_two_jambs_of_one_name_in_order(name: str) -> None:
    for ring in MAP_BY_NAME[name].rings:
        for i, edge in enumerate(ring.edges):
            left, right = ring.nodes[i].name, ring.nodes[(i + 1) % len(ring.nodes)].name
            if edge.kind is not EdgeKind.WALL:
                assert left[-1] == "L", left
                assert right == left[:-1] + "R"


@every_map
def test_lights_hang_in_the_middle_of_corridors(name: str) -> None:
    corridors = corridors_of(MAP_BY_NAME[name])
    for x, y in lights_of(MAP_BY_NAME[name]):
        aside = [
            abs((x - c.start.x) * (c.end.y - c.start.y) - (y - c.start.y) * (c.end.x - c.start.x))
            / c.length_mm
            for c in corridors
            if 0.0 <= c.along(x, y) <= c.length_mm
        ]
        assert min(aside) < 10.0, (x, y)


@pytest.mark.parametrize("name", sorted(set(MAP_BY_NAME) - {"hallway"}))
def test_neighboring_lights_are_four_to_six_meters_apart_but_for_gaps(name: str) -> None:
    lights = lights_of(MAP_BY_NAME[name])
    apart = np.hypot(*(lights[:, None] - lights[None]).transpose(2, 0, 1))
    apart[np.diag_indices(len(lights))] = np.inf
    nearest = apart.min(axis=1)
    assert nearest.min() > 3500.0
    assert np.quantile(nearest, 0.8) < 6000.0


@every_map
def test_no_wall_leaks(name: str) -> None:
    segments, at = walls_of(MAP_BY_NAME[name]).segments, 0
    for ring in MAP_BY_NAME[name].rings:
        part = segments[at : at + len(ring.edges)]
        assert (part[:, 2:] == np.roll(part[:, :2], -1, axis=0)).all()
        at += len(ring.edges)
    assert at == len(segments)


def test_the_two_floors_are_one_building_whose_shafts_are_upright() -> None:
    building = load_building(next(path for path in PATHS if path.stem == MSU.name))
    assert [(m.name, m.floor) for m in building.maps] == [
        ("msu_engineering_3", "3"),
        ("msu_engineering_2", "2"),
    ]
    assert [one.node for one, _ in building.rides] == ["acs.elev.L", "old.elev.L"]
    for one, other in building.rides:
        above, below = (_place(building.map_named(end.map), end.node) for end in (one, other))
        assert above == pytest.approx(below, abs=1.0)


def _place(source: Map, name: str) -> tuple[float, float]:
    for ring in source.rings:
        for node, place in zip(ring.nodes, corners(ring), strict=True):
            if node.name == name:
                return place
    raise KeyError(name)


def _along() -> dict[str, tuple[str, float, float]]:
    """Of each node its ring, how far along it the node is, and the way once around."""
    out = {}
    for ring in MSU.rings:
        at = 0.0
        for node, edge in zip(ring.nodes, ring.edges, strict=True):
            out[node.name] = (ring.name, at, ring.path_length_mm)
            at += edge.length_mm if edge.counted else 0.0
    return out


def test_every_published_distance_is_found_on_the_third_floor() -> None:
    """The tables round down to millimeters; 0.1 % was asked for, and a few hundredths of an inch are met."""
    along = _along()
    for run in PUBLISHED_RUNS:
        ring, begin, around = along[run.origin]
        other, end, _ = along[run.goal]
        assert ring == other, run
        assert (end - begin) % around == pytest.approx(run.distance_mm, abs=1.5), run


def test_what_else_is_published_of_the_third_floor() -> None:
    assert [ring.name for ring in MSU.rings] == ["1", "2", "3", "4"]
    assert MSU.travel == "wall-on-left"
    walls = walls_of(MSU)
    low_x, low_y, high_x, high_y = walls.bounds
    assert high_x - low_x < 136_000.0
    assert high_y - low_y == pytest.approx(116_000.0, abs=10.0)
    panes = [i for i, glass in enumerate(walls.glass) if glass]
    assert [walls.kinds[i] for i in panes] == [EdgeKind.DOOR]
    assert walls.attributes[panes[0]] == "glass, double door of the ACS laboratory"
    assert max(c.width_mm for c in corridors_of(MSU)) <= 3661.0
    # G, N and J lead from the corridor at y = 31.9 m to the one at 11.5 m, and have two lights each.
    between = [x for x, y in lights_of(MSU) if 13_500.0 < y < 30_000.0 and x < 120_000.0]
    assert [round(sum(abs(x - c) < 100.0 for x in between)) for c in (1_525.0, 52_209.0, 98_115.0)] == [
        2,
        2,
        2,
    ]
    assert len(between) == 6


def test_doors_of_the_third_floor_are_as_wide_as_the_thesis_says_doors_are() -> None:
    for edge in MSU.edges():
        if edge.kind is EdgeKind.DOOR:
            inches = edge.length_mm / 25.4
            assert min(abs(inches - wide) for wide in (32, 36, 40, 72, 80)) < 0.02, inches
