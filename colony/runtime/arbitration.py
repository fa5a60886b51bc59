"""Who commands an actuator in a frame: protocol logic without input, output or a clock.

Being served first is not subsuming: a server that executed the requests of a frame in the order of their
priorities would end up with the *last* command, the least important one. So of all the requests of a
frame exactly one command is dispatched, once:

- Requests carry the exclusive guard: whoever bids a command knows that the network lets it through, and
  normally nobody else bids one in that frame. Priorities are the second line of defense.
- The frame is decided as soon as a command has come and no live client with a higher place is still to be
  heard; a higher one that stays out delays it by the grace at most, for by its exclusive guard the command is
  the right one. When all live clients have been heard and none commands, it is idle.
- At the deadline the highest command of those that came is dispatched, or the idle command. A late or lost
  client therefore leads to idle, never to a lesser behavior.
- Two commands in one frame are a violation: it is recorded, and the higher place wins.

`choose` is the rule, `Arbiter` the protocol around it: ticks, requests and times in, events out.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from colony.ir.program import Actuator, ActuatorField
from colony.ir.types import Bool, ScalarValue
from colony.runtime.messages import Bid, Fate, Request, Tick, Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """Times after a tick, or after the first command, at which an arbiter stops waiting."""

    deadline_ns: int
    grace_ns: int


def timing(frame_ns: int) -> Timing:
    """A deadline that leaves a fifth of the frame, and a tenth of it of grace."""
    return Timing(deadline_ns=max(1, frame_ns * 4 // 5), grace_ns=frame_ns // 10)


class Choice(NamedTuple):
    """Where a frame stands: `contender` is the highest client with a command so far.

    `settled`: no client that could still be heard can change it.
    """

    contender: str | None
    settled: bool


def choose(places: tuple[str, ...], requests: Mapping[str, Request], lost: Container[str]) -> Choice:
    """Decide among the requests of one frame; `places` are the clients, highest first."""
    waiting = False
    for client in places:
        if client in lost:
            continue
        request = requests.get(client)
        if request is None:
            waiting = True
        elif request.bid == "command":
            return Choice(client, not waiting)
    return Choice(None, not waiting)


class Dispatch(NamedTuple):
    """Event: send this now. `values` are in base units; None when nothing is sent (`idle hold`)."""

    k: int
    by: str | None
    values: tuple[ScalarValue, ...] | None
    fault: str | None


Event = Dispatch | Verdict


_BIDS = frozenset(get_args(Bid))


def malformed(request: Request, actuator: Actuator, places: Container[str]) -> str | None:
    """What is wrong with a request, or None. Nothing that is wrong may move a robot."""
    if request.client not in places:
        return f"`{request.client}` is no client of {actuator.name}"
    if request.bid not in _BIDS:
        return f"`{request.client}` bids {request.bid!r}"
    if request.bid != "command":
        return None
    if request.values is None:
        return None if request.fault else f"`{request.client}` commands without values"
    if len(request.values) != len(actuator.fields):
        return f"`{request.client}` gave {len(request.values)} values, not {len(actuator.fields)}"
    for field, value in zip(actuator.fields, request.values, strict=True):
        if not _acceptable(field, value):
            return f"`{request.client}` gave {field.name} = {value!r}"
    return None


def _acceptable(field: ActuatorField, value: ScalarValue) -> bool:
    if isinstance(field.type, Bool):
        return isinstance(value, bool)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return False
    return (field.low is None or value >= field.low) and (field.high is None or value <= field.high)


AHEAD = 64
"""How many frames before its tick a request may come; a wilder one is refused."""

Phase = Literal["no frame", "open", "dispatched", "closed"]


class Arbiter:
    """The protocol of one actuator. Mutable: the requests of the present frame and of those to come.

    Every frame gives exactly one `Dispatch` and one `Verdict`: the dispatch when it is decided, the verdict
    when every live client has been heard too, or the next frame begins.
    """

    def __init__(self, actuator: Actuator, places: tuple[str, ...], times: Timing) -> None:
        self._actuator = actuator
        self._places = places
        self._times = times
        self._phase: Phase = "no frame"
        self._tick = Tick(k=-1, t_ns=0)
        self._lost: frozenset[str] = frozenset()
        self._ahead: dict[int, list[Request]] = {}
        self._reset()

    def _reset(self) -> None:
        self._requests: dict[str, Request] = {}
        self._late: set[str] = set()
        self._refused: dict[str, str] = {}
        self._notes: list[str] = []
        self._decide_by: int | None = None
        self._at_deadline = False
        self._sent: Dispatch | None = None

    @property
    def wake_at(self) -> int | None:
        """When to call `wake` if nothing else happens."""
        return self._decide_by if self._phase == "open" else None

    def open(self, tick: Tick, lost: frozenset[str], now_ns: int) -> tuple[Event, ...]:
        """A frame begins; the one before it ends, however it stands. Ticks of the past are ignored."""
        if tick.k <= self._tick.k:
            return ()
        events = [*self._end_frame()]
        self._reset()
        self._tick, self._lost, self._phase = tick, lost, "open"
        self._decide_by = tick.t_ns + self._times.deadline_ns
        for request in self._ahead.pop(tick.k, ()):
            self._note(request, now_ns)
        self._ahead = {k: v for k, v in self._ahead.items() if k > tick.k}
        return (*events, *self._advance(now_ns))

    def receive(self, request: Request, now_ns: int) -> tuple[Event, ...]:
        """A request came. One for a frame that is over changes nothing."""
        k = self._tick.k
        if request.k > k:
            if request.k <= k + AHEAD and request.client in self._places:
                self._ahead.setdefault(request.k, []).append(request)
            return ()
        if request.k < k or self._phase in ("no frame", "closed"):
            return ()
        self._note(request, now_ns)
        return self._advance(now_ns)

    def wake(self, now_ns: int) -> tuple[Event, ...]:
        """Time went by."""
        return self._advance(now_ns)

    def finish(self) -> tuple[Event, ...]:
        """No frame follows: the present one ends as it stands."""
        events = tuple(self._end_frame())
        self._phase = "closed" if self._tick.k >= 0 else "no frame"
        return events

    def _note(self, request: Request, now_ns: int) -> None:
        client = request.client
        if client in self._requests or client in self._refused or client in self._late:
            return  # a message doubled on its way
        wrong = malformed(request, self._actuator, self._places)
        if wrong is not None:
            self._notes.append(wrong)
            if client in self._places:
                self._refused[client] = wrong
            return
        if self._phase == "dispatched" and self._at_deadline:
            self._late.add(client)
            if request.bid == "command":
                self._notes.append(f"`{client}` commanded after the deadline")
            return
        self._requests[client] = request
        if request.bid == "command" and self._phase == "open" and self._decide_by is not None:
            self._decide_by = min(self._decide_by, now_ns + self._times.grace_ns)

    def _advance(self, now_ns: int) -> tuple[Event, ...]:
        events: list[Event] = []
        if self._phase == "open":
            choice = choose(self._places, self._requests, self._unheard_of())
            overdue = self._decide_by is not None and now_ns >= self._decide_by
            if choice.settled or overdue:
                self._at_deadline = now_ns >= self._tick.t_ns + self._times.deadline_ns
                events.append(self._dispatch(choice.contender))
        if self._phase == "dispatched" and self._all_heard():
            events.append(self._verdict())
        return tuple(events)

    def _unheard_of(self) -> frozenset[str]:
        """Clients that are not waited for and do not count."""
        return self._lost.union(self._refused) if self._refused else self._lost

    def _all_heard(self) -> bool:
        return all(
            c in self._requests or c in self._lost or c in self._refused or c in self._late
            for c in self._places
        )

    def _end_frame(self) -> tuple[Event, ...]:
        events: list[Event] = []
        if self._phase == "open":
            self._at_deadline = True
            contender = choose(self._places, self._requests, self._unheard_of()).contender
            events.append(self._dispatch(contender))
        if self._phase == "dispatched":
            events.append(self._verdict())
        return tuple(events)

    def _dispatch(self, winner: str | None) -> Dispatch:
        values, fault = self._actuator.idle, None
        if winner is not None:
            request = self._requests[winner]
            fault = request.fault
            if request.values is not None and fault is None:
                values = request.values
        self._sent = Dispatch(self._tick.k, winner, values, fault)
        self._phase = "dispatched"
        return self._sent

    def _verdict(self) -> Verdict:
        sent = self._sent
        assert sent is not None
        self._phase = "closed"
        commands = sum(r.bid == "command" for c, r in self._requests.items() if c not in self._lost)
        return Verdict(
            k=self._tick.k,
            t_ns=self._tick.t_ns,
            actuator=self._actuator.name,
            by=sent.by,
            values=declared_units(self._actuator, sent.values),
            fates=tuple((c, self._fate(c, sent.by)) for c in self._places),
            fault=sent.fault,
            violation=commands > 1,
            notes=tuple(self._notes),
        )

    def _fate(self, client: str, winner: str | None) -> Fate:
        if client == winner:
            return "won"
        if client in self._lost:
            return "lost"
        if client in self._refused:
            return "refused"
        request = self._requests.get(client)
        if request is None:
            return "late"
        return "overruled" if request.bid == "command" else request.bid


def declared_units(
    actuator: Actuator, values: tuple[ScalarValue, ...] | None
) -> tuple[ScalarValue, ...] | None:
    """A command in the units in which the program declares its fields."""
    if values is None:
        return None
    return tuple(
        v if isinstance(v, bool) or f.factor == 1.0 else v / f.factor
        for f, v in zip(actuator.fields, values, strict=True)
    )
