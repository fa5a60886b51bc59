"""A process of the runtime over zenoh: it runs one or more nodes, the same that run in virtual time.

    with Host.open(robot_address, [RServer(driver)], serves=True) as host:
        signal.signal(signal.SIGTERM, lambda *_: host.stop())
        host.run()

Nodes of one host hand their messages to each other in memory (`exchange.py`); only what another process
listens to is encoded and sent. Three kinds of threads use the nodes, each node one thread at a time:

- The thread of `run` takes what is due from the exchange, and otherwise a message from the inbox, into which
  the network threads put bytes (`reception.py`, `inbox.py`). It never waits for room on a
  link: a message that does not fit is dropped, and its receiver continues without it or fetches it. A frozen
  process therefore delays nobody else.
- The acknowledging thread commits what nodes store, and sends what may wait (`inbox.py`).
- Emergency stops have a thread for each server (`reception.py`). It hands a stop to a node as soon as the
  node finishes its current message, ahead of everything that waits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from typing import NamedTuple

from colony.runtime.observe.closing import close_all
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.codec import MessageFormatError, check_plausible
from colony.runtime.protocol.messages import (
    Batched,
    Call,
    Effect,
    Malformed,
    Message,
    Node,
    Problem,
    Reply,
    SendMessage,
    Tick,
)
from colony.runtime.transport.exchange import NEVER_NS, Delivery, Exchange, Member
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.inbox import Acknowledging, Inbox, MessageQueue, QueuedMessage, must_wait
from colony.runtime.transport.live.network import ZenohSession, require_threads
from colony.runtime.transport.live.outbox import Outbox, Report
from colony.runtime.transport.live.reception import Reception
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.runtime.transport.live.robot_time import LearnedTime, time_of

BATCH = 64
"""Maximum number of messages of other processes that are handled before wakes that are due."""


class Replacement(NamedTuple):
    """What takes the place of a node that failed.

    The nodes at `addresses` are closed; after `pause_ns` nanoseconds, those that `make` returns start.
    """

    addresses: tuple[str, ...]
    pause_ns: int
    make: Callable[[], Sequence[Node]]


OnFailure = Callable[[str, Exception], Replacement]
"""A function that says what takes the place of the node at an address, which raised an exception.

