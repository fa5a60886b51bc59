"""The address of a robot, from the options `--robot NAME`, `--connect [ENDPOINT]`, `--security FILE`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.reporting import say
from colony.cli.robot_choice import check_robot_name

if TYPE_CHECKING:
    from colony.runtime.kit.connection import Connection
    from colony.runtime.transport.live.robot_address import RobotAddress

F = TypeVar("F", bound=Callable[..., object])

HERE = "here"
"""The value of `--connect` without an endpoint: a robot on this machine."""

_CONNECT = "The gateway of the robot, tls/HOST:PORT; without a value, the robot runs on this machine."
_SECURITY = "Your credentials for a gateway: a TOML file with user, certificate, key and authority."


def robot_option(help: str, *, required: bool = False) -> Callable[[F], F]:
    """Return the option `--robot NAME`, which accepts valid names of robots."""
    return click.option("--robot", required=required, metavar="NAME", callback=check_robot_name, help=help)


def connect_option(help: str = _CONNECT) -> Callable[[F], F]:
    """Return the option `--connect [ENDPOINT]`."""
    return click.option("--connect", is_flag=False, flag_value=HERE, metavar="[ENDPOINT]", help=help)


def security_option(help: str = _SECURITY) -> Callable[[F], F]:
    """Return the option `--security FILE`."""
    return click.option("--security", metavar="FILE", type=click.Path(path_type=Path), help=help)


def robot_address_of(robot: str, connect: str | None, security: Path | None) -> RobotAddress:
    """Return the address of the robot.

    Raises:
        LiveError: the name, the endpoint or the credentials are invalid.
        click.UsageError: an endpoint without credentials, or credentials without an endpoint.
    """
    from colony.runtime.transport.live.robot_address import Remote, local

    if connect in (None, HERE):
        if security is not None:
            raise click.UsageError("--security requires --connect tls/HOST:PORT, the gateway of the robot")
        return local(robot, os.environ)
    from colony.runtime.transport.live.configuration import parse_endpoint
    from colony.runtime.transport.live.security import read_credentials

    assert connect is not None
    parse_endpoint(connect)
    if security is None:
        raise click.UsageError(
            "--connect ENDPOINT requires --security FILE, your credentials for the gateway"
        )
    return Remote(robot=robot, endpoint=connect, credentials=read_credentials(security))


def expect_robot_with_endpoint(robot: str | None, connect: str | None) -> None:
    """Check that a command with a gateway's endpoint also has the name of the robot behind it.

    Raises:
        click.UsageError: the name is missing.
    """
    if robot is None and connect not in (None, HERE):
        raise click.UsageError("--connect ENDPOINT requires --robot NAME, the robot behind the gateway")


def running_robot(robot: str | None, connect: str | None, server: str) -> str:
    """Return the name of the robot; if none is given, of the one on this machine that has this server.

    Raises:
        click.UsageError: several have it, or the robot is behind a gateway.
        click.ClickException: none has it.
    """
    if robot is not None:
        return robot
    from colony.runtime.kit.discovery import running_robots

    expect_robot_with_endpoint(robot, connect)
    names = [name for name, servers in running_robots().items() if server in servers]
    if not names:
        raise click.ClickException(f"no robot with a {server} runs on this machine")
    if len(names) > 1:
        raise click.UsageError(
            f"several robots run on this machine: give --robot NAME; found {', '.join(names)}"
        )
    return names[0]


def running_robot_options(function: F) -> F:
    """Add the options of a command about a robot that runs: `--robot`, `--connect` and `--security`."""
    robot = robot_option("The robot; required if several run on this machine.")
    return robot(connect_option()(security_option()(function)))


@contextmanager
def asking(
    robot: str | None, connect: str | None, security: Path | None, server: str, *, name: str
) -> Iterator[Connection]:
    """Open a connection, called `name`, to a server of a robot that runs.

    A call that the server refuses ends the command with one line and exit code 1.
    """
    from colony.runtime.kit.discovery import session_with
    from colony.runtime.kit.errors import CallRefusedError

    with (
        reporting_connection_errors(),
        session_with(robot_address_of(running_robot(robot, connect, server), connect, security)) as session,
        session.connect(server, name=name) as connection,
    ):
        try:
            yield connection
        except CallRefusedError as problem:
            say(f"colony: error: {problem.message}")
            raise click.exceptions.Exit(EXIT_ERRORS) from None


@contextmanager
def reporting_connection_errors() -> Iterator[None]:
    """If a robot cannot be reached, report that in one line and exit with 2."""
    from colony.runtime.kit.errors import RobotConnectionError
    from colony.runtime.transport.live.run_directory import LiveError

    try:
        yield
    except (LiveError, RobotConnectionError) as problem:
        say(f"colony: error: {problem}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None
