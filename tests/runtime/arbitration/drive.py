"""An arbiter of one actuator with three clients, and what comes in to it."""

from __future__ import annotations

from colony.ir.program import Actuator, ActuatorField
from colony.ir.servers import SPEED
from colony.runtime.arbitration.arbiter import Arbiter, Timing
from colony.runtime.protocol.bindings import ActuatorBinding
from colony.runtime.protocol.deployment import ActuatorSpec, actuator_spec
from colony.runtime.protocol.messages import Request, Tick
from tests.kit.node_stage import MS

TIMES = Timing(deadline_ns=40 * MS, grace_ns=5 * MS)
PLACES = ("back_off", "avoid", "cruise")
DRIVE = Actuator(
    name="drive",
    fields=(
        ActuatorField(name="velocity", type=SPEED, low=-600.0, high=600.0),
        ActuatorField(name="turn", type=SPEED),
    ),
    server="RServer",
    command="drive",
    idle=(0.0, 0.0),
)
COMMANDS = {"back_off": (-200.0, 15.0), "avoid": (80.0, 30.0), "cruise": (300.0, 0.0)}


def ranked(*clients: str) -> tuple[tuple[str, int], ...]:
    """Return clients with priorities that count down to one."""
    return tuple(zip(clients, range(len(clients), 0, -1), strict=True))


def table(actuator: Actuator, *clients: str) -> ActuatorSpec:
    """Return an actuator with these clients, as it is deployed."""
    binding = ActuatorBinding(
        actuator=actuator.name, server=actuator.server, command=actuator.command, field_indices=()
    )
    return actuator_spec(actuator, binding, ranked(*clients))


def request(client: str, bid: str = "silent", k: int = 0) -> Request:
    values = COMMANDS.get(client, (1.0, 1.0)) if bid == "command" else None
    return Request(k=k, actuator="drive", client=client, bid=bid, values=values)  # type: ignore[arg-type]


def arbiter() -> Arbiter:
    return Arbiter(table(DRIVE, *PLACES), TIMES)


def tick(k: int = 0) -> Tick:
    return Tick(k=k, t_ns=k * 50 * MS)
