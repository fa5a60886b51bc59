"""The observer, which sees everything and commands nothing.

It combines each frame with its verdicts, has the monitor check it, and passes it to the sinks (a recording, a
summary, a progress line).

The last frame of a server that is killed while publishing may reach the observer and no other node. If a
later tick declares the frame void, the monitor has stepped over a frame that no client saw, and its memory is
wrong for the rest of the epoch. Like a client in this situation, the observer then asks the Clock for a new
epoch. It does the same if the frame is declared void before the observer has handed it out, but clients may
have stepped over it: such a frame is disputed, and no reading of it explains all verdicts.

The answers of modules in Python also arrive as frames. The observer waits for the answers and verdicts of
each frame, up to a timeout.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import NamedTuple, Protocol, TypeVar

from colony.ir.frame import Answer
from colony.runtime.frames.assembler import FRAME_RETENTION_NS, AssembledFrame, FrameAssembler
from colony.runtime.frames.membership import READY_INTERVAL_NS
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.closing import close_all
from colony.runtime.observe.monitor import Monitor
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import (
    UNHEARD,
    Effect,
    Message,
    Ready,
    Request,
    Restart,
    Send,
    ServerFrame,
    Tick,
    Verdict,
)


class Sink(Protocol):
    """A consumer of frames, in order."""

    def take(self, log: RunFrame) -> None:
        """Take the next frame."""
        ...

    def close(self) -> None:
        """Finish, because no frame follows; called once, even after a failure."""
        ...


class _PendingFrame(NamedTuple):
    """A frame that waits for its verdicts; `skipped` frames before it were lost."""

    assembled: AssembledFrame
    arrived_ns: int
    skipped: int
    memory_unknown: bool


KEYFRAME_NS = 400_000_000
"""Maximum time, in nanoseconds, from a keyframe to the end of the last frame before the next keyframe.

