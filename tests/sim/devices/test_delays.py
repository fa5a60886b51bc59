"""Commands that take effect late; readings that arrive late, and of base and ring at a rate."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.body.model import Body
from colony.body.reader import body_of_text
from colony.runtime.servers.drivers import Drivers, Reading
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.config import config_of
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.plant.hardware import WATCHDOG_NS, Devices
from colony.sim.world.world import World
from tests.sim.devices.stage import CHASSIS
from tests.sim.robots import IDEAL

MS = 1_000_000
FRAME = 50 * MS
DELAYS = '[body.delays]\ncommand = "{command} ms"\nreading = "{reading} ms"\n\n[body.limits]'
SERVERS = """
[server.Lift.simulated]
device = "joint"
range  = "0 mm .. 200 mm"
speed  = "100 mm/s"

[server.Lidar]
rate = "10 Hz"

[server.Lidar.simulated]
device = "lidar"
count  = 8
bearing = "-180 deg"
range  = "12 m"
"""


class Robot:
    """A small robot that faces a wall 5 m ahead, and its drivers. Mutable: its clock goes on."""

    def __init__(self, command_ms: int = 0, reading_ms: int = 0) -> None:
        delays = DELAYS.format(command=command_ms, reading=reading_ms)
        file = body_of_text(CHASSIS.replace("[body.limits]", delays) + SERVERS, "probe.toml")
        assert file.body is not None, file.diagnostics
        self.clock = VirtualClock(7)
        walls = [[-9000.0, 5000.0, 9000.0, 5000.0]]
        self.world = World(walls=walls, poses=[(0.0, 0.0, 0.0)], config=config_of(file.body))
        self.drivers: Drivers = simulated_drivers(Plant(self.world, self.clock), body=file.body)

    def frame(self, count: int = 1) -> None:
        for _ in range(count):
            self.clock.now_ns += FRAME
            self.read("Lift", "position")

    def drive(self, velocity: float) -> None:
        self.drivers.base.drive(velocity, 0.0)

    def y(self) -> tuple[float, int] | None:
        """The way that the base reports, and its age."""
        state = self.drivers.base.state()
        return None if state is None else (state.y, self.clock.now_ns - state.t_ns)

    def read(self, server: str, field: str) -> Reading | None:
        return self.drivers.devices[server].fields()[field]


def check(reading: Reading | None, value: object, age_ms: int) -> None:
    assert reading.age_ns == age_ms * MS
    assert reading.value == pytest.approx(value)


@pytest.mark.parametrize("delay_ms", [1, 30, 50, 70, 1234])
def test_a_command_moves_the_base_after_its_delay(delay_ms: int) -> None:
    prompt, late = Robot(), Robot(command_ms=delay_ms)
    late.drive(300.0)
    late.clock.now_ns += delay_ms * MS
    for robot in (prompt, late):
        robot.y()
    assert late.world.distance(0) == 0.0
    prompt.drive(300.0)
    for robot in (prompt, late):
        robot.clock.now_ns += 200 * MS
        robot.y()
    assert 40.0 < prompt.world.distance(0) == pytest.approx(late.world.distance(0))
    assert late.world.speed(0) == prompt.world.speed(0)


def test_commands_take_effect_in_their_order_and_a_stop_is_one_of_them() -> None:
    robot = Robot(command_ms=130)
    robot.drive(300.0)
    robot.frame()
    robot.drive(-300.0)
    robot.frame()
    robot.drivers.base.stop()
    speeds = []
    for _ in range(8):
        robot.clock.now_ns += 10 * MS
        robot.y()
        speeds.append(robot.world.speed(0).velocity_mm_s)
    assert speeds == pytest.approx([0.0, 0.0, 0.0, 100.0, 200.0, 300.0, 300.0, 300.0])
    robot.clock.now_ns += 50 * MS
    robot.y()
    assert robot.world.speed(0).velocity_mm_s == pytest.approx(-200.0)
    robot.frame()
    assert robot.world.speed(0).velocity_mm_s == 0.0


def test_a_joint_moves_after_the_delay_and_refuses_at_once() -> None:
    robot = Robot(command_ms=70)
    lift = robot.drivers.devices["Lift"]
    lift.command("move", {"position": 50.0})
    with pytest.raises(ValueError, match="no command `fly`"):
        lift.command("fly", {})
    robot.frame()
    assert robot.read("Lift", "position") == Reading(0.0, 0)
    assert robot.read("Lift", "target") == Reading(0.0, 0)
    robot.frame()
    check(robot.read("Lift", "position"), 3.0, 0)
    assert robot.read("Lift", "target") == Reading(50.0, 0)
    lift.safe()
    robot.frame()
    assert robot.read("Lift", "moving") == Reading(True, 0)
    robot.frame()
    check(robot.read("Lift", "position"), 10.0, 0)
    assert robot.read("Lift", "moving") == Reading(False, 0)


@pytest.mark.parametrize("delay_ms", [1, 30, 50, 70, 170])
def test_a_reading_is_as_old_as_its_delay(delay_ms: int) -> None:
    late, prompt = Robot(reading_ms=delay_ms), Robot()
    read = []
    for robot in (late, prompt):
        robot.y()
        robot.drive(300.0)
        robot.drivers.devices["Lift"].command("move", {"position": 200.0})
    for _ in range(10):
        late.frame()
        read.append((late.clock.now_ns, late.y(), late.read("Lift", "position")))
    waited = sum(y is None for _, y, _ in read)
    assert waited == (delay_ms - 1) // 50
    for now_ns, y, position in read[waited:]:
        prompt.clock.now_ns = now_ns - delay_ms * MS
        was = prompt.y()
        assert y[0] == pytest.approx(was[0])
        assert y[1] == delay_ms * MS
        raised = prompt.read("Lift", "position")
        check(position, raised.value, delay_ms)
    assert y[0] > 30.0


def test_a_delay_adds_to_the_age_of_what_is_measured_at_a_rate() -> None:
    robot, ages = Robot(reading_ms=60), []
    for _ in range(7):
        robot.frame()
        scan = robot.read("Lidar", "scan")
        ages.append(None if scan is None else scan.age_ns // MS)
    assert ages == [None, 100, 150, 100, 150, 100, 150]


def test_a_scan_that_arrives_late_is_of_where_the_robot_was() -> None:
    robot, prompt = Robot(reading_ms=100), Robot()
    for one in (robot, prompt):
        one.drive(1000.0)
        one.frame(10)
    before = prompt.read("Lidar", "scan")
    robot.frame(2)
    check(robot.read("Lidar", "scan"), before.value, 100)
    prompt.frame(2)
    assert prompt.read("Lidar", "scan") != before


def test_sonars_and_infrared_arrive_late() -> None:
    late = replace(IDEAL, reading_delay_ns=80 * MS)
    clock = VirtualClock()
    world = World(walls=[[-5000.0, 3000.0, 5000.0, 3000.0]], poses=[(0.0, 0.0, 0.0)], config=late)
    proximity = simulated_drivers(Plant(world, clock)).proximity
    assert (proximity.sonar(), proximity.infrared()) == (None, None)
    world.command(0, 300.0, 0.0)
    for _ in range(20):
        clock.now_ns += FRAME
        sonar, infrared = proximity.sonar(), proximity.infrared()
    assert sonar.t_ns == infrared.t_ns == clock.now_ns - 80 * MS
    assert 0.0 < sonar.value[12] - world.sonar(0)[12] == pytest.approx(0.08 * 300.0)


def test_the_plant_of_processes_delays_both() -> None:
    """A base stops when its watchdog's time has passed since its last command arrived."""
    config = replace(IDEAL, command_delay_ns=30 * MS, reading_delay_ns=30 * MS)
    world = World(walls=[], poses=[(0.0, 0.0, 0.0)], config=config)
    one = Devices(world, ("robot",), {}, now_ns=7)
    assert (one.base(0), one.proximity(0).sonar) == (None, None)
    one.drive(0, 300.0, 0.0)
    one.advance(7 + 20 * MS)
    assert one.base(0) is None
    one.advance(7 + 40 * MS)
    assert one.truth(0).velocity == pytest.approx(8.0)
    one.advance(7 + 80 * MS)
    state, sonar = one.base(0), one.proximity(0).sonar
    assert one.time_ns - state.t_ns == one.time_ns - sonar.t_ns == 30 * MS
    assert state.speed == pytest.approx(16.0)
    assert one.truth(0).velocity == pytest.approx(40.0)
    one.advance(7 + WATCHDOG_NS + 20 * MS)
    assert one.truth(0).velocity == 300.0
    one.advance(7 + WATCHDOG_NS + 60 * MS)
    assert one.truth(0).velocity < 300.0


