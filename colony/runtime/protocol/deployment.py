"""Deployment of a program: the part that servers must know, such as clients, priorities and frame period.

A deployment is a message, so that the program itself may run anywhere. The leader of a run deploys the
program at the Clock and at every server with a bound actuator, and again at each of these that restarts.
While the leader is connected, no other process may deploy.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Literal

import msgspec

from colony.execute.compiled import Compiled
from colony.ir.program import Actuator
from colony.ir.types import Bool, ScalarValue
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import ActuatorBinding, Bindings
from colony.runtime.protocol.fields import DSERVER
from colony.runtime.protocol.plausibility import FRAME_NUMBER_NS

MIN_FRAME_NS = FRAME_NUMBER_NS
MAX_FRAME_NS = 3_600_000_000_000
"""Limits of a robot's frame period, in nanoseconds.

Faster frames would run out of numbers (see `clock.py`); with slower ones a lost client would go unnoticed for
hours.
"""

MAX_DEPLOYMENT_BYTES = 256 * 1024
"""Byte limit of a deployment, in msgpack, that the method `deploy` of a server decodes."""


MAX_CLIENTS = 2000
"""Largest number of clients of all actuators of a program: each frame carries the fate of every client."""

MAX_ITEMS = 1000
"""Largest number, each, of actuators, fields of one, Python modules, servers and variables of a deployment.
"""

MAX_REPORTED = 5
"""Largest number of names or priorities listed in a message."""

MAX_NAME_LENGTH = 255
"""Largest number of characters of any name in a deployment."""


class FieldTable(msgspec.Struct, frozen=True, kw_only=True):
    """A field of an actuator; `low` and `high` are in base units."""

    name: str
    kind: Literal["bool", "number"]
    factor: float
    low: float | None
    high: float | None


class ActuatorTable(msgspec.Struct, frozen=True, kw_only=True):
    """An actuator as its server arbitrates it.

    `places[i]` is the index of the field for parameter i of the server's `command`, None if that is 0; empty
    if the server takes the fields as they are. `idle` is in base units, None for `idle hold`. `clients` are
    names and priorities, highest first.
    """

    name: str
    fields: tuple[FieldTable, ...]
    server: str
    command: str
    places: tuple[int | None, ...]
    idle: tuple[ScalarValue, ...] | None
    on_loss: Literal["stop", "degrade"]
    clients: tuple[tuple[str, int], ...]


class Deployment(msgspec.Struct, frozen=True, kw_only=True):
    """A program on a robot. `run` is unique to the run; "" stands for a robot without a program.

    `announced` are the modules in Python whose answers DServer relays; `seed` is that of `Runtime.random`;
    `servers` are read besides those that every robot has. `lockstep`: each frame begins as soon as the one
    before it is decided, instead of after `frame_ns`. `reads` are the variables that the program's sensors
    are bound to: DServer's frames show them.
    """

    run: str
    program: str
    frame_ns: int
    seed: int
    actuators: tuple[ActuatorTable, ...]
    announced: tuple[str, ...] = ()
    lockstep: bool = False
    servers: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()


def deployment(
    compiled: Compiled,
    bindings: Bindings,
    *,
    run: str,
    seed: int,
    lockstep: bool = False,
    servers: tuple[str, ...] = (),
) -> Deployment:
    """Return the deployment of a compiled program."""
    return Deployment(
        run=run,
        program=compiled.name,
        frame_ns=compiled.frame_ns,
        seed=seed,
        actuators=tuple(
            actuator_table(one.actuator, binding, tuple((c.module, c.priority) for c in one.clients))
            for one, binding in zip(compiled.code.actuators, bindings.actuators, strict=True)
        ),
        announced=compiled.announced,
        lockstep=lockstep,
        servers=servers,
        reads=variables_read(bindings),
    )


def variables_read(bindings: Bindings) -> tuple[str, ...]:
    """Return the variables of DServer that sensors are bound to, each once, in the order declared."""
    return tuple(dict.fromkeys(b.field for b in bindings.sensors if b.server == DSERVER.name))


def actuators_of(deployed: Deployment, server: str) -> tuple[ActuatorTable, ...]:
    """Return the actuators that are bound to a server."""
    return tuple(table for table in deployed.actuators if table.server == server)


def client_addresses(deployed: Deployment) -> tuple[tuple[str, str], ...]:
    """Return every client's address, and the server that receives its requests."""
    return tuple(
        (topics.client_address(table.name, client), table.server)
        for table in deployed.actuators
        for client, _ in table.clients
    )


def problems(deployed: Deployment) -> tuple[str, ...]:
    """Return the reasons why a deployment is impossible; empty if it is valid.

    Reasons are a missing name, a frame period out of range, two clients with one name or priority, and
    exceeded limits. Limits come first, so that nothing large is examined.
    """
    return tuple(_too_many(deployed)) or tuple(_problems(deployed))


def _too_many(deployed: Deployment) -> Iterator[str]:
    tables = deployed.actuators
    counts = [
        ("clients", sum(len(table.clients) for table in tables), MAX_CLIENTS),
        ("actuators", len(tables), MAX_ITEMS),
        ("fields of an actuator", max((len(t.fields) for t in tables), default=0), MAX_ITEMS),
        ("modules in Python", len(deployed.announced), MAX_ITEMS),
        ("servers", len(deployed.servers), MAX_ITEMS),
        ("variables", len(deployed.reads), MAX_ITEMS),
    ]
    for what, count, most in counts:
        if count > most:
            yield f"{count} {what}; expected at most {most}"
    for name in (deployed.run, deployed.program, *deployed.announced, *deployed.servers, *deployed.reads):
        if len(name) > MAX_NAME_LENGTH:
            yield f"the name `{name[:20]}...` has {len(name)} characters; expected at most {MAX_NAME_LENGTH}"


def _problems(deployed: Deployment) -> Iterator[str]:
    if not deployed.run:
        yield "a run without a name"
    if not MIN_FRAME_NS <= deployed.frame_ns <= MAX_FRAME_NS:
        expected = f"expected {MIN_FRAME_NS} to {MAX_FRAME_NS}"
        yield f"a frame of {deployed.frame_ns} ns; {expected}"
    for table in deployed.actuators:
        yield from _problems_of(table)


def _problems_of(table: ActuatorTable) -> Iterator[str]:
    for what, index in (("name", 0), ("priority", 1)):
        counted = Counter(client[index] for client in table.clients)
        for duplicate in sorted(str(x) for x, count in counted.items() if count > 1)[:MAX_REPORTED]:
            yield f"{table.name}: two clients have the {what} {duplicate}"
    if any(len(name) > MAX_NAME_LENGTH for name, _ in table.clients):
        yield f"{table.name}: the name of a client has more than {MAX_NAME_LENGTH} characters"
    if table.idle is not None and len(table.idle) != len(table.fields):
        yield f"{table.name}: an idle command of {len(table.idle)} values, not {len(table.fields)}"


def actuator_table(
    actuator: Actuator, binding: ActuatorBinding, clients: tuple[tuple[str, int], ...]
) -> ActuatorTable:
    """Return the actuator's table for the server that it is bound to."""
    return ActuatorTable(
        name=actuator.name,
        fields=tuple(
            FieldTable(
                name=f.name,
                kind="bool" if isinstance(f.type, Bool) else "number",
                factor=f.factor,
                low=f.low,
                high=f.high,
            )
            for f in actuator.fields
        ),
        server=binding.server,
        command=binding.command,
        places=binding.places,
        idle=actuator.idle,
        on_loss=actuator.on_loss,
        clients=clients,
    )
