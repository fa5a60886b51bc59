"""Sightings held against the plates that were passed."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import Pose
from studies.plates.judging import (
    MATCH_RADIUS_MM,
    MIN_VIEW_NS,
    Sighting,
    judge_sightings,
    true_position,
)
from studies.plates.passed import Pass
from studies.plates.record import Outcome, Tally, tally

_PLATES = tuple(
    Plate(
        edge=0, start_mm=0.0, end_mm=356.0, center=Point(0.0, y), heading_deg=90.0, door=door, text=door[:3]
    )
    for door, y in (("352.second", 1000.0), ("354", 3000.0), ("356", 5000.0))
)  # fmt: skip
LONG = 2 * MIN_VIEW_NS


def _judged(sightings: list[Sighting], passes: list[Pass]) -> tuple[Outcome, ...]:
    return judge_sightings(sightings, _PLATES, passes, lambda one: f"a thing at {one.position.y:g}")


def _seen(t_ns: int, y: float, text: str = "", x: float = 0.0) -> Sighting:
    return Sighting(t_ns, Point(x, y), text)


def test_found_missed_and_out_of_view() -> None:
    outcomes = _judged(
        [_seen(14, 1100.0, "352")], [Pass(0, 10, LONG), Pass(1, 20, LONG), Pass(2, 30, MIN_VIEW_NS - 1)]
    )
    assert [(one.kind, one.at_ns, one.name) for one in outcomes] == [
        ("found", 10, "352.second"),
        ("missed", 20, "354"),
        ("unseen", 30, "356"),
    ]
    assert outcomes[0].right
    assert tally(outcomes) == Tally(found=1, missed=1, unseen=1, right=1, false=0)
    assert tally(outcomes).due == 2


def test_what_is_in_view_for_too_short_a_time_counts_when_it_is_found() -> None:
    [outcome] = _judged([_seen(31, 5000.0, "358")], [Pass(2, 30, 0)])
    assert (outcome.kind, outcome.right, outcome.text) == ("found", False, "358")


def test_a_second_sighting_and_one_of_nothing_are_false() -> None:
    outcomes = _judged(
        [_seen(5, 2000.0, "11"), _seen(11, 1000.0), _seen(12, 1000.0 + MATCH_RADIUS_MM)], [Pass(0, 10, LONG)]
    )
    assert [(one.kind, one.name) for one in outcomes] == [
        ("false", "a thing at 2000"),
        ("found", "352.second"),
        ("false", "352.second again"),
    ]
    assert tally(outcomes).false == 2


def test_a_plate_that_is_taken_for_another_one_is_false() -> None:
    right, wrong = _seen(11, 1000.0), _seen(12, 3000.0)
    outcomes = _judged(
        [right._replace(door="352.second"), wrong._replace(door="356")],
        [Pass(0, 10, LONG), Pass(1, 20, LONG)],
    )
    assert [(one.kind, one.name) for one in outcomes] == [
        ("found", "352.second"),
        ("false", "356 instead of 354"),
        ("missed", "354"),
    ]


def test_a_plate_that_was_not_passed_counts_neither_way() -> None:
    outcomes = _judged([_seen(11, 3000.0, "354")], [])
    assert [(one.kind, one.at_ns, one.right) for one in outcomes] == [("beyond", 11, True)]
    assert tally(outcomes) == Tally(0, 0, 0, 0, 0)


def test_farther_than_half_a_meter_is_no_plate() -> None:
    [near] = _judged([_seen(1, 1000.0, x=MATCH_RADIUS_MM)], [])
    [far] = _judged([_seen(1, 1000.0, x=MATCH_RADIUS_MM + 1.0)], [])
    assert (near.kind, far.kind) == ("beyond", "false")
    assert judge_sightings([_seen(1, 0.0)], (), (), lambda one: "wall")[0].name == "wall"


_NUMBERS = st.floats(-1e5, 1e5)
_HEADINGS = st.floats(0.0, 360.0, exclude_max=True)
_POSES = st.builds(Pose, _NUMBERS, _NUMBERS, _HEADINGS)


@given(_NUMBERS, _NUMBERS, _POSES, _POSES)
def test_a_true_place_is_as_far_away_and_in_the_same_direction(
    x: float, y: float, believed: Pose, true: Pose
) -> None:
    place = true_position(Point(x, y), believed, true)
    for angle in (0.0, 90.0):
        assert math.isclose(
            _component(place, true, angle), _component(Point(x, y), believed, angle), abs_tol=1e-5
        )


def _component(place: Point, pose: Pose, off_deg: float) -> float:
    """How far a place is from a robot, in a direction of its own."""
    angle = math.radians(pose.heading_deg + off_deg)
    return (place.y - pose.y_mm) * math.cos(angle) - (place.x - pose.x_mm) * math.sin(angle)


def test_a_right_belief_changes_nothing() -> None:
    pose = Pose(3.0, 4.0, 30.0)
    assert math.dist(true_position(Point(10.0, 20.0), pose, pose), (10.0, 20.0)) < 1e-9
