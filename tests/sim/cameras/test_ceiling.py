"""The camera that looks up: where lights are in its image, how bright things are, what noise depends on."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.runtime.transport.virtual import VirtualClock
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.drivers import Plant, SimulatedCamera, image_of
from colony.sim.hazards.hazards import Hazard, Hazards, draw
from colony.sim.hazards.scenery import CeilingLight, Scenery, SunBand
from colony.sim.world.world import World
from tests.buildings import MSU
from tests.sim.robots import UP_CAMERA

NO_WALLS = np.zeros((0, 4))
SHARP = replace(UP_CAMERA, noise=0.0, vignetting=0.0, blur_mm=0.1)
H = 1350.0
FX, FY = 120.0 / math.tan(math.radians(30.0)), 60.0 / math.tan(math.radians(24.0))
ON = 200
"""Brighter than any ceiling, and darker than any light."""


def scenery(*lights: CeilingLight, sun: tuple[SunBand, ...] = (), seed: int = 0) -> Scenery:
    silent = np.zeros(0, dtype=np.bool_)
    return Scenery(seed=seed, walls=NO_WALLS, silent=silent, lights=lights, sun=sun)


def lit(camera: CeilingCamera, pose: tuple[float, float, float]) -> tuple[int, int, int, int]:
    """The first and last column, and the first and last row, in which there is light."""
    rows, columns = np.nonzero(camera.image(pose, 0) > ON)
    return int(columns.min()), int(columns.max()), int(rows.min()), int(rows.max())


def column_of(ahead_mm: float) -> float:
    return 119.5 + FX * ahead_mm / H


def row_of(left_mm: float) -> float:
    return 59.5 - FY * left_mm / H


@pytest.mark.parametrize("heading", [0.0, 90.0, 180.0, 270.0, 37.0])
@pytest.mark.parametrize(("ahead", "left"), [(0.0, 0.0), (300.0, 0.0), (-250.0, 150.0), (120.0, -400.0)])
def test_a_light_is_in_the_image_where_the_lens_puts_it(heading: float, ahead: float, left: float) -> None:
    sine, cosine = math.sin(math.radians(heading)), math.cos(math.radians(heading))
    x, y = 5000.0 - ahead * sine - left * cosine, 7000.0 + ahead * cosine - left * sine
    lamp = CeilingLight(x_mm=x, y_mm=y, heading_deg=heading)
    first, last, top, bottom = lit(CeilingCamera(scenery(lamp), SHARP), (5000.0, 7000.0, heading))
    assert first == pytest.approx(max(column_of(ahead - 300.0), 0.0), abs=1.0)
    assert last == pytest.approx(min(column_of(ahead + 300.0), 239.0), abs=1.0)
    assert top == pytest.approx(max(row_of(left + 600.0), 0.0), abs=1.0)
    assert bottom == pytest.approx(min(row_of(left - 600.0), 119.0), abs=1.0)


def test_a_light_across_the_way_is_longer_across_the_image() -> None:
    lamp = CeilingLight(x_mm=0.0, y_mm=0.0, heading_deg=90.0)  # hangs in a corridor that crosses this one
    first, last, top, bottom = lit(CeilingCamera(scenery(lamp), SHARP), (0.0, 0.0, 0.0))
    assert last - first == pytest.approx(FX * 1200.0 / H, abs=2.0)
    assert bottom - top == pytest.approx(FY * 600.0 / H, abs=2.0)


def test_a_light_comes_in_at_the_right_and_leaves_at_the_left() -> None:
    camera = CeilingCamera(scenery(CeilingLight(x_mm=0.0, y_mm=2000.0, heading_deg=0.0)), SHARP)
    seen = [np.flatnonzero(camera.rows((0.0, y, 0.0), 0, [60])[0] > ON) for y in range(0, 4000, 10)]
    first = next(i for i, columns in enumerate(seen) if columns.size)
    last = max(i for i, columns in enumerate(seen) if columns.size)
    half_view = H * math.tan(math.radians(30.0))
    assert first * 10 == pytest.approx(2000.0 - 300.0 - half_view, abs=15.0)
    assert last * 10 == pytest.approx(2000.0 + 300.0 + half_view, abs=15.0)
    assert seen[first].max() == 239
    assert seen[last].min() == 0


def test_the_blur_widens_an_edge_and_leaves_its_middle() -> None:
    lamp = CeilingLight(x_mm=0.0, y_mm=0.0, heading_deg=0.0)
    widths = []
    for blur in (5.0, 40.0):
        config = replace(UP_CAMERA, noise=0.0, vignetting=0.0, blur_mm=blur)
        row = CeilingCamera(scenery(lamp), config).rows((0.0, 0.0, 0.0), 0, [59])[0].astype(float)
        low, high = np.median(row[:40]), row[119]
        part = (row - low) / (high - low)
        assert int(np.argmax(part > 0.5)) == pytest.approx(column_of(-300.0), abs=1.0)
        widths.append(int(np.argmax(part > 0.95)) - int(np.argmax(part > 0.1)))
    assert widths[0] <= 2 < 6 <= widths[1]


def test_lights_are_on_dim_or_out() -> None:
    levels = []
    for brightness in (1.0, 1.0 / 3.0, 0.0):
        lamp = CeilingLight(x_mm=0.0, y_mm=0.0, heading_deg=0.0, brightness=brightness)
        image = CeilingCamera(scenery(lamp), SHARP).image((0.0, 0.0, 0.0), 0).astype(float)
        levels.append(image[60, 120] - np.median(image[:, :40]))
    assert levels[0] == pytest.approx(3.0 * levels[1], abs=8.0)
    assert -25.0 < levels[2] < 0.0


def test_the_sun_makes_the_ceiling_bright_and_lights_faint() -> None:
    lamp = CeilingLight(x_mm=0.0, y_mm=0.0, heading_deg=0.0)
    band = SunBand(x_mm=0.0, y_mm=0.0, heading_deg=0.0, length_mm=9e3, width_mm=9e3, level=105.0)
    contrast = []
    for sun in ((), (band,)):
        image = CeilingCamera(scenery(lamp, sun=sun), SHARP).image((0.0, 0.0, 0.0), 0).astype(float)
        contrast.append(image[60, 120] - np.median(image[:, :40]))
    assert contrast[1] < 0.6 * contrast[0]


def test_corners_are_darker_than_the_middle() -> None:
    config = replace(UP_CAMERA, noise=0.0, vignetting=0.5)
    image = CeilingCamera(scenery(), config).image((150.0, 150.0, 0.0), 0).astype(float)
    corner = np.median(image[:10, :10])
    assert corner < 0.7 * np.median(image[55:65, 110:130])


def test_noise_depends_on_seed_and_time_alone() -> None:
    pose = (150.0, 150.0, 12.0)
    camera, twin, other = (CeilingCamera(scenery(seed=seed)) for seed in (1, 1, 2))
    first = camera.image(pose, 1_000)
    camera.image(pose, 2_000)
    assert (camera.image(pose, 1_000) == first).all()
    assert (twin.image(pose, 1_000) == first).all()
    assert (camera.image(pose, 1_001) != first).mean() > 0.5
    assert (other.image(pose, 1_000) != first).mean() > 0.5


def test_noise_has_the_deviation_that_the_config_says() -> None:
    pose = (300.0, 300.0, 0.0)
    noisy = CeilingCamera(scenery(), replace(UP_CAMERA, noise=5.0)).image(pose, 7).astype(float)
    clean = CeilingCamera(scenery(), replace(UP_CAMERA, noise=0.0)).image(pose, 7).astype(float)
    assert (noisy - clean).std() == pytest.approx(5.0, abs=0.2)
    assert abs((noisy - clean).mean()) < 0.2


def test_rows_alone_are_those_of_the_image() -> None:
    every = draw(Hazards(sunlit=1.0), MSU, 4)
    camera = CeilingCamera(every)
    for light in every.lights[::9]:
        pose = (light.x_mm + 200.0, light.y_mm - 90.0, light.heading_deg + 7.0)
        rows = camera.rows(pose, 55, (90, 30, 60))
        assert (rows == camera.image(pose, 55)[[90, 30, 60]]).all()


@pytest.mark.parametrize("row", [-1, 120])
def test_rows_that_there_are_not_are_refused(row: int) -> None:
    with pytest.raises(ValueError, match="expected numbers from 0 to 119"):
        CeilingCamera(scenery()).rows((0.0, 0.0, 0.0), 0, [3, row])


@pytest.mark.parametrize("wrong", [{"along_deg": 180.0}, {"noise": math.nan}, {"width": 0}, {"blur_mm": 0.0}])
def test_cameras_that_make_no_sense_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected"):
        replace(UP_CAMERA, **wrong)  # type: ignore[arg-type]


def test_a_driver_grabs_what_is_above_the_robot_now() -> None:
    every = draw(Hazards().without(Hazard.PEOPLE), MSU, 4)
    clock = VirtualClock()
    world = World(walls=every, poses=[MSU.start], seed=1)
    camera = CeilingCamera(every)
    driver = SimulatedCamera(
        Plant(world, clock), lambda now_ns: image_of(camera.image(world.true_pose(0), now_ns), now_ns)
    )
    world.command(0, 300.0, 0.0)
    before = driver.grab().rows(0, 120)
    clock.now_ns = 1_500_000_000
    after = driver.grab().rows(0, 120)
    assert (after.t_ns, after.height, after.width, after.channels) == (1_500_000_000, 120, 240, 1)
    assert after.pixels != before.pixels
    assert after.pixels == camera.image(world.true_pose(0), 1_500_000_000).tobytes()
