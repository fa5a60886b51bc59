"""Messages between the nodes of a robot, and requests of a node to its transport.

Every message is an immutable struct of numbers, bools, strings, bytes, tuples and mappings of them, which
`codec.py` encodes and checks on decoding. A component of a robot is a `Node`: it takes one message and a time
and returns effects; it never sleeps, opens or sends anything itself. A process runs one or more nodes.

One frame k of a robot, by its messages (thesis section 4.3: only clients and servers talk to each other):

    Clock    -> all nodes        Tick(k)          the time, the servers that are down, the clients lost
    server   -> its readers      ServerFrame(k)   every field, or "no value"
    module   -> DServer          Announcement(k)  the answer of a module in Python, which DServer publishes
    client   -> its server       Request(k)       a command, or the reason why there is none
    client   -> its server       Bounds(k)        the limits of an actuator, for commands from outside
    server   -> observers        Verdict(k)       the winner, the command sent, the fates of the others

With these messages, clients join a run and recover from a crash:

    client   -> Clock            Ready            it is ready for the run; later, a sign of life
    client   -> DServer          Checkpoint(k)    its memory after frame k; `Recall` asks for it back
    client   -> Clock            Restart          it cannot continue: all restart from the initial memory

Scripts, operators and programs outside a network talk to any server, at any time:

    caller   -> server           Call             a method and its arguments
    server   -> caller           Reply            the result, or the problem
    server   -> caller           Notice           an event that the caller subscribed to
    caller   -> server           Alive            the connection is still in use

The live transport combines the requests that the clients of one process send to one server at one time into
one message, a `Batch`. It does the same with signs of life and small checkpoints. It splits batches before
the receiving node sees them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Literal, NamedTuple, Protocol, runtime_checkable

import msgspec

from colony.ir.frame import Answer, Bid
from colony.ir.types import ScalarValue, Value

# --- messages ------------------------------------------------------------------------------------------


class Sample(NamedTuple):
    """A reading and the time at which the device took it."""

    value: Value
    t_ns: int


class _Message(msgspec.Struct, frozen=True, kw_only=True, tag=True, array_like=True):
    """A message, encoded as an array that begins with the message's name."""


class Stopped(msgspec.Struct, frozen=True, kw_only=True):
    """An emergency stop: the connection that requested it, and the robot's time at which it was received."""

    by: str
    t_ns: int


class Tick(_Message, frozen=True, kw_only=True):
    """The start of frame `k` at `t_ns`; servers in `down` and clients in `lost` (by address) are not alive.

    `start` is the first frame of the epoch, in which all memory of the network had its initial values. Frames
    of earlier epochs are obsolete. `run` names the run of a program that the frame belongs to, "" for a robot
    without a program. `void` lists past frames, by server and number, that will never come because their
    server crashed: they count as "no value". `stopped` is the emergency stop in force. A stop that a server
    received at or before `released_ns` is over.

    `gaps` are the recent gaps in the numbers of the epoch, in order: after the frame with the first number
    of a gap comes the one with its second number, because the Clock was restarted in between. `restarted` is
    True in the first frame of an epoch that begins because memory was lost, if anything that is alive knows
    that the run had begun. `tuned` are the tunable params with another value than at the start of the run, by
    name, in their declared units.
    """

    k: int
    t_ns: int
    start: int = 0
    run: str = ""
    down: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    void: tuple[tuple[str, int], ...] = ()
    stopped: Stopped | None = None
    released_ns: int = -1
    gaps: tuple[tuple[int, int], ...] = ()
    restarted: bool = False
    tuned: dict[str, float] = {}

    @property
    def previous(self) -> int:
        """The number of the frame before this one in the run."""
        return self.gaps[-1][0] if self.gaps and self.gaps[-1][1] == self.k else self.k - 1


class ServerFrame(_Message, frozen=True, kw_only=True):
    """A server's values for frame `k`: fields in base units by name; None, or absent, is "no value".

    `since` is the first frame that this process of the server answered; it does not have earlier ones.
    `stopped` is the emergency stop that keeps the server's actuators idle.
    """

    server: str
    k: int
    fields: Mapping[str, Sample | None]
    since: int = 0
    stopped: Stopped | None = None


class Fetch(_Message, frozen=True, kw_only=True):
    """A request to the publisher of the frames of `server` (or to the Clock) to publish frame `k` again."""

    server: str
    k: int


class Request(_Message, frozen=True, kw_only=True):
    """The bid of `client` for `actuator` in frame `k`.

    `values` are the command's fields in base units, already limited and clamped. They are None if the bid is
    not a command, or if a field is not finite; in the latter case, `fault` describes it.
    """

    k: int
    actuator: str
    client: str
    bid: Bid
    values: tuple[ScalarValue, ...] | None = None
    fault: str | None = None


