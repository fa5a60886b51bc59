"""The processes that a compiled program asks for, whatever robot they run on: its clients, the announcers of
its modules in Python, and the observer. Each can be built alone, in a process of its own."""

from __future__ import annotations

from collections.abc import Iterable

from colony.execute.compiled import Compiled
from colony.execute.executor import ModuleExecutor, ProgramExecutor
from colony.execute.needs import ClientKey, needs_of_clients
from colony.execute.views import of_clients
from colony.runtime.clients.announcer import Announcer
from colony.runtime.clients.client import ClientNode
from colony.runtime.clients.client_program import ClientProgram
from colony.runtime.frames.assembler import FrameAssembler, frames_kept
from colony.runtime.observe.monitor import Monitor
from colony.runtime.observe.observer import Observer, Sink
from colony.runtime.protocol.bindings import Bindings, SensorBinding


def build_clients(
    compiled: Compiled, bindings: Bindings, clients: Iterable[ClientKey], run: str
) -> tuple[ClientNode, ...]:
    """Build the clients of one process, by actuator and module: a node for all that wait for the same.

    Raises:
        KeyError: there is no such client.
    """
    on_loss = {a.name: a.on_loss for a in compiled.robot.actuators}
    here = tuple(clients)
    needs = needs_of_clients(of_clients(compiled.code, here))
    groups: dict[object, list[ClientKey]] = {}
    for client in here:
        servers = frozenset(b.server for b in _only(bindings.sensors, needs[client].sensors))
        groups.setdefault((servers, needs[client].python_modules, on_loss[client[0]]), []).append(client)
    return tuple(_client_node(compiled, bindings, group, run) for group in groups.values())


def _client_node(compiled: Compiled, bindings: Bindings, clients: list[ClientKey], run: str) -> ClientNode:
    part = ClientProgram(compiled, clients)
    (on_loss,) = {a.on_loss for a in compiled.robot.actuators if a.name in dict(clients)}
    assembler = FrameAssembler(
        _only(bindings.sensors, part.sensors),
        part.python_modules,
        run=run,
        keep=frames_kept(compiled.frame_ns),
        awaited="degrade" if on_loss == "degrade" else "all",
    )
    server = {b.actuator: b.server for b in bindings.actuators}
    return ClientNode(part, [server[actuator] for actuator, _ in clients], assembler, run=run)


def build_announcer(compiled: Compiled, bindings: Bindings, module: str, run: str) -> Announcer:
    """Build the process that runs a module in Python, and tells its answers.

    Raises:
        KeyError: there is no such module.
        Failure: it cannot be imported or built.
    """
    executor = ModuleExecutor(compiled, module)
    keep = frames_kept(compiled.frame_ns)
    assembler = FrameAssembler(_only(bindings.sensors, executor.sensors), run=run, keep=keep)
    return Announcer(module, assembler, executor, run=run, keep=keep)


def build_observer(
    compiled: Compiled,
    bindings: Bindings,
    sinks: tuple[Sink, ...],
    run: str,
    *,
    requests: bool = False,
) -> Observer:
    """Build the process that sees every frame; with `requests`, also what the clients asked for."""
    actuators, modules, keep = compiled.robot.actuators, compiled.announced, frames_kept(compiled.frame_ns)
    degrading = (a.name for a in actuators if a.on_loss == "degrade")
    return Observer(
        FrameAssembler(bindings.sensors, run=run, keep=keep, declared=True),
        tuple(a.name for a in actuators),
        Monitor(ProgramExecutor(compiled, simplified=False, answered=True), degrading, modules),
        sinks,
        modules=FrameAssembler((), modules, run=run, keep=keep, awaited="living") if modules else None,
        heeded=tuple(dict.fromkeys(b.server for b in bindings.actuators)) if requests else (),
        frame_ns=compiled.frame_ns,
    )


def _only(bindings: tuple[SensorBinding, ...], sensors: tuple[str, ...]) -> tuple[SensorBinding, ...]:
    wanted = frozenset(sensors)
    return tuple(b for b in bindings if b.sensor in wanted)
