"""The processes that a compiled program asks for, whatever robot they run on: its clients, the announcers of
its modules in Python, and the observer."""

from __future__ import annotations

from dataclasses import dataclass

from colony.compile.clients import ClientList
from colony.ir.program import Program, PythonModule
from colony.runtime import topics
from colony.runtime.announcer import Announcer
from colony.runtime.assembly import FrameAssembler
from colony.runtime.bindings import Bindings, SensorBinding
from colony.runtime.client import ClientNode
from colony.runtime.monitor import Monitor
from colony.runtime.observer import Observer, Sink
from colony.runtime.servers.commanding import Commanded
from colony.runtime.slices import ActivityExecutor, client_slice, whole_executor


@dataclass(frozen=True, slots=True, kw_only=True)
class Team:
    """The processes of a program. `announced` are the modules in Python whose activity DServer hands on."""

    clients: tuple[ClientNode, ...]
    announcers: tuple[Announcer, ...]
    announced: tuple[str, ...]
    observer: Observer


def team(program: Program, clients: ClientList, bindings: Bindings, sinks: tuple[Sink, ...]) -> Team:
    """Build all of them.

    Raises:
        Failure: a module in Python cannot be imported or built.
    """
    servers = {b.actuator: b.server for b in bindings.actuators}
    nodes: list[ClientNode] = []
    outside: set[str] = set()
    for group in clients.actuators:
        for client in group.clients:
            part = client_slice(program, clients, group.actuator, client.module)
            outside.update(part.outside)
            assembler = FrameAssembler(_only(bindings.sensors, part.sensors), part.outside)
            nodes.append(
                ClientNode(
                    actuator=group.actuator,
                    module=client.module,
                    server=servers[group.actuator],
                    assembler=assembler,
                    step=part.step,
                )
            )
    announced = tuple(m for m in program.modules if isinstance(m, PythonModule) and m.name in outside)
    return Team(
        clients=tuple(nodes),
        announcers=tuple(
            Announcer(m.name, FrameAssembler(bindings.sensors), ActivityExecutor(program, m).step)
            for m in announced
        ),
        announced=tuple(m.name for m in announced),
        observer=Observer(
            FrameAssembler(bindings.sensors),
            tuple(a.name for a in program.robot.actuators),
            Monitor(whole_executor(program, clients)),
            sinks,
        ),
    )


def commanded_by(
    program: Program, clients: ClientList, bindings: Bindings, server: str
) -> tuple[Commanded, ...]:
    """The actuators of a server, each with its clients."""
    places = places_of(program, clients)
    return tuple(
        Commanded(actuator=actuator, binding=binding, places=places[actuator.name])
        for actuator, binding in zip(program.robot.actuators, bindings.actuators, strict=True)
        if binding.server == server
    )


def places_of(program: Program, clients: ClientList) -> dict[str, tuple[str, ...]]:
    """The clients of every actuator of the program, highest place first; none where nothing is wired."""
    wired = {a.actuator: tuple(c.module for c in a.clients) for a in clients.actuators}
    return {a.name: wired.get(a.name, ()) for a in program.robot.actuators}


def client_addresses(
    program: Program, clients: ClientList, bindings: Bindings
) -> tuple[tuple[str, str], ...]:
    """Every client's address, and the server that it sends its requests to."""
    servers = {b.actuator: b.server for b in bindings.actuators}
    return tuple(
        (topics.client_address(actuator, module), servers[actuator])
        for actuator, modules in places_of(program, clients).items()
        for module in modules
    )


def _only(bindings: tuple[SensorBinding, ...], sensors: tuple[str, ...]) -> tuple[SensorBinding, ...]:
    wanted = frozenset(sensors)
    return tuple(b for b in bindings if b.sensor in wanted)
