"""A whole robot in one process: Clock, servers, clients and observer, in virtual time.

    clock = VirtualClock()
    session = VirtualSession(compiled, drivers, clock=clock, seed=1)
    session.run(60_000_000_000)

However a run ends, even by an exception, the robot is stopped and the sinks are closed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from colony.execute.compiled import Compiled
from colony.ir.servers import DSERVER, PROXIMITY, RSERVER, RUNTIME
from colony.ir.types import Value
from colony.runtime.assembly.nodes import (
    build_announcer,
    build_clients,
    build_observer,
)
from colony.runtime.assembly.sharing import announcer_process_name, client_processes
from colony.runtime.frames.assembler import frames_to_keep
from colony.runtime.frames.clock import Clock
from colony.runtime.kit.devices import device_server
from colony.runtime.kit.once import Report
from colony.runtime.observe.closing import close_all
from colony.runtime.observe.observer import Sink
from colony.runtime.protocol.bindings import Bindings, bind
from colony.runtime.protocol.deployment import Deployment, deployment
from colony.runtime.protocol.messages import Node
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.servers.cserver import CServer
from colony.runtime.servers.drivers import Drivers
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.pserver import PServer
from colony.runtime.servers.rserver import RServer
from colony.runtime.servers.runtime_server import RuntimeServer
from colony.runtime.store.store import MemoryStore
from colony.runtime.transport.exchange import Link, deliver_immediately
from colony.runtime.transport.virtual import VirtualClock, VirtualTransport

RUN = "run"
"""The name of a run in virtual time."""

Builders = Mapping[str, Callable[[], Node]]
"""Functions that build nodes, by address; called again for a restart."""

ServersFactory = Callable[[Deployment, int], Builders]
"""A function that returns the builders of a robot's servers.

