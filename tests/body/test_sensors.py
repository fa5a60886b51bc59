"""Range finders and the like: contradictions within a body, and what differs from the interface."""

from __future__ import annotations

import pytest

from tests.body.test_disagreements import findings, found
from tests.body.test_reader import SMALL, problems

INTERFACE = """language 1
robot small {
  frame    50 ms
  sensor   near[3] : mm  bearing [0 deg, 60 deg, -60 deg]  range 50 .. 1500  from Sharp.range  within 300 ms
  sensor   felt[2] : bool  bearing [-40 deg, 180 deg]  from Skirt.bumper  within 300 ms
  sensor   turning : rad/s                             from Imu.turn_rate     within 300 ms
  sensor   leaning : m/s^2                             from Imu.sideways_acceleration
  sensor   north : deg   range 0 .. 360                from Imu.heading
  sensor   needle : rad                                from Compass.heading
}
"""
BODY = (
    SMALL
    + """
[server.Sharp.simulated]
device    = "range_finder"
poses     = [["10 cm", "0 cm", "0 deg"], ["5 cm", "9 cm", "60 deg"], ["5 cm", "-9 cm", "-60 deg"]]
range     = "150 cm"
nearest   = "5 cm"
half_beam = "5 deg"

[server.Skirt.simulated]
device  = "bumper"
sectors = ["-60 deg .. -20 deg", "150 deg .. -150 deg"]

[server.Imu.simulated]
device = "imu"
turn   = { noise = "0.1 deg/s" }

[server.Compass]
simulated = { device = "compass", offset = "2 deg" }
"""
)


def test_they_agree() -> None:
    assert problems(BODY) == []
    assert found(INTERFACE, BODY) == []


@pytest.mark.parametrize(
    ("old", "new", "place", "message"),
    [
        (
            '"5 cm", "9 cm"',
            '"5 cm", "9 m"',
            None,
            "a place 9000.14 mm from the center of the robot; expected at most 2200 mm",
        ),
        (
            '= "5 cm"',
            '= "150 cm"',
            '"150 cm"',
            "the smallest reading, 1500 mm, is not below the longest range",
        ),
        (
            "-60 deg .. -20 deg",
            "-60 deg .. -60 deg",
            None,
            "the sector `-60 deg .. -60 deg` has no width",
        ),
        (
            "-60 deg .. -20 deg",
            "-420 deg .. -20 deg",
            None,
            "the sector `-420 deg .. -20 deg` has a bearing of more than a turn",
        ),
    ],
)
def test_a_contradiction_is_found_at_its_place(old: str, new: str, place: str | None, message: str) -> None:
    assert old in BODY
    [(code, text, said)] = problems(BODY.replace(old, new, 1))
    assert (code, said) == ("B009", message)
    assert place in (None, text)


POSES = '[["10 cm", "0 cm", "0 deg"], ["5 cm", "9 cm", "60 deg"], ["5 cm", "-9 cm", "-60 deg"]]'
SECTORS = '["-60 deg .. -20 deg", "150 deg .. -150 deg"]'


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("Sharp.range", "Sharp.ranges", ("R002", "near", "`near`: Sharp has no field `ranges`")),
        (
            "near[3] : mm  bearing [0 deg, 60 deg, -60 deg]",
            "near[2] : mm",
            ("B013", POSES, "`near` has 2 elements, and its device has 3"),
        ),
        ("[3] : mm", "[3] : deg", ("R003", "near", "`near`: Sharp.range is mm[3], not deg[3]")),
        (
            "60 deg, -60",
            "60 deg, -50",
            ("B014", POSES, "`near[2]` looks along -50 deg, and its device along -60 deg"),
        ),
        ("turning : rad/s", "turning : rad", ("R003", "turning", None)),
        ("leaning : m/s^2", "leaning : m/s", ("R003", "leaning", None)),
        ("needle : rad", "needle : m", ("R003", "needle", "`needle`: Compass.heading is deg, not mm")),
        ("felt[2] : bool  bearing [-40 deg, 180 deg]", "felt : bool", ("B013", SECTORS, None)),
        (
            "180 deg]",
            "140 deg]",
            ("B014", SECTORS, "`felt[1]` is at 140 deg, outside of its sector, 150 deg .. -150 deg"),
        ),
        ("50 .. 1500", "50 .. 1000", ("B015", '"150 cm"', None)),
        ("50 .. 1500", "60 .. 1500", ("B015", '"5 cm"', None)),
    ],
)
def test_what_does_not_fit_a_device_is_found(
    old: str, new: str, expected: tuple[str, str | None, str | None]
) -> None:
    assert old in INTERFACE
    code, place, message = found(INTERFACE.replace(old, new), BODY)[0]
    assert code == expected[0]
    assert expected[1] in (None, place)
    assert expected[2] in (None, message)


