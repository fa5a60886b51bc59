"""`colony teleop`: drive a robot by hand, with a gamepad or the keys of a terminal."""

from __future__ import annotations

import asyncio
import signal
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.reporting import say
from colony.cli.robot_options import (
    reporting_connection_errors,
    robot_address_of,
    running_robot,
    running_robot_options,
)
from colony.cli.run.options import OptionError, parsed
from colony.runs.scenario import parse_number
from colony.text.units import ANGLE, LENGTH, NUMBER, TIME, Dimension

if TYPE_CHECKING:
    from colony.cli.teleop.inputs import GamepadInput, Keyboard, PadLayout
    from colony.runtime.kit.connection import Session

ANY_GAMEPAD = "any"
"""The value of `--gamepad` without a device: the first gamepad that can be read."""

LAYOUT = "deadman=tl,fast=tr,stop=east,velocity=-y,turn=-rx,sideways=-x,dead_zone=0.1"

PRIORITY = 10_000
"""The priority of an operator: above every client, of which a program has at most 2000."""


def _quantity(
    option: str, dimension: Dimension, least: float, most: float, example: str
) -> Callable[[str], float]:
    """Return the parser of an option: a number from `least` to `most` base units, or one with a unit."""

    def parse(text: str) -> float:
        value = parse_number(text, dimension, 1.0)
        if value is None or not least <= value <= most:
            expected = f"{least:g} to {most:g} {dimension}, such as {example}"
            raise OptionError(f"{option}: found `{text}`; expected {expected}")
        return value

    return parse


def _layout(text: str) -> PadLayout:
    """Parse changes of `LAYOUT`."""
    from colony.cli.teleop.inputs import PadLayout
    from colony.drivers.gamepad import axis_part, button_code

    parts = dict(part.split("=") for part in LAYOUT.split(","))
    for part in text.split(","):
        name, _, value = (each.strip() for each in part.partition("="))
        if name not in parts or not value:
            raise OptionError(f"--layout: found `{part}`; expected changes of {LAYOUT}")
        parts[name] = value
    dead_zone = parse_number(parts.pop("dead_zone"), NUMBER, 1.0)
    if dead_zone is None or not 0.0 <= dead_zone < 1.0:
        raise OptionError("--layout: expected a dead_zone from 0 to less than 1, such as 0.1")
    try:
        deadman, fast, stop = (button_code(parts.pop(name)) for name in ("deadman", "fast", "stop"))
        velocity, turn, sideways = map(axis_part, parts.values())
    except ValueError as problem:
        raise OptionError(f"--layout: {problem}") from None
    return PadLayout(deadman, fast, stop, velocity, turn, sideways, dead_zone)


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
    "--layout",
    metavar="NAME=WHAT,...",
    default=LAYOUT,
    callback=parsed(_layout),
    help=f"Changes of the gamepad's layout: buttons, axes, and the part of an axis that is 0. "
    f"[default: {LAYOUT}]",
)
@click.option(
    "--speed",
    metavar="SPEED",
    callback=parsed(_quantity("--speed", LENGTH.over(TIME), 1.0, 1e5, "0.4m/s")),
    help="The speed at full deflection: 0.4m/s, or a number in mm/s. [default: half of what the robot takes]",
)
@click.option(
    "--turn",
    metavar="RATE",
    callback=parsed(_quantity("--turn", ANGLE.over(TIME), 1.0, 1e4, "45deg/s")),
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
    callback=parsed(_quantity("--lease", TIME, 0.1, 5.0, "0.3s")),
    help="The time for which a command holds if this process dies or freezes.",
)
def command(
    robot: str | None,
    connect: str | None,
    security: Path | None,
    gamepad: str | None,
    layout: PadLayout,
    **settings: Any,
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

    One key counts at a time. A terminal reports no releases: a key counts as held for 0.6 s after it was
    pressed, and for 0.2 s after each repetition.

    Exit code: 0 at the end, 1 if the robot refuses, 2 for misuse, and if there is no robot or gamepad.

    \b
    Example:
      colony teleop
      colony teleop --gamepad --speed 0.4m/s --turn 45deg/s
      colony teleop --robot rome --gamepad /dev/input/event5 --layout deadman=tr,turn=-x
    """
    from colony.cli.teleop.inputs import Keyboard, single_keys
    from colony.runtime.kit.discovery import session_with
    from colony.runtime.kit.errors import CallRefusedError

    with reporting_connection_errors():
        name = running_robot(robot, connect, "RServer")
        address = robot_address_of(name, connect, security)
        source = _hand_input(gamepad, layout)
        keys = single_keys(sys.stdin.fileno()) if isinstance(source, Keyboard) else nullcontext()
        with session_with(address) as session, keys:
            try:
                asyncio.run(_operate(session, name, source, **settings))
            except CallRefusedError as problem:
                say(f"colony: error: {problem.message}")
                raise click.exceptions.Exit(EXIT_ERRORS) from None


def _hand_input(gamepad: str | None, layout: PadLayout) -> GamepadInput | Keyboard:
    from colony.cli.teleop.inputs import GamepadInput, Keyboard
    from colony.drivers.gamepad import Gamepad

    if gamepad is not None:
        pad = Gamepad("" if gamepad == ANY_GAMEPAD else gamepad)
        pad.read(time.monotonic())
        if pad.problem:
            raise click.ClickException(f"--gamepad: {pad.problem}")
        return GamepadInput(pad, layout)
    if not sys.stdin.isatty():
        raise click.UsageError("the standard input is no terminal, which has keys: give --gamepad [DEVICE]")
    return Keyboard(sys.stdin.fileno())


async def _operate(
    session: Session, name: str, source: GamepadInput | Keyboard, priority: int, **settings: Any
) -> None:
    from colony.cli.interruption import termination_signals
    from colony.cli.stop import stop_robot
    from colony.cli.teleop.operating import NAME, Teleoperation
    from colony.runtime.kit.aio import AsyncSession

    stop = partial(stop_robot, name, session)
    async with AsyncSession(session.hub).connect("RServer", name=NAME, priority=priority) as base:
        operation = Teleoperation(base, source, priority, stop, **settings)
        for number in (*termination_signals(), signal.SIGQUIT):
            asyncio.get_running_loop().add_signal_handler(number, operation.end)
        await operation.run()
