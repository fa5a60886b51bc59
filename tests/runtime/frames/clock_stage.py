"""A Clock on a stage: the time, the servers that answer it, and connections that lead a run."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec

from colony.compile.pipeline import compile_program
from colony.ir.program import Program
from colony.runtime.frames.clock import Clock
from colony.runtime.library import clock as library
from colony.runtime.library.ask import Ask
from colony.runtime.library.clock import Participants
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import Deployment, deployment
from colony.runtime.protocol.interface import Interface
from colony.runtime.protocol.messages import (
    Alive,
    Effect,
    Fate,
    Fetch,
    Message,
    Ready,
    Reply,
    Send,
    ServerFrame,
    Tick,
    Verdict,
    Wake,
    WakeAt,
)
from tests.robot_servers import ROME_SERVERS
from tests.runtime.calling import CLOSE, call_of, opening
from tests.runtime.programs import roam

MS = 1_000_000
S = 1000 * MS
CLIENTS = ("drive/back_off", "drive/avoid", "drive/cruise")


def deployed(run: str = "run", program: Program | None = None, **options: object) -> Deployment:
    program = roam() if program is None else program
    made = deployment(compile_program(program).compiled, bind(program.robot, ROME_SERVERS), run=run, seed=1)
    return msgspec.structs.replace(made, **options)  # type: ignore[arg-type]


class Stage:
    """A Clock, the time, and what it did."""

    def __init__(
        self,
        deployment: Deployment | None = None,
        *,
        now_ns: int = 0,
        servers: tuple[str, ...] = ("PServer", "RServer"),
        frames_kept: int = 40,
        stop_path: Path | None = None,
        interface: Interface | None = None,
    ) -> None:
        self.clock = Clock(
            servers=servers,
            frames_kept=frames_kept,
            deployment=deployment,
            stop_path=stop_path,
            interface=interface,
        )
        self.now_ns = now_ns
        self.ticks: list[Tick] = []
        self.sent: list[Send] = []
        self.wakes: list[int] = []
        self.answered = 0
        self._took(self.clock.start(now_ns))

    def take(self, *messages: Message) -> None:
        for message in messages:
            self._took(self.clock.handle(message, self.now_ns))

    def until(self, t_ns: int, answering: Iterable[str] = ("PServer", "RServer")) -> None:
        """Wake it as it wants until `t_ns`; servers answer every tick at once."""
        while self.wakes and min(self.wakes) <= t_ns:
            self.now_ns = max(self.now_ns, min(self.wakes))
            self.wakes.remove(min(self.wakes))
            self.take(Wake())
            while self.answered < len(self.ticks):
                k = self.ticks[self.answered].k
                self.answered += 1
                self.take(*(ServerFrame(server=s, k=k, fields={}) for s in answering))
        self.now_ns = t_ns

    def ready(self, run: str = "run", clients: Iterable[str] = CLIENTS) -> None:
        self.take(*(Ready(client=c, run=run) for c in clients))

    def fetched(self, k: int) -> list[Tick]:
        self.sent.clear()
        before = len(self.ticks)
        self.take(Fetch(server="Clock", k=k))
        return self.ticks[before:]

    def _took(self, effects: Iterable[Effect]) -> None:
        for effect in effects:
            if isinstance(effect, WakeAt):
                self.wakes.append(effect.t_ns)
            else:
                self.sent.append(effect)
                if isinstance(effect.message, Tick):
                    self.ticks.append(effect.message)


class Leader:
    """A connection to the Clock of a stage."""

    def __init__(self, stage: Stage, connection: str) -> None:
        self._stage = stage
        self._connection = connection
        self._number = 0
        self.ask(opening(connection))

    def send(self, ask: Ask[Any]) -> None:
        self._number += 1
        self._stage.take(call_of(ask, self._connection, self._number))

    def ask(self, ask: Ask[Any]) -> Reply:
        """Make a call, and let frames pass until it is answered."""
        self.send(ask)
        while not self.is_answered:
            self._stage.until(self._stage.now_ns + 10 * MS)
        (reply,) = (s.message for s in self._stage.sent if isinstance(s.message, Reply))
        self._stage.sent = [s for s in self._stage.sent if not isinstance(s.message, Reply)]
        return reply

    @property
    def is_answered(self) -> bool:
        return any(isinstance(s.message, Reply) for s in self._stage.sent)

    def deploy(self, what: Deployment) -> str | None:
        problem = self.ask(library.deploy(what)).problem
        return None if problem is None else problem.code

    def who(self) -> Participants:
        return msgspec.msgpack.decode(self.ask(library.participants()).result, type=Participants)

    def alive(self) -> None:
        self._stage.take(Alive(connection=self._connection))

    def close(self) -> None:
        self.ask(CLOSE)


def verdict(k: int, *fates: tuple[str, Fate]) -> Verdict:
    return Verdict(k=k, t_ns=0, actuator="drive", by=None, values=(0.0, 0.0), fates=fates)
