"""The part of a server that takes commands: an arbiter an actuator, and one dispatch a frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from colony.ir.program import Actuator
from colony.ir.types import ScalarValue
from colony.runtime import topics
from colony.runtime.arbitration import Arbiter, Dispatch, Event, Timing
from colony.runtime.bindings import ActuatorBinding
from colony.runtime.messages import Effect, Request, Send, Tick, WakeAt


@dataclass(frozen=True, slots=True, kw_only=True)
class Commanded:
    """An actuator of this server and its clients, highest place first."""

    actuator: Actuator
    binding: ActuatorBinding
    places: tuple[str, ...]


Perform = Callable[[Commanded, tuple[ScalarValue, ...], int], None]
"""Carry out a command: for which actuator, its fields in base units, and the time."""


class CommandDesk:
    """Arbitrates and performs the commands of a server's actuators. Mutable: its arbiters."""

    def __init__(self, commanded: tuple[Commanded, ...], times: Timing, perform: Perform) -> None:
        self._commanded = {c.actuator.name: c for c in commanded}
        self._arbiters = {c.actuator.name: Arbiter(c.actuator, c.places, times) for c in commanded}
        self._clients = {
            name: {topics.client_address(name, place): place for place in c.places}
            for name, c in self._commanded.items()
        }
        self._perform = perform
        self._alarm: int | None = None

    def tick(self, tick: Tick, now_ns: int) -> Iterable[Effect]:
        """Open the frame of every actuator."""
        for name, arbiter in self._arbiters.items():
            clients = self._clients[name]
            lost = frozenset(clients[a] for a in tick.lost if a in clients)
            yield from self._carry_out(name, arbiter.open(tick, lost, now_ns), now_ns)
        yield from self._set_alarm()

    def request(self, request: Request, now_ns: int) -> Iterable[Effect]:
        """Take a client's request; one for an actuator of another server is ignored."""
        arbiter = self._arbiters.get(request.actuator)
        if arbiter is not None:
            yield from self._carry_out(request.actuator, arbiter.receive(request, now_ns), now_ns)
            yield from self._set_alarm()

    def wake(self, now_ns: int) -> Iterable[Effect]:
        """Decide what is overdue."""
        if self._alarm is not None and now_ns >= self._alarm:
            self._alarm = None
        for name, arbiter in self._arbiters.items():
            yield from self._carry_out(name, arbiter.wake(now_ns), now_ns)
        yield from self._set_alarm()

    def _carry_out(self, name: str, events: tuple[Event, ...], now_ns: int) -> Iterator[Effect]:
        for event in events:
            if isinstance(event, Dispatch):
                if event.values is not None:
                    self._perform(self._commanded[name], event.values, now_ns)
            else:
                yield Send(topics.VERDICTS, event)

    def _set_alarm(self) -> Iterator[Effect]:
        due = min((at for a in self._arbiters.values() if (at := a.wake_at) is not None), default=None)
        if due is not None and (self._alarm is None or due < self._alarm):
            self._alarm = due
            yield WakeAt(due)
