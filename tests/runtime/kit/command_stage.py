"""A server with a lift, without any transport: what it is made to do, and what it sends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from msgspec import structs

from colony.runtime.kit.commands import Command, command, parameter
from colony.runtime.kit.fields import FieldReader, field
from colony.runtime.kit.service import Service
from colony.runtime.library.ask import Ask
from colony.runtime.library.clock import deploy
from colony.runtime.protocol import topics
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec, Deployment
from colony.runtime.protocol.messages import (
    Effect,
    Message,
    Reply,
    Request,
    Send,
    ServerFrame,
    Tick,
    Verdict,
    Wake,
    WakeAt,
)
from tests.runtime.calling import CLOSE, call_of, opening
from tests.runtime.kit.lift_stage import FRAME_NS, MS


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
        return command(
            "move",
            self.move,
            parameter("height", unit="mm", low=0.0, high=400.0),
            parameter("fast", boolean=True),
            safe=self.safe,
        )


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


def program(run: str = "run", *actuators: ActuatorSpec) -> Deployment:
    return Deployment(run=run, program="p", frame_ns=FRAME_NS, seed=0, actuators=actuators or (LIFT,))


class Caller:
    """A connection to the server of a stage. Mutable: counts its calls."""

    def __init__(self, stage: Stage, name: str, priority: int) -> None:
        self.stage, self.connection, self.priority = stage, f"{name}/1", priority
        self.calls = 1
        stage.handle(call_of(opening(name), self.connection, 1, priority))

    def send(self, ask: Ask[Any]) -> list[Reply]:
        """Make a call, and return the answers that come at once."""
        self.calls += 1
        effects = self.stage.handle(call_of(ask, self.connection, self.calls, self.priority))
        return replies(effects, self.connection)

    def do(self, ask: Ask[Any]) -> str | None:
        """Make a call; return the code of its refusal, or None."""
        [reply] = self.send(ask)
        return None if reply.problem is None else reply.problem.code

    def refusal(self, ask: Ask[Any]) -> str:
        """Make a call that is refused, and return the message."""
        [reply] = self.send(ask)
        assert reply.problem is not None
        return reply.problem.message

    def end(self) -> None:
        """Close the connection."""
        self.stage.handle(call_of(CLOSE, self.connection, self.calls + 1, self.priority))


class Stage:
    """A server with a lift, without any transport. Mutable: `now` is the present."""

    def __init__(self, *deployed: Deployment, lift: Lift | None = None) -> None:
        self.lift = Lift() if lift is None else lift
        self.reports: list[str] = []
        self.now = 1000 * MS
        self.calls = 0
        self.sent: list[Effect] = []
        fields = [field("height", lambda: 7.0, unit="mm")]
        self.service = Service(
            "Lift",
            (),
            FieldReader("Lift", fields, self.reports.append),
            self.reports.append,
            commands=[self.lift.command()],
        )
        self.sent += self.service.start(self.now)
        assert self.take() == ["safe"], "nobody knows what it did before"
        if deployed:
            self.open()
            for program in deployed:
                assert self.do(deploy(program)).problem is None

    def handle(self, *messages: Message) -> list[Effect]:
        effects = [effect for message in messages for effect in self.service.handle(message, self.now)]
        self.sent += effects
        return effects

    def take(self) -> list[Any]:
        """What the lift was made to do since the last time."""
        done, self.lift.done = self.lift.done, []
        return done

    def tick(self, k: int, run: str = "run", **options: Any) -> list[Effect]:
        self.now += FRAME_NS
        return self.handle(Tick(k=k, t_ns=self.now, run=run, **options))

    def bid(self, k: int, *values: float | bool, client: str = "up", **options: Any) -> list[Effect]:
        request = Request(k=k, actuator="lift", client=client, bid="inactive")
        if values:
            request = structs.replace(request, bid="command", values=values)
        return self.handle(structs.replace(request, **options))

    def decide(self, k: int, *values: float | bool) -> list[Effect]:
        """A frame of which both clients are heard; `up` commands, or nobody."""
        return [*self.tick(k), *self.bid(k, *values), *self.bid(k, client="down")]

    def pass_time(self, ns: int) -> list[Effect]:
        end, effects = self.now + ns, list[Effect]()
        wakes = sorted({e.t_ns for e in self.sent if isinstance(e, WakeAt) and self.now < e.t_ns <= end})
        for due in [*wakes, end]:
            self.now = due
            effects += self.handle(Wake())
        return effects

    def open(self, connection: str = "ada/1") -> None:
        self.handle(call_of(opening("leader"), connection))
        self.calls = 1

    def do(self, ask: Ask[Any], connection: str = "ada/1") -> Reply:
        self.calls += 1
        effects = self.handle(call_of(ask, connection, self.calls))
        [reply] = [e.message for e in effects if isinstance(e, Send) and isinstance(e.message, Reply)]
        return reply


def replies(effects: Sequence[Effect], connection: str) -> list[Reply]:
    answers = [e.message for e in effects if isinstance(e, Send) and isinstance(e.message, Reply)]
    return [answer for answer in answers if answer.connection == connection]


def verdicts(effects: Sequence[Effect]) -> list[Verdict]:
    return [e.message for e in effects if isinstance(e, Send) and isinstance(e.message, Verdict)]


def frames(effects: Sequence[Effect]) -> list[ServerFrame]:
    topic = topics.frames("Lift")
    return [e.message for e in effects if isinstance(e, Send) and e.topic == topic]  # type: ignore[misc]
