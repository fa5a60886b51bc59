"""The simulated hardware in its own time: steps without drift, watchdogs, readings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.sim.cameras.camera import Camera
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.cameras.surfaces import scene
from colony.sim.compiled import Bytes2
from colony.sim.hazards.scenery import CeilingLight, bare_scenery
from colony.sim.plant.hardware import MAX_LAG_NS, STEP_NS, WATCHDOG_NS, Devices
from colony.sim.plant.process import reading
from colony.sim.plant.protocol import AttachBase, AttachCamera, AttachProximity
from colony.sim.world.world import World
from tests.sim.robots import FRONT_CAMERA, IDEAL, RING

MS = 1_000_000
S = 1_000_000_000
NORTH_WALL = [[-9000.0, 9000.0, 9000.0, 9000.0]]
ALONE = ((0.0, 0.0, 0.0),)


def devices(poses: tuple[tuple[float, float, float], ...] = ALONE, **options: int) -> Devices:
    world = World(walls=NORTH_WALL, poses=poses, config=IDEAL)
    camera = Camera(scene(NORTH_WALL), FRONT_CAMERA, robot_radius_mm=400.0)
    names = tuple(f"robot{number}" for number in range(len(poses)))
    return Devices(world, names, {"ahead": lambda: camera.see}, now_ns=7, **options)


def test_time_passes_in_whole_steps_and_does_not_drift() -> None:
    one = devices(step_ns=10 * MS)
    for now_ns in range(7, 3 * S, 7_777_777):  # waking up at odd times loses nothing
        one.advance(now_ns)
        assert 0 <= now_ns - one.time_ns < 10 * MS
        assert (one.time_ns - 7) % (10 * MS) == 0


def test_how_time_is_cut_makes_no_difference() -> None:
    often, seldom = devices(), devices()
    for one, every in ((often, 10 * MS), (seldom, 130 * MS)):
        one.drive(0, 300.0, 5.0)
        for now_ns in range(7, 400 * MS, every):
            one.advance(now_ns)
        one.advance(400 * MS)
    assert often.truth(0) == seldom.truth(0)


def test_a_base_that_is_not_commanded_any_more_stops() -> None:
    one = devices()
    for k in range(10):
        one.drive(0, 300.0, 0.0)
        one.advance(7 + (k + 1) * 200 * MS)
        assert one.truth(0).driven
    last = one.time_ns
    one.advance(last + 300 * MS - 10 * MS)
    assert one.truth(0).velocity == 300.0
    one.advance(last + 300 * MS + 10 * MS)
    assert not one.truth(0).driven
    one.advance(last + 1 * S)
    assert one.truth(0).velocity == 0.0
    assert 600.0 < one.truth(0).distance < 780.0
    one.drive(0, 300.0, 0.0)  # and goes on when it is
    assert one.truth(0).driven


def test_halting_is_for_one_robot() -> None:
    one = devices(((0.0, 0.0, 0.0), (3000.0, 0.0, 0.0)))
    one.drive(0, 300.0, 0.0)
    one.drive(1, 300.0, 0.0)
    one.halt(1)
    one.advance(400 * MS)
    assert [one.truth(robot).velocity > 0.0 for robot in (0, 1)] == [True, False]


def test_what_is_too_late_is_skipped_and_nothing_moved_meanwhile() -> None:
    one = devices()
    one.drive(0, 300.0, 0.0)
    one.advance(400 * MS)
    before = one.truth(0)
    one.advance(400 * MS + 3600 * S)
    after = one.truth(0)
    assert after.t_ns == pytest.approx(400 * MS + 3600 * S, abs=STEP_NS)
    assert after.skipped_ns == pytest.approx(3600 * S, abs=2 * STEP_NS)
    assert not after.driven
    assert after.distance == before.distance
    one.advance(one.time_ns + 20 * MS)
    assert one.truth(0).velocity < before.velocity


def test_what_is_a_little_late_is_simulated() -> None:
    one = devices()
    one.drive(0, 300.0, 0.0)
    one.advance(7 + MAX_LAG_NS)
    truth = one.truth(0)
    assert (truth.skipped_ns, truth.velocity) == (0, 0.0)
    assert truth.distance > 300.0 * (WATCHDOG_NS / 1e9 - 300.0 / 800.0)


def test_readings_are_of_the_present_step() -> None:
    one = devices()
    one.drive(0, 200.0, 0.0)
    one.advance(7 + 500 * MS)
    base, rings, image, truth = one.base(0), one.proximity(0), one.image(0, "ahead"), one.truth(0)
    assert {r.t_ns for r in (base, rings.sonar, rings.infrared, image, truth)} == {7 + 500 * MS}
    ports = (
        AttachBase(robot="robot0"),
        AttachProximity(robot="robot0"),
        AttachCamera(robot="robot0", camera="ahead"),
    )
    readings = [reading(port, one) for port in ports]
    assert [r.value for r in readings] == [base, rings, image]
    assert {r.t_ns for r in readings} == {7 + 500 * MS}
    assert (base.x, base.y, base.heading) == pytest.approx((truth.x, truth.y, truth.heading))
    assert (base.speed, base.turn_rate, base.wheel_speed) == (200.0, 0.0, 200.0)
    assert rings.sonar.value[12] == pytest.approx(9000.0 - truth.y - RING.ring_mm)
    assert len(rings.infrared.value) == 24
    assert (image.height, image.width, len(image.pixels)) == (120, 240, 120 * 240)


def test_robots_see_each_other() -> None:
    one = devices(((0.0, 0.0, 0.0), (0.0, 2000.0, 180.0)))
    assert one.proximity(0).sonar.value[12] == pytest.approx(2000.0 - 400.0 - RING.ring_mm)
    before = np.frombuffer(one.image(0, "ahead").pixels, np.uint8)
    one.place(1, 3000.0, -2000.0, 0.0)
    assert one.proximity(0).sonar.value[12] > 5000.0
    assert (np.frombuffer(one.image(0, "ahead").pixels, np.uint8) != before).any()


def test_a_robot_that_is_carried_does_not_notice() -> None:
    one = devices()
    one.drive(0, 300.0, 0.0)
    one.advance(400 * MS)
    believed = one.base(0)
    one.place(0, -1000.0, -2000.0, 90.0)
    truth = one.truth(0)
    assert (truth.x, truth.y, truth.heading, truth.velocity) == (-1000.0, -2000.0, 90.0, 0.0)
    assert (one.base(0).x, one.base(0).y) == (believed.x, believed.y)
    with pytest.raises(ValueError, match="from a wall"):
        one.place(0, 0.0, 8900.0, 0.0)
    with pytest.raises(ValueError, match="not finite"):
        one.place(0, math.nan, 0.0, 0.0)
    assert one.truth(0) == truth


def test_names_are_told_where_they_are_wrong() -> None:
    one = devices()
    assert one.number("robot0") == 0
    with pytest.raises(ValueError, match="no robot `bob`; the robots are robot0"):
        one.number("bob")
    with pytest.raises(ValueError, match="no camera `up`; they have ahead"):
        one.check_camera("up")
    with pytest.raises(ValueError, match="2 robots, named a, a"):
        Devices(World(walls=[], poses=[(0, 0, 0), (2000, 0, 0)]), ("a", "a"), {}, now_ns=0)
    for step_ns in (0, -1, 10 * S):
        with pytest.raises(ValueError, match="steps of"):
            devices(step_ns=step_ns)


def test_a_camera_looks_up_from_where_its_robot_is() -> None:
    lamp = CeilingLight(x_mm=0.0, y_mm=0.0, heading_deg=0.0)
    below = replace(bare_scenery(np.array(NORTH_WALL)), lights=(lamp,))
    world = World(walls=below, poses=((0.0, 0.0, 0.0), (3000.0, 0.0, 0.0)), config=IDEAL)
    camera = CeilingCamera(below)

    def above(world: World, robot: int, t_ns: int) -> Bytes2:
        return camera.image(world.true_pose(robot), t_ns)

    one = Devices(world, ("under", "beside"), {"up": lambda: above}, now_ns=7)
    under, beside = one.image(0, "up"), one.image(1, "up")
    assert (under.t_ns, under.height, under.width, under.channels) == (7, 120, 240, 1)
    assert under.pixels == CeilingCamera(below).image((0.0, 0.0, 0.0), 7).tobytes()
    assert max(under.pixels) > 200 > max(beside.pixels)
