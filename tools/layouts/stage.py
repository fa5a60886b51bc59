"""A whole robot in one layout, in lockstep: real hosts in threads, over the network, in virtual time.

The processes are those that `assembly/processes/jobs.py` makes of the robot's parts. Each is a host of its
own with its own session, as `child.py` there opens it. The process that starts them has the observer and the
parts that are hosted there, as in `run.py`. The time advances only when all threads are at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from threading import Thread
from typing import Any, NamedTuple

from colony.execute.compiled import Compiled
from colony.ir.frame import Reading
from colony.ir.program import Program
from colony.ir.servers import COMMON_SERVERS, DSERVER, RSERVER
from colony.runtime.assembly.nodes import build_observer
from colony.runtime.assembly.processes.hosting import HostedParts
from colony.runtime.assembly.processes.jobs import (
    Layout,
    Processes,
    client_processes,
    fresh_folder,
    server_parts,
    server_processes,
)
from colony.runtime.assembly.processes.spec import (
    AnnouncerPart,
    ClientsPart,
    Device,
    GatewayPart,
    GroupPart,
    NodePart,
    SinglePart,
    name_of,
    read_spec,
    singles,
)
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.library import clock, emergency
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.bindings import bind, bound_servers
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.messages import Alive, Node, SentMessage
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.host import Host, Replacement
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import Outbox
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.virtual import VirtualClock
from tests.kit.calling import CLOSE, call_of, opening
from tests.waiting import until
from tools.layouts.devices import Plant, devices_of
from tools.layouts.faults import Guard, InjectedError
from tools.layouts.traffic import Traffic

RUN = "run"
LEADER = "Leader"
OUTSIDER = "Outsider"
BEGIN_NS = 10_000_000_000
"""The time at which the robot starts."""


class Places(NamedTuple):
    """The layout of the servers, and that of the clients."""

    servers: Layout
    clients: Layout


class Heard(NamedTuple):
    """A message that an outsider heard."""

    t_ns: int
    topic: str
    message: SentMessage


class Process:
    """A host, in a thread. Mutable.

    Args:
        stage: the robot.
        name: the name of the process.
        part: what runs in it; None for the process that starts the others.
    """

    def __init__(self, stage: Stage, name: str, part: NodePart | None) -> None:
        self._stage = stage
        self.name = name
        self.part = part
        self.listens = not isinstance(part, (ClientsPart, AnnouncerPart))
        self._parts = () if part is None else singles(part)
        self._hosted = HostedParts(stage.robot_address, stage.plant, stage.reports.append)
        nodes = self._build(self._parts)
        self.addresses = {node.address for node in nodes} or {topics.OBSERVER}
        servers = topics.servers(node.address for node in nodes) if self.listens else ()
        self.network = ZenohSession.open(
            stage.robot_address, server_names=(LEADER,) if part is None else servers
        )
        stage.traffic.meter(self.network, listens=self.listens)
        is_shared = part is None or isinstance(part, GroupPart)
        self._host = Host(
            self.network,
            nodes if part is not None else (stage.observer,),
            time=stage.clock,
            report=stage.reports.append,
            on_failure=self._replacement if is_shared else None,
        )
        self._sleep = stage.traffic.take_newest()
        self.failure: BaseException | None = None
        self.thread = Thread(target=self._run, name=name, daemon=True)

    def _build(self, parts: Iterable[SinglePart]) -> tuple[Node, ...]:
        guard = self._stage.guard
        return tuple(
            node for part in parts for node in guard.guarded(self._hosted.build((part,)), name_of(part))
        )

    def start(self) -> None:
        """Run the host."""
        self._stage.traffic.watch(self._sleep)
        self.thread.start()

    def add(self, parts: tuple[SinglePart, ...]) -> None:
        """Run parts in this process, too."""
        self._parts = (*self._parts, *parts)
        nodes = self._build(parts)
        self.addresses |= {node.address for node in nodes}
        self.network.claim(topics.servers(node.address for node in nodes))
        self._host.add(nodes)

    def rouse(self) -> None:
        """Let the host look at the time."""
        if self.thread.is_alive():
            self._host.add(())

    def end(self) -> None:
        """End the host, and leave the network."""
        self._host.stop()
        self.thread.join()
        self._stage.traffic.forget(self.thread, self._sleep)
        self._host.close()
        self.network.close()
        self._hosted.close()

    def _run(self) -> None:
        try:
            self._host.run()
        except BaseException as failure:
            self.failure = failure
            self._stage.traffic.forget(self.thread, self._sleep)

    def _replacement(self, address: str, problem: Exception) -> Replacement:
        """Return what the product makes of a failure, after the pause that was drawn."""
        if not isinstance(problem, InjectedError):
            raise problem
        replacement = self._hosted.replacement(address, problem)
        part = next(p for p in self._parts if name_of(p) == problem.failure.part)

        def make() -> tuple[Node, ...]:
            self._stage.restarted.append(part)
            return self._stage.guard.guarded(tuple(replacement.make()), name_of(part))

        pause_ns = problem.failure.pause_ns
        self._stage.guard.wake_at(self._stage.clock.now_ns + pause_ns)
        return replacement._replace(pause_ns=pause_ns, make=make)


class Stage:
    """A robot and a run of a program on it, in one layout. Mutable; close it.

    `heard` is what an outsider heard, `logs` are the frames that the observer saw.

    Args:
        program: the program, on scripted devices.
        compiled: the same, compiled.
        robot_address: the robot; its folder is empty.
        readings: what the sensors read.
        places: the layout.
        guard: the faults.
        traffic: what is on its way.
    """

    def __init__(
        self,
        program: Program,
        compiled: Compiled,
        robot_address: Local,
        readings: Sequence[Mapping[str, Reading]],
        *,
        places: Places,
        guard: Guard,
        traffic: Traffic,
    ) -> None:
        self.robot_address = robot_address
        self.guard = guard
        self.clock = VirtualClock(BEGIN_NS)
        self.traffic = traffic
        self.plant = Plant(program, readings, self.clock)
        self.reports: list[str] = []
        self.heard: list[Heard] = []
        self.logs: list[RunFrame] = []
        self.restarted: list[SinglePart] = []
        self._due: list[tuple[int, Callable[[], None]]] = []
        self._processes: dict[str, Process] = {}
        self._resources = ExitStack()
        self._resources.enter_context(self.traffic.watching())
        devices = devices_of(program)
        base = (RSERVER,) if devices.base is not None else ()
        bindings = bind(compiled.robot, (*devices.servers, *base, *COMMON_SERVERS))
        self.deployment = deployment(
            compiled, bindings, run=RUN, seed=0, servers=bound_servers(compiled.robot)
        )
        deployed = (topics.CLOCK, DSERVER.name, *(b.server for b in bindings.actuators))
        self._deployed_servers = tuple(dict.fromkeys(deployed))
        self.observer = build_observer(compiled, bindings, (_Sink(self.logs),), RUN, requests=True)
        folder = robot_address.directory.path.parent
        parts = server_parts(fresh_folder(folder / "state"), Device(plant="none"), devices)
        specs = fresh_folder(folder / "specs")
        self._servers = server_processes(robot_address, parts, specs, simulator="none", layout=places.servers)
        self._clients = client_processes(
            robot_address, self.deployment, compiled, bindings, specs, layout=places.clients
        )
        self._resources.callback(self._end)
        try:
            self._outsider = self._listen_outside()
            self._begin()
        except BaseException:
            self.close()
            raise

    # --- the robot -------------------------------------------------------------------------------------

    def _listen_outside(self) -> ZenohSession:
        network = self._resources.enter_context(
            ZenohSession.open(self.robot_address, server_names=(OUTSIDER,))
        )
        self.traffic.meter(network, listens=True)
        prefix = f"colony/{self.robot_address.robot}/"

        def take(sample: Any) -> None:
            topic = str(sample.key_expr).removeprefix(prefix)
            messages = codec.decode_all(sample.payload.to_bytes())
            self.heard += [Heard(self.clock.now_ns, topic, message) for message in messages]

        session: Any = network.session
        subscriber = session.declare_subscriber(f"{prefix}**", _Handler(take))
        token = session.liveliness().declare_token(keys.liveliness_key(self.robot_address.robot, OUTSIDER))
        self._resources.callback(lambda: (subscriber.undeclare(), token.undeclare()))
        return network

    def _begin(self) -> None:
        """Start servers, the Clock last, then clients: no process misses what another sends at its start."""
        leader = self._processes[LEADER] = Process(self, LEADER, None)
        self.outbox = Outbox(
            leader.network.session, self.robot_address.robot, self.reports.append, user=leader.network.user
        )
        self.leader, self._leads = Caller(self, "leader", leader.network.user), False
        for process in reversed([leader, *self._open(self._servers)]):
            self._start(process)
        self._host(leader, self._servers)
        for process in self._open(self._clients):
            self._start(process)
        self._host(leader, self._clients)

    def _host(self, leader: Process, processes: Processes) -> None:
        if processes.hosted:
            leader.add(processes.hosted)
            self._join(leader)

    def _open(self, processes: Processes) -> list[Process]:
        opened = []
        for job in processes.jobs:
            part = read_spec(Path(job.arguments[0])).part
            assert not isinstance(part, GatewayPart)
            self._processes[job.name] = process = Process(self, job.name, part)
            opened.append(process)
        return opened

    def _start(self, process: Process) -> None:
        """Run a process once it hears of all that it can reach, and wait until they hear of it."""
        others = [p for p in self._processes.values() if p.thread.is_alive()]
        reached = {a for p in others if p.listens or process.listens for a in p.addresses}
        _await_presence(process.network, {OUTSIDER, *reached})
        process.start()
        self._join(process)

    def _join(self, process: Process) -> None:
        others = [p for p in self._processes.values() if p.thread.is_alive()]
        for other in others:
            if other.listens or process.listens:
                _await_presence(other.network, process.addresses)
        _await_presence(self._outsider, process.addresses)
        self.traffic.settle()

    # --- time ------------------------------------------------------------------------------------------

    def run_until(self, t_ns: int) -> None:
        """Let everything happen that is due up to `t_ns`, one time after another."""
        while True:
            now_ns = self.clock.now_ns
            times = [t for t, _ in self._due]
            times += [t for t in (self.guard.next_wake(now_ns),) if t is not None]
            due_ns = min(times, default=t_ns)
            if due_ns > t_ns:
                break
            self._advance(due_ns)
            if due_ns == t_ns and not any(t <= t_ns for t, _ in self._due):
                break
        self._advance(t_ns)

    def _advance(self, t_ns: int) -> None:
        self.clock.now_ns = max(self.clock.now_ns, t_ns)
        for process in self._processes.values():
            process.rouse()
        self.settle()
        due = [action for t, action in self._due if t <= t_ns]
        self._due = [(t, action) for t, action in self._due if t > t_ns]
        for action in due:
            action()
        self._lead_again()

    def settle(self) -> None:
        """Let everything happen that is due; end processes that failed, which start again after a pause."""
        self.traffic.settle()
        for name, process in tuple(self._processes.items()):
            if process.failure is None:
                continue
            if not isinstance(process.failure, InjectedError):
                raise process.failure
            del self._processes[name]
            process.end()
            remaining = (self._outsider, *(p.network for p in self._processes.values()))
            for network in remaining:
                until(lambda n=network, p=process: not p.addresses & set(n.alive()), "gone")  # type: ignore[misc]
            part = process.part
            assert part is not None
            due_ns = self.clock.now_ns + process.failure.failure.pause_ns
            self._due.append((due_ns, lambda name=name, part=part: self._revive(name, part)))  # type: ignore[misc]

    def _revive(self, name: str, part: NodePart) -> None:
        self._processes[name] = process = Process(self, name, part)
        self._start(process)
        self.restarted += singles(part)

    # --- calls -----------------------------------------------------------------------------------------

    def _lead_again(self) -> None:
        """Deploy the program to servers that were restarted, as `processes/run.py` does."""
        restarted, self.restarted = self.restarted, []
        for part in restarted:
            server = name_of(part)
            if server in self._deployed_servers and self._leads:
                self._deploy(server)

    def _deploy(self, server: str) -> None:
        self.leader.open(server)
        self.leader.ask(server, clock.deploy(self.deployment))

    def lead(self) -> None:
        """Deploy the program."""
        self._leads = True
        for server in self._deployed_servers:
            self._deploy(server)

    def leave(self) -> None:
        """Close the leader's connections, which ends the run until it leads again."""
        self._leads = False
        for server in self._deployed_servers:
            self.leader.close(server)

    def operator(self) -> Caller:
        """Return an operator with a connection to each server that has actuators, and the Clock."""
        operator = Caller(self, "operator", self._processes[LEADER].network.user)
        for server in self._deployed_servers:
            operator.open(server)
        return operator

    def stop(self, operator: Caller) -> None:
        """Stop the robot."""
        for server in self._deployed_servers:
            operator.ask(server, emergency.stop())

    def _end(self) -> None:
        for name in tuple(self._processes):
            self._processes.pop(name).end()

    def close(self) -> None:
        """End all processes."""
        self._resources.close()


