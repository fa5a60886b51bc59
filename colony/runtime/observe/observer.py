"""The observer: it sees everything and commands nothing.

It combines each frame with its verdicts, has the monitor check it, and passes it to the sinks (a recording, a
summary, a progress line).

A frame of a server that is killed while it publishes may reach the observer and no other node. When a tick
declares it void, the monitor has stepped over a frame that no client saw, and could expect nothing for the
rest of the run. Like a client to which this happens, the observer then asks the Clock for a new epoch.

The answers of modules in Python come as frames, too. They delay no other frame: a frame waits for them as it
waits for its verdicts, and proceeds without them after a timeout.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, TypeVar

from colony.ir.frame import Answer, Frame, Outcome
from colony.runtime.frames.assembler import KEPT_NS, Assembled, FrameAssembler
from colony.runtime.observe.closing import close_all
from colony.runtime.observe.monitor import Keyframe, Monitor
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import (
    UNHEARD,
    Effect,
    Message,
    Request,
    Restart,
    Send,
    ServerFrame,
    Tick,
    Verdict,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameLog:
    """All data of one frame: the readings, each actuator's verdict, and the expected outcome.

    A verdict may be absent if a run broke off in the middle of a frame. `disagreements` describe differences
    of the verdicts from `expected` although no client was late or lost: there should never be one. `restart`
    is True if all memory restarted with this frame in the middle of a run; `requests` are those of the
    clients, as they came (if they are observed). `skipped` frames before this one were missed for good; from
    there to the next restart nothing is expected, as memory is unknown. `keyframe`, at least every
    `KEYFRAME_NS`, has the memory before the frame. `answers` are those of modules in Python, as far as they
    are known.
    """

    tick: Tick
    frame: Frame
    verdicts: Mapping[str, Verdict]
    expected: Outcome
    disagreements: tuple[str, ...]
    restart: bool = False
    requests: tuple[Request, ...] = ()
    skipped: int = 0
    keyframe: Keyframe | None = None
    answers: Mapping[str, Answer] = field(default_factory=dict)

    @property
    def breaches(self) -> tuple[str, ...]:
        """The contracts that are broken in this frame."""
        return self.expected.breaches

    @property
    def damaged(self) -> bool:
        """True if data before this frame is damaged; only a recording can be."""
        return False

    @property
    def memory_unknown(self) -> bool:
        """True if memory is unknown, and so nothing is expected."""
        return not self.expected.decisions


class Sink(Protocol):
    """A consumer of frames in their order."""

    def take(self, log: FrameLog) -> None:
        """Take the next frame."""
        ...

    def close(self) -> None:
        """End the frames; called once, also after a failure."""
        ...


class _Waiting(NamedTuple):
    """A frame that came at `came_ns`, after `skipped` missed ones, which may make memory unknown."""

    assembled: Assembled
    came_ns: int
    skipped: int
    memory_unknown: bool


KEYFRAME_NS = 400_000_000
"""Longest time in ns from a keyframe to the end of the last frame before the next one.

