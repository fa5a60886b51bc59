"""A Clock on a stage: the time, the servers that answer it, and connections that lead a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from colony.compile.pipeline import compile_program
from colony.ir.program import Program
from colony.runtime.frames.clock import Clock
from colony.runtime.library import clock as library
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.clock import Participants
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import Deployment, deployment
from colony.runtime.protocol.messages import (
    Alive,
    Effect,
    Fate,
    Fetch,
    Ready,
    Reply,
    ServerFrame,
    Tick,
    Verdict,
)
from tests.kit.calling import CLOSE, opening
from tests.kit.node_stage import MS, Caller, NodeStage, messages, result_of
from tests.robot_servers import ROME_SERVERS
from tests.runtime.programs import roam

CLIENTS = ("drive/back_off", "drive/avoid", "drive/cruise")


def deployed(run: str = "run", program: Program | None = None, **options: object) -> Deployment:
    program = roam() if program is None else program
    made = deployment(compile_program(program).compiled, bind(program.robot, ROME_SERVERS), run=run, seed=1)
    return msgspec.structs.replace(made, **options)  # type: ignore[arg-type]


class Stage(NodeStage):
    """A Clock, and the servers that answer it."""

    node: Clock

    def __init__(
        self,
        deployment: Deployment | None = None,
        *,
        now_ns: int = 0,
        servers: tuple[str, ...] = ("PServer", "RServer"),
        frames_kept: int = 40,
        **options: Any,
    ) -> None:
        self.ticks: list[Tick] = []
        self._answered = 0
        self._answering: tuple[str, ...] | None = None
        super().__init__(
            Clock(servers=servers, frames_kept=frames_kept, deployment=deployment, **options), now_ns
        )

    def keep(self, effects: Sequence[Effect]) -> None:
        super().keep(effects)
        self.ticks += messages(effects, Tick)

    def wake(self) -> None:
        super().wake()
        while self._answering is not None and self._answered < len(self.ticks):
            k = self.ticks[self._answered].k
            self._answered += 1
            self.handle(*(ServerFrame(server=s, k=k, fields={}) for s in self._answering))

    def until(
        self, t_ns: int, alive: Iterable[Caller] = (), answering: tuple[str, ...] = ("PServer", "RServer")
    ) -> list[Effect]:
        """Let time pass; servers answer every tick at once."""
        self._answering = answering
        return super().until(t_ns, alive)

    def ready(self, run: str = "run", clients: Iterable[str] = CLIENTS) -> None:
        self.handle(*(Ready(client=c, run=run) for c in clients))

    def fetched(self, k: int) -> list[Tick]:
        return messages(self.handle(Fetch(server="Clock", k=k)), Tick)


class Leader(Caller):
    """A connection to the Clock of a stage."""

    stage: Stage

    def __init__(self, stage: Stage, connection: str) -> None:
        super().__init__(stage, connection)
        self.ask(opening(connection))

    def ask(self, ask: CallRequest[Any]) -> Reply:
        """Make a call, and let frames pass until it is answered."""
        self.begin(ask)
        while (self.name, self.number) not in self.stage.replies:
            self.stage.pass_time(10 * MS)
        return self.stage.replies[self.name, self.number]

    def deploy(self, what: Deployment) -> str | None:
        problem = self.ask(library.deploy(what)).problem
        return None if problem is None else problem.code

    def who(self) -> Participants:
        return result_of(library.participants(), self.ask(library.participants()))

    def alive(self) -> None:
        self.stage.handle(Alive(connection=self.name))

    def close(self) -> None:
        self.ask(CLOSE)


def verdict(k: int, *fates: tuple[str, Fate]) -> Verdict:
    return Verdict(k=k, t_ns=0, actuator="drive", by=None, values=(0.0, 0.0), fates=fates)
