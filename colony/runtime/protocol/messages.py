"""What the nodes of a robot say to each other, and what a node asks of its transport.

Every message is an immutable struct of numbers, bools, strings, bytes, tuples and mappings of them, which
`codec.py` puts into bytes and checks on the way back. A part of a robot is a `Node`: it takes one message and
a time and returns effects; it never sleeps, opens or sends anything itself. A process of the system runs one
or several nodes.

One frame k of a robot, by its messages (thesis section 4.3: clients ask servers, nobody else talks):

    Clock    -> everyone         Tick(k)          the time, who is down, who is lost
    server   -> its readers      ServerFrame(k)   every field, or "no value"
    module   -> DServer          Announcement(k)  the answer of a module in Python, which DServer publishes
    client   -> its server       Request(k)       a command, or that it has none
    server   -> observers        Verdict(k)       who won, what was sent, why the others lost

What clients of a network need besides, to come and go:

    client   -> Clock            Ready            it listens, and can begin; and later, that it lives
    client   -> DServer          Checkpoint(k)    its memory after frame k; and Recall, to have it back
    client   -> Clock            Restart          it cannot go on: begin anew from the initial memory, all

And what scripts, operators and programs outside a network do, at any server, at any time:

    anyone   -> server           Call             a method and its arguments
    server   -> caller           Reply            the result, or what is wrong
    server   -> caller           Notice           something that the caller asked to be told of
    anyone   -> server           Alive            the connection still stands

The live transport puts the requests that clients of one process send to one server at one time into one
message, a `Batch`, and likewise their signs of life and small checkpoints; it takes batches apart before the
receiving node sees them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Literal, NamedTuple, Protocol, runtime_checkable

import msgspec

from colony.ir.frame import Answer, Bid
from colony.ir.types import ScalarValue, Value


class Sample(NamedTuple):
    """A reading and the time at which the device took it."""

    value: Value
    t_ns: int


class _Message(msgspec.Struct, frozen=True, kw_only=True, tag=True, array_like=True):
    """In bytes, an array that begins with the message's name."""


class Stopped(msgspec.Struct, frozen=True, kw_only=True):
    """An emergency stop: the connection that asked for it, and the robot's time at which it was heard."""

    by: str
    t_ns: int


class Tick(_Message, frozen=True, kw_only=True):
    """Frame `k` begins at `t_ns`; `down` are servers and `lost` clients (by address) that do not live.

    `start` is the frame in which the memory of the whole network was at its initial values: 0, or that of
    the last restart. Frames before it are of no use any more. `run` names the run of a program that the
    frame belongs to; "" is that of a robot without a program. `void` are frames of the past, by server and
    number, that never came and never will, because their server died: they count as "no value".

    `stopped` is the emergency stop that is on. One that a server heard at or before `released_ns` is over.
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


class ServerFrame(_Message, frozen=True, kw_only=True):
    """What a server has for frame `k`: fields in base units by name; None, or absent, is "no value".

    `since` is the first frame that this process of the server answered. It knows nothing of those before.
    `stopped` is the emergency stop that keeps the server's actuators idle.
    """

    server: str
    k: int
    fields: Mapping[str, Sample | None]
    since: int = 0
    stopped: Stopped | None = None


class Fetch(_Message, frozen=True, kw_only=True):
    """Asks whoever published the frames of `server` (or the Clock its ticks) to publish frame `k` again."""

    server: str
    k: int


class Request(_Message, frozen=True, kw_only=True):
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


class Announcement(_Message, frozen=True, kw_only=True):
    """A module in Python tells DServer its answer in frame `k`: for its client, for the guards of others, and
    for the observer. Nobody else runs the module."""

    k: int
    module: str
    answer: Answer


Fate = Literal[
    "won",
    "suppressed",
    "inhibited",
    "inactive",  # its predicate is false
    "silent",  # it reads something missing
    "overruled",  # it was active although another, with a higher place, was too: a violation
    "overridden",  # it was active, but a client outside the network, with a higher priority, commanded
    "locked out",  # it was active, but somebody else holds the lock
    "stopped",  # it was active, but the emergency stop is on
    "late",  # lives, but its request was not there when the frame was decided at its deadline
    "lost",
    "refused",  # its request was malformed
]

UNHEARD: frozenset[Fate] = frozenset({"late", "lost", "refused"})
"""Fates of clients whose request did not count."""

Hold = Literal["stopped", "locked"]


class Verdict(_Message, frozen=True, kw_only=True):
    """How frame `k` of an actuator came out.

    `by` is the client of the network that won. `values` were sent, in declared units; None when nothing was
    (`idle hold`). `fates` has every client, highest place first. `violation`: two were active. `outside` is
    the client outside the network whose command was sent instead; `hold` tells that the emergency stop or
    a lock kept the network from deciding. `notes` say what was wrong with what came.
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


