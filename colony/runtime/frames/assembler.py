"""Assembly of ticks and server frames, in any order of arrival, into the frames that executors step on.

A sensor is missing when its server published "no value", when its value is older than `within`, when the tick
lists the server as down, or when a later tick lists the server's frame as void. A frame that was not
delivered is none of these: the assembler fetches it again (servers keep frames for `FRAME_RETENTION_NS`), and
hands out no later frame before it, because memory must see every frame, and all readers the same one.

If that is impossible (the frame is no longer kept, or was handed out and has become void), the assembler is
`lost`: memory must be restored from a checkpoint, or a new epoch must begin. At the start of each epoch
(`Tick.start`) the assembler drops everything before it.

A restarted Clock goes on with the epoch, but not with the next number. Its ticks list the gap (`Tick.gaps`):
the assembler hands out the frame after the gap directly after the frame before it.

Readings are converted here, once: into base units for executors, into declared units for the observer. The
values of tunable params come with the tick.

The answer of a module in Python cannot count as missing, because no reader knows what it would have been. The
assembler waits for it. Only where lesser behaviors may take over (`on_loss degrade`), a module without an
answer counts as inactive. The observer waits only for modules that are alive.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple, TypeVar

from colony.ir.frame import Answer, Frame, Reading
from colony.ir.servers import DSERVER
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import SensorBinding
from colony.runtime.protocol.messages import (
    Effect,
    Fetch,
    Progress,
    Ready,
    Restart,
    SendMessage,
    ServerFrame,
    Tick,
)

# --- assembler -----------------------------------------------------------------------------------------


FRAME_RETENTION_NS = 2_000_000_000
"""Nanoseconds for which servers keep published frames, and readers wait for a frame."""

MAX_FRAMES_KEPT = 10_000
"""Maximum number of frames that a server keeps, however short the frame period."""

COMMAND, ERROR, BLIND = "command", "error", "blind"
"""Fields of the frames in which the answers of a module in Python are published."""

Awaited = Literal["all", "degrade", "living"]
"""The modules in Python that an assembler waits for.

"all": every module. "living": modules that are alive. "degrade": the same, and none while DServer is down.
"""

MAX_FETCHES_PER_TICK = 100
"""Maximum number of missing ticks and frames fetched with each tick, the oldest first.

