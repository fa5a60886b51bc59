"""A robot with a sonar, a bumper and a drive, as text, and modules that drive it."""

from __future__ import annotations


def robot(more: str = "") -> str:
    """Its declaration, with a line of `more`."""
    return f"""
robot r {{
  sensor sonar  : mm range 0 .. 10000 from PServer.sonar
  sensor bumper : bool from RServer.bumper
  sensor level  : number range 0 .. 100 default 0 from DServer.Level
  actuator drive {{ velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }}
           to RServer.drive idle drive(velocity = 0, turn = 0)
{f"  {more}{chr(10)}" if more else ""}}}
"""


def go(name: str, when: str, velocity: str = "300 mm/s", turn: str = "0") -> str:
    """A module that drives."""
    return f"module {name} {{ when {when} do drive(velocity = {velocity}, turn = {turn}) }}\n"