def test_bearings_of_range_finders_may_have_a_step() -> None:
    steps = INTERFACE.replace("[0 deg, 60 deg, -60 deg]", "-60 deg step 60 deg")
    order = '[["5 cm", "-9 cm", "-60 deg"], ["10 cm", "0 cm", "0 deg"], ["5 cm", "9 cm", "60 deg"]]'
    assert found(steps, BODY.replace(POSES, order)) == []


CORNERS = '[["13 cm", "6 cm"], ["13 cm", "-6 cm"], ["0 cm", "0 cm"]]'


@pytest.mark.parametrize(
    ("bearings", "looks", "order"),
    [
        ("[25 deg, -25 deg, 0 deg]", None, ""),
        ("[45 deg, -10 deg, 90 deg]", None, ""),
        ("-25 deg step 50 deg", ("down[0]", "-25", "24.8"), "25, -25, 75"),
        ("[25 deg, 0 deg, -25 deg]", None, ""),
        ("[-2 deg, 2 deg, 90 deg]", ("down[0]", "-2", "24.8"), "2, -2, 90"),
        ("[25 deg, -150 deg, 0 deg]", ("down[1]", "-150", "-24.8"), "25, -25, 0"),
    ],
)
def test_cliff_sensors_look_where_their_places_are(
    bearings: str, looks: tuple[str, str, str] | None, order: str
) -> None:
    floor = f'\n[server.Floor]\nsimulated = {{ device = "cliff", places = {CORNERS} }}\n'
    sensor = f"  sensor   down[3] : bool  bearing {bearings}  from Floor.cliff\n}}\n"
    interface = INTERFACE.rstrip("}\n") + "\n" + sensor
    said = [(d.code, d.message, d.hint) for d in findings(interface, BODY + floor)]
    degrees = ", ".join(f"{x} deg" for x in order.split(", "))
    hint = f"in the order of the places the bearings are `[{degrees}]`"
    message = "`{}` looks along {} deg, and its place lies along {} deg"
    assert said == ([("B014", message.format(*looks), hint)] if looks else [])


FAULTS = '[server.Imu]\nfaults = { missing = "1 percent", frozen = 0.005, lasting = "2 s" }\n'
EYE = '[server.Eye]\nsimulated = { device = "camera", height = "1 m", view = "60 deg", size = [64, 64] }\n'


def test_any_device_but_a_camera_may_have_faults() -> None:
    faulty = BODY.replace("[server.Imu.simulated]", f"{FAULTS}\n[server.Imu.simulated]")
    assert problems(faulty) == []
    base = '[server.RServer]\nsimulated = { device = "base" }\nfaults = { frozen = "2 percent" }\n'
    assert problems(BODY + base) == []
    assert problems(faulty.replace("0.005", '"99 percent"')) == [
        ("B009", "faults", "its readings are missing or frozen all the time")
    ]
    assert problems(BODY + EYE + "faults = { missing = 0.1 }\n") == [
        ("B009", "faults", "`Eye` is a camera: its images are asked for, and have no faults")
    ]
    real = '[server.Arm]\nhardware = { driver = "arm:Arm" }\nfaults = { missing = 0.1 }\n'
    assert problems(BODY + real) == [("B009", "faults", "`Arm` has faults, but no simulated device")]
    assert [code for code, _, _ in problems(faulty.replace('"2 s"', '"0 s"'))] == ["B008"]
