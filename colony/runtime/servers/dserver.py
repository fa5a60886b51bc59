"""DServer: the variables and semaphores that the processes of a robot share (thesis section 4.6.1).

Its state survives its death, SIGKILL included. Each change is put into a journal, and the journal into the
store in one commit, after all waiting messages were handled and before any effect leaves: nothing is
acknowledged that could be lost, and many changes cost one commit. A repeated call is not done again, even by
a server that replaced a dead one (see `once.py`).

On a full disk the server refuses calls that would have to be kept, and everything else continues: calls that
only read, ticks, frames, and the commands of actuators.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import msgspec

from colony.ir.types import ScalarValue, Value
from colony.runtime.arbitration.arbiter import timing
from colony.runtime.arbitration.ballot import NOBODY, STOPPED
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.frames.publishing import FRAMES_KEPT, Fields, Publisher
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import Asked, RefusedError, method
from colony.runtime.protocol.deployment import (
    DEPLOYMENT_BYTES,
    ActuatorTable,
    Deployment,
    client_addresses,
    commanded_by,
)
from colony.runtime.protocol.fields import DSERVER
from colony.runtime.protocol.leadership import Leadership
from colony.runtime.protocol.messages import (
    Alive,
    Announcement,
    Call,
    Checkpoint,
    Effect,
    Fetch,
    Malformed,
    Message,
    Recall,
    Request,
    Stopped,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.servers.checkpoints import Checkpoints
from colony.runtime.servers.commanding import CommandDesk
from colony.runtime.servers.data_calls import DataCalls
from colony.runtime.servers.data_methods import command
from colony.runtime.servers.once import CallAnswers
from colony.runtime.servers.relaying import ActivityRelay
from colony.runtime.servers.semaphores import Semaphores
from colony.runtime.servers.showing import Wanted
from colony.runtime.servers.variables import Variables
from colony.runtime.servers.watching import Watches
from colony.runtime.store.store import Journal, Key, MemoryStore, Store, StoreError

_EPOCH = Key("fact", "epoch")
_CLOSED = Key("fact", "closed")

_ROBOT_WITHOUT_PROGRAM = timing(50_000_000)

WATCHDOG_DEADLINES = 3
"""Time without a tick, in deadlines of a frame, after which actuators become idle: two ticks were missed."""

ROOM_NS = 1_000_000_000
"""Nanoseconds between two checks for room on a full disk."""


class DServer:
    """The server of variables: it publishes them, sets those that actuators are bound to, and answers calls.

    An actuator of one field sets its variable to the field's value, one of several fields to an array of them
    in the order declared, in declared units. A variable set by a command of frame k is read in frame k + 1.
    The server also relays the activity of the modules in Python that are `announced`, and keeps the
    checkpoints of clients. Mutable: the variables and all other state.

    Frames show the variables that connections asked for by `publish`, and, in frames of the program's own
    run, those that the program reads.

    Args:
        held: variables that are as fresh as each frame, as if an outside source kept setting them. Setting
            one of them ends that, also for the server that replaces this one when it dies.
        deployment: a program that is deployed from the beginning; others come by the call `deploy`.
        keep: the number of frames kept for readers that missed one.
        store: the store of the state; loaded here, closed by `close`.
        epoch: the name of the clock that times are of. Values in the store of another one's times are old.
        notes: returns sentences for users about the store, for `status`.

    Raises:
        StoreError: the content of the store cannot be read.
    """

    address = DSERVER.name

    def __init__(
        self,
        held: Mapping[str, Value] | None = None,
        *,
        deployment: Deployment | None = None,
        keep: int = FRAMES_KEPT,
        store: Store | None = None,
        epoch: str = "",
        notes: Callable[[], Iterable[str]] = lambda: (),
    ) -> None:
        self._store = MemoryStore() if store is None else store
        self._journal = Journal(self._store)
        self._epoch, self._other_epoch = epoch, False
        self._notes = notes
        self._variables, self._wanted = Variables(self._journal), Wanted(self._journal)
        self._semaphores, self._answers = Semaphores(self._journal), CallAnswers(self._journal)
        self._watches, self._checkpoints = Watches(self._journal), Checkpoints(self._journal)
        if self._load():
            self._variables.hold(held or {})
        self._leadership = Leadership(self.address)
        self._calls = DataCalls(
            self._variables,
            self._semaphores,
            self._answers,
            self._watches,
            self._wanted,
            others=(method("deploy", Deployment, self._deploy, largest=DEPLOYMENT_BYTES),),
            lost=self._leadership.lost,
            stop=self._stop,
            full=self.full,
            no_room=lambda: self._journal.full,
        )
        self._look_for_room_at = 0
        self._emergency = StopFollower()
        self._halting = False
        self._bark_at: int | None = None
        self._times = _ROBOT_WITHOUT_PROGRAM
        self._changed: list[str] = []
        self._reads: tuple[str, ...] = ()
        self._run: str | None = None
        self._publisher = Publisher(
            self.address, self._read, keep=keep, stopped=lambda: self._emergency.stopped
        )
        self._desk = CommandDesk((), self._times, self._set)
        self._relay = ActivityRelay(self.address, (), keep=keep)
        if deployment is not None:
            self._use(deployment)
        listens = (
            *self._publisher.listens,
            *self._relay.listens,
            topics.requests(self.address),
            topics.checkpoints(self.address),
            *self._calls.listens,
        )
        self.listens = tuple(dict.fromkeys(listens))

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Age loaded values of another clock, and give earlier connections the time to reconnect."""
        self._variables.age(now_ns, all_of_them=self._other_epoch)
        return self._calls.start(now_ns)

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Handle a message, and carry out its commands and stops."""
        self._make_room(now_ns)
        match message:
            case Call() | Alive():
                yield from self._calls.handle(message, now_ns)
            case Tick():
                self._relay.tick()
                before = self._emergency.stopped
                self._emergency.follow(message)
                self._halting = before is None and self._emergency.stopped is not None
                yield from self._publisher.handle(message)
                yield from self._arbitrate(message, now_ns)
                yield from self._watch(now_ns)
            case Fetch() if message.server == self.address:
                yield from self._publisher.handle(message)
            case Fetch():
                yield from self._relay.fetch(message)
            case Announcement():
                yield from self._relay.announce(message, now_ns)
            case Request():
                yield from self._desk.request(message, now_ns)
            case Checkpoint():
                self._checkpoints.keep(message)
            case Recall():
                yield from self._checkpoints.recall(message)
            case Malformed() if message.topic == topics.requests(self.address):
                self._desk.malformed(message)
            case Malformed():
                yield from self._calls.handle(message, now_ns)
            case Wake():
                yield from self._desk.wake(now_ns)
                yield from self._calls.handle(message, now_ns)
                self._bark(now_ns)
            case _:
                return
        if self._halting:
            self._halting = False
            yield from self._desk.halt(now_ns)
        if self._changed:
            changed, self._changed = self._changed, []
            yield from self._calls.changed(changed, now_ns)

    def _make_room(self, now_ns: int) -> None:
        """Try now and then whether a full disk has room again."""
        if self._journal.full is not None and now_ns >= self._look_for_room_at:
            self._look_for_room_at = now_ns + ROOM_NS
            self._journal.make_room()

    def _bark(self, now_ns: int) -> None:
        """Halt once the watchdog is due."""
        if self._bark_at is not None and now_ns >= self._bark_at:
            self._bark_at, self._halting = None, True

    def full(self) -> tuple[str, ...]:
        """Return sentences for users about the store, and about limits that are or were reached."""
        parts = (
            self._variables,
            self._wanted,
            self._semaphores,
            self._watches,
            self._answers,
            self._checkpoints,
            self._publisher,
        )
        no_room = () if self._journal.full is None else (f"nothing new is kept: {self._journal.full}",)
        return (*no_room, *self._notes(), *(sentence for part in parts for sentence in part.reached))

    def settle(self) -> None:
        """Commit the changes; on a full disk, changes that were not promised wait.

        Raises:
            StoreError: they cannot be kept; the server must end, and none of its effects may leave.
        """
        self._journal.settle()

    def close(self) -> None:
        """Commit the changes and an orderly end, and close the store."""
        try:
            self._journal.put(_CLOSED, b"")
            self._journal.settle()
        finally:
            self._store.close()

    def _read(self, tick: Tick) -> Fields:
        new, gone = self._wanted.frame_of(tick.run)
        self._variables.hide(gone)
        if (reads := self._wanted.reads) is not self._reads:
            self._reads = reads
            self._variables.read_by_program(reads)
        self._variables.show(new)
        return self._variables.fields(tick.t_ns)

    def _arbitrate(self, tick: Tick, now_ns: int) -> Iterable[Effect]:
        """Begin a frame of the deployed run; in frames of another run there is nothing to decide."""
        if self._run not in (None, tick.run):
            return self._desk.finish(now_ns)
        return self._desk.tick(tick, now_ns, NOBODY if self._emergency.stopped is None else STOPPED)

    # --- the emergency stop --------------------------------------------------------------------------

    def _stop(self, by: str, now_ns: int) -> None:
        self._emergency.hear(Stopped(by=by, t_ns=now_ns))
        self._halting = True

    def _watch(self, now_ns: int) -> Iterable[Effect]:
        """Schedule a wake at which the actuators become idle, unless a tick comes before."""
        if self._desk.moves:
            self._bark_at = now_ns + WATCHDOG_DEADLINES * self._times.deadline_ns
            yield WakeAt(self._bark_at)

    # --- published and set variables -----------------------------------------------------------------

    def _set(self, actuator: ActuatorTable, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        command(self._variables, actuator, values, now_ns)
        self._changed.append(actuator.command)

    def _deploy(self, asked: Asked, deployed: Deployment, now_ns: int) -> None:
        if not self._leadership.take(asked.caller, deployed):
            return
        self._use(deployed)

    def _use(self, deployed: Deployment) -> None:
        self._variables.hide(self._wanted.deploy(deployed.run, deployed.reads))
        self._run = deployed.run
        self._checkpoints.begin(deployed.run, (client for client, _ in client_addresses(deployed)))
        self._times = timing(deployed.frame_ns, lockstep=deployed.lockstep)
        self._desk = CommandDesk(commanded_by(deployed, self.address), self._times, self._set)
        self._relay.deploy(deployed.announced)

    def _load(self) -> bool:
        """Load the content of the store; return False if it is of a server that died and is replaced."""
        entries = dict(self._store.load())
        parts = (
            self._variables,
            self._wanted,
            self._semaphores,
            self._answers,
            self._watches,
            self._checkpoints,
        )
        try:
            for part in parts:
                part.load(entries)
        except (msgspec.MsgspecError, LookupError, ValueError, RefusedError) as problem:
            raise StoreError(f"what DServer's store has does not fit together: {problem!r}") from None
        if entries.get(_EPOCH, b"") != self._epoch.encode():
            self._other_epoch = bool(entries)
            self._journal.put(_EPOCH, self._epoch.encode())
        if _CLOSED in entries:
            self._journal.drop(_CLOSED)
        return not entries or _CLOSED in entries
