"""The lidar against a slow caster of rays that shares nothing with it; its noise; when it measures."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from statistics import NormalDist

import numpy as np
import pytest

from colony.nav.maps.walls import walls_of
from colony.sim.devices.beams import normal_quantiles
from colony.sim.hazards.scenery import CorridorTrack, Person, bare_scenery
from colony.sim.world.world import World
from tests.buildings import LOOP
from tests.sim.devices.stage import Stage

Pose = tuple[float, float, float]
Wall = tuple[float, float, float, float]
Disk = tuple[float, float, float]

HULL_MM = 300.0
FULL_MM = 8000.0


def lidar(count: int, bearing: float, step: float, more: str = "", place: str = '"0 mm", "0 mm"') -> str:
    return f"""
[server.Lidar.simulated]
device  = "lidar"
pose    = [{place}, "0 deg"]
count   = {count}
bearing = "{bearing!r} deg"
step    = "{step!r} deg"
range   = "8 m"
{more}
"""


def cast(x: float, y: float, direction: float, walls: list[Wall], disks: list[Disk]) -> float:
    """The distance to the first thing on a ray, in degrees from north; infinity beyond the range.

    It moves along the ray from crossing to crossing with complex numbers, one ray and one wall at a time.
    """
    along = complex(-math.sin(math.radians(direction)), math.cos(math.radians(direction)))
    found = [math.inf]
    for x0, y0, x1, y1 in walls:
        a, b = (complex(x0 - x, y0 - y) / along, complex(x1 - x, y1 - y) / along)
        if (a.imag > 0.0) != (b.imag > 0.0):
            found.append(a.real + (b.real - a.real) * a.imag / (a.imag - b.imag))
    for cx, cy, radius in disks:
        c = complex(cx - x, cy - y) / along
        if abs(c.imag) < radius:
            found.append(c.real - math.sqrt(radius**2 - c.imag**2))
    nearest = min(d for d in found if d > 0.0)
    return nearest if nearest <= FULL_MM else math.inf


def place_of(pose: Pose, ahead: float, left: float) -> tuple[float, float]:
    sine, cosine = math.sin(math.radians(pose[2])), math.cos(math.radians(pose[2]))
    return pose[0] - ahead * sine - left * cosine, pose[1] + ahead * cosine - left * sine


def expect_same(readings: list[float], expected: list[float], shifted: list[list[float]]) -> None:
    """Readings are as expected, or beside an edge those of a ray a tenth of a microdegree away."""
    for reading, exact, near in zip(readings, expected, shifted, strict=True):
        if reading != pytest.approx(exact, rel=1e-9):
            assert any(reading == pytest.approx(other, rel=1e-6) for other in near), (reading, exact, near)


def free_poses(rng: np.random.Generator, walls: list[Wall], count: int) -> list[Pose]:
    """Poses at which robots overlap nothing."""
    found: list[Pose] = []
    while len(found) < count:
        pose = (*rng.uniform(-5000.0, 5000.0, 2).tolist(), rng.uniform(0.0, 360.0))
        try:
            World(walls=np.array(walls), poses=[*found, pose])
        except ValueError:
            continue
        found.append(pose)
    return found


SCANNERS = [
    (360, -180.0, 1.0),
    (541, -135.0, 0.5),
    (90, 180.0, -4.0),
    (31, 20.0, -1.7),
    (7, -160.0, 51.0),
    (1, 33.0, 1.0),
]


@pytest.mark.parametrize("seed", range(12))
def test_ranges_are_those_of_a_slow_caster_of_rays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    walls: list[Wall] = [
        tuple(row) for row in rng.uniform(-6000.0, 6000.0, (rng.integers(1, 25), 4)).tolist()
    ]
    walls += [(a[2], a[3], b[0], b[1]) for a, b in zip(walls[::3], walls[1::3], strict=False)]
    poses = free_poses(rng, walls, int(rng.integers(1, 6)))
    count, bearing, step = SCANNERS[seed % len(SCANNERS)]
    ahead, left = (round(float(x)) for x in rng.uniform(-200.0, 200.0, 2))
    stage = Stage(
        lidar(count, bearing, step, place=f'"{ahead} mm", "{left} mm"'), walls=walls, poses=poses, seed=seed
    )
    for robot, pose in enumerate(poses):
        x, y = place_of(pose, ahead, left)
        disks = [(other[0], other[1], HULL_MM) for other in poses if other != pose]
        angles = [pose[2] + bearing + i * step for i in range(count)]
        readings = stage.read("Lidar", "scan", robot)
        expect_same(
            list(readings),
            [cast(x, y, angle, walls, disks) for angle in angles],
            [[cast(x, y, angle + off, walls, disks) for off in (-1e-7, 1e-7)] for angle in angles],
        )


def test_ranges_in_a_building_have_no_leaks() -> None:
    walls: list[Wall] = [tuple(row) for row in walls_of(LOOP).segments.tolist()]
    start = (LOOP.start.x_mm, LOOP.start.y_mm, LOOP.start.heading_deg)
    stage = Stage(lidar(720, -180.0, 0.5), walls=walls, poses=[start])
    for _ in range(10):
        pose = stage.world.true_pose(0)
        angles = [pose.heading_deg - 180.0 + i * 0.5 for i in range(720)]
        readings = stage.read("Lidar", "scan")
        expect_same(
            list(readings),
            [cast(pose.x_mm, pose.y_mm, angle, walls, []) for angle in angles],
            [[cast(pose.x_mm, pose.y_mm, a + off, walls, []) for off in (-1e-7, 1e-7)] for a in angles],
        )
        stage.drive(1.0, 700.0, 9.0)


def test_beams_along_a_wall_and_into_its_corners_end_there() -> None:
    """Axes of the robot and walls are parallel, so that beams meet ends exactly."""
    box = [(-1000, -1000, -1000, 1000), (-1000, 1000, 1000, 1000), (1000, 1000, 1000, -1000)]
    box += [(1000, -1000, -1000, -1000)]
    stage = Stage(lidar(8, -180.0, 45.0), walls=box)
    corner = math.hypot(1000.0, 1000.0)
    assert stage.read("Lidar", "scan") == pytest.approx([1000.0, corner] * 4)
    edge_on = Stage(lidar(8, -180.0, 45.0), walls=[(0, 500, 0, 2000), (-2000, 1000, 2000, 1000)])
    readings = edge_on.read("Lidar", "scan")
    assert readings[4] == pytest.approx(1000.0)


@pytest.mark.parametrize("heading", [0.0, 77.0])
def test_people_are_seen_and_glass_is_not(heading: float) -> None:
    track = CorridorTrack(x_mm=0.0, y_mm=3000.0, heading_deg=0.0, length_mm=10.0, half_width_mm=400.0)
    person = Person(track=track, along_mm=0.0, offset_mm=0.0, forward=True, speed_mm_s=0.0)
    walls = np.array([[-9000.0, 2000.0, 9000.0, 2000.0], [-9000.0, 4000.0, 9000.0, 4000.0]])
    scenery = replace(bare_scenery(walls), silent=np.array([True, False]), people=(person,))
    stage = Stage(lidar(5, -heading, 12.0), walls=scenery, poses=[(0.0, 0.0, heading)])
    readings = stage.read("Lidar", "scan")
    assert readings[0] == pytest.approx(2750.0)
    assert readings[1:] == pytest.approx([4000.0 / math.cos(math.radians(a)) for a in (12, 24, 36, 48)])


def test_blocked_beams_have_no_echo() -> None:
    blocked = """
