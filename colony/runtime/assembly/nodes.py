"""The nodes of a compiled program: its clients, the announcers of its Python modules, and the observer.

Each process builds the nodes that run in it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple

from colony.execute.compiled import Compiled
from colony.execute.executor import ModuleExecutor, ProgramExecutor
from colony.execute.needs import BOUNDS, ClientKey, clients_view, needs_of_clients
from colony.runtime.clients.client import Announcer, ClientNode, ClientProgram
from colony.runtime.frames.assembler import Awaited, FrameAssembler, frames_to_keep
from colony.runtime.observe.observer import Monitor, Observer, Sink
from colony.runtime.protocol.bindings import Bindings, SensorBinding
from colony.runtime.protocol.topics import CLOCK


def build_clients(
    compiled: Compiled, bindings: Bindings, clients: Iterable[ClientKey], run: str
) -> tuple[ClientNode, ...]:
    """Build the clients of one process, given by actuator and module.

    Clients that read the same servers and Python modules and have the same `on_loss` share one node.

    Raises:
        KeyError: the program has no such client.
    """
    degrading = {a.name for a in compiled.robot.actuators if a.on_loss == "degrade"}
    keys = tuple(clients)
    needs = needs_of_clients(clients_view(compiled.code, keys))
    groups: dict[_Inputs, list[ClientKey]] = {}
    for client in keys:
        bound = _bindings_of(bindings.sensors, needs[client].sensors)
        servers = frozenset(b.server for b in bound if b.server != CLOCK)
        awaited: Awaited = "degrade" if client[0] in degrading and client[1] != BOUNDS else "all"
        groups.setdefault(_Inputs(servers, needs[client].python_modules, awaited), []).append(client)
    return tuple(
        _client_node(compiled, bindings, group, inputs.awaited, run) for inputs, group in groups.items()
    )


class _Inputs(NamedTuple):
    """The inputs that a client waits for in each frame."""

    servers: frozenset[str]
    python_modules: tuple[str, ...]
    awaited: Awaited


def _client_node(
    compiled: Compiled, bindings: Bindings, clients: list[ClientKey], awaited: Awaited, run: str
) -> ClientNode:
    program = ClientProgram(compiled, clients)
    assembler = FrameAssembler(
        _bindings_of(bindings.sensors, program.sensors),
        program.python_modules,
        run=run,
        frames_kept=frames_to_keep(compiled.frame_ns),
        awaited=awaited,
    )
    server = {b.actuator: b.server for b in bindings.actuators}
    return ClientNode(program, [server[actuator] for actuator, _ in program.keys], assembler, run=run)


def build_announcer(compiled: Compiled, bindings: Bindings, module: str, run: str) -> Announcer:
    """Build the node that runs a Python module and announces its answers.

    Raises:
        KeyError: the program has no such module.
        DiagnosticError: the module cannot be imported or built.
    """
    executor = ModuleExecutor(compiled, module)
    frames_kept = frames_to_keep(compiled.frame_ns)
    assembler = FrameAssembler(
        _bindings_of(bindings.sensors, executor.sensors), run=run, frames_kept=frames_kept
    )
    return Announcer(module, assembler, executor, run=run, frames_kept=frames_kept)


def build_observer(
    compiled: Compiled,
    bindings: Bindings,
    sinks: tuple[Sink, ...],
    run: str,
    *,
    requests: bool = False,
    decided: Collection[str] | None = None,
) -> Observer:
    """Build the node that sees every frame and, with `requests`, the clients' requests.

    `decided` are the actuators that get verdicts, by default all.
    """
    actuators, modules = compiled.robot.actuators, compiled.python_modules
    frames_kept = frames_to_keep(compiled.frame_ns)
    answer_assembler = FrameAssembler((), modules, run=run, frames_kept=frames_kept, awaited="living")
    degrading = (a.name for a in actuators if a.on_loss == "degrade")
    return Observer(
        FrameAssembler(bindings.sensors, run=run, frames_kept=frames_kept, declared_units=True),
        tuple(a.name for a in actuators if decided is None or a.name in decided),
        Monitor(
            ProgramExecutor(compiled, simplified=False, answers_given=True), degrading, modules, actuators
        ),
        sinks,
        answer_assembler=answer_assembler if modules else None,
        request_servers=tuple(dict.fromkeys(b.server for b in bindings.actuators)) if requests else (),
        frame_ns=compiled.frame_ns,
        servers_read=_servers_read(compiled, bindings),
    )


def _servers_read(compiled: Compiled, bindings: Bindings) -> dict[ClientKey, frozenset[str]]:
    """Return the servers whose frames each client waits for."""
    keys = [(a.actuator.name, client.module) for a in compiled.code.actuators for client in a.clients]
    server = {b.sensor: b.server for b in bindings.sensors}
    return {
        key: frozenset(server[sensor] for sensor in needs.sensors).difference({CLOCK})
        for key, needs in needs_of_clients(clients_view(compiled.code, keys)).items()
    }


def _bindings_of(bindings: tuple[SensorBinding, ...], sensors: tuple[str, ...]) -> tuple[SensorBinding, ...]:
    names = frozenset(sensors)
    return tuple(b for b in bindings if b.sensor in names)
