"""`colony ps`: the running robots with their servers, connections and runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.robot_options import (
    HERE,
    connect_option,
    expect_robot_with_endpoint,
    reporting_connection_errors,
    robot_address_of,
    robot_option,
    security_option,
)
from colony.runtime.kit.discovery import running_robots, session_with
from colony.text.wording import printable

if TYPE_CHECKING:
    from colony.runtime.kit.robot_state import RobotState, ServerState
    from colony.runtime.library.actuator import Arbitration
    from colony.runtime.library.clock import Participants
    from colony.runtime.library.leader import RunStatus


@click.command(name="ps", short_help="show the running robots and their state")
@robot_option("Show only this robot; required behind a gateway.")
@connect_option()
@security_option()
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(robot: str | None, connect: str | None, security: Path | None, format_: str) -> None:
    """Show the robots that run on this machine: the state of their servers, the limits that the servers
    have reached, drivers that fail, connections and their priorities, an emergency stop, and the clients of
    the run.

    A client is alive, late (its request for the newest frame missed the deadline) or lost (it sent nothing
    for the length of its lease). The table counts the frames in which a client was on time, late or lost, and
    its restarts. If its process died, the table shows the last line of its output.

    Exit code: 0, or 1 if no robot runs.

    \b
    Example:
      colony ps
      colony ps --robot rome --format json
      colony ps --robot rome --connect tls/rome.lab:7447 --security ada.toml
    """
    with reporting_connection_errors():
        states = _states(robot, connect, security)
    if format_ == "json":
        from colony.runtime.kit.robot_state import as_json

        click.echo(as_json(states))
    elif not states:
        click.echo(f"no process of {robot} runs" if robot else "no robot runs on this machine")
    else:
        for state in states:
            click.echo("\n".join(map(printable, _lines(state))))
    if not any(server.state != "down" for state in states for server in state.servers):
        raise click.exceptions.Exit(EXIT_ERRORS)


def _states(robot: str | None, connect: str | None, security: Path | None) -> list[RobotState]:
    expect_robot_with_endpoint(robot, connect)
    from colony.runtime.kit.robot_state import state_of

    names = [robot] if robot is not None else list(running_robots())
    if connect in (None, HERE):
        names = [name for name in names if name in running_robots()]
    states = []
    for name in names:
        robot_address = robot_address_of(name, connect, security)
        with session_with(robot_address) as session:
            states.append(state_of(session, robot_address))
    return states


# --- for people ----------------------------------------------------------------------------------


def _lines(state: RobotState) -> Iterator[str]:
    yield state.robot
    width = max(len(s.server) for s in state.servers)
    for server in state.servers:
        yield f"  {server.server:<{width}}  {_server(server)}"
    yield from (f"  {line}" for line in _emergency(state))
    if state.arbitration is not None:
        yield from (f"  {line}" for line in _arbitration(state))
    for name, arbitration in state.actuators.items():
        yield from (f"  {line}" for line in _actuators(name, arbitration))
    if state.run is not None:
        yield from (f"  {line}" for line in _run(state.run, _priorities(state)))
        yield from (f"  {line}" for line in _processes(state.run, {s.server for s in state.servers}))
    elif state.participants is not None:
        yield f"  no program runs{_resident(state.participants)}; frame {state.participants.k}"
    connections = [(s.server, c) for s in state.servers for c in s.connections]
    if connections:
        yield "  connections"
        rows = [("server", "client", "priority", "calls", "refused", "connection")]
        rows += [
            (server, c.name, str(c.priority), str(c.calls), str(c.problems), c.connection)
            for server, c in connections
        ]
        yield from _table(rows)


def _server(server: ServerState) -> str:
    parts = [server.state]
    if server.process is not None:
        parts.append(f"process {server.process}")
    if server.malformed:
        parts.append(f"{server.malformed} malformed messages")
    parts += server.full
    if server.opening:
        parts.append("the device is being opened")
    parts += (f"FAILS: {text}" for text in server.failing)
    if server.problem is not None:
        parts.append(server.problem)
    return ", ".join(parts)


def _emergency(state: RobotState) -> Iterator[str]:
    stops = [part.stopped for part in (state.participants, state.arbitration) if part is not None]
    if stopped := next((stop for stop in stops if stop is not None), None):
        yield f"EMERGENCY STOP, by {stopped.by}; release it with `colony stop --release`"
    if state.participants is not None and state.participants.trouble is not None:
        yield f"trouble: {state.participants.trouble}"


def _arbitration(state: RobotState) -> Iterator[str]:
    arbitration = state.arbitration
    assert arbitration is not None
    if arbitration.lock_holder is not None:
        yield f"locked by {arbitration.lock_holder}"
    yield f"the base is commanded by {arbitration.acting or 'nobody'}"
    for outside in arbitration.outside:
        if outside.unlimited:
            yield f"{outside.name} ({outside.connection}) ignores the limits of the program"


def _actuators(server: str, arbitration: Arbitration) -> Iterator[str]:
    """Yield who commands the actuators of a server of users."""
    if arbitration.lock_holder is not None:
        yield f"{server} is locked by {arbitration.lock_holder}"
    for actuator in arbitration.actuators:
        yield f"{server}.{actuator.command} is commanded by {actuator.acting or 'nobody'}"
    for outside in dict.fromkeys((o.name, o.connection) for o in arbitration.outside if o.unlimited):
        yield f"{outside[0]} ({outside[1]}) ignores the limits of the program at {server}"


def _priorities(state: RobotState) -> dict[str, int]:
    found = {
        f"{actuator.name}/{client.name}": client.priority
        for arbitration in state.actuators.values()
        for actuator in arbitration.actuators
        for client in actuator.clients
    }
    base = () if state.arbitration is None else state.arbitration.actuators
    return found | {f"{a.name}/{c.name}": c.priority for a in base for c in a.clients}


def _run(run: RunStatus, priorities: dict[str, int]) -> Iterator[str]:
    params = f" with the params of {run.params}" if run.params else ""
    yield f"run {run.run} of {run.file}{params}, led by process {run.process}"
    text = f"frame {run.k}, {run.frames} decided"
    if run.restarts:
        text += f", memory was reset {run.restarts} times"
    if run.disagreements:
        text += f", {run.disagreements} DISAGREE WITH THE PROGRAM"
    yield text
    if run.still:
        yield f"nothing moves: {run.still}"
    for sensor in run.faults:
        yield f"SENSOR FAULT: `{sensor}` has a value of the wrong type"
    rows = [("client", "priority", "state", "on time", "late", "lost", "restarts", "last error")]
    rows += [
        (
            c.address,
            str(priorities.get(c.address, "")),
            c.standing,
            str(c.on_time),
            str(c.late),
            str(c.lost),
            str(c.restarts),
            c.last_error or "",
        )
        for c in run.clients
    ]
    yield from _table(rows)


def _resident(participants: Participants) -> str:
    """Return what is to say about the limits that hold without a program."""
    from colony.runtime.protocol.deployment import LIMITS_RUN

    if participants.run != LIMITS_RUN:
        return ""
    lost = [client.client for client in participants.clients if not client.lives]
    missing = f"; LOST: {', '.join(lost)}, so nobody drives" if lost else ""
    return f", but the limits of {participants.program} hold{missing}"


def _processes(run: RunStatus, servers: set[str]) -> Iterator[str]:
    """Yield the processes of a run that are not servers: those of clients and of Python modules."""
    rows = [(name, str(pid)) for name, pid in run.processes.items() if name not in servers]
    if rows:
        yield from _table([("process", "id"), *rows])


def _table(rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    rows = list(rows)
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        yield "    " + "  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip()
