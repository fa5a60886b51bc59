"""Links and elevators of one map."""

from __future__ import annotations

import pytest

from colony.nav.maps.stickrep.checks import linked_rings
from colony.nav.maps.stickrep.geometry import Point, link_endpoints
from colony.nav.maps.stickrep.model import ElevatorLink, Map, RingLink, RingPosition
from colony.nav.maps.stickrep.reader import read_map, write_map
from colony.text.source import Source
from tests.diagnostics import place_of, problems_of

BLOCKS = """stickrep 1
map blocks
unit m
floor 1
start 1 1 0
ring outline 0 0 0
-270 A W 0 16
-270 B W 0 20
-270 C W 0 7
 180 lift.L E 0 1
 180 lift.R W 0 8
-270 D W 0 11
 180 10L D 0 1
 180 10R W 0 8
ring west 2 2 270
-90 P W 0 7
-90 Q W 0 12
-90 R W 0 7
-90 S W 0 12
ring east 11 2 270
-90 T W 0 7
-90 U W 0 12
-90 V W 0 7
-90 X W 0 12
"""
"""Two blocks in an outline of 20 m by 16 m, with corridors of 2 m around and between them."""


def read(*lines: str) -> Map:
    return read_map(Source("blocks.stickrep", BLOCKS + "\n".join(lines) + "\n"))


def found(*lines: str) -> list[str]:
    """Line, column, code and message of everything that is wrong."""
    return [f"{place_of(d)} {d.code} {d.message}" for d in problems_of(read, *lines)]


FIRST = len(BLOCKS.splitlines()) + 1


def test_places_are_nodes_or_so_far_after_them() -> None:
    linked = read("link 10R P+6", "link Q T")
    assert linked.links == (
        RingLink(RingPosition("10R"), RingPosition("P", 6000.0)),
        RingLink(RingPosition("Q"), RingPosition("T")),
    )
    across, junction = link_endpoints(linked)
    assert across == (Point(8000.0, 0.0), Point(8000.0, 2000.0))
    assert junction == (Point(9000.0, 2000.0), Point(11000.0, 2000.0))


@pytest.mark.parametrize(
    "line",
    [
        "link A P",  # the two corners of one turn
        "link A+8 S+6",
        "link S+6 A+8",  # either way round
        "link 10L P+6.9",
        "link Q+6 X+6",  # between the blocks
        "link Q X+11.6",  # displaced by 0.4 m
        "link R X",
        "link C V",
    ],
)
def test_links_that_are_sound(line: str) -> None:
    assert len(read(line).links) == 1


@pytest.mark.parametrize(
    ("line", "column", "message"),
    [
        ("link Q O", 8, "M025 there is no node `O` in this map"),
        ("link Qx T", 6, "M025 there is no node `Qx` in this map"),
        ("link Q+x T", 8, "M009 expected the distance from the node, a number; found `x`"),
        ("link Q+ T", 8, "M009 expected the distance from the node, a number; found ``"),
        ("link Q+13 X", 8, "M026 the place is 13000 mm after `Q`; the edge there is 12000 mm long"),
        ("link Q+-1 X", 8, "M026 the place is -1000 mm after `Q`; the edge there is 12000 mm long"),
        ("link P Q", 6, "`P` and `Q` are both on ring `west`"),
        ("link A V", 6, "`A` and `V` are 22.8 m apart"),
        ("link A+8 S+7", 6, "`A+8` and `S+7` are displaced by 1000 mm along the corridor"),
        ("link Q+6 U+6", 6, "are 9.0 m apart"),
        ("link A+1 P+1", 6, "`A+1` and `P+1` are not on opposite walls"),
        ("link R+1 X+1", 6, "not on opposite walls"),
    ],
)
def test_links_that_are_not(line: str, column: int, message: str) -> None:
    (error,) = found(line)
    assert error.startswith(f"{FIRST}:{column} M0")
    assert error.endswith(message)


def test_a_wall_between_two_places_is_seen() -> None:
    pillar = ["ring pillar 10 4 270", *(f"-90 p{i} W 0 .2" for i in range(4))]
    (error,) = found(*pillar, "link Q+2.1 X+9.9")
    assert error.endswith("`Q+2.1` and `X+9.9` have a wall between them")
    assert len(read(*pillar, "link Q+2.3 X+9.7").links) == 1


def test_all_links_are_judged_at_once_and_only_when_the_rings_are_sound() -> None:
    assert [error.split()[1] for error in found("link A O", "link P Q", "elevator N f.stickrep N")] == [
        "M025",
        "M026",
        "M025",
    ]
    broken = BLOCKS.replace("W 0 20", "W 0 21") + "link A O\n"
    assert [d.code for d in problems_of(read_map, Source("blocks.stickrep", broken))] == ["M018"]


def test_lines_may_not_be_told_twice() -> None:
    assert [error.split()[1] for error in found("link Q T", "link Q T")] == ["M005"]
    assert len(read("link Q T", "link Q X+12").links) == 2


def test_rings_that_links_join() -> None:
    assert linked_rings(read()) == (("outline",), ("west",), ("east",))
    assert linked_rings(read("link Q T")) == (("outline",), ("west", "east"))
    assert linked_rings(read("link 10R P+6", "link C V")) == (("outline", "west", "east"),)


def test_elevators() -> None:
    with_lift = read("elevator lift.L upstairs/two.stickrep shaft.L")
    assert with_lift.elevators == (ElevatorLink("lift.L", "upstairs/two.stickrep", "shaft.L"),)
    assert with_lift.floor == "1"


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("elevator lift.R two.stickrep lift.L", "10 M027 the edge after `lift.R` is a wall; "),
        ("elevator 10L two.stickrep lift.L", "10 M027 the edge after `10L` is a door; "),
        ("elevator lift two.stickrep lift.L", "10 M025 there is no node `lift` "),
        ("elevator lift.L two.stickrep li,ft", "30 M008 expected the name of a node; "),
        ("elevator lift.L /two.stickrep lift.L", "17 M029 the path `/two.stickrep` is absolute; "),
        ("elevator lift.L two.stickrep", "29 M007 expected `elevator NODE FILE NODE`; "),
    ],
)
def test_elevators_that_are_none(line: str, error: str) -> None:
    (message,) = found(line)
    assert message.startswith(f"{FIRST}:{error}")


def test_a_map_with_elevators_says_which_floor_it_is() -> None:
    text = BLOCKS.replace("floor 1\n", "") + "elevator lift.L two.stickrep lift.L\n"
    assert [d.code for d in problems_of(read_map, Source("blocks.stickrep", text))] == ["M028"]


def test_joints_are_written_as_they_were_read() -> None:
    lines = ["link 10R P+6", "link Q T", "elevator lift.L ../two.stickrep lift.L"]
    written = write_map(read(*lines, "travel wall-on-left"))
    assert written.endswith("\n\n" + "\n".join(lines) + "\n")
    assert "\nfloor 1\ntravel wall-on-left\n" in written
    assert read_map(Source("written.stickrep", written)) == read(*lines, "travel wall-on-left")
