from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.nav.maps.stickrep.reader import read_map
from colony.nav.maps.walls import walls_of
from colony.nav.pose.echoes import Floats, reflectors_of
from colony.nav.pose.filter import JumpLimit, PoseFilter, Uncertainty
from colony.nav.pose.pose import MeasurementRow, MotionSince, OdometryStep
from colony.text.source import Source
from tests.nav.maps.small_maps import ROOM
from tests.nav.sonars import CHANNELS, RING

MIRRORS = reflectors_of(walls_of(read_map(Source("room", ROOM.replace("glass", "wood")))))
TRUE = (1_400.0, 1_200.0, 20.0)


def scan(pose: tuple[float, float, float] = TRUE) -> Floats:
    """What is read at a pose, by the same model: what is left of an error is the filter's own."""
    ranges = RING.predict(MIRRORS, pose[0], pose[1], math.radians(pose[2])).ranges
    return np.where(np.isfinite(ranges), ranges, 10_000.0)


def off(pose_filter: PoseFilter) -> tuple[float, float]:
    """By how much the position is off in mm, and the heading in degrees."""
    x, y, heading = pose_filter.state[:3].tolist()
    return math.hypot(x - TRUE[0], y - TRUE[1]), abs(math.remainder(math.degrees(heading) - TRUE[2], 360.0))


def test_scans_correct_the_pose_and_make_it_surer() -> None:
    pose_filter = PoseFilter(RING, (1_440.0, 1_160.0, 22.0))
    before = np.diag(pose_filter.covariance).copy()
    for _ in range(10):
        pose_filter.observe_scan(MIRRORS, scan())
    assert off(pose_filter)[0] < 3.0
    assert off(pose_filter)[1] < 0.2
    assert (np.diag(pose_filter.covariance)[:3] < 0.1 * before[:3]).all()
    assert not pose_filter.is_lost


def test_a_reading_that_is_far_off_does_not_count() -> None:
    pose_filter, other = PoseFilter(RING, TRUE), PoseFilter(RING, TRUE)
    disturbed = scan()
    disturbed[[3, 9, 20]] = 250.0  # people, and cross-talk
    pose_filter.observe_scan(MIRRORS, scan())
    other.observe_scan(MIRRORS, disturbed)
    assert off(other) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_scan_while_turning_says_less_of_the_heading() -> None:
    pose_filter, blurred = PoseFilter(RING, TRUE), PoseFilter(RING, TRUE)
    pose_filter.observe_scan(MIRRORS, scan())
    blurred.observe_scan(MIRRORS, scan(), math.radians(6.0))
    assert blurred.covariance[2, 2] > 2.0 * pose_filter.covariance[2, 2]


