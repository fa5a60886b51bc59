"""From ticks and server frames, arriving in any order, to the consistent frames that executors step on.

A sensor is missing when its server said "no value", when its value is older than `within`, or when a tick
says that the server is down. A frame not delivered is none of these: it is asked for again (servers keep
what they published for `KEPT_NS`), and no later frame is handed out before it, because memory must see
every frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from colony.ir.frame import Frame, Reading
from colony.ir.types import Value
from colony.runtime import topics
from colony.runtime.bindings import SensorBinding
from colony.runtime.fields import DSERVER
from colony.runtime.messages import Effect, Fetch, Sample, Send, ServerFrame, Tick

KEPT_NS = 2_000_000_000
"""For how long servers keep the frames that they published, and readers wait for one."""


KEPT_MOST = 10_000
"""How many frames a server keeps at most, however short they are."""

ACTIVE = "active"
"""The one field of the frames in which the activity of a module in Python is published."""


class Assembled(NamedTuple):
    """Frame `tick.k` as a program sees it; `current` is whether no later tick has come.

    `active` is the activity, in the frame, of the modules in Python that were asked for.
    """

    tick: Tick
    frame: Frame
    current: bool
    active: Mapping[str, bool]


class FrameAssembler:
    """Collects what one process reads. Mutable: the frames that are not complete yet."""

    def __init__(self, bindings: tuple[SensorBinding, ...], modules: tuple[str, ...] = ()) -> None:
        self._bindings = bindings
        self._modules = {topics.activity(DSERVER.name, module): module for module in modules}
        self._servers = frozenset(b.server for b in bindings).union(self._modules)
        self._ticks: dict[int, Tick] = {}
        self._frames: dict[int, dict[str, ServerFrame]] = {}
        self._next = 0
        self._latest = -1

    @property
    def listens(self) -> tuple[str, ...]:
        """The topics that its frames come from."""
        return (topics.TICKS, *(topics.frames(server) for server in sorted(self._servers)))

    def take(self, message: Tick | ServerFrame) -> tuple[Effect, ...]:
        """Note a message; gives requests for what should have come before it and did not."""
        if message.k < self._next:
            return ()
        if isinstance(message, ServerFrame):
            if message.server in self._servers:
                self._frames.setdefault(message.k, {})[message.server] = message
            return ()
        self._ticks[message.k] = message
        self._latest = max(self._latest, message.k)
        return tuple(self._gaps(message))

    def complete(self) -> Iterator[Assembled]:
        """Every frame that can be handed out now, in order, each once."""
        while (tick := self._ticks.get(self._next)) is not None:
            got = self._frames.get(self._next, {})
            if any(s not in got and s not in self._down(tick) for s in self._servers):
                return
            del self._ticks[self._next]
            self._frames.pop(self._next, None)
            self._next += 1
            yield Assembled(tick, self._assemble(tick, got), tick.k == self._latest, self._active(got))

    def _down(self, tick: Tick) -> tuple[str, ...]:
        """Servers not to wait for: a server that is down now gives no frame of the past either."""
        latest = self._ticks.get(self._latest, tick)
        return tick.down if latest is tick else (*tick.down, *latest.down)

    def _gaps(self, tick: Tick) -> Iterator[Effect]:
        for k in range(self._next, tick.k):
            if k not in self._ticks:
                yield Send(topics.fetches(topics.CLOCK), Fetch(server=topics.CLOCK, k=k))
            got = self._frames.get(k, {})
            for server in sorted(self._servers):
                if server not in got and server not in tick.down:
                    yield Send(topics.fetches(server), Fetch(server=server, k=k))

    def _active(self, got: Mapping[str, ServerFrame]) -> dict[str, bool]:
        found = {}
        for server, module in self._modules.items():
            sample = got[server].fields[ACTIVE] if server in got else None
            found[module] = sample is not None and bool(sample.value)
        return found

    def _assemble(self, tick: Tick, got: Mapping[str, ServerFrame]) -> Frame:
        readings: dict[str, Reading] = {}
        down = tick.down
        for b in self._bindings:
            frame = got.get(b.server)
            if frame is None or b.server in down:
                continue
            sample = frame.fields.get(b.field)
            if sample is not None and _fresh(sample, tick.t_ns, b.within_ns):
                readings[b.sensor] = sample.value if b.factor == 1.0 else _scaled(sample.value, b.factor)
        return Frame(tick.t_ns, readings)


def _fresh(sample: Sample, now_ns: int, within_ns: int | None) -> bool:
    return within_ns is None or now_ns - sample.t_ns <= within_ns


def _scaled(value: Value, factor: float) -> Value:
    if isinstance(value, tuple):
        return tuple(v / factor for v in value)
    return value / factor
