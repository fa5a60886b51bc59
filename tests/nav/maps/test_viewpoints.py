"""Where a robot stands that looks at something of a map."""

from __future__ import annotations

import math

import pytest

from colony.nav.maps.signs import NoViewpointError, parse_pose, plates_of, viewpoint_of
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.walls import free_distance, walls_of
from tests.buildings import MSU


def test_a_door_with_a_plate_has_it_to_the_robots_left_in_mid_corridor() -> None:
    for plate in plates_of(MSU):
        x, y, heading = viewpoint_of(MSU, plate.door)
        bearing = math.degrees(math.atan2(x - plate.center.x, plate.center.y - y)) - heading
        assert bearing % 360.0 == pytest.approx(90.0, abs=1e-6), plate.door
        distance = math.hypot(plate.center.x - x, plate.center.y - y)
        away = Point((x - plate.center.x) / distance, (y - plate.center.y) / distance)
        free = free_distance(walls_of(MSU).segments, plate.center, away)
        assert distance == pytest.approx(min(free / 2, 1900.0))


def test_an_elevator_is_ahead() -> None:
    x, y, heading = viewpoint_of(MSU, "acs.elev")
    assert (x, y, heading) == viewpoint_of(MSU, "acs.elev.L")
    walls = walls_of(MSU)
    names = [node.name for ring in MSU.rings for node in ring.nodes]
    edge = names.index("acs.elev.L")
    assert walls.kinds[edge] is EdgeKind.ELEVATOR
    x0, y0, x1, y1 = walls.segments[edge].tolist()
    toward = math.degrees(math.atan2(x - (x0 + x1) / 2, (y0 + y1) / 2 - y))
    assert (toward - heading) % 360.0 == pytest.approx(0.0, abs=1e-6)


def test_every_node_is_a_place_or_says_why_not() -> None:
    refused = 0
    for node in (node.name for ring in MSU.rings for node in ring.nodes):
        try:
            x, y, heading = viewpoint_of(MSU, node)
        except NoViewpointError:
            refused += 1
        else:
            parse_pose(MSU, f"{x!r},{y!r},{heading!r}")
    assert refused < 20


@pytest.mark.parametrize(
    ("place", "found"),
    [
        ("1,2", "expected a door, a node or X,Y,HEADING"),
        ("a,b,c", "expected a door"),
        ("1e9,0,0", "is outside of `msu_engineering_3`; expected x from"),
        ("5000,5000,nan", "is outside of"),
    ],
)
def test_poses_that_are_none(place: str, found: str) -> None:
    with pytest.raises(NoViewpointError, match=found):
        parse_pose(MSU, place)


def test_a_pose_is_taken_as_it_is() -> None:
    assert parse_pose(MSU, "5000, 6000, -90") == (5000.0, 6000.0, 270.0)


def test_a_name_that_is_not_there_has_others_like_it() -> None:
    with pytest.raises(NoViewpointError, match="no door or node `3767`; did you mean `377` or `376`"):
        viewpoint_of(MSU, "3767")
