"""A robot with a lift of its own server, in virtual time: real Clock, clients, observer and kit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from colony.compile.pipeline import compile_program
from colony.dsl.load import check_text
from colony.runtime.assembly.virtual import Builders, VirtualRobot
from colony.runtime.kit.commands import Command, command, parameter
from colony.runtime.kit.description import Description, server_spec
from colony.runtime.kit.fields import Field, FieldReader, Reading, field
from colony.runtime.kit.service import Service
from colony.runtime.library.ask import Ask
from colony.runtime.library.clock import deploy
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.servers.dserver import DServer
from colony.runtime.transport.virtual import Link, VirtualClock, deliver_immediately
from tests.robot_servers import ROME_SERVERS
from tests.runtime.calling import call_of, opening
from tests.runtime.scripted import Log

MS = 1_000_000
FRAME_NS = 50 * MS

PROGRAM = """
language 1
robot amr {
  sensor   height : mm  from Lift.height  within 300 ms
  actuator lift { height : mm range 0 .. 400, fast : bool }
           to Lift.move  idle lift(height = 0 mm, fast = false)
}
module up { when height < 300 mm  do lift(height = 400 mm, fast = true) }
module down { when last.lift.height > 0 mm and height >= 300 mm  do lift(height = 100 mm, fast = false) }
network { lift = up suppresses down }
"""


class Robot:
    """A robot with a lift that moves 10 mm a frame where it is told to. Mutable.

    `told` is what the lift was told last in each frame, `all_told` all of it with its times.
    """

    def __init__(self, link: Link = deliver_immediately, *, seed: int = 0) -> None:
        checked = check_text(PROGRAM)
        assert checked.program is not None, checked.diagnostics
        self.clock, self.log, self.reports = VirtualClock(), Log(), list[str]()
        self.told: dict[int, tuple[float, bool]] = {}
        self.all_told: list[tuple[int, tuple[float, bool]]] = []
        self.height = 250.0
        height, move = self._height(), self._move()
        description = Description(server="Lift", fields=(height.description,), commands=(move.description,))
        compiled = compile_program(checked.program).compiled
        bindings = bind(compiled.robot, (*ROME_SERVERS, server_spec(description)))
        self.robot = VirtualRobot(
            compiled, bindings, self._servers, clock=self.clock, seed=seed, sinks=(self.log,), link=link
        )
        self.robot.start()
        self._deployments = 0
        self.deploy()

    def deploy(self) -> None:
        """Deploy the program to the lift, as the leader does again after each restart of the server."""
        self._deployments += 1
        leader = f"ada/{self._deployments}"
        self.call("Lift", opening("leader"), leader)
        deployed = deploy(self.robot.deployed)
        self.robot.transport.at(self.clock() + 1, lambda: self.call("Lift", deployed, leader, 2))

    def call(self, server: str, ask: Ask[Any], connection: str = "eve/1", number: int = 1) -> None:
        """Make a call now."""
        self.robot.transport.inject(topics.calls(server), call_of(ask, connection, number))

    def at(self, k: int, action: Callable[[], object]) -> None:
        """Do something 10 ms after the tick of frame k."""
        self.robot.transport.at(k * FRAME_NS + 10 * MS, lambda: action() and None)

    def run(self, frames: int) -> None:
        """For so many frames."""
        self.robot.transport.run_until(frames * FRAME_NS)
        self.robot.observer.close()

    def _height(self) -> Field:
        return field("height", lambda: Reading(self.height, age_ns=0), unit="mm", has_age=True)

    def _move(self) -> Command:
        return command(
            "move",
            self._perform,
            parameter("height", unit="mm", low=0.0, high=400.0),
            parameter("fast", boolean=True),
        )

    def _perform(self, height: float, fast: bool) -> None:
        self.told[self.clock() // FRAME_NS] = (height, fast)
        self.all_told.append((self.clock(), (height, fast)))
        self.height += max(-10.0, min(10.0, height - self.height))

    def _servers(self, deployed: Deployment, frames_kept: int) -> Builders:
        height, move = self._height(), self._move()
        return {
            "DServer": lambda: DServer(deployment=deployed, frames_kept=frames_kept),
            "Lift": lambda: Service(
                "Lift",
                (),
                FieldReader("Lift", [height], self.reports.append),
                self.reports.append,
                commands=[move],
            ),
        }


UP, DOWN, IDLE = (400.0, True), (100.0, False), (0.0, False)
"""What the program has the lift do."""
