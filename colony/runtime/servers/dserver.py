"""DServer: the variables and semaphores that the processes of a robot share (thesis section 4.6.1).

Its state survives a crash, SIGKILL included. Each change is written to a journal. The journal is written to
the store in one commit, after all waiting messages were handled and before any answer leaves. So nothing
acknowledged can be lost, many changes cost one commit, and frames do not wait for the disk. A repeated call
is not executed again, even after a restart of the server (see `call_answers.py`).

On a full disk the server refuses calls whose effects must be stored. Everything else continues: calls that
only read, ticks, frames, and the commands of actuators.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

import msgspec

from colony.ir.servers import DSERVER
from colony.ir.types import ScalarValue, Value
from colony.runtime.frames.assembler import BLIND, COMMAND, ERROR
from colony.runtime.frames.publishing import (
    FRAME_BYTES,
    FRAMES_KEPT,
    KEPT_BYTES,
    FetchBudget,
    Fields,
    Publisher,
    frame_bytes,
)
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.deployment import ActuatorSpec, Deployment, actuators_of, client_addresses
from colony.runtime.protocol.messages import (
    Announcement,
    Checkpoint,
    Effect,
    Fetch,
    Message,
    Recall,
    Sample,
    SendMessage,
    ServerFrame,
    Tick,
)
from colony.runtime.servers.actuating import CommandedActuators
from colony.runtime.servers.call_answers import CallAnswers, ResourceLimit
from colony.runtime.servers.data_calls import DataCalls, Watches
from colony.runtime.servers.data_methods import set_commanded_variable
from colony.runtime.servers.frame_content import FrameSubscriptions
from colony.runtime.servers.outside_control import ActuatorState, OutsideCommands
from colony.runtime.servers.semaphores import Semaphores
from colony.runtime.servers.variables import Variables
from colony.runtime.store.store import Journal, Key, MemoryStore, Store, StoreError

# --- relaying ------------------------------------------------------------------------------------------
#
# The relay in DServer, which publishes the answers of modules in Python as frames.


class ActivityRelay:
    """A publisher of announcements as frames. Mutable.

    It keeps the newest `frames_kept` frames of each module, and answers fetches within a budget that each
    tick renews. It passes fetches of answers that are not kept here on to the module's process, which
    announces them again: only DServer is linked to both that process and those that fetch.
    """

    def __init__(self, server: str, modules: tuple[str, ...], *, frames_kept: int) -> None:
        self._server = server
        self._max_frames = frames_kept
        self._budget = FetchBudget()
        self.listens = (topics.announcements(server), topics.fetches(server))
        self.deploy(modules)

    def deploy(self, modules: tuple[str, ...]) -> None:
        """Relay the answers of these modules from now on."""
        self._names = {module: topics.activity(self._server, module) for module in modules}
        self._modules = {name: module for module, name in self._names.items()}
        self._frames: dict[str, dict[int, ServerFrame]] = {name: {} for name in self._names.values()}
        self._bytes = dict.fromkeys(self._frames, 0)
        self._bytes_per_module = KEPT_BYTES // max(1, len(self._names))

    def tick(self) -> None:
        """Begin a frame: renew the budget for fetches."""
        self._budget.reset()

    def announce(self, message: Announcement, now_ns: int) -> Iterable[Effect]:
        """Relay an announcement; ignore unknown modules and repeated announcements."""
        name = self._names.get(message.module)
        if name is None or message.k in self._frames[name]:
            return ()
        kept = self._frames[name]
        values, error, blind = message.answer
        fields = {
            COMMAND: None if values is None else Sample(values, now_ns),
            ERROR: Sample(error, now_ns),
            BLIND: Sample(blind, now_ns),
        }
        frame = kept[message.k] = ServerFrame(server=name, k=message.k, fields=fields)
        self._bytes[name] += frame_bytes(fields)
        while len(kept) > 1 and (len(kept) > self._max_frames or self._bytes[name] > self._bytes_per_module):
            self._bytes[name] -= frame_bytes(kept.pop(next(iter(kept))).fields)
        return (SendMessage(topics.frames(name), frame),)

    def fetch(self, message: Fetch) -> Iterable[Effect]:
        """Publish a frame again, or let the module announce it again if it is not kept."""
        module = self._modules.get(message.server)
        if module is None:
            return ()
        frame = self._frames[message.server].get(message.k)
        size = FRAME_BYTES if frame is None else frame_bytes(frame.fields)
        if not self._budget.take(message.server, message.k, size):
            return ()
        if frame is None:
            return (SendMessage(topics.repeats(self._server, module), message),)
        return (SendMessage(topics.frames(message.server), frame),)


# --- last sent -----------------------------------------------------------------------------------------
#
# Commands last sent to actuators on `idle hold`, kept for the time after a restart of DServer.
#
# Such an actuator keeps the value of its last command, which may be long ago: `last.ACTUATOR.FIELD` has
# that value in a server that was restarted, too. Other actuators get a command in every frame.


class _Sent(NamedTuple):
    run: str
    values: tuple[bool | float, ...]


class LastSent:
    """The last command of each actuator that holds, in base units. Mutable; changes go to the journal."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._run = ""
        self._sent: dict[str, _Sent] = {}

    def begin(self, run: str, actuators: Iterable[ActuatorSpec]) -> Mapping[str, tuple[ScalarValue, ...]]:
        """Begin or continue a run; return what these actuators were given in it, and drop the rest."""
        self._run = run
        names = {spec.name for spec in actuators if _is_kept(spec)}
        for name, sent in tuple(self._sent.items()):
            if sent.run != run or name not in names:
                del self._sent[name]
                self._journal.drop(Key("sent", name))
        return {name: sent.values for name, sent in self._sent.items()}

    def put(self, actuator: ActuatorSpec, values: tuple[ScalarValue, ...]) -> None:
        """Keep a command, if the actuator holds it and its frames report it."""
        if not _is_kept(actuator):
            return
        sent = _Sent(self._run, values)
        if repr(sent) != repr(self._sent.get(actuator.name)):  # 0.0 is not -0.0
            self._sent[actuator.name] = sent
            self._journal.put(Key("sent", actuator.name), _encode(sent))

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the commands from the entries of a store."""
        for key, data in entries.items():
            if key.kind == "sent":
                self._sent[key.name] = _sent.decode(data)


def _is_kept(actuator: ActuatorSpec) -> bool:
    return actuator.idle is None and any(isinstance(of, int) for of in actuator.reported)


_encode = msgspec.msgpack.Encoder().encode
_sent = msgspec.msgpack.Decoder(_Sent)


# --- checkpoints ---------------------------------------------------------------------------------------
#
# Checkpoints at DServer: the memory of a program's clients, for the processes that replace lost clients.
#
# DServer accepts checkpoints only of clients of the deployed program.


MAX_MEMORY_BYTES = 1 << 20
"""Byte limit of the memory in one checkpoint."""

MAX_TOTAL_BYTES = 1 << 24
"""Byte limit of all checkpoints; each counts its memory, its name and `OVERHEAD`."""

OVERHEAD = 100

_RUN = Key("fact", "run")
_CLIENTS = Key("fact", "clients")


class Checkpoints:
    """The newest checkpoint of each client, by address. Mutable; changes are written to the journal."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._newest: dict[str, Checkpoint] = {}
        self._bound = ResourceLimit("checkpoints", MAX_TOTAL_BYTES, in_bytes=True)
        self._used = 0
        self._run: str | None = None
        self._clients: frozenset[str] = frozenset()

    @property
    def limit_messages(self) -> tuple[str, ...]:
        """User-readable messages about the limits reached since the server started."""
        return self._bound.limit_messages(self._used)

    def put(self, checkpoint: Checkpoint) -> None:
        """Keep a checkpoint of a client of the program, unless it is too large or outdated."""
        client = checkpoint.client
        if client not in self._clients:
            return
        previous = self._newest.get(client)
        if previous is not None and (checkpoint.start, checkpoint.k) <= (previous.start, previous.k):
            return
        used = self._used + _size(checkpoint) - (0 if previous is None else _size(previous))
        if len(checkpoint.memory) > MAX_MEMORY_BYTES or not self._bound.allows(used):
            return
        self._used = used
        self._newest[client] = checkpoint
        self._journal.put(Key("checkpoint", client), _checkpoints_encode(checkpoint))

    def recall(self, recall: Recall) -> Iterator[SendMessage]:
        """Send a client its newest checkpoint; ignore a client that is not of the deployed program."""
        if recall.client in self._clients:
            empty = Checkpoint(client=recall.client, k=-1, start=-1, memory=b"")
            newest = self._newest.get(recall.client, empty)
            yield SendMessage(topics.recall_answers(DSERVER.name, recall.client), newest)

    def begin(self, run: str, clients: Iterable[str]) -> None:
        """Begin a run with these clients; drop all checkpoints if the run is new."""
        if run == self._run:
            return
        for client in self._newest:
            self._journal.drop(Key("checkpoint", client))
        self._newest.clear()
        self._used = 0
        self._run, self._clients = run, frozenset(clients)
        self._journal.put(_RUN, run.encode())
        self._journal.put(_CLIENTS, _checkpoints_encode(sorted(self._clients)))

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the checkpoints, their run and its clients from the entries of a store."""
        run = entries.get(_RUN)
        self._run = None if run is None else run.decode()
        if _CLIENTS in entries:
            self._clients = _clients.decode(entries[_CLIENTS])
        for key, data in entries.items():
            if key.kind == "checkpoint":
                self._newest[key.name] = _checkpoints.decode(data)
                self._used += _size(self._newest[key.name])


def _size(checkpoint: Checkpoint) -> int:
    return len(checkpoint.memory) + len(checkpoint.client) + OVERHEAD


_checkpoints_encode = msgspec.msgpack.Encoder().encode
_checkpoints = msgspec.msgpack.Decoder(Checkpoint)
_clients = msgspec.msgpack.Decoder(frozenset[str])


# --- dserver -------------------------------------------------------------------------------------------


_CLOCK_ID = Key("fact", "epoch")
_CLOSED = Key("fact", "closed")

SPACE_CHECK_INTERVAL_NS = 1_000_000_000
"""Nanoseconds between two checks for space on a full disk."""


class DServer:
    """The server of variables. It publishes them, sets those bound to actuators, and answers calls. Mutable.

    An actuator with one field sets its variable to the field's value; one with several fields sets it to a
    list of their values in the order declared. Values are in declared units. Modules read a variable set by a
    command of frame k in frame k + 1. The server also relays the activity of the deployment's modules in
    Python, and keeps the checkpoints of clients.

    Frames show the variables that connections requested by `publish` and, during the program's run, those
    that the program reads.

    Args:
        pinned_variables: variables that are fresh in every frame, as if an outside source kept setting them,
            until a call sets them; this outlasts a restart.
        deployment: the program deployed at the start; the call `deploy` replaces it.
        frames_kept: the number of frames kept for readers that missed one.
        store: the store of the state. It is loaded here, and closed by `close`.
        clock_id: the identity of the clock in use. Stored values dated by another clock count as old.
        notes: returns user-readable messages about the store, for `status`.

    Raises:
        StoreError: the content of the store cannot be read.
    """

    address = DSERVER.name

    def __init__(
        self,
        pinned_variables: Mapping[str, Value] | None = None,
        *,
        deployment: Deployment | None = None,
        frames_kept: int = FRAMES_KEPT,
        store: Store | None = None,
        clock_id: str = "",
        notes: Callable[[], Iterable[str]] = lambda: (),
    ) -> None:
        self._store = MemoryStore() if store is None else store
        self._journal = Journal(self._store)
        self._clock_id, self._other_clock = clock_id, False
        self._notes = notes
        self._variables, self._frame_subscriptions = (
            Variables(self._journal),
            FrameSubscriptions(self._journal),
        )
        self._semaphores, self._answers = Semaphores(self._journal), CallAnswers(self._journal)
        self._watches, self._checkpoints = Watches(self._journal), Checkpoints(self._journal)
        self._last_sent = LastSent(self._journal)
        if self._load():
            self._variables.pin(pinned_variables or {})
        self._relay = ActivityRelay(self.address, (), frames_kept=frames_kept)
        outside = OutsideCommands(ActuatorState(server=self.address, built_in={}))
        self._actuators = CommandedActuators(outside, self._set, begin=self._begin)
        self._calls = DataCalls(
            self._variables,
            self._semaphores,
            self._answers,
            self._watches,
            self._frame_subscriptions,
            other_methods=self._actuators.methods,
            on_lost=self._actuators.on_lost,
            stop=self._actuators.stop,
            other_limit_messages=self.limit_messages,
            storage_problem=lambda: self._journal.full,
        )
        self._next_space_check_ns = 0
        self._changed: list[str] = []
        self._reads: tuple[str, ...] = ()
        self._publisher = Publisher(
            self.address, self._read, frames_kept=frames_kept, stopped=lambda: self._actuators.stopped
        )
        if deployment is not None:
            self._actuators.activate(deployment, 0)
        listens = (
            *self._publisher.listens,
            *self._relay.listens,
            *self._actuators.listens,
            topics.checkpoints(self.address),
            *self._calls.listens,
        )
        self.listens = tuple(dict.fromkeys(listens))

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Backdate loaded values that another clock dated, and give earlier connections time to reconnect."""
        self._variables.backdate(now_ns, all_values=self._other_clock)
        self._actuators.start(now_ns)
        return self._calls.start(now_ns)

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Handle a message, and carry out its commands and stops."""
        self._check_space(now_ns)
        match message:
            case Fetch() if message.server != self.address:
                yield from self._relay.fetch(message)
            case Announcement():
                yield from self._relay.announce(message, now_ns)
            case Checkpoint():
                self._checkpoints.put(message)
            case Recall():
                yield from self._checkpoints.recall(message)
            case _:
                if isinstance(message, Tick):
                    self._relay.tick()
                yield from self._actuators.handle(message, now_ns, self._publisher.handle, self._calls)
        if self._changed:
            changed, self._changed = self._changed, []
            yield from self._calls.changed(changed, now_ns)

    def _check_space(self, now_ns: int) -> None:
        """Check periodically whether a full disk has space again."""
        if self._journal.full is not None and now_ns >= self._next_space_check_ns:
            self._next_space_check_ns = now_ns + SPACE_CHECK_INTERVAL_NS
            self._journal.check_space()

    def limit_messages(self) -> tuple[str, ...]:
        """Return user-readable messages about the store and the limits reached since the server started."""
        limited_components = (
            self._variables,
            self._frame_subscriptions,
            self._semaphores,
            self._watches,
            self._answers,
            self._checkpoints,
            self._publisher,
        )
        storage_messages = (
            () if self._journal.full is None else (f"nothing new is kept: {self._journal.full}",)
        )
        return (
            *storage_messages,
            *self._notes(),
            *(message for component in limited_components for message in component.limit_messages),
        )

    @property
    def unsettled(self) -> bool:
        """True if there are changes to commit."""
        return self._journal.unsettled

    def settle(self) -> Callable[[], None] | None:
        """Take the changes, and return a function that commits them; None if there are none.

        On a full disk, those that are not about to be acknowledged wait. The function raises StoreError if
        they cannot be stored: the server must end, and acknowledge nothing.
        """
        return self._journal.settle()

    def close(self) -> None:
        """Commit the changes, mark an orderly end, and close the store."""
        try:
            self._journal.put(_CLOSED, b"")
            if (commit := self._journal.settle()) is not None:
                commit()
        finally:
            self._store.close()

    def _read(self, tick: Tick) -> Fields:
        shown, hidden = self._frame_subscriptions.begin_frame(tick.run)
        self._variables.hide(hidden)
        if (reads := self._frame_subscriptions.reads) is not self._reads:
            self._reads = reads
            self._variables.set_program_names(reads)
        self._variables.show(shown)
        variables, sent = self._variables.fields(tick.t_ns), self._actuators.fields(tick)
        return {**variables, **sent} if sent else variables

    # --- published and set variables -----------------------------------------------------------------

    def _set(self, actuator: ActuatorSpec, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        set_commanded_variable(self._variables, actuator, values, now_ns)
        self._last_sent.put(actuator, values)
        self._changed.append(actuator.command)

    def _begin(self, deployed: Deployment) -> Mapping[str, tuple[ScalarValue, ...]]:
        """Begin a run; return what its actuators were given before."""
        self._variables.hide(self._frame_subscriptions.deploy(deployed.run, deployed.reads))
        self._checkpoints.begin(deployed.run, (client for client, _ in client_addresses(deployed)))
        self._relay.deploy(deployed.python_modules)
        return self._last_sent.begin(deployed.run, actuators_of(deployed, self.address))

    def _load(self) -> bool:
        """Load the store; return False if it was left by a server that crashed."""
        entries = dict(self._store.load())
        stored_components = (
            self._variables,
            self._frame_subscriptions,
            self._semaphores,
            self._answers,
            self._watches,
            self._checkpoints,
            self._last_sent,
        )
        try:
            for component in stored_components:
                component.load(entries)
        except (msgspec.MsgspecError, LookupError, ValueError, RefusedError) as problem:
            raise StoreError(f"the content of DServer's store is inconsistent: {problem!r}") from None
        if entries.get(_CLOCK_ID, b"") != self._clock_id.encode():
            self._other_clock = bool(entries)
            self._journal.put(_CLOCK_ID, self._clock_id.encode())
        if _CLOSED in entries:
            self._journal.drop(_CLOSED)
        return not entries or _CLOSED in entries
