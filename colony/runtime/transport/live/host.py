"""A process of the runtime over zenoh: it runs one or more nodes, the same that run in virtual time.

    with Host.open(robot_address, [RServer(driver)], serves=True) as host:
        signal.signal(signal.SIGTERM, lambda *_: host.stop())
        host.run()

One thread at a time handles messages, in one of three ways:

- In the thread of `run`. The network threads put bytes into the inbox (`reception.py`, `inbox.py`). The
  thread of `run` takes messages in order (`message_queue.py`), decodes them, passes them to the nodes,
  settles the nodes, and sends their effects. While it sends, which may block until a link has room, other
  threads may hand messages to the nodes.
- Immediately. In a direct host, whose nodes never block, the receiving thread hands a message to the nodes
  itself if nothing else waits or is being handled. This saves two thread switches. Other messages go to the
  inbox, where urgent calls overtake the rest. Such a host never waits for room on a link: a message that does
  not fit is dropped, and its receiver continues without it or fetches it. A frozen server therefore delays
  only its own clients. Only large messages that must not be dropped wait, in a separate thread (`sender.py`).
- Deferred. Frames that no reader needs yet wait in ring buffers (`deferred.py`), and other deferrable
  messages in the inbox, until the nodes have another message or a wake to handle.

Emergency stops have their own thread (`stop_lane.py`). It takes over the nodes as soon as they finish their
current message, ahead of everything that waits, and never waits for room to send its replies.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from threading import Event, Lock

from colony.runtime.observe.closing import close_all
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.codec import MessageFormatError
from colony.runtime.protocol.messages import (
    Call,
    DeferringNode,
    Effect,
    Malformed,
    Message,
    Node,
    Problem,
    Reply,
    Send,
    SettlingNode,
    Tick,
    Wake,
)
from colony.runtime.protocol.plausibility import check_plausible
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.deferred import DeferredFrames
from colony.runtime.transport.live.inbox import Inbox
from colony.runtime.transport.live.message_queue import MessageQueue, QueuedMessage
from colony.runtime.transport.live.network import ZenohSession, require_threads
from colony.runtime.transport.live.outbox import Outbox, Report
from colony.runtime.transport.live.reception import Reception
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.runtime.transport.live.robot_time import LearnedTime, time_of
from colony.runtime.transport.live.sender import Sender, must_block

BATCH = 64
"""Maximum number of messages handled before the nodes settle and their effects are sent."""

NEVER_NS = 1 << 63
"""A time that is never reached."""


class Host:
    """The nodes of a process, connected by zenoh. Mutable."""

    def __init__(
        self,
        network: ZenohSession,
        nodes: Sequence[Node],
        *,
        time: Callable[[], int],
        handle_directly: bool = False,
        announces: bool = True,
        report: Report = lambda problem: None,
    ) -> None:
        """Run nodes on an open network that the caller owns; `Host.open` opens its own.

        Args:
            network: open session; closing the host leaves it open.
            nodes: nodes with different addresses.
            time: clock of the robot, in nanoseconds.
            handle_directly: True to let the receiving thread hand messages to the nodes, and to never wait
                for room on links. Only for nodes that never block: nothing is received while they handle a
                message. Ignored if a node has to settle.
            announces: False for nodes that take no part in the robot: nobody learns that they are present.
            report: callback for a sentence about each problem that the host survives; called in a thread that
                handles messages.
        """
        self._nodes = tuple(nodes)
        self._network = network
        self._time = time
        self._learned = time if isinstance(time, LearnedTime) else None
        self._settling = tuple(node for node in nodes if isinstance(node, SettlingNode))
        self._is_direct = handle_directly and not self._settling
        self._announces = announces
        self._listeners: dict[str, list[Node]] = {}
        for node in nodes:
            for topic in dict.fromkeys(node.listens):
                self._listeners.setdefault(topic, []).append(node)
        session, robot, user = network.session, network.robot, network.user
        self._outbox = Outbox(session, robot, report, user=user, may_block=not self._is_direct)
        self._stop_outbox = Outbox(session, robot, report, user=user, urgent=True)
        self._blocking_outbox = Outbox(session, robot, report, user=user) if self._is_direct else None
        self._sender: Sender | None = None
        self._inbox = Inbox(MessageQueue())
        self._deferred = DeferredFrames(session, robot)
        handler = self._handle_directly if self._is_direct else None
        self._reception = Reception(
            network, self._inbox, self._deferred, direct_handler=handler, on_stop=self._stop_nodes
        )
        self._handling = Lock()
        self._no_stop_pending = Event()  # cleared while an emergency stop is waiting for the nodes
        self._no_stop_pending.set()
        self._wakes: list[tuple[int, int, Node]] = []
        self._sleeps_until_ns = NEVER_NS
        self._count = 0
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
        handle_directly: bool = False,
        announces: bool = True,
        report: Report = lambda problem: None,
    ) -> Host:
        """Join the robot's processes with these nodes; they start in `run`.

        With `serves`, no other process on this machine can run nodes with these addresses, and other
        processes find this one through the socket of the first node. `time` defaults to the robot's time.

        Raises:
            AlreadyRunningError: another process already runs one of the nodes.
            RunDirectoryError: the robot's folder cannot be used.
            UnreachableError: the gateway cannot be reached, refuses the login, or no Clock ticks behind it.
        """
        server_names = tuple(node.address for node in nodes) if serves else ()
        with ExitStack() as resources:
            network = resources.enter_context(ZenohSession.open(robot_address, server_names=server_names))
            if time is None:
                time = time_of(network)
            host = cls(
                network,
                nodes,
                time=time,
                handle_directly=handle_directly,
                announces=announces,
                report=report,
            )
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
            with ExitStack() as declared:
                if self._blocking_outbox is not None:
                    self._sender = Sender(self._blocking_outbox, self._time, self._fail)
                    declared.callback(self._sender.close)
                with self._handling:
                    self._listen(declared)
                    sends = self._send_directly(self._begin())
                self._send(sends)
                self._announce(declared)
                while not self._stopping:
                    self._run_once()
        finally:
            self._handling.acquire()  # never released: nothing reaches the nodes from now on
            close_all(self._nodes)
        if self._failure is not None:
            raise self._failure

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

    def _listen(self, declared: ExitStack) -> None:
        for topic, nodes in self._listeners.items():
            defers = all(isinstance(node, DeferringNode) and topic in node.deferred for node in nodes)
            self._reception.listen(topic, declared, defers=defers)
        if self._learned is not None and topics.TICKS in self._listeners:
            self._learned.stop_listening()  # `_read` passes ticks on, so each is decoded once

    def _announce(self, declared: ExitStack) -> None:
        """Announce the nodes, once they can receive."""
        for node in self._nodes if self._announces else ():
            key = keys.liveliness_key(self._network.robot, node.address)
            declared.callback(self._network.session.liveliness().declare_token(key).undeclare)

    def _begin(self) -> list[Send]:
        effects: list[_NodeEffect] = []
        for node in self._nodes:
            effects.extend((node, effect) for effect in node.start(self._time()))
        self._settle()
        return self._note_wakes(effects)

    def _run_once(self) -> None:
        """Handle everything that is due or queued; if there is nothing, sleep."""
        self._no_stop_pending.wait()
        with self._handling:
            sends: list[Send] = []
            handled = self._handle_batch(sends)
            if self._inbox.has_dropped_calls:
                sends += self._refusals()
            self._sleeps_until_ns = self._wakes[0][0] if self._wakes else NEVER_NS
            sends = self._send_directly(sends)
        self._send(sends)
        if not handled:
            self._inbox.sleep(self._time_to_wake_s())

    def _handle_batch(self, sends: list[Send]) -> bool:
        """Handle one batch; return True if anything was handled.

        The messages to send are appended to `sends`.
        """
        effects: list[_NodeEffect] = []
        handled = self._take_deferred(effects) | self._wake(effects)
        for _ in range(BATCH if self._settling else 1):
            if not self._no_stop_pending.is_set() or (queued := self._inbox.pop()) is None:
                break
            handled = True
            self._deliver(queued.topic, self._read(queued), effects)
        if handled:
            self._settle()
            sends += self._note_wakes(effects)
        return handled

    def _settle(self) -> None:
        for settling in self._settling:
            settling.settle()

    def _wake(self, effects: list[_NodeEffect]) -> bool:
        """Wake the nodes that are due; return True if there were any."""
        now, woken = self._time(), False
        while self._wakes and self._wakes[0][0] <= now:
            node = heapq.heappop(self._wakes)[2]
            effects.extend((node, effect) for effect in node.handle(Wake(), now))
            woken = True
        return woken

    def _time_to_wake_s(self) -> float | None:
        until = self._sleeps_until_ns
        return None if until == NEVER_NS else max(0.0, (until - self._time()) / 1e9)

    def _refusals(self) -> Iterable[Send]:
        for topic, connection, number in self._inbox.dropped_calls():
            server = topic.partition("/")[0]
            text = f"{server}: too many calls of {connection}; this one was not carried out"
            reply = Reply(connection=connection, number=number, problem=Problem(code="flood", message=text))
            yield Send(topics.replies(server, connection), reply)

    def _send(self, sends: list[Send]) -> None:
        self._outbox.send_all(sends, self._time())

    # --- any thread that handles messages -----------------------------------------------------------

    def _take_deferred(self, effects: list[_NodeEffect]) -> bool:
        """Handle deferred frames; return True if there were any."""
        handled, frames = False, self._deferred.take()
        while self._no_stop_pending.is_set() and (queued := next(frames, None)) is not None:
            self._deliver(queued.topic, self._read(queued), effects)
            handled = True
        return handled

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

    def _deliver(self, topic: str, messages: Iterable[Message], effects: list[_NodeEffect]) -> None:
        now = self._time()
        for message in messages:
            for node in self._listeners[topic]:
                effects.extend((node, effect) for effect in node.handle(message, now))

    def _note_wakes(self, effects: list[_NodeEffect]) -> list[Send]:
        """Schedule the wakes among the effects; return the messages to send."""
        sends: list[Send] = []
        for node, effect in effects:
            if isinstance(effect, Send):
                sends.append(effect)
            else:
                self._count += 1
                heapq.heappush(self._wakes, (effect.t_ns, self._count, node))
        return sends

    def _send_directly(self, sends: list[Send]) -> list[Send]:
        """Send without waiting for room if the host is direct; return the messages left to send.

        A direct host leaves none; another host leaves all.
        """
        if self._sender is None:
            return sends
        if large := [send for send in sends if must_block(send)]:
            self._sender.put(large)
            sends = [send for send in sends if not must_block(send)]
        self._send(sends)
        return []

    def _fail(self, failure: BaseException) -> None:
        """End `run` with an exception that a thread raised."""
        self._failure = failure
        self.stop()

    # --- the threads of the network ------------------------------------------------------------------

    def _handle_directly(self, topic: str, message: bytes | Call) -> bool:
        """Handle a message and all messages queued meanwhile; return False if it must be queued."""
        if not self._no_stop_pending.is_set() or not self._handling.acquire(blocking=False):
            # the nodes are busy: perhaps in this very thread, if a node receives from another one here
            return False
        try:
            if self._stopping or not self._inbox.claim():
                return False
            effects: list[_NodeEffect] = []
            if self._take_deferred(effects):
                self._send_directly(self._note_wakes(effects))
            if not self._no_stop_pending.is_set():
                return False
            queued: QueuedMessage | None = QueuedMessage(topic, message)
            while queued is not None:
                effects = []
                self._deliver(queued.topic, self._read(queued), effects)
                self._send_directly(self._note_wakes(effects))
                queued = self._inbox.pop() if self._no_stop_pending.is_set() else None
            if self._wakes and self._wakes[0][0] < self._sleeps_until_ns:
                self._sleeps_until_ns = self._wakes[0][0]
                self._inbox.rouse()
        except BaseException as failure:
            self._fail(failure)
        finally:
            self._handling.release()
        return True

    # --- the thread of emergency stops ---------------------------------------------------------------

    def _stop_nodes(self, topic: str, message: Call) -> None:
        """Hand an emergency stop to the nodes, ahead of all queued messages."""
        try:
            self._stop_outbox.send_all(self._handle_stop(topic, message), self._time())
        except BaseException as failure:
            self._fail(failure)

    def _handle_stop(self, topic: str, message: Call) -> list[Send]:
        """Let the nodes handle a stop while no other thread uses them; return their messages."""
        self._no_stop_pending.clear()
        try:
            with self._handling:
                if self._stopping:
                    return []
                effects: list[_NodeEffect] = []
                self._deliver(topic, (message,), effects)
                self._settle()
                return self._note_wakes(effects)
        finally:
            self._no_stop_pending.set()
            self._inbox.rouse()  # a node may have scheduled an earlier wake


_NodeEffect = tuple[Node, Effect]
"""A node, and an effect of it that has not been carried out."""