def test_steps_that_are_cut_for_delayed_readings_end_at_the_same_time_and_place() -> None:
    plain, late = (
        World(walls=[], poses=[(0.0, 0.0, 0.0)], config=replace(IDEAL, reading_delay_ns=delay))
        for delay in (0, 30 * MS)
    )
    for world in (plain, late):
        world.command(0, 300.0, 10.0)
        for _ in range(20):
            world.advance(0.05)
    assert plain.elapsed_ns == late.elapsed_ns == 1000 * MS
    assert tuple(late.true_pose(0)) == pytest.approx(tuple(plain.true_pose(0)), abs=1.0)


RING = """
[server.PServer]
rate = "5 Hz"
fields.infrared = { rate = "10 Hz" }

[server.PServer.simulated]
device  = "proximity"
count   = 24
bearing = "-180 deg"
ring    = "300 mm"

[server.PServer.simulated.sonar]
range    = "8 m"
nearest  = "150 mm"
half_beam = "12 deg"
critical  = "30 deg"

[server.PServer.simulated.infrared]
range = "800 mm"
"""


def rated(reading_ms: int) -> tuple[Body, World]:
    """A robot whose base is measured four times a second, its ring five and ten times."""
    delays = DELAYS.format(command=0, reading=reading_ms)
    text = CHASSIS.replace("[server.RServer]", '[server.RServer]\nrate = "4 Hz"') + RING
    file = body_of_text(text.replace("[body.limits]", delays), "probe.toml")
    assert file.body is not None, file.diagnostics
    walls = [[-9000.0, 5000.0, 9000.0, 5000.0]]
    world = World(walls=walls, poses=[(0.0, 0.0, 0.0)], config=config_of(file.body))
    world.command(0, 300.0, 0.0)
    return file.body, world


