"""The robot of a program as its description has it: the body, and what its servers offer."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from colony.body.disagreements import findings
from colony.body.model import Body
from colony.body.reader import read_body
from colony.body.servers import servers_of
from colony.body.shipped import ROME, shipped_body
from colony.dsl.descriptions import find_body
from colony.ir.program import Robot
from colony.ir.servers import ServerSpec
from colony.text.diagnostics import DiagnosticError, has_errors


class DescribedRobot(NamedTuple):
    """A robot as its description has it.

    Attributes:
        body: its body.
        servers: what its servers offer.
        path: the file of the body; None for the stand-in of a robot without one.
        interface: its interface; None if nothing is known of it.
    """

    body: Body
    servers: tuple[ServerSpec, ...]
    path: Path | None = None
    interface: Robot | None = None


def described_robot(robot: Robot, body: Path | None = None) -> DescribedRobot:
    """Return the robot that a program runs on; RoME if the program's robot has no body.

    Args:
        robot: its interface.
        body: the file of its body, by default the one that `find_body` finds.

    Raises:
        DiagnosticError: the body has errors, or the interface and the body do not fit each other.
    """
    path = body or find_body(robot)
    if path is None:
        return rome(robot)
    file = read_body(path)
    found = findings(robot, file)
    if file.body is None or has_errors(found):
        raise DiagnosticError(found)
    return DescribedRobot(file.body, servers_of(file.body, robot), path, robot)


def rome(robot: Robot | None = None) -> DescribedRobot:
    """Return RoME, as the robot of programs whose robot has no body."""
    body = shipped_body(ROME)
    return DescribedRobot(body, servers_of(body, robot), interface=robot)
