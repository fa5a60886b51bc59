"""Interfaces of single devices, held to their bodies: what agrees, and what does not fit."""

from __future__ import annotations

import pytest

from colony.view.polar import PicturePoint, Sector
from tests.body.test_disagreements import found
from tests.body.test_reader import SMALL, problems
from tests.view.test_robot_scene import scene, sensor

OUTPUTS_INTERFACE = """language 1
robot small {
  frame    50 ms
  sensor   horn_on : bool                        from Signals.horn
  sensor   glow : percent range 0 .. 100         from Signals.lamp
  actuator signals { horn : bool, lamp : number range 0 .. 1 }
           to Signals.set  idle signals(horn = false, lamp = 0)
}
"""
OUTPUTS_BODY = (
    SMALL
    + """
[server.Signals]
simulated = { device = "output", outputs = { horn = "on", lamp = "level" } }
"""
)

ENCODERS_INTERFACE = """language 1
robot small {
  frame  50 ms
  sensor rolled[2] : m   from Wheels.travel within 60 ms
}
"""
ENCODERS_BODY = (
    SMALL
    + """
[server.Wheels]
rate = "50 Hz"

[server.Wheels.simulated]
device     = "encoders"
resolution = "0.5 mm"
"""
)

DOCK_INTERFACE = """language 1
robot small {
  frame    50 ms
  sensor seen : bool                      from Eye.dock_seen
  sensor away : m range 0 .. 3.5          from Eye.dock_distance within 200 ms
  sensor off  : deg range -180 .. 180     from Eye.dock_bearing
}
"""
DOCK_BODY = (
    SMALL
    + """
[server.Eye]
rate = "10 Hz"

[server.Eye.simulated]
device = "dock_sensor"
pose   = ["300 mm", "-400 mm", "20 deg"]
range  = "3 m"
view   = "60 deg"
"""
)

JOINTS_INTERFACE = """language 1
robot small {
  frame    50 ms
  sensor   height : mm range 0 .. 400                  from Winch.position
  sensor   hoist : mm/s range -50 .. 50                from Winch.velocity
  sensor   spin : deg/s range -60 .. 60                from Brush.velocity
  actuator winch { velocity : m/s range -0.05 .. 0.05 }  to Winch.run  idle winch(velocity = 0)
  actuator brush { velocity : deg/s range -60 .. 60 }    to Brush.run  idle brush(velocity = 0)
}
"""
JOINTS_BODY = (
    SMALL
    + """
[server.Winch.simulated]
device  = "joint"
control = "velocity"
range   = "0 .. 400 mm"
speed   = "50 mm/s"

[server.Brush]
simulated = { device = "rotary_joint", control = "velocity", range = "0 .. 1e6 deg", speed = "60 deg/s" }
"""
)

OUTPUTS = (OUTPUTS_INTERFACE, OUTPUTS_BODY)
ENCODERS = (ENCODERS_INTERFACE, ENCODERS_BODY)
DOCK = (DOCK_INTERFACE, DOCK_BODY)
JOINTS = (JOINTS_INTERFACE, JOINTS_BODY)

Device = tuple[str, str]


@pytest.mark.parametrize("device", [OUTPUTS, ENCODERS, DOCK, JOINTS])
def test_an_interface_of_the_device_agrees(device: Device) -> None:
    assert found(*device) == []


