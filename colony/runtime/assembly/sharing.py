"""Which clients of a program share a process."""

from __future__ import annotations

from colony.execute.compiled import Compiled
from colony.execute.needs import ClientKey
from colony.runtime.protocol.topics import client_address


def shared_clients(compiled: Compiled, *, isolate: bool) -> tuple[tuple[ClientKey, ...], ...]:
    """Return the clients of each process: all share one, as nothing that is written in the language can crash
    or hang; modules in Python run elsewhere.

    Clients of an actuator with `on_loss degrade` are alone, since they are to be lost one by one. With
    `isolate`, all are.
    """
    alone = {a.name for a in compiled.robot.actuators if isolate or a.on_loss == "degrade"}
    keys = [(actuator, module) for actuator, module, _ in compiled.clients]
    shared = tuple(key for key in keys if key[0] not in alone)
    return (*((shared,) if shared else ()), *((key,) for key in keys if key[0] in alone))


def name_of_process(clients: tuple[ClientKey, ...]) -> str:
    """Return what a process of clients is called: the address of its client, where it has one alone."""
    return client_address(*clients[0]) if len(clients) == 1 else "clients"
