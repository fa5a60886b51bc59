"""The process that sees everything and commands nothing: it puts each frame together with its verdicts,
has it checked by the monitor, and hands it to the sinks (a recording, a summary, a progress line)."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from colony.ir.frame import Frame, Outcome
from colony.runtime import topics
from colony.runtime.assembly import KEPT_NS, Assembled, FrameAssembler
from colony.runtime.messages import Effect, Message, ServerFrame, Tick, Verdict
from colony.runtime.monitor import Monitor


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameLog:
    """All of one frame: what was sensed, what each actuator's server decided, and what should have been.

    A verdict may be absent, where a run broke off in the middle of a frame. `disagreements` tell how the
    verdicts differ from `expected` although nobody was late or lost: there should never be one.
    """

    tick: Tick
    frame: Frame
    verdicts: Mapping[str, Verdict]
    expected: Outcome
    disagreements: tuple[str, ...]


class Sink(Protocol):
    """Takes frames in their order."""

    def take(self, log: FrameLog) -> None: ...

    def close(self) -> None:
        """No more frames come; called once, also after a failure."""
        ...


class Observer:
    """Mutable: frames that still wait for verdicts."""

    address = "Observer"

    def __init__(
        self,
        assembler: FrameAssembler,
        actuators: tuple[str, ...],
        monitor: Monitor,
        sinks: tuple[Sink, ...],
    ) -> None:
        self._assembler = assembler
        self._actuators = actuators
        self._monitor = monitor
        self._sinks = sinks
        self._waiting: deque[Assembled] = deque()
        self._verdicts: dict[int, dict[str, Verdict]] = {}
        self.listens = (*assembler.listens, topics.VERDICTS)

    def add(self, sink: Sink) -> None:
        """One more sink, before the first frame."""
        self._sinks = (*self._sinks, sink)

    def start(self, now_ns: int) -> Iterable[Effect]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        effects: tuple[Effect, ...] = ()
        match message:
            case Tick() | ServerFrame():
                effects = self._assembler.take(message)
                self._waiting.extend(self._assembler.complete())
            case Verdict():
                self._verdicts.setdefault(message.k, {})[message.actuator] = message
            case _:
                return ()
        while self._waiting and self._ready(self._waiting[0], now_ns):
            self._release()
        return effects

    def close(self) -> None:
        """Hand over what is there, and close the sinks whatever happens."""
        try:
            while self._waiting:
                self._release()
        finally:
            _close_all(self._sinks)

    def _ready(self, first: Assembled, now_ns: int) -> bool:
        verdicts = self._verdicts.get(first.tick.k, {})
        return len(verdicts) == len(self._actuators) or now_ns - first.tick.t_ns > KEPT_NS

    def _release(self) -> None:
        tick, frame, _, _ = self._waiting.popleft()
        verdicts = self._verdicts.pop(tick.k, {})
        expected, disagreements = self._monitor.check(frame, verdicts)
        log = FrameLog(
            tick=tick, frame=frame, verdicts=verdicts, expected=expected, disagreements=disagreements
        )
        for sink in self._sinks:
            sink.take(log)


def _close_all(sinks: tuple[Sink, ...]) -> None:
    """Close each sink even where closing another fails; the first failure is raised in the end."""
    failures: list[BaseException] = []
    for sink in sinks:
        try:
            sink.close()
        except BaseException as failure:
            failures.append(failure)
    if failures:
        raise failures[0]
