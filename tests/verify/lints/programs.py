"""Small programs for one robot, and what the lints say of them."""

from __future__ import annotations

from colony.dsl.load import load_text
from colony.verify.lints import lint

ROBOT = """
robot r {
  sensor sonar  : mm range 0 .. 10000 from PServer.sonar
  sensor bumper : bool from RServer.bumper
  sensor level  : number range 0 .. 100 default 0 from DServer.Level
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive idle drive(velocity = 0, turn = 0)
}
"""


def go(name: str, when: str, velocity: str = "300 mm/s", turn: str = "0") -> str:
    """A module that drives."""
    return f"module {name} {{ when {when} do drive(velocity = {velocity}, turn = {turn}) }}\n"


USES = "contract uses: fresh(sonar) or fresh(bumper) or level >= 0 or level < 0\n"
"""Reads every sensor, so that none of them is said to be unused."""


def found(text: str, robot: str = ROBOT) -> list[tuple[str, str]]:
    """Code and message of every warning."""
    return [(d.code, d.message) for d in lint(load_text(robot + text + USES))]


def codes(text: str) -> list[str]:
    return [code for code, _ in found(text)]
