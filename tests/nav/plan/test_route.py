"""Plans: the published paths of the thesis, names, ways between rings and floors, and why there is none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import pytest

from colony.nav.maps.building import Building, Landing, LandingRide, load_building
from colony.nav.maps.corridors import corridors_of
from colony.nav.maps.stickrep.geometry import corners, in_free_space
from colony.nav.maps.stickrep.model import EdgeKind, Map, Ring
from colony.nav.plan.plan import Plan
from colony.nav.plan.route import NoPlanError, plan
from colony.nav.shared import GoalKind
from studies.confidence.automaton import TABLE_6_5
from studies.confidence.published_runs import PUBLISHED_RUNS, PublishedRun
from tests.paths import MAPS

FLOORS = ("narrow", "atrium", "msu_engineering_2", "msu_engineering_3", "loop", "hallway")


@cache
def building(name: str) -> Building:
    return load_building(MAPS / f"{name}.stickrep")


def floor(name: str) -> Map:
    return building(name).maps[0]


def doors(of: Map) -> list[str]:
    return [
        node.name
        for ring in of.rings
        for node, edge in zip(ring.nodes, ring.edges, strict=True)
        if edge.kind is not EdgeKind.WALL
    ]


def kinds(found: Plan) -> str:
    return "".join(chr(segment.kind) for segment in found.segments)


# --- the thesis -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("run", PUBLISHED_RUNS, ids=lambda run: f"{run.wing}-{run.number}")
def test_the_published_runs(run: PublishedRun) -> None:
    """Tables 6.1 and 6.2: the distance to 0.1 % (in fact, to the millimeter), and how often each mode."""
    found = plan(floor("msu_engineering_3"), run.origin, run.goal)
    assert found.distance_mm == pytest.approx(run.distance_mm, abs=1.0)
    assert tuple(found.modes.count(mode) for mode in "lcd") == run.required


@pytest.mark.parametrize("row", TABLE_6_5, ids=lambda row: row.modes)
def test_the_strings_of_table_6_5(row: tuple[str, str, str, float]) -> None:
    origin, goal, modes, _ = row
    assert plan(floor("msu_engineering_3"), origin, goal).modes == modes


def test_a_ring_is_followed_as_it_is_traced() -> None:
    there = plan(floor("msu_engineering_3"), "345R", "343R")
    back = plan(floor("msu_engineering_3"), "343R", "345R")
    ring = floor("msu_engineering_3").rings[1]
    assert there.distance_mm + back.distance_mm == pytest.approx(ring.path_length_mm)
    assert (there.modes, back.modes.count("c")) == ("d", 10)
    assert plan(floor("msu_engineering_3"), "343R", "345R", travel="either").modes == "d"


def test_the_sides_of_an_alcove_count_for_nothing() -> None:
    found = plan(floor("loop"), "209R", "213L", travel="wall-on-left")
    assert found.distance_mm == pytest.approx((64 + 16 + 40 + 16 + 140) * 25.4)
    assert found.travel_mm == pytest.approx(found.distance_mm, abs=10.0)


# --- names ----------------------------------------------------------------------------------------------


def test_a_door_stands_for_the_jamb_that_makes_the_shorter_path() -> None:
    loop = floor("loop")
    assert plan(loop, "201", "205").origin == "201R"
    assert plan(loop, "201", "205").goal == "205L"
    assert plan(loop, "201", "207").origin == "201L"
    assert plan(loop, "201L", "205").origin == "201L"
    thesis = plan(floor("msu_engineering_3"), "NE.men", "acs.elev.R")
    assert (thesis.origin, thesis.goal) == ("NE.men.R", "acs.elev.R")


@pytest.mark.parametrize(
    ("origin", "goal", "message", "hint"),
    [
        ("2011", "205", "there is no start `2011` in the map `loop`", "`201`"),
        ("201", "b", "there is no goal `b` in the map `loop`", "did you mean `B`"),
        ("201", "%", "there is no goal `%` in the map `loop`", "`colony map` draws the names"),
        ("201", "201", "`201` and `201` are the same place", "name a start and a goal that differ"),
        ("201L", "201L", "`201L` and `201L` are the same place", "name a start and a goal that differ"),
    ],
)
def test_names_that_make_no_plan(origin: str, goal: str, message: str, hint: str) -> None:
    with pytest.raises(NoPlanError) as problem:
        plan(floor("loop"), origin, goal)
    assert problem.value.message == message
    assert hint in problem.value.hint


def test_from_a_door_to_its_other_jamb() -> None:
    assert plan(floor("loop"), "201L", "201R").distance_mm == pytest.approx(36 * 25.4, abs=3.0)


# --- rings ----------------------------------------------------------------------------------------------


def test_rings_without_links_are_not_joined_where_the_wall_is_on_the_left() -> None:
    unlinked = replace(floor("loop"), links=())
    with pytest.raises(
        NoPlanError, match=r"ring `outline`, the other on `block`, and no links join these"
    ) as problem:
        plan(unlinked, "201R", "214L", travel="wall-on-left")
    assert "add `link` lines to the map" in problem.value.hint
    # What one may travel either way needs no links: a corridor has both its walls.
    assert plan(unlinked, "201R", "214L").modes == "ld"


def test_links_join_rings_and_count_for_nothing() -> None:
    linked = plan(floor("loop"), "203R", "212L", travel="wall-on-left")
    assert linked.modes == "ld"
    assert linked.travel_mm < 8_000.0


def test_between_nodes_of_one_ring_no_link_is_taken() -> None:
    """Else the way from 345R to 345L would lead across MAIN and back, and not once around the block."""
    found = plan(floor("msu_engineering_3"), "345R", "345L")
    assert found.distance_mm == pytest.approx(337_007.0, abs=1.0)


def test_what_stands_in_no_corridor_cannot_be_reached() -> None:
    loop = floor("loop")
    hall = replace(loop, rings=(loop.rings[0],), links=())  # without its block it is one hall of 30 m by 20 m
    with pytest.raises(NoPlanError, match="`201L` is in no corridor"):
        plan(hall, "201L", "205L")


# --- floors ---------------------------------------------------------------------------------------------


def test_a_goal_on_another_floor_is_reached_by_elevator() -> None:
    found = plan(building("msu_engineering_3"), "372R", "msu_engineering_2:264L")
    assert found.modes.count("v") == 1
    ride = next(s for s in found.segments if s.kind is GoalKind.ELEVATOR)
    assert (ride.start.floor, ride.end.floor) == ("msu_engineering_3", "msu_engineering_2")
    assert ride.heading_deg == 270.0
    at = found.segments.index(ride)
    assert found.segments[at - 1].end == ride.start
    assert found.segments[at + 1].start == ride.end
    assert found.distance_mm > 0.0
    assert plan(building("msu_engineering_3"), "372R", "2:264L") == found


def test_from_an_elevator_one_rides_at_once() -> None:
    found = plan(building("msu_engineering_3"), "old.elev.L", "2:264L")
    assert kinds(found).startswith("V")
    assert found.modes.startswith("v")


def test_an_elevator_that_is_told_from_floor_to_floor_is_ridden_in_one_go() -> None:
    loop, node = floor("loop"), "liftL"
    floors = tuple(replace(loop, name=name, floor=name) for name in "1234")
    rides = tuple(LandingRide(Landing(one, node), Landing(other, node)) for one, other in pairwise("1234"))
    assert any(n.name == node for ring in loop.rings for n in ring.nodes)
    found = plan(Building(maps=floors, rides=rides), "201L", "4:205L")
    assert found.modes.count("v") == 1
    (ride,) = (s for s in found.segments if s.kind is GoalKind.ELEVATOR)
    assert (ride.start.floor, ride.end.floor) == ("1", "4")
    assert ride.doors_mm[0] == ride.doors_mm[1] > 0.0


def test_names_are_looked_for_on_the_floor_that_was_asked_for() -> None:
    found = plan(building("msu_engineering_3"), "acs.elev.R", "376R")
    assert {s.end.floor for s in found.segments} == {"msu_engineering_3"}
    three = building("msu_engineering_3").maps[0]
    twins = Building(maps=(floor("loop"), three, replace(three, name="another", floor="")))
    with pytest.raises(
        NoPlanError, match="several floors: `msu_engineering_3`, `another`; say which one: `msu_eng"
    ):
        plan(twins, "201L", "350R")


def test_floors_without_an_elevator_are_apart() -> None:
    both = Building(maps=building("msu_engineering_3").maps)
    with pytest.raises(
        NoPlanError, match="no elevator that can be reached leads from `msu_engineering_3` to"
    ):
        plan(both, "350R", "264L")


def test_a_floor_may_have_the_name_of_another_map() -> None:
    """`2:x` then is on both; the elevators are found all the same."""
    three, two = building("msu_engineering_3").maps
    names = {three.name: "2", two.name: "3"}
    renamed = Building(
        maps=tuple(replace(floor, name=names[floor.name]) for floor in (three, two)),
        rides=tuple(
            LandingRide(
                *(
                    position_after_ride._replace(map=names[position_after_ride.map])
                    for position_after_ride in ride
                )
            )
            for ride in building("msu_engineering_3").rides
        ),
    )
    found = plan(renamed, "372R", "264L")
    assert found.modes == plan(building("msu_engineering_3"), "372R", "264L").modes
    lifts = [replace(one, rings=(_with_node(one.rings[0], "lift"), *one.rings[1:])) for one in renamed.maps]
    with pytest.raises(NoPlanError, match="say which one: `2:lift`"):
        plan(Building(maps=(floor("loop"), *lifts)), "201L", "2:lift")


def _with_node(ring: Ring, name: str) -> Ring:
    """The ring with another name for its first node."""
    return replace(ring, nodes=(replace(ring.nodes[0], name=name), *ring.nodes[1:]))


def test_a_name_that_is_none_is_quoted_in_one_short_line() -> None:
    with pytest.raises(NoPlanError) as problem:
        plan(floor("loop"), "x" * 5000 + "\n", "205L")
    assert len(problem.value.message) < 100
    with pytest.raises(NoPlanError, match=r"no goal `a\\nb` in the map"):
        plan(floor("loop"), "205L", "a\nb")


def test_a_name_in_other_letters_is_the_one_that_is_meant() -> None:
    with pytest.raises(NoPlanError, match="did you mean `205L`"):
        plan(floor("loop"), "205l", "201L")


# --- what every plan is ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FLOORS)
def test_every_door_has_a_plan_and_every_plan_is_a_way(name: str) -> None:
    """From every door to the seventh after it: unbroken, along the middle of corridors, in free space."""
    here = floor(name)
    rings = tuple(corners(ring) for ring in here.rings)
    middles = corridors_of(here)
    names = doors(here)
    for i, origin in enumerate(names):
        found = plan(here, origin, names[(i + 7) % len(names)] if len(names) > 7 else names[i - 1])
        for one, other in pairwise(found.segments):
            assert one.end[:2] == pytest.approx(other.start[:2])
            assert one.end.floor == other.start.floor == here.name
        for segment in found.segments:
            middle = [(a + b) / 2 for a, b in zip(segment.start[:2], segment.end[:2], strict=True)]
            assert in_free_space(rings, *middle)
            ends = (segment.start[:2], segment.end[:2])
            assert any(all(abs(c.offset(*end)) < 1.0 for end in ends) for c in middles)
        check_modes(found)


def check_modes(found: Plan) -> None:
    """Segments are [L] E C [L] E C ... [L] D, and the modes say the same."""
    letters = kinds(found)
    assert letters.replace("EC", "c").lower() == found.modes
    assert letters.endswith("D")
    assert "LL" not in letters
    for segment in found.segments:
        assert (segment.kind is GoalKind.LIGHTS) == bool(segment.lights_mm)
        if segment.lights_mm:
            assert list(segment.lights_mm) == sorted(segment.lights_mm)
            assert segment.lights_mm[-1] == pytest.approx(segment.length_mm, abs=1.0)
            assert segment.lights_mm[0] >= 599.0
