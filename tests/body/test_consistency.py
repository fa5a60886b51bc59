"""What contradicts itself within a body."""

from __future__ import annotations

import re

import pytest

from colony.body.consistency import MAX_POSITIONS
from colony.body.devices import DEVICES
from colony.body.servers import servers_of
from colony.body.shipped import shipped_body
from colony.cli.serve.processes import SUPERVISOR
from colony.ir.servers import MAX_SERVER_NAME, RESERVED_SERVER_NAMES
from colony.runtime.assembly.limits import LIMITS
from colony.runtime.assembly.sharing import SHARED
from colony.runtime.library.leader import LEADER
from colony.runtime.protocol.topics import CLOCK, OBSERVER
from colony.runtime.transport.live.configuration import GATEWAY
from colony.runtime.transport.live.run_directory import MAX_NAME_LENGTH
from colony.sim.plant.child import SIMULATOR
from tests.body.test_disagreements import DEVICES_BODY
from tests.body.test_reader import LIDAR, SMALL, body_of, problems
from tests.pages import files

BASE = '[server.RServer]\nsimulated = { device = "base" }\n'
RING = """
[server.PServer.simulated]
device   = "proximity"
count    = 8
bearing  = "0 deg"
ring     = "200 mm"
sonar    = { range = "5 m", half_beam = "12 deg", critical = "30 deg" }
infrared = { range = "1 m" }
"""
BODY = SMALL + LIDAR + BASE + RING + DEVICES_BODY.removeprefix(SMALL)
EYE = 'device = "camera", height = "1 m", view = "60 deg", size = [64, 64]'
CAMERA = f'[server.Eye]\nsimulated = {{ {EYE}, pose = ["9 m", "0 mm", "0 deg"] }}\n'


def test_a_body_with_every_device_has_no_contradiction() -> None:
    assert problems(BODY) == []


def test_each_field_and_parameter_is_described_by_a_noun_or_when_it_is_true() -> None:
    """Hints say `it is ...` of it."""
    sweeper = files("devices.md")["robots/sweeper/sweeper.toml"]
    bodies = (body_of(BODY), body_of(sweeper), *map(shipped_body, ("rome", "amr", "omni")))
    kinds = {type(server.simulated) for body in bodies for server in body.servers.values()}
    assert kinds >= {type_ for _, type_ in DEVICES}
    for spec in (spec for body in bodies for spec in servers_of(body)):
        parameters = (parameter for command in spec.commands for parameter in command.parameters)
        for part in (*spec.fields, *parameters):
            assert re.match("(the|a) |true (while|where|for|to) ", part.meaning), (spec.name, part)


@pytest.mark.parametrize(
    ("old", "new", "place", "message"),
    [
        (
            "[server.RServer]",
            "[server.Base]",
            '"base"',
            'the device "base" is served by `RServer` alone, and a robot has one',
        ),
        (
            "[server.PServer.simulated]",
            "[server.Ring.simulated]",
            '"proximity"',
            'the device "proximity" is served by `PServer` alone, and a robot has one',
        ),
        (
            'device = "base"',
            'device = "button", fields = ["a"]',
            '"button"',
            '`RServer` serves the device "base" alone',
        ),
        (
            '[server.RServer]\nsimulated = { device = "base" }\n',
            '[server.RServer]\nhardware = { driver = "my.base:Base" }\nfields.bumpr = {}\n',
            "fields.bumpr",
            "the device of `RServer` has no field `bumpr`",
        ),
        (
            "simulated.count = 360",
            'simulated.count = 361\nsimulated.step = "1 deg"',
            '"1 deg"',
            "361 elements that are 1 deg apart take more than a full turn",
        ),
        (
            'pose = ["5 cm",',
            'pose = ["9 m",',
            '["9 m", "0 mm", "90 deg"]',
            "a place 9000 mm from the center of the robot; expected at most 2200 mm",
        ),
        (
            '["-10 cm", "-10 cm"]]',
            '["-10 cm", "-10 m"]]',
            None,
            "a place 10000.5 mm from the center of the robot; expected at most 2200 mm",
        ),
        (
            'range     = "0 .. 400 mm"',
            'range     = "400 .. 0 mm"',
            '"400 .. 0 mm"',
            "the range begins at 400 mm, which is not below its end, 0 mm",
        ),
        (
            '"-90 .. 90 deg"',
            '"90 .. 90 deg"',
            '"90 .. 90 deg"',
            "the range begins at 90 deg, which is not below its end, 90 deg",
        ),
        (
            'up = "400 mm"',
            'up = "401 mm"',
            '"401 mm"',
            "the position `up` is at 401 mm, outside of the range, 0 to 400 mm",
        ),
        (
            'standing = "40 W"',
            'standing = "40 W", charger = "40 W"',
            '"40 W"',
            "the charger gives 40 W, and the robot takes 40 W: it is never charged",
        ),
        ('"estop", "start"', '"estop", "estop"', None, "two buttons have the field `estop`"),
        (
            'no_echo = "12 m"',
            'no_echo = "1 mm"',
            '"1 mm"',
            "an element without an echo reads 1 mm, and the device measures up to 12000 mm",
        ),
        (
            "[server.RServer]",
            '[server.RServer]\nfields.bumper.no_echo = "9 m"',
            '"9 m"',
            "`RServer.bumper` is bool; only ranges have a reading without an echo",
        ),
        (
            "[server.RServer]",
            "[server.RServer]\nfields.bumpr = {}",
            None,
            "the device of `RServer` has no field `bumpr`",
        ),
    ],
)
def test_a_contradiction_is_found_at_its_place(old: str, new: str, place: str | None, message: str) -> None:
    assert old in BODY
    [(code, text, said)] = problems(BODY.replace(old, new, 1))
    assert (code, said) == ("B009", message)
    assert place in (None, text)


