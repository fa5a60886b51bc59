"""The TurtleBot3 that comes with colony, and the Waffle Pi that the comments of its body describe."""

from __future__ import annotations

import re

from colony.body.disagreements import findings
from colony.body.model import Body, Circle
from colony.body.reader import body_of_text
from colony.dsl.load import load_text
from tests.paths import ROOT

FOLDER = ROOT / "robots" / "turtlebot"
VARIANT = re.compile(r"= (.*?) +# waffle_pi: (.*)")


def read(interface: str, body: str) -> Body:
    """Return a body that agrees with its interface."""
    file = body_of_text(body, "turtlebot.toml")
    assert findings(load_text(interface).robot, file) == ()
    assert file.body is not None
    return file.body


def test_a_waffle_pi_is_the_same_with_the_values_of_the_comments() -> None:
    interface, body = ((FOLDER / f"turtlebot.{suffix}").read_text() for suffix in ("colony", "toml"))
    burger = read(interface, body)
    changed, count = VARIANT.subn(r"= \2", body)
    waffle = read(
        interface.replace("robot turtlebot {", "robot waffle_pi {"),
        changed.replace('name  = "turtlebot"', 'name  = "waffle_pi"'),
    )
    assert count == 7
    for robot, radius_mm, velocity_mm_s, x_mm in (
        (burger, 125.0, 220.0, -32.0),
        (waffle, 240.0, 260.0, -64.0),
    ):
        assert robot.chassis.footprint == Circle(radius_mm=radius_mm)
        assert robot.chassis.limits.velocity_mm_s == velocity_mm_s
        assert robot.servers["Lidar"].ros2["scan"].pose.x_mm == x_mm
    assert (burger.chassis.drive.wheel_base_mm, waffle.chassis.drive.wheel_base_mm) == (160.0, 287.0)
