"""A robot for any program in virtual time, of which every process can die: the real Clock, DServer, clients,
announcers and observer, two servers that read sensors from a trace, and one that takes all commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from colony.compile.pipeline import compile_program
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.runtime.assembly.scripted import (
    SCRIPTED_SERVERS,
    ActuatorServer,
    ActuatorServerBuilder,
    ScriptedRobot,
    scripted_bindings,
)
from colony.runtime.clients.client import ClientNode
from colony.runtime.protocol.messages import Message
from colony.runtime.transport.exchange import Delay, Link
from colony.runtime.transport.virtual import VirtualClock
from tools.loss.oracle import Seen


class Robot(ScriptedRobot):
    """One run of a program over a trace. Mutable: the nodes that live."""

    servers: tuple[str, ...] = SCRIPTED_SERVERS

    def __init__(
        self,
        program: Program,
        trace: Sequence[Frame],
        *,
        frame_ns: int,
        seed: int,
        link: Link,
        isolate: bool,
        actuator_server: ActuatorServerBuilder = ActuatorServer,
    ) -> None:
        self.program = replace(program, robot=replace(program.robot, frame_ns=frame_ns))
        self.frame_ns = frame_ns
        self.compiled = compile_program(self.program).compiled
        self.bindings = scripted_bindings(self.program.robot)
        self._link = link
        self._clock = VirtualClock()
        super().__init__(
            self.compiled,
            lambda tick: trace[tick.k % len(trace)].readings,
            clock=self._clock,
            seed=seed,
            link=self._noting,
            isolate=isolate,
            actuator_server=actuator_server,
        )
        self.seen = Seen(sent=self.sent)
        self.start()

    def _noting(self, sender: str, receiver: str, message: Message) -> Delay:
        self.seen.note(sender, message)
        return self._link(sender, receiver, message)

    def client(self, address: str) -> ClientNode:
        """The node of a client."""
        nodes = (node for node in self.nodes.values() if isinstance(node, ClientNode))
        (found,) = (node for node in nodes if address in node.program.clients)
        return found

    @property
    def now_ns(self) -> int:
        return self._clock.now_ns

    def run(self, frames: int) -> None:
        """For so many frames."""
        self.transport.run_until(frames * self.frame_ns)
        self.observer.close()