@pytest.mark.parametrize("name", sorted(RESERVED_SERVER_NAMES))
def test_a_name_of_the_runtime_is_no_name_of_a_server(name: str) -> None:
    message = f"`{name}` is reserved for the runtime, and no server can have it"
    assert problems(SMALL + LIDAR.replace("Lidar", name)) == [("B009", f"server.{name}", message)]


@pytest.mark.parametrize("name", ["_Lidar", "L" * (MAX_SERVER_NAME + 1)])
def test_a_name_that_no_process_can_have(name: str) -> None:
    [(code, text, message)] = problems(SMALL + LIDAR.replace("Lidar", name))
    assert (code, text) == ("B009", f"server.{name}")
    assert "cannot be the name of a server" in message
    assert problems(SMALL + LIDAR.replace("Lidar", "L" * MAX_SERVER_NAME)) == []


def test_the_names_are_those_that_the_runtime_uses() -> None:
    named = {CLOCK, GATEWAY, LEADER, LIMITS, OBSERVER, SHARED, SIMULATOR, SUPERVISOR, "all"}
    assert named == RESERVED_SERVER_NAMES
    assert MAX_SERVER_NAME == MAX_NAME_LENGTH


def test_a_camera_far_away() -> None:
    [(_, place, _)] = problems(BODY + CAMERA)
    assert place == '["9 m", "0 mm", "0 deg"]'


def test_too_many_positions() -> None:
    names = ", ".join(f'p{i} = "{i} mm"' for i in range(MAX_POSITIONS + 1))
    many = BODY.replace('positions = { down = "0 mm", up = "400 mm" }', f"positions = {{ {names} }}")
    assert [message for _, _, message in problems(many)] == ["101 positions; expected at most 100"]


@pytest.mark.parametrize("key", ["sideways", "sideways_acceleration"])
def test_a_base_with_two_wheels_has_no_limits_of_sideways_motion(key: str) -> None:
    unit = "mm/s" if key == "sideways" else "mm/s^2"
    text = BODY.replace("[body.limits]", f'[body.limits]\n{key} = "300 {unit}"')
    assert problems(text) == [
        (
            "B009",
            key,
            f"`{key}` is a limit of a base that drives sideways, and this one has two driven wheels",
        )
    ]
    drive = 'kind = "omnidirectional", wheel_distance = "30 cm"'
    assert problems(text.replace('kind = "differential"', drive)) == []


def test_a_limit_of_sideways_motion_is_that_of_motion_ahead_unless_it_is_given() -> None:
    drive = 'kind = "omnidirectional", wheel_distance = "30 cm"'
    body = body_of(BODY.replace('kind = "differential"', drive))
    assert (body.chassis.sideways_mm_s, body.chassis.sideways_acceleration_mm_s2) == (500.0, 1000.0)
    limits = 'sideways = "300 mm/s"\nsideways_acceleration = "400 mm/s^2"'
    given = BODY.replace("[body.limits]", f"[body.limits]\n{limits}").replace('kind = "differential"', drive)
    chassis = body_of(given).chassis
    assert (chassis.sideways_mm_s, chassis.sideways_acceleration_mm_s2) == (300.0, 400.0)
    two_wheels = body_of(BODY).chassis
    assert two_wheels.sideways_mm_s == two_wheels.sideways_acceleration_mm_s2 == 0.0
