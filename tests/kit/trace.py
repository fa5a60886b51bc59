"""A stage for any program: one server reads all of its sensors from a trace, a clock ticks at its times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from colony.compile.pipeline import compile_program
from colony.ir.frame import Decision, Frame, Reading
from colony.ir.program import Program, in_declared_units
from colony.ir.servers import DSERVER
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import Timing
from colony.runtime.assembly.nodes import build_announcer, build_clients, build_observer
from colony.runtime.assembly.sharing import client_processes
from colony.runtime.frames.publishing import Fields, Publisher
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import ActuatorBinding, Bindings, SensorBinding
from colony.runtime.protocol.deployment import ActuatorSpec, actuators_of, deployment, reported_fields
from colony.runtime.protocol.messages import (
    Announcement,
    Effect,
    Fetch,
    Message,
    Node,
    QuietNode,
    Request,
    Sample,
    Send,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.servers.commanding import CommandDispatcher
from colony.runtime.servers.relaying import ActivityRelay
from colony.runtime.transport.virtual import Link, VirtualClock, VirtualTransport, deliver_immediately
from tests.runtime.scripted import Log

TIMES = Timing(deadline_ns=40_000_000, grace_ns=5_000_000)
SERVER = DSERVER.name


class TraceClock(QuietNode):
    """Ticks at the times of a trace."""

    address = topics.CLOCK

    def __init__(self, trace: Sequence[Frame]) -> None:
        self._ticks = [Tick(k=k, t_ns=f.t_ns, restarted=f.restarted) for k, f in enumerate(trace)]
        self._k = 0
        self.listens = (topics.fetches(self.address),)

    def start(self, now_ns: int) -> Iterable[Effect]:
        return (WakeAt(self._ticks[0].t_ns),)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Fetch):
            yield Send(topics.frames(self.address), self._ticks[message.k])
        elif self._k < len(self._ticks):
            yield Send(topics.TICKS, self._ticks[self._k])
            self._k += 1
            if self._k < len(self._ticks):
                yield WakeAt(self._ticks[self._k].t_ns)


class TraceServer(QuietNode):
    """Has every sensor of the trace as a field, and takes the commands of every actuator."""

    address = SERVER

    def __init__(
        self, trace: Sequence[Frame], commanded: tuple[ActuatorSpec, ...], announced: tuple[str, ...]
    ) -> None:
        self._trace, self._commanded = trace, commanded
        self._publisher = Publisher(SERVER, self._read, frames_kept=100)
        self._relay = ActivityRelay(SERVER, announced, frames_kept=100)
        self._desk = CommandDispatcher(commanded, TIMES, self._perform)
        self.performed: list[tuple[int, str, tuple[ScalarValue, ...]]] = []
        listens = (*self._publisher.listens, *self._relay.listens, topics.requests(SERVER))
        self.listens = tuple(dict.fromkeys(listens))

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        match message:
            case Tick():
                self._relay.tick()
                yield from self._desk.end_before(message, now_ns)
                yield from self._publisher.handle(message)
                yield from self._desk.tick(message, now_ns)
            case Fetch() if message.server == SERVER:
                yield from self._publisher.handle(message)
            case Fetch():
                yield from self._relay.fetch(message)
            case Announcement():
                yield from self._relay.announce(message, now_ns)
            case Request():
                yield from self._desk.request(message, now_ns)
            case Wake():
                yield from self._desk.wake(now_ns)
            case _:
                pass

    def _read(self, tick: Tick) -> Fields:
        readings = self._sent(tick) | dict(self._trace[tick.k].readings)
        return {n: None if r is None else Sample(r, tick.t_ns) for n, r in readings.items()}  # type: ignore[arg-type]

    def _sent(self, tick: Tick) -> dict[str, Reading]:
        """What actuators were given last, in declared units."""
        given = self._desk.fields(tick)
        fields = reported_fields(self._commanded)
        return {
            name: in_declared_units((sample.value,), (fields[name],))[0]  # type: ignore[arg-type, index]
            for name, sample in given.items()
            if sample is not None
        }

    def _perform(self, actuator: ActuatorSpec, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        self.performed.append((now_ns, actuator.name, values))


class Played:
    """What came of a trace."""

    def __init__(self, log: Log, server: TraceServer) -> None:
        self.log = log
        self.performed = server.performed

    def decisions(self) -> list[tuple[Decision, ...]]:
        return [
            tuple(Decision(v.actuator, v.by, v.values, v.fault) for v in log.verdicts.values())
            for log in self.log.frames
        ]


def play(
    program: Program,
    trace: Sequence[Frame],
    *,
    isolate: bool = False,
    order_seed: int = 0,
    link: Link = deliver_immediately,
) -> Played:
    """Run a program's clients over a trace in virtual time, together or each alone."""
    compiled = compile_program(program).compiled
    bindings = Bindings(
        sensors=tuple(
            SensorBinding(
                sensor=s.name,
                server=SERVER,
                field=s.name,
                max_age_ns=None,
                factor=s.factor,
                declared=True,
                sent=s.sent is not None,
            )
            for s in program.robot.sensors
        ),
        actuators=tuple(
            ActuatorBinding(actuator=a.name, server=SERVER, command=a.name, field_indices=())
            for a in program.robot.actuators
        ),
    )
    log = Log()
    deployed = deployment(compiled, bindings, run="", seed=0)
    server = TraceServer(trace, actuators_of(deployed, SERVER), compiled.python_modules)
    observer = build_observer(compiled, bindings, (log,), "")
    transport = VirtualTransport(VirtualClock(trace[0].t_ns), seed=order_seed, link=link)
    processes = client_processes(compiled, isolate=isolate)
    nodes: tuple[Node, ...] = (
        server,
        *(node for process in processes for node in build_clients(compiled, bindings, process.clients, "")),
        *(build_announcer(compiled, bindings, module, "") for module in compiled.python_modules),
        observer,
        TraceClock(trace),
    )
    for node in nodes:
        transport.add(node)
    transport.run_until(trace[-1].t_ns + 10_000_000_000)
    observer.close()
    return Played(log, server)
