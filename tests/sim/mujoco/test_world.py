"""A robot that MuJoCo moves: what its drivers and devices say, and that only its wheels drive it."""

from __future__ import annotations

import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import ArrayLike

pytest.importorskip("mujoco", reason="extra mujoco not installed")

from colony.body.model import Body
from colony.body.servers import servers_of
from colony.body.shipped import shipped_body
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.config import config_of
from colony.sim.devices import devices_of
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.mechanism import nothing_given
from colony.sim.mujoco.model import TIRE_FRICTION, build_of, mjcf
from colony.sim.mujoco.world import MujocoWorld
from colony.sim.timeline import MAX_STEP_S
from colony.sim.world.world import PressedBumpers, Speed, World
from tests.sim.devices.stage import body_with

S = 1_000_000_000
AMR = shipped_body("amr")
AHEAD = np.array([[-3000.0, 2000.0, 3000.0, 2000.0]])
"""A wall 2 m north of the origin, whose free space is south of it."""

POINTS_NORTH = (0.0, 0.0, 0.0)


def world_of(body: Body = AMR, walls: ArrayLike = AHEAD, seed: int = 0) -> MujocoWorld:
    return MujocoWorld(body=body, walls=walls, pose=POINTS_NORTH, seed=seed)


def advance(world: MujocoWorld, seconds: float) -> None:
    for _ in range(round(seconds / 0.05)):
        world.advance(0.05)


def test_it_stands_still_until_its_first_command() -> None:
    world = world_of()
    advance(world, 2.0)
    assert tuple(world.true_pose(0)) == pytest.approx(POINTS_NORTH, abs=0.01)
    assert (world.speed(0), world.wheel_speed(0), world.distance(0)) == (Speed(0.0, 0.0), 0.0, 0.0)
    assert world.bumper(0) == PressedBumpers(front=False, rear=False)


def test_only_friction_moves_it() -> None:
    """The same commands move a robot on a slippery floor by next to nothing, and its wheels spin."""
    moved, rolled = [], []
    for friction in (TIRE_FRICTION, 1e-4):
        world = world_of()
        wheels = world.model.geom_type == 4
        assert wheels.sum() == 2
        world.model.geom_friction[wheels, 0] = friction
        world.command(0, 500.0, 0.0)
        advance(world, 2.0)
        moved.append(world.true_pose(0).y_mm)
        rolled.append(world.odometry(0).y_mm)
    assert moved[0] == pytest.approx(875.0, rel=0.01)
    assert moved[1] < 10.0
    assert rolled == pytest.approx([875.0, 875.0], rel=0.02)


def test_the_model_has_nothing_but_motors_to_move_it() -> None:
    model = ElementTree.fromstring(mjcf(AMR, AHEAD, POINTS_NORTH))
    actuators = [(actuator.tag, actuator.get("joint")) for actuator in model.find("actuator") or ()]
    assert actuators == [("velocity", "left wheel"), ("velocity", "right wheel"), ("position", "Lift")]
    assert not model.findall(".//equality") + model.findall(".//keyframe")


def test_acceleration_is_that_of_the_body() -> None:
    world = world_of()
    world.command(0, 900.0, 0.0)
    advance(world, 0.5)
    assert world.speed(0).velocity_mm_s == pytest.approx(500.0, abs=20.0)
    world.command(0, 0.0, 0.0)
    advance(world, 2.0)
    assert world.speed(0) == Speed(0.0, 0.0)


def test_commands_and_readings_are_late_as_the_body_says() -> None:
    late = replace(config_of(AMR), command_delay_ns=200_000_000, reading_delay_ns=100_000_000)
    clock = VirtualClock()
    world = MujocoWorld(body=AMR, walls=AHEAD, pose=POINTS_NORTH, config=late)
    base = simulated_drivers(Plant(world, clock), body=AMR).base
    base.drive(500.0, 0.0)
    clock.now_ns = 200_000_000
    state = base.state()
    assert world.distance(0) == 0.0
    assert state.t_ns == 100_000_000
    clock.now_ns = 400_000_000
    state = base.state()
    assert world.distance(0) == pytest.approx(20.0, rel=0.1)
    assert state.t_ns == 300_000_000
    assert state.y == pytest.approx(5.0, rel=0.2)


