"""A robot for any program in virtual time, of which every process can die: the real Clock, DServer, clients,
announcers and observer, two servers that read sensors from a trace, and one that takes all commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

from colony.compile.clients import ClientList
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.ir.types import ScalarValue
from colony.runtime import topics
from colony.runtime.arbitration import Dispatch, declared_units, timing
from colony.runtime.assembly import frames_kept
from colony.runtime.bindings import ActuatorBinding, Bindings, SensorBinding
from colony.runtime.clock import Clock
from colony.runtime.deployment import Deployment, commanded_by, deployment
from colony.runtime.fields import DSERVER
from colony.runtime.messages import (
    Checkpoint,
    Effect,
    Fetch,
    Message,
    Node,
    Request,
    Restart,
    Sample,
    ServerFrame,
    Tick,
    Verdict,
    Wake,
)
from colony.runtime.servers.commanding import CommandDesk, Commanded
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.publishing import Fields, Publisher
from colony.runtime.store import MemoryStore
from colony.runtime.team import build_announcer, build_client, build_observer, members
from colony.runtime.virtual import Delay, Link, VirtualClock, VirtualTransport
from tests.runtime.scripted import Log

RUN = "run"
SENSING = ("S0", "S1")
ACTOR = "Actor"
SERVERS = (*SENSING, ACTOR, DSERVER.name)


class SensorServer:
    """Has some of the sensors; frame k is that of the trace with the same number, over and over."""

    def __init__(self, address: str, trace: Sequence[Frame], names: tuple[str, ...], keep: int) -> None:
        self.address = address
        self._trace = trace
        self._names = names
        self._publisher = Publisher(address, self._read, keep=keep)
        self.listens = self._publisher.listens

    def start(self, now_ns: int) -> tuple[Effect, ...]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, (Tick, Fetch)):
            yield from self._publisher.handle(message)

    def close(self) -> None:
        pass

    def _read(self, tick: Tick) -> Fields:
        readings = self._trace[tick.k % len(self._trace)].readings
        return {n: Sample(readings[n], tick.t_ns) for n in self._names if readings.get(n) is not None}  # type: ignore[arg-type]


class Actor:
    """Takes the commands of every actuator, as RServer does."""

    address = ACTOR

    def __init__(self, deployed: Deployment, keep: int, sent: list[Sent]) -> None:
        self._run = deployed.run
        self._publisher = Publisher(ACTOR, lambda tick: {}, keep=keep)
        commanded = commanded_by(deployed, ACTOR)
        self._desk = CommandDesk(commanded, timing(deployed.frame_ns), lambda *_: None, told=self._told)
        self._sent = sent
        self.listens = (*self._publisher.listens, topics.requests(ACTOR))

    def start(self, now_ns: int) -> tuple[Effect, ...]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        match message:
            case Tick():
                yield from self._publisher.handle(message)
                if message.run == self._run:
                    yield from self._desk.tick(message, now_ns)
                else:
                    yield from self._desk.finish(now_ns)
            case Fetch():
                yield from self._publisher.handle(message)
            case Request():
                yield from self._desk.request(message, now_ns)
            case Wake():
                yield from self._desk.wake(now_ns)
            case _:
                pass

    def close(self) -> None:
        pass

    def _told(self, commanded: Commanded, dispatch: Dispatch, now_ns: int) -> None:
        values = declared_units(commanded.actuator, dispatch.values)
        self._sent.append(Sent(dispatch.k, commanded.actuator.name, dispatch.by, values, dispatch.fault))


class Sent(NamedTuple):
    """A command that left arbitration; values in declared units."""

    k: int
    actuator: str
    by: str | None
    values: tuple[ScalarValue, ...] | None
    fault: str | None


@dataclass(frozen=True, slots=True)
class Seen:
    """All that went over the network of a run, as far as it matters."""

    ticks: dict[int, Tick] = field(default_factory=dict)
    frames: dict[tuple[str, int], ServerFrame] = field(default_factory=dict)
    void: set[tuple[str, int]] = field(default_factory=set)
    checkpoints: dict[tuple[str, int], bytes] = field(default_factory=dict)
    verdicts: dict[tuple[int, str], Verdict] = field(default_factory=dict)
    sent: list[Sent] = field(default_factory=list)
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


class Robot:
    """One run of a program over a trace. Mutable: the nodes that live."""

    def __init__(
        self,
        program: Program,
        clients: ClientList,
        trace: Sequence[Frame],
        *,
        frame_ns: int,
        seed: int,
        link: Link,
    ) -> None:
        self.program = replace(program, robot=replace(program.robot, frame_ns=frame_ns))
        self.clients = clients
        self.frame_ns = frame_ns
        self.seen, self.log = Seen(), Log()
        self.who = members(self.program, clients)
        self._link = link
        self._clock = VirtualClock()
        self.transport = VirtualTransport(self._clock, seed=seed, link=self._noting)
        bindings, keep = self._bindings(), frames_kept(frame_ns)
        deployed = deployment(
            self.program, clients, bindings, run=RUN, seed=seed, announced=self.who.announced
        )
        self._builders = self._build(bindings, deployed, trace, keep)
        self.nodes = {address: build() for address, build in self._builders.items()}
        self.observer = build_observer(self.program, clients, bindings, (self.log,), RUN)
        for node in (*self.nodes.values(), self.observer):
            self.transport.add(node)

    def _build(
        self, bindings: Bindings, deployed: Deployment, trace: Sequence[Frame], keep: int
    ) -> dict[str, Callable[[], Node]]:
        store = MemoryStore()
        builders: dict[str, Callable[[], Node]] = {
            topics.CLOCK: lambda: Clock(servers=SERVERS, keep=keep, deployment=deployed),
            ACTOR: lambda: Actor(deployed, keep, self.seen.sent),
            DSERVER.name: lambda: DServer(announced=deployed.announced, keep=keep, store=store),
        }
        for server in SENSING:
            names = tuple(b.sensor for b in bindings.sensors if b.server == server)
            builders[server] = partial(SensorServer, server, trace, names, keep)
        for actuator, module in self.who.clients:
            builders[topics.client_address(actuator, module)] = partial(
                build_client, self.program, self.clients, bindings, actuator, module, RUN
            )
        for module in self.who.announced:
            builders[topics.activity(DSERVER.name, module)] = partial(
                build_announcer, self.program, bindings, module, RUN
            )
        return builders

    def _bindings(self) -> Bindings:
        robot = self.program.robot
        return Bindings(
            sensors=tuple(
                SensorBinding(
                    sensor=s.name, server=SENSING[i % len(SENSING)], field=s.name, within_ns=None, factor=1.0
                )
                for i, s in enumerate(robot.sensors)
            ),
            actuators=tuple(
                ActuatorBinding(actuator=a.name, server=ACTOR, command=a.name, places=())
                for a in robot.actuators
            ),
        )

    def _noting(self, sender: str, receiver: str, message: Message) -> Delay:
        self.seen.note(sender, message)
        return self._link(sender, receiver, message)

    @property
    def now_ns(self) -> int:
        return self._clock.now_ns

    @property
    def addresses(self) -> tuple[str, ...]:
        """Of all processes but the observer's."""
        return tuple(self._builders)

    def kill(self, address: str) -> None:
        """As SIGKILL would; again is nothing."""
        if address in self.transport.addresses:
            self.transport.kill(address)

    def freeze(self, address: str) -> None:
        """As SIGSTOP would; of one that does not live it is nothing."""
        if address in self.transport.addresses:
            self.transport.freeze(address)

    def revive(self, address: str) -> None:
        """Start a new process if there is none, and let a frozen one go on."""
        if address in self.transport.addresses:
            self.transport.thaw(address)
        else:
            self.nodes[address] = self._builders[address]()
            self.transport.add(self.nodes[address])

    def run(self, frames: int) -> None:
        """For so many frames."""
        self.transport.run_until(frames * self.frame_ns)
        self.observer.close()
