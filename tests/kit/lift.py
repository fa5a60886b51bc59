"""A lift of a server written with the kit: alone on a stage, and of a robot in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from msgspec import structs

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.runtime.assembly.virtual import Builders, VirtualRobot
from colony.runtime.kit.commands import Command, command, parameter
from colony.runtime.kit.description import Description, Field, FieldReader, Reading, field, server_spec
from colony.runtime.kit.service import Service
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.clock import deploy
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec, Deployment
from colony.runtime.protocol.messages import Effect, Request, SendMessage, ServerFrame, Tick, Verdict
from colony.runtime.servers.dserver import DServer
from colony.runtime.transport.virtual import VirtualClock
from tests.kit.calling import call_of, opening
from tests.kit.node_stage import FRAME_NS, MS, Caller, NodeStage, messages
from tests.robot_servers import ROME_SERVERS
from tests.runtime.scripted import Log

HEIGHT = ActuatorFieldSpec(name="height", kind="number", factor=1.0, low=0.0, high=400.0)
FAST = ActuatorFieldSpec(name="fast", kind="bool", factor=1.0, low=None, high=None)
LIFT = ActuatorSpec(
    name="lift",
    fields=(HEIGHT, FAST),
    server="Lift",
    command="move",
    field_indices=(0, 1),
    idle=(0.0, False),
    on_loss="stop",
    clients=(("up", 2), ("down", 1)),
    reported=(0, 1),
)
HOLDING = structs.replace(LIFT, idle=None)


def move_command(
    perform: Callable[[float, bool], object], safe: Callable[[], object] | None = None
) -> Command:
    """Return the command of a lift."""
    height = parameter("height", unit="mm", low=0.0, high=400.0)
    return command("move", perform, height, parameter("fast", boolean=True), safe=safe)


def service(fields: Sequence[Field], commands: Sequence[Command], report: Callable[[str], None]) -> Service:
    """Return the server Lift."""
    return Service("Lift", (), FieldReader("Lift", fields, report), report, commands=commands)


class Lift:
    """A device. Mutable: `done` is all that it was made to do."""

    def __init__(self) -> None:
        self.done: list[Any] = []
        self.failure: Exception | None = None

    def move(self, height: float, fast: bool) -> None:
        if self.failure is not None:
            raise self.failure
        self.done.append((height, fast))

    def safe(self) -> None:
        self.done.append("safe")

    def command(self) -> Command:
        return move_command(self.move, self.safe)


def program(run: str = "run", *actuators: ActuatorSpec) -> Deployment:
    return Deployment(run=run, program="p", frame_ns=FRAME_NS, seed=0, actuators=actuators or (LIFT,))


class Stage(NodeStage):
    """A server with a lift, and its leader, where something is deployed."""

    node: Service

    def __init__(self, *deployed: Deployment, lift: Lift | None = None) -> None:
        self.lift = Lift() if lift is None else lift
        self.reports: list[str] = []
        height = field("height", lambda: 7.0, unit="mm")
        super().__init__(service([height], [self.lift.command()], self.reports.append), 1000 * MS)
        assert self.take() == ["safe"], "nobody knows what it did before"
        self.leader = Caller(self, "ada/1")
        if deployed:
            self.leader.open("leader")
            for program in deployed:
                self.leader.do(deploy(program))

    def take(self) -> list[Any]:
        """What the lift was made to do since the last time."""
        done, self.lift.done = self.lift.done, []
        return done

    def tick(self, k: int, run: str = "run", **options: Any) -> list[Effect]:
        self.now_ns += FRAME_NS
        return self.handle(Tick(k=k, t_ns=self.now_ns, run=run, **options))

    def bid(self, k: int, *values: float | bool, client: str = "up", **options: Any) -> list[Effect]:
        request = Request(k=k, actuator="lift", client=client, bid="inactive")
        if values:
            request = structs.replace(request, bid="command", values=values)
        return self.handle(structs.replace(request, **options))

    def decide(self, k: int, *values: float | bool) -> list[Effect]:
        """A frame of which both clients are heard; `up` commands, or nobody."""
        return [*self.tick(k), *self.bid(k, *values), *self.bid(k, client="down")]


def verdicts(effects: Sequence[Effect]) -> list[Verdict]:
    return messages(effects, Verdict)


def frames(effects: Sequence[Effect]) -> list[ServerFrame]:
    topic = topics.frames("Lift")
    return [e.message for e in effects if isinstance(e, SendMessage) and e.topic == topic]  # type: ignore[misc]


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

    `told` is what the lift was told last in each frame.
    """

    def __init__(self) -> None:
        self.clock, self.log, self.reports = VirtualClock(), Log(), list[str]()
        self.told: dict[int, tuple[float, bool]] = {}
        self.height = 250.0
        self._field = field("height", lambda: Reading(self.height, age_ns=0), unit="mm", has_age=True)
        self._command = move_command(self._perform)
        fields, commands = (self._field.description,), (self._command.description,)
        compiled = compile_program(load_text(PROGRAM)).compiled
        spec = server_spec(Description(server="Lift", fields=fields, commands=commands))
        bindings = bind(compiled.robot, (*ROME_SERVERS, spec))
        self.robot = VirtualRobot(
            compiled, bindings, self._servers, clock=self.clock, seed=0, sinks=(self.log,)
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

    def call(self, server: str, ask: CallRequest[Any], connection: str = "eve/1", number: int = 1) -> None:
        """Make a call now."""
        self.robot.transport.inject(topics.calls(server), call_of(ask, connection, number))

    def at(self, k: int, action: Callable[[], object]) -> None:
        """Do something 10 ms after the tick of frame k."""
        self.robot.transport.at(k * FRAME_NS + 10 * MS, lambda: action() and None)

    def run(self, frames: int) -> None:
        """For so many frames."""
        self.robot.transport.run_until(frames * FRAME_NS)
        self.robot.observer.close()

    def _perform(self, height: float, fast: bool) -> None:
        self.told[self.clock() // FRAME_NS] = (height, fast)
        self.height += max(-10.0, min(10.0, height - self.height))

    def _servers(self, deployed: Deployment, frames_kept: int) -> Builders:
        return {
            "DServer": lambda: DServer(deployment=deployed, frames_kept=frames_kept),
            "Lift": lambda: service([self._field], [self._command], self.reports.append),
        }


UP, DOWN, IDLE = (400.0, True), (100.0, False), (0.0, False)
"""What the program has the lift do."""
