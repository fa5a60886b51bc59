"""`colony sim hold`: readings of simulated devices that are held by hand, such as a pressed button."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.reporting import say
from colony.cli.robot_options import reporting_connection_errors, robot_option
from colony.cli.run.options import OptionError, duration_ns, parsed

if TYPE_CHECKING:
    from colony.ir.program import Sensor
    from colony.runs.scenario import ReadingChange
    from colony.runtime.kit.connection import Session

POLL_INTERVAL_S = 0.05
"""Seconds between two checks whether it is time to end."""


@click.command("hold", short_help="hold what devices read, such as a pressed button")
@click.argument("settings", metavar="SERVER.FIELD=VALUE...", nargs=-1, required=True)
@robot_option("The robot; required if several simulated ones run on this machine.")
@click.option(
    "--for",
    "length_ns",
    metavar="TIME",
    callback=parsed(partial(duration_ns, option="--for")),
    help="The time to hold them: 3 (in seconds), 90s or 2min.",
)
def hold_command(settings: tuple[str, ...], robot: str | None, length_ns: int | None) -> None:
    """Hold fields of a simulated robot's devices at values, until Ctrl-C or for a time.

    The robot is one of `colony serve` or `colony run --processes`, on this machine. VALUE is that of
    `colony run --set`: a number has a unit, or the one that the interface declares for the field (base units
    if it declares none); one value fills an array; `missing` is none. Afterwards the devices read what they
    did before. What the base and the ring of sonars measure cannot be held.

    Exit code: 0 at the end, 1 if the simulator refuses, 2 for misuse.

    \b
    Example:
      colony sim hold Panel.estop=true
      colony sim hold Panel.estop=true Lift.load="12 kg" --robot amr --for 3s
    """
    from colony.cli.interruption import interruptible
    from colony.cli.run.simulator import FieldGiver
    from colony.runs.scenario import GivenValueError
    from colony.runs.spec import RunAbortedError
    from colony.runtime.kit.discovery import session_with
    from colony.runtime.transport.live.robot_address import local
    from colony.text.wording import duration_text

    try:
        with reporting_connection_errors():
            robot_address = local(_simulated(robot), os.environ)
            with session_with(robot_address) as session:
                changes = _changes(robot_address.robot, session, settings)
    except GivenValueError as bad:
        raise OptionError(str(bad)) from None
    with (
        interruptible("ending") as interrupted,
        closing(FieldGiver(robot_address, changes, lambda: None)) as giver,
    ):
        held_ns: int | None = None
        while not interrupted():
            try:
                given = giver.poll()
            except RunAbortedError as problem:
                say(f"colony: error: {problem}")
                raise click.exceptions.Exit(EXIT_ERRORS) from None
            if given and held_ns is None:
                held_ns = time.monotonic_ns()
                end = "Ctrl-C ends it" if length_ns is None else f"ends after {duration_text(length_ns)}"
                say(f"{robot_address.robot}: {', '.join(settings)}; {end}")
            if None not in (held_ns, length_ns) and time.monotonic_ns() - held_ns >= length_ns:  # type: ignore[operator]
                return
            time.sleep(POLL_INTERVAL_S)


def _simulated(robot: str | None) -> str:
    """Return the name of the simulated robot that runs on this machine."""
    from colony.runtime.kit.discovery import running_robots
    from colony.sim.plant.child import SIMULATOR

    names = [name for name, processes in running_robots().items() if SIMULATOR in processes]
    if robot is not None and robot not in names:
        raise click.ClickException(f"no {SIMULATOR} of `{robot}` runs on this machine")
    if robot is None and not names:
        raise click.ClickException(f"no {SIMULATOR} runs on this machine")
    if robot is None and len(names) > 1:
        raise click.UsageError(
            f"several simulated robots run on this machine: give --robot NAME; found {', '.join(names)}"
        )
    return names[0] if robot is None else robot


def _changes(name: str, session: Session, settings: tuple[str, ...]) -> tuple[ReadingChange, ...]:
    """Return what the texts `SERVER.FIELD=VALUE` say, for the fields that the servers describe.

    Raises:
        GivenValueError: a text is not of this form, or a server has no such field.
        RobotConnectionError: a server does not run.
    """
    from colony.ir.program import Robot
    from colony.ir.servers import DSERVER
    from colony.runs.scenario import GivenValueError, expect_givable, setting

    servers: dict[str, None] = {}
    for text in settings:
        place = text.partition("=")[0].strip()
        server, dot, _ = place.partition(".")
        if not dot:
            raise GivenValueError(f"found `{text}`; expected SERVER.FIELD=VALUE, such as Panel.estop=true")
        if server == DSERVER.name:
            raise GivenValueError(f"found `{text}`; a variable of {server} is set by `colony data set`")
        expect_givable(place, server)
        servers[server] = None
    sensors = tuple(sensor for server in servers for sensor in _fields(session, server))
    robot = Robot(name=name, sensors=sensors)
    return tuple(setting(robot, text) for text in settings)


def _fields(session: Session, server: str) -> Iterable[Sensor]:
    """Yield a sensor for each field that a server describes, in the unit that the interface declares."""
    from colony.runs.scenario import described_sensor
    from colony.runtime.kit.description import describe, server_spec

    with session.connect(server, name="colony sim hold") as connection:
        spec = server_spec(connection.do(describe()))
    for field in spec.fields:
        yield described_sensor(server, field)
