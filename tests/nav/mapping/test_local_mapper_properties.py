"""What holds of the local mapper for any input: it does not care where north is, nor can it be poisoned."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colony.nav.mapping.himm import MAX_CERTAINTY, Cells, HimmMap, HimmParameters, LocalPose
from colony.nav.mapping.local_map import HoughParameters, lines_in
from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.walls import Walls
from colony.nav.pose.echoes import Floats, reflectors_of
from colony.nav.pose.tracker import Correction, PoseTracker
from colony.runtime.library.robot import Position
from tests.nav.sonars import CHANNELS, RING

SILENT = (10_000.0,) * CHANNELS
PERIOD_NS = 100_000_000
AT = (1_400.0, 1_200.0, 20.0)
WRONG = (1_440.0, 1_160.0, 21.5)

SCAN = st.lists(
    st.floats(-1e4, 2e4) | st.sampled_from([math.nan, math.inf, -math.inf, 0.0, 10_000.0]),
    min_size=CHANNELS,
    max_size=CHANNELS,
).map(tuple)


def walls(*segments: tuple[float, float, float, float]) -> Walls:
    return Walls(
        segments=np.array(segments, dtype=np.float64).reshape(-1, 4),
        kinds=(EdgeKind.WALL,) * len(segments),
        attributes=("",) * len(segments),
    )


ROOM = walls(
    (0, 0, 0, 3_000), (0, 3_000, 4_000, 3_000), (4_000, 3_000, 4_000, 1_000), (4_000, 1_000, 2_500, 1_000),
    (2_500, 1_000, 2_500, 0), (2_500, 0, 0, 0),
)  # fmt: skip


def scan_at(of: Walls, x: float, y: float, heading: float) -> tuple[float, ...]:
    """What sonars without errors read."""
    ranges = RING.predict(reflectors_of(of), x, y, math.radians(heading)).ranges
    return tuple(np.where(np.isfinite(ranges), ranges, 10_000.0).tolist())


def position(x: float, y: float, heading: float, t_ns: int = 0) -> Position:
    return Position(x=x, y=y, heading=heading, t_ns=t_ns)


def stood(tracker: PoseTracker, ranges: tuple[float, ...], where: Position, scans: int = 8) -> Correction:
    """Return the last correction of a robot that stands for a while."""
    for k in range(1, scans + 1):
        at = position(where.x, where.y, where.heading, where.t_ns + k * PERIOD_NS)
        correction = tracker.update(ranges, at)
    return correction


def turned(points: Floats, angle_deg: float) -> Floats:
    """Points, (n, 2), turned about the origin."""
    cosine, sine = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.asarray(points @ np.array([[cosine, sine], [-sine, cosine]]))


@settings(max_examples=40, deadline=None)
@given(angle=st.floats(-180.0, 180.0), east=st.floats(-1e5, 1e5), north=st.floats(-1e5, 1e5))
def test_where_north_is_and_where_the_map_begins_makes_no_difference(
    angle: float, east: float, north: float
) -> None:
    ends = turned(ROOM.segments.reshape(-1, 2), angle) + np.array([east, north])
    elsewhere = walls(*ends.reshape(-1, 4).tolist())
    x, y = turned(np.array([WRONG[:2]]), angle)[0].tolist()
    ranges = scan_at(ROOM, *AT)
    here = stood(PoseTracker(ROOM), ranges, position(*WRONG))
    there = stood(PoseTracker(elsewhere), ranges, position(x + east, y + north, WRONG[2] + angle))
    assert math.hypot(here.x_mm + 40.0, here.y_mm - 40.0) < 3.0
    expected = turned(np.array([[here.x_mm, here.y_mm]]), angle)[0]
    assert (there.x_mm, there.y_mm) == pytest.approx(tuple(expected), abs=0.01)
    assert there.heading_deg == pytest.approx(here.heading_deg, abs=1e-4)


@settings(max_examples=40, deadline=None)
@given(
    garbage=st.lists(
        st.tuples(
            SCAN,
            st.tuples(*(st.floats(-1e6, 1e6) | st.just(math.nan) for _ in range(3))),
            st.integers(-(10**10), 10**10),
        ),
        max_size=12,
    )
)
def test_no_input_poisons_it(
    garbage: list[tuple[tuple[float, ...], tuple[float, float, float], int]],
) -> None:
    """Whatever it was given, it recovers when a client sets the position."""
    tracker = PoseTracker(ROOM)
    for ranges, where, t_ns in garbage:
        correction = tracker.update(ranges, position(*where, t_ns))
        assert all(map(math.isfinite, (correction.x_mm, correction.y_mm, correction.heading_deg)))
    tracker.update(SILENT, position(-1e7, 0.0, 0.0, 10**11))
    last = stood(tracker, scan_at(ROOM, *AT), position(*WRONG, t_ns=10**11))
    assert (last.x_mm, last.y_mm) == pytest.approx((-40.0, 40.0), abs=4.0)


@pytest.mark.parametrize("broken", [math.nan, math.inf])
def test_a_sonar_that_says_nothing_is_no_evidence(broken: float) -> None:
    ranges = list(scan_at(ROOM, *AT))
    ranges[12] = ranges[18] = broken
    last = stood(PoseTracker(ROOM), tuple(ranges), position(*WRONG))
    assert (last.x_mm, last.y_mm) == pytest.approx((-40.0, 40.0), abs=6.0)
    nothing = stood(PoseTracker(ROOM), (broken,) * CHANNELS, position(*WRONG), scans=120)
    assert (nothing.x_mm, nothing.y_mm, nothing.heading_deg) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("of", [walls(), ROOM], ids=["an empty map", "outside of every wall"])
def test_where_no_wall_is_to_be_heard_nothing_is_corrected(of: Walls) -> None:
    last = stood(PoseTracker(of), scan_at(ROOM, *AT), position(-50_000.0, 70_000.0, 45.0), scans=60)
    assert (last.x_mm, last.y_mm, last.heading_deg) == (0.0, 0.0, 0.0)


def test_one_wall_gives_the_heading_and_the_way_to_it_and_nothing_else() -> None:
    west = walls((0.0, -9_000.0, 0.0, 9_000.0))
    last = stood(PoseTracker(west), scan_at(west, 1_000.0, 0.0, 0.0), position(1_050.0, 300.0, 2.0), scans=60)
    assert last.x_mm == pytest.approx(-50.0, abs=3.0)
    assert last.heading_deg == pytest.approx(-2.0, abs=0.2)
    assert last.y_mm == pytest.approx(0.0, abs=3.0)


@pytest.mark.parametrize("gap_s", [0.5, 4.0, 30.0])
def test_sonars_that_are_silent_for_seconds_do_not_make_a_drive_a_leap(gap_s: float) -> None:
    """What is known before the gap is still known after it, as far as the robot may have driven meanwhile."""
    hall = walls((0.0, -9_000.0, 0.0, 90_000.0), (2_400.0, 90_000.0, 2_400.0, -9_000.0))
    tracker = PoseTracker(hall)
    before = stood(tracker, scan_at(hall, 1_200.0, 0.0, 0.0), position(1_260.0, 0.0, 0.0))
    assert before.x_mm == pytest.approx(-60.0, abs=3.0)
    after_ns = 8 * PERIOD_NS + round(gap_s * 1e9)
    after = tracker.update(SILENT, position(1_260.0, 500.0 * gap_s, 0.0, after_ns))
    assert after.x_mm == pytest.approx(-60.0, abs=3.0)


def test_time_that_goes_back_does_no_harm() -> None:
    tracker, ranges = PoseTracker(ROOM), scan_at(ROOM, *AT)
    for k in range(20):
        last = tracker.update(ranges, position(*WRONG, t_ns=(20 - k) * PERIOD_NS))
    assert (last.x_mm, last.y_mm) == pytest.approx((-40.0, 40.0), abs=4.0)


def test_who_begins_in_the_middle_needs_no_past() -> None:
    """A mapper that is restarted, 30 mm and 3 degrees off, at any time."""
    last = stood(PoseTracker(ROOM), scan_at(ROOM, *AT), position(1_430.0, 1_200.0, 23.0, 10**15))
    assert last.x_mm == pytest.approx(-30.0, abs=4.0)
    assert last.heading_deg == pytest.approx(-3.0, abs=0.3)


def test_hours_at_one_place_leave_it_able_to_learn() -> None:
    """Scans make it surer and surer; then the robot is pushed aside by 80 mm while its wheels stand."""
    tracker = PoseTracker(ROOM)
    stood(tracker, scan_at(ROOM, *AT), position(*AT), scans=2_000)
    pushed = scan_at(ROOM, AT[0] + 80.0, AT[1], AT[2])
    last = stood(tracker, pushed, position(*AT, t_ns=2_000 * PERIOD_NS), scans=60)
    assert last.x_mm == pytest.approx(80.0, abs=20.0)


@settings(max_examples=60, deadline=None)
@given(
    scans=st.lists(
        st.tuples(SCAN, st.floats(-4e3, 4e3), st.floats(-4e3, 4e3), st.floats(-10.0, 10.0)),
        min_size=1,
        max_size=12,
    ),
)
def test_certainties_stay_within_their_bounds(
    scans: list[tuple[tuple[float, ...], float, float, float]],
) -> None:
    local = HimmMap(HimmParameters(half_side_mm=3_000.0))
    for ranges, ahead, left, heading in scans:
        local.mark(LocalPose(ahead, left, heading), np.array(ranges))
        assert local.grid.max() <= MAX_CERTAINTY  # unsigned: what is below 0 would be above
    cells = local.cells()
    assert np.abs(np.concatenate([cells.ahead_mm, cells.left_mm, [0.0]])).max() < 3_000.0


@settings(max_examples=80, deadline=None)
@given(
    angle=st.floats(-90.0, 89.9),
    distance=st.floats(-3_000.0, 3_000.0),
    begin=st.floats(-3_000.0, 0.0),
    length=st.floats(1_500.0, 4_000.0),
)
def test_a_line_that_is_drawn_is_found(angle: float, distance: float, begin: float, length: float) -> None:
    along = np.arange(begin, begin + length, 20.0)
    cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    ahead, left = cosine * along - sine * distance, sine * along + cosine * distance
    at = np.unique(np.floor(np.stack([ahead, left], axis=1) / 100.0) * 100.0 + 50.0, axis=0)
    first = lines_in(Cells(at[:, 0], at[:, 1], np.full(len(at), 12.0)), HoughParameters())[0]
    off = math.remainder(first.angle_deg - angle, 180.0)
    # Cells along the grid may have a step of one cell: what is fitted to it is steeper by half than it.
    assert abs(off) < math.degrees(1.5 * 110.0 / length)
    sign = 1.0 if abs(first.angle_deg - angle) < 90.0 else -1.0
    middle = begin + length / 2.0
    there = sign * first.distance_mm + middle * math.sin(math.radians(off))
    assert there == pytest.approx(distance, abs=60.0)  # half a cell, and a little
