"""Range finders against a slow caster of rays that shares nothing with them; their noise; what they see."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from colony.sim.hazards.scenery import CorridorTrack, Person, bare_scenery
from tests.sim.devices.stage import Stage
from tests.sim.devices.test_lidar import HULL_MM, Pose, Wall, cast, free_poses, place_of

POSES = [(100.0, 50.0, 0.0), (0.0, 200.0, 90.0), (-150.0, 0.0, 175.0), (120.0, -60.0, -37.5)]


def finder(more: str = "", poses: list[Pose] = POSES) -> str:
    listed = ", ".join(f'["{x!r} mm", "{y!r} mm", "{bearing!r} deg"]' for x, y, bearing in poses)
    return f"""
[server.Sharp.simulated]
device = "range_finder"
poses  = [{listed}]
range  = "8 m"
{more}
"""


def ranges(stage: Stage, robot: int = 0) -> list[float]:
    return list(stage.read("Sharp", "range", robot))


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("half", [0.0, 12.5])
def test_ranges_are_those_of_the_nearest_ray(seed: int, half: float) -> None:
    rng = np.random.default_rng(seed)
    walls: list[Wall] = [tuple(row) for row in rng.uniform(-6000.0, 6000.0, (12, 4)).tolist()]
    poses = free_poses(rng, walls, int(rng.integers(1, 5)))
    stage = Stage(finder(f'half_beam = "{half} deg"'), walls=walls, poses=poses, seed=seed)
    offsets = np.linspace(-half, half, 27) if half else [0.0]
    for robot, pose in enumerate(poses):
        disks = [(other[0], other[1], HULL_MM) for other in poses if other != pose]
        for (ahead, left, bearing), reading in zip(POSES, ranges(stage, robot), strict=True):
            x, y = place_of(pose, ahead, left)
            rays = [cast(x, y, pose[2] + bearing + offset, walls, disks) for offset in offsets]
            assert reading == pytest.approx(min(rays), rel=1e-9)


def test_a_cone_sees_what_is_beside_a_ray() -> None:
    post = [(-60.0, 1000.0, -40.0, 1000.0), (-5000.0, 3000.0, 5000.0, 3000.0)]
    ahead: list[Pose] = [(0.0, 0.0, 0.0)]
    assert ranges(Stage(finder(poses=ahead), walls=post)) == pytest.approx([3000.0])
    wide = Stage(finder('half_beam = "10 deg"', ahead), walls=post)
    assert ranges(wide) == pytest.approx([1000.0 / math.cos(math.radians(3.0))])


def test_people_and_robots_are_seen_and_glass_is_not() -> None:
    track = CorridorTrack(x_mm=0.0, y_mm=3000.0, heading_deg=0.0, length_mm=10.0, half_width_mm=400.0)
    person = Person(track=track, along_mm=0.0, offset_mm=0.0, forward=True, speed_mm_s=0.0)
    walls = np.array([[-9000.0, 2000.0, 9000.0, 2000.0], [-9000.0, -4000.0, 9000.0, -4000.0]])
    scenery = replace(bare_scenery(walls), silent=np.array([True, False]), people=(person,))
    around: list[Pose] = [(0.0, 0.0, 0.0), (0.0, 0.0, 90.0), (0.0, 0.0, 180.0), (0.0, 0.0, -90.0)]
    stage = Stage(finder(poses=around), walls=scenery, poses=[(0.0, 0.0, 0.0), (1500.0, 0.0, 0.0)])
    assert ranges(stage) == pytest.approx([2750.0, math.inf, 4000.0, 1500.0 - HULL_MM])


def test_a_surface_that_is_too_near_reads_the_smallest_range() -> None:
    wall = [(-5000.0, 310.0, 5000.0, 310.0)]
    stage = Stage(finder('nearest = "0.4 m"', [(290.0, 0.0, 0.0), (290.0, 0.0, 180.0)]), walls=wall)
    assert ranges(stage) == [400.0, math.inf]


def many(stage: Stage, count: int) -> NDArray[np.float64]:
    """Many readings of a robot that stands still."""
    found = []
    for _ in range(count):
        stage.world.advance(0.05)
        found.append(ranges(stage))
    return np.array(found)


WALL = [(-9000.0, 2000.0, 9000.0, 2000.0)]
NOISY = 'noise = "5 mm"\nnoise_fraction = "1 percent"\ndropouts = "10 percent"\nhalf_beam = "5 deg"'


def test_noise_is_normal_and_dropouts_have_their_share() -> None:
    stage = Stage(finder(NOISY, [(0.0, 0.0, 0.0), (0.0, 0.0, 60.0)]), walls=WALL)
    readings = many(stage, 4000)
    lost = np.isinf(readings)
    assert lost.mean() == pytest.approx(0.1, abs=4.0 * math.sqrt(0.1 * 0.9 / lost.size))
    for column, exact in ((0, 2000.0), (1, 2000.0 / math.cos(math.radians(55.0)))):
        own = readings[~lost[:, column], column]
        spread = 5.0 + 0.01 * exact
        assert own.mean() == pytest.approx(exact, abs=4.0 * spread / math.sqrt(own.size))
        assert own.std() == pytest.approx(spread, rel=4.0 / math.sqrt(2 * own.size))


def test_noise_depends_on_the_seed_and_the_time_alone() -> None:
    often, once, other = (Stage(finder(NOISY), walls=WALL, seed=seed) for seed in (3, 3, 4))
    for _ in range(20):
        for stage in (often, once, other):
            stage.world.advance(0.05)
        ranges(often)
    assert ranges(often) == ranges(once) != ranges(other)