def _await_presence(network: ZenohSession, addresses: set[str]) -> None:
    until(lambda: addresses <= set(network.alive()), f"{addresses} are not heard of")


class Caller:
    """A user's connections, one to each server. Mutable: counts the calls."""

    def __init__(self, stage: Stage, name: str, user: str) -> None:
        self._stage = stage
        self._connection = f"{user}/{name}"
        self._numbers: dict[str, int] = {}

    def open(self, server: str) -> None:
        """Open a connection to a server, or open it again at a server that was restarted."""
        self._numbers[server] = 0
        self.ask(server, opening(self._connection))

    def close(self, server: str) -> None:
        """Close a connection."""
        self.ask(server, CLOSE)
        del self._numbers[server]

    def ask(self, server: str, ask: CallRequest[Any]) -> None:
        """Call a server, and let everything happen that follows at once."""
        self._numbers[server] += 1
        self._send(server, call_of(ask, self._connection, self._numbers[server]))

    def keep_alive(self) -> None:
        """Send a sign of life to all servers."""
        for server in self._numbers:
            self._send(server, Alive(connection=self._connection))

    def _send(self, server: str, message: SentMessage) -> None:
        self._stage.outbox.send(topics.calls(server), message, self._stage.clock.now_ns)
        self._stage.settle()


class _Sink:
    """A sink that keeps the frames."""

    def __init__(self, logs: list[RunFrame]) -> None:
        self._logs = logs

    def take(self, log: RunFrame) -> None:
        """Keep a frame."""
        self._logs.append(log)

    def close(self) -> None:
        """Do nothing."""


class _Handler(NamedTuple):
    """A handler of samples."""

    callback: Callable[[Any], None]
