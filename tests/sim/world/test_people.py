"""People: they keep to their corridors, never touch who stands still, and stop for robots, not for long."""

from __future__ import annotations

import math

import numpy as np
import pytest

from colony.nav.maps.walls import walls_of
from colony.sim.hazards.hazards import Hazard, Hazards, draw
from colony.sim.hazards.scenery import PERSON_RADIUS_MM, CorridorTrack, Person, Scenery
from colony.sim.world.people import LONGEST_STOP_S
from colony.sim.world.world import World
from tests.buildings import LOOP, MSU
from tests.sim.robots import IDEAL, RING

LENGTH, HALF = 30_000.0, 1500.0
WALLS = np.array([(-HALF, 0.0, -HALF, LENGTH), (HALF, LENGTH, HALF, 0.0), (-HALF, LENGTH, HALF, LENGTH)])
NORTHWARD = CorridorTrack(
    x_mm=0.0, y_mm=800.0, heading_deg=0.0, length_mm=LENGTH - 1600.0, half_width_mm=HALF
)
TOUCH = IDEAL.radius_mm + PERSON_RADIUS_MM
CROWDED = Hazards(on=frozenset({Hazard.PEOPLE}), person_spacing_mm=4_000.0)


def person(along: float, *, offset: float = 0.0, forward: bool = False, speed: float = 1000.0) -> Person:
    return Person(track=NORTHWARD, along_mm=along, offset_mm=offset, forward=forward, speed_mm_s=speed)


def corridor(*people: Person, seed: int = 0) -> Scenery:
    return Scenery(seed=seed, walls=WALLS, silent=np.zeros(len(WALLS), dtype=np.bool_), people=people)


def nearest(world: World, robot: int = 0) -> float:
    x, y, _ = world.true_pose(robot)
    return float(np.hypot(*(world.people - (x, y)).T).min())


def test_somebody_alone_walks_to_the_end_and_back() -> None:
    world = World(walls=corridor(person(10_000.0, offset=300.0)), poses=[(1000.0, 29_000.0, 0.0)])
    ys = []
    for _ in range(1200):
        world.advance(0.05)
        ((x, y),) = world.people
        ys.append(y)
        assert x == pytest.approx(-300.0)
    assert np.abs(np.diff(ys)).max() == pytest.approx(50.0)
    assert min(ys) == pytest.approx(800.0, abs=50.0)
    assert max(ys) > 27_000.0
    assert ys[-1] < max(ys) - 1000.0


