"""A whole robot in one process: clock, servers, clients and observer, joined by a transport in virtual time.

    clock = VirtualClock()
    session = Session(program, compiled.clients, drivers, clock=clock, seed=1)
    session.run(60_000_000_000)

Whatever ends a run, be it an exception, the robot is stopped and the sinks are closed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from colony.compile.clients import ClientList
from colony.ir.program import Program
from colony.ir.types import Value
from colony.runtime.assembly.nodes import build_announcer, build_client, build_observer, members
from colony.runtime.frames.assembly import frames_kept
from colony.runtime.frames.clock import Clock
from colony.runtime.observe.closing import close_all
from colony.runtime.observe.observer import Sink
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.fields import DSERVER, PSERVER, RSERVER, RUNTIME
from colony.runtime.protocol.messages import Node
from colony.runtime.protocol.topics import CLOCK, activity, client_address
from colony.runtime.servers.drivers import Drivers
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.pserver import PServer
from colony.runtime.servers.rserver import RServer
from colony.runtime.servers.runtime_server import RuntimeServer
from colony.runtime.store.store import MemoryStore
from colony.runtime.transport.virtual import Link, VirtualClock, VirtualTransport, perfect

RUN = "run"
"""What the run of a session is called."""


class Session:
    """One robot and one run of it. Mutable: everything below it.

    `restart`, and `transport` with `kill`, `freeze` and `thaw`, do to a process what may happen to one;
    `transport.at` does it at a time. What a store keeps survives, as it would on a disk.

    Args:
        program, clients: what is run, and its compiled form.
        drivers: the devices; they tell time by `clock`.
        seed: of `Runtime.random`.
        variables: DServer's, held as they are (see `DServer`), in declared units.
        sinks: who takes the frames.
        order_seed: of the order in which messages of one moment arrive; no result depends on it.
        link: faults of the transport.
        requests: whether frames come with what the clients asked for.
        nodes: who else takes part, such as camera servers and scripts; started last, in this order.

    Raises:
        Failure: a sensor or an actuator is bound to what no server has, or a module in Python cannot be
            imported or built.
    """

    def __init__(
        self,
        program: Program,
        clients: ClientList,
        drivers: Drivers,
        *,
        clock: VirtualClock,
        seed: int,
        variables: Mapping[str, Value] | None = None,
        sinks: tuple[Sink, ...] = (),
        order_seed: int | None = None,
        link: Link = perfect,
        requests: bool = False,
        nodes: tuple[Node, ...] = (),
    ) -> None:
        bindings, who = bind(program), members(program, clients)
        deployed = deployment(program, clients, bindings, run=RUN, seed=seed, announced=who.announced)
        keep, store = frames_kept(program.robot.frame_ns), MemoryStore()
        builders: dict[str, Callable[[], Node]] = {
            RSERVER.name: lambda: RServer(drivers.base, deployment=deployed, keep=keep),
            PSERVER.name: lambda: PServer(drivers.proximity, keep=keep),
            DSERVER.name: lambda: DServer(variables, deployment=deployed, keep=keep, store=store),
            RUNTIME.name: lambda: RuntimeServer(seed, keep=keep),
        }
        servers = tuple(builders)
        for actuator, module in who.clients:
            builders[client_address(actuator, module)] = partial(
                build_client, program, clients, bindings, actuator, module, RUN
            )
        for module in who.announced:
            builders[activity(DSERVER.name, module)] = partial(
                build_announcer, program, bindings, module, RUN
            )
        self._observer = build_observer(program, bindings, sinks, RUN, requests=requests)
        builders[CLOCK] = lambda: Clock(servers=servers, keep=keep, deployment=deployed)
        self._builders = builders
        self._nodes: dict[str, Node] = {address: build() for address, build in builders.items()}
        self._nodes[self._observer.address] = self._observer
        self._nodes.update((node.address, node) for node in nodes)
        self.transport = VirtualTransport(clock, seed=seed if order_seed is None else order_seed, link=link)
        self._closed = False

    def add(self, sink: Sink) -> None:
        """One more sink, before `run`."""
        self._observer.add(sink)

    def restart(self, address: str) -> None:
        """Put a new process in the place of one, which is killed if it still lives; not of the observer."""
        if address in self.transport.addresses:
            self.transport.kill(address)
        node = self._nodes[address] = self._builders[address]()
        self.transport.add(node)

    def run(
        self,
        duration_ns: int,
        *,
        stop: Callable[[], bool] = lambda: False,
        pace: Callable[[int], None] | None = None,
    ) -> bool:
        """Run the frames from 0 up to, and not with, `duration_ns`, once; False when `stop` ended it.

        `stop` is asked, and `pace` is told the time, before every moment in which something happens.
        """
        try:
            self.transport.add(self._nodes[CLOCK])  # who says that it is ready is to be heard
            for address, node in self._nodes.items():
                if address != CLOCK:
                    self.transport.add(node)
            return self.transport.run_until(duration_ns, stop=stop, pace=pace)
        finally:
            self.close()

    def close(self) -> None:
        """Stop the robot and close the sinks; all of it is tried, then the first failure is raised."""
        if self._closed:
            return
        self._closed = True
        close_all(self._nodes.values())  # RServer is the first
