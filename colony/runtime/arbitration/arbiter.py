"""Arbitration of an actuator: when it is commanded in a frame, and by which client.

This is protocol logic without input, output or a clock. Serving requests by priority is not enough: a server
that executed all requests of a frame in that order would end up with the *last* command, the least important
one. So exactly one of the commands requested in a frame is dispatched, once:

- Clients evaluate exclusive guards: a client that bids a command knows that the network lets it through, and
  normally no other client bids one in that frame. Priorities are the second line of defense.
- The frame is decided as soon as a command has arrived and all live clients of higher priority have been
  heard from. A higher client that does not answer delays the decision by at most the grace period, because
  the exclusive guard of the command says that it is the right one. When all live clients have been heard
  from and none commands, the actuator is idle.
- At the deadline the highest command that has arrived is dispatched, or the idle command. A late or lost
  client therefore leads to idle, never to a lesser behavior. The deadline passes with its wake, which a host
  delivers after all messages that it has: a process that was held up for a moment finds nobody late who
  waits in it. After twice the deadline a message is too old to be waited for.
- Two commands in one frame are a violation: it is recorded, and the higher priority wins.
- Connections from outside the network, locks and the emergency stop are `Interventions`. A command from
  outside is held to the bounds of its frame (`ballot.py`), which its decision waits for, until the
  deadline at most.

`ballot.py` contains the rule, `Arbiter` the protocol around it: ticks, requests and times in, events out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import msgspec

from colony.execute.needs import BOUNDS
from colony.ir.program import Role, in_declared_units
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.ballot import (
    NO_INTERVENTIONS,
    Ballot,
    Choice,
    ClientRanking,
    FrameBounds,
    Interventions,
    may_keep,
    request_error,
)
from colony.runtime.protocol.deployment import ActuatorSpec
from colony.runtime.protocol.messages import ACTIVE, Bounds, Fate, Hold, Request, Tick, Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """The deadline after a tick, and the grace period after the first command.

    The deadline counts from the time in the tick; with `from_arrival`, from the tick's arrival.
    """

    deadline_ns: int
    grace_ns: int
    from_arrival: bool = False


def timing(frame_ns: int, *, lockstep: bool = False) -> Timing:
    """Return a deadline at four fifths of the frame, and a grace period of a tenth of it.

    In lockstep the times of ticks count frames, and are not the times at which the frames begin.
    """
    return Timing(deadline_ns=max(1, frame_ns * 4 // 5), grace_ns=frame_ns // 10, from_arrival=lockstep)


class Dispatch(NamedTuple):
    """Event: send this command now. `values` are in base units; None when nothing is sent (`idle hold`).

    With a `fault`, they are those of the idle command, in the place of the command of `by` or `outside`.
    `source` is that of the command of `outside`.
    """

    k: int
    by: str | None
    values: tuple[ScalarValue, ...] | None
    fault: str | None
    outside: str | None = None
    hold: Hold | None = None
    unlimited: bool = False
    source: object = None


Event = Dispatch | Verdict

MAX_FRAMES_AHEAD = 64
"""Maximum number of frames by which a request may precede its tick; earlier ones are dropped."""

MAX_NOTES = 20
MAX_NOTE_LENGTH = 200
"""Maximum number of notes in a verdict, and of characters in each, whatever clients send."""

Phase = Literal["open", "dispatched", "closed"]


def had_role(fates: Mapping[str, Fate], role: Role) -> bool:
    """Return True if a module had a role in a frame.

    Args:
        fates: the fates of all clients in the verdict of the frame.
        role: the role.
    """
    fate = fates.get(role.module)
    return fate == "won" if role.kind == "by" else fate in ACTIVE


def with_notes(verdict: Verdict, notes: Iterable[str]) -> Verdict:
    """Return a verdict with more notes, as many as it may have."""
    more = tuple(map(_shortened, notes))
    return msgspec.structs.replace(verdict, notes=(*verdict.notes, *more)[:MAX_NOTES]) if more else verdict


def _shortened(note: str) -> str:
    return note if len(note) <= MAX_NOTE_LENGTH else f"{note[: MAX_NOTE_LENGTH - 3]}..."


class Arbiter:
    """The arbitration protocol of one actuator. Stateful: keeps requests for this frame and later ones.

    Every frame gives exactly one `Dispatch` and one `Verdict`: the dispatch when the frame is decided, the
    verdict when every live client has been heard from, or the next frame begins.

    Args:
        actuator: actuator, with its clients and their priorities.
        times: deadline and grace period.
    """

    def __init__(self, actuator: ActuatorSpec, times: Timing) -> None:
        self._actuator = actuator
        self._ranking = ClientRanking(actuator.clients)
        self._times = times
        self._phase: Phase = "closed"
        self._tick = Tick(k=-1, t_ns=0)
        self._ahead: dict[int, list[Request]] = {}
        self._next_notes: list[str] = []
        self._bounds = FrameBounds(actuator, MAX_FRAMES_AHEAD)
        self._begin(self._tick, frozenset(), 0, NO_INTERVENTIONS)

    def _begin(self, tick: Tick, lost: frozenset[str], now_ns: int, interventions: Interventions) -> None:
        self._tick, self._interventions = tick, interventions
        self._bounds.begin(tick.k, lost=BOUNDS in lost)
        self._awaits_bounds = False
        self._lost = lost.intersection(self._ranking.names) if lost else lost
        self._ballot = Ballot(self._ranking, self._lost)
        self._late: set[str] = set()
        self._refused: set[str] = set()
        self._notes, self._next_notes = self._next_notes, []
        began_ns = now_ns if self._times.from_arrival else tick.t_ns
        self._deadline_ns = began_ns + self._times.deadline_ns
        self._stale_ns = self._deadline_ns + self._times.deadline_ns
        self._decide_by = self._deadline_ns
        self._sent: Dispatch | None = None

    @property
    def wake_at(self) -> int | None:
        """Time at which to call `wake` if nothing else happens."""
        return self._due_ns if self._phase == "open" else None

    @property
    def _due_ns(self) -> int:
        """Time at which the frame is decided whatever has not arrived by then."""
        return self._deadline_ns if self._awaits_bounds else self._decide_by

    def open(
        self, tick: Tick, lost: frozenset[str], now_ns: int, interventions: Interventions = NO_INTERVENTIONS
    ) -> tuple[Event, ...]:
        """Begin a frame, and end the previous one as it stands; ignore ticks of the past."""
        if tick.k <= self._tick.k:
            return ()
        events = self._end_frame()
        self._begin(tick, lost, now_ns, interventions)
        self._phase = "open"
        if self._ahead:
            for request in self._ahead.pop(tick.k, ()):
                self._take(request, now_ns)
            self._ahead = {k: v for k, v in self._ahead.items() if k > tick.k}
        return (*events, *self._advance(now_ns))

    def end_before(self, k: int) -> tuple[Event, ...]:
        """End the frame before frame `k` as it stands, if it is still open."""
        return self._end_frame() if self._tick.k < k else ()

    def receive(self, request: Request, now_ns: int) -> tuple[Event, ...]:
        """Take a request; one for a frame that is over changes nothing."""
        k = self._tick.k
        if request.k > k:
            self._keep_for_later(request)
            return ()
        if request.k < k or self._phase == "closed":
            return ()
        self._take(request, now_ns)
        return self._advance(now_ns)

    def receive_bounds(self, bounds: Bounds, now_ns: int) -> tuple[Event, ...]:
        """Take the bounds of a frame; those of a frame that is over change nothing."""
        refusal = self._bounds.take(bounds)
        if refusal is not None:
            self.add_note(refusal)
        return self._advance(now_ns) if self._awaits_bounds else ()

    def intervene(self, interventions: Interventions, now_ns: int) -> tuple[Event, ...]:
        """Apply a change of outside commands, locks or the stop; a dispatched frame is not affected."""
        if self._phase != "open":
            return ()
        self._interventions = interventions
        return self._advance(now_ns)

    def wake(self, now_ns: int) -> tuple[Event, ...]:
        """Decide the frame if its deadline or grace period has passed."""
        return self._advance(now_ns, passes=now_ns >= self._due_ns)

    def finish(self) -> tuple[Event, ...]:
        """End the current frame as it stands, because no other follows."""
        return self._end_frame()

    def add_note(self, note: str) -> None:
        """Add a note for users to the verdict of this frame or, if it is over, of the next."""
        notes = self._notes if self._phase in ("open", "dispatched") else self._next_notes
        if len(notes) < MAX_NOTES:
            notes.append(_shortened(note))

    def _keep_for_later(self, request: Request) -> None:
        if request.client not in self._ranking.rank:
            return
        if not may_keep(request.k, self._ahead, self._tick.k, MAX_FRAMES_AHEAD):
            return
        kept = self._ahead.setdefault(request.k, [])
        if len(kept) < 2 * len(self._ranking.names):
            kept.append(request)

    def _take(self, request: Request, now_ns: int) -> None:
        client = request.client
        if client in self._ballot.requests or client in self._refused or client in self._late:
            return  # a duplicated message
        reason = request_error(request, self._actuator, self._ranking.rank)
        if reason is not None:
            self.add_note(reason)
            if client in self._ranking.rank:
                self._refused.add(client)
                self._ballot.exclude(client)
            return
        if self._phase == "dispatched" and self._at_deadline:
            self._late.add(client)
            self._ballot.mark_late(client)
            if request.bid == "command":
                self.add_note(f"`{client}` commanded after the deadline")
            return
        self._ballot.take(request)
        if request.bid == "command" and self._phase == "open":
            self._decide_by = min(self._decide_by, now_ns + self._times.grace_ns)

    def _advance(self, now_ns: int, *, passes: bool = False) -> tuple[Event, ...]:
        """Decide the frame if all that matters is known, if a deadline passes, or if it is too old."""
        dispatch: Dispatch | None = None
        if self._phase == "open":
            choice = self._ballot.choose(self._interventions)
            self._awaits_bounds = choice.outside is not None and self._bounds.awaited_for(choice.outside)
            settled = choice.settled and not self._awaits_bounds
            if settled or passes or now_ns >= self._stale_ns:
                self._at_deadline = not settled and now_ns >= self._deadline_ns
                dispatch = self._dispatch(choice)
        if self._phase == "dispatched" and self._ballot.complete:
            verdict = self._verdict()
            return (verdict,) if dispatch is None else (dispatch, verdict)
        return () if dispatch is None else (dispatch,)

    def _end_frame(self) -> tuple[Event, ...]:
        if self._phase == "open":
            return (self._dispatch(self._ballot.choose(self._interventions)), self._verdict())
        return (self._verdict(),) if self._phase == "dispatched" else ()

    def _dispatch(self, choice: Choice) -> Dispatch:
        values, fault = self._actuator.idle, None
        outside = choice.outside
        if outside is not None:
            values, fault, note = self._bounds.apply(outside)
            if note is not None:
                self.add_note(note)
        elif choice.by is not None:
            request = self._ballot.requests[choice.by]
            fault = request.fault
            if request.values is not None and fault is None:
                values = request.values
        self._sent = Dispatch(
            self._tick.k,
            choice.by,
            values,
            fault,
            outside=None if outside is None else outside.connection,
            hold=self._interventions.hold,
            unlimited=outside is not None and outside.unlimited and self._actuator.limited,
            source=None if outside is None else outside.source,
        )
        self._phase = "dispatched"
        return self._sent

    def _verdict(self) -> Verdict:
        sent = self._sent
        assert sent is not None
        self._phase = "closed"
        return Verdict(
            k=self._tick.k,
            t_ns=self._tick.t_ns,
            actuator=self._actuator.name,
            by=sent.by,
            values=in_declared_units(sent.values, self._actuator.fields),
            fates=(
                *((c, self._fate(c, sent)) for c in self._ranking.names),
                *self._bounds.fates(sent.fault),
                *self._fates_outside(sent),
            ),
            fault=sent.fault,
            violation=self._ballot.command_count > 1,
            notes=tuple(self._notes),
            outside=sent.outside,
            hold=sent.hold,
            unlimited=sent.unlimited,
        )

    def _fate(self, client: str, sent: Dispatch) -> Fate:
        if client == sent.by:
            return "won"
        if client in self._lost:
            return "lost"
        if client in self._refused:
            return "refused"
        request = self._ballot.requests.get(client)
        if request is None:
            return "late"
        if request.bid != "command":
            return request.bid
        return _losing_fate(sent)

    def _fates_outside(self, sent: Dispatch) -> tuple[tuple[str, Fate], ...]:
        """Return the fates of outside connections whose command was not sent."""
        if not self._interventions.commands:
            return ()
        fate: Fate = "overridden" if sent.hold is None else _losing_fate(sent)
        return tuple(
            (c.connection, fate) for c in self._interventions.commands if c.connection != sent.outside
        )


def _losing_fate(sent: Dispatch) -> Fate:
    """Return the fate of a client whose command did not get through."""
    match sent.hold:
        case "stopped":
            return "stopped"
        case "locked":
            return "locked out"
        case None:
            return "overruled" if sent.outside is None else "overridden"
