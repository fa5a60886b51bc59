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
from collections.abc import Collection, Iterable, Mapping
from queue import SimpleQueue
from threading import Event, Thread
from types import MappingProxyType
from typing import NamedTuple, Protocol, TypeVar

from colony.ir.frame import (
    NOTHING_GIVEN,
    Answer,
    Decision,
    Frame,
    Outcome,
    OverriddenCommand,
    given_in_frame,
    is_connection,
)
from colony.ir.memory import ProgramMemory
from colony.ir.program import Actuator
from colony.runtime.frames.assembler import (
    FRAME_RETENTION_NS,
    READY_INTERVAL_NS,
    AssembledFrame,
    FrameAssembler,
)
from colony.runtime.frames.run_frame import Keyframe, RunFrame
from colony.runtime.observe.closing import close_all
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import (
    UNHEARD,
    Effect,
    Fate,
    Message,
    Ready,
    Request,
    Restart,
    SendMessage,
    ServerFrame,
    Tick,
    Verdict,
)

# --- monitor -------------------------------------------------------------------------------------------
#
# The monitor, which steps the whole client list over the frames that the clients saw.
#
# This yields the contracts broken in each frame, the limited, clamped and faulty commands, and a check of
# the runtime itself: while no client is late or lost, the verdicts must be the decisions of the client
# list; otherwise a verdict may also be idle. Where a connection outside the network commanded, or a hold
# kept the network from deciding, the client that did not get through must be the one that would have won.
#
# Contracts are evaluated of what was sent: of the command from outside, or of the idle command if the
# actuator was idle because of a hold, or because a client was late or lost.
#
# Modules in Python run only in their own processes: the monitor takes the answers that they announced.
# After a frame in which one of them announced no answer, memory is unknown as long as it depends on that
# answer.


_NO_ANSWERS: Mapping[str, Answer] = {}


class CheckedFrame(NamedTuple):
    """The expected outcome of a frame, and the unexcused differences of the verdicts from it."""

    expected: Outcome
    disagreements: tuple[str, ...]


class RestartableExecutor(Protocol):
    """An executor that can restart from its initial memory, and exposes its memory."""

    def step(
        self,
        frame: Frame,
        answers: Mapping[str, Answer],
        given: Mapping[str, OverriddenCommand] = NOTHING_GIVEN,
    ) -> Outcome:
        """Return the outcome of a frame, given the answers of modules in Python.

        `given` is what actuators were given, where that may not be what the network decided.
        """
        ...

    def advance(self, frame: Frame, answers: Mapping[str, Answer], missing: Collection[str]) -> bool:
        """Step over a frame with missing answers, or one after it; return True if memory is known."""
        ...

    def network_decisions(self) -> tuple[Decision, ...]:
        """Return what the network decided in the last frame, whatever actuators were given."""
        ...

    @property
    def memory(self) -> ProgramMemory | None:
        """The current memory, None if it is unknown."""
        ...

    def restart(self) -> None:
        """Reset all memory to its initial values."""
        ...


class Monitor:
    """Checks verdicts against the client list. Mutable.

    `degrading_actuators` are those with `on_loss degrade`. Once any client is lost, lesser clients may
    command them, so their verdicts are not compared until memory restarts. `modules` are the modules in
    Python. `actuators` are those of which contracts see what was sent, and not what the network decided.
    """

    def __init__(
        self,
        executor: RestartableExecutor,
        degrading_actuators: Iterable[str] = (),
        modules: Iterable[str] = (),
        actuators: Iterable[Actuator] = (),
    ) -> None:
        self._actuators = tuple(actuators)
        self._executor = executor
        self._modules = frozenset(modules)
        self._degrading_actuators = frozenset(degrading_actuators)
        self._degraded: set[str] = set()
        self._memory_is_initial, self._memory_unknown, self._is_doubted = True, False, False

    def restart(self) -> None:
        """Restart all memory with the next frame."""
        if not self._memory_is_initial:
            self._executor.restart()
        self._degraded.clear()
        self._memory_is_initial, self._memory_unknown, self._is_doubted = True, False, False

    def lose_memory(self) -> None:
        """Stop comparing until memory restarts, because a frame was missed."""
        self._memory_unknown = True

    def keyframe(self) -> Keyframe:
        """Return the memory before the next frame."""
        is_known = not (self._memory_unknown or self._is_doubted)
        return Keyframe(self._executor.memory if is_known else None, bool(self._degraded))

    def check(
        self,
        frame: Frame,
        verdicts: Mapping[str, Verdict],
        lost: Collection[str] = (),
        answers: Mapping[str, Answer] = _NO_ANSWERS,
    ) -> CheckedFrame:
        """Step over a frame in which the clients `lost` are lost, and compare the received verdicts."""
        if self._memory_unknown:
            return CheckedFrame(Outcome(()), ())
        self._memory_is_initial = False
        if lost:
            self._degraded.update(self._degrading_actuators)
        missing = self._modules - answers.keys()
        if missing or self._is_doubted:
            self._is_doubted = not self._executor.advance(frame, answers, missing)
            return CheckedFrame(Outcome(()), ())
        given = given_in_frame(self._actuators, verdicts)
        if given:
            outcome = self._executor.step(frame, answers, given)
            expected = outcome._replace(decisions=self._executor.network_decisions())
        else:
            expected = self._executor.step(frame, answers)
        texts = (
            self._disagreement(decision, verdict)
            for decision in expected.decisions
            if (verdict := verdicts.get(decision.actuator)) is not None
        )
        return CheckedFrame(expected, tuple(text for text in texts if text is not None))

    def _disagreement(self, decision: Decision, verdict: Verdict) -> str | None:
        same = (verdict.by, verdict.values, verdict.fault) == (decision.by, decision.values, decision.fault)
        if same and not verdict.violation:
            return None
        if not verdict.violation and (decision.actuator in self._degraded or _is_excused(decision, verdict)):
            return None
        sent = f"{verdict.by or 'nobody'} {verdict.values}"
        expected = f"{decision.by or 'nobody'} {decision.values}"
        violation = "two clients were active: " if verdict.violation else ""
        return f"{decision.actuator}: {violation}{sent} was sent; the client list gives {expected}"


