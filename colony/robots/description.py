"""A robot's description alone, as a program without modules: its interface, its limits, its contracts."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from colony.dsl.descriptions import RobotChoice, existing_choice, find_in_project
from colony.dsl.load import load_text
from colony.dsl.parse import VERSION_LINE
from colony.ir.program import Program
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.protocol.interface import Interface, interface_of, interface_problem
from colony.text.diagnostics import DiagnosticError
from colony.text.source import Source, Span


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
