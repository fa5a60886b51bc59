from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.filter import JumpLimit, PoseFilter, Uncertainty
from colony.vision.detections import PlateBox, PlateReading
from colony.vision.level_camera import SIDE
from colony.vision.plates.observations import PlateObservation, fix_of_plate, observe_plate
from studies.thesis.wall_view import WallView
from tests.nav.sonars import RING
from tests.vision.plates.walls import corners_of, plate

NOTHING = PlateReading("", 0.0)
PLATE = Plate(
    edge=0, start_mm=0.0, end_mm=356.0, center=Point(100.0, 1900.0), heading_deg=10.0, door="352", text="352"
)


def look_from(x: float, y: float, heading: float) -> PlateObservation:
    """A perfect look at `PLATE`."""
    dx, dy = PLATE.center.x - x, PLATE.center.y - y
    axis = heading + 90.0
    bearing = math.remainder(math.degrees(math.atan2(-dx, dy)) - axis, 360.0)
    depth = math.hypot(dx, dy) * math.cos(math.radians(bearing))
    return PlateObservation(0, Pose(x, y, heading), axis, bearing, depth, 0.0, 1.0, NOTHING)


def box_of(place_mm: float, view: WallView) -> PlateBox:
    a, b, c, d = (tuple(corner) for corner in corners_of(plate("352", place_mm), view).tolist())
    return PlateBox((a, b, c, d), 1.0)


@given(st.floats(700.0, 2500.0), st.floats(-25.0, 25.0), st.floats(-0.3, 0.3), st.floats(0.0, 360.0))
def test_a_plate_is_placed_where_it_hangs(d: float, tilt: float, part: float, heading: float) -> None:
    view = WallView(d, tilt)
    place = view.place_of(SIDE, 119.5 + 240.0 * part * 0.8)
    robot = Pose(1000.0, 2000.0, heading)
    seen = observe_plate(box_of(place, view), SIDE, robot, t_ns=7, reading=NOTHING)
    # The wall's normal is the optical axis less the tilt; places count to the left of it.
    normal = math.radians(heading + 90.0 - tilt)
    x = robot.x_mm - math.sin(normal) * d - math.cos(normal) * place
    y = robot.y_mm + math.cos(normal) * d - math.sin(normal) * place
    assert seen.place == pytest.approx((x, y), abs=0.5)
    assert seen.rise_mm == pytest.approx(0.0, abs=1e-6)
    assert seen.t_ns == 7


def test_what_hangs_higher_rises() -> None:
    view = WallView(1500.0, 5.0)
    box = box_of(0.0, view)
    lifted = PlateBox(tuple((column, row - 1.0) for column, row in box.corners), 1.0)  # type: ignore[arg-type]
    seen = observe_plate(lifted, SIDE, Pose(0.0, 0.0, 0.0), t_ns=0, reading=NOTHING)
    assert seen.rise_mm == pytest.approx(seen.depth_mm / SIDE.focal)
    band = PlateBox(tuple((column, row - 30.0) for column, row in box.corners), 1.0)  # type: ignore[arg-type]
    in_band = observe_plate(band, SIDE, Pose(0.0, 0.0, 0.0), t_ns=0, reading=NOTHING, first_row=30)
    assert in_band.rise_mm == pytest.approx(0.0, abs=1e-6)


poses = st.tuples(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0), st.floats(-130.0, -70.0))


@given(poses, st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0), st.floats(-1.0, 1.0)))
def test_a_fix_holds_for_the_true_pose_whatever_was_believed(
    true: tuple[float, float, float], error: tuple[float, float, float]
) -> None:
    seen = look_from(*true)
    x, y, heading = (a + b for a, b in zip(true, error, strict=True))
    believed = seen._replace(robot=Pose(x, y, heading), axis_deg=seen.axis_deg + error[2])
    bearing, depth = fix_of_plate(believed, PLATE).rows
    assert depth.ch == 0.0  # where the plate is straight before the camera, it would be next to nothing
    for row, most in ((bearing, 2.0), (depth, depth.sigma / 3.0)):
        off = row.cx * true[0] + row.cy * true[1] + row.ch * math.radians(true[2]) - row.value
        assert abs(off) < most  # 2 mm: an error of a degree times one of 30 mm, and so on
        assert math.hypot(row.cx, row.cy) == pytest.approx(1.0)
        assert 0.0 < row.sigma < 400.0


def test_the_sigmas_of_a_fix_cover_looks_that_are_off() -> None:
    rng = np.random.default_rng(5)
    print("seed 5")
    offs: list[list[float]] = [[], []]
    for _ in range(400):
        true = (rng.uniform(-300, 300), rng.uniform(-300, 300), rng.uniform(-120, -80))
        seen = look_from(*true)
        noisy = seen._replace(
            bearing_deg=seen.bearing_deg + 0.15 * rng.standard_normal(),
            depth_mm=seen.depth_mm * (1.0 + 0.04 * rng.standard_normal()),
        )
        for number, row in enumerate(fix_of_plate(noisy, PLATE).rows):
            off = row.cx * true[0] + row.cy * true[1] + row.ch * math.radians(true[2]) - row.value
            offs[number].append(off / row.sigma)
    # One look is better than its sigma says: that is for what several looks at a plate have in common.
    assert np.std(offs[0]) < 0.3
    assert 0.3 < np.std(offs[1]) < 0.5


@pytest.mark.parametrize("ahead_mm", [0.0, 3.0, 40.0, 300.0])
def test_the_depth_moves_the_filter_to_the_wall_wherever_the_plate_is_in_the_image(ahead_mm: float) -> None:
    """The robot drives along the wall, 150 mm nearer to it than it believes."""
    true_x, y, heading = PLATE.center.x + 1_000.0, PLATE.center.y - ahead_mm, 0.0
    believed = look_from(true_x, y, heading)._replace(robot=Pose(true_x + 150.0, y, heading))
    pose_filter = PoseFilter(RING, (true_x + 150.0, y, heading), Uncertainty(start_mm=200.0))
    for row in fix_of_plate(believed, PLATE).rows:
        assert pose_filter.observe(row, limit=JumpLimit(400.0, math.radians(10.0)))
    assert pose_filter.state[0] - true_x < 60.0
