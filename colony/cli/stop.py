"""`colony stop`: the emergency stop of robots."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.reporting import say
from colony.cli.robot_options import (
    connect_option,
    expect_robot_with_endpoint,
    reporting_connection_errors,
    robot_address_of,
    robot_option,
    security_option,
)
from colony.runtime.kit.discovery import running_robots, session_with

if TYPE_CHECKING:
    from colony.runtime.kit.connection import Session


BASE_SERVERS = frozenset({"RServer", "Clock", "Leader", "Simulator", "Supervisor"})
"""Servers whose presence means that there is a base to stop, even while RServer itself is down.

A robot's name without any of them belongs to a data server that several robots share.
"""


@click.command(name="stop", short_help="stop robots immediately, in an emergency")
@robot_option("Stop only this robot. [default: all robots on this machine]")
@click.option("--release", is_flag=True, help="Release the stop, so that the robot can move again.")
@connect_option()
@security_option()
def command(robot: str | None, release: bool, connect: str | None, security: Path | None) -> None:
    """Stop a robot immediately, and keep it from moving until the stop is released.

    The stop goes to every server that moves hardware, ahead of all other calls, and to the Clock, which saves
    it to a file and repeats it in every frame. It overrides every program and connection, and survives the
    death of any process. Programs keep running, and drive again after the release.

    What does not answer is sent the stop for 10 s more: it may be frozen, or be started again just now.

    Exit code: 0 if the Clock has saved the stop and every running server that moves hardware has acknowledged
    it; 1 if not (the robot may have stopped anyway); 2 if the robot does not exist or cannot be reached. With
    --release: 0 if the Clock has released the stop, otherwise 1 or 2.

    \b
    Example:
      colony stop
      colony stop --robot rome --release
      colony stop --robot rome --connect tls/rome.lab:7447 --security ada.toml
    """
    with reporting_connection_errors():
        names = _robots(robot, connect)
    if release and len(names) > 1:
        raise click.UsageError(f"--release requires --robot NAME; found {', '.join(names)}")
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(max_workers=len(names)) as pool:  # robots are stopped in parallel
        codes = list(pool.map(lambda name: _command(name, release, connect, security), names))
    if any(codes):
        raise click.exceptions.Exit(max(codes) if len(codes) == 1 else EXIT_ERRORS)


def _robots(robot: str | None, connect: str | None) -> list[str]:
    if robot is not None:
        if connect is None and robot not in running_robots():
            found = ", ".join(running_robots()) or "none"
            raise click.ClickException(
                f"no process of `{robot}` runs on this machine (running robots: {found})"
            )
        return [robot]
    expect_robot_with_endpoint(robot, connect)
    running = running_robots()
    names = [name for name, servers in running.items() if not BASE_SERVERS.isdisjoint(servers)]
    if not names:
        details = f" that has a base; found {', '.join(running)}" if running else ""
        raise click.ClickException(f"no robot runs on this machine{details}")
    return names


def _command(name: str, release: bool, connect: str | None, security: Path | None) -> int:
    """Stop or release one robot; return the exit code for it."""
    from colony.runtime.kit.errors import RobotConnectionError
    from colony.runtime.transport.live.run_directory import LiveError

    try:
        session = session_with(robot_address_of(name, connect, security))
    except (LiveError, RobotConnectionError) as problem:
        say(f"colony: error: {problem}")
        return EXIT_MISUSE
    with session:
        try:
            done = _release(name, session) if release else stop_robot(name, session)
        except RobotConnectionError as problem:
            say(f"{name}: error: {problem}")
            return EXIT_ERRORS
    return 0 if done else EXIT_ERRORS


def stop_robot(name: str, session: Session) -> bool:
    """Stop a robot in an emergency, and print what has become of it; return True if the stop is kept."""
    from colony.runtime.kit.emergency import INSIST_S, StopButton

    with StopButton(session, name="colony stop") as button:
        pressed = button.press()
        if pressed.unanswered:
            problems = "; ".join(pressed.problems.values())
            say(f"{name}: {problems}; pressing on for {INSIST_S:g} s (Ctrl-C gives up)")
        pressed = button.insist(pressed)
    for problem in pressed.problems.values():
        say(f"{name}: error: {problem}")
    if pressed.acknowledged:
        by, run = _circumstances(session)
        _print_line(f"{name}: stopped{by}; acknowledged by {', '.join(pressed.acknowledged)}{run}")
    return pressed.kept


def _release(name: str, session: Session) -> bool:
    from colony.runtime.library.clock import release
    from colony.runtime.protocol.topics import CLOCK

    with session.connect(CLOCK, name="colony stop") as clock:
        clock.do(release())
    _print_line(f"{name}: released{_circumstances(session)[1]}")
    return True


def _print_line(text: str) -> None:
    """Print a line; failing to print it must not keep the other robots from being stopped."""
    try:
        click.echo(text)
    except OSError as problem:
        say(f"{text} (standard output: {problem.strerror})")


def _circumstances(session: Session) -> tuple[str, str]:
    """Return phrases that name the user who stopped the robot first, and its run; empty if unknown."""
    from colony.runtime.kit.errors import RobotConnectionError
    from colony.runtime.library.clock import participants
    from colony.runtime.protocol.deployment import LIMITS_RUN
    from colony.runtime.protocol.topics import CLOCK

    if CLOCK not in session.servers():
        return "", ""
    try:
        with session.connect(CLOCK, name="colony stop") as clock:
            status = clock.do(participants())
    except RobotConnectionError:
        return "", ""
    by = "" if status.stopped is None else f" by {status.stopped.by}"
    has_program = status.run and status.run != LIMITS_RUN
    return by, f"; the run {status.run} continues" if has_program else ""
