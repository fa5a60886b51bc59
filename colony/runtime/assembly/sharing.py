"""Which clients of a program share a process, and what the processes of a program are called.

No two names are equal, whatever actuators and modules are called: that of the shared process has one part,
that of a client two, that of a module in Python three.
"""

from __future__ import annotations

from typing import NamedTuple

from colony.execute.compiled import Compiled
from colony.execute.needs import ClientKey
from colony.runtime.protocol.fields import DSERVER
from colony.runtime.protocol.topics import activity, client_address

SHARED = "clients"
"""Name of the process that clients share."""


class ClientProcess(NamedTuple):
    """The clients of one process. `shared` tells that it is the one for all clients that do not run apart: of
    a program with a single client, too."""

    clients: tuple[ClientKey, ...]
    shared: bool

    @property
    def name(self) -> str:
        """The name of the process: a client that runs apart gives it its address."""
        return SHARED if self.shared else client_address(*self.clients[0])


def client_processes(compiled: Compiled, *, isolate: bool) -> tuple[ClientProcess, ...]:
    """Return the processes of the clients of a program.

    All clients share one, because modules written in the language can neither crash nor hang; modules in
    Python run elsewhere. Clients of an actuator with `on_loss degrade` run apart, so that losing one does not
    lose the others. With `isolate`, all do.
    """
    apart = {a.name for a in compiled.robot.actuators if isolate or a.on_loss == "degrade"}
    keys = [(actuator, module) for actuator, module, _ in compiled.clients]
    shared = tuple(key for key in keys if key[0] not in apart)
    return (
        *((ClientProcess(shared, shared=True),) if shared else ()),
        *(ClientProcess((key,), shared=False) for key in keys if key[0] in apart),
    )


def announcer_process(module: str) -> str:
    """Return the name of the process of a module in Python: the address of its announcer."""
    return activity(DSERVER.name, module)