def test_commands_are_limited() -> None:
    world = world_of(walls=np.empty((0, 4)))
    world.command(0, 9000.0, -900.0)
    advance(world, 3.0)
    assert world.speed(0).velocity_mm_s == pytest.approx(1000.0, rel=0.01)
    assert world.speed(0).turn_deg_s == pytest.approx(-90.0, rel=0.02)
    with pytest.raises(ValueError, match="expected finite ones"):
        world.command(0, math.nan, 0.0)
    with pytest.raises(ValueError, match="expected a time above 0"):
        world.advance(MAX_STEP_S + 1.0)
    with pytest.raises(IndexError, match="no robot 1"):
        world.command(1, 0.0, 0.0)


@pytest.mark.parametrize(
    ("velocity", "bumper"), [(400.0, PressedBumpers(True, False)), (-400.0, PressedBumpers(False, True))]
)
def test_a_wall_presses_the_bumper_and_stalls_the_wheels(velocity: float, bumper: PressedBumpers) -> None:
    wall = AHEAD if velocity > 0.0 else -AHEAD
    world = world_of(walls=wall)
    world.command(0, velocity, 0.0)
    advance(world, 6.0)
    assert world.bumper(0) == bumper
    assert {round(bearing) % 360 for bearing in world.contact_bearings(0)} == {0 if velocity > 0.0 else 180}
    assert world.bumps(0) == 1
    assert abs(world.true_pose(0).y_mm) == pytest.approx(1600.0, abs=5.0)
    assert abs(world.speed(0).velocity_mm_s) < 1.0
    world.command(0, -velocity, 0.0)
    advance(world, 1.0)
    assert world.bumper(0) == PressedBumpers(front=False, rear=False)


def test_the_errors_of_the_odometry_are_those_of_ours() -> None:
    """The same seed draws the same errors of scale, which show on a long way."""
    exact = replace(config_of(AMR), wheel_slip_mm=0.0)
    ways = []
    for world in (
        World(walls=[], poses=[POINTS_NORTH], config=exact, seed=7),
        MujocoWorld(body=AMR, walls=[], pose=POINTS_NORTH, config=exact, seed=7),
    ):
        world.command(0, 1000.0, 0.0)
        for _ in range(200):
            world.advance(0.05)
        ways.append((world.odometry(0).heading_deg + 180.0) % 360.0 - 180.0)
    assert abs(ways[0]) > 0.5
    assert ways[1] == pytest.approx(ways[0], abs=0.3)


def test_the_same_calls_give_the_same_run() -> None:
    poses = []
    for seed in (3, 3, 4):
        world = world_of(seed=seed)
        world.command(0, 300.0, 20.0)
        advance(world, 1.0)
        poses.append((world.true_pose(0), world.odometry(0)))
    assert poses[0] == poses[1]
    assert poses[0][0] == poses[2][0]
    assert poses[0][1] != poses[2][1]


def test_time_that_is_no_whole_step_is_made_up_for() -> None:
    world = world_of()
    for _ in range(30):
        world.advance(1 / 30)
    assert world.elapsed_ns == 30 * round(1e9 / 30)
    assert world.data.time == pytest.approx(0.5 + 0.998, abs=0.0021)


def test_drivers_are_those_of_our_simulator() -> None:
    clock = VirtualClock()
    drivers = simulated_drivers(Plant(world_of(), clock), body=AMR, servers=servers_of(AMR))
    assert drivers.proximity is None
    assert set(drivers.devices) == {"Lidar", "Floor", "Battery", "Panel", "Lift"}
    drivers.base.drive(500.0, 0.0)
    clock.now_ns = 2 * S
    state = drivers.base.state()
    assert state.t_ns == 2 * S
    assert state.y == pytest.approx(875.0, rel=0.02)
    scan = drivers.devices["Lidar"].fields()["scan"]
    assert scan.value[180] == pytest.approx(2000.0 - 875.0, abs=60.0)
    assert scan.value[0] == math.inf