def test_walking_does_not_depend_on_how_time_is_cut() -> None:
    short, long = (World(walls=corridor(person(20_000.0)), poses=[(0.0, 3000.0, 0.0)]) for _ in range(2))
    for _ in range(400):
        short.advance(0.05)
    for _ in range(4):
        long.advance(5.0)
    assert short.people == pytest.approx(long.people, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_nobody_touches_a_robot_that_stands(seed: int) -> None:
    crowded = draw(CROWDED, LOOP, seed)
    world = World(walls=crowded, poses=[LOOP.start], seed=seed)
    met = False
    for _ in range(4000):
        world.advance(0.05)
        assert nearest(world) >= TOUCH + 50.0
        met |= nearest(world) < 1500.0
    assert met
    assert world.bumps(0) == 0
    assert world.contact_speed(0) == 0.0


def test_nobody_walks_into_a_wall() -> None:
    crowded = draw(CROWDED, MSU, 3)
    world = World(walls=crowded, poses=[MSU.start])
    walls = walls_of(MSU).segments
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    for _ in range(100):
        world.advance(1.0)
        for at in world.people:
            part = np.clip(((at - start) * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
            assert np.hypot(*(start + part[:, None] * along - at).T).min() >= PERSON_RADIUS_MM


def drive_among(world: World, seconds: float) -> list[float]:
    """Drive north and stop before what is ahead; how long each stop took, in s."""
    stops, now = [], 0.0
    for _ in range(round(seconds / 0.05)):
        near = world.sonar(0)[10:15].min()
        world.command(0, 0.0 if near < 700.0 else 150.0 if near < 1200.0 else 500.0, 0.0)
        world.advance(0.05)
        if world.speed(0).velocity_mm_s < 1.0:
            now += 0.05
        elif now:
            stops.append(now)
            now = 0.0
    return [*stops, now]


def test_a_robot_that_stops_in_time_gets_past_and_touches_nobody() -> None:
    longest = 0.0
    for seed in range(30):
        world = World(walls=corridor(person(15_000.0, offset=100.0), seed=seed), poses=[(0.0, 1000.0, 0.0)])
        stops = drive_among(world, 45.0)
        longest = max(longest, *stops)
        assert world.true_pose(0).y_mm > 8000.0, seed
        assert world.bumps(0) == 0, seed
    assert 5.0 < longest < LONGEST_STOP_S + 5.0


def test_some_stop_for_a_robot_and_some_step_aside() -> None:
    stopped = 0
    for seed in range(60):
        world = World(walls=corridor(person(5_000.0), seed=seed), poses=[(0.0, 2000.0, 0.0)])
        world.advance(2.5)
        before = world.people.copy()
        world.advance(0.5)
        stopped += bool((world.people == before).all())
    assert 12 <= stopped <= 36  # 0.4 of 60


def test_who_has_no_room_to_pass_turns_around() -> None:
    narrow = 800.0
    walls = WALLS * np.array([narrow / HALF, 1.0, narrow / HALF, 1.0])
    track = CorridorTrack(x_mm=0.0, y_mm=800.0, heading_deg=0.0, length_mm=20_000.0, half_width_mm=narrow)
    somebody = Person(track=track, along_mm=9_000.0, offset_mm=0.0, forward=False, speed_mm_s=1000.0)
    scenery = Scenery(seed=1, walls=walls, silent=np.zeros(3, dtype=np.bool_), people=(somebody,))
    world = World(walls=scenery, poses=[(0.0, 3000.0, 0.0)])
    ys = []
    for _ in range(600):
        world.advance(0.05)
        ys.append(float(world.people[0, 1]))
    assert min(ys) > 3000.0 + TOUCH
    assert ys[-1] > 8000.0


def test_who_runs_somebody_over_is_stopped_and_has_done_it_himself() -> None:
    for seed in range(20):
        world = World(walls=corridor(person(6_000.0), seed=seed), poses=[(0.0, 1000.0, 0.0)], config=IDEAL)
        world.command(0, 500.0, 0.0)
        for _ in range(400):
            world.advance(0.05)
            assert nearest(world) >= TOUCH - 1e-6
        if world.bumps(0):
            assert world.contact_speed(0) == pytest.approx(500.0)
            return
    pytest.fail("nobody was run over")


def test_people_are_heard_and_seen_where_they_are() -> None:
    somebody = person(2_400.0, speed=0.0)  # 3200 mm north
    world = World(walls=corridor(somebody), poses=[(0.0, 1000.0, 0.0)], config=IDEAL)
    gap = 3200.0 - 1000.0 - PERSON_RADIUS_MM - RING.ring_mm
    assert world.sonar(0)[12] == pytest.approx(gap, abs=1.0)
    assert not world.infrared(0)[12]
    assert World(walls=WALLS, poses=[(0.0, 1000.0, 0.0)], config=IDEAL).sonar(0)[12] > 9000.0


def test_people_make_way_where_a_robot_is_put_down() -> None:
    people = [person(float(along)) for along in range(1000, 9000, 400)]
    world = World(walls=corridor(*people), poses=[(0.0, 4000.0, 0.0)])
    assert nearest(world) >= 2000.0
    world.place(0, (0.0, 12_000.0, 0.0))
    assert nearest(world) >= 2000.0
    assert len(world.people) == len(people)


def test_who_makes_way_for_one_robot_does_not_do_so_into_another() -> None:
    poses = [(0.0, 3000.0, 0.0), *((0.0, 23_000.0 + 1500.0 * n, 0.0) for n in range(4))]
    world = World(walls=corridor(person(20_000.0)), poses=poses)
    world.place(0, (0.0, 20_500.0, 0.0))
    assert min(nearest(world, robot) for robot in range(len(poses))) >= 2000.0


def test_a_robot_that_drives_blindly_meets_people_at_its_speed_and_goes_through_nobody() -> None:
    """However the time is cut: eight people, at all offsets, against 400 mm/s."""
    struck = 0
    for seed in range(12):
        random = np.random.default_rng(seed)
        crowd = [
            person(
                random.uniform(4000.0, 28_000.0),
                offset=random.uniform(-1200.0, 1200.0),
                forward=bool(random.random() < 0.5),
                speed=random.uniform(600.0, 1400.0),
            )
            for _ in range(8)
        ]
        world = World(walls=corridor(*crowd, seed=seed), poses=[(0.0, 1500.0, 0.0)], config=IDEAL)
        world.command(0, 400.0, 0.0)
        for _ in range(600):
            world.advance(0.1)
            assert nearest(world) >= TOUCH - 1e-6
            if world.bumps(0):
                break
        struck += world.bumps(0)
        assert world.contact_speed(0) == pytest.approx(400.0 if world.bumps(0) else 0.0)
    assert struck >= 4


def test_two_robots_are_both_minded() -> None:
    people = (person(15_000.0), person(20_000.0, offset=400.0))
    poses = [(-400.0, 5000.0, 0.0), (500.0, 6200.0, 90.0)]
    world = World(walls=corridor(*people, seed=3), poses=poses)
    for _ in range(2000):
        world.advance(0.05)
        assert min(nearest(world, 0), nearest(world, 1)) >= TOUCH + 50.0


def test_the_same_seed_gives_the_same_walks() -> None:
    def walks(seed: int) -> bytes:
        world = World(walls=draw(CROWDED, LOOP, seed), poses=[LOOP.start], seed=0)
        drive_among(world, 30.0)
        return world.people.tobytes() + repr(world.true_pose(0)).encode()

    assert walks(1) == walks(1)
    assert walks(1) != walks(2)


def test_a_person_keeps_clear_of_the_walls_however_far_aside_they_like_to_walk() -> None:
    world = World(walls=corridor(person(5_000.0, offset=5000.0)), poses=[(0.0, 25_000.0, 0.0)])
    assert world.people[0, 0] == pytest.approx(-(HALF - PERSON_RADIUS_MM - 50.0))
    assert math.isfinite(nearest(world))
