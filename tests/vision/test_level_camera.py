"""The geometry of cameras that look along the floor."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.vision.level_camera import AHEAD, SIDE, LevelCamera

cameras = st.builds(
    LevelCamera,
    columns=st.integers(4, 640),
    rows=st.integers(4, 480),
    view_deg=st.floats(10.0, 150.0),
    yaw_deg=st.floats(-180.0, 180.0),
    height_mm=st.floats(100.0, 2500.0),
)


@given(cameras, st.floats(-80.0, 80.0))
def test_columns_and_bearings_are_one_another(camera: LevelCamera, bearing: float) -> None:
    assert camera.bearing_of(camera.column_of(bearing)) == pytest.approx(bearing, abs=1e-6)


@given(cameras)
def test_the_outer_edges_of_the_image_are_half_the_view_away(camera: LevelCamera) -> None:
    assert camera.column_of(camera.view_deg / 2) == pytest.approx(-0.5, abs=1e-6)
    assert camera.column_of(-camera.view_deg / 2) == pytest.approx(camera.columns - 0.5, abs=1e-6)


@given(cameras, st.floats(0.0, 3000.0), st.floats(100.0, 20_000.0))
def test_what_is_higher_is_seen_further_up(camera: LevelCamera, above: float, depth: float) -> None:
    row = camera.row_of(above, depth)
    assert (row < (camera.rows - 1) / 2) == (above > camera.height_mm) or above == camera.height_mm
    assert (above - camera.height_mm) * camera.focal / depth == pytest.approx(
        (camera.rows - 1) / 2 - row, abs=1e-6
    )


def test_a_plate_of_the_thesis_robot_is_as_large_as_it_is() -> None:
    assert pytest.approx(207.846, abs=1e-3) == SIDE.focal
    assert SIDE.yaw_deg == 90.0
    assert AHEAD.yaw_deg == 0.0
    assert 2 * SIDE.focal * math.tan(math.radians(30.0)) == pytest.approx(SIDE.columns)


@pytest.mark.parametrize(
    "wrong",
    [{"columns": 3}, {"view_deg": 180.0}, {"view_deg": math.nan}, {"height_mm": 0.0}, {"yaw_deg": math.inf}],
)
def test_what_makes_no_camera_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected"):
        replace(AHEAD, **wrong)  # type: ignore[arg-type]