_EXCLUDED_FATES: frozenset[Fate] = frozenset({"overridden", "locked out", "stopped"})


def _has_fate(verdict: Verdict, fates: frozenset[Fate]) -> bool:
    return any(fate in fates for _, fate in verdict.fates)


def _is_excused(decision: Decision, verdict: Verdict) -> bool:
    """Return True if the verdict gives a reason why no client of the network commanded."""
    if verdict.by is not None:
        return False
    if verdict.outside is None and verdict.hold is None:
        return _has_fate(verdict, UNHEARD)
    excluded = {
        party for party, fate in verdict.fates if fate in _EXCLUDED_FATES and not is_connection(party)
    }
    return excluded <= {decision.by}


# --- observer ------------------------------------------------------------------------------------------


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
            effects = (*effects, SendMessage(topics.RESTARTS, restart))
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
        return (SendMessage(topics.READY, ready),)

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


# --- background ----------------------------------------------------------------------------------------
#
# A thread that passes frames on to sinks: a slow disk or a terminal that takes nothing holds no frame up.


MAX_WAITING = 20_000
"""Maximum number of frames that wait: a quarter of an hour of most robots, some 100 MB."""

PAUSE_S = 0.1
"""Seconds until the next frames are passed on: waking a thread takes as long as recording a frame."""

PATIENCE_S = 10.0
"""Seconds after which a sink is given up at the end of a run, if it takes no frame meanwhile."""


class BackgroundSink:
    """A sink that passes frames to another one in a thread of its own. Mutable.

    What the other sink raises is raised by the next `take`, or by `close`.

    Args:
        sink: the other sink.
        dispensable: True for a sink that needs only the newest frames: others are dropped while it takes
            none, and at the end a tenth of the patience is enough.
    """

    def __init__(self, sink: Sink, *, dispensable: bool = False) -> None:
        self._sink = sink
        self._dispensable = dispensable
        self._taken = 0
        self._queue: SimpleQueue[RunFrame | None] = SimpleQueue()
        self._failure: BaseException | None = None
        self._has_failed = False
        self._closing = Event()
        self._thread = Thread(target=self._run, name="sinks", daemon=True)
        self._thread.start()

    def take(self, log: RunFrame) -> None:
        """Queue a frame.

        Raises:
            TimeoutError: too many frames wait.
            Exception: as raised by the sink.
        """
        self._raise_failure()
        if self._dispensable and not self._queue.empty():
            return
        if self._queue.qsize() >= MAX_WAITING:
            raise TimeoutError(f"{MAX_WAITING} frames wait to be shown and recorded: nothing takes them")
        self._queue.put(log)

    def close(self) -> None:
        """Pass on what waits, and close the sink.

        Raises:
            TimeoutError: the sink takes nothing any more.
            Exception: as raised by the sink.
        """
        self._queue.put(None)
        self._closing.set()
        before = -1
        while self._thread.is_alive() and before != self._taken:
            before = self._taken
            self._thread.join(PATIENCE_S / 10 if self._dispensable else PATIENCE_S)
        if self._thread.is_alive():
            if self._dispensable:
                return
            raise TimeoutError(f"{self._queue.qsize()} frames were not recorded: nothing takes them")
        self._sink.close()
        self._raise_failure()

    def _run(self) -> None:
        while (log := self._next()) is not None:
            self._taken += 1
            if not self._has_failed:
                try:
                    self._sink.take(log)
                except BaseException as failure:
                    self._failure, self._has_failed = failure, True

    def _next(self) -> RunFrame | None:
        if self._queue.empty():
            self._closing.wait(PAUSE_S)
        return self._queue.get()

    def _raise_failure(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure
