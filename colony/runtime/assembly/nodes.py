"""The processes that a compiled program asks for, whatever robot they run on: its clients, the announcers of
its modules in Python, and the observer. Each can be built alone, in a process of its own."""

from __future__ import annotations

from dataclasses import dataclass

from colony.compile.clients import ClientList
from colony.compile.lower.lower import lower_client
from colony.execute.code import OutsideActive
from colony.ir.program import Program, PythonModule
from colony.runtime.clients.announcer import Announcer
from colony.runtime.clients.client import ClientNode
from colony.runtime.clients.slices import ActivityExecutor, ClientSlice, whole_executor
from colony.runtime.frames.assembly import FrameAssembler, frames_kept
from colony.runtime.observe.monitor import Monitor
from colony.runtime.observe.observer import Observer, Sink
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import Bindings, SensorBinding
from colony.runtime.protocol.fields import DSERVER


@dataclass(frozen=True, slots=True, kw_only=True)
class Members:
    """Who takes part in a run, besides the servers: clients as (actuator, module), highest place first, and
    the modules in Python whose activity DServer hands on."""

    clients: tuple[tuple[str, str], ...]
    announced: tuple[str, ...]

    @property
    def addresses(self) -> tuple[str, ...]:
        """Of all of them."""
        return (
            *(topics.client_address(actuator, module) for actuator, module in self.clients),
            *(topics.activity(DSERVER.name, module) for module in self.announced),
        )


def members(program: Program, clients: ClientList) -> Members:
    """Who takes part. Builds none of them, and imports no module in Python."""
    outside: set[str] = set()
    if any(isinstance(m, PythonModule) for m in program.modules):
        for group in clients.actuators:
            for client in group.clients:
                code = lower_client(program, clients, group.actuator, client.module)
                outside.update(op.module for op in code.ops if isinstance(op, OutsideActive))
    return Members(
        clients=tuple((group.actuator, c.module) for group in clients.actuators for c in group.clients),
        announced=tuple(m.name for m in program.modules if m.name in outside),
    )


def build_client(
    program: Program, clients: ClientList, bindings: Bindings, actuator: str, module: str, run: str
) -> ClientNode:
    """The client that `module` is for `actuator`.

    Raises:
        KeyError: there is no such client.
        Failure: its module in Python cannot be imported or built.
    """
    part = ClientSlice(program, clients, actuator, module)
    (server,) = (b.server for b in bindings.actuators if b.actuator == actuator)
    (on_loss,) = (a.on_loss for a in program.robot.actuators if a.name == actuator)
    assembler = FrameAssembler(
        _only(bindings.sensors, part.sensors),
        part.outside,
        run=run,
        keep=frames_kept(program.robot.frame_ns),
        degrade=on_loss == "degrade",
    )
    return ClientNode(
        actuator=actuator, module=module, server=server, assembler=assembler, part=part, run=run
    )


def build_announcer(program: Program, bindings: Bindings, module: str, run: str) -> Announcer:
    """The process that tells when a module in Python is active.

    Raises:
        KeyError: there is no such module.
        Failure: it cannot be imported or built.
    """
    found = {m.name: m for m in program.modules if isinstance(m, PythonModule)}[module]
    keep = frames_kept(program.robot.frame_ns)
    assembler = FrameAssembler(bindings.sensors, run=run, keep=keep)
    return Announcer(module, assembler, ActivityExecutor(program, found), run=run, keep=keep)


def build_observer(
    program: Program,
    bindings: Bindings,
    sinks: tuple[Sink, ...],
    run: str,
    *,
    requests: bool = False,
) -> Observer:
    """The process that sees every frame; with `requests`, also what the clients asked for.

    Raises:
        Failure: a module in Python cannot be imported or built.
    """
    degrading = (a.name for a in program.robot.actuators if a.on_loss == "degrade")
    return Observer(
        FrameAssembler(bindings.sensors, run=run, keep=frames_kept(program.robot.frame_ns)),
        tuple(a.name for a in program.robot.actuators),
        Monitor(whole_executor(program), degrading),
        sinks,
        heeded=tuple(dict.fromkeys(b.server for b in bindings.actuators)) if requests else (),
        frame_ns=program.robot.frame_ns,
    )


def places_of(program: Program, clients: ClientList) -> dict[str, tuple[str, ...]]:
    """The clients of every actuator of the program, highest place first; none where nothing is wired."""
    wired = {a.actuator: tuple(c.module for c in a.clients) for a in clients.actuators}
    return {a.name: wired.get(a.name, ()) for a in program.robot.actuators}


def _only(bindings: tuple[SensorBinding, ...], sensors: tuple[str, ...]) -> tuple[SensorBinding, ...]:
    wanted = frozenset(sensors)
    return tuple(b for b in bindings if b.sensor in wanted)