Longer frames exceed it. With the frame that is being decided it stays below half a second.
"""


class Observer:
    """The node that observes a run.

    Mutable: frames that still wait for verdicts, and the epoch of which it stepped over a void frame.

    Args:
        assembler: the assembler of all sensors.
        actuators: the actuators by name; a frame is complete with a verdict of each.
        monitor: the checker of the frames.
        sinks: the consumers of the frames.
        heeded: servers whose requests are passed on too.
        modules: the assembler of the modules in Python, if there are any.
        frame_ns: the period of the program's frames.
    """

    address = topics.OBSERVER

    def __init__(
        self,
        assembler: FrameAssembler,
        actuators: tuple[str, ...],
        monitor: Monitor,
        sinks: tuple[Sink, ...],
        heeded: tuple[str, ...] = (),
        *,
        modules: FrameAssembler | None = None,
        frame_ns: int = 0,
    ) -> None:
        self._assembler = assembler
        self._modules = modules
        self._actuators = frozenset(actuators)
        self._monitor = monitor
        self._sinks = sinks
        self._waiting: deque[_Waiting] = deque()
        self._verdicts: dict[int, dict[str, Verdict]] = {}
        self._requests: dict[int, dict[tuple[str, str], Request]] = {}
        self._answers: dict[int, dict[str, Answer]] = {}
        self._heeds = bool(heeded)
        self._first = True
        self._keyframe_ns: int | None = None
        self._frame_ns = frame_ns
        self._skipped, self._memory_unknown = 0, True
        self._contradicted: int | None = None
        listens = (*assembler.listens, *(modules.listens if modules else ()), topics.VERDICTS)
        self.listens = tuple(dict.fromkeys((*listens, *(topics.requests(s) for s in heeded))))

    @property
    def deferred(self) -> tuple[str, ...]:
        """All topics but ticks. A frame is processed when the next tick arrives; by then it is decided."""
        return tuple(topic for topic in self.listens if topic != topics.TICKS)

    def add(self, sink: Sink) -> None:
        """Add a sink; call this before the first frame."""
        self._sinks = (*self._sinks, sink)

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Do nothing."""
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Collect frames, verdicts and requests, and pass complete frames to the sinks."""
        effects: tuple[Effect, ...] = ()
        match message:
            case Tick() | ServerFrame():
                effects = (*self._assembler.take(message), *self._take_answers(message))
                self._collect(now_ns)
                if self._assembler.lost:
                    self._skip()
                    self._collect(now_ns)
                if isinstance(message, Tick) and self._contradicted == self._assembler.start:
                    restart = Restart(client=self.address, start=self._contradicted)
                    effects = (*effects, Send(topics.RESTARTS, restart))
            case Verdict():
                if message.actuator in self._actuators:
                    _kept(self._verdicts, message.k)[message.actuator] = message
            case Request():
                _kept(self._requests, message.k).setdefault((message.actuator, message.client), message)
            case _:
                return ()
        while self._waiting and self._ready(self._waiting[0], now_ns):
            self._release()
        return effects

    def close(self) -> None:
        """Pass on the frames that wait, and close the sinks in any case."""
        try:
            while self._waiting:
                self._release()
        finally:
            close_all(self._sinks)

    def _skip(self) -> None:
        """Skip frames that are lost; note the epoch if a frame that was handed out has turned void."""
        left_out = self._assembler.skip()
        if not left_out:
            self._contradicted = self._assembler.start
        self._skipped += left_out
        self._memory_unknown = True

    def _take_answers(self, message: Tick | ServerFrame) -> tuple[Effect, ...]:
        """Note the answers of modules in Python; do not wait for one that is too far behind."""
        if self._modules is None:
            return ()
        effects = self._modules.take(message)
        for assembled in self._modules.complete():
            _kept(self._answers, assembled.tick.k).update(assembled.answers)
        if self._modules.lost:
            self._modules.skip()
        return effects

    def _collect(self, now_ns: int) -> None:
        for assembled in self._assembler.complete():
            self._waiting.append(_Waiting(assembled, now_ns, self._skipped, self._memory_unknown))
            self._skipped, self._memory_unknown = 0, False

    def _ready(self, first: _Waiting, now_ns: int) -> bool:
        k = first.assembled.tick.k
        answered = self._modules is None or k < self._modules.next
        if not answered or len(self._verdicts.get(k, ())) < len(self._actuators):
            return now_ns - first.came_ns > KEPT_NS
        return not self._heeds or self._heard(k) or len(self._waiting) > 1

    def _heard(self, k: int) -> bool:
        """Return True if all requests that count in a frame's verdicts have come (perhaps after these)."""
        requests, verdicts = self._requests.get(k, {}), self._verdicts.get(k, {})
        return all(
            (actuator, client) in requests or fate in UNHEARD
            for actuator, verdict in verdicts.items()
            for client, fate in verdict.fates
        )

    def _release(self) -> None:
        assembled, _, skipped, memory_unknown = self._waiting.popleft()
        tick, frame = assembled.tick, assembled.frame
        verdicts, requests = _taken(self._verdicts, tick.k), _taken(self._requests, tick.k)
        answers = _taken(self._answers, tick.k)
        if assembled.restart:
            self._monitor.restart()
        elif memory_unknown:
            self._monitor.lose_memory()
        keyframe = self._keyframe(tick.t_ns, assembled.restart or memory_unknown)
        expected, disagreements = self._monitor.check(frame, verdicts, tick.lost, answers)
        log = FrameLog(
            tick=tick,
            frame=frame,
            verdicts=verdicts,
            expected=expected,
            disagreements=disagreements,
            restart=assembled.restart and not self._first,
            requests=tuple(requests.values()),
            skipped=skipped,
            keyframe=keyframe,
            answers=answers,
        )
        self._first = False
        for sink in self._sinks:
            sink.take(log)

    def _keyframe(self, t_ns: int, jumped: bool) -> Keyframe | None:
        """Return the memory before a frame if it is due, or if frames are missing before it (`jumped`)."""
        begun_ns = self._keyframe_ns
        if begun_ns is not None and t_ns + self._frame_ns - begun_ns <= KEYFRAME_NS and not jumped:
            return None
        self._keyframe_ns = t_ns
        return self._monitor.keyframe()


K = TypeVar("K")
V = TypeVar("V")

_MOST_WAITING = 20_000
"""Largest number of frames that are kept in part, before they are complete."""


def _kept(of: dict[int, dict[K, V]], k: int) -> dict[K, V]:
    """Return the part of frame `k` that is kept so far."""
    found = of.setdefault(k, {})
    if len(of) > _MOST_WAITING:
        del of[next(iter(of))]
    return found


def _taken(of: dict[int, dict[K, V]], k: int) -> dict[K, V]:
    """Remove and return the part of frame `k` that is kept; drop older frames."""
    found = of.pop(k, {})
    for old in [at for at in of if at < k]:
        del of[old]
    return found