@pytest.mark.parametrize(
    ("device", "old", "new", "code", "message"),
    [
        (
            OUTPUTS,
            "horn_on : bool",
            "horn_on : number",
            "R003",
            "`horn_on`: Signals.horn is bool, not number",
        ),
        (OUTPUTS, "Signals.lamp", "Signals.lmp", "R002", "`glow`: Signals has no field `lmp`"),
        (OUTPUTS, "number range 0 .. 1 ", "number range 0 .. 2 ", "R008", None),
        (OUTPUTS, "Signals.set", "Signals.put", "R004", "`signals`: Signals has no command `put`"),
        (OUTPUTS, "0 .. 100 ", "0 .. 50 ", "B015", None),
        (DOCK, "0 .. 3.5", "0 .. 3.4", "B015", "`away` has a range up to 3.4 m, and its device reads 3.5 m"),
        (DOCK, "off  : deg", "off  : mm", "R003", "`off`: Eye.dock_bearing is deg, not mm"),
        (DOCK, "Eye.dock_seen", "Eye.dock_see", "R002", "`seen`: Eye has no field `dock_see`"),
        (
            DOCK,
            "within 200 ms",
            "within 60 ms",
            "B017",
            "`away` is measured every 100 ms, and read `within 60 ms`",
        ),
        (
            JOINTS,
            "-50 .. 50 ",
            "-40 .. 50 ",
            "B015",
            "`hoist` has a range from -40 mm/s, and its device reads -50 mm/s",
        ),
        (JOINTS, "Winch.velocity", "Winch.target", "R002", "`hoist`: Winch has no field `target`"),
        (JOINTS, "Winch.run", "Winch.move", "R004", "`winch`: Winch has no command `move`"),
        (JOINTS, "-0.05 .. 0.05", "-0.05 .. 0.06", "R008", None),
        (JOINTS, "spin : deg/s", "spin : mm/s", "R003", "`spin`: Brush.velocity is deg/s, not mm/s"),
    ],
)
def test_what_does_not_fit_the_device_is_found(
    device: Device, old: str, new: str, code: str, message: str | None
) -> None:
    interface, body = device
    assert old in interface
    [(found_code, _, found_message)] = found(interface.replace(old, new), body)
    assert found_code == code
    assert message in (None, found_message)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("[2]", "[4]", ("B013", '"encoders"', "`rolled` has 4 elements, and its device has 2")),
        ("[2]", "", ("B013", '"encoders"', "`rolled` is no array, and its device has 2")),
        ("travel", "ticks", ("R002", "rolled", "`rolled`: Wheels has no field `ticks`")),
        (": m ", ": deg ", ("R003", "rolled", "`rolled`: Wheels.travel is mm[2], not deg[2]")),
    ],
)
def test_what_does_not_fit_encoders_is_found_at_its_place(
    old: str, new: str, problem: tuple[str, str, str]
) -> None:
    assert found(ENCODERS_INTERFACE.replace(old, new), ENCODERS_BODY) == [problem]


@pytest.mark.parametrize(
    ("outputs", "code", "message"),
    [
        ("{}", "B009", "0 outputs; expected 1 to 100"),
        ('{ horn = "loud" }', "B006", None),
        ('{ "my horn" = "on" }', "B006", None),
        (
            "{ " + ", ".join(f'a{i} = "on"' for i in range(101)) + " }",
            "B009",
            "101 outputs; expected 1 to 100",
        ),
    ],
)
def test_outputs_that_make_no_sense_are_reported(outputs: str, code: str, message: str | None) -> None:
    [(found_code, _, found_message)] = problems(
        OUTPUTS_BODY.replace('{ horn = "on", lamp = "level" }', outputs)
    )
    assert message in (None, found_message)
    assert found_code == code


def test_a_dock_sensor_is_on_the_robot() -> None:
    [(code, place, message)] = [p[:3] for p in problems(DOCK_BODY.replace('"300 mm"', '"9 m"'))]
    assert (code, place) == ("B009", '["9 m", "-400 mm", "20 deg"]')
    assert message.startswith("a place 9008.88 mm from the center of the robot")


def test_a_dock_sensor_is_drawn() -> None:
    eye = sensor(scene(*DOCK), "Eye")
    assert eye.note == "docks, 60°, 3 m"
    [beam] = eye.beams
    assert (beam.origin, beam.sector, beam.reach_mm) == (
        PicturePoint(400.0, 300.0),
        Sector(-10.0, 50.0),
        3000.0,
    )


def test_a_running_joint_has_no_positions() -> None:
    named = JOINTS_BODY.replace('speed   = "50 mm/s"', 'speed = "50 mm/s"\npositions = { up = "400 mm" }')
    [(code, place, message)] = problems(named)
    assert (code, place) == ("B009", "positions")
    assert message == "a joint that runs at a velocity is not sent to positions"
