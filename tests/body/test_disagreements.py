"""An interface and a body, held to each other."""

from __future__ import annotations

import re

import pytest

from colony.body.disagreements import disagreements
from colony.body.reader import body_of_text
from colony.dsl.load import load_text
from colony.text.diagnostics import Diagnostic
from tests.body.test_reader import LIDAR, SMALL

INTERFACE = """language 1
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


def findings(interface: str, body: str) -> list[Diagnostic]:
    file = body_of_text(body, "small.toml")
    assert file.body is not None, file.diagnostics
    return list(disagreements(load_text(interface).robot, file.body, file))


def found(interface: str, body: str) -> list[tuple[str, str, str]]:
    """The code, the text of the place, and the message of each finding."""
    return [(d.code, d.span.text, d.message) for d in findings(interface, body)]


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
        ("Lidar.scan", "Lidr.scan", ("R001", "scan", "`scan`: there is no server `Lidr`")),
        ("Lidar.scan", "Lidar.scn", ("R002", "scan", "`scan`: Lidar has no field `scn`")),
        (
            "to RServer.drive",
            "to RServer.drv",
            ("R004", "drive", "`drive`: RServer has no command `drv`"),
        ),
        (
            "to RServer.drive",
            "to Lidar.drive",
            ("R004", "drive", "`drive`: Lidar has no command `drive`"),
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
            ("B015", '"12 m"', "`scan` has a range up to 11 m, and its device reads 12 m"),
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


@pytest.mark.parametrize("turn", ["1 rad/s", "1.5 rad/s", "0.7 rad/s", "100 deg/s", "1.2345678901 rad/s"])
def test_the_range_that_a_hint_gives_is_within_the_limit(turn: str) -> None:
    body = BODY.replace('turn              = "1 rad/s"', f'turn = "{turn}"')
    [wide] = findings(INTERFACE.replace("range -45 .. 45", "range -180 .. 180"), body)
    [given] = re.findall("`(range .*?)`", wide.hint or "")
    assert found(INTERFACE.replace("range -45 .. 45", given), body) == []


def test_a_period_is_compared_in_nanoseconds() -> None:
    [(code, place, _)] = found(INTERFACE, BODY.replace("[robot]", '[robot]\nframe = "51 ms"'))
    assert (code, place) == ("B011", '"51 ms"')


def test_every_declaration_of_an_unknown_server_is_reported() -> None:
    without = INTERFACE.replace("from Lidar", "from Lader")
    assert [code for code, _, _ in found(without, BODY)] == ["R001", "R001", "B018"]


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


DRIVER = 'hardware = { driver = "my.base:Base", watchdog = "2 s" }'
DRIVEN = BODY.replace('simulated = { device = "base" }', DRIVER)
WHEELS = INTERFACE.replace("RServer", "Wheels")
DRIVEN_WHEELS = DRIVEN.replace("RServer", "Wheels")


@pytest.mark.parametrize(("watchdog", "count"), [("none", 1), ("2 s", 0), ("500 ms", 0)])
def test_a_device_that_nothing_stops_is_a_warning(watchdog: str, count: int) -> None:
    body = DRIVEN.replace("2 s", watchdog)
    text = "nothing stops `RServer` when its computer fails or its cable is pulled"
    assert found(INTERFACE, body) == [("B019", f'"{watchdog}"', text)] * count


def test_a_device_that_is_stopped_needs_a_watchdog() -> None:
    body = DRIVEN.replace(', watchdog = "2 s"', "")
    text = "`RServer` has no `watchdog`: nothing may stop it when its computer fails"
    assert found(INTERFACE, body) == [("B019", '"my.base:Base"', text)]
    before, _, after = INTERFACE.partition("  actuator drive")
    assert found(before + after[after.index("  actuator") :], body) == []


def test_a_server_with_a_driver_alone_takes_any_command() -> None:
    assert [code for code, _, _ in found(WHEELS, DRIVEN_WHEELS)] == ["R002"]  # its fields are in no table
    assert found(WHEELS, DRIVEN_WHEELS + "fields.bumper = {}\n") == []


def test_rserver_with_a_driver_alone_is_a_base() -> None:
    assert found(INTERFACE, DRIVEN) == []
    unknown = INTERFACE.replace("RServer.bumper", "RServer.bumpr")
    assert found(unknown, DRIVEN) == [("R002", "bumper", "`bumper`: RServer has no field `bumpr`")]
    fast = INTERFACE.replace("range -0.5 .. 0.5", "range -0.5 .. 0.6")
    assert [code for code, _, _ in found(fast, DRIVEN)] == ["B016"]
    command = INTERFACE.replace("to RServer.drive", "to RServer.drv")
    assert [code for code, _, _ in found(command, DRIVEN)] == ["R004"]


# --- a base that drives sideways

OMNI_BODY = BODY.replace(
    '"differential", wheel_base = "30 cm"',
    '"omnidirectional", wheel_base = "30 cm", wheel_distance = "25 cm"',
)
OMNI = INTERFACE.replace("-45 .. 45", "-45 .. 45, sideways : mm/s range -500 .. 500").replace(
    "turn = 0", "turn = 0, sideways = 0"
)


def test_a_base_that_drives_sideways_has_that_speed() -> None:
    measured = OMNI.replace("bumper : bool", "strafing : mm/s").replace(".bumper", ".sideways_speed")
    assert found(OMNI, OMNI_BODY) == found(measured, OMNI_BODY) == []
    assert found(INTERFACE, OMNI_BODY) == []  # nobody has to
    slower = OMNI_BODY.replace("[body.limits]", '[body.limits]\nsideways = "0.4 m/s"')
    [beyond] = findings(OMNI, slower)
    assert beyond.message == "`drive.sideways` reaches -500 mm/s, and the base at most 400 mm/s"
    assert beyond.labels[0].span.text == '"0.4 m/s"'


def test_a_base_with_two_wheels_does_not_drive_sideways() -> None:
    measured = INTERFACE.replace("bumper : bool", "strafing : mm/s").replace(".bumper", ".sideways_speed")
    [command], [field] = findings(OMNI, BODY), findings(measured, BODY)
    assert (command.code, command.message) == (
        "R005",
        "`drive.sideways`: RServer.drive takes no `sideways`",
    )
    assert (field.code, field.message) == ("R002", "`strafing`: RServer has no field `sideways_speed`")
    expected = 'only a base whose body says `kind = "omnidirectional"` in `[body.drive]` drives sideways'
    assert command.hint == field.hint == expected


# --- every device

DEVICES = """language 1
enum level { down = 0, up = 1 }
robot small {
  frame    50 ms
  sensor   cliff[4] : bool                                     from Under.cliff        within 300 ms
  sensor   battery : percent    range 0 .. 100                 from Battery.level      within 2 s
  sensor   charging : bool                                     from Battery.charging
  sensor   estop : bool                                        from Panel.estop
  sensor   height : m           range 0 .. 0.4                 from Lift.position
  sensor   lifting : bool                                      from Lift.moving
  sensor   load : kg                                           from Lift.load
  sensor   pan_at : deg         range -90 .. 90                from Pan.position
  actuator lift { position : level }  to Lift.move  idle hold
  actuator pan { position : rad range -1 .. 1 }                 to Pan.move   idle hold
}
"""
DEVICES_BODY = (
    SMALL
    + """
