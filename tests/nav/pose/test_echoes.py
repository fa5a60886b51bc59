from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.nav.maps.stickrep.reader import load_map, read_map
from colony.nav.maps.walls import walls_of
from colony.nav.pose.echoes import Reflectors, SonarRing, reflectors_of
from colony.sim.world.world import World
from colony.text.source import Source
from tests.nav.maps.small_maps import ROOM
from tests.nav.sonars import CHANNELS, RING, SONARS
from tests.paths import MAPS
from tests.sim.robots import IDEAL

LOOP = MAPS / "loop.stickrep"


@pytest.fixture(scope="module")
def poses() -> list[tuple[float, float, float]]:
    """Places along the walls of the loop, not in the block."""
    random = np.random.default_rng(5)
    reflectors = reflectors_of(walls_of(load_map(LOOP)))
    wall = random.integers(len(reflectors.length), size=120)
    along, away = random.uniform(0.0, reflectors.length[wall]), random.uniform(450.0, 2_000.0, 120)
    at = (
        reflectors.start[wall]
        + along[:, None] * reflectors.along[wall]
        + away[:, None] * reflectors.normal[wall]
    )
    return [
        (x, y, heading)
        for (x, y), heading in zip(at.tolist(), random.uniform(0, 360, 120).tolist(), strict=True)
    ]


def test_it_expects_what_the_simulator_reads(poses: list[tuple[float, float, float]]) -> None:
    walls = walls_of(load_map(LOOP))
    world = World(walls=walls.segments, poses=[tuple(load_map(LOOP).start)], config=IDEAL)
    reflectors, off, tried = reflectors_of(walls), [], 0
    for x, y, heading in poses:
        try:
            world.place(0, (x, y, heading))
        except ValueError:  # too near to a wall
            continue
        tried += 1
        expected = RING.predict(reflectors.within(x, y, 7_000.0), x, y, math.radians(heading))
        sure = np.isfinite(expected.sigma)
        off += (world.sonar(0) - expected.ranges)[sure].tolist()
    assert tried > 60
    assert len(off) > 8 * tried
    assert np.percentile(np.abs(off), 90) < 2.0
    assert np.mean(np.abs(off) > 20.0) < 0.03  # in the gap between two rays: a jamb, a corner


def test_the_jacobian_is_the_slope_of_the_ranges(poses: list[tuple[float, float, float]]) -> None:
    reflectors = reflectors_of(walls_of(load_map(LOOP)))
    off = []
    for x, y, heading in poses:
        near, angle = reflectors.within(x, y, 7_000.0), math.radians(heading)
        here = RING.predict(near, x, y, angle)
        for column, (dx, dy, turn) in enumerate([(0.5, 0, 0), (0, 0.5, 0), (0, 0, 1e-4)]):
            there = RING.predict(near, x + dx, y + dy, angle + turn)
            both = np.isfinite(here.ranges) & np.isfinite(there.ranges)
            change = there.ranges[both] - here.ranges[both]
            slope = here.jacobian[both, column] * (dx + dy + turn)
            off += np.abs(change - slope)[np.abs(change) < 2.0].tolist()
    assert np.percentile(off, 95) < 0.03  # mm: the rest meets another wall now


def test_a_wall_is_heard_within_the_critical_angle_and_the_beam() -> None:
    reflectors = reflectors_of(walls_of(read_map(Source("room", ROOM))))._replace(sigma_factor=np.ones(4))
    beside_the_west_wall = RING.predict(reflectors, 900.0, 1_270.0, 0.0)
    assert beside_the_west_wall.ranges[18] == pytest.approx(900.0 - 360.0)
    detected = np.flatnonzero(np.isfinite(beside_the_west_wall.ranges[16:21])) + 16
    assert detected.tolist() == [16, 17, 18, 19, 20]  # 30 degrees to either side, of 42
    assert beside_the_west_wall.sigma[18] < beside_the_west_wall.sigma[17]
    assert beside_the_west_wall.jacobian[18].tolist() == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)
    assert beside_the_west_wall.jacobian[17, 2] == pytest.approx(-beside_the_west_wall.jacobian[19, 2])


def test_walls_are_not_heard_from_behind() -> None:
    reflectors = reflectors_of(walls_of(read_map(Source("room", ROOM))))
    assert RING.predict(reflectors, -900.0, 1_270.0, 0.0).ranges[6] == pytest.approx(3_048.0 + 900.0 - 360.0)


def test_glass_is_not_trusted_and_hides_what_is_behind() -> None:
    walls = walls_of(read_map(Source("room", ROOM)))
    assert walls.glass == (False, False, True, False)
    expected = RING.predict(reflectors_of(walls), 2_000.0, 1_270.0, 0.0)
    assert math.isinf(expected.sigma[6])  # the east side, a glass door
    assert math.isfinite(expected.sigma[18])
    assert math.isfinite(expected.ranges[6])


def test_doors_are_trusted_less_than_walls() -> None:
    walls = walls_of(read_map(Source("room", ROOM.replace("glass", "wood"))))
    expected = RING.predict(reflectors_of(walls), 3_048.0 / 2, 1_270.0, 0.0)
    assert expected.ranges[6] == pytest.approx(expected.ranges[18])
    assert expected.sigma[6] == pytest.approx(2.0 * expected.sigma[18])


def test_nothing_near_by_and_nothing_within_reach() -> None:
    reflectors = reflectors_of(walls_of(read_map(Source("room", ROOM))))
    none = reflectors.within(50_000.0, 0.0, 1_000.0)
    assert len(none.length) == 0
    for expected in (
        RING.predict(none, 0.0, 0.0, 0.0),
        SonarRing(replace(SONARS, reach_mm=300.0)).predict(reflectors, 1_500.0, 1_270.0, 0.0),
    ):
        assert not np.isfinite(expected.ranges).any()
        assert not np.isfinite(expected.sigma).any()
        assert expected.jacobian.shape == (CHANNELS, 3)


def facing(*walls: tuple[float, float]) -> Reflectors:
    """Walls in a line 3 m north of the origin, each from west to east between two places."""
    start = np.array([(west, 3_000.0) for west, _ in walls])
    count = len(walls)
    return Reflectors(
        start=start,
        along=np.tile([1.0, 0.0], (count, 1)),
        normal=np.tile([0.0, -1.0], (count, 1)),
        length=np.array([east - west for west, east in walls]),
        sigma_factor=np.ones(count),
    )


def test_the_end_of_a_wall_is_heard_but_not_trusted() -> None:
    """Its place of detection lies between two rays; scan after scan the same two."""
    whole = RING.predict(facing((-3_000.0, 3_000.0)), 0.0, 0.0, 0.0)
    assert np.isfinite(whole.sigma[10:15]).all()
    gap = RING.predict(facing((-3_000.0, -900.0), (900.0, 3_000.0)), 0.0, 0.0, 0.0)
    detected = np.flatnonzero(np.isfinite(gap.ranges)).tolist()
    assert detected == [10, 11, 13, 14]
    assert (gap.ranges[[11, 13]] > whole.ranges[[11, 13]] + 50.0).all()
    assert np.isinf(gap.sigma[[11, 13]]).all()
