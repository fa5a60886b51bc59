"""The option `--also`: other robots in the world of a run."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.run.options import OptionError, scenario_of, start_pose
from colony.shipped import Shipped

if TYPE_CHECKING:
    from colony.runs.spec import OtherRobot

ALSO_FORM = "[NAME=]DESCRIPTION:BEHAVIOR[@X,Y,HEADING][,scenario=FILE]"

MAX_OTHERS = 100

also_option = click.option(
    "--also",
    multiple=True,
    metavar=ALSO_FORM,
    help="Another robot in the same world, which runs a behavior of its own; at a free place that the seed "
    "gives, unless it has a pose; what nothing simulates for it is in a scenario. May be repeated.",
)
"""`--also`, as texts."""


def other_robots(texts: tuple[str, ...], robot: str) -> tuple[OtherRobot, ...]:
    """Return the other robots of a run, with their programs; `robot` is the name of the run's own robot.

    Robots without a name have that of their description, with a number where it is taken: rome, rome_2.

    Exits with 2 if a behavior cannot be read, with 1 if it has errors or does not fit its robot.

    Raises:
        OptionError: a text is not of this form, a name is taken, or there are too many.
    """
    if len(texts) > MAX_OTHERS:
        raise OptionError(f"--also: found {len(texts)} robots; expected at most {MAX_OTHERS}")
    found: list[OtherRobot] = []
    for text in texts:
        found.append(_other_robot(text, {robot, *(other.name for other in found)}))
    return tuple(found)


def _other_robot(text: str, taken: set[str]) -> OtherRobot:
    from colony.cli.programs import described_for_run
    from colony.cli.reporting import exit_with, say
    from colony.dsl.descriptions import RobotChoice
    from colony.dsl.load import check_file
    from colony.runs.spec import OtherRobot

    robot, comma, scenario = text.partition(",scenario=")
    named, at, pose = robot.partition("@")
    name, equals, kind = named.rpartition("=")
    description, _, behavior = kind.partition(":")
    if (
        not (description and behavior)
        or (equals and not name)
        or (at and not pose)
        or (comma and not scenario)
    ):
        raise OptionError(f"--also: found `{text}`; expected {ALSO_FORM}, such as rome:wander")
    start = start_pose(pose, option=f"--also {named}") if at else None
    file = Shipped.BEHAVIOR.find(behavior)
    choice = RobotChoice(text=description, origin=f"--also {text}")
    checked = check_file(file, robot=choice)
    if checked.program is None:
        say(f"colony run: error: --also {text}: cannot use `{behavior}` for this robot:")
        exit_with(checked.diagnostics)
    sys.path += [str(Path(file).resolve().parent), os.curdir]
    return OtherRobot(
        name=_free_name(name or Path(description).stem, taken, is_given=bool(name)),
        file=file,
        described=described_for_run(checked.program.robot),
        program=checked.program,
        start=start,
        scenario=scenario_of(checked.program.robot, scenario or None),
    )


def _free_name(name: str, taken: set[str], *, is_given: bool) -> str:
    from colony.runtime.transport.live.run_directory import check_name

    if is_given:
        try:
            check_name("robot", name)
        except ValueError as problem:
            raise OptionError(f"--also: {problem}") from None
        if name in taken:
            raise OptionError(f"--also: two robots are named `{name}`; expected a name for each")
    return name if name not in taken else next(_numbered(name, taken))


def _numbered(name: str, taken: set[str]) -> Iterator[str]:
    return (f"{name}_{number}" for number in range(2, len(taken) + 3) if f"{name}_{number}" not in taken)