[server.Lidar.fields.scan]
no_echo = "8 m"
blocked = ["40 deg .. 100 deg"]
"""
    walls = [(-1e5, 500, 1e5, 500), (-1e5, -500, 1e5, -500)]
    for bearing, step in ((-180.0, 30.0), (180.0, -30.0)):
        stage = Stage(blocked + lidar(12, bearing, step), walls=walls)
        readings = stage.read("Lidar", "scan")
        seen = {bearing + i * step for i, reading in enumerate(readings) if reading < math.inf}
        assert {angle % 360.0 for angle in seen} == {0, 30, 120, 150, 180, 210, 240, 300, 330}


def test_quantiles_are_those_of_a_normal_variable() -> None:
    table = normal_quantiles()
    assert (np.diff(table) > 0.0).all()
    assert table == pytest.approx(-table[::-1])
    assert table.std() == pytest.approx(1.0, abs=2e-3)
    assert NormalDist().cdf(table[1000]) == pytest.approx(1000.5 / len(table))


def ranges_of(stage: Stage, scans: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Many scans of a robot that stands still."""
    found = []
    for _ in range(scans):
        stage.world.advance(0.1)
        found.append(stage.read("Lidar", "scan"))
    return np.array(found)


RING = [(3000 * math.cos(a), 3000 * math.sin(a)) for a in np.radians(np.arange(361))]
ROUND = [(*a, *b) for a, b in pairwise(RING)]


def test_noise_is_normal_and_dropouts_have_their_share() -> None:
    stage = Stage(lidar(360, -180.0, 1.0, 'noise = "20 mm"\ndropouts = 0.05'), walls=ROUND)
    exact = Stage(lidar(360, -180.0, 1.0), walls=ROUND).read("Lidar", "scan")
    readings = ranges_of(stage, 400)
    lost = np.isinf(readings)
    assert lost.mean() == pytest.approx(0.05, abs=4 * math.sqrt(0.05 * 0.95 / lost.size))
    errors = (readings - np.array(exact))[~lost] / 20.0
    bound = 4.0 / math.sqrt(errors.size)
    assert errors.mean() == pytest.approx(0.0, abs=bound)
    assert errors.std() == pytest.approx(1.0, abs=bound)
    for limit in (0.5, 1.0, 2.0, 3.0):
        share = 2.0 * NormalDist().cdf(limit) - 1.0
        assert (abs(errors) < limit).mean() == pytest.approx(share, abs=bound)
    centered = np.where(lost, 0.0, readings - np.array(exact)) / 20.0
    for neighbor in (np.roll(centered, 1, axis=1), np.roll(centered, 1, axis=0)):
        assert (centered * neighbor).mean() == pytest.approx(0.0, abs=bound)


