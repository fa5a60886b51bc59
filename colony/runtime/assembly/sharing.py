"""The assignment of a program's clients to processes, and the names of the processes.

All process names are different, whatever the names of actuators and modules: the name of the shared process
has one part, that of a client two, and that of a Python module three.
"""

from __future__ import annotations

from typing import NamedTuple

from colony.execute.compiled import Compiled
from colony.execute.needs import BOUNDS, ClientKey
from colony.ir.servers import DSERVER
from colony.runtime.protocol.deployment import limited_actuators
from colony.runtime.protocol.topics import activity, client_address

SHARED = "clients"
"""Name of the process that clients share."""


class ClientProcess(NamedTuple):
    """The clients of one process.

    `shared` is True for the process of all clients that are not isolated, even if there is only one.
    """

    clients: tuple[ClientKey, ...]
    shared: bool

    @property
    def name(self) -> str:
        """The name of the process; the process of an isolated client is named after the client's address."""
        return SHARED if self.shared else client_address(*self.clients[0])


def client_processes(compiled: Compiled, *, isolate: bool) -> tuple[ClientProcess, ...]:
    """Return the processes of the clients of a program.

    Modules written in the language can neither crash nor hang, and Python modules run elsewhere, so all
    clients share one process. Clients of an actuator with `on_loss degrade` are isolated, each in its own
    process, so that losing one does not lose the others. With `isolate`, all clients are. The client of an
    actuator's bounds only concerns commands from outside the network, so only `isolate` isolates it.
    """
    isolated = {a.name for a in compiled.robot.actuators if isolate or a.on_loss == "degrade"}
    keys = [(actuator, module) for actuator, module, _ in compiled.clients]
    bounds = [(actuator, BOUNDS) for actuator in limited_actuators(compiled)]
    shared = (*(key for key in keys if key[0] not in isolated), *(() if isolate else bounds))
    apart = (*(key for key in keys if key[0] in isolated), *(bounds if isolate else ()))
    return (
        *((ClientProcess(shared, shared=True),) if shared else ()),
        *(ClientProcess((key,), shared=False) for key in apart),
    )


def announcer_process_name(module: str) -> str:
    """Return the name of a Python module's process: the address of its announcer."""
    return activity(DSERVER.name, module)
