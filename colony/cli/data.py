"""`colony data`: the variables of a robot's DServer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click
import msgspec

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.reporting import say
from colony.cli.robot_options import (
    asking,
    robot_address_of,
    running_robot,
    running_robot_options,
)
from colony.runtime.kit.discovery import session_with
from colony.text.wording import printable

if TYPE_CHECKING:
    from colony.runtime.kit.connection import Connection
    from colony.runtime.library.leader import ReadVariable

SERVER = "DServer"
PAGE = 1000
"""Names per request of `colony data list`."""


@click.group(name="data", short_help="list, read, set and delete shared variables")
def command() -> None:
    """List, read, set and delete the variables that the processes of a robot share (DServer).

    Values are JSON. Limits that DServer has reached, and damaged files that it has set aside, are reported on
    standard error.

    Exit code: 0 on success, 1 if DServer refuses, 2 if the robot does not exist or cannot be reached.

    \b
    Example:
      colony data list
      colony data get Pose --robot rome
      colony data set GoalDirection 270.0
      colony data delete GoalDirection GoalDistance
    """


@command.command(name="list", short_help="list the names of variables")
@click.argument("prefix", default="")
@running_robot_options
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def list_names(
    prefix: str, robot: str | None, connect: str | None, security: Path | None, format_: str
) -> None:
    """List the names of all variables, or of those that begin with PREFIX.

    \b
    Example:
      colony data list Goal
      colony data list --format json
    """
    _expect_names((prefix,))
    with _dserver(robot, connect, security) as server:
        names = list(_names(server, prefix))
    if format_ == "json":
        click.echo(msgspec.json.encode(names).decode())
    else:
        for name in names:
            click.echo(printable(name))


@command.command(short_help="show the value of a variable")
@click.argument("name")
@running_robot_options
def get(name: str, robot: str | None, connect: str | None, security: Path | None) -> None:
    """Show the value of the variable NAME as JSON: bytes in base64, infinities and NaN as null.

    \b
    Example:
      colony data get Pose
    """
    from colony.runtime.library import data

    _expect_names((name,))
    with _dserver(robot, connect, security) as server:
        value = server.do(data.get(name))
    try:
        click.echo(msgspec.json.encode(value).decode())
    except (TypeError, ValueError) as problem:
        raise click.ClickException(f"the value of `{name}` cannot be shown as JSON: {problem}") from None


@command.command(name="set", short_help="set a variable", context_settings={"ignore_unknown_options": True})
@click.argument("name")
@click.argument("value")
@running_robot_options
def set_value(name: str, value: str, robot: str | None, connect: str | None, security: Path | None) -> None:
    """Set the variable NAME to VALUE, which is JSON: quote text, and quote it again for the shell.

    A value of another type than the running program reads is set with a warning: it is a sensor fault.

    \b
    Example:
      colony data set GoalDirection -90.5
      colony data set Door '"103"'
      colony data set Place '[1200.0, 800.0]'
    """
    from colony.runtime.library import data

    _expect_names((name,))
    try:
        decoded = msgspec.json.decode(value)
        call = data.set(name, decoded)
    except (msgspec.DecodeError, UnicodeError, OverflowError, RecursionError) as problem:
        raise click.UsageError(f"VALUE is not valid JSON: {problem}; put text in quotes") from None
    with _dserver(robot, connect, security) as server:
        server.do(call)
    for read in _reads(robot, connect, security):
        if read.variable == name and not read.fits(decoded):
            say(
                f"colony: warning: the program reads `{name}` as {read.expected} (sensor `{read.sensor}`): "
                "this value is a sensor fault"
            )


def _reads(robot: str | None, connect: str | None, security: Path | None) -> Iterable[ReadVariable]:
    """Return the variables that the program of a running robot reads; none if they are not known."""
    from colony.runtime.kit.errors import RobotConnectionError
    from colony.runtime.library.leader import LEADER, run_program

    with (
        suppress(RobotConnectionError),
        session_with(robot_address_of(running_robot(robot, connect, SERVER), connect, security)) as session,
    ):
        if LEADER in session.servers():
            with session.connect(LEADER, name="colony data") as leader:
                return leader.do(run_program()).reads
    return ()


@command.command(short_help="delete variables")
@click.argument("names", metavar="NAME...", nargs=-1, required=True)
@running_robot_options
def delete(names: tuple[str, ...], robot: str | None, connect: str | None, security: Path | None) -> None:
    """Delete variables and their histories. This works even when DServer is full.

    Exit code: 1 if a variable does not exist; the others are deleted anyway.

    \b
    Example:
      colony data delete GoalDirection GoalDistance
    """
    from colony.runtime.library import data

    _expect_names(names)
    with _dserver(robot, connect, security) as server:
        missing = [name for name in names if not server.do(data.delete(name))]
    for name in missing:
        say(f"colony: error: {SERVER} has no variable `{name}`")
    if missing:
        raise click.exceptions.Exit(EXIT_ERRORS)


# --- DServer ---------------------------------------------------------------------------------------


def _expect_names(names: Iterable[str]) -> None:
    for name in names:
        try:
            name.encode()
        except UnicodeEncodeError:
            raise click.UsageError(f"the name {name!a} is not UTF-8") from None


@contextmanager
def _dserver(robot: str | None, connect: str | None, security: Path | None) -> Iterator[Connection]:
    """Open a connection to DServer, and report DServer's warnings."""
    from colony.runtime.library.ask import STATUS

    with asking(robot, connect, security, SERVER, name="colony data") as server:
        for warning in server.do(STATUS).full:
            say(f"colony: warning: {SERVER}: {printable(warning)}")
        yield server


def _names(server: Connection, prefix: str) -> Iterator[str]:
    from colony.runtime.library import data

    after = ""
    while page := server.do(data.names(prefix, after=after, limit=PAGE)):
        yield from page
        after = page[-1]