They are fetched again only when they are 2, 4, 8... ticks old, so that a server that is far behind is not
flooded.
"""

MAX_REPORTED_TICKS = 100
"""Maximum number of ticks in a report of progress: half a second, between two checkpoints, of 5 ms frames."""

MAX_REPORTED_NAMES = 2000
"""Maximum number of servers, clients and void frames in the ticks of a report of progress."""

V = TypeVar("V")


def frames_to_keep(frame_ns: int) -> int:
    """Return the number of frames that every node keeps."""
    return min(max(2, FRAME_RETENTION_NS // frame_ns), MAX_FRAMES_KEPT)


class AssembledFrame(NamedTuple):
    """Frame `tick.k` as a program sees it; `current` is True if no later tick has come.

    `answers` are those of the modules in Python, by module; the answer of a module that is not awaited may be
    absent. `void` are the servers whose frame a later tick declares void; the frames of those in `discarded`
    did arrive, so that other readers may have used them.
    """

    tick: Tick
    frame: Frame
    current: bool
    answers: Mapping[str, Answer]
    void: frozenset[str] = frozenset()
    discarded: frozenset[str] = frozenset()

    @property
    def restart(self) -> bool:
        """True if all memory restarts from its initial values with this frame."""
        return self.tick.k == self.tick.start


class FrameAssembler:
    """Assembles the frames that one process reads. Stateful: keeps the incomplete frames.

    Args:
        bindings: the sensors that the process reads.
        modules: the modules in Python whose answers the process needs.
        run: the run whose ticks count.
        frames_kept: number of frames that servers keep.
        awaited: modules whose answers the assembler waits for.
        declared_units: True for readings in declared units, which users see, instead of base units.
    """

    def __init__(
        self,
        bindings: tuple[SensorBinding, ...],
        modules: tuple[str, ...] = (),
        *,
        run: str = "",
        frames_kept: int = MAX_FRAMES_KEPT,
        awaited: Awaited = "all",
        declared_units: bool = False,
    ) -> None:
        self._bindings = tuple(b for b in bindings if b.server != topics.CLOCK)
        self._tunables = tuple(b for b in bindings if b.server == topics.CLOCK)
        self._modules = {topics.activity(DSERVER.name, module): module for module in modules}
        self._servers = tuple(sorted({b.server for b in self._bindings}.union(self._modules)))
        self._run = run
        self._frames_kept = frames_kept
        self._awaited = awaited
        self._declared_units = declared_units
        self._ticks: dict[int, Tick] = {}
        self._frames: dict[int, dict[str, ServerFrame]] = {}
        self._void: dict[tuple[str, int], int] = {}  # the tick that declares a frame void, by (server, k)
        self._gaps: dict[int, int] = {}  # the frame after a gap, by the frame before it
        self._newest: deque[Tick] = deque(maxlen=MAX_REPORTED_TICKS)
        self._start = self._latest = self._fetched_to = -1
        self._contradicted = False
        self._set_last(-2)

    @property
    def listens(self) -> tuple[str, ...]:
        """Topics of the frames and ticks to assemble."""
        return (topics.TICKS, *(topics.frames(server) for server in (topics.CLOCK, *self._servers)))

    @property
    def start(self) -> int:
        """The first frame of the epoch, -1 before any tick."""
        return self._start

    @property
    def next(self) -> int:
        """The next frame to be handed out."""
        return self._next

    @property
    def latest(self) -> int:
        """The newest frame that was ticked, -1 before any tick."""
        return self._latest

    @property
    def last(self) -> int:
        """The last frame that was handed out, or that memory is of."""
        return self._last

    @property
    def run(self) -> str:
        """The run whose ticks count."""
        return self._run

    @property
    def progress(self) -> Progress | None:
        """The progress in the run, None before any tick of it."""
        ticks: list[Tick] = []
        names = 0
        for tick in reversed(self._newest):
            names += len(tick.down) + len(tick.lost) + len(tick.void)
            if names > MAX_REPORTED_NAMES:
                break
            ticks.insert(0, tick)
        return Progress(start=self._start, stepped=self._last, ticks=tuple(ticks)) if ticks else None

    @property
    def lost(self) -> bool:
        """True if the next frame is unobtainable, or a frame handed out was wrong.

        A new epoch repairs this, and so does `resume`.
        """
        if self._contradicted:
            return True
        return self._distance(self._next) >= self._frames_kept and not self._only_modules_down()

    def is_passed_over(self, frames: int) -> bool:
        """Return True if the next frame waits for a server that has sent one at least `frames` later."""
        if (tick := self._ticks.get(self._next)) is None:
            return False
        received, absent = self._frames.get(self._next, {}), self._absent(tick)
        waiting = {s for s in self._servers if s not in received and s not in absent}
        return bool(waiting) and any(
            k >= self._next + frames and not waiting.isdisjoint(sent) for k, sent in self._frames.items()
        )

    def take(self, message: Tick | ServerFrame) -> tuple[Effect, ...]:
        """Take a message, and return fetches of earlier ticks and frames that are missing."""
        if isinstance(message, ServerFrame):
            self._take_frame(message)
            return ()
        if message.run != self._run or not self._start <= message.start <= message.k:
            return ()
        if message.start > self._start:
            self._begin_epoch(message)
        self._note_gaps(message)
        if message.k < self._next or message.k in self._ticks:
            return ()
        self._ticks[message.k] = message
        self._newest.append(message)
        for server, k in message.void:
            self._note_void(server, k, message.k)
        if message.k <= self._latest:
            return ()
        self._latest = message.k
        self._trim(self._ticks)
        return () if self.lost else tuple(self._fetches())

    def pop_complete(self) -> Iterator[AssembledFrame]:
        """Hand out every frame that is complete by now, in order, each once."""
        while not self._contradicted and (tick := self._ticks.get(self._next)) is not None:
            received = self._frames.get(self._next, {})
            absent = self._absent(tick)
            if any(s not in received and s not in absent for s in self._servers):
                return
            del self._ticks[self._next]
            self._frames.pop(self._next, None)
            self._set_last(self._next)
            void = frozenset([s for s, k in self._void if k == tick.k]) if absent else _NO_SERVERS
            discarded = void.intersection(received)
            if absent:
                received = {server: frame for server, frame in received.items() if server not in absent}
            for declared in tick.void:  # needed only until the tick that declares them is handed out
                self._void.pop(declared, None)
            yield AssembledFrame(
                tick=tick,
                frame=self._assemble(tick, received),
                current=tick.k == self._latest,
                answers=self._answers(received),
                void=void,
                discarded=discarded,
            )

    def resume(self, k: int) -> tuple[Effect, ...]:
        """Continue after frame `k`, as memory is now that after it; return the necessary fetches."""
        self._jump_behind(k)
        self._contradicted = self._in_gap(k) or any(
            void_k <= k < declared_k and server not in self._modules
            for (server, void_k), declared_k in self._void.items()
        )
        return () if self.lost else tuple(self._fetches())

    def skip(self) -> int:
        """Skip lost frames, for a reader that commands nothing; return the number of skipped frames."""
        distance = self._distance(self._next)
        skipped = distance if distance >= self._frames_kept else 0
        self._jump_behind(self._latest - 1 if skipped else self._last)
        self._contradicted = False
        return skipped

    def _jump_behind(self, k: int) -> None:
        self._set_last(k)
        self._fetched_to = self._next - 1
        self._ticks = {number: tick for number, tick in self._ticks.items() if number >= self._next}
        self._frames = {number: frames for number, frames in self._frames.items() if number >= self._next}

    def _set_last(self, k: int) -> None:
        self._last, self._next = k, self._gaps.get(k, k + 1)

    # --- gaps ------------------------------------------------------------------------------------------

    def _note_gaps(self, tick: Tick) -> None:
        for previous, first in tick.gaps:
            if first <= self._last or previous < self._start or self._gaps.get(previous) == first:
                continue
            self._contradicted |= previous < self._last  # a frame in the gap was handed out
            self._gaps[previous] = first
            for kept in (self._ticks, self._frames):
                for k in [number for number in kept if previous < number < first]:
                    del kept[k]
            self._set_last(self._last)

    def _in_gap(self, k: int) -> bool:
        return any(previous < k < first for previous, first in self._gaps.items())

    def _distance(self, k: int) -> int:
        """Return the number of frames from frame `k` to the newest one."""
        skipped = sum(first - previous - 1 for previous, first in self._gaps.items() if previous >= k)
        return self._latest - k - skipped

    # --- input -----------------------------------------------------------------------------------------

    def _take_frame(self, frame: ServerFrame) -> None:
        if frame.k < self._next or frame.server not in self._servers:
            return
        self._frames.setdefault(frame.k, {})[frame.server] = frame
        self._trim(self._frames)

    def _trim(self, kept: dict[int, V]) -> None:
        """Drop old entries while nothing can be handed out; keep the next frame and the newest ones."""
        while len(kept) > 2 * self._frames_kept:
            del kept[next(k for k in kept if k != self._next)]

    def _note_void(self, server: str, k: int, declared_k: int) -> None:
        if k < self._start or (server not in self._servers and server != DSERVER.name):
            return
        if k < self._next and server in self._servers and server not in self._modules:
            self._contradicted = True  # the frame was handed out, but other readers never got it
        self._void[server, k] = declared_k
        if len(self._void) > MAX_FRAMES_KEPT:
            del self._void[next(iter(self._void))]

    def _begin_epoch(self, tick: Tick) -> None:
        self._start = tick.start
        self._latest = self._fetched_to = -1
        self._contradicted = False
        self._gaps.clear()
        self._newest.clear()
        self._set_last(tick.start - 1)
        self._ticks.clear()
        self._void.clear()
        self._frames = {k: frames for k, frames in self._frames.items() if k >= tick.start}

    def _fetches(self) -> Iterator[Effect]:
        remaining = MAX_FETCHES_PER_TICK
        down = self._ticks[self._latest].down if self._latest in self._ticks else ()
        next_k = self._next
        while next_k < self._latest:
            k, next_k = next_k, self._gaps.get(next_k, next_k + 1)
            if remaining <= 0:
                return
            age = self._distance(k)
            if k <= self._fetched_to and age & (age - 1):
                continue
            self._fetched_to = max(self._fetched_to, k)
            tick = self._ticks.get(k)
            if tick is None:
                remaining -= 1
                yield SendMessage(topics.fetches(topics.CLOCK), Fetch(server=topics.CLOCK, k=k))
            settled = {*self._frames.get(k, ()), *down, *(() if tick is None else self._absent(tick))}
            for server in self._servers:
                if server in settled:
                    continue
                remaining -= 1
                publisher = DSERVER.name if server in self._modules else server
                yield SendMessage(topics.fetches(publisher), Fetch(server=server, k=k))

    # --- output ----------------------------------------------------------------------------------------

    def _absent(self, tick: Tick) -> frozenset[str]:
        """Return the servers whose frames are not waited for, and are ignored if they arrive."""
        if not tick.down and not self._void:
            return _NO_SERVERS
        k = tick.k
        absent = {s for s in (*self._servers, DSERVER.name) if s in tick.down or (s, k) in self._void}
        if self._awaited == "all":
            return frozenset(absent.difference(self._modules))
        answers_lost = self._awaited == "degrade" and DSERVER.name in absent
        return frozenset(absent.union(self._modules) if answers_lost else absent)

    def _only_modules_down(self) -> bool:
        """Return True if all missing frames are of dead modules in Python: a new epoch would not help."""
        tick, newest = self._ticks.get(self._next), self._ticks.get(self._latest)
        if tick is None or newest is None:
            return False
        settled = self._absent(tick).union(self._frames.get(self._next, ()))
        awaited = [s for s in self._servers if s not in settled]
        return bool(awaited) and all(s in self._modules and s in newest.down for s in awaited)

    def _answers(self, frames: Mapping[str, ServerFrame]) -> dict[str, Answer]:
        return {
            module: _answer(frames[server]) for server, module in self._modules.items() if server in frames
        }

    def _assemble(self, tick: Tick, frames: Mapping[str, ServerFrame]) -> Frame:
        readings: dict[str, Reading] = {}
        convert = SensorBinding.in_declared_units if self._declared_units else SensorBinding.in_base_units
        for b in self._bindings:
            frame = frames.get(b.server)
            sample = None if frame is None else frame.fields.get(b.field)
            if sample is not None and b.is_fresh(sample.t_ns, tick.t_ns):
                readings[b.sensor] = convert(b, sample.value)
            elif b.sent:
                readings[b.sensor] = None  # an executor would put what it sent itself in its place
        for b in self._tunables if tick.tuned else ():
            value = tick.tuned.get(b.field)
            if value is not None:
                readings[b.sensor] = convert(b, value)
        return Frame(tick.t_ns, readings, restarted=tick.restarted)


_NO_SERVERS: frozenset[str] = frozenset()


def _answer(frame: ServerFrame) -> Answer:
    command = frame.fields.get(COMMAND)
    values = None if command is None or not isinstance(command.value, tuple) else command.value
    error, blind = (f is not None and f.value is True for f in map(frame.fields.get, (ERROR, BLIND)))
    return Answer(values, error, blind)


# --- membership ----------------------------------------------------------------------------------------
#
# Membership of clients, or of a module in Python, in a run.
#
# Members report that they are ready until the run begins, and request a new epoch when they cannot
# continue. With the first report of each node goes its progress, if the run has begun before: the Clock was
# restarted.


READY_INTERVAL_NS = 200_000_000
"""Nanoseconds between two reports of readiness, until the run begins."""

ALIVE_INTERVAL_NS = 90_000_000
"""Shortest interval, in nanoseconds, between two reports to the Clock that a client is alive.