@pytest.mark.parametrize(("delay_ms", "waited"), [(0, 0), (30, 1)])
def test_base_and_ring_are_measured_at_their_rates(delay_ms: int, waited: int) -> None:
    body, world = rated(delay_ms)
    clock = VirtualClock(7)
    drivers = simulated_drivers(Plant(world, clock), body=body)
    base, ring = drivers.base, drivers.proximity
    assert base is not None
    assert ring is not None
    measured: dict[int, object] = {}  # what was read of which time
    ages: dict[str, list[int]] = {"base": [], "sonar": [], "infrared": []}
    for _ in range(12):
        clock.now_ns += FRAME
        sonar, infrared, state = ring.sonar(), ring.infrared(), base.state()
        assert measured.setdefault(state.t_ns, state) is state
        assert measured.setdefault(-sonar.t_ns, sonar) == sonar
        for name, t_ns in (("base", state.t_ns), ("sonar", sonar.t_ns), ("infrared", infrared.t_ns)):
            ages[name].append((clock.now_ns - t_ns) // MS)
    assert len(set(map(str, measured.values()))) == len(measured)
    late = waited * 50
    assert ages == {
        "base": [(50 * k - late) % 250 + late for k in range(1, 13)],
        "sonar": [(50 * k - late) % 200 + late for k in range(1, 13)],
        "infrared": [(50 * k - late) % 100 + late for k in range(1, 13)],
    }


def test_the_plant_of_processes_has_the_rates() -> None:
    _, world = rated(0)
    one = Devices(world, ("robot",), {}, now_ns=7)
    ages = []
    for k in range(1, 16):
        one.advance(7 + k * 20 * MS)
        state, rings = one.base(0), one.proximity(0)
        ages.append([(one.time_ns - t) // MS for t in (state.t_ns, rings.sonar.t_ns, rings.infrared.t_ns)])
    base, sonar, infrared = map(list, zip(*ages, strict=True))
    assert base == [*range(20, 241, 20), 0, 20, 40]  # measured at the end of the first step from 250 ms on
    assert sonar == [20 * k % 200 for k in range(1, 16)]
    assert infrared == [20 * k % 100 for k in range(1, 16)]


def test_the_base_is_measured_as_often_as_its_most_frequent_field() -> None:
    def period_ns(server: str) -> int | None:
        text = CHASSIS.replace("[server.RServer]", f"[server.RServer]\n{server}")
        file = body_of_text(text, "probe.toml")
        assert file.body is not None, file.diagnostics
        return config_of(file.body).base_period_ns

    assert period_ns("") is None
    assert period_ns('rate = "5 Hz"') == 200 * MS
    assert period_ns('rate = "5 Hz"\nfields.x = { rate = "10 Hz" }') == 100 * MS
    assert period_ns('fields.x = { rate = "10 Hz" }') is None
