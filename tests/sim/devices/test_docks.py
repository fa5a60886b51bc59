"""Docks of a map: what charges there, and what sees them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.nav.maps.stickrep.model import Pose
from colony.nav.maps.stickrep.reader import load_map
from colony.sim.hazards.hazards import Hazards, draw
from tests.paths import MAPS
from tests.sim.devices.stage import Stage
from tests.sim.devices.test_devices import BATTERY

EYE = """
[server.Eye.simulated]
device = "dock_sensor"
pose   = ["200 mm", "100 mm", "30 deg"]
range  = "3 m"
view   = "90 deg"
"""
NOISY = EYE + 'noise = "20 mm"\nbearing_noise = "2 deg"\n'


def seen(stage: Stage, robot: int = 0) -> tuple[object, ...]:
    return tuple(stage.read("Eye", field, robot) for field in ("dock_seen", "dock_distance", "dock_bearing"))


def test_a_battery_is_charged_at_the_docks_of_the_map_alone() -> None:
    stage = Stage(BATTERY, docks=[(5000.0, 0.0, 90.0), (9000.0, 0.0, 0.0)])
    assert stage.read("Battery", "charging") is False  # where the run began
    for x, is_reached in ((4760.0, True), (4740.0, False), (5240.0, True), (9000.0, True), (7000.0, False)):
        stage.world.place(0, (x, 0.0, 200.0))
        stage.advance(0.1)
        assert stage.read("Battery", "charging") is is_reached
    stage.world.place(0, (9000.0, 0.0, 0.0))
    before = stage.read("Battery", "level")
    stage.advance(10.0)
    assert isinstance(before, float)
    assert stage.read("Battery", "level") == pytest.approx(before + 0.25)


@pytest.mark.parametrize(
    ("heading", "is_reached"), [(350.0, True), (19.9, True), (20.5, False), (170.0, False)]
)
def test_a_charger_reaches_robots_that_look_along_its_heading(heading: float, is_reached: bool) -> None:
    stage = Stage(BATTERY + 'reach_angle = "15 deg"\n', docks=[(0.0, 0.0, 5.0)])
    stage.world.place(0, (0.0, 0.0, heading))
    stage.advance(0.1)
    assert stage.read("Battery", "charging") is is_reached


def test_a_dock_is_seen_within_range_and_view() -> None:
    stage = Stage(EYE, docks=[(0.0, 2000.0, 180.0)])
    assert seen(stage) == (True, pytest.approx(2000.0), pytest.approx(0.0))
    # The robot looks west, its sensor at (-200, -100) west-southwest: the dock is 46 degrees from there.
    bearing_deg = math.degrees(math.atan2(-300.0, 2000.0))
    stage.world.place(0, (0.0, 0.0, -bearing_deg - 14.0))
    assert seen(stage) == (True, pytest.approx(2000.0), pytest.approx(bearing_deg + 14.0))
    stage.world.place(0, (0.0, 0.0, 90.0))
    assert seen(stage) == (False, None, None)
    stage.world.place(0, (0.0, -1150.0, 0.0))
    assert stage.read("Eye", "dock_distance") == pytest.approx(3150.0)
    stage.world.place(0, (0.0, -1205.0, 0.0))
    assert seen(stage) == (False, None, None)


@pytest.mark.parametrize("seed", range(10))
def test_distance_and_bearing_are_those_from_the_center(seed: int) -> None:
    around = EYE.replace('view   = "90 deg"', "")
    rng = np.random.default_rng(seed)
    docks = rng.uniform(-2000.0, 2000.0, (5, 3))
    stage = Stage(around, docks=[(x, y, 0.0) for x, y, _ in docks])
    for _ in range(20):
        x, y, heading = rng.uniform(-1000.0, 1000.0), rng.uniform(-1000.0, 1000.0), rng.uniform(0.0, 360.0)
        stage.world.place(0, (x, y, heading))
        ahead, left = np.array([-math.sin(math.radians(heading)), math.cos(math.radians(heading))]), None
        left = np.array([-ahead[1], ahead[0]])
        eye = np.array([x, y]) + 200.0 * ahead + 100.0 * left
        away = np.hypot(*(docks[:, :2] - eye).T)
        to_dock = docks[away.argmin(), :2] - (x, y)
        bearing = math.degrees(math.atan2(to_dock @ left, to_dock @ ahead))
        if away.min() <= 3000.0:
            assert seen(stage) == (True, pytest.approx(np.hypot(*to_dock)), pytest.approx(bearing))


def test_a_wall_hides_a_dock_and_the_next_one_is_seen() -> None:
    wall = [[-500.0, 1000.0, 500.0, 1000.0]]
    hidden, free = (0.0, 1500.0, 0.0), (1500.0, 2000.0, 0.0)
    around = EYE.replace('view   = "90 deg"', "")
    assert seen(Stage(around, walls=wall, docks=[hidden])) == (False, None, None)
    both = seen(Stage(around, walls=wall, docks=[hidden, free]))
    assert both == (True, pytest.approx(2500.0), pytest.approx(math.degrees(math.atan2(-1500.0, 2000.0))))
    assert seen(Stage(around, docks=[hidden, free]))[1] == pytest.approx(1500.0)
    assert seen(Stage(around, walls=wall)) == (False, None, None)


def test_a_docked_robot_is_at_distance_0_from_its_dock() -> None:
    around = EYE.replace('view   = "90 deg"', "")
    assert seen(Stage(around, docks=[(0.0, 0.0, 0.0)])) == (True, 0.0, 0.0)


def test_the_noise_is_that_of_the_body_and_of_the_seed_alone() -> None:
    robots = [(0.0, 0.0, 0.0), (5000.0, 0.0, 0.0)]
    docks = [(0.0, 2000.0, 0.0), (5000.0, 2000.0, 0.0)]

    def readings(seed: int, robot: int, reads: int = 1) -> np.ndarray:
        stage, found = Stage(NOISY, poses=robots, docks=docks, seed=seed), []
        for _ in range(1500):
            stage.world.advance(0.05)
            for _ in range(reads):
                row = seen(stage, robot)[1:]
            found.append(row)
        return np.array(found, dtype=float)

    first = readings(1, 0)
    assert first.mean(axis=0) == pytest.approx([2000.0, 0.0], abs=2.0)
    assert first.std(axis=0) == pytest.approx([20.0, 2.0], rel=0.06)
    assert abs(np.corrcoef(first.T)[0, 1]) < 0.08
    assert np.array_equal(first, readings(1, 0, reads=2))
    assert not np.array_equal(first, readings(2, 0))
    assert not np.array_equal(first, readings(1, 1))


def test_holes_and_docks_of_a_map_are_in_every_scenery_of_it() -> None:
    loop = load_map(MAPS / "loop.stickrep")
    dock = Pose(1000.0, 1000.0, 90.0)
    assert draw(Hazards.none(), replace(loop, docks=(dock,)), 3).docks == (dock,)
    assert draw(Hazards(), replace(loop, docks=(dock,)), 3).docks == (dock,)
