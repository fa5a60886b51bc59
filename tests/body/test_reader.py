"""Bodies as they are read: values in base units, and every error at its place."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from colony.body.devices import LidarSpec, MountPose
from colony.body.model import Body, Circle, Corner, Polygon
from colony.body.reader import MAX_BYTES, body_of_text, read_body
from tests.paths import ROBOTS

SMALL = """[robot]
name = "small"

[body]
footprint = { shape = "circle", radius = "0.2 m" }
drive = { kind = "differential", wheel_base = "30 cm" }

[body.limits]
velocity          = "0.5 m/s"
turn              = "1 rad/s"
acceleration      = "1 m/s^2"
turn_acceleration = "180 deg/s^2"
"""

LIDAR = """
[server.Lidar]
rate = "10 Hz"
fields.scan = { no_echo = "12 m", invalid = "hold", blocked = ["150 deg .. 165 deg", "0.5 .. 1 rad"] }
fields.temperature = { rate = "1 Hz" }
simulated.device = "lidar"
simulated.pose = ["5 cm", "0 mm", "90 deg"]
simulated.count = 360
simulated.bearing = "0 deg"
simulated.range = "12 m"
hardware = { driver = "colony.drivers.ldlidar:LD06", port = "/dev/ttyUSB1", baud = 230400, inverted = true }
"""


def body_of(text: str) -> Body:
    found = body_of_text(text, "small.toml")
    assert found.diagnostics == ()
    assert found.body is not None
    return found.body


def problems(text: str) -> list[tuple[str, str, str]]:
    """The code, the text of the place, and the message of each error."""
    found = body_of_text(text, "small.toml")
    assert (found.body is None) == bool(found.diagnostics)
    return [(d.code, d.span.text, d.message) for d in found.diagnostics]


def test_values_are_in_base_units() -> None:
    body = body_of(SMALL + LIDAR)
    assert body.robot.name == "small"
    assert body.robot.frame_s is None
    assert body.chassis.footprint == Circle(radius_mm=200.0)
    assert body.chassis.drive.wheel_base_mm == 300.0
    assert body.chassis.limits.turn_deg_s == pytest.approx(57.29577951308232, rel=1e-15)
    lidar = body.servers["Lidar"]
    assert lidar.rate_of("scan") == 10.0
    assert lidar.rate_of("temperature") == 1.0
    assert tuple(lidar.fields) == ("scan", "temperature")
    assert lidar.fields["scan"].blocked[0] == (150.0, 165.0)
    assert lidar.fields["scan"].blocked[1][1] == pytest.approx(57.3, abs=0.01)
    assert (lidar.fields["scan"].no_echo_mm, lidar.fields["scan"].invalid) == (12_000.0, "hold")
    assert isinstance(lidar.simulated, LidarSpec)
    assert lidar.simulated.pose == MountPose(50.0, 0.0, 90.0)
    assert lidar.hardware.driver == "colony.drivers.ldlidar:LD06"
    assert lidar.hardware.options == {"port": "/dev/ttyUSB1", "baud": 230400, "inverted": True}


def test_a_footprint_may_be_a_polygon() -> None:
    corners = '[["-200 mm", "-150 mm"], ["200 mm", "-150 mm"], ["200 mm", "150 mm"], ["-200 mm", "150 mm"]]'
    text = SMALL.replace('shape = "circle", radius = "0.2 m"', f'shape = "polygon", corners = {corners}')
    footprint = body_of(text).chassis.footprint
    assert isinstance(footprint, Polygon)
    assert footprint.corners[1] == Corner(200.0, -150.0)
    bent = text.replace('["200 mm", "150 mm"]', '["-100 mm", "0 mm"]')
    assert [message for _, _, message in problems(bent)] == ["the footprint is not convex"]
    turned = text.replace('["200 mm", "-150 mm"]', '["-200 mm", "160 mm"]')
    assert problems(turned)[0][0] == "B009"
    twice = text.replace(corners, f"{corners[:-1]}, {corners[1:]}")
    assert [message for _, _, message in problems(twice)] == [
        "the corners go around the footprint more than once"
    ]


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_bodies_that_come_with_colony(path: Path) -> None:
    found = read_body(path.with_suffix(".toml"))
    assert found.diagnostics == ()
    assert found.body.robot.name == path.stem


def test_all_errors_are_found_at_once() -> None:
    text = SMALL.replace('"30 cm"', "30").replace('"0.5 m/s"', '"0.5 m"').replace("[robot]", "[robt]")
    assert problems(text + "[server.A]\nsimulated = 3\n") == [
        ("B003", "robt", "a body has no key `robt`"),
        ("B007", "30", "`body.drive.wheel_base`: found 30 without a unit"),
        ("B007", '"0.5 m"', "`body.limits.velocity`: found a value in `m`; expected one in mm/s"),
        ("B006", "3", "`server.A.simulated` is 3; expected a table"),
    ]


@pytest.mark.parametrize(
    ("old", "new", "code", "place", "message"),
    [
        ('name = "small"', "", "B004", "robot", "`robot` has no `name`"),
        ('name = "small"', 'name = "a b"', "B006", '"a b"', '`robot.name` is "a b"; expected a name'),
        ('shape = "circle", ', "", "B004", "footprint", "`body.footprint` has no `shape`"),
        ('"circle"', '"oval"', "B005", '"oval"', 'there is no shape "oval"'),
        ('"circle"', "[1]", "B005", "[1]", "there is no shape an array of 1 item"),
        (
            '"0.2 m"',
            "true",
            "B006",
            "true",
            "`body.footprint.radius` is true; expected a text with a number and a unit",
        ),
        (
            '"0.2 m"',
            '"0.2 m m"',
            "B006",
            '"0.2 m m"',
            "`body.footprint.radius`: found `0.2 m m`; expected a number and a unit",
        ),
        (
            '"0.2 m"',
            '"0.2 parsec"',
            "B007",
            '"0.2 parsec"',
            "`body.footprint.radius`: `parsec` is not a unit",
        ),
        (
            '"0.2 m"',
            '"0.2"',
            "B007",
            '"0.2"',
            "`body.footprint.radius`: found `0.2` without a unit; expected one in mm",
        ),
        (
            '"0.2 m"',
            '"1e300 m"',
            "B008",
            '"1e300 m"',
            "`body.footprint.radius`: found `1e300`, which is too large",
        ),
        (
            '"0.2 m"',
            '"1e-300 m"',
            "B008",
            '"1e-300 m"',
            "`body.footprint.radius`: found `1e-300`, which is too small",
        ),
        ('"0.2 m"', '"-1 m"', "B008", '"-1 m"', '`body.footprint.radius` is "-1 m"; expected above 0 mm'),
        (
            '"0.2 m"',
            '"1e999 m"',
            "B008",
            '"1e999 m"',
            "`body.footprint.radius`: found `1e999`, which is too large",
        ),
        (
            '"0.2 m"',
            '"1e9999 m"',
            "B006",
            '"1e9999 m"',
            "`body.footprint.radius`: found `1e9999 m`; expected a number and a unit",
        ),
    ],
)
def test_an_error_has_its_place(old: str, new: str, code: str, place: str, message: str) -> None:
    assert old in SMALL
    assert problems(SMALL.replace(old, new)) == [(code, place, message)]


@pytest.mark.parametrize(
    ("old", "new", "code", "place"),
    [
        ('rate = "10 Hz"', 'rate = "0 Hz"', "B008", '"0 Hz"'),
        ('rate = "10 Hz"', 'rate = "1e-300 Hz"', "B008", '"1e-300 Hz"'),
        ('"hold"', '"holt"', "B006", '"holt"'),
        ('"150 deg .. 165 deg"', '"150 deg"', "B006", '["150 deg", "0.5 .. 1 rad"]'),
        ('"150 deg .. 165 deg"', "3", "B006", '[3, "0.5 .. 1 rad"]'),
        ('"150 deg .. 165 deg"', '"150 mm .. 165 deg"', "B007", '["150 mm .. 165 deg", "0.5 .. 1 rad"]'),
        ('no_echo = "12 m", ', "", "B009", "blocked"),
        ("count = 360", "count = 0", "B008", "0"),
        ("count = 360", "count = 36.5", "B006", "36.5"),
        ('["5 cm", "0 mm", "90 deg"]', '["5 cm", "0 mm"]', "B006", '["5 cm", "0 mm"]'),
        ('"colony.drivers.ldlidar:LD06"', '"ldlidar"', "B006", '"ldlidar"'),
        ("inverted = true", "inverted = []", "B006", "[]"),
        ("{ driver =", "{ drver =", "B004", "hardware"),
        ("[server.Lidar]", "[server.DServer]", "B009", "server.DServer"),
        ("[server.Lidar]", '[server."a b"]', "B006", 'server."a b"'),
        ("fields.temperature =", "fields.temperature.x =", "B003", "fields.temperature.x"),
    ],
)
def test_an_error_of_a_server_has_its_place(old: str, new: str, code: str, place: str) -> None:
    assert old in LIDAR
    assert next((c, p) for c, p, _ in problems(SMALL + LIDAR.replace(old, new))) == (code, place)


@pytest.mark.parametrize("value", ["inf", "-inf", "nan", "1e300", "1" + "0" * 30])
def test_a_number_for_a_driver_is_one_that_it_can_be_given(value: str) -> None:
    [(code, place, message)] = problems(SMALL + LIDAR.replace("baud = 230400", f"baud = {value}"))
    assert (code, place) == ("B006", value)
    assert message.startswith("`server.Lidar.hardware.baud` is ")
    assert message.endswith("; expected a number up to 1e+18")


def test_bounds_are_in_units_that_people_write() -> None:
    joint = 'device = "joint", range = "0 .. 1 m", speed = "1 m/s"'
    text = f'{SMALL}[server.Lift]\nsimulated = {{ {joint}, load = "-1 kg" }}\n'
    assert problems(text) == [
        ("B008", '"-1 kg"', '`server.Lift.simulated.load` is "-1 kg"; expected at least 0 kg')
    ]


def test_a_server_has_a_device() -> None:
    assert problems(SMALL + '[server.Arm]\nrate = "1 Hz"\n')[0][2] == (
        "`Arm` has no device: neither simulated nor real"
    )


@pytest.mark.parametrize(
    "text",
    [
        "a = ",
        "[" * 5000,
        "a" + ".a" * 5000 + " = 1",
        "a = 1" + "0" * 10000,
        "a = { b = 1",
        "[a]\n[a]",
        "a = 1979-05-27\n",
        "robot = 3\nbody = []\nserver = 2.5",
        "\x00",
        SMALL + '[server]\nx = { simulated = { device = "lidar", count = 999999999999999999999 } }',
    ],
)
def test_whatever_the_text_there_is_an_error(text: str) -> None:
    assert problems(text)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "large.toml").write_text("#" * (MAX_BYTES + 1))
    (tmp_path / "latin.toml").write_bytes(b'a = "\xe4"')
    assert [d.code for d in read_body(tmp_path / "none.toml").diagnostics] == ["B001"]
    assert [d.code for d in read_body(tmp_path).diagnostics] == ["B001"]
    os.mkfifo(tmp_path / "pipe.toml")
    assert [d.code for d in read_body(tmp_path / "pipe.toml").diagnostics] == ["B001"]
    assert [d.code for d in read_body("a\0b.toml").diagnostics] == ["B001"]
    assert [d.code for d in read_body(tmp_path / "large.toml").diagnostics] == ["B001"]
    assert [d.code for d in read_body(tmp_path / "latin.toml").diagnostics] == ["B002"]


@pytest.mark.parametrize(
    ("text", "is_continued"),
    [
        ('[body]\ndrive = { kind = "omnidirectional" }\n[body.drive.wheels]\n', True),
        ('[body]\ndrive = { kind = "omnidirectional" }\n[body.drive]\n', True),
        ('[body]\ndrive = { kind = "omnidirectional" }\n[[body.drive]]\n', True),
        ('body = { drive = { kind = "differential" } }\n[body.drive.wheels]\n', True),
        ("[body]\n[body]\n", False),
        ("[body]\nx = 1\nx = 2\n", False),
    ],
)
def test_a_header_that_continues_a_table_in_braces_has_a_hint(text: str, is_continued: bool) -> None:
    [problem] = body_of_text(text, "small.toml").diagnostics
    assert problem.code == "B002"
    assert problem.hint.startswith("an inline table `{ }` cannot be continued") == is_continued


def test_a_file_knows_the_places_of_its_keys() -> None:
    file = body_of_text(SMALL + LIDAR, "small.toml")
    assert file.key("server", "Lidar", "rate").text == "rate"
    assert file.value("server", "Lidar", "rate").text == '"10 Hz"'
    assert file.key("server", "Lidar", "simulated", "noise").text == "simulated.device"
    assert file.key("server", "Lidar", "fields").text == "fields.scan"
    assert file.key("server", "Other").text == "server.Lidar"
    assert file.key("nothing").start == 0


@pytest.mark.parametrize(("number", "shown"), [("nan", "nan"), ("inf", "inf"), ("-inf", "-inf")])
def test_numbers_that_are_none_are_called_by_their_names(number: str, shown: str) -> None:
    text = SMALL.replace('"30 cm"', f'"30 cm", scale_error = {number}')
    message = f"`body.drive.scale_error` is {shown}; expected at least 0 and at most 1"
    assert problems(text) == [("B008", number, message)]


def test_control_characters_are_escaped_in_messages() -> None:
    escape = "\\u001b[31m"  # as TOML writes it
    for old, new in (
        ('"small"', f'"a{escape}\\n"'),
        ('"0.2 m"', f'"1 {escape}"'),
        ('"0.2 m"', f'"1 m {escape}"'),
        ('name = "small"', f'name = "small"\n"{escape}" = 3'),
        ("[body.limits]", f'[server."{escape}"]\n[body.limits]'),
    ):
        found = body_of_text(SMALL.replace(old, new), "small.toml").diagnostics
        assert found
        assert all(d.message.isprintable() and (d.hint or "").isprintable() for d in found)
        assert "\\x1b[31m" in found[0].message
