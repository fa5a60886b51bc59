"""DServer: the variables and semaphores that the processes of a robot share (thesis section 4.6.1).

Its state survives a crash, SIGKILL included. Each change is written to a journal. The journal is written to
the store in one commit, after all waiting messages were handled and before any effect leaves. So nothing
acknowledged can be lost, and many changes cost one commit. A repeated call is not executed again, even after
a restart of the server (see `call_answers.py`).

On a full disk the server refuses calls whose effects must be stored. Everything else continues: calls that
only read, ticks, frames, and the commands of actuators.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import msgspec

from colony.ir.types import ScalarValue, Value
from colony.runtime.arbitration.arbiter import timing
from colony.runtime.arbitration.ballot import NO_INTERVENTIONS, STOPPED
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.frames.publishing import FRAMES_KEPT, Fields, Publisher
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import CallId, RefusedError, method
from colony.runtime.protocol.deployment import (
    MAX_DEPLOYMENT_BYTES,
    ActuatorSpec,
    Deployment,
    actuators_of,
    client_addresses,
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
from colony.runtime.servers.call_answers import CallAnswers
from colony.runtime.servers.checkpoints import Checkpoints
from colony.runtime.servers.commanding import CommandDispatcher
from colony.runtime.servers.data_calls import DataCalls
from colony.runtime.servers.data_methods import set_commanded_variable
from colony.runtime.servers.frame_content import FrameSubscriptions
from colony.runtime.servers.last_sent import LastSent
from colony.runtime.servers.relaying import ActivityRelay
from colony.runtime.servers.semaphores import Semaphores
from colony.runtime.servers.variables import Variables
from colony.runtime.servers.watching import Watches
from colony.runtime.store.store import Journal, Key, MemoryStore, Store, StoreError

_CLOCK_ID = Key("fact", "epoch")
_CLOSED = Key("fact", "closed")

_TIMING_WITHOUT_PROGRAM = timing(50_000_000)

WATCHDOG_DEADLINES = 3
"""Time without a tick, in frame deadlines, after which actuators become idle: two ticks were missed."""

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
        self._leadership = Leadership(self.address)
        self._calls = DataCalls(
            self._variables,
            self._semaphores,
            self._answers,
            self._watches,
            self._frame_subscriptions,
            other_methods=(method("deploy", Deployment, self._deploy, max_bytes=MAX_DEPLOYMENT_BYTES),),
            on_lost=self._leadership.on_lost,
            stop=self._stop,
            other_limit_messages=self.limit_messages,
            storage_problem=lambda: self._journal.full,
        )
        self._next_space_check_ns = 0
        self._emergency = StopFollower()
        self._halt_due = False
        self._watchdog_due_ns: int | None = None
        self._timing = _TIMING_WITHOUT_PROGRAM
        self._changed: list[str] = []
        self._reads: tuple[str, ...] = ()
        self._run: str | None = None
        self._publisher = Publisher(
            self.address, self._read, frames_kept=frames_kept, stopped=lambda: self._emergency.stopped
        )
        self._commands = CommandDispatcher((), self._timing, self._set)
        self._relay = ActivityRelay(self.address, (), frames_kept=frames_kept)
        if deployment is not None:
            self._activate(deployment)
        listens = (
            *self._publisher.listens,
            *self._relay.listens,
            topics.requests(self.address),
            topics.checkpoints(self.address),
            *self._calls.listens,
        )
        self.listens = tuple(dict.fromkeys(listens))

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Backdate loaded values that another clock dated, and give earlier connections time to reconnect."""
        self._variables.backdate(now_ns, all_values=self._other_clock)
        return self._calls.start(now_ns)

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Handle a message, and carry out its commands and stops."""
        self._check_space(now_ns)
        match message:
            case Call() | Alive():
                yield from self._calls.handle(message, now_ns)
            case Tick():
                self._relay.tick()
                before = self._emergency.stopped
                self._emergency.follow(message)
                self._halt_due = before is None and self._emergency.stopped is not None
                yield from self._commands.end_before(message, now_ns)
                yield from self._publisher.handle(message)
                yield from self._arbitrate(message, now_ns)
                yield from self._feed_watchdog(now_ns)
            case Fetch() if message.server == self.address:
                yield from self._publisher.handle(message)
            case Fetch():
                yield from self._relay.fetch(message)
            case Announcement():
                yield from self._relay.announce(message, now_ns)
            case Request():
                yield from self._commands.request(message, now_ns)
            case Checkpoint():
                self._checkpoints.put(message)
            case Recall():
                yield from self._checkpoints.recall(message)
            case Malformed() if message.topic == topics.requests(self.address):
                self._commands.note_malformed(message)
            case Malformed():
                yield from self._calls.handle(message, now_ns)
            case Wake():
                yield from self._commands.wake(now_ns)
                yield from self._calls.handle(message, now_ns)
                self._check_watchdog(now_ns)
            case _:
                return
        if self._halt_due:
            self._halt_due = False
            yield from self._commands.halt(now_ns)
        if self._changed:
            changed, self._changed = self._changed, []
            yield from self._calls.changed(changed, now_ns)

    def _check_space(self, now_ns: int) -> None:
        """Check periodically whether a full disk has space again."""
        if self._journal.full is not None and now_ns >= self._next_space_check_ns:
            self._next_space_check_ns = now_ns + SPACE_CHECK_INTERVAL_NS
            self._journal.check_space()

    def _check_watchdog(self, now_ns: int) -> None:
        """Halt once the watchdog is due."""
        if self._watchdog_due_ns is not None and now_ns >= self._watchdog_due_ns:
            self._watchdog_due_ns, self._halt_due = None, True

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

    def settle(self) -> None:
        """Commit the changes; on a full disk, those that are not about to be acknowledged wait.

        Raises:
            StoreError: the changes cannot be stored; the server must end, and none of its effects may leave.
        """
        self._journal.settle()

    def close(self) -> None:
        """Commit the changes, mark an orderly end, and close the store."""
        try:
            self._journal.put(_CLOSED, b"")
            self._journal.settle()
        finally:
            self._store.close()

    def _read(self, tick: Tick) -> Fields:
        shown, hidden = self._frame_subscriptions.begin_frame(tick.run)
        self._variables.hide(hidden)
        if (reads := self._frame_subscriptions.reads) is not self._reads:
            self._reads = reads
            self._variables.set_program_names(reads)
        self._variables.show(shown)
        variables, sent = self._variables.fields(tick.t_ns), self._commands.fields(tick)
        return {**variables, **sent} if sent else variables

    def _arbitrate(self, tick: Tick, now_ns: int) -> Iterable[Effect]:
        """Begin a frame of the deployed run; end the frames if the tick is of another run."""
        if self._run not in (None, tick.run):
            return self._commands.finish(now_ns)
        return self._commands.tick(
            tick, now_ns, NO_INTERVENTIONS if self._emergency.stopped is None else STOPPED
        )

    # --- the emergency stop --------------------------------------------------------------------------

    def _stop(self, by: str, now_ns: int) -> None:
        self._emergency.engage(Stopped(by=by, t_ns=now_ns))
        self._halt_due = True

    def _feed_watchdog(self, now_ns: int) -> Iterable[Effect]:
        """Schedule a wake at which the actuators become idle, unless a tick arrives first."""
        if self._commands.can_halt:
            self._watchdog_due_ns = now_ns + WATCHDOG_DEADLINES * self._timing.deadline_ns
            yield WakeAt(self._watchdog_due_ns)

    # --- published and set variables -----------------------------------------------------------------

    def _set(self, actuator: ActuatorSpec, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        set_commanded_variable(self._variables, actuator, values, now_ns)
        self._last_sent.put(actuator, values)
        self._changed.append(actuator.command)

    def _deploy(self, call_id: CallId, deployed: Deployment, now_ns: int) -> None:
        if not self._leadership.take(call_id.caller, deployed):
            return
        self._activate(deployed)

    def _activate(self, deployed: Deployment) -> None:
        self._variables.hide(self._frame_subscriptions.deploy(deployed.run, deployed.reads))
        self._run = deployed.run
        self._checkpoints.begin(deployed.run, (client for client, _ in client_addresses(deployed)))
        self._timing = timing(deployed.frame_ns, lockstep=deployed.lockstep)
        actuators = actuators_of(deployed, self.address)
        given = self._last_sent.begin(deployed.run, actuators)
        self._commands = CommandDispatcher(actuators, self._timing, self._set, given=given)
        self._relay.deploy(deployed.python_modules)

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
