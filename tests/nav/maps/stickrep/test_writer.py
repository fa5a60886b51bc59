from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings

from colony.nav.maps.stickrep.model import Map, Pose
from colony.nav.maps.stickrep.reader import load_map, read_map, write_map
from colony.text.source import Source
from tests.diagnostics import place_of, problems_of
from tests.nav.maps.small_maps import ROOM, sound_maps
from tests.paths import MAPS


def read(text: str) -> Map:
    return read_map(Source("map.stickrep", text))


def test_what_is_written_can_be_read_by_people() -> None:
    assert write_map(read(ROOM)) == (
        "stickrep 1\n"
        "map room\n"
        "unit inch\n"
        "lights incremental\n"
        "closure 2\n"
        "start 50 50 0\n"
        "\n"
        "ring outline 0 0 0\n"
        "# alpha  node  type  lights  length  attribute\n"
        "-270     A     W     0       100     brick\n"
        "-270     B     W     1 60    120     brick\n"
        "-270     C     D     0       100     glass\n"
        "-270     D     W     0       120     brick\n"
    )


@pytest.mark.parametrize("name", ["hallway", "loop"])
def test_the_maps_that_come_along_survive(name: str) -> None:
    loaded = load_map(MAPS / f"{name}.stickrep")
    assert read(write_map(loaded)) == loaded


@pytest.mark.parametrize("unit", ["mm", "cm", "m", "ft"])
def test_links_survive_in_every_unit(unit: str) -> None:
    loaded = load_map(MAPS / "loop.stickrep")
    back = read(write_map(replace(loaded, unit=unit)))
    for link, original in zip(back.links, loaded.links, strict=True):
        for site, before in zip(link, original, strict=True):
            assert site.node == before.node
            assert site.offset_mm == pytest.approx(before.offset_mm, abs=1e-3)


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(sound_maps())
def test_writing_what_was_read_is_a_fixed_point(drawn: Map) -> None:
    once = write_map(drawn)
    back = read(once)
    assert write_map(back) == once
    assert read(write_map(back)) == back


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(sound_maps())
def test_nothing_is_lost_but_the_seventh_decimal(drawn: Map) -> None:
    back = read(write_map(drawn))
    assert (back.name, back.unit, back.light_offsets) == (drawn.name, drawn.unit, drawn.light_offsets)
    assert (back.floor, back.travel) == (drawn.floor, drawn.travel)
    assert back.start[:2] == pytest.approx(drawn.start[:2], abs=1e-3)
    for ring, original in zip(back.rings, drawn.rings, strict=True):
        assert [(n.name, n.corner) for n in ring.nodes] == [(n.name, n.corner) for n in original.nodes]
        for edge, before in zip(ring.edges, original.edges, strict=True):
            assert (edge.kind, edge.counted, edge.attribute) == (
                before.kind,
                before.counted,
                before.attribute,
            )
            assert edge.length_mm == pytest.approx(before.length_mm, abs=1e-3)
            offsets = [light.offset_mm for light in before.lights]
            assert [light.offset_mm for light in edge.lights] == pytest.approx(offsets, abs=5e-3)


def test_a_heading_that_rounds_up_to_a_full_turn_is_zero() -> None:
    room = read(ROOM)
    turned = write_map(type(room)(name="m", rings=room.rings, start=Pose(1270.0, 1270.0, 359.99999999)))
    assert "start 50 50 0\n" in turned


def test_holes_are_written_and_read_again() -> None:
    holed = read(ROOM.replace("start ", "hole 10 20.5 30 40\nhole 60 10 50 5\nstart ", 1))
    assert [hole.x0_mm for hole in holed.holes] == [254.0, 1524.0]
    assert holed.holes[0].corners()[2] == (30 * 25.4, 40 * 25.4)
    assert read(write_map(holed)).holes == holed.holes


@pytest.mark.parametrize(
    ("line", "code"), [("hole 1 2 3", "M007"), ("hole 1 2 1 5", "M007"), ("hole 1 2 x 5", "M009")]
)
def test_a_hole_that_is_none_is_reported(line: str, code: str) -> None:
    [found] = problems_of(read, ROOM.replace("start ", f"{line}\nstart ", 1))
    assert found.code == code


def test_docks_are_written_and_read_again() -> None:
    docked = read(ROOM.replace("start ", "dock 10 20.5 90\ndock 60 10 -0.5\nstart ", 1))
    assert docked.docks == (Pose(254.0, 20.5 * 25.4, 90.0), Pose(1524.0, 254.0, 359.5))
    assert read(write_map(docked)).docks == docked.docks


@pytest.mark.parametrize(
    ("line", "code"), [("dock 1 2", "M007"), ("dock 1 x 5", "M009"), ("dock 500 50 0", "M022")]
)
def test_a_dock_that_is_none_is_reported(line: str, code: str) -> None:
    [found] = problems_of(read, ROOM.replace("start ", f"dock 30 30 0\n{line}\nstart ", 1))
    assert (found.code, place_of(found)[:2]) == (code, "4:")
