"""The devices of a simulated robot: the world is at the clock's present whenever one is used."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from colony.body.shipped import shipped_body
from colony.runtime.library.camera import array
from colony.runtime.servers.drivers import Reading
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.surfaces import scene
from colony.sim.config import config_of
from colony.sim.drivers import Plant, SimulatedCamera, image_of, simulated_drivers
from colony.sim.world.world import World
from tests.sim.robots import FRONT_CAMERA, IDEAL, RING, SIDEWAYS

S = 1_000_000_000


def plant(clock: VirtualClock, poses: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)) -> Plant:
    walls = [[-5000.0, 3000.0, 5000.0, 3000.0]]
    return Plant(World(walls=walls, poses=poses, config=IDEAL), clock)


def test_time_passes_when_a_device_is_used() -> None:
    clock = VirtualClock()
    base = simulated_drivers(plant(clock)).base
    base.drive(200.0, 0.0)
    clock.now_ns = 25 * S
    state = base.state()
    assert state.t_ns == 25 * S
    assert state.front_bumper
    assert not state.rear_bumper
    assert state.y == pytest.approx(2600.0, abs=2.0)
    assert state.x == pytest.approx(0.0, abs=1e-6)


def test_speeds_are_measured() -> None:
    clock = VirtualClock()
    base = simulated_drivers(plant(clock)).base
    base.drive(-100.0, 45.0)
    clock.now_ns = 1 * S
    state = base.state()
    assert (state.speed, state.turn_rate) == (-100.0, 45.0)
    wheel = 45.0 * 3.141592653589793 / 180 * IDEAL.wheel_base_mm / 2
    assert state.wheel_speed == pytest.approx((abs(-100 - wheel) + abs(-100 + wheel)) / 2)
    assert 0.0 < state.heading < 45.0
    base.stop()
    clock.now_ns = 3 * S
    stopped = base.state()
    assert (stopped.speed, stopped.turn_rate, stopped.wheel_speed) == (0.0, 0.0, 0.0)


def test_a_base_that_drives_sideways_is_commanded_and_measured_so() -> None:
    clock, config = VirtualClock(), replace(IDEAL, **SIDEWAYS)
    base = simulated_drivers(Plant(World(walls=(), poses=((0.0, 0.0, 0.0),), config=config), clock)).base
    assert base.limits.sideways == config.max_sideways_mm_s
    base.drive(0.0, 0.0, 200.0)
    clock.now_ns = 2 * S
    state = base.state()
    assert (state.speed, state.sideways_speed, state.wheel_speed) == (0.0, 200.0, 200.0)
    assert state.x == pytest.approx(-350.0, abs=5.0)
    assert state.y == 0.0
    base.stop()
    clock.now_ns = 3 * S
    stopped = base.state()
    assert stopped.sideways_speed == 0.0


def test_rings_are_plain_values_with_their_time() -> None:
    clock = VirtualClock(7)
    proximity = simulated_drivers(plant(clock)).proximity
    clock.now_ns = 50_000_007
    sonar, infrared = proximity.sonar(), proximity.infrared()
    assert sonar.t_ns == infrared.t_ns == 50_000_007
    assert isinstance(sonar.value, tuple)
    assert isinstance(infrared.value, tuple)
    assert {type(v) for v in sonar.value} == {float}
    assert {type(v) for v in infrared.value} == {bool}
    assert sonar.value[12] == pytest.approx(3000.0 - RING.ring_mm)


def test_a_camera_sees_where_the_robot_is_now() -> None:
    clock = VirtualClock()
    shared = plant(clock)
    scenery = scene([[-5000.0, 3000.0, 5000.0, 3000.0]])
    eye = Camera(scenery, FRONT_CAMERA, robot_radius_mm=400.0)
    camera = SimulatedCamera(shared, lambda now_ns: image_of(eye.see(shared.world, 0, now_ns), now_ns))
    first = camera.grab().rows(0, 120)
    simulated_drivers(shared).base.drive(500.0, 0.0)
    clock.now_ns = 2 * S
    second = camera.grab().rows(0, 120)
    assert (first.t_ns, second.t_ns) == (0, 2 * S)
    assert (first.height, first.width, first.channels) == (120, 240, 1)
    assert array(second).mean() > array(first).mean()  # the wall is nearer, and brighter


def test_robots_of_one_world_share_its_time() -> None:
    clock = VirtualClock()
    shared = plant(clock, ((0.0, 0.0, 0.0), (2000.0, 0.0, 180.0)))
    first, second = simulated_drivers(shared, 0).base, simulated_drivers(shared, 1).base
    first.drive(100.0, 0.0)
    second.drive(100.0, 0.0)
    clock.now_ns = 2 * S
    one, other = first.state(), second.state()
    assert one.y == pytest.approx(-other.y)
    assert one.y > 100.0


def test_a_base_tells_what_it_can_do() -> None:
    base = simulated_drivers(plant(VirtualClock())).base
    assert (base.limits.velocity, base.limits.turn) == (IDEAL.max_velocity_mm_s, IDEAL.max_turn_deg_s)
    assert base.limits.acceleration == IDEAL.acceleration_mm_s2
    assert base.register_bits is None


def test_devices_are_read_and_commanded_at_the_present_of_the_clock() -> None:
    clock, body = VirtualClock(5), shipped_body("amr")
    amr = Plant(World(walls=[], poses=[(0.0, 0.0, 0.0)], config=config_of(body)), clock)
    drivers = simulated_drivers(amr, body=body, seed=3)
    assert {server.name for server in drivers.servers} >= {"RServer", "Lidar", "Lift", "DServer"}
    assert drivers.base is not None
    assert drivers.proximity is None
    lift, lidar = drivers.devices["Lift"], drivers.devices["Lidar"]
    lift.command("move", {"position": 2.0})
    clock.now_ns = 5 + S
    position = lift.fields()["position"]
    assert (position.value, position.age_ns) == (pytest.approx(50.0), 0)
    lift.safe()
    clock.now_ns = 5 + 2 * S + 30_000_000
    assert lift.fields()["position"] == Reading(position.value, 0)
    scan = lidar.fields()["scan"]
    clock.now_ns += 20_000_000
    later = lidar.fields()["scan"]
    assert later == Reading(scan.value, scan.age_ns + 20_000_000)
    assert set(scan.value) == {math.inf}
    lift.close()


def test_what_is_given_comes_in_place_of_what_devices_measure() -> None:
    clock, body = VirtualClock(), shipped_body("amr")
    amr = Plant(World(walls=[], poses=[(0.0, 0.0, 0.0)], config=config_of(body)), clock)
    panel = simulated_drivers(amr, body=body, given=lambda *key: True).devices["Panel"]
    assert panel.fields() == {"estop": Reading(True, 0)}


class Recorder:
    """A companion of a plant, with a frame every 30 ms. Mutable: what it saw, and when it is due."""

    def __init__(self, plant: Plant, number: int, period_ns: int = 30_000_000) -> None:
        self.base = simulated_drivers(plant, number, body=shipped_body("rome")).base
        self.period_ns, self.due_ns = period_ns, 0
        self.seen: list[tuple[int, float]] = []

    def run_frame(self) -> None:
        state = self.base.state()
        self.seen.append((state.t_ns, state.y))
        self.base.drive(200.0, 0.0)
        self.due_ns += self.period_ns


def test_companions_run_at_their_own_frames_in_the_world_of_that_time() -> None:
    clock = VirtualClock()
    together = plant(clock, ((0.0, -5000.0, 0.0), (3000.0, -5000.0, 0.0), (-3000.0, -5000.0, 0.0)))
    own = simulated_drivers(together).base
    fast, slow = Recorder(together, 1), Recorder(together, 2, 70_000_000)
    together.join(fast)
    together.join(slow)
    own.drive(100.0, 0.0)
    assert fast.seen == []
    clock.now_ns = 200_000_000
    state = own.state()
    assert state.t_ns == 200_000_000
    assert [t for t, _ in fast.seen] == [30_000_000 * k for k in range(7)]
    assert [t for t, _ in slow.seen] == [0, 70_000_000, 140_000_000]
    assert together.world.elapsed_ns == 200_000_000
    ways = [y for _, y in fast.seen]
    assert ways == sorted(ways)
    assert ways[-1] > ways[0]


def test_a_companion_that_is_due_now_runs_before_the_world_goes_on() -> None:
    clock = VirtualClock()
    together = plant(clock, ((0.0, -5000.0, 0.0), (3000.0, -5000.0, 0.0)))
    other = Recorder(together, 1)
    together.join(other)
    for clock.now_ns in (30_000_000, 60_000_000):
        together.catch_up()
    assert [t for t, _ in other.seen] == [0, 30_000_000]
    clock.now_ns += 1
    together.catch_up()
    assert [t for t, _ in other.seen] == [0, 30_000_000, 60_000_000]
