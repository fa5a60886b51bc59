"""Robots as their descriptions and their servers describe them."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from colony.body.disagreements import findings
from colony.body.model import Body
from colony.body.reader import read_body
from colony.body.servers import servers_of
from colony.body.shipped import ROME, shipped_body
from colony.dsl.descriptions import RobotChoice, existing_choice, find_body, find_in_project
from colony.dsl.load import load_text
from colony.dsl.parse import VERSION_LINE
from colony.ir.program import Program, Robot
from colony.ir.servers import ServerSpec
from colony.runtime.kit.discovery import session_with
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.protocol.bindings import bound_servers
from colony.runtime.protocol.interface import Interface, interface_of, interface_problem
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.text.diagnostics import DiagnosticError, has_errors
from colony.text.source import Source, Span


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


class NoDescriptionError(RobotConnectionError):
    """The description that a robot is served with is not found here, or the robot has none."""


def described_program(choice: RobotChoice) -> Program:
    """Return a description as a program.

    Raises:
        DiagnosticError: it has errors, or there is no such description.
    """
    try:
        return load_text(f"{VERSION_LINE}\nimport robot\n", "--robot", robot=choice)
    except DiagnosticError as problem:
        option, _, typed = choice.origin.partition(" ")
        source = Source(option, typed)
        written = Span(
            source, len(typed) - len(choice.text) if typed.endswith(choice.text) else 0, len(typed)
        )
        raise DiagnosticError(
            [replace(d, span=written) if d.span.source.name == "--robot" else d for d in problem.diagnostics]
        ) from None


def served_program(interface: Interface, choice: RobotChoice) -> Program:
    """Return the description that a robot is served with, as a program.

    Args:
        interface: the interface that the robot is served with; without parts for one without a description.
        choice: the description that was chosen for it. If that is no more than the robot's name, the
            description may also be that of the project, or the one that is called as the interface says.

    Raises:
        NoDescriptionError: it is not found, or another was chosen; or the robot has none.
        DiagnosticError: it has errors.
    """
    problem = "its description is not found" if interface.parts else "it is served without a description"
    for candidate in _candidates(interface, choice):
        program = described_program(candidate)
        if interface_problem(interface_of(program.robot), interface) is None:
            return program
        found, served = program.robot.name, interface.robot
        other = f"`{served}`, not `{found}`" if found != served else f"another `{served}` than the one here"
        problem = f"its description is {other}"
    raise NoDescriptionError(problem)


def _candidates(interface: Interface, choice: RobotChoice) -> tuple[RobotChoice, ...]:
    if not choice.is_name:
        return (choice,)
    if not interface.parts:  # whatever the robot is called
        return ()
    by_name, said = existing_choice(choice, Path()), interface.robot
    path = find_in_project(said, Path()) if re.fullmatch(r"\w+", said) else None
    as_said = None if path is None else RobotChoice(text=str(path), origin="the robot")
    return tuple(found for found in (by_name, as_said) if found is not None)


def additional_servers(
    robot: Robot, described: DescribedRobot, robot_address: RobotAddress
) -> tuple[ServerSpec, ...]:
    """Return the servers of sensors and actuators that the description lacks, as they describe themselves.

    Servers that do not run, or have no valid description, are left out.
    """
    known_servers = {server.name for server in described.servers}
    additional_names = [name for name in bound_servers(robot) if name not in known_servers]
    if not additional_names:
        return ()
    from colony.runtime.kit.description import describe, server_spec
    from colony.runtime.kit.errors import RobotConnectionError

    specs = []
    with suppress(RobotConnectionError), session_with(robot_address) as session:
        for name in additional_names:
            with suppress(RobotConnectionError, ValueError), session.connect(name) as connection:
                specs.append(server_spec(connection.do(describe())))
    return tuple(specs)
