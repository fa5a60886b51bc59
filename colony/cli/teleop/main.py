"""`colony teleop`: drive a robot by hand, with a gamepad or the keys of a terminal."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.reporting import say
from colony.cli.robot_options import (
    reporting_connection_errors,
    robot_address_of,
    running_robot,
    running_robot_options,
)
from colony.cli.run.options import OptionError, duration_ns, parsed
from colony.runs.scenario import parse_number
from colony.text.units import ANGLE, LENGTH, TIME, Dimension

if TYPE_CHECKING:
    from colony.cli.teleop.inputs import HandInput, Layout
    from colony.cli.teleop.operating import FullSpeeds
    from colony.drivers.gamepad import AxisPart
    from colony.runtime.kit.connection import Session

T = TypeVar("T")

ANY_GAMEPAD = "any"
"""The value of `--gamepad` without a device: the first gamepad that can be read."""

PRIORITY = 10_000
"""The priority of an operator: above every client, of which a program has at most 2000."""

MIN_LEASE_S, MAX_LEASE_S = 0.1, 5.0
MAX_HOLD_S = 2.0

AXES = "velocity=-y,turn=-rx,sideways=-x"


def _seconds(option: str, low: float, high: float) -> Callable[[str], float]:
    def parse(text: str) -> float:
        seconds = duration_ns(text, option=option) / 1e9
        if not low <= seconds <= high:
            raise OptionError(f"{option}: found {seconds:g} s; expected {low:g} to {high:g} s")
        return seconds

    return parse


def _rate(option: str, dimension: Dimension, example: str) -> Callable[[str], float]:
    def parse(text: str) -> float:
        value = parse_number(text, dimension, 1.0)
        if value is None or value <= 0.0:
            raise OptionError(f"{option}: found `{text}`; expected {example}")
        return value

    return parse


def _named(option: str, parse: Callable[[str], T]) -> Callable[[str], T]:
    """Return a parser that reports what `parse` raises as a mistake of the option."""

    def parse_option(text: str) -> T:
        try:
            return parse(text)
        except ValueError as problem:
            raise OptionError(f"{option}: {problem}") from None

    return parse_option


def _button(text: str) -> int:
    from colony.drivers.gamepad import button_code

    return button_code(text)


def _axes(text: str) -> dict[str, AxisPart]:
    """Return the axes of the speeds; those that the text leaves out stay as they are by default."""
    from colony.drivers.gamepad import axis_part

    speeds = dict(part.split("=") for part in AXES.split(","))
    for part in filter(None, map(str.strip, text.split(","))):
        speed, equals, axis = (each.strip() for each in part.partition("="))
        if not equals or speed not in speeds:
            raise ValueError(f"found `{part}`; expected {AXES}")
        speeds[speed] = axis
    return {speed: axis_part(axis) for speed, axis in speeds.items()}


@click.command(name="teleop", short_help="drive a robot by hand, with a gamepad or keys")
@running_robot_options
@click.option(
    "--gamepad",
    is_flag=False,
    flag_value=ANY_GAMEPAD,
    metavar="[DEVICE]",
    help="Read a gamepad: its device, /dev/input/event5, or without a value the first one found. "
    "[default: the keys of this terminal]",
)
@click.option(
    "--speed",
    metavar="SPEED",
    callback=parsed(_rate("--speed", LENGTH.over(TIME), "a speed above 0, such as 0.4m/s")),
    help="The speed at full deflection: 0.4m/s, or a number in mm/s. [default: half of what the robot takes]",
)
@click.option(
    "--turn",
    metavar="RATE",
    callback=parsed(_rate("--turn", ANGLE.over(TIME), "a turn rate above 0, such as 45deg/s")),
    help="The turn rate at full deflection: 45deg/s, or a number in deg/s. [default: half of what it takes]",
)
@click.option(
    "--priority",
    type=click.IntRange(min=0),
    default=PRIORITY,
    show_default=True,
    help="The priority of the commands. Modules have 1 and up: the default is above them, 0 below.",
)
@click.option(
    "--lease",
    "lease_s",
    metavar="TIME",
    default="0.3s",
    show_default=True,
    callback=parsed(_seconds("--lease", MIN_LEASE_S, MAX_LEASE_S)),
    help="The time for which a command holds if this process dies or freezes.",
)
@click.option(
    "--hold",
    "hold_s",
    metavar="TIME",
    default="0.6s",
    show_default=True,
    callback=parsed(_seconds("--hold", 0.05, MAX_HOLD_S)),
    help="The time for which a key counts as held until the terminal repeats it.",
)
@click.option(
    "--deadman",
    metavar="BUTTON",
    default="tl",
    show_default=True,
    callback=parsed(_named("--deadman", _button)),
    help="The button to hold while driving: a name, or a number such as 310.",
)
@click.option(
    "--fast",
    metavar="BUTTON",
    default="tr",
    show_default=True,
    callback=parsed(_named("--fast", _button)),
    help="The button that doubles the speeds while it is held.",
)
@click.option(
    "--stop-button",
    metavar="BUTTON",
    default="east",
    show_default=True,
    callback=parsed(_named("--stop-button", _button)),
    help="The button that stops the robot as `colony stop` does.",
)
@click.option(
    "--axes",
    metavar="LIST",
    default=AXES,
    show_default=True,
    callback=parsed(_named("--axes", _axes)),
    help="The axis of each speed; those that are left out stay.",
)
@click.option(
    "--dead-zone",
    type=click.FloatRange(0.0, 90.0),
    default=10.0,
    show_default=True,
    metavar="PERCENT",
    help="The part of an axis around its middle that counts as 0.",
)
def command(
    robot: str | None,
    connect: str | None,
    security: Path | None,
    gamepad: str | None,
    speed: float | None,
    turn: float | None,
    priority: int,
    lease_s: float,
    hold_s: float,
    deadman: int,
    fast: int,
    stop_button: int,
    axes: dict[str, AxisPart],
    dead_zone: float,
) -> None:
    """Drive the base of a robot that runs, until q or Ctrl-C. A line shows who drives.

    The robot is yours while you hold the deadman of the gamepad, or a key. When you let go, the program
    drives again in the next frame, or the robot stands. Its limits hold for you, too (docs/teleop.md).

    \b
    Keys:
      w s, up down      ahead, back               space  let go at once
      a d, left right   turn left, right          x      stop the robot, as `colony stop` does
      , .               sideways left, right      q      quit
      W S A D           the same, twice as fast

    One key counts at a time. A terminal reports no releases: a key counts as held for --hold after it was
    pressed, and for 0.2 s after each repetition.

    Exit code: 0 at the end, 1 if the robot refuses, 2 for misuse, and if there is no robot or gamepad.

    \b
    Example:
      colony teleop
      colony teleop --gamepad --speed 0.4m/s --turn 45deg/s
      colony teleop --robot rome --gamepad /dev/input/event5 --axes turn=-x --deadman tr
    """
    from colony.cli.teleop.inputs import Layout
    from colony.cli.teleop.operating import FullSpeeds
    from colony.runtime.kit.discovery import session_with
    from colony.runtime.kit.errors import CallRefusedError

    layout = Layout(deadman, fast, stop_button, **axes, dead_zone=dead_zone / 100.0)
    with reporting_connection_errors():
        name = running_robot(robot, connect, "RServer")
        address = robot_address_of(name, connect, security)
        with _hand_input(gamepad, layout, hold_s) as source, session_with(address) as session:
            try:
                full = FullSpeeds(speed, turn)
                asyncio.run(_operate(session, name, source, full, priority, lease_s))
            except CallRefusedError as problem:
                say(f"colony: error: {problem.message}")
                raise click.exceptions.Exit(EXIT_ERRORS) from None


@contextmanager
def _hand_input(gamepad: str | None, layout: Layout, hold_s: float) -> Iterator[HandInput]:
    from colony.cli.teleop.inputs import GamepadInput, Keyboard, single_keys
    from colony.drivers.gamepad import GamepadError

    if gamepad is not None:
        try:
            pad = GamepadInput("" if gamepad == ANY_GAMEPAD else gamepad, layout)
        except GamepadError as problem:
            raise click.ClickException(f"--gamepad: {problem}") from None
        with closing(pad):
            yield pad
    elif sys.stdin.isatty():
        with single_keys(sys.stdin.fileno()):
            yield Keyboard(sys.stdin.fileno(), hold_s)
    else:
        raise click.UsageError("the standard input is no terminal, which has keys: give --gamepad [DEVICE]")


async def _operate(
    session: Session, name: str, source: HandInput, full: FullSpeeds, priority: int, lease_s: float
) -> None:
    from colony.cli.interruption import termination_signals
    from colony.cli.stop import stop_robot
    from colony.cli.teleop.operating import NAME, Teleoperation
    from colony.runtime.kit.aio import AsyncSession

    stop = partial(stop_robot, name, session)
    async with AsyncSession(session.hub).connect("RServer", name=NAME, priority=priority) as base:
        operation = Teleoperation(base, source, full, priority=priority, lease_s=lease_s, stop=stop)
        for number in termination_signals():
            asyncio.get_running_loop().add_signal_handler(number, operation.end)
        await operation.run()
