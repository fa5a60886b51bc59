"""Sensors of docks: held to their interface, and drawn."""

from __future__ import annotations

import pytest

from colony.view.polar import Point, Sector
from tests.body.test_disagreements import found
from tests.body.test_reader import SMALL, problems
from tests.view.test_robot_scene import scene, sensor

INTERFACE = """language 1
robot small {
  frame    50 ms
  sensor seen : bool                      from Eye.dock_seen
  sensor away : m range 0 .. 3.5          from Eye.dock_distance within 200 ms
  sensor off  : deg range -180 .. 180     from Eye.dock_bearing
}
"""
BODY = (
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


def test_an_interface_of_a_dock_sensor_agrees() -> None:
    assert found(INTERFACE, BODY) == []


@pytest.mark.parametrize(
    ("old", "new", "code", "message"),
    [
        ("0 .. 3.5", "0 .. 3.4", "B015", "`away` has a range up to 3.4 m, and its device reads 3.5 m"),
        ("off  : deg", "off  : mm", "R003", "`off`: Eye.dock_bearing is deg, not mm"),
        ("Eye.dock_seen", "Eye.dock_see", "R002", "`seen`: Eye has no field `dock_see`"),
        (
            "within 200 ms",
            "within 60 ms",
            "B017",
            "`away` is measured every 100 ms, and read `within 60 ms`",
        ),
    ],
)
def test_what_does_not_fit_a_dock_sensor_is_found(old: str, new: str, code: str, message: str) -> None:
    [(found_code, _, found_message)] = found(INTERFACE.replace(old, new), BODY)
    assert (found_code, found_message) == (code, message)


def test_a_dock_sensor_is_on_the_robot() -> None:
    [(code, place, message)] = [p[:3] for p in problems(BODY.replace('"300 mm"', '"9 m"'))]
    assert (code, place) == ("B009", '["9 m", "-400 mm", "20 deg"]')
    assert message.startswith("a place 9008.88 mm from the center of the robot")


def test_a_dock_sensor_is_drawn() -> None:
    eye = sensor(scene(INTERFACE, BODY), "Eye")
    assert eye.note == "docks, 60°, 3 m"
    [beam] = eye.beams
    assert (beam.origin, beam.sector, beam.reach_mm) == (Point(400.0, 300.0), Sector(-10.0, 50.0), 3000.0)
