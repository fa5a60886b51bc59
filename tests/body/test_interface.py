"""An interface and a body, held to each other."""

from __future__ import annotations

import pytest

from colony.body.interface import disagreements
from colony.body.reader import body_of_text
from colony.dsl.load import load_text
from tests.body.test_reader import LIDAR, SMALL

INTERFACE = """language 2
robot small {
  frame    50 ms
  sensor   scan[360] : m   bearing 0 deg   range 0 .. 12   from Lidar.scan          within 200 ms
  sensor   celsius : degC                                  from Lidar.temperature   within 2 s
  sensor   bumper : bool                                   from RServer.bumper
  sensor   docked_at : number  default 0                   from DServer.DockedAt
  sensor   random : number     range 0 .. 1                from Runtime.random
  actuator drive { velocity : m/s range -0.5 .. 0.5, turn : deg/s range -45 .. 45 }
           to RServer.drive    idle drive(velocity = 0, turn = 0)
  actuator report { goal : number }  to DServer.Goal  idle hold
}
"""
BASE = '[server.RServer]\nsimulated = { device = "base" }\n'
BODY = SMALL + LIDAR + BASE


def found(interface: str, body: str) -> list[tuple[str, str, str]]:
    """The code, the text of the place, and the message of each finding."""
    file = body_of_text(body, "small.toml")
    assert file.body is not None, file.diagnostics
    robot = load_text(interface).robot
    return [(d.code, d.span.text, d.message) for d in disagreements(robot, file.body, file)]


def test_they_agree() -> None:
    assert found(INTERFACE, BODY) == []
    assert found(INTERFACE, BODY.replace("[robot]", '[robot]\nframe = "0.05 s"')) == []


def test_what_is_sent_before_is_no_field_of_the_body() -> None:
    assert found(INTERFACE + "let was = last.drive.velocity\n", BODY) == []


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "robot small",
            "robot tiny",
            ("B010", '"small"', "the body is that of `small`, the interface that of `tiny`"),
        ),
        ("Lidar.scan", "Lidr.scan", ("B012", "scan", "`scan`: the body has no server `Lidr`")),
        ("Lidar.scan", "Lidar.scn", ("B012", "scan", "`scan`: `Lidar` has no field `scn` in the body")),
        (
            "to RServer.drive",
            "to RServer.drv",
            ("B012", "drive", "`drive`: the device of `RServer` takes no command `drv`"),
        ),
        (
            "to RServer.drive",
            "to Lidar.drive",
            ("B012", "drive", "`drive`: the device of `Lidar` takes no command `drive`"),
        ),
        ("scan[360]", "scan[180]", ("B013", "360", "`scan` has 180 elements, and its device has 360")),
        (
            "bearing 0 deg",
            "bearing 1 deg",
            ("B014", '"0 deg"', "`scan[0]` looks along 1 deg, and its device along 0 deg"),
        ),
        (
            "bearing 0 deg",
            "bearing 0 deg step 0.5 deg",
            ("B014", "simulated.device", "`scan[1]` looks along 0.5 deg, and its device along 1 deg"),
        ),
        (
            "bearing 0 deg",
            "",
            (
                "B014",
                '["150 deg .. 165 deg", "0.5 .. 1 rad"]',
                "`scan` has no bearings, which the body blocks (interval 1)",
            ),
        ),
        (
            "range 0 .. 12",
            "range 0 .. 11",
            ("B015", '"12 m"', "`scan` has a range up to 11000 mm, and its device reads 12000 mm"),
        ),
        (
            "range -0.5 .. 0.5",
            "range -0.5 .. 0.6",
            ("B016", "velocity", "`drive.velocity` reaches 0.6 m/s, and the base at most 0.5 m/s"),
        ),
        (
            "range -45 .. 45",
            "",
            ("B016", "turn", "`drive.turn` has no range, and the base reaches at most 57.29577951 deg/s"),
        ),
        (
            "within 200 ms",
            "within 90 ms",
            ("B017", '"10 Hz"', "`scan` is measured every 100 ms, and read `within 90 ms`"),
        ),
        (
            "within 2 s",
            "within 900 ms",
            ("B017", '"1 Hz"', "`celsius` is measured every 1 s, and read `within 900 ms`"),
        ),
    ],
)
def test_what_differs_is_found(old: str, new: str, expected: tuple[str, str, str]) -> None:
    assert old in INTERFACE
    assert found(INTERFACE.replace(old, new), BODY)[0] == expected


def test_a_period_is_compared_in_nanoseconds() -> None:
    [(code, place, _)] = found(INTERFACE, BODY.replace("[robot]", '[robot]\nframe = "51 ms"'))
    assert (code, place) == ("B011", '"51 ms"')


def test_a_server_is_reported_once() -> None:
    without = INTERFACE.replace("from Lidar", "from Lader")
    assert [code for code, _, _ in found(without, BODY)] == ["B012", "B018"]


def test_what_nothing_reads_is_a_warning() -> None:
    more = BODY + '[server.Arm]\nhardware = { driver = "arm:Arm" }\n'
    eye = 'device = "camera", height = "1 m", view = "60 deg", size = [64, 64]'
    camera = f"[server.Eye]\nsimulated = {{ {eye} }}\n"
    assert found(INTERFACE, more + camera) == [
        ("B018", "server.Arm", "nothing in the interface reads or commands `Arm`")
    ]
    fewer = INTERFACE.replace("Lidar.temperature", "RServer.speed").replace("degC", "mm/s")
    assert found(fewer, BODY) == [
        ("B018", "fields.temperature", "nothing in the interface reads `Lidar.temperature`")
    ]


def test_a_server_with_a_driver_alone_takes_any_command() -> None:
    driven = BODY.replace('simulated = { device = "base" }', 'hardware = { driver = "my.base:Base" }')
    assert [code for code, _, _ in found(INTERFACE, driven)] == ["B012"]  # its fields are in no table
    assert found(INTERFACE, driven + "fields.bumper = {}\n") == []