[server.Under.simulated]
device = "cliff"
places = [["10 cm", "10 cm"], ["10 cm", "-10 cm"], ["-10 cm", "10 cm"], ["-10 cm", "-10 cm"]]

[server.Battery]
simulated = { device = "battery", capacity = "500 Wh", standing = "40 W", driving = "200 W" }

[server.Panel]
simulated = { device = "button", fields = ["estop", "start"] }

[server.Lift.simulated]
device    = "joint"
range     = "0 .. 400 mm"
speed     = "50 mm/s"
positions = { down = "0 mm", up = "400 mm" }

[server.Pan]
simulated = { device = "rotary_joint", range = "-90 .. 90 deg", speed = "60 deg/s" }
"""
)


def test_every_device_agrees() -> None:
    assert found(DEVICES, DEVICES_BODY) == []


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("cliff[4]", "cliff[3]", ("B013", None, "`cliff` has 3 elements, and its device has 4")),
        ("cliff[4] : bool", "cliff[4] : mm", ("R003", "cliff", "`cliff`: Under.cliff is bool[4], not mm[4]")),
        (
            "battery : percent",
            "battery : V",
            ("R003", "battery", None),
        ),
        ("Panel.estop", "Panel.strt", ("R002", "estop", "`estop`: Panel has no field `strt`")),
        ("load : kg", "load : N", ("R003", "load", "`load`: Lift.load is kg, not N")),
        (
            "range 0 .. 0.4",
            "range 0 .. 0.3",
            ("B015", '"0 .. 400 mm"', "`height` has a range up to 0.3 m, and its device reads 0.4 m"),
        ),
        (
            "range -90 .. 90 ",
            "range -45 .. 90 ",
            ("B015", '"-90 .. 90 deg"', "`pan_at` has a range from -45 deg, and its device reads -90 deg"),
        ),
        (
            "up = 1",
            "up = 2",
            (
                "R003",
                "position",
                "`lift.position` is level, but the command takes position",
            ),
        ),
        (
            "rad range -1 .. 1",
            "rad range -1 .. 2",
            ("R008", "position", None),
        ),
        (
            "rad range -1 .. 1",
            "mm range -1 .. 1",
            ("R003", "position", "`pan.position` is mm, but the command takes deg"),
        ),
        (
            "rad range -1 .. 1",
            "number range -1 .. 1",
            ("R003", "position", "`pan.position` is number, but the command takes deg"),
        ),
        ("{ position : rad", "{ angle : rad", ("R005", "angle", "`pan.angle`: Pan.move takes no `angle`")),
    ],
)
def test_what_does_not_fit_a_device_is_found(
    old: str, new: str, expected: tuple[str, str | None, str | None]
) -> None:
    assert old in DEVICES
    [(code, place, message)] = found(DEVICES.replace(old, new), DEVICES_BODY)
    assert code == expected[0]
    assert expected[1] in (None, place)
    assert expected[2] in (None, message)


def test_enums_of_one_name_differ_by_their_members() -> None:
    other = DEVICES.replace("level { down = 0, up = 1 }", "position { down = 0 }").replace(
        ": level", ": position"
    )
    assert [message for _, _, message in found(other, DEVICES_BODY)] == [
        "`lift.position` is an enum of down = 0, but the command takes one of down = 0, up = 1"
    ]


def test_types_and_names_of_common_servers_are_held_to_them() -> None:
    wrong = INTERFACE.replace("Runtime.random", "Runtime.rand")
    assert found(wrong, BODY) == [("R002", "random", "`random`: Runtime has no field `rand`")]
    angle = INTERFACE.replace("scan[360] : m ", "scan[360] : deg ")
    assert found(angle, BODY) == [("R003", "scan", "`scan`: Lidar.scan is mm[360], not deg[360]")]


def test_two_actuators_on_one_command() -> None:
    twice = INTERFACE.replace(
        "  actuator report",
        "  actuator wheels { turn : deg/s range -9 .. 9 }  to RServer.drive  idle wheels(turn = 0)\n"
        "  actuator report",
    )
    assert [code for code, _, _ in found(twice, BODY)] == ["R006"]


def test_an_error_of_a_declaration_shows_its_server_in_the_body() -> None:
    [misfit, unread] = findings(INTERFACE.replace("Lidar.scan", "Lidar.scn"), BODY)
    assert unread.code == "B018"
    assert misfit.hint == "did you mean `scan`?"
    assert [(label.span.text, label.text) for label in misfit.labels] == [
        ("server.Lidar", "the body describes `Lidar` here")
    ]


def test_a_field_of_a_driver_is_listed_in_the_body() -> None:
    [misfit] = findings(WHEELS, DRIVEN_WHEELS)
    assert misfit.hint == "list it in the body: `fields.bumper = {}`"
    [misfit] = findings(WHEELS, DRIVEN_WHEELS + "fields.bumpr = {}\n")[:1]
    assert misfit.hint == "did you mean `bumpr`?"


def with_delay(reading: str, body: str = BODY) -> str:
    return body.replace("[body.limits]", f'[body.delays]\nreading = "{reading}"\n\n[body.limits]')


@pytest.mark.parametrize("server", ["RServer", "Panel"])
def test_a_reading_that_always_arrives_too_late(server: str) -> None:
    panel = '[server.Panel]\nsimulated = { device = "button", fields = ["bumper"] }\n'
    late = with_delay("100 ms", BODY if server == "RServer" else BODY + panel)
    interface = INTERFACE.replace("from RServer.bumper", f"from {server}.bumper")
    assert found(INTERFACE, with_delay("100 ms")) == []
    read = interface.replace(f"from {server}.bumper", f"from {server}.bumper within 99 ms")
    assert [f for f in found(read, late) if f[0] == "B017"] == [
        ("B017", '"100 ms"', "`bumper` arrives 100 ms after it is measured, and read `within 99 ms`")
    ]


def test_a_delay_adds_to_the_time_between_two_measurements() -> None:
    """`scan` is measured every 100 ms and read within 200 ms, `celsius` every second and within 2 s."""
    assert found(INTERFACE, with_delay("100 ms")) == []
    assert found(INTERFACE, with_delay("101 ms")) == [
        (
            "B017",
            '"10 Hz"',
            "`scan` is measured every 100 ms and arrives 101 ms after, and read `within 200 ms`",
        )
    ]
