from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.vision.level_camera import AHEAD, SIDE
from studies.thesis.wall_view import WallView, overlap_mm, starting_column

distances = st.floats(300.0, 4000.0)
tilts = st.floats(-49.9, 49.9)
HALF = SIDE.view_deg / 2.0


def rim_mm(view: WallView, bearing_deg: float) -> float:
    """Where a ray meets a wall that runs along the y axis at x = -d, of a camera at the origin that looks to
    the west, turned by the tilt: how far south of the camera. By two lines in the plane, without a formula of
    the thesis."""
    heading = math.radians(90.0 + view.tilt_deg + bearing_deg)
    east, north = -math.sin(heading), math.cos(heading)
    return -north * (-view.distance_mm / east)


@given(distances, tilts)
def test_the_projections_of_the_field_of_view(distance: float, tilt: float) -> None:
    view = WallView(distance, tilt)
    if tilt + HALF < 80.0:
        assert view.left_mm(SIDE.view_deg) == pytest.approx(rim_mm(view, HALF), rel=1e-9, abs=1e-6)
    if HALF - tilt < 80.0:
        assert view.right_mm(SIDE.view_deg) == pytest.approx(-rim_mm(view, -HALF), rel=1e-9, abs=1e-6)


def test_signs_of_the_projections() -> None:
    assert WallView(1000.0, -40.0).left_mm(60.0) < 0.0 < WallView(1000.0, -20.0).left_mm(60.0)
    assert WallView(1000.0, 40.0).right_mm(60.0) < 0.0 < WallView(1000.0, 20.0).right_mm(60.0)
    assert WallView(1000.0, 40.0).left_mm(120.0) == math.inf


@given(distances, st.floats(-20.0, 20.0), st.floats(-119.0, 119.0))
def test_columns_and_places_are_inverse(distance: float, tilt: float, offset: float) -> None:
    view, column = WallView(distance, tilt), 119.5 + offset
    place = view.place_of(SIDE, column)
    assert place == pytest.approx(rim_mm(view, SIDE.bearing_of(column)), rel=1e-9, abs=1e-6)
    assert view.column_of(SIDE, place) == pytest.approx(column, abs=1e-6)


@given(distances, st.floats(-15.0, 15.0), st.floats(-15.0, 15.0), st.floats(0.0, 6000.0))
def test_the_overlap_is_what_both_images_show(d: float, one: float, other: float, moved: float) -> None:
    first, second = WallView(d, one), WallView(d, other)
    # Along the way of the robot, from where it was first.
    ahead_first, behind_second = first.right_mm(60.0), moved - second.left_mm(60.0)
    assert overlap_mm(first, second, moved, 60.0) == pytest.approx(ahead_first - behind_second, abs=1e-6)


@given(distances, st.floats(-15.0, 15.0), st.floats(-15.0, 15.0), st.floats(0.0, 6000.0))
def test_the_starting_column_is_where_new_wall_begins(
    d: float, one: float, other: float, moved: float
) -> None:
    first, second = WallView(d, one), WallView(d, other)
    column = starting_column(first, second, moved, SIDE)
    seen_to = first.right_mm(60.0)
    if column < SIDE.columns:  # where that column looks, along the way of the robot, was not seen before
        assert moved - second.place_of(SIDE, column) >= seen_to - 1e-6 or column == 0
    if column > 0:  # and where the one before it looks was
        assert moved - second.place_of(SIDE, column - 1.0) <= seen_to + 1e-6


def test_who_stands_starts_beyond_the_image_and_who_is_far_on_at_its_first_column() -> None:
    view = WallView(1500.0, 0.0)
    assert starting_column(view, view, 0.0, SIDE) == 240
    assert starting_column(view, view, 1800.0, SIDE) == 0
    half = starting_column(view, view, 1500.0 * math.tan(math.radians(30.0)), SIDE)
    assert half == 120


def test_other_cameras() -> None:
    wide = replace(AHEAD, columns=640, rows=480, view_deg=80.0)
    view = WallView(1000.0, 10.0)
    assert view.column_of(wide, view.left_mm(80.0)) == pytest.approx(-0.5)
    assert view.column_of(wide, -view.right_mm(80.0)) == pytest.approx(639.5)
