"""RServer alone on a stage: a base that rolls as it is told, ticks, and people who call."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from colony.runtime.arbitration.stop_latch import StopLatch
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec, Deployment
from colony.runtime.protocol.messages import (
    Alive,
    Effect,
    Problem,
    Reply,
    Request,
    ServerFrame,
    Tick,
    Verdict,
)
from colony.runtime.servers.drivers import BaseLimits, BaseState
from colony.runtime.servers.rserver import RServer
from tests.kit.calling import opening
from tests.kit.node_stage import FRAME_NS, MS, Caller, NodeStage, messages

LIMITS = BaseLimits(velocity=600.0, turn=90.0, acceleration=800.0, turn_acceleration=240.0)


class RollingBase:
    """A base without errors that takes on its speeds at once; `pushed` is what it turns besides, in deg/s.

    `held`: something keeps it from moving. `mute`: it gives nothing. `unreached`: why stops do not reach it.
    """

    limits = LIMITS
    register_bits: int | None = None
    unreached: str | None = None

    def __init__(self) -> None:
        self.now_ns = 0
        self.x = self.y = self.heading = 0.0
        self.velocity = self.turn = self.pushed = 0.0
        self.front = self.rear = self.held = self.mute = False
        self.told: list[tuple[int, float, float]] = []
        self.stops: list[int] = []

    def roll(self, now_ns: int) -> None:
        while self.now_ns < now_ns:
            dt = min(now_ns - self.now_ns, MS) / 1e9
            self.now_ns += min(now_ns - self.now_ns, MS)
            if not self.held:
                self.heading = (self.heading + (self.turn + self.pushed) * dt) % 360.0
                self.x -= math.sin(math.radians(self.heading)) * self.velocity * dt
                self.y += math.cos(math.radians(self.heading)) * self.velocity * dt

    def drive(self, velocity: float, turn: float) -> None:
        self.velocity, self.turn = velocity, turn
        self.told.append((self.now_ns, velocity, turn))

    def stop(self) -> None:
        self.velocity = self.turn = 0.0
        self.stops.append(self.now_ns)

    def state(self) -> BaseState | None:
        if self.mute:
            return None
        return BaseState(
            t_ns=self.now_ns,
            x=self.x,
            y=self.y,
            heading=self.heading,
            front_bumper=self.front,
            rear_bumper=self.rear,
            speed=self.velocity,
            turn_rate=self.turn,
            wheel_speed=abs(self.velocity),
        )


def stage_in_run(**options: Any) -> Stage:
    """Return a stage on which a program runs."""
    return Stage(run="r1", deployment=deployed(), **options)


class Stage(NodeStage):
    """Ticks an RServer and keeps what it says. `latch` is that of the Clock that ticks."""

    def __init__(self, base: RollingBase | None = None, *, run: str = "", **options: Any) -> None:
        self.base = RollingBase() if base is None else base
        self.latch = StopLatch(None)
        self.run = run
        self.k = -1
        self.verdicts: list[Verdict] = []
        self.frames: list[ServerFrame] = []
        self.callers: dict[str, Caller] = {}
        self._alive: set[str] = set()
        super().__init__(RServer(self.base, **options))

    # --- time ----------------------------------------------------------------------------------------

    def advance(self, t_ns: int) -> None:
        super().advance(t_ns)
        self.base.roll(self.now_ns)

    def tick(self, *, lost: Iterable[str] = (), run: str | None = None) -> None:
        """The next frame begins."""
        self.until((self.k + 1) * FRAME_NS)
        self.k += 1
        self.handle(*(Alive(connection=connection) for connection in sorted(self._alive)))
        stop = {"stopped": self.latch.stopped, "released_ns": self.latch.released_ns}
        run = self.run if run is None else run
        self.handle(Tick(k=self.k, t_ns=self.k * FRAME_NS, run=run, lost=tuple(lost), **stop))  # type: ignore[arg-type]

    def release(self) -> None:
        """The Clock releases the emergency stop; the next tick says so."""
        self.latch.release(self.now_ns)

    def frame(self, *requests: Request, count: int = 1, lost: Iterable[str] = ()) -> Verdict | None:
        """Whole frames, with these requests in each; gives the verdict of the last one."""
        before = len(self.verdicts)
        for _ in range(count):
            self.tick(lost=lost)
            self.handle(*(msgspec.structs.replace(request, k=self.k) for request in requests))
            self.until(self.k * FRAME_NS + FRAME_NS - 1)
        return self.verdicts[-1] if len(self.verdicts) > before else None

    def frames_until(self, connection: str, number: int, most: int = 2000) -> Reply:
        """Frames until a call is answered."""
        for _ in range(most):
            if (connection, number) in self.replies:
                return self.replies[connection, number]
            self.frame()
        raise AssertionError(f"{connection} waits for the answer to call {number} in vain")

    def keep(self, effects: Sequence[Effect]) -> None:
        super().keep(effects)
        self.verdicts += messages(effects, Verdict)
        for frame in messages(effects, ServerFrame):
            self.frames.append(frame)
            self.latch.observe(frame.stopped)

    # --- people --------------------------------------------------------------------------------------

    def open(self, connection: str, priority: int = 0, name: str | None = None) -> str:
        """A connection, which stays alive until `die`."""
        self.caller(connection).priority = priority
        self._alive.add(connection)
        self.send(connection, opening(name or connection))
        return connection

    def caller(self, connection: str) -> Caller:
        return self.callers.setdefault(connection, Caller(self, connection))

    def die(self, connection: str) -> None:
        """No sign of life from here on."""
        self._alive.remove(connection)

    def send(self, connection: str, ask: CallRequest[Any]) -> int:
        """Make a call; gives its number."""
        self.caller(connection).begin(ask)
        return self.caller(connection).number

    def do(self, connection: str, ask: CallRequest[Any]) -> Any:
        """Make a call that is answered at once, and does."""
        return self.caller(connection).do(ask)

    def problem(self, connection: str, ask: CallRequest[Any]) -> Problem:
        """Make a call that is refused at once."""
        return self.caller(connection).problem(ask)

    def close(self, connection: str) -> None:
        self._alive.discard(connection)
        self.caller(connection).close()


CLIENTS = (("back_off", 3), ("avoid", 2), ("cruise", 1))


def deployed(run: str = "r1", clients: tuple[tuple[str, int], ...] = CLIENTS, **changes: Any) -> Deployment:
    """A program that commands the base with velocity and turn."""
    table: dict[str, Any] = {
        "name": "drive",
        "fields": (
            ActuatorFieldSpec(name="velocity", kind="number", factor=1.0, low=-300.0, high=500.0),
            ActuatorFieldSpec(name="turn", kind="number", factor=1.0, low=-60.0, high=60.0),
        ),
        "server": "RServer",
        "command": "drive",
        "field_indices": (0, 1),
        "idle": (0.0, 0.0),
        "on_loss": "stop",
        "clients": clients,
    }
    actuators = changes.pop("actuators", None)
    if actuators is None:
        actuators = (ActuatorSpec(**(table | changes)),)
    return Deployment(run=run, program="p", frame_ns=FRAME_NS, seed=1, actuators=actuators)


def bid(client: str, *values: float, bid: str = "command") -> Request:
    """A request of a client, of which the frame is filled in."""
    kind = bid if not values else "command"
    return Request(k=0, actuator="drive", client=client, bid=kind, values=values or None)  # type: ignore[arg-type]


def silent(*but: str) -> tuple[Request, ...]:
    """That all clients have nothing to say, but for these."""
    return tuple(bid(client, bid="silent") for client, _ in CLIENTS if client not in but)