It is a fraction of the shortest lease. The Clock also learns from verdicts which clients are alive.
"""


class Membership:
    """The members of one node, by address. Stateful: remembers the times of their last reports.

    `assembler` knows the node's progress in the run.
    """

    def __init__(self, members: tuple[str, ...], run: str, assembler: FrameAssembler) -> None:
        self.run = run
        self._assembler = assembler
        self._members = members
        self._ready_sent_ns = 0
        self._alive_sent_ns: int | None = None

    def start(self, now_ns: int) -> Iterator[Effect]:
        """Report the members as ready."""
        self._ready_sent_ns = now_ns
        progress = self._assembler.progress
        for member in self._members:
            yield SendMessage(topics.READY, Ready(client=member, run=self.run, progress=progress))
            progress = None

    def on_tick(self, tick: Tick, now_ns: int) -> Iterator[Effect]:
        """Handle a tick; until the run begins, report the members as ready from time to time.

        The Clock may not know: the report may have been lost, or the Clock restarted.
        """
        if tick.run != self.run and now_ns - self._ready_sent_ns >= READY_INTERVAL_NS:
            yield from self.start(now_ns)

    def on_requests_sent(self, k: int, now_ns: int) -> Iterator[Effect]:
        """Report the members as alive after their requests for frame `k`, unless they did so recently."""
        if self._alive_sent_ns is None or now_ns - self._alive_sent_ns >= ALIVE_INTERVAL_NS:
            self._alive_sent_ns = now_ns
            yield from self._report(k)

    def restart_request(self, start: int) -> Effect:
        """Return a request for a new epoch, as the members cannot continue in the one begun at `start`."""
        return SendMessage(topics.RESTARTS, Restart(client=self._members[0], start=start))

    def _report(self, k: int) -> Iterator[Effect]:
        for member in self._members:
            yield SendMessage(topics.READY, Ready(client=member, run=self.run, k=k))
