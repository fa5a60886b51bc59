"""`colony stop`: the emergency stop of robots."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.places import (
    HERE,
    connect_option,
    place_of,
    problems_told,
    running_robots,
    security_option,
    session_with,
)
from colony.cli.reporting import say

if TYPE_CHECKING:
    from colony.runtime.kit.connection import Connection


OF_A_BASE = frozenset({"RServer", "Clock", "Leader", "Simulator", "Supervisor"})
"""Where one of these runs there is a base to stop, also while RServer itself is down; a "robot" with none of
them is a data server that robots share."""


@click.command(name="stop", short_help="stop robots at once, in an emergency")
@click.option("--robot", metavar="NAME", help="Only this one; without it, all robots of this machine.")
@click.option("--release", is_flag=True, help="Let the robot be moved again.")
@connect_option()
@security_option()
def command(robot: str | None, release: bool, connect: str | None, security: Path | None) -> None:
    """Stop a robot at once, whatever else goes on, and keep it from moving until it is released.

    The stop is a latch in RServer: it goes before all other calls, holds against every program and
    connection, and survives a restart of the server. Programs go on meanwhile, and drive again after the
    release. Each robot that was stopped has acknowledged it.

    Exit code 0, 1 where a robot did not acknowledge, 2 where there is none.

    \b
    Example:
      colony stop
      colony stop --robot rome --release
      colony stop --robot rome --connect tls/rome.lab:7447 --security ada.toml
    """
    with problems_told():
        names = _robots(robot, connect)
    if release and len(names) > 1:
        raise click.UsageError(f"--release also wants --robot NAME: found {', '.join(names)}")
    failed = False
    for name in names:
        failed |= not _command(name, release, connect, security)
    if failed:
        raise click.exceptions.Exit(EXIT_ERRORS)


def _robots(robot: str | None, connect: str | None) -> list[str]:
    if robot is not None:
        return [robot]
    if connect not in (None, HERE):
        raise click.UsageError("--connect ENDPOINT also wants --robot NAME: a gateway is that of one robot")
    running = running_robots()
    names = [name for name, servers in running.items() if not OF_A_BASE.isdisjoint(servers)]
    if not names:
        beside = f" that has a base; found {', '.join(running)}" if running else ""
        raise click.ClickException(f"no robot runs on this machine{beside}")
    return names


def _command(name: str, release: bool, connect: str | None, security: Path | None) -> bool:
    """Whether the robot has acknowledged."""
    from colony.runtime.fields import RSERVER
    from colony.runtime.kit.errors import CallRefused, ConnectionProblem
    from colony.runtime.library import robot

    with problems_told():
        session = session_with(place_of(name, connect, security))
    with session:
        try:
            with session.connect(RSERVER.name, name="colony stop") as base:
                base.do(robot.release() if release else robot.emergency_stop())
                click.echo(f"{name}: {'released' if release else 'stopped'}{_told(base)}")
        except CallRefused as problem:
            say(f"{name}: error: {problem.message}")
            return False
        except ConnectionProblem as problem:
            say(f"{name}: error: not acknowledged: {problem}")
            return False
    return True


def _told(base: Connection) -> str:
    """Who stopped it first, and what it is in; nothing where this user may not know."""
    from colony.runtime.kit.errors import ConnectionProblem
    from colony.runtime.library import robot

    try:
        found = base.do(robot.arbitration())
    except ConnectionProblem:
        return ""
    by = "" if found.stopped is None else f" by {found.stopped.by}"
    return by + (f"; the run {found.run} goes on" if found.run else "")
