"""The rule that decides which party gets an actuator in a frame, if several parties command it.

There are three kinds of parties. The clients of the network bid, and by their exclusive guards at most one of
them commands. A connection from outside the network commands with its own priority, which differs from that
of every client: if it is above the network's winner, it acts instead of the winner; if it is below, it acts
only when the network is idle. The emergency stop keeps out all parties; a lock keeps out all but its holder.

The rule applies to the requests that have arrived so far; a missing request is never taken for an idle one. A
connection from outside acts when every client of higher priority was heard from and does not command, or when
the network's winner has lower priority (then, by the exclusive guards, every client above that winner is
inactive). If a higher client is late, lost or refused, the actuator is idle.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Container, Iterable
from typing import NamedTuple, get_args

from colony.execute.needs import BOUNDS
from colony.ir.frame import Bid
from colony.ir.types import ScalarValue
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec
from colony.runtime.protocol.messages import Bounds, Fate, Hold, Request

# --- ballot --------------------------------------------------------------------------------------------


class ClientRanking:
    """The clients of an actuator and their priorities, in descending order of priority (rank 0 first)."""

    def __init__(self, clients: tuple[tuple[str, int], ...]) -> None:
        self.names = tuple(name for name, _ in clients)
        self.priorities = tuple(priority for _, priority in clients)
        self.rank = {name: rank for rank, name in enumerate(self.names)}

    def above(self, priority: int) -> int:
        """Return the number of clients with a higher priority."""
        return sum(p > priority for p in self.priorities)


class OutsideCommand(NamedTuple):
    """A command from outside the network; `values` in base units, in the order of the actuator's fields.

    With `unlimited`, the limits of the program do not hold for it. `source` is what its server derived it
    from, and gets back with the dispatch.
    """

    connection: str
    priority: int
    values: tuple[ScalarValue, ...]
    unlimited: bool = False
    source: object = None


class Interventions(NamedTuple):
    """The influences on a frame from outside the network: commands and holds.

    `commands` are in descending order of priority, no two of one priority. `hold` keeps out all parties, or
    all but the `holder` of the lock.
    """

    commands: tuple[OutsideCommand, ...] = ()
    hold: Hold | None = None
    holder: str | None = None


NO_INTERVENTIONS = Interventions()
STOPPED = Interventions(hold="stopped")


class Choice(NamedTuple):
    """The decision of a frame so far: the client `by` or the connection `outside` acts, or neither (idle).

    `settled` is True if no outstanding request can change it.
    """

    by: str | None
    outside: OutsideCommand | None
    settled: bool


class Ballot:
    """The requests for one actuator in one frame. Stateful: collects the requests that arrive.

    All requests of a frame together take time linear in the number of clients.
    """

    def __init__(self, ranking: ClientRanking, lost: Iterable[str]) -> None:
        count = len(ranking.names)
        self._ranking = ranking
        self.requests: dict[str, Request] = {}
        self.command_count = 0
        self._heard = bytearray(count)
        self._first_unheard = 0  # the highest-ranked client that is still waited for
        self._first_unknown = count  # the highest-ranked client whose request will never be known
        self._contender = count  # the highest-ranked client that commands
        for client in lost:
            self.exclude(client)

    @property
    def complete(self) -> bool:
        """True if no client is still waited for."""
        return self._first_unheard == len(self._heard)

    def take(self, request: Request) -> None:
        """Take a client's first, well-formed request; a lost client's request does not count."""
        rank = self._ranking.rank[request.client]
        self.requests[request.client] = request
        if self._heard[rank]:
            return
        if request.bid == "command":
            self.command_count += 1
            self._contender = min(self._contender, rank)
        self._mark_heard(rank)

    def exclude(self, client: str) -> None:
        """Stop waiting for a client; its bid stays unknown."""
        rank = self._ranking.rank[client]
        self._first_unknown = min(self._first_unknown, rank)
        self._mark_heard(rank)

    def mark_late(self, client: str) -> None:
        """Stop waiting for a client whose request came after the decision."""
        self._mark_heard(self._ranking.rank[client])

    def choose(self, interventions: Interventions) -> Choice:
        """Return the decision according to the requests so far."""
        match interventions.hold:
            case "stopped":
                return Choice(None, None, True)
            case "locked":
                by_holder = (c for c in interventions.commands if c.connection == interventions.holder)
                return Choice(None, next(by_holder, None), True)
            case None:
                pass
        count = len(self._heard)
        if interventions.commands:
            outside = interventions.commands[0]
            above = self._ranking.above(outside.priority)
            if above <= self._contender:
                if min(self._first_unheard, self._first_unknown) >= above:
                    return Choice(None, outside, True)
                if self._contender < count:
                    return Choice(None, outside, False)
        if self._contender < count:
            return Choice(self._ranking.names[self._contender], None, self._first_unheard > self._contender)
        return Choice(None, None, self.complete)

    def _mark_heard(self, rank: int) -> None:
        heard = self._heard
        heard[rank] = 1
        if rank == self._first_unheard:
            next_rank = heard.find(0, rank)
            self._first_unheard = len(heard) if next_rank < 0 else next_rank


_BIDS = frozenset(get_args(Bid))


def request_error(request: Request, actuator: ActuatorSpec, clients: Container[str]) -> str | None:
    """Return the reason why a request is malformed, or None. No malformed request may move a robot."""
    if request.client not in clients:
        return f"`{request.client}` is not a client of {actuator.name}"
    if request.bid not in _BIDS:
        return f"`{request.client}` bids {request.bid!r}"
    if request.bid != "command":
        return None
    if request.values is None:
        return None if request.fault else f"`{request.client}` commands without values"
    if len(request.values) != len(actuator.fields):
        return f"`{request.client}` gave {len(request.values)} values, expected {len(actuator.fields)}"
    for field, value in zip(actuator.fields, request.values, strict=True):
        if not _is_acceptable(field, value):
            return f"`{request.client}` gave {field.name} = {value!r}"
    return None


def _is_acceptable(field: ActuatorFieldSpec, value: ScalarValue) -> bool:
    if field.kind == "bool":
        return isinstance(value, bool)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return False
    return (field.low is None or value >= field.low) and (field.high is None or value <= field.high)


# --- frame bounds --------------------------------------------------------------------------------------
#
# The bounds of an actuator in a frame, to which a command from outside the network is held.
#
# The client `BOUNDS` sends them, computed from the same frame as the program's own commands. A command of
# frame k from outside the network obeys the bounds of frame k: where they do not arrive by the deadline,
# where they are malformed, or where no command satisfies them, the actuator gets its idle command, which is
# never bounded. The program's own commands do not wait for these bounds: its clients bound them themselves.


LIMITS_UNKNOWN = "limits unknown"
"""Fault of an outside command in a frame whose bounds did not arrive by the deadline."""


class BoundedCommand(NamedTuple):
    """An outside command as it is sent.

    `values` are in base units. With a `fault` they are those of the idle command, None if nothing is sent;
    `note` tells users the reason.
    """

    values: tuple[ScalarValue, ...] | None
    fault: str | None = None
    note: str | None = None


class FrameBounds:
    """The bounds of one actuator, of this frame and later ones. Stateful.

    Args:
        actuator: actuator; unless it is `limited`, every command may be sent.
        frames_ahead: maximum number of frames whose bounds are kept before their ticks.
    """

    def __init__(self, actuator: ActuatorSpec, frames_ahead: int) -> None:
        self._actuator = actuator
        self._frames_ahead = frames_ahead
        self._k = -1
        self._ahead: dict[int, Bounds] = {}
        self._bounds: Bounds | None = None
        self._failed: Fate | None = None

    def begin(self, k: int, *, lost: bool) -> None:
        """Begin frame `k`; `lost` is True if the client of the bounds is lost."""
        self._k = k
        self._bounds = self._ahead.pop(k, None) if self._ahead else None
        self._failed = "lost" if lost else None
        if self._ahead:
            self._ahead = {later: v for later, v in self._ahead.items() if later > k}

    def take(self, bounds: Bounds) -> str | None:
        """Take the bounds of this frame or a later one; return a note if they are refused.

        The first bounds of a frame count. Bounds of earlier frames are ignored.
        """
        if not self._actuator.limited or bounds.k < self._k:
            return None
        reason = bounds_error(bounds, self._actuator)
        if reason is not None:
            if bounds.k == self._k and self._bounds is None:
                self._failed = "refused"
            return reason
        if bounds.k == self._k:
            self._bounds = self._bounds or bounds
        elif may_keep(bounds.k, self._ahead, self._k, self._frames_ahead):
            self._ahead.setdefault(bounds.k, bounds)
        return None

    def awaited_for(self, command: OutsideCommand) -> bool:
        """Return True if a command needs the bounds of the frame, and these may still arrive."""
        return self._binds(command) and self._bounds is None and self._failed is None

    def apply(self, command: OutsideCommand) -> BoundedCommand:
        """Return a command held to the bounds of the frame, field by field."""
        if not self._binds(command):
            return BoundedCommand(command.values)
        idle, bounds = self._actuator.idle, self._bounds
        if bounds is None:
            reason = (
                "have not come" if self._failed is None else f"are not known: `{BOUNDS}` is {self._failed}"
            )
            return BoundedCommand(idle, LIMITS_UNKNOWN, f"limits of frame {self._k} {reason}")
        if bounds.fault is not None:
            return BoundedCommand(idle, bounds.fault, f"limits of frame {self._k}: {bounds.fault}")
        limits = zip(command.values, bounds.low, bounds.high, strict=True)
        return BoundedCommand(tuple([_clamp(value, low, high) for value, low, high in limits]))

    def fates(self, fault: str | None) -> tuple[tuple[str, Fate], ...]:
        """Return the fate of the client of the bounds in a frame whose command waited for it in vain."""
        return ((BOUNDS, self._failed or "late"),) if fault == LIMITS_UNKNOWN else ()

    def _binds(self, command: OutsideCommand) -> bool:
        return self._actuator.limited and not command.unlimited


def may_keep(later: int, kept: Collection[int], k: int, frames_ahead: int) -> bool:
    """Return True if a message that precedes its tick may be kept.

    Args:
        later: frame of the message.
        kept: frames of which messages are kept already.
        k: present frame, -1 before the first tick, which may have any number.
        frames_ahead: maximum number of frames by which a message may precede its tick.
    """
    if k >= 0:
        return later <= k + frames_ahead
    return later in kept or len(kept) < frames_ahead


def bounds_error(bounds: Bounds, actuator: ActuatorSpec) -> str | None:
    """Return the reason why bounds are malformed, or None. No malformed bounds may move a robot."""
    if bounds.fault is not None:
        return None
    count = len(actuator.fields)
    if len(bounds.low) != count or len(bounds.high) != count:
        found = f"{len(bounds.low)} lower and {len(bounds.high)} upper ones"
        return f"bounds of {actuator.name}: {found}; expected {count} of each"
    for field, low, high in zip(actuator.fields, bounds.low, bounds.high, strict=True):
        if not _is_interval(field, low, high):
            return f"bounds of {actuator.name}: {field.name} from {low!r} to {high!r}"
    return None


def _is_interval(field: ActuatorFieldSpec, low: float | None, high: float | None) -> bool:
    """Return True if these are the bounds of a field: within its range, and the lower not above the upper."""
    given = tuple(bound for bound in (low, high) if bound is not None)
    if field.kind == "bool":
        return not given
    if not all(map(math.isfinite, given)) or (len(given) == 2 and given[0] > given[1]):
        return False
    return (field.low is None or (low is not None and low >= field.low)) and (
        field.high is None or (high is not None and high <= field.high)
    )


def _clamp(value: ScalarValue, low: float | None, high: float | None) -> ScalarValue:
    if low is not None and value < low:
        return low
    return high if high is not None and value > high else value
