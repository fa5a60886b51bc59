"""What each hazard does to a robot: slips, glass, open doors, cross-talk, encoders, compass, contacts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.nav.maps.walls import walls_of
from colony.sim.config import RobotConfig
from colony.sim.hazards.hazards import Hazard, Hazards, draw
from colony.sim.hazards.scenery import CompassDisturbance, ExpansionJoint, Scenery, WheelSlip, bare_scenery
from colony.sim.sensors.sonar import disturbance_deg
from colony.sim.world.world import World
from tests.buildings import LOOP, MSU
from tests.sim.robots import IDEAL, RING, ROME, pass_time
from tests.sim.world.test_world import history

BOX = np.array(
    [(-2e3, 0.0, -2e3, 40e3), (2e3, 40e3, 2e3, 0.0), (-2e3, 40e3, 2e3, 40e3), (2e3, 0.0, -2e3, 0.0)]
)
JOINT = ExpansionJoint(x0_mm=-2000.0, y0_mm=5000.0, x1_mm=2000.0, y1_mm=5000.0)
SURE = WheelSlip(probability=1.0, turn_deg=10.0, min_mm=30.0, max_mm=80.0)


def with_joints(*joints: ExpansionJoint, slip: WheelSlip = SURE, seed: int = 0) -> Scenery:
    return replace(bare_scenery(BOX, seed=seed), joints=joints, slip=slip)


def passed(scenery: Scenery, *, dt: float = 0.05, speed: float = 500.0) -> World:
    """A robot without errors of its own that has driven over the joint."""
    world = World(walls=scenery, poses=[(0.0, 4000.0, 0.0)], config=IDEAL)
    world.command(0, speed, 0.0)
    pass_time(world, 4.0, dt)
    return world


# --- joints --------------------------------------------------------------------------------------


def test_a_slip_turns_the_robot_and_its_odometry_does_not_notice() -> None:
    turns, lost = [], []
    for seed in range(300):
        world = passed(with_joints(JOINT, seed=seed))
        assert world.odometry(0).heading_deg == 0.0
        assert world.odometry(0).x_mm == 0.0
        turns.append((world.true_pose(0).heading_deg + 180.0) % 360.0 - 180.0)
        lost.append(world.odometry(0).y_mm - 4000.0 - world.distance(0))
    assert abs(np.mean(turns)) < 4.0 * 10.0 / math.sqrt(300)
    assert np.std(turns) == pytest.approx(10.0, abs=4.0 * 10.0 / math.sqrt(600))
    assert 30.0 <= min(lost) < 33.0
    assert 77.0 < max(lost) <= 80.0


def test_a_quarter_of_the_crossings_slip() -> None:
    slip = WheelSlip(probability=0.25, turn_deg=10.0, min_mm=30.0, max_mm=80.0)
    slips = sum(
        passed(with_joints(JOINT, slip=slip, seed=s)).true_pose(0).heading_deg != 0.0 for s in range(400)
    )
    assert abs(slips - 100) <= 4.0 * math.sqrt(400 * 0.25 * 0.75)


def test_a_robot_that_does_not_cross_does_not_slip() -> None:
    beside = ExpansionJoint(x0_mm=500.0, y0_mm=5000.0, x1_mm=2000.0, y1_mm=5000.0)
    ahead = ExpansionJoint(x0_mm=-2000.0, y0_mm=9000.0, x1_mm=2000.0, y1_mm=9000.0)
    world = passed(with_joints(beside, ahead))
    assert world.true_pose(0) == world.odometry(0)


def test_a_robot_that_backs_over_a_joint_loses_way_backward() -> None:
    world = World(walls=with_joints(JOINT), poses=[(0.0, 6000.0, 0.0)], config=IDEAL)
    world.command(0, -500.0, 0.0)
    pass_time(world, 3.0, 0.05)
    assert 30.0 <= (6000.0 - world.odometry(0).y_mm) - world.distance(0) <= 80.0


def test_a_slip_does_not_depend_on_how_time_is_cut() -> None:
    short, long = passed(with_joints(JOINT)), passed(with_joints(JOINT), dt=4.0)
    assert short.true_pose(0).heading_deg == pytest.approx(long.true_pose(0).heading_deg)
    assert short.odometry(0).y_mm == pytest.approx(long.odometry(0).y_mm)


def test_each_crossing_is_drawn_by_itself() -> None:
    joints = tuple(
        ExpansionJoint(x0_mm=-2000.0, y0_mm=y, x1_mm=2000.0, y1_mm=y) for y in (4500.0, 4900.0, 5300.0)
    )
    turns = []
    for count in range(1, 4):
        world = passed(with_joints(*joints[:count]))
        turns.append(world.true_pose(0).heading_deg)
    assert len(set(turns)) == 3


def test_crossings_are_counted_on_from_floor_to_floor() -> None:
    """Else each floor of a building would bring the same slips in the same order."""
    one, again = with_joints(JOINT), with_joints(JOINT)
    world = passed(one)
    first = world.true_pose(0).heading_deg
    world.enter(again, [(0.0, 4000.0, 0.0)])
    pass_time(world, 4.0, 0.05)
    assert world.true_pose(0).y_mm > 5000.0
    assert world.true_pose(0).heading_deg not in (0.0, first)


# --- what sonars hear ----------------------------------------------------------------------------


def test_glass_is_neither_heard_nor_seen_and_stops_the_robot() -> None:
    silent = np.array([False, False, True, False])
    glass = Scenery(seed=0, walls=BOX, silent=silent)
    behind = np.vstack([BOX, [(-2e3, 43e3, 2e3, 43e3)]])
    room = Scenery(seed=0, walls=behind, silent=np.append(silent, False))
    for scenery, expected in ((glass, 10_000.0), (room, 4_000.0 - 360.0)):
        world = World(walls=scenery, poses=[(0.0, 39_000.0, 0.0)], config=IDEAL)
        assert world.sonar(0)[12] == pytest.approx(expected)
        world.command(0, 300.0, 0.0)
        world.advance(4.0)
        assert not world.infrared(0)[12]
        assert world.bumper(0).front
        assert world.true_pose(0).y_mm == pytest.approx(39_600.0, abs=0.5)
        assert world.contact_speed(0) == pytest.approx(300.0)


def test_an_open_door_is_heard_as_a_room() -> None:
    hazards = Hazards(on=frozenset({Hazard.DOORS}), open_door=1.0, door_deg=(90.0, 90.0))
    open_, shut = draw(hazards, LOOP, 1), draw(Hazards.none(), LOOP, 1)
    deeper = 0
    for door in open_.doors:
        x0, y0, x1, y1 = walls_of(LOOP).segments[door.edge]
        length = math.hypot(x1 - x0, y1 - y0)
        right = ((y1 - y0) / length, -(x1 - x0) / length)  # into the corridor
        x, y = (x0 + x1) / 2 + 1000.0 * right[0], (y0 + y1) / 2 + 1000.0 * right[1]
        heading = math.degrees(math.atan2(right[0], -right[1]))  # toward the door
        readings = [
            World(walls=each, poses=[(x, y, heading)], config=IDEAL).sonar(0)[12] for each in (open_, shut)
        ]
        assert readings[1] == pytest.approx(1000.0 - RING.ring_mm, abs=1.0)
        deeper += readings[0] > readings[1] + 300.0
    assert deeper == len(open_.doors) > 10


def test_cross_talk_comes_at_its_rate_and_only_shortens() -> None:
    calm = World(walls=bare_scenery(BOX), poses=[(0.0, 20_000.0, 10.0)], config=IDEAL)
    talk = World(
        walls=replace(bare_scenery(BOX), cross_talk=0.005), poses=[(0.0, 20_000.0, 10.0)], config=IDEAL
    )
    false, least = 0, math.inf
    for _ in range(2000):
        calm.advance(0.05)
        talk.advance(0.05)
        true, heard = calm.sonar(0), talk.sonar(0)
        changed = true != heard
        assert (heard[changed] < true[changed]).all()
        least = min(least, heard.min())
        false += int(changed.sum())
        assert (talk.infrared(0) == calm.infrared(0)).all()
    trials = 2000 * 24
    assert abs(false - 0.005 * trials) <= 4.0 * math.sqrt(trials * 0.005 * 0.995)
    assert 300.0 <= least < 450.0


def test_cross_talk_does_not_depend_on_who_reads_it() -> None:
    one, other = (
        World(walls=replace(bare_scenery(BOX), cross_talk=0.5), poses=[(0.0, 9e3, 0.0)]) for _ in range(2)
    )
    for _ in range(10):
        one.advance(0.05)
        one.sonar(0)
        other.advance(0.05)
    assert (one.sonar(0) == other.sonar(0)).all()
    assert (one.sonar(0) == one.sonar(0)).all()


# --- odometry, compass, contacts -----------------------------------------------------------------


def test_both_encoders_are_wrong_by_the_same_part() -> None:
    world = World(
        walls=replace(bare_scenery(BOX), encoder_scale=1.02), poses=[(0.0, 4000.0, 0.0)], config=IDEAL
    )
    world.command(0, 500.0, 0.0)
    world.advance(10.0)
    assert world.odometry(0).y_mm - 4000.0 == pytest.approx(1.02 * world.distance(0))
    assert world.odometry(0).x_mm == pytest.approx(0.0)


def test_a_compass_is_disturbed_smoothly_and_within_bounds() -> None:
    compass_disturbance = CompassDisturbance(seed=9, max_deg=60.0)
    line = np.array([disturbance_deg(compass_disturbance, 1000.0, float(y)) for y in range(0, 200_000, 50)])
    assert np.abs(line).max() <= 60.0
    assert line.std() > 15.0
    assert np.abs(np.diff(line)).max() < 5.0  # on five centimeters
    assert disturbance_deg(CompassDisturbance(), 123.0, 456.0) == 0.0


def test_a_compass_reads_the_heading_where_nothing_disturbs_it() -> None:
    world = World(walls=bare_scenery(BOX), poses=[(0.0, 4000.0, 350.0)])
    assert world.compass(0) == pytest.approx(350.0)
    disturbed = World(
        walls=replace(bare_scenery(BOX), compass_disturbance=CompassDisturbance(seed=1, max_deg=60.0)),
        poses=[(0.0, 4000.0, 350.0)],
    )
    off = (disturbed.compass(0) - 350.0 + 180.0) % 360.0 - 180.0
    assert off == pytest.approx(disturbance_deg(CompassDisturbance(seed=1, max_deg=60.0), 0.0, 4000.0))


def test_the_speed_of_the_worst_contact_is_kept() -> None:
    world = World(walls=BOX, poses=[(0.0, 38_000.0, 0.0)], config=IDEAL)
    assert world.contact_speed(0) == 0.0
    for speed, worst in ((120.0, 120.0), (400.0, 400.0), (50.0, 400.0)):
        world.command(0, -300.0, 0.0)
        world.advance(1.5)
        world.command(0, speed, 0.0)
        for _ in range(3):
            world.advance(9.0)
        assert world.bumper(0).front
        assert world.contact_speed(0) == pytest.approx(worst)
    assert world.bumps(0) == 3


@pytest.mark.parametrize("part", [0.2, 0.5, 0.8])
def test_who_drives_into_an_open_door_touches_its_leaf_or_its_room_at_full_speed(part: float) -> None:
    scenery = draw(Hazards(on=frozenset({Hazard.DOORS}), open_door=1.0), LOOP, 3)
    solid = scenery.walls[np.hypot(*(scenery.walls[:, 2:] - scenery.walls[:, :2]).T) > 0.0]
    start, along = solid[:, :2], solid[:, 2:] - solid[:, :2]
    for door in scenery.doors:
        x0, y0, x1, y1 = walls_of(LOOP).segments[door.edge]
        length = math.hypot(x1 - x0, y1 - y0)
        u, v = (x1 - x0) / length, (y1 - y0) / length
        place = x0 + part * (x1 - x0) + 700.0 * v, y0 + part * (y1 - y0) - 700.0 * u
        toward = math.degrees(math.atan2(v, u))
        world = World(walls=scenery, poses=[(*place, toward)], config=IDEAL)
        world.command(0, 400.0, 0.0)
        for _ in range(100):
            world.advance(0.1)
            at = np.array(world.true_pose(0)[:2])
            spot = np.clip(((at - start) * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
            assert np.hypot(*(start + spot[:, None] * along - at).T).min() >= IDEAL.radius_mm - 1e-6
        assert world.contact_speed(0) == pytest.approx(400.0)
        assert world.bumper(0).front


def test_a_robot_that_keeps_pushing_does_not_count_as_fast() -> None:
    world = World(walls=BOX, poses=[(0.0, 39_599.5, 0.0)], config=IDEAL)  # as good as touching
    world.command(0, 500.0, 0.0)
    world.advance(5.0)
    assert 0.0 < world.contact_speed(0) < 50.0


# --- determinism ---------------------------------------------------------------------------------


def test_a_world_without_hazards_is_that_of_its_walls_bit_for_bit() -> None:
    plain = World(walls=walls_of(LOOP).segments, poses=[LOOP.start], seed=3)
    calm = World(walls=draw(Hazards.none(), LOOP, 77), poses=[LOOP.start], seed=3)
    assert history(plain, 0) == history(calm, 0)


@pytest.mark.parametrize("hazard", [Hazard.LIGHTS, Hazard.SUN, Hazard.COMPASS, Hazard.PEOPLE, Hazard.SLIP])
def test_what_a_robot_does_not_meet_changes_nothing_of_its_run(hazard: Hazard) -> None:
    """Who turns on the spot crosses no joint; people may come near, so only the wheels are compared then."""

    def run(hazards: Hazards) -> list[tuple[object, ...]]:
        world = World(walls=draw(hazards, MSU, 4), poses=[MSU.start], seed=4)
        seen: list[tuple[object, ...]] = []
        for _ in range(200):
            world.command(0, 0.0, 40.0)
            world.advance(0.05)
            heard = () if hazard is Hazard.PEOPLE else tuple(world.sonar(0).tolist())
            seen.append((world.odometry(0), world.true_pose(0), heard))
        return seen

    assert run(Hazards()) == run(Hazards().without(hazard))


@pytest.mark.parametrize("config", [IDEAL, ROME], ids=["ideal", "real"])
def test_with_all_hazards_the_same_seed_gives_the_same_run(config: RobotConfig) -> None:
    def run(seed: int) -> list[tuple[object, ...]]:
        world = World(walls=draw(Hazards(), MSU, seed), poses=[MSU.start], seed=seed, config=config)
        return [*history(world, 0, 400), (world.people.tobytes(), world.contact_speed(0), world.compass(0))]

    assert run(1) == run(1)
    assert run(1) != run(2)
