"""A robot for any program in virtual time, of which every process can die: the real Clock, DServer, clients,
announcers and observer, two servers that read sensors from a trace, and one that takes all commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from colony.compile.pipeline import compile_program
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.ir.servers import DSERVER
from colony.robots.scripted import ActuatorServer, ActuatorServerBuilder, ScriptedRobot, SentCommand
from colony.runtime.clients.client import ClientNode
from colony.runtime.protocol.messages import (
    Checkpoint,
    Message,
    Restart,
    ServerFrame,
    Tick,
    Verdict,
)
from colony.runtime.transport.exchange import Delay, Link
from colony.runtime.transport.virtual import VirtualClock


@dataclass(frozen=True, slots=True)
class Seen:
    """All that went over the network of a run, as far as it matters."""

    ticks: dict[int, Tick] = field(default_factory=dict)
    frames: dict[tuple[str, int], ServerFrame] = field(default_factory=dict)
    void: set[tuple[str, int]] = field(default_factory=set)
    checkpoints: dict[tuple[str, int], bytes] = field(default_factory=dict)
    verdicts: dict[tuple[int, str], Verdict] = field(default_factory=dict)
    sent: list[SentCommand] = field(default_factory=list)
    recalled: set[str] = field(default_factory=set)
    restarts: set[tuple[str, int]] = field(default_factory=set)

    def note(self, sender: str, message: Message) -> None:
        """Take a message in.

        Raises:
            AssertionError: a server published two different frames of one number.
        """
        match message:
            case Tick():
                self.ticks.setdefault(message.k, message)
                self.void.update(message.void)
            case ServerFrame():
                known = self.frames.setdefault((message.server, message.k), message)
                assert known is message or _values(known) == _values(message), (known, message)
            case Checkpoint() if sender != DSERVER.name:
                self.checkpoints[message.client, message.k] = message.memory
            case Checkpoint() if message.k >= 0:
                self.recalled.add(message.client)
            case Restart():
                self.restarts.add((message.client, message.start))
            case Verdict():
                self.verdicts.setdefault((message.k, message.actuator), message)
            case _:
                pass


def _values(frame: ServerFrame) -> str:
    return repr({name: None if s is None else s.value for name, s in frame.fields.items()})


class Robot(ScriptedRobot):
    """One run of a program over a trace. Mutable: the nodes that live."""

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