def test_noise_stays_within_the_range() -> None:
    near = Stage(lidar(4, -180.0, 90.0, 'noise = "500 mm"'), walls=[(-1e5, 310, 1e5, 310)])
    far = Stage(lidar(4, -180.0, 90.0, 'noise = "500 mm"'), walls=[(-1e5, 7990, 1e5, 7990)])
    assert ranges_of(near, 200)[:, 2].min() == 0.0
    assert ranges_of(far, 200)[:, 2].max() == FULL_MM


NOISY = 'noise = "10 mm"\ndropouts = 0.1'


def test_noise_depends_on_the_seed_the_robot_and_the_scan_alone() -> None:
    apart = [(0.0, 0.0, 0.0), (900.0, 0.0, 90.0)]
    walls = [(-3000, 3000, 3000, 3000)]

    def reading(seed: int, robot: int, poses: list[Pose], steps: int, every: int) -> object:
        stage = Stage(lidar(40, -20.0, 1.0, NOISY), walls=walls, poses=poses, seed=seed)
        for step in range(steps):
            stage.world.advance(0.05)
            if every and step % every == 0:
                stage.read("Lidar", "scan", 0)
        return stage.read("Lidar", "scan", robot)

    first = reading(1, 0, apart, 20, 0)
    assert first == reading(1, 0, apart, 20, 1) == reading(1, 0, apart, 20, 7)
    assert first == reading(1, 0, [*apart, (0.0, -2000.0, 0.0)], 20, 0)
    assert first != reading(2, 0, apart, 20, 0)
    assert first != reading(1, 0, apart, 21, 0)
    lone = reading(1, 1, [(0.0, -2000.0, 0.0), (0.0, 0.0, 0.0)], 20, 0)
    assert lone != first


def test_a_scanner_with_a_rate_measures_then_and_gives_its_time() -> None:
    stage = Stage('[server.Lidar]\nrate = "10 Hz"' + lidar(3, -10.0, 10.0), walls=[(-1e4, 5000, 1e4, 5000)])
    stage.world.command(0, 500.0, 0.0)
    seen = []
    for _ in range(8):
        stage.world.advance(0.04)
        stage.read("Lidar", "scan")
        taken_ns = stage.time_of("Lidar", "scan")
        seen.append((stage.world.elapsed_ns // 1_000_000, (taken_ns or 0) // 1_000_000))
    assert seen == [(40, 0), (80, 0), (120, 120), (160, 120), (200, 200), (240, 200), (280, 200), (320, 320)]


def test_a_scan_is_what_was_there_when_it_was_measured() -> None:
    """Whether and when scans are read between changes nothing."""
    text = '[server.Lidar]\nrate = "5 Hz"' + lidar(36, -180.0, 10.0, NOISY)
    poses = [(0.0, 0.0, 0.0), (1200.0, 0.0, 0.0)]
    always, never = (Stage(text, walls=[(-1e4, 5000, 1e4, 5000)], poses=poses) for _ in range(2))
    for step in range(60):
        for stage in (always, never):
            stage.world.command(0, 300.0, 20.0)
            stage.world.command(1, -200.0, 0.0)
            stage.world.advance(0.03)
        read = always.read("Lidar", "scan")
        if step % 17 == 16:
            assert read == never.read("Lidar", "scan")
            assert always.time_of("Lidar", "scan") == never.time_of("Lidar", "scan")


@pytest.mark.parametrize("seed", range(5))
def test_scanners_that_scan_together_read_what_each_reads_alone(seed: int) -> None:
    """Scans that were taken together are read in any order, and some of them never."""
    poses = [(0.0, 0.0, 10.0), (1500.0, 0.0, 100.0), (0.0, 1500.0, 200.0)]
    walls = [[-4000.0, 4000.0, 4000.0, 4000.0]]
    rng = np.random.default_rng(seed)
    scanner, seen = lidar(40, -20.0, 1.0, NOISY), set[object]()
    rated = '[server.Lidar]\nrate = "10 Hz"\n' + scanner
    alone, together = (Stage(text, walls=walls, poses=poses, seed=seed) for text in (scanner, rated))
    for _ in range(6):
        for stage in (alone, together):
            stage.world.command(0, 500.0, 20.0)
            stage.advance(0.1)
        for robot in rng.permutation(3)[: rng.integers(1, 4)].tolist():
            scan = together.read("Lidar", "scan", robot)
            assert scan == alone.read("Lidar", "scan", robot), f"seed {seed}"
            seen |= set(scan)
    assert len(seen) > 50
