"""A whole robot in one process: clock, servers, clients and observer, joined by a transport in virtual time.

    clock = VirtualClock()
    session = Session(program, compiled.clients, drivers, clock=clock, seed=1)
    session.run(60_000_000_000)

Whatever ends a run, be it an exception, the robot is stopped and the sinks are closed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from colony.compile.clients import ClientList
from colony.ir.program import Program
from colony.ir.types import Value
from colony.runtime.arbitration import timing
from colony.runtime.assembly import KEPT_MOST, KEPT_NS
from colony.runtime.bindings import bind
from colony.runtime.clock import Clock
from colony.runtime.drivers import Drivers
from colony.runtime.fields import DSERVER, RSERVER
from colony.runtime.liveness import lease
from colony.runtime.messages import Node
from colony.runtime.observer import Sink
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.pserver import PServer
from colony.runtime.servers.rserver import RServer
from colony.runtime.servers.runtime_server import RuntimeServer
from colony.runtime.team import client_addresses, commanded_by, team
from colony.runtime.virtual import Link, VirtualClock, VirtualTransport, perfect


class Session:
    """One robot and one run of it. Mutable: everything below it.

    Args:
        program, clients: what is run, and its compiled form.
        drivers: the devices; they tell time by `clock`.
        seed: of `Runtime.random`.
        variables: DServer's, held as they are (see `DServer`), in declared units.
        sinks: who takes the frames.
        order_seed: of the order in which messages of one moment arrive; no result depends on it.
        link: faults of the transport.

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
    ) -> None:
        frame_ns = program.robot.frame_ns
        bindings = bind(program)
        members = team(program, clients, bindings, sinks)
        times, keep = timing(frame_ns), min(max(2, KEPT_NS // frame_ns), KEPT_MOST)
        servers: tuple[Node, ...] = (
            RServer(
                drivers.base,
                commanded_by(program, clients, bindings, RSERVER.name),
                times=times,
                watchdog_ns=lease(frame_ns),
                keep=keep,
            ),
            PServer(drivers.proximity, keep=keep),
            DServer(
                variables or {},
                commanded_by(program, clients, bindings, DSERVER.name),
                announced=members.announced,
                times=times,
                keep=keep,
            ),
            RuntimeServer(seed, keep=keep),
        )
        ticking = Clock(
            frame_ns=frame_ns,
            servers=tuple(s.address for s in servers),
            clients=client_addresses(program, clients, bindings),
            lease_ns=lease(frame_ns),
            keep=keep,
        )
        self._observer = members.observer
        self._nodes = (*servers, *members.clients, *members.announcers, members.observer, ticking)
        self.transport = VirtualTransport(clock, seed=seed if order_seed is None else order_seed, link=link)
        self._closed = False

    def add(self, sink: Sink) -> None:
        """One more sink, before `run`."""
        self._observer.add(sink)

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
            for node in self._nodes:
                self.transport.add(node)
            return self.transport.run_until(duration_ns, stop=stop, pace=pace)
        finally:
            self.close()

    def close(self) -> None:
        """Stop the robot and close the sinks; all of it is tried, then the first failure is raised."""
        if self._closed:
            return
        self._closed = True
        failures: list[BaseException] = []
        for node in self._nodes:  # RServer is the first
            try:
                node.close()
            except BaseException as failure:
                failures.append(failure)
        if failures:
            raise failures[0]