# --- clients that come and go ----------------------------------------------------------------------


class Ready(_Message, frozen=True, kw_only=True):
    """A client of the network, by address, tells the Clock that it listens, and for which run.

    It says so again from time to time, as a sign of life: `k` is the frame for which it has just sent its
    request, -1 where it did not.
    """

    client: str
    run: str = ""
    k: int = -1


class Restart(_Message, frozen=True, kw_only=True):
    """A client that lost its memory asks the Clock for a new epoch, unless one began since `start`.

    So does the observer when it stepped over a frame that nobody else received.
    """

    client: str
    start: int


class Checkpoint(_Message, frozen=True, kw_only=True):
    """Memory of a client after frame `k`, of the network that began at `start`. Cells that several clients of
    a node need are in the checkpoint of the first: all checkpoints of a node together restore it.

    To DServer, to be kept; and from it, as the answer to `Recall`, with `k` -1 where it has none.
    """

    client: str
    k: int
    start: int
    memory: bytes


class Recall(_Message, frozen=True, kw_only=True):
    """A client asks DServer for its newest checkpoint."""

    client: str


MOST_IN_BATCH = 1000
"""Messages in one batch."""

Batched = Request | Ready | Checkpoint
"""Messages that travel in batches."""


class Batch(_Message, frozen=True, kw_only=True):
    """Several messages of one kind, from clients of one process to one server, sent together.

    The live transport makes batches and takes them apart: nodes, and virtual time, never see one.
    """

    messages: Annotated[tuple[Batched, ...], msgspec.Meta(min_length=1, max_length=MOST_IN_BATCH)]


# --- calls -----------------------------------------------------------------------------------------


Right = Literal["read", "command", "stop"]
"""What a user may be allowed: to look, to change and move things, to stop the robot in an emergency."""


class Call(_Message, frozen=True, kw_only=True):
    """Method `method` of a server, with arguments in msgpack.

    `connection` is `user/id`. `number` counts the calls of a connection from 1; the same number again is the
    same call again, and is done once. `priority` orders calls that wait at the server, higher first. `right`
    is what the caller claims to be allowed; the transport vouches for it and for the user.
    """

    connection: str
    number: int
    method: str
    arguments: msgspec.Raw
    priority: int = 0
    right: Right = "command"


class Problem(msgspec.Struct, frozen=True, kw_only=True):
    """Why a call failed: a code that programs can tell apart, and a message for people."""

    code: str
    message: str


class Reply(_Message, frozen=True, kw_only=True):
    """The answer to call `number`: its result in msgpack, unless there is a problem.

    `number` is 0 where the call could not even be read.
    """

    connection: str
    number: int
    result: msgspec.Raw = msgspec.Raw(b"\xc0")
    problem: Problem | None = None


class Notice(_Message, frozen=True, kw_only=True):
    """Something that a connection asked to be told of: about `subject`, the body in msgpack."""

    connection: str
    subject: str
    body: msgspec.Raw


class Alive(_Message, frozen=True, kw_only=True):
    """A connection still stands, though it calls nothing."""

    connection: str


class Malformed(_Message, frozen=True, kw_only=True):
    """What a transport hands over in place of bytes that are no message. Never sent.

    `connection` is whose call it would have been, None where it was none.
    """

    topic: str
    connection: str | None
    reason: str


class Wake(_Message, frozen=True, kw_only=True):
    """The time that a node asked to be woken at has come. Never sent."""


Sent = (
    Tick
    | ServerFrame
    | Fetch
    | Announcement
    | Request
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
"""What a node may send to another."""

Wire = Sent | Batch
"""What goes from one process to another."""

Message = Sent | Malformed | Wake


class Send(NamedTuple):
    """Effect: deliver `message` to every node that listens to `topic`."""

    topic: str
    message: Sent


class WakeAt(NamedTuple):
    """Effect: give me a `Wake` at `t_ns`, or at once if that is past. Wakes are never taken back."""

    t_ns: int


Effect = Send | WakeAt


class Node(Protocol):
    """A part of a robot, without its input and output.

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


class QuietNode:
    """What is alike in nodes that wait for messages and hold nothing outside their process."""

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Do nothing."""
        return ()

    def close(self) -> None:
        """Close nothing."""


@runtime_checkable
class Deferring(Node, Protocol):
    """A node that tolerates delay on some topics."""

    @property
    def deferred(self) -> tuple[str, ...]:
        """Topics whose messages may wait until the node is woken, or is handed another message."""
        ...


@runtime_checkable
class Settling(Protocol):
    """A node with something to bring to rest before its effects may leave: a transport calls `settle` after
    it handled what was waiting, and only then carries out the effects of all of it."""

    def settle(self) -> None: ...