It takes the deployment and the number of frames that the servers keep.
"""


class VirtualRobot:
    """The nodes of one run, connected by a transport in virtual time. Mutable.

    `kill`, `freeze`, `restart` and `revive` imitate what may happen to a real process; use `transport.at` to
    call them at a given time. Data in a store survives, as it would on a disk.

    Args:
        compiled: program to run.
        bindings: servers of its sensors and actuators.
        servers: function that returns the builders of all servers but the Clock.
        clock: time, which the transport advances.
        seed: seed of `Runtime.random`.
        sinks: sinks of the frames.
        ticking: True to run a Clock; without one, the caller injects ticks.
        order_seed: seed of the order of messages that arrive at the same time; no result depends on it.
        link: faults of the transport.
        requests: True to add the clients' requests to the frame logs.
        nodes: additional nodes, such as camera servers and scripts; started last, in this order, and never
            restarted: `restart` and `revive` accept only the names in `processes`.
        isolate: True to run each client in its own process.

    Raises:
        DiagnosticError: a Python module cannot be imported or built.
    """

    def __init__(
        self,
        compiled: Compiled,
        bindings: Bindings,
        servers: ServersFactory,
        *,
        clock: VirtualClock,
        seed: int,
        sinks: tuple[Sink, ...] = (),
        ticking: bool = True,
        order_seed: int | None = None,
        link: Link = deliver_immediately,
        requests: bool = False,
        nodes: tuple[Node, ...] = (),
        isolate: bool = False,
    ) -> None:
        frames_kept = frames_to_keep(compiled.frame_ns)
        self.deployed = deployed = deployment(compiled, bindings, run=RUN, seed=seed)
        server_builders = servers(deployed, frames_kept)
        builders: dict[str, Callable[[], Node | tuple[Node, ...]]] = {}
        if ticking:  # the Clock comes first, so that it receives every report of readiness
            builders[CLOCK] = lambda: Clock(
                servers=tuple(server_builders), frames_kept=frames_kept, deployment=deployed
            )
        builders.update(server_builders)
        for process in client_processes(compiled, isolate=isolate):
            builders[process.name] = partial(build_clients, compiled, bindings, process.clients, RUN)
        for module in compiled.python_modules:
            builders[announcer_process_name(module)] = partial(
                build_announcer, compiled, bindings, module, RUN
            )
        self.observer = build_observer(compiled, bindings, sinks, RUN, requests=requests)
        self._builders = builders
        self.nodes: dict[str, Node] = {}
        self._addresses: dict[str, tuple[str, ...]] = {}
        for name in builders:
            self._build(name)
        self.nodes[self.observer.address] = self.observer
        self.nodes.update((node.address, node) for node in nodes)
        self.transport = VirtualTransport(clock, seed=seed if order_seed is None else order_seed, link=link)

    @property
    def processes(self) -> tuple[str, ...]:
        """The names of the restartable processes; a process with one node has the address of that node."""
        return tuple(self._builders)

    def start(self) -> None:
        """Start all nodes."""
        for node in self.nodes.values():
            self.transport.add(node)

    def kill(self, process: str) -> None:
        """Kill a process as SIGKILL would; a dead process stays dead."""
        for address in self._living(process):
            self.transport.kill(address)

    def freeze(self, process: str) -> None:
        """Stop a process as SIGSTOP would, if it is alive."""
        for address in self._living(process):
            self.transport.freeze(address)

    def revive(self, process: str) -> None:
        """Resume a frozen process, or restart a dead one."""
        living = self._living(process)
        for address in living:
            self.transport.thaw(address)
        if not living:
            self.restart(process)

    def restart(self, process: str) -> None:
        """Kill a process if it is still alive, and start a new one. The observer cannot be restarted."""
        self.kill(process)
        for node in self._build(process):
            self.transport.add(node)

    def _build(self, process: str) -> tuple[Node, ...]:
        built = self._builders[process]()
        nodes = built if isinstance(built, tuple) else (built,)
        self.nodes.update((node.address, node) for node in nodes)
        self._addresses[process] = tuple(node.address for node in nodes)
        return nodes

    def _living(self, process: str) -> list[str]:
        return [a for a in self._addresses.get(process, (process,)) if a in self.transport.addresses]


class VirtualSession(VirtualRobot):
    """A robot with the standard servers, and one run of it.

    Args:
        compiled: program to run.
        drivers: device drivers, which read the time from `clock`.
        clock: as in `VirtualRobot`.
        seed: as in `VirtualRobot`.
        variables: variables that DServer holds (see `DServer`), in declared units.
        sinks: as in `VirtualRobot`.
        order_seed: as in `VirtualRobot`.
        link: as in `VirtualRobot`.
        requests: as in `VirtualRobot`.
        nodes: as in `VirtualRobot`.
        isolate: as in `VirtualRobot`.
        report: takes each problem of a device's driver.

    Raises:
        DiagnosticError: a sensor or actuator is bound to something that no server offers, or a Python module
            cannot be imported or built.
    """

    def __init__(
        self,
        compiled: Compiled,
        drivers: Drivers,
        *,
        clock: VirtualClock,
        seed: int,
        variables: Mapping[str, Value] | None = None,
        sinks: tuple[Sink, ...] = (),
        order_seed: int | None = None,
        link: Link = deliver_immediately,
        requests: bool = False,
        nodes: tuple[Node, ...] = (),
        isolate: bool = False,
        report: Report = lambda problem: None,
    ) -> None:
        store = MemoryStore()

        def servers(deployed: Deployment, frames_kept: int) -> Builders:
            built: dict[str, Callable[[], Node]] = {}
            base, proximity = drivers.base, drivers.proximity
            if base is not None:
                built[RSERVER.name] = lambda: RServer(base, deployment=deployed, frames_kept=frames_kept)
            if proximity is not None:
                built[PROXIMITY] = lambda: PServer(proximity, frames_kept=frames_kept)
            specs = {spec.name: spec for spec in drivers.servers}
            for name, driver in drivers.devices.items():
                built[name] = partial(
                    device_server,
                    specs[name],
                    driver,
                    report,
                    deployment=deployed,
                    frames_kept=frames_kept,
                )
            built[DSERVER.name] = lambda: DServer(
                variables, deployment=deployed, frames_kept=frames_kept, store=store
            )
            built[RUNTIME.name] = lambda: RuntimeServer(seed, frames_kept=frames_kept)
            return built

        frames_kept = frames_to_keep(compiled.frame_ns)
        cameras = (
            CServer(driver, frames_kept=frames_kept, address=name) for name, driver in drivers.cameras.items()
        )
        super().__init__(
            compiled,
            bind(compiled.robot, drivers.servers),
            servers,
            clock=clock,
            seed=seed,
            sinks=sinks,
            order_seed=order_seed,
            link=link,
            requests=requests,
            nodes=(*cameras, *nodes),
            isolate=isolate,
        )
        self._closed = False

    def add(self, sink: Sink) -> None:
        """Add a sink, before `run`."""
        self.observer.add(sink)

    def run(
        self,
        duration_ns: int,
        *,
        stop: Callable[[], bool] = lambda: False,
        pace: Callable[[int], None] | None = None,
    ) -> bool:
        """Run the frames from 0 to before `duration_ns`, once; return False if `stop` ended the run.

        `stop` is checked, and `pace` is called with the time, before each time at which something happens.
        """
        try:
            self.start()
            return self.transport.run_until(duration_ns, stop=stop, pace=pace)
        finally:
            self.close()

    def close(self) -> None:
        """Stop the robot and close the sinks; on failures, continue, then raise the first."""
        if self._closed:
            return
        self._closed = True
        base_first = sorted(self.nodes, key=lambda address: address != RSERVER.name)
        close_all(self.nodes[address] for address in base_first)
