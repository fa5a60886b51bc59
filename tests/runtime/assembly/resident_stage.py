"""A described robot in virtual time whose limits hold without a program: the real servers, the clients of the
limits and their leader, a joystick, and a program that comes and goes."""

from __future__ import annotations

from collections.abc import Callable

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.compiled import Compiled
from colony.runtime.assembly.limits import lead_limits, limit_bindings, limit_deployment, limit_nodes
from colony.runtime.assembly.nodes import build_clients
from colony.runtime.assembly.sharing import client_processes
from colony.runtime.frames.clock import Clock
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.library import clock, robot
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.messages import Message, Node, Tick, Verdict
from colony.runtime.servers.drivers import Drivers
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.pserver import PServer
from colony.runtime.servers.rserver import RServer
from colony.runtime.servers.runtime_server import RuntimeServer
from colony.runtime.transport.exchange import Delay
from colony.runtime.transport.virtual import VirtualClock, VirtualTransport
from tests.robot_servers import ROME_SERVERS

SERVERS = ("RServer", "PServer", "DServer", "Runtime")


def description(name: str = "rome") -> Compiled:
    """Return a description alone, compiled."""
    return compile_program(load_text("language 1\nimport robot\n", robot=name)).compiled


def joystick(velocity: float, codes: list[str | None]) -> Script:
    """Drive straight on, again and again; note the codes of refusals, None for none."""
    while True:
        try:
            yield from do("RServer", robot.drive(velocity, 0.0, lease=0.3))
            codes.append(None)
        except RobotConnectionError as problem:
            codes.append(getattr(problem, "code", type(problem).__name__))
        yield from sleep(0.1)


class Robot:
    """A robot of a description. Mutable: the nodes that live, and what was sent.

    `ticks` and `verdicts` are those that went over the network, `codes` the answers to the joystick.
    """

    def __init__(self, drivers: Drivers, now: VirtualClock, *, velocity: float, limits: Compiled) -> None:
        self.now, self.drivers, self.limits = now, drivers, limits
        self.ticks: list[Tick] = []
        self.verdicts: list[Verdict] = []
        self.codes: list[str | None] = []
        self.transport = VirtualTransport(now, seed=1, link=self._noting)
        self._programs = 0
        self._builders: dict[str, Callable[[], Node]] = {
            "Clock": lambda: Clock(servers=SERVERS, resident=limit_deployment(limits)),
            "RServer": lambda: RServer(drivers.base),
            "PServer": lambda: PServer(drivers.proximity),
            "DServer": DServer,
            "Runtime": lambda: RuntimeServer(0),
        }
        for build in self._builders.values():
            self.transport.add(build())
        self.start_limits()
        self.transport.add(
            ScriptNode("joystick", joystick(velocity, self.codes), ("RServer",), priority=50, delay_ns=1)
        )

    def start_limits(self) -> None:
        """Start the process of the limits: its clients, and their leader."""
        leader = ScriptNode("limits", lead_limits(self.limits), ("Clock", "RServer"))
        self._limits = [*limit_nodes(self.limits, limit_bindings(self.limits.robot)), leader]
        for node in self._limits:
            self.transport.add(node)

    def kill_limits(self) -> None:
        """Kill the process of the limits."""
        for node in self._limits:
            self.transport.kill(node.address)

    def kill(self, server: str) -> None:
        """Kill a server."""
        self.transport.kill(server)

    def start(self, server: str) -> None:
        """Start a server again."""
        self.transport.add(self._builders[server]())

    def program(self, text: str, *, seconds: float) -> None:
        """Run a program for some time from now on; then its leader ends, and its clients."""
        compiled = compile_program(load_text(text, robot="rome")).compiled
        self._programs += 1
        run = f"run {self._programs}"
        deployed = deployment(compiled, bind(compiled.robot, ROME_SERVERS), run=run, seed=0)
        nodes = [
            node
            for process in client_processes(compiled, isolate=False)
            for node in build_clients(compiled, bind(compiled.robot, ROME_SERVERS), process.clients, run)
        ]

        def lead() -> Script:
            for server in ("Clock", "RServer", "DServer"):
                yield from do(server, clock.deploy(deployed))
            yield from sleep(seconds)

        leader = ScriptNode(f"leader {self._programs}", lead(), ("Clock", "RServer", "DServer"))
        for node in (*nodes, leader):
            self.transport.add(node)
        ends_ns = self.now() + round(seconds * 1e9)
        self.transport.at(ends_ns + 1, lambda: [self.transport.kill(node.address) for node in nodes] and None)

    def run(self, until_ns: int) -> None:
        """Let time pass."""
        self.transport.run_until(until_ns)

    def sent(self, since_ns: int = 0) -> list[Verdict]:
        """The verdicts in which the joystick commanded."""
        return [v for v in self.verdicts if v.t_ns >= since_ns and v.outside is not None]

    def _noting(self, sender: str, receiver: str, message: Message) -> Delay:
        if isinstance(message, Tick) and sender == "Clock" and message not in self.ticks[-1:]:
            self.ticks.append(message)
        if isinstance(message, Verdict) and receiver == "Clock":
            self.verdicts.append(message)
        return 0