def test_the_lift_is_moved_by_its_motor() -> None:
    world = world_of()
    lift = devices_of(AMR, servers_of(AMR), world, 0, seed=1, given=nothing_given)["Lift"]

    def read() -> dict[str, object]:
        return {name: s and s.value for name, s in lift.sense(world.elapsed_ns).items()}

    at_rest = {
        "position": 0.0,
        "target": 0.0,
        "moving": False,
        "load": 0.0,
        "lower_end": True,
        "upper_end": False,
    }
    assert read() == at_rest
    lift.command("move", {"position": 2.0}, world.elapsed_ns)
    advance(world, 2.0)
    assert read()["position"] == pytest.approx(100.0, abs=2.0)
    assert read()["moving"]
    lift.safe(world.elapsed_ns)
    advance(world, 1.0)
    assert read()["position"] == pytest.approx(100.0, abs=2.0)
    assert not read()["moving"]
    lift.command("move", {"position": 2.0}, world.elapsed_ns)
    advance(world, 3.0)
    assert read() == at_rest | {"position": 200.0, "target": 2.0, "lower_end": False, "upper_end": True}


def test_a_battery_is_charged_where_the_robot_stands() -> None:
    """Contacts creep: that neither counts as driving nor as a speed."""
    world = world_of()
    devices = devices_of(AMR, servers_of(AMR), world, 0, seed=1, given=nothing_given)
    charging = devices["Battery"].sense(world.elapsed_ns)["charging"]
    assert charging.value is True
    advance(world, 5.0)
    charging = devices["Battery"].sense(world.elapsed_ns)["charging"]
    assert charging.value is True


LIDAR = """
[server.Lidar]
fields.scan = { no_echo = "5 m", blocked = ["85 deg .. 95 deg"] }

[server.Lidar.simulated]
device   = "lidar"
pose     = ["100 mm", "-50 mm", "0 deg"]
count    = 4
bearing  = "180 deg"
step     = "-90 deg"
range    = "5 m"
"""


def test_beams_of_a_lidar_off_the_center_that_turns_clockwise() -> None:
    """Beams behind, left (blocked), ahead and right, of a scanner 100 mm ahead and 50 mm to the right."""
    body = body_with(LIDAR)
    box = [[-1000.0, 1000.0, 1000.0, 1000.0], [1000.0, 1000.0, 1000.0, -6000.0]]
    world = world_of(body, walls=np.array(box))
    lidar = devices_of(body, servers_of(body), world, 0, seed=1, given=nothing_given)["Lidar"]
    sample = lidar.sense(world.elapsed_ns)["scan"]
    assert sample.value == pytest.approx((math.inf, math.inf, 900.0, 950.0), abs=0.1)


def test_what_it_does_not_simulate_is_refused() -> None:
    with pytest.raises(ValueError, match="no sonars and no cameras, such as that of PServer"):
        build_of(shipped_body("rome"))
    with pytest.raises(ValueError, match="two driven wheels"):
        build_of(shipped_body("omni"))
    with pytest.raises(ValueError, match="expected at least 400 mm"):
        MujocoWorld(body=AMR, walls=AHEAD, pose=(0.0, 1700.0, 0.0))
    narrow = replace(AMR.chassis.drive, wheel_base_mm=790.0)
    with pytest.raises(ValueError, match="are not under a hull"):
        build_of(replace(AMR, chassis=replace(AMR.chassis, drive=narrow)))
    world = world_of()
    for ring in (world.sonar, world.infrared):
        with pytest.raises(ValueError, match="no ring of sonars"):
            ring(0)
