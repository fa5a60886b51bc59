from __future__ import annotations

import numpy as np
import pytest

from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.stickrep.reader import load_map, read_map
from colony.nav.maps.walls import lights_of, walls_of
from colony.text.source import Source
from tests.buildings import MAPS
from tests.nav.maps.small_maps import ROOM

INCH = 25.4


def test_walls_of_a_room() -> None:
    walls = walls_of(read_map(Source("room", ROOM)))
    expected = [(0, 0, 0, 100), (0, 100, 120, 100), (120, 100, 120, 0), (120, 0, 0, 0)]
    assert walls.segments / INCH == pytest.approx(np.array(expected), abs=1e-9)
    assert walls.kinds == (EdgeKind.WALL, EdgeKind.WALL, EdgeKind.DOOR, EdgeKind.WALL)
    assert walls.bounds == pytest.approx((0.0, 0.0, 120 * INCH, 100 * INCH))
    assert walls.attributes == ("brick", "brick", "glass", "brick")
    assert walls.glass == (False, False, True, False)
    assert not walls.segments.flags.writeable


@pytest.mark.parametrize(
    ("attribute", "pane"),
    [
        ("glass", True),
        ("Glass, double door of the stairs", True),
        ("door of wired glass", True),
        ("glass brick", False),
        ("wall of glass bricks", False),
        ("glass-block", False),
        ("glasshouse door", False),
        ("glass bricks, and a pane of glass", True),
    ],
)
def test_panes_of_glass_are_told_from_glass_bricks(attribute: str, pane: bool) -> None:
    walls = walls_of(read_map(Source("room", ROOM.replace("100 glass", f"100 {attribute}"))))
    assert walls.glass[2] is pane


def test_a_light_on_one_edge_hangs_half_way_across() -> None:
    assert lights_of(read_map(Source("room", ROOM))) / INCH == pytest.approx(np.array([[60.0, 50.0]]))


@pytest.mark.parametrize("offset", [7.0, 9.0, 9.9])
def test_a_light_at_the_mouth_of_another_corridor_hangs_in_the_middle_of_its_own(offset: float) -> None:
    """A corridor of 18 m by 2 m, with one of 2 m by 20 m leading north from its middle: a T."""
    text = (
        "stickrep 1\nmap t\nunit m\nstart 1 1 0\nring r 0 0 0\n"
        "-270 A W 0 2\n-270 B W 0 8\n-90 C W 0 20\n-270 D W 0 2\n-270 E W 0 20\n-90 F W 0 8\n"
        f"-270 G W 0 2\n-270 H W 1 {offset} 18\n"
    )
    assert lights_of(read_map(Source("t", text))) == pytest.approx(np.array([[18e3 - 1e3 * offset, 1e3]]))


def test_a_mouth_near_the_end_of_a_corridor() -> None:
    """A corridor of 18 m by 3 m, with one of 2 m by 20 m leading north 2 m after its end: some of the places
    beside the light are beyond that, where nothing is opposite."""
    text = (
        "stickrep 1\nmap t\nunit m\nstart 1 1 0\nring r 0 0 0\n"
        "-270 A W 0 3\n-270 B W 0 2\n-90 C W 0 20\n-270 D W 0 2\n-270 E W 0 20\n-90 F W 0 14\n"
        "-270 G W 0 3\n-270 H W 1 15 18\n"
    )
    assert lights_of(read_map(Source("t", text))) == pytest.approx(np.array([[3e3, 1.5e3]]))


def test_a_map_without_lights() -> None:
    text = ROOM.replace("1 60 120", "0 120")
    assert lights_of(read_map(Source("room", text))).shape == (0, 2)


@pytest.mark.parametrize("name", ["hallway", "loop"])
def test_rings_are_closed_without_leaks(name: str) -> None:
    source = load_map(MAPS / f"{name}.stickrep")
    segments = walls_of(source).segments
    at = 0
    for ring in source.rings:
        part = segments[at : at + len(ring.edges)]
        assert (part[:, 2:] == np.roll(part[:, :2], -1, axis=0)).all()
        at += len(ring.edges)
    assert at == len(segments)


def test_the_lights_of_the_loop_hang_in_the_middle_of_its_corridor() -> None:
    lights = lights_of(load_map(MAPS / "loop.stickrep")) / INCH
    assert len(lights) == 20
    from_the_outline = np.minimum.reduce(
        [lights[:, 0], 1200 - lights[:, 0] - 20, lights[:, 1], 788 - lights[:, 1]]
    )
    assert from_the_outline == pytest.approx(np.full(20, 50.0))