BoundsFault = Literal["limits contradict", "bound missing"]


class Bounds(_Message, frozen=True, kw_only=True):
    """The bounds of an actuator's fields in frame `k`, which commands from outside the network are held to.

    `low` and `high` have a bound in base units for each field, None where the field has none: the greatest
    lower and the least upper one of its range and its limits. With a `fault`, no command may be sent.
    """

    k: int
    actuator: str
    low: tuple[float | None, ...] = ()
    high: tuple[float | None, ...] = ()
    fault: BoundsFault | None = None


class Announcement(_Message, frozen=True, kw_only=True):
    """The answer of a module in Python in frame `k`, sent to DServer.

    DServer relays it to the module's client, to clients whose guards need it, and to the observer; no other
    process runs the module.
    """

    k: int
    module: str
    answer: Answer


Fate = Literal[
    "won",
    "suppressed",
    "inhibited",
    "inactive",  # its applicability predicate is false
    "silent",  # it reads a missing value
    "overruled",  # active, although a client of higher priority was, too: a violation
    "overridden",  # active, but a client outside the network with a higher priority commanded
    "locked out",  # active, but another connection holds the lock
    "stopped",  # active, but the emergency stop is on
    "late",  # alive, but its request was missing when the frame was decided at its deadline
    "lost",
    "refused",  # its request was malformed
]

UNHEARD: frozenset[Fate] = frozenset({"late", "lost", "refused"})
"""Fates of clients whose request did not count."""

ACTIVE: frozenset[Fate] = frozenset(
    {"won", "suppressed", "inhibited", "overruled", "overridden", "locked out", "stopped"}
)
"""Fates of clients whose modules were active."""

Hold = Literal["stopped", "locked"]


class Verdict(_Message, frozen=True, kw_only=True):
    """The outcome of frame `k` for an actuator.

    `by` is the client of the network that won. `values` is the command sent, in declared units, None if
    nothing was sent (`idle hold`). `fates` has every client, highest priority first. `violation` is True if
    two clients were active. `outside` is the client outside the network that acted instead; `unlimited` is
    True if the program's limits did not hold for it. With a `fault`, the idle command was sent in place of
    the winner's or that client's. `hold` is "stopped" or "locked" if the emergency stop or a lock kept the
    network from deciding. `notes` describe problems with the requests.
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
    outside: str | None = None
    hold: Hold | None = None
    unlimited: bool = False


# --- clients that join and recover -----------------------------------------------------------------


class Progress(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """The progress of a node in a run, from which a restarted Clock learns where to go on.

    `start` is the first frame of the epoch, and `stepped` the last frame that the node stepped over (`start`
    - 1 if there is none). `ticks` are the newest ticks of the epoch that it received.
    """

    start: int
    stepped: int
    ticks: tuple[Tick, ...]


class Ready(_Message, frozen=True, kw_only=True):
    """A report of a client of the network, by address, to the Clock: it is ready for a run.

    The client repeats it as a sign of life: `k` is the frame of its newest request, -1 if it has sent none.
    If the run has begun before, the report of a node's first client has the node's `progress`. The observer
    reports its progress as well.
    """

    client: str
    run: str = ""
    k: int = -1
    progress: Progress | None = None


class Restart(_Message, frozen=True, kw_only=True):
    """A request for a new epoch, by a client that lost its memory; ignored if one began since `start`.

    The observer sends it, too, when it had to skip a frame that no client received.
    """

    client: str
    start: int


class Checkpoint(_Message, frozen=True, kw_only=True):
    """Memory of a client after frame `k` of the epoch that began at `start`.

    Cells that several clients of a node need are only in the checkpoint of the first, so restoring a node
    takes all of its checkpoints. DServer keeps a checkpoint, and sends it as the answer to `Recall`, with `k`
    -1 if it has none.
    """

    client: str
    k: int
    start: int
    memory: bytes


class Recall(_Message, frozen=True, kw_only=True):
    """A client's request to DServer for its newest checkpoint."""

    client: str


MAX_BATCH_LENGTH = 1000
"""Maximum number of messages in one batch."""

Batched = Request | Bounds | Ready | Checkpoint
"""Messages that travel in batches."""


class Batch(_Message, frozen=True, kw_only=True):
    """Several messages of one kind, from clients of one process to one server, sent together.

    Only the live transport makes and splits batches; nodes never see one.
    """

    messages: Annotated[tuple[Batched, ...], msgspec.Meta(min_length=1, max_length=MAX_BATCH_LENGTH)]


