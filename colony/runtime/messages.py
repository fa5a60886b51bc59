"""What the processes of a robot say to each other, and what a process asks of its transport.

Everything here is immutable and holds only numbers, bools, strings, tuples and mappings of them, so that a
transport may hand a message over as it is or put it into bytes. A process of the runtime is a `Node`: it
takes one message and a time and returns effects; it never sleeps, opens or sends anything itself.

One frame k of a robot, by its messages (thesis section 4.3: clients ask servers, nobody else talks):

    Clock    -> everyone         Tick(k)          the time, who is down, who is lost
    server   -> its readers      ServerFrame(k)   every field, or "no value"
    module   -> DServer          Announcement(k)  the activity of a module in Python, which DServer publishes
    client   -> its server       Request(k)       a command, or that it has none
    server   -> observers        Verdict(k)       who won, what was sent, why the others lost
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

from colony.ir.types import ScalarValue, Value


class Sample(NamedTuple):
    """A reading and the time at which the device took it."""

    value: Value
    t_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """Frame `k` begins at `t_ns`; `down` are servers and `lost` clients (by address) that do not live."""

    k: int
    t_ns: int
    down: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerFrame:
    """What a server has for frame `k`: fields in base units by name; None, or absent, is "no value"."""

    server: str
    k: int
    fields: Mapping[str, Sample | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fetch:
    """Asks whoever published the frames of `server` (or the Clock its ticks) to publish frame `k` again."""

    server: str
    k: int


Bid = Literal[
    "command",  # active: the network lets its command through
    "held back",  # its predicate holds, but by the network another stands above it
    "silent",  # its predicate does not hold, something is missing, or it does not tell why it has no command
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What `client` wants of `actuator` in frame `k`.

    `values` are the fields in base units, limited and clamped already; None unless the bid is a command,
    and None with `fault` when the command is not finite.
    """

    k: int
    actuator: str
    client: str
    bid: Bid
    values: tuple[ScalarValue, ...] | None = None
    fault: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Announcement:
    """A module in Python tells DServer whether it is active in frame `k`, for the guards of others."""

    k: int
    module: str
    active: bool


Fate = Literal[
    "won",
    "held back",
    "silent",
    "overruled",  # it was active although another, with a higher place, was too: a violation
    "late",  # lives, but its request was not there when the frame was decided at its deadline
    "lost",
    "refused",  # its request was malformed
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """How frame `k` of an actuator came out.

    `values` were sent, in declared units; None when nothing was (`idle hold`). `fates` has every client,
    highest place first. `violation`: two were active. `note` says what was wrong with a refused request.
    """

    k: int
    t_ns: int
    actuator: str
    by: str | None
    values: tuple[ScalarValue, ...] | None
    fates: tuple[tuple[str, Fate], ...]
    fault: str | None = None
    violation: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Wake:
    """The time that a node asked to be woken at has come."""


Message = Tick | ServerFrame | Fetch | Announcement | Request | Verdict | Wake


class Send(NamedTuple):
    """Effect: deliver `message` to every node that listens to `topic`."""

    topic: str
    message: Message


class WakeAt(NamedTuple):
    """Effect: give me a `Wake` at `t_ns`, or at once if that is past. Wakes are never taken back."""

    t_ns: int


Effect = Send | WakeAt


class Node(Protocol):
    """A process of the runtime, without its input and output.

    `handle` must accept messages in any order that a network may bring about, and twice. Times are those
    of the robot's Clock, in nanoseconds.
    """

    @property
    def address(self) -> str: ...

    @property
    def listens(self) -> tuple[str, ...]:
        """The topics whose messages it gets."""
        ...

    def start(self, now_ns: int) -> Iterable[Effect]:
        """What it does before any message."""
        ...

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]: ...

    def close(self) -> None:
        """Leave whatever it holds in a safe state; called once, also after a failure."""
        ...