Frames longer than this each have a keyframe. Together with a frame that is still being decided, the time
stays below half a second.
"""


class KeyframeSchedule:
    """The times of keyframes. Mutable: remembers the last one."""

    def __init__(self, frame_ns: int) -> None:
        self._frame_ns = frame_ns
        self._last_ns: int | None = None

    def is_due(self, t_ns: int, after_gap: bool) -> bool:
        """Return True if the frame at `t_ns` has a keyframe, as it always has after missing frames."""
        last_ns = self._last_ns
        if last_ns is not None and t_ns + self._frame_ns - last_ns <= KEYFRAME_NS and not after_gap:
            return False
        self._last_ns = t_ns
        return True


class Observer:
    """The node that observes a run.

    Stateful: keeps frames that wait for verdicts.

    Args:
        assembler: assembler of all sensors.
        actuators: names of the actuators; a frame is complete when each has a verdict.
        monitor: checker of the frames.
        sinks: consumers of the frames.
        request_servers: servers of the actuators whose requests are also passed to the sinks.
        answer_assembler: assembler of the answers of modules in Python, if there are any.
        frame_ns: period of the program's frames.
        servers_read: servers whose frames a client waits for, by actuator and module.
    """

    address = topics.OBSERVER

    def __init__(
        self,
        assembler: FrameAssembler,
        actuators: tuple[str, ...],
        monitor: Monitor,
        sinks: tuple[Sink, ...],
        request_servers: tuple[str, ...] = (),
        *,
        answer_assembler: FrameAssembler | None = None,
        frame_ns: int = 0,
        servers_read: Mapping[tuple[str, str], frozenset[str]] = MappingProxyType({}),
    ) -> None:
        self._assembler = assembler
        self._answer_assembler = answer_assembler
        self._actuators = frozenset(actuators)
        self._monitor = monitor
        self._sinks = sinks
        self._pending: deque[_PendingFrame] = deque()
        self._verdicts: dict[int, dict[str, Verdict]] = {}
        self._requests: dict[int, dict[tuple[str, str], Request]] = {}
        self._answers: dict[int, dict[str, Answer]] = {}
        self._collects_requests = bool(request_servers)
        self._first = True
        self._keyframes = KeyframeSchedule(frame_ns)
        self._servers_read = servers_read
        self._skipped, self._memory_unknown = 0, True
        self._contradicted_epoch: int | None = None
        self._reported_ns: int | None = None
        listens = (
            *assembler.listens,
            *(answer_assembler.listens if answer_assembler else ()),
            topics.VERDICTS,
        )
        self.listens = tuple(dict.fromkeys((*listens, *(topics.requests(s) for s in request_servers))))

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
                if isinstance(message, Tick):
                    effects = (*effects, *self._report(message, now_ns))
            case Verdict():
                if message.actuator in self._actuators:
                    _data_of_frame(self._verdicts, message.k)[message.actuator] = message
            case Request():
                _data_of_frame(self._requests, message.k).setdefault(
                    (message.actuator, message.client), message
                )
            case _:
                return ()
        while self._pending and self._is_ready(self._pending[0], now_ns):
            self._release()
        if isinstance(message, Tick) and self._contradicted_epoch == self._assembler.start:
            restart = Restart(client=self.address, start=self._contradicted_epoch)
            effects = (*effects, Send(topics.RESTARTS, restart))
        return effects

    def close(self) -> None:
        """Pass the pending frames to the sinks, and close the sinks even if that fails."""
        try:
            while self._pending:
                self._release()
        finally:
            close_all(self._sinks)

    def _skip(self) -> None:
        """Skip lost frames; remember the epoch if a frame that was handed out has become void."""
        skipped = self._assembler.skip()
        if not skipped:
            self._contradicted_epoch = self._assembler.start
        self._skipped += skipped
        self._memory_unknown = True

    def _report(self, tick: Tick, now_ns: int) -> tuple[Effect, ...]:
        """Report the progress in the run to a Clock that was restarted, from time to time."""
        due = self._reported_ns is None or now_ns - self._reported_ns >= READY_INTERVAL_NS
        progress = self._assembler.progress if tick.run != self._assembler.run and due else None
        if progress is None:
            return ()
        self._reported_ns = now_ns
        ready = Ready(client=self.address, run=self._assembler.run, progress=progress)
        return (Send(topics.READY, ready),)

    def _take_answers(self, message: Tick | ServerFrame) -> tuple[Effect, ...]:
        """Collect the answers of modules in Python; stop waiting for answers that are too far behind."""
        if self._answer_assembler is None:
            return ()
        effects = self._answer_assembler.take(message)
        for assembled in self._answer_assembler.pop_complete():
            _data_of_frame(self._answers, assembled.tick.k).update(assembled.answers)
        if self._answer_assembler.lost:
            self._answer_assembler.skip()
        return effects

    def _collect(self, now_ns: int) -> None:
        for assembled in self._assembler.pop_complete():
            self._pending.append(_PendingFrame(assembled, now_ns, self._skipped, self._memory_unknown))
            self._skipped, self._memory_unknown = 0, False

    def _is_ready(self, first: _PendingFrame, now_ns: int) -> bool:
        k = first.assembled.tick.k
        answered = self._answer_assembler is None or k < self._answer_assembler.next
        if not answered or len(self._verdicts.get(k, ())) < len(self._actuators):
            return now_ns - first.arrived_ns > FRAME_RETENTION_NS
        return not self._collects_requests or self._has_requests(k) or len(self._pending) > 1

    def _has_requests(self, k: int) -> bool:
        """Return True if all requests mentioned in a frame's verdicts have arrived."""
        requests, verdicts = self._requests.get(k, {}), self._verdicts.get(k, {})
        return all(
            (actuator, client) in requests or fate in UNHEARD
            for actuator, verdict in verdicts.items()
            for client, fate in verdict.fates
        )

    def _release(self) -> None:
        assembled, _, skipped, memory_unknown = self._pending.popleft()
        tick, frame = assembled.tick, assembled.frame
        verdicts, requests = (
            _pop_data_of_frame(self._verdicts, tick.k),
            _pop_data_of_frame(self._requests, tick.k),
        )
        answers = _pop_data_of_frame(self._answers, tick.k)
        disputed = self._is_disputed(assembled, verdicts)
        if disputed and tick.start == self._assembler.start:
            self._contradicted_epoch = tick.start
        if assembled.restart:
            self._monitor.restart()
        if disputed or (memory_unknown and not assembled.restart):
            self._monitor.lose_memory()
        after_gap = assembled.restart or memory_unknown or disputed
        keyframe = self._monitor.keyframe() if self._keyframes.is_due(tick.t_ns, after_gap) else None
        expected, disagreements = self._monitor.check(frame, verdicts, tick.lost, answers)
        log = RunFrame(
            tick=tick,
            frame=frame,
            verdicts=verdicts,
            expected=expected,
            disagreements=disagreements,
            breaches=expected.breaches,
            restart=assembled.restart and not self._first,
            requests=tuple(requests.values()),
            skipped=skipped,
            memory_unknown=not expected.decisions,
            keyframe=keyframe,
            answers=answers,
        )
        self._first = False
        for sink in self._sinks:
            sink.take(log)

    def _is_disputed(self, assembled: AssembledFrame, verdicts: Mapping[str, Verdict]) -> bool:
        """Return True if clients may have stepped over frames of servers that are void by now.

        A client that was heard in time had the frames of all servers that it reads.
        """
        return bool(assembled.discarded) or any(
            fate not in UNHEARD
            and not assembled.void.isdisjoint(self._servers_read.get((actuator, party), ()))
            for actuator, verdict in (verdicts.items() if assembled.void else ())
            for party, fate in verdict.fates
        )


K = TypeVar("K")
V = TypeVar("V")

_MAX_INCOMPLETE_FRAMES = 20_000
"""Maximum number of incomplete frames that are kept."""


def _data_of_frame(by_frame: dict[int, dict[K, V]], k: int) -> dict[K, V]:
    """Return the data that has arrived for frame `k`, adding an empty entry if there is none."""
    entry = by_frame.setdefault(k, {})
    if len(by_frame) > _MAX_INCOMPLETE_FRAMES:
        del by_frame[next(iter(by_frame))]
    return entry


def _pop_data_of_frame(by_frame: dict[int, dict[K, V]], k: int) -> dict[K, V]:
    """Remove and return the data that has arrived for frame `k`; drop older frames."""
    entry = by_frame.pop(k, {})
    for old_k in [number for number in by_frame if number < k]:
        del by_frame[old_k]
    return entry
