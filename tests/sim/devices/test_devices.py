"""Batteries, joints, buttons, cliff sensors, and devices that exist in hardware alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from colony.body.servers import servers_of
from colony.body.shipped import shipped_body
from colony.ir.types import Value
from colony.sim.config import config_of
from colony.sim.devices import devices_of
from colony.sim.devices.sensors import is_inside
from colony.sim.mechanism import nothing_given
from colony.sim.world.world import World
from colony.text.units import parse_unit
from tests.sim.devices.stage import Stage

BATTERY = """
[server.Battery.simulated]
device   = "battery"
capacity = "10 Wh"
start    = 0.5
standing = "30 W"
driving  = "100 W"
charger  = "930 W"
reach    = "250 mm"
"""
NO_CHARGER = BATTERY.replace('charger  = "930 W"', "")


def test_a_battery_falls_by_time_and_way() -> None:
    stage = Stage(NO_CHARGER)
    assert stage.read("Battery", "level") == 0.5
    assert stage.read("Battery", "charging") is False
    stage.advance(60.0)
    assert stage.read("Battery", "level") == pytest.approx(0.5 - 30 * 60 / 36_000)
    stage.world.command(0, 500.0, 0.0)
    stage.advance(60.0)
    seconds = stage.world.distance(0) / 1000.0  # at the highest speed
    assert seconds == pytest.approx(30.0, abs=0.1)
    assert stage.read("Battery", "level") == pytest.approx(0.5 - (30 * 120 + 100 * seconds) / 36_000)


def test_a_battery_is_charged_where_its_run_began_while_the_robot_stands() -> None:
    stage = Stage(BATTERY)
    stage.advance(10.0)
    assert stage.read("Battery", "level") == pytest.approx(0.75)
    assert stage.read("Battery", "charging") is True
    stage.world.command(0, 100.0, 0.0)
    stage.advance(1.0)
    assert stage.read("Battery", "charging") is False  # within reach, and on its way
    stage.drive(1.0, 0.0)
    assert stage.read("Battery", "charging") is True
    stage.drive(2.0, 200.0)
    assert stage.read("Battery", "charging") is False  # it stands, and is too far away
    stage.drive(2.0, -200.0)
    assert stage.read("Battery", "charging") is True
    stage.world.command(0, 0.0, 30.0)
    stage.advance(1.0)
    assert stage.read("Battery", "charging") is False  # it turns on the spot


def test_a_battery_is_neither_more_than_full_nor_less_than_empty() -> None:
    full = Stage(BATTERY)
    full.advance(100.0)
    assert full.read("Battery", "level") == 1.0
    empty = Stage(NO_CHARGER)
    empty.advance(700.0, 1.0)
    assert empty.read("Battery", "level") == 0.0
    empty.drive(1.0, 500.0)
    assert empty.world.distance(0) > 400.0


def test_what_a_battery_reads_does_not_depend_on_when_it_is_read() -> None:
    often, once = Stage(BATTERY), Stage(BATTERY)
    for stage in (often, once):
        for velocity in (0.0, 300.0, -300.0, 0.0, 900.0):
            stage.world.command(0, velocity, 10.0)
            for _ in range(40):
                stage.world.advance(0.05)
                if stage is often:
                    stage.read("Battery", "level")
    assert often.read("Battery", "level") == once.read("Battery", "level")


LIFT = """
[server.Lift.simulated]
device    = "joint"
range     = "0 mm .. 200 mm"
speed     = "50 mm/s"
load      = "12 kg"
positions = { down = "0 mm", carry = "60 mm", up = "200 mm" }
"""
KG12 = 12 * float(parse_unit("kg").factor)
"""12 kg, in base units."""

PAN = """
[server.Pan.simulated]
device = "rotary_joint"
range  = "-90 deg .. 45 deg"
speed  = "60 deg/s"
"""


def test_a_joint_goes_to_its_positions_at_its_speed() -> None:
    stage = Stage(LIFT)
    lift = stage.devices[0]["Lift"]

    def state() -> tuple[Value | None, ...]:
        return tuple(stage.read("Lift", field) for field in ("position", "target", "moving", "load"))

    assert state() == (0.0, 0.0, False, KG12)
    lift.command("move", {"position": 2.0}, stage.world.elapsed_ns)
    assert state() == (0.0, 2.0, True, KG12)
    stage.advance(1.0)
    assert state() == (pytest.approx(50.0), 2.0, True, KG12)
    stage.advance(4.0)
    assert state() == (200.0, 2.0, False, KG12)
    lift.command("move", {"position": 1.0}, stage.world.elapsed_ns)
    lift.command("move", {"position": 1.0}, stage.world.elapsed_ns)
    stage.advance(1.0)
    assert state() == (pytest.approx(150.0), 1.0, True, KG12)
    lift.safe(stage.world.elapsed_ns)
    stage.advance(1.0)
    assert state() == (pytest.approx(150.0), 1.0, False, KG12)
    lift.command("move", {"position": 1.0}, stage.world.elapsed_ns)
    stage.advance(5.0)
    assert state() == (60.0, 1.0, False, KG12)


@pytest.mark.parametrize("position", [3.0, -1.0, 0.5])
def test_a_position_that_a_joint_does_not_have_is_refused(position: float) -> None:
    stage = Stage(LIFT)
    with pytest.raises(ValueError, match="expected a number from 0 to 2"):
        stage.devices[0]["Lift"].command("move", {"position": position}, 0)
    with pytest.raises(ValueError, match="no command `drop`"):
        stage.devices[0]["Lift"].command("drop", {}, 0)
    assert stage.read("Lift", "moving") is False


def test_a_rotary_joint_stays_within_its_range_and_begins_nearest_to_0() -> None:
    stage = Stage(PAN)
    assert stage.read("Pan", "position") == stage.read("Pan", "target") == 0.0
    stage.devices[0]["Pan"].command("move", {"position": -120.0}, 0)
    stage.advance(1.0)
    assert stage.read("Pan", "position") == pytest.approx(-60.0)
    stage.advance(1.0)
    assert (stage.read("Pan", "position"), stage.read("Pan", "target")) == (-90.0, -120.0)
    assert Stage(PAN.replace("-90 deg ..", "10 deg ..")).read("Pan", "position") == 10.0


def test_a_joint_between_its_positions_has_no_target_yet() -> None:
    stage = Stage(LIFT.replace('down = "0 mm", ', ""))
    assert (stage.read("Lift", "position"), stage.read("Lift", "target")) == (0.0, None)
    stage.devices[0]["Lift"].command("move", {"position": 0.0}, 0)
    assert stage.read("Lift", "target") == 0.0


CLIFF = """
[server.Floor.simulated]
device = "cliff"
places = [["300 mm", "200 mm"], ["300 mm", "-200 mm"], ["-300 mm", "0 mm"]]
"""


def test_cliff_sensors_see_holes_below_their_places() -> None:
    hole = [(-1000.0, 1000.0), (1000.0, 1000.0), (1000.0, 2000.0), (-1000.0, 2000.0)]
    stage = Stage(CLIFF, holes=[hole, [(5e3, 0.0), (6e3, 0.0), (5e3, 1e3)]])
    assert stage.read("Floor", "cliff") == (False, False, False)
    stage.world.place(0, (0.0, 750.0, 0.0))
    assert stage.read("Floor", "cliff") == (True, True, False)
    stage.world.place(0, (-950.0, 750.0, 0.0))
    assert stage.read("Floor", "cliff") == (False, True, False)
    stage.world.place(0, (0.0, 750.0, 180.0))
    assert stage.read("Floor", "cliff") == (False, False, True)
    stage.world.place(0, (5200.0, 300.0, 90.0))
    assert stage.read("Floor", "cliff") == (False, False, True)
    assert Stage(CLIFF).read("Floor", "cliff") == (False, False, False)


@pytest.mark.parametrize("seed", range(20))
def test_a_point_is_inside_a_polygon_around_which_its_corners_turn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    polygon = rng.uniform(-1.0, 1.0, (int(rng.integers(3, 9)), 2))
    for x, y in rng.uniform(-1.2, 1.2, (200, 2)):
        around = polygon - (x, y)
        ahead = np.roll(around, -1, axis=0)
        cross = around[:, 0] * ahead[:, 1] - around[:, 1] * ahead[:, 0]
        turned = np.arctan2(cross, (around * ahead).sum(axis=1)).sum()
        assert is_inside(polygon, x, y) == (round(turned / math.tau) % 2 == 1)


def test_a_world_refuses_holes_that_are_none() -> None:
    with pytest.raises(ValueError, match="at least 3"):
        Stage(CLIFF, holes=[[(0.0, 0.0), (1.0, 0.0)]])
    with pytest.raises(ValueError, match="not finite"):
        Stage(CLIFF, holes=[[(0.0, 0.0), (1.0, 0.0), (math.nan, 1.0)]])


PANEL = '[server.Panel]\nsimulated = { device = "button", fields = ["estop", "start"] }\n'
ARM = """
[server.Arm]
fields.grip = {}
hardware    = { driver = "arm_drivers:Arm" }
"""


def test_buttons_are_released_unless_they_are_given() -> None:
    def given(server: str, field: str, now_ns: int) -> Value | None:
        return True if (server, field) == ("Panel", "estop") and now_ns >= 100_000_000 else None

    stage = Stage(PANEL + LIFT, given=given)
    assert (stage.read("Panel", "estop"), stage.read("Panel", "start")) == (False, False)
    stage.advance(0.1)
    assert (stage.read("Panel", "estop"), stage.read("Panel", "start")) == (True, False)


def test_what_is_given_stands_in_the_place_of_any_field() -> None:
    values: dict[str, Value] = {"load": 80.0, "level": 0.25, "cliff": (True, False, False)}
    slow = '[server.Battery]\nrate = "1 Hz"\n'
    stage = Stage(slow + BATTERY + LIFT + CLIFF, given=lambda server, field, now_ns: values.get(field))
    stage.advance(0.5)
    assert stage.read("Lift", "load") == 80.0
    assert stage.read("Lift", "position") == 0.0
    assert stage.read("Battery", "level") == 0.25
    assert stage.time_of("Battery", "level") == 500_000_000
    assert stage.time_of("Battery", "charging") == 0
    assert stage.read("Floor", "cliff") == (True, False, False)


def test_a_device_of_hardware_alone_reads_what_is_given_and_ignores_commands() -> None:
    stage = Stage(ARM)
    arm = stage.devices[0]["Arm"]
    arm.command("close", {"force": 3.0}, 0)
    arm.safe(0)
    assert dict(arm.sense(0)) == {}


def test_amr_has_a_device_for_each_server_but_its_base() -> None:
    body = shipped_body("amr")
    world = World(walls=[], poses=[(0.0, 0.0, 0.0)], config=config_of(body))
    found = devices_of(body, servers_of(body), world, 0, seed=1, given=nothing_given)
    assert set(found) == {"Lidar", "Floor", "Battery", "Panel", "Lift"}
    for device in found.values():
        assert None not in device.sense(0).values()


def test_rome_has_no_devices_besides_base_ring_and_cameras() -> None:
    body = shipped_body("rome")
    world = World(walls=[], poses=[(0.0, 0.0, 0.0)])
    assert devices_of(body, servers_of(body), world, 0, seed=1, given=nothing_given) == {}