# --- calls -----------------------------------------------------------------------------------------


Right = Literal["read", "command", "stop", "unlimited"]
"""Right of a user: to read, to change and move things, to stop in an emergency, or to ignore limits."""


class Call(_Message, frozen=True, kw_only=True):
    """A call of method `method` of a server, with arguments in msgpack.

    `connection` is `user/id`. `number` counts the calls of a connection from 1; a repeated number is the same
    call, and is executed once. `priority` orders calls that wait at the server, higher first. `right`
    is the right that the caller claims; the transport vouches for it and for the user.
    """

    connection: str
    number: int
    method: str
    arguments: msgspec.Raw
    priority: int = 0
    right: Right = "command"


class Problem(msgspec.Struct, frozen=True, kw_only=True):
    """The reason why a call failed: a code for programs, and a message for people."""

    code: str
    message: str


class Reply(_Message, frozen=True, kw_only=True):
    """The answer to call `number`: its result in msgpack, unless there is a problem.

    `number` is 0 if the call could not be decoded.
    """

    connection: str
    number: int
    result: msgspec.Raw = msgspec.Raw(b"\xc0")
    problem: Problem | None = None


class Notice(_Message, frozen=True, kw_only=True):
    """An event that a connection subscribed to: its subject, and its body in msgpack."""

    connection: str
    subject: str
    body: msgspec.Raw


class Alive(_Message, frozen=True, kw_only=True):
    """A sign of life of a connection that makes no calls."""

    connection: str


class Malformed(_Message, frozen=True, kw_only=True):
    """A stand-in that a transport delivers for bytes that are not a message. Never sent.

    `connection` is that of a malformed call, None for other bytes.
    """

    topic: str
    connection: str | None
    reason: str


class Wake(_Message, frozen=True, kw_only=True):
    """A wake that the node scheduled. Never sent."""


SentMessage = (
    Tick
    | ServerFrame
    | Fetch
    | Announcement
    | Request
    | Bounds
    | Verdict
    | Ready
    | Restart
    | Checkpoint
    | Recall
    | Call
    | Reply
    | Notice
    | Alive
)
"""Messages that a node may send to another."""

WireMessage = SentMessage | Batch
"""Messages that travel from one process to another."""

Message = SentMessage | Malformed | Wake


class SendMessage(NamedTuple):
    """Effect: deliver `message` to every node that listens to `topic`."""

    topic: str
    message: SentMessage


class WakeAt(NamedTuple):
    """Effect: deliver a `Wake` at `t_ns`, immediately if it is past. Wakes cannot be cancelled."""

    t_ns: int


Effect = SendMessage | WakeAt


class Node(Protocol):
    """A component of a robot, without its input and output.

    `handle` must accept messages in any order, and duplicates. Times are those of the robot's Clock, in
    nanoseconds.
    """

    @property
    def address(self) -> str:
        """Name of the node, unique on its robot."""
        ...

    @property
    def listens(self) -> tuple[str, ...]:
        """Topics whose messages the node receives."""
        ...

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Return the effects of starting, before any message."""
        ...

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Handle a message and return its effects."""
        ...

    def close(self) -> None:
        """Leave all resources in a safe state; called once, also after a failure."""
        ...


class QuietNode:
    """Defaults for nodes that only wait for messages and own no resources outside their process."""

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Do nothing."""
        return ()

    def close(self) -> None:
        """Close nothing."""


@runtime_checkable
class SettlingNode(Protocol):
    """A node that must finish some work before it acknowledges anything.

    After a transport has delivered a message, or several, it calls `settle` and then what that returns, which
    another thread may do; only then do answers leave. Frames acknowledge nothing, and leave at once.
    """

    @property
    def unsettled(self) -> bool:
        """True if `settle` has something to finish."""
        ...

    def settle(self) -> Callable[[], None] | None:
        """Return a function that finishes the work of the messages handled so far; None if there is none."""
        ...


# --- wakes ---------------------------------------------------------------------------------------------
#
# The wakes that a node asks for: one at a time, in place of one for each change of what is due.


class WakeSchedule:
    """The next wake of a node or of one of its parts. Mutable."""

    def __init__(self) -> None:
        self._next_ns: int | None = None

    def request(self, due_ns: int | None, now_ns: int) -> Iterable[Effect]:
        """Ask for a wake at `due_ns`, unless one is to come by then; None asks for nothing."""
        next_ns = self._next_ns
        if due_ns is None or due_ns == next_ns or (next_ns is not None and now_ns < next_ns < due_ns):
            return ()
        self._next_ns = due_ns
        return (WakeAt(due_ns),)