It raises the exception if the host has to end.
"""


class Host:
    """The nodes of a process, connected by zenoh. Mutable."""

    def __init__(
        self,
        network: ZenohSession,
        nodes: Sequence[Node],
        *,
        time: Callable[[], int],
        announces: bool = True,
        report: Report = lambda problem: None,
        on_failure: OnFailure | None = None,
    ) -> None:
        """Run nodes on an open network that the caller owns; `Host.open` opens its own.

        Args:
            network: open session; closing the host leaves it open.
            nodes: nodes with different addresses.
            time: clock of the robot, in nanoseconds.
            announces: False for nodes that take no part in the robot: nobody learns that they are present.
            report: callback for a sentence about each problem that the host survives; called in a thread that
                handles messages.
            on_failure: says what takes the place of a node that failed; without it, the host ends.
        """
        self._network = network
        self._on_failure = on_failure
        self._time = time
        self._learned = time if isinstance(time, LearnedTime) else None
        self._announces = announces
        self._report = report
        self._exchange = Exchange(time)
        self._outbox = self._new_outbox()
        self._batched: list[SendMessage] = []
        self._unsettled: dict[Member, None] = {}
        self._acknowledging: Acknowledging | None = None
        self._inbox = Inbox(MessageQueue())
        self._reception = Reception(network, self._inbox, on_stop=self._stop_lane)
        self._first = tuple(nodes)
        self._announced: set[str] = set()
        self._declared = ExitStack()
        self._stopping = False
        self._failure: BaseException | None = None
        self._resources = ExitStack()

    @classmethod
    def open(
        cls,
        robot_address: RobotAddress,
        nodes: Sequence[Node],
        *,
        serves: bool = False,
        time: Callable[[], int] | None = None,
        announces: bool = True,
        report: Report = lambda problem: None,
        on_failure: OnFailure | None = None,
    ) -> Host:
        """Join the robot's processes with these nodes; they start in `run`.

        With `serves`, no other process on this machine can run nodes with these addresses (except those of
        clients), and other processes find this one through the socket of the first node. `time` defaults to
        the robot's time.

        Raises:
            AlreadyRunningError: another process already runs one of the nodes.
            RunDirectoryError: the robot's folder cannot be used.
            UnreachableError: the gateway cannot be reached, refuses the login, or no Clock ticks behind it.
        """
        server_names = topics.servers(node.address for node in nodes) if serves else ()
        with ExitStack() as resources:
            network = resources.enter_context(ZenohSession.open(robot_address, server_names=server_names))
            if time is None:
                time = time_of(network)
            host = cls(network, nodes, time=time, announces=announces, report=report, on_failure=on_failure)
            host.take_ownership(resources.pop_all())
            return host

    @property
    def network(self) -> ZenohSession:
        """The session of the process, also for connections that do not belong to its nodes."""
        return self._network

    def run(self) -> None:
        """Run the nodes until `stop` is called or one fails; always close all of them at the end.

        Raises:
            ForkedError: the session was opened before this process was forked.
        """
        require_threads()
        try:
            with self._declared:
                self._acknowledging = Acknowledging(self._exchange, self._sender(), self._fail)
                self._declared.callback(self._acknowledging.close)
                self._admit(self._first)
                while not self._stopping:
                    self._run_once()
        finally:
            members = reversed(self._exchange.members)  # what was added last may need what was there before
            close_all([self._exchange.remove(member.address) for member in members])
        if self._failure is not None:
            raise self._failure

    def add(self, nodes: Sequence[Node]) -> None:
        """Add nodes, which start soon. May be called from any thread."""
        self._exchange.at(self._time(), lambda: self._admit(nodes))
        self._inbox.rouse()

    def stop(self) -> None:
        """Make `run` return soon. May be called from any thread or from a signal handler."""
        self._stopping = True
        self._inbox.rouse()

    def take_ownership(self, resources: ExitStack) -> None:
        """Close `resources` when the host is closed."""
        self._resources.push(resources)

    def close(self) -> None:
        """Leave the network. Idempotent."""
        self._resources.close()

    def __enter__(self) -> Host:
        """Return the host."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the host."""
        self.close()

    # --- the thread of `run` -------------------------------------------------------------------------

    def _admit(self, nodes: Sequence[Node]) -> None:
        """Add nodes, start them, and announce them once they can receive."""
        members = [self._exchange.add(node) for node in nodes]
        joining = [member.address for member in members if member.address not in self._announced]
        for topic in dict.fromkeys(topic for node in nodes for topic in node.listens):
            is_new = self._reception.listen(topic, self._declared)
            if is_new and self._learned is not None and topic == topics.TICKS:
                self._learned.stop_listening()  # `_read` passes ticks on, so each is decoded once
        for member in members:
            self._carry_out(member, self._exchange.start(member))
        self._flush()
        for address in joining if self._announces else ():
            self._announced.add(address)
            key = keys.liveliness_key(self._network.robot, address)
            self._declared.callback(self._network.session.liveliness().declare_token(key).undeclare)

    def _replace(self, address: str, problem: Exception) -> None:
        """Let other nodes take the place of one that failed, and of those that belong to it.

        Raises:
            Exception: nothing takes its place: the host ends.
        """
        if self._on_failure is None:
            raise problem
        replacement = self._on_failure(address, problem)
        with suppress(Exception):
            present = [a for a in replacement.addresses if self._exchange.member(a) is not None]
            close_all([self._exchange.remove(address) for address in present])

        def restart() -> None:
            try:
                self._admit(replacement.make())
            except Exception as again:
                self._replace(address, again)

        if replacement.pause_ns:
            self._exchange.at(self._time() + replacement.pause_ns, restart)
        else:
            restart()

    def _run_once(self) -> None:
        """Handle all messages but calls, then wakes that are due, then one call; if there is none, sleep."""
        self._handle_messages()
        while (due := self._exchange.pop(self._time())) is not None:
            self._deliver(due)
            self._handle_messages()
        self._flush()
        queued = self._inbox.pop()
        if self._inbox.has_dropped_calls:
            self._outbox.send_all(self._refusals(), self._time())
        if queued is not None:
            self._receive(queued)
        elif not self._stopping:
            self._inbox.sleep(self._time_to_wake_s())

    def _handle_messages(self) -> None:
        """Handle messages of this process, and those of others that are no calls: all, or a batch of them."""
        for _ in range(BATCH):
            while (handed_over := self._exchange.pop_message()) is not None:
                self._handle(*handed_over)
            queued = self._inbox.pop_frame()
            if queued is None:
                return
            self._receive(queued)

    def _deliver(self, due: Delivery) -> None:
        if due.receiver is None:
            assert callable(due.content)
            due.content()
        else:
            assert not callable(due.content)
            self._handle(due.receiver, due.content)

    def _receive(self, queued: QueuedMessage) -> None:
        for message in self._read(queued):
            for member in self._exchange.listeners(queued.topic):
                self._handle(member, message)

    def _handle(self, member: Member, message: Message) -> None:
        if member.settling is not None:
            self._unsettled[member] = None
        try:
            effects = self._exchange.handle(member, message)
        except Exception as problem:
            self._replace(member.address, problem)
        else:
            self._carry_out(member, effects)

    def _carry_out(self, member: Member, effects: Iterable[Effect]) -> None:
        """Hand over and send messages; those that can travel together wait for `_flush`."""
        outside: list[SendMessage] = []
        for send in self._put(member, effects):
            (self._batched if isinstance(send.message, Batched) else outside).append(send)
        if outside:
            self._outbox.send_all(outside, self._time())

    def _flush(self) -> None:
        """Send what can travel together, and let nodes settle that acknowledged nothing."""
        if self._unsettled:
            assert self._acknowledging is not None
            for member in self._unsettled:
                self._acknowledging.finish(member)
            self._unsettled.clear()
        if self._batched:
            batched, self._batched = self._batched, []
            self._outbox.send_all(batched, self._time())

    def _time_to_wake_s(self) -> float | None:
        until = self._exchange.next_ns
        return None if until == NEVER_NS else max(0.0, (until - self._time()) / 1e9)

    def _refusals(self) -> Iterable[SendMessage]:
        for topic, connection, number in self._inbox.dropped_calls():
            server = topic.partition("/")[0]
            text = f"{server}: too many calls of {connection}; this one was not carried out"
            reply = Reply(connection=connection, number=number, problem=Problem(code="flood", message=text))
            yield SendMessage(topics.replies(server, connection), reply)

    def _read(self, queued: QueuedMessage) -> tuple[Message, ...]:
        if not isinstance(queued.message, bytes):
            return (queued.message,)
        try:
            messages = codec.decode_all(queued.message)
            for message in messages:
                keys.check_frame(message, queued.topic)
                if self._learned is not None and isinstance(message, Tick):
                    self._learned.on_tick(message.t_ns)
                check_plausible(message, self._time())
        except MessageFormatError as problem:
            return (Malformed(topic=queued.topic, connection=None, reason=str(problem)),)
        return messages

    # --- any thread that handles messages -----------------------------------------------------------

    def _new_outbox(self, *, waits: bool = False, urgent: bool = False) -> Outbox:
        network, exchange = self._network, self._exchange
        return Outbox(
            network.session,
            network.robot,
            self._report,
            user=network.user,
            may_block=waits,
            urgent=urgent,
            is_local=lambda topic: bool(exchange.listeners(topic)),
        )

    def _put(self, member: Member, effects: Iterable[Effect]) -> Sequence[SendMessage]:
        """Hand messages to the nodes of this host, and schedule wakes; return what is to be sent at once."""
        exchange, at_once, waiting = self._exchange, list[SendMessage](), list[SendMessage]()
        settles = member.settling is not None
        for effect in effects:
            if not isinstance(effect, SendMessage):
                exchange.wake_at(member, effect.t_ns)
            elif not must_wait(effect.message, settles=settles):
                exchange.hand_over(*effect)
                at_once.append(effect)
            else:
                if not settles:
                    exchange.hand_over(*effect)
                waiting.append(effect)
        if waiting:
            assert self._acknowledging is not None
            self._acknowledging.put(member, waiting)
        return at_once

    def _sender(self) -> Callable[[Member, Sequence[SendMessage]], None]:
        """Return a function that sends messages which had to wait, in one thread."""
        outbox = self._new_outbox(waits=True)

        def send(member: Member, sends: Sequence[SendMessage]) -> None:
            if member.settling is not None:
                for send in sends:
                    self._exchange.hand_over(*send)
                self._inbox.rouse()
            outbox.send_all(sends, self._time())

        return send

    def _fail(self, failure: BaseException) -> None:
        """End `run` with an exception that a thread raised."""
        self._failure = failure
        self.stop()

    # --- the threads of emergency stops --------------------------------------------------------------

    def _stop_lane(self) -> Callable[[str, Call], None]:
        """Return a function that hands an emergency stop to the nodes, ahead of all queued messages."""
        outbox = self._new_outbox(urgent=True)

        def replace(member: Member, problem: Exception) -> None:
            if not member.removed:
                self._replace(member.address, problem)

        def stop(topic: str, message: Call) -> None:
            for member in self._exchange.listeners(topic):
                try:
                    effects = self._exchange.handle_stop(member, message)
                    outbox.send_all(self._put(member, effects), self._time())
                except Exception as problem:
                    self._exchange.at(self._time(), partial(replace, member, problem))
            self._inbox.rouse()

        return stop
