"""The limits of a robot's description, which hold while no program runs.

They are a program without modules: its only clients are those of the bounds. Its run is the Clock's resident
one, so in no frame may a server believe that the robot has no limits: a server to which the run has not been
deployed yet commands nothing in its frames. The script `lead_limits` deploys it to the servers of actuators,
again after each restart and after each program. A program's deployment takes its place, with bounds that
contain those of the description.
"""

from __future__ import annotations

from collections.abc import Iterable

from colony.execute.compiled import Compiled
from colony.execute.needs import BOUNDS, ClientKey, clients_view, needs_of_clients
from colony.ir.program import Robot
from colony.ir.servers import (
    COMMON_SERVERS,
    DSERVER,
    OMNIDIRECTIONAL_RSERVER,
    CommandSpec,
    FieldSpec,
    ParameterSpec,
    ServerSpec,
)
from colony.ir.types import Array, Quantity
from colony.runtime.assembly.nodes import build_clients
from colony.runtime.clients.client import ClientNode
from colony.runtime.kit.description import describe, server_spec
from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError
from colony.runtime.kit.once import Report
from colony.runtime.kit.script import Do, Script, do, sleep
from colony.runtime.library import clock
from colony.runtime.protocol.bindings import Bindings, bind, bound_servers
from colony.runtime.protocol.deployment import LIMITS_RUN, Deployment, deployment, limited_actuators
from colony.runtime.protocol.topics import CLOCK
from colony.text.diagnostics import DiagnosticError
from colony.text.units import NUMBER

LIMITS = "Limits"
"""Name of the process of a description's limits."""

DEPLOY_INTERVAL_S = 0.25
"""Seconds between two rounds in which the limits are deployed where they are not."""

CALL_TIMEOUT_S = 1.0
"""Seconds to wait for the answer of a server: one that is frozen must not delay the others for long."""

BUSY = "busy"
"""Code of the refusal of a server that another program leads."""

_KNOWN = (OMNIDIRECTIONAL_RSERVER, *COMMON_SERVERS)
"""The servers that are known without a body; others describe themselves.

RServer has all that any base has: it refuses the deployment of a program that drives another base sideways.
"""

_KNOWN_NAMES = frozenset(server.name for server in _KNOWN)


def limit_clients(compiled: Compiled) -> tuple[ClientKey, ...]:
    """Return the clients of a description's limits; none if it has no limits."""
    return tuple((actuator, BOUNDS) for actuator in limited_actuators(compiled))


def limit_nodes(compiled: Compiled, bindings: Bindings) -> tuple[ClientNode, ...]:
    """Return the nodes of the clients of the limits; clients of a program may have the same names."""
    nodes = build_clients(compiled, bindings, limit_clients(compiled), LIMITS_RUN)
    for node in nodes:
        node.address = f"{LIMITS}/{node.address}"
    return nodes


def limit_bindings(robot: Robot, described: Iterable[ServerSpec] = ()) -> Bindings:
    """Return the bindings of a description.

    Args:
        robot: the robot of the description.
        described: servers as they describe themselves; others are assumed to be as the description says.

    Raises:
        DiagnosticError: a sensor or actuator does not fit its server.
    """
    known = {spec.name: spec for spec in (*_KNOWN, *described)}
    assumed = (_assumed(robot, name) for name in bound_servers(robot) if name not in known)
    return bind(robot, (*known.values(), *assumed))


def limit_deployment(compiled: Compiled, described: Iterable[ServerSpec] = ()) -> Deployment:
    """Return the deployment of a description's limits; `described` is as for `limit_bindings`."""
    return deployment(
        compiled,
        limit_bindings(compiled.robot, described),
        run=LIMITS_RUN,
        seed=0,
        servers=bound_servers(compiled.robot),
        resident=True,
    )


def limit_servers(compiled: Compiled) -> tuple[str, ...]:
    """Return the servers to which the limits are deployed: those of actuators.

    DServer is one only if limits bind its actuators or read its variables, because a deployment there ends
    the checkpoints of the run before.
    """
    robot, clients = compiled.robot, limit_clients(compiled)
    limited = {actuator for actuator, _ in clients}
    read = {
        s for needs in needs_of_clients(clients_view(compiled.code, clients)).values() for s in needs.sensors
    }
    needs_data = any(s.server == DSERVER.name and s.name in read for s in robot.sensors)
    needs_data |= any(a.server == DSERVER.name and a.name in limited for a in robot.actuators)
    servers = dict.fromkeys(a.server for a in robot.actuators if a.server != DSERVER.name)
    return (*servers, *((DSERVER.name,) if needs_data else ()))


def lead_limits(compiled: Compiled, report: Report = lambda text: None) -> Script:
    """Keep the limits deployed while no program runs; the script never ends by itself.

    Args:
        compiled: the limits.
        report: callback for the reason why a server refuses them, which then commands nothing.
    """
    deployments = {
        name: limit_deployment(compiled) for name in limit_servers(compiled) if name in _KNOWN_NAMES
    }
    refusals: dict[str, str] = {}
    while True:
        try:
            participants = yield from do(CLOCK, clock.participants())
            is_resident = participants.run == LIMITS_RUN
        except RobotConnectionError:
            is_resident = False
        for server in limit_servers(compiled) if is_resident else ():
            try:
                if server not in deployments:
                    spec = server_spec((yield Do(server, describe())))
                    deployments[server] = limit_deployment(compiled, (spec,))
                yield from do(server, clock.deploy(deployments[server]))
                refusals.pop(server, None)
            except (CallRefusedError, ValueError, DiagnosticError) as problem:
                if server not in _KNOWN_NAMES:
                    deployments.pop(server, None)  # another server may have its name now
                if getattr(problem, "code", "") == BUSY:  # a program has begun
                    continue
                if (reason := str(problem)) != refusals.get(server):
                    refusals[server] = reason
                    report(f"the limits of {compiled.robot.name} do not hold at {server}: {reason}")
            except RobotConnectionError:
                continue  # it is not there: then it commands nothing
        yield from sleep(DEPLOY_INTERVAL_S)


def _assumed(robot: Robot, server: str) -> ServerSpec:
    """Return a server that fits the description."""
    fields: dict[str, FieldSpec] = {}
    for sensor in robot.sensors:
        if sensor.server == server and sensor.sent is None:
            found = fields.get(sensor.field)
            if found is None or _is_plain(found):
                fields[sensor.field] = FieldSpec(sensor.field, sensor.type, "")
    commands = (
        CommandSpec(a.command, tuple(ParameterSpec(f.name, f.type, "") for f in a.fields))
        for a in robot.actuators
        if a.server == server
    )
    return ServerSpec(server, fields=tuple(fields.values()), commands=tuple(commands))


def _is_plain(field: FieldSpec) -> bool:
    """Return True if a field is a plain number, as which any quantity can be read."""
    element = field.type.element if isinstance(field.type, Array) else field.type
    return isinstance(element, Quantity) and element == Quantity(NUMBER)