def test_moving_makes_it_less_sure_up_to_a_bound() -> None:
    pose_filter = PoseFilter(RING, TRUE, Uncertainty(max_mm=200.0))
    x, y, heading = pose_filter.state[:3]
    assert pose_filter.move(OdometryStep(0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    pose_filter.move(OdometryStep(100.0, 20.0, 0.1))
    expected = (
        x - 100 * math.sin(heading) - 20 * math.cos(heading),
        y + 100 * math.cos(heading) - 20 * math.sin(heading),
    )
    assert pose_filter.state[:2].tolist() == pytest.approx(expected)
    assert pose_filter.state[2] == pytest.approx(heading + 0.1)
    for _ in range(500):
        pose_filter.move(OdometryStep(100.0, 0.0, 0.0))
    assert np.sqrt(np.diag(pose_filter.covariance)[:2]).max() == pytest.approx(200.0, rel=0.01)
    assert (np.linalg.eigvalsh(pose_filter.covariance) > -1e-9).all()


def test_the_drift_of_the_odometry_is_learned() -> None:
    """A robot goes back and forth, and turns two degrees a meter to the left, which it does not notice."""
    drift, pose, pose_filter = math.radians(2.0) / 1e3, TRUE, PoseFilter(RING, TRUE)
    for i in range(400):
        step = 20.0 if i // 20 % 2 == 0 else -20.0
        x, y, heading = pose[0], pose[1], math.radians(pose[2])
        pose = (
            x - step * math.sin(heading),
            y + step * math.cos(heading),
            pose[2] + math.degrees(drift * step),
        )
        moved = pose_filter.move(OdometryStep(step, 0.0, 0.0))
        pose_filter.observe_scan(MIRRORS, scan(pose))
    assert pose_filter.state[3] == pytest.approx(drift, rel=0.3)
    assert math.copysign(1.0, moved.turned_rad) == math.copysign(1.0, step)


@pytest.mark.parametrize("turn", [-33.0, -12.0, 17.0, 30.0])
def test_who_is_turned_finds_the_way_again_by_one_scan(turn: float) -> None:
    pose_filter = PoseFilter(RING, (1_420.0, 1_180.0, TRUE[2] - turn))
    assert pose_filter.relocate(MIRRORS, scan())
    assert off(pose_filter)[1] < 2.0
    assert off(pose_filter)[0] < 30.0


def test_who_is_right_stays_where_he_is() -> None:
    pose_filter = PoseFilter(RING, TRUE)
    assert not pose_filter.relocate(MIRRORS, scan())
    assert off(pose_filter) == (0.0, 0.0)


def test_a_scan_that_fits_nowhere_changes_nothing() -> None:
    pose_filter = PoseFilter(RING, TRUE)
    state, covariance = pose_filter.state.copy(), pose_filter.covariance.copy()
    for ranges in (np.full(CHANNELS, 300.0), np.full(CHANNELS, 10_000.0), np.full(CHANNELS, math.nan)):
        assert not pose_filter.relocate(MIRRORS, ranges)
        assert not pose_filter.adopt_if_better((1_000.0, 1_000.0, 90.0), MIRRORS, ranges)
    assert (pose_filter.state == state).all()
    assert (pose_filter.covariance == covariance).all()


def test_who_hears_nothing_of_what_he_should_is_lost_and_who_expects_nothing_is_not() -> None:
    lost, outside = PoseFilter(RING, TRUE), PoseFilter(RING, (90_000.0, 0.0, 0.0))
    for _ in range(6):
        lost.observe_scan(MIRRORS, np.full(CHANNELS, 10_000.0))
        outside.observe_scan(MIRRORS, np.full(CHANNELS, 500.0))
    assert lost.is_lost
    assert not outside.is_lost
    assert off(lost) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_another_pose_is_taken_only_if_it_explains_more() -> None:
    pose_filter = PoseFilter(RING, (1_000.0, 1_200.0, 70.0))
    assert not pose_filter.adopt_if_better((1_000.0, 1_600.0, -40.0), MIRRORS, scan())
    assert pose_filter.adopt_if_better((TRUE[0] + 40.0, TRUE[1], TRUE[2] - 2.0), MIRRORS, scan())
    assert off(pose_filter)[0] < 10.0
    assert not pose_filter.adopt_if_better(TRUE, MIRRORS, scan())


def test_a_correction_by_others_moves_the_pose_and_not_the_doubt() -> None:
    pose_filter = PoseFilter(RING, TRUE)
    covariance = pose_filter.covariance.copy()
    pose_filter.shift(100.0, -50.0, 0.1)
    assert pose_filter.state[:3].tolist() == pytest.approx([1_500.0, 1_150.0, math.radians(20.0) + 0.1])
    assert (pose_filter.covariance == covariance).all()
    pose_filter.reset((0.0, 0.0, 90.0))
    assert pose_filter.state[:3].tolist() == pytest.approx([0.0, 0.0, math.pi / 2])


# --- landmarks ----------------------------------------------------------------------------------------


BELIEVED = JumpLimit(500.0, 0.3)


def drive(pose_filter: PoseFilter, travel_mm: float) -> None:
    """Go straight on, in steps of 50 mm."""
    for _ in range(round(travel_mm / 50.0)):
        pose_filter.move(OdometryStep(50.0, 0.0, 0.0))


def test_a_landmark_corrects_the_place_along_its_row_and_nothing_across_it() -> None:
    pose_filter = PoseFilter(RING, (1_000.0, 2_000.0, 0.0))
    before = pose_filter.covariance.copy()
    assert pose_filter.observe(MeasurementRow(0.0, 1.0, 0.0, 2_050.0, 20.0))
    part = before[1, 1] / (before[1, 1] + 400.0)
    assert pose_filter.state[1] == pytest.approx(2_000.0 + part * 50.0)
    assert pose_filter.covariance[1, 1] == pytest.approx(part * 400.0)
    assert pose_filter.state[0] == 1_000.0
    assert pose_filter.covariance[0, 0] == pytest.approx(before[0, 0])


@pytest.mark.parametrize("turns", [-1, 0, 2])
def test_a_heading_is_right_from_whatever_turn_it_is_counted(turns: int) -> None:
    pose_filter = PoseFilter(RING, (0.0, 0.0, 359.0))
    value = math.radians(1.0) + turns * 2.0 * math.pi
    for _ in range(200):
        assert pose_filter.observe(MeasurementRow(0.0, 0.0, 1.0, value, math.radians(0.5)))
    assert math.degrees(pose_filter.state[2]) == pytest.approx(361.0, abs=0.1)


def test_what_was_seen_a_while_ago_holds_for_the_pose_of_then() -> None:
    """The robot went a meter to the north and half a meter to the west since."""
    now, then = PoseFilter(RING, (0.0, 0.0, 90.0)), PoseFilter(RING, (0.0, 0.0, 90.0))
    since = MotionSince(ahead_mm=500.0, left_mm=-1_000.0, turned_rad=math.radians(90.0), travel_mm=0.0)
    assert now.observe(MeasurementRow(0.0, 1.0, 0.0, 30.0, 20.0))
    assert then.observe(MeasurementRow(0.0, 1.0, 0.0, 30.0 - 1_000.0, 20.0), since)
    assert then.state[1] == pytest.approx(now.state[1], rel=0.5)
    # A heading that is off by a radian puts the place of then half a meter off: it goes with it.
    assert then.covariance[1, 2] < -1e-3
    assert then.covariance[1, 1] > now.covariance[1, 1]


def test_the_scale_of_the_odometry_is_learned_from_landmarks() -> None:
    """Who believes to go a meter goes 985 mm."""
    pose_filter, true = PoseFilter(RING, (0.0, 0.0, 0.0)), 0.0
    for _ in range(10):
        drive(pose_filter, 5_000.0)
        true += 5_000.0 * 0.985
        assert pose_filter.observe(MeasurementRow(0.0, 1.0, 0.0, true, 25.0))
    assert pose_filter.state[4] == pytest.approx(-0.015, abs=0.002)
    drive(pose_filter, 5_000.0)
    assert pose_filter.state[1] == pytest.approx(true + 5_000.0 * 0.985, abs=15.0)


def test_a_landmark_that_surprises_tells_of_a_slip_and_teaches_nothing() -> None:
    pose_filter = PoseFilter(RING, (0.0, 0.0, 0.0))
    drive(pose_filter, 5_000.0)
    assert pose_filter.observe(MeasurementRow(0.0, 1.0, 0.0, 5_000.0, 25.0))
    scale = pose_filter.state[4]
    drive(pose_filter, 1_000.0)
    assert pose_filter.observe(MeasurementRow(0.0, 1.0, 0.0, 5_600.0, 25.0), limit=BELIEVED)
    assert pose_filter.state[1] == pytest.approx(5_600.0, abs=10.0)
    assert pose_filter.state[4] == scale
    assert pose_filter.covariance[1, 1] < 30.0**2


def test_a_heading_that_surprises_is_taken_over() -> None:
    pose_filter = PoseFilter(RING, (0.0, 0.0, 0.0))
    pose_filter.observe(MeasurementRow(0.0, 0.0, 1.0, 0.0, 0.005))
    assert pose_filter.observe(MeasurementRow(0.0, 0.0, 1.0, 0.2, 0.01), limit=BELIEVED)
    assert pose_filter.state[2] == pytest.approx(0.2, abs=0.005)


@pytest.mark.parametrize(
    "row",
    [
        MeasurementRow(0.0, 1.0, 0.0, 900.0, 25.0),  # farther off than any slip
        MeasurementRow(0.0, 1.0, 0.0, 0.0, 0.0),
        MeasurementRow(0.0, 1.0, 0.0, 0.0, -1.0),
        MeasurementRow(0.0, 0.0, 0.0, 5.0, 1.0),
        MeasurementRow(0.0, 0.0, 1.0, 0.5, 0.01),
        MeasurementRow(
            0.0, 1.0, 10.0, 100.0, 25.0
        ),  # a turn of the heading is 63 mm: is it off by 100 or by 37?
    ],
)
def test_what_is_not_believed_changes_nothing(row: MeasurementRow) -> None:
    pose_filter = PoseFilter(RING, (0.0, 0.0, 0.0))
    state, covariance = pose_filter.state.copy(), pose_filter.covariance.copy()
    assert not pose_filter.observe(row, limit=BELIEVED)
    assert (pose_filter.state == state).all()
    assert (pose_filter.covariance == covariance).all()


rows = st.builds(
    MeasurementRow,
    st.floats(-1, 1),
    st.floats(-1, 1),
    st.floats(-2e3, 2e3),
    st.floats(-1e4, 1e4),
    st.floats(0.1, 1e3),
)


@given(st.lists(rows, max_size=8))
def test_the_covariance_stays_one_whatever_landmarks_tell(rows: list[MeasurementRow]) -> None:
    pose_filter = PoseFilter(RING, (0.0, 0.0, 0.0))
    for row in rows:
        pose_filter.observe(row, limit=BELIEVED)
        pose_filter.move(OdometryStep(50.0, 0.0, 0.02))
    assert np.isfinite(pose_filter.state).all()
    scale = np.sqrt(np.diag(pose_filter.covariance))
    assert (np.linalg.eigvalsh(pose_filter.covariance / np.outer(scale, scale)) > -1e-7).all()
