"""A process of the runtime over zenoh: it runs one or several nodes, the very same that run in virtual time.

    with Host.open(place, [RServer(driver)], serves=True) as host:
        signal.signal(signal.SIGTERM, lambda *_: host.stop())
        host.run()

The threads of the network put bytes into the inbox. One thread, that of `run`, does all else: it takes
messages in their order (see `waiting.py`), reads them, gives them to the nodes, lets these settle, and sends
what they want sent. While it sends, which may have to wait for room, others may hand messages to the nodes.

Emergency stops have a thread of their own (`stop_lane.py`). It takes over the nodes as soon as they have
handled their present message, before everything that waits, and never waits for room to send its replies.

For nodes that never keep anyone waiting there is a shorter way: in a `direct` host the thread that receives
a message hands it to the nodes itself, if nothing else waits or is being handled, and spares two switches
between threads. Calls that find others waiting go to the inbox, where the urgent ones overtake the others. A
thread of the network waits for no room: a small reply that finds none is dropped, and its caller asks again.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from threading import Event, Lock

import zenoh

from colony.runtime.observe.closing import close_all
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.codec import LARGEST, NotAMessage
from colony.runtime.protocol.messages import (
    Call,
    Checkpoint,
    Deferring,
    Effect,
    Malformed,
    Message,
    Node,
    Notice,
    Problem,
    Reply,
    Send,
    Settling,
    Tick,
    Wake,
)
from colony.runtime.protocol.plausibility import check_plausible
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.border import Border
from colony.runtime.transport.live.inbox import Inbox
from colony.runtime.transport.live.network import ZenohSession, local_user
from colony.runtime.transport.live.outbox import SMALL_BYTES, Outbox, Report
from colony.runtime.transport.live.place import Place
from colony.runtime.transport.live.robot_time import LearnedTime, time_of
from colony.runtime.transport.live.stop_lane import StopLane
from colony.runtime.transport.live.waiting import Waiting, WaitingRoom

BATCH = 64
"""How many messages are handled, at most, before nodes settle and their effects leave."""

DEFERRED_MOST = 128
"""Frames of a server that wait to be handled with others; of more, the oldest are dropped, and asked for
again. At their largest they are as many bytes as may wait of all other frames."""

DEFERRED_BATCH = 8
"""Messages of a topic that are handled before others get their turn."""

NEVER_NS = 1 << 63
"""A time that does not come."""


class Host:
    """Mutable: what waits, who is to be woken when, and whether it is to stop."""

    def __init__(
        self,
        network: ZenohSession,
        nodes: Sequence[Node],
        *,
        time: Callable[[], int],
        direct: bool = False,
        report: Report = lambda problem: None,
    ) -> None:
        """For a network that is open already and stays so; `Host.open` opens one of its own.

        Args:
            nodes: all have different addresses.
            time: the robot's, in nanoseconds.
            direct: the thread that receives a message of a frame may hand it to the nodes. Only for those
                that take no time to speak of over any message, as nothing is received meanwhile; nodes that
                have to settle do without.
            report: told of what went wrong and is survived, from a thread that handles messages.
        """
        self._nodes = tuple(nodes)
        self._network = network
        self._time = time
        self._learned = time if isinstance(time, LearnedTime) else None
        self._inbox = Inbox(WaitingRoom())
        session, robot, user = network.session, network.robot, network.user
        self._outbox = Outbox(session, robot, report, user=user)
        self._quick_outbox = Outbox(session, robot, report, user=user, patient=False)
        self._stop_outbox = Outbox(session, robot, report, user=user, urgent=True)
        self._border = Border(local_user())
        self._listeners: dict[str, list[Node]] = {}
        for node in nodes:
            for topic in dict.fromkeys(node.listens):
                self._listeners.setdefault(topic, []).append(node)
        self._settling = tuple(node for node in nodes if isinstance(node, Settling))
        self._deferred: list[tuple[str, _Subscriber]] = []
        self._direct = direct and not self._settling
        self._handling = Lock()
        self._calm = Event()  # cleared while an emergency stop is waiting for the nodes
        self._calm.set()
        self._wakes: list[tuple[int, int, Node]] = []
        self._sleeps_until = NEVER_NS
        self._later: list[Send] = []
        self._count = 0
        self._stopping = False
        self._failure: BaseException | None = None
        self._holds = ExitStack()

    @classmethod
    def open(
        cls,
        place: Place,
        nodes: Sequence[Node],
        *,
        serves: bool = False,
        time: Callable[[], int] | None = None,
        direct: bool = False,
        report: Report = lambda problem: None,
    ) -> Host:
        """Join the robot's processes with these nodes; they begin in `run`.

        With `serves` it is the one process of this machine that has nodes of these addresses, and is found
        under the socket of the first. `time` is the robot's, unless another is given.

        Raises:
            AlreadyRunning: one of the nodes runs already.
            RunDirectoryError: the robot's folder cannot be used.
            NotReached: the gateway cannot be reached, or refuses, or no Clock ticks behind it.
        """
        listens = tuple(node.address for node in nodes) if serves else ()
        with ExitStack() as holds:
            network = holds.enter_context(ZenohSession.open(place, listens=listens))
            if time is None:
                time = time_of(network)
            host = cls(network, nodes, time=time, direct=direct, report=report)
            host.and_close(holds.pop_all())
            return host

    @property
    def network(self) -> ZenohSession:
        """What the process is part of, for connections besides its nodes."""
        return self._network

    def run(self) -> None:
        """Run the nodes until `stop`, or until one fails; in the end all are closed, whatever happens."""
        try:
            with ExitStack() as declared:
                with self._handling:
                    self._listen(declared)
                    self._begin()
                self._announce(declared)
                while not self._stopping:
                    self._turn()
                with self._handling:
                    later, self._later = self._later, []
                    self._take_deferred([])
                self._send(later, self._outbox)
        finally:
            self._handling.acquire()  # for good: from now on nobody hands the nodes anything
            close_all(self._nodes)
        if self._failure is not None:
            raise self._failure

    def stop(self) -> None:
        """End `run` soon; from any thread, or from a signal handler."""
        self._stopping = True
        self._inbox.rouse()

    def and_close(self, holds: ExitStack) -> None:
        """Close these too, when the host is closed."""
        self._holds.push(holds)

    def close(self) -> None:
        """Leave the network; again is nothing."""
        self._holds.close()

    def __enter__(self) -> Host:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    # --- the thread of `run` -------------------------------------------------------------------------

    def _begin(self) -> None:
        effects: list[_Due] = []
        for node in self._nodes:
            effects.extend((node, effect) for effect in node.start(self._time()))
        self._settle()
        self._send(self._note_wakes(effects), self._outbox)

    def _turn(self) -> None:
        """Handle what is due and what waits; sleep where there is nothing."""
        self._calm.wait()
        with self._handling:
            sends, self._later = self._later, []
            handled = self._handle_batch(sends)
            self._sleeps_until = self._wakes[0][0] if self._wakes else NEVER_NS
        self._send(sends, self._outbox)
        if self._inbox.gave_up:
            self._refuse_given_up()
        if not handled:
            self._inbox.sleep(self._until_wake_s())

    def _handle_batch(self, sends: list[Send]) -> bool:
        """Handle what is due; whether there was anything. What is to be sent is added to `sends`."""
        effects: list[_Due] = []
        handled = self._take_deferred(effects) | self._wake(effects)
        for _ in range(BATCH if self._settling else 1):
            if not self._calm.is_set() or (waiting := self._inbox.pop()) is None:
                break
            handled = True
            self._deliver(waiting.topic, self._read(waiting), effects)
        if handled:
            self._settle()
            sends += self._note_wakes(effects)
        return handled

    def _take_deferred(self, effects: list[_Due]) -> bool:
        """Handle the messages that may wait until others are handled; whether there were any."""
        handled = False
        for topic, subscriber in self._deferred:
            for _ in range(DEFERRED_BATCH):
                if not self._calm.is_set() or (sample := subscriber.try_recv()) is None:
                    break
                data = sample.payload.to_bytes()
                waiting = Waiting(topic, data if len(data) <= LARGEST else _too_large(topic, None, len(data)))
                self._deliver(topic, self._read(waiting), effects)
                handled = True
        return handled

    def _settle(self) -> None:
        for settling in self._settling:
            settling.settle()

    def _wake(self, effects: list[_Due]) -> bool:
        """Wake who is due; whether somebody was."""
        now, woken = self._time(), False
        while self._wakes and self._wakes[0][0] <= now:
            node = heapq.heappop(self._wakes)[2]
            effects.extend((node, effect) for effect in node.handle(Wake(), now))
            woken = True
        return woken

    def _until_wake_s(self) -> float | None:
        until = self._sleeps_until
        return None if until == NEVER_NS else max(0.0, (until - self._time()) / 1e9)

    def _deliver(self, topic: str, messages: Iterable[Message], effects: list[_Due]) -> None:
        now = self._time()
        for message in messages:
            for node in self._listeners[topic]:
                effects.extend((node, effect) for effect in node.handle(message, now))

    def _note_wakes(self, effects: list[_Due]) -> list[Send]:
        """Note when nodes are to be woken; gives what is to be sent."""
        sends: list[Send] = []
        for node, effect in effects:
            if isinstance(effect, Send):
                sends.append(effect)
            else:
                self._count += 1
                heapq.heappush(self._wakes, (effect.t_ns, self._count, node))
        return sends

    def _send(self, sends: list[Send], outbox: Outbox) -> None:
        outbox.send_all(sends, self._time())

    def _refuse_given_up(self) -> None:
        for topic, connection, number in self._inbox.given_up():
            server = topic.partition("/")[0]
            text = f"{server}: too many calls of {connection}; this one was not done"
            reply = Reply(connection=connection, number=number, problem=Problem(code="flood", message=text))
            self._outbox.send(topics.replies(server, connection), reply, self._time())

    # --- the threads of the network ------------------------------------------------------------------

    def _at_once(self, topic: str, message: bytes | Call) -> bool:
        """Handle a message in this thread, and what waits because of it; False if it must wait."""
        if not self._calm.is_set() or not self._handling.acquire(blocking=False):
            return False  # somebody is handling, perhaps this very thread: a node hears another of its host
        try:
            if self._stopping or not self._inbox.claim():
                return False
            effects: list[_Due] = []
            if self._take_deferred(effects):
                self._send_at_once(effects)
            if not self._calm.is_set():
                return False
            waiting: Waiting | None = Waiting(topic, message)
            while waiting is not None:
                effects = []
                self._deliver(waiting.topic, self._read(waiting), effects)
                self._send_at_once(effects)
                waiting = self._inbox.pop() if self._calm.is_set() else None
            if self._later or (self._wakes and self._wakes[0][0] < self._sleeps_until):
                self._sleeps_until = self._wakes[0][0] if self._wakes else NEVER_NS
                self._inbox.rouse()
        except BaseException as failure:
            self._failure = failure
            self.stop()
        finally:
            self._handling.release()
        return True

    def _send_at_once(self, effects: list[_Due]) -> None:
        sends = self._note_wakes(effects)
        self._later += filter(_may_be_large, sends)
        self._send([send for send in sends if not _may_be_large(send)], self._quick_outbox)

    def _listen(self, declared: ExitStack) -> None:
        robot = self._network.robot
        for topic in self._listeners:
            if keys.takes_calls(topic):
                for right in keys.RIGHTS:
                    if right != "stop":
                        key = keys.listening_to_calls(robot, topic, right)
                        self._subscribe(key, self._takes_call(topic), declared)
                self._listen_to_stops(topic, declared)
            elif self._defers(topic) and keys.takes_frames(topic):
                self._listen_later(topic, declared)
            else:
                self._subscribe(keys.listening(robot, topic), self._takes_frame(topic), declared)
        if self._learned is not None and topics.TICKS in self._listeners:
            self._learned.stop_listening()  # `_read` tells it of ticks: each is decoded once

    def _defers(self, topic: str) -> bool:
        """Whether all who listen to a topic are in no hurry for it."""
        listeners = self._listeners[topic]
        return all(isinstance(node, Deferring) and topic in node.deferred for node in listeners)

    def _listen_later(self, topic: str, declared: ExitStack) -> None:
        """Have frames kept outside of Python until other messages are handled: no thread is woken for them.

        Other messages are not kept there: those of users are to be counted, and of a verdict that is dropped
        for lack of room nobody can ask for another.
        """
        key = keys.listening(self._network.robot, topic)
        handler: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(DEFERRED_MOST)
        subscriber = self._network.session.declare_subscriber(key, handler)
        declared.callback(subscriber.undeclare)
        self._deferred.append((topic, subscriber))

    def _listen_to_stops(self, topic: str, declared: ExitStack) -> None:
        """Have a lane for what comes under the right to stop, over both sessions where there are two."""
        lane = StopLane(self._stop_nodes, self._inbox.call)
        declared.callback(lane.close)
        key = keys.listening_to_calls(self._network.robot, topic, "stop")
        self._subscribe(key, _takes_stop(topic, lane, self._border, twice=False), declared)
        if self._network.stops is not None:
            take = _takes_stop(topic, lane, Border(local_user()), twice=True)
            self._subscribe(key, take, declared, self._network.stops)

    def _subscribe(
        self,
        key: str,
        take: Callable[[zenoh.Sample], None],
        declared: ExitStack,
        session: zenoh.Session | None = None,
    ) -> None:
        handler = zenoh.handlers.Callback(take, indirect=False)
        session = self._network.session if session is None else session
        declared.callback(session.declare_subscriber(key, handler).undeclare)

    def _announce(self, declared: ExitStack) -> None:
        """Tell that the nodes are there, once they can hear."""
        for node in self._nodes:
            key = keys.alive(self._network.robot, node.address)
            declared.callback(self._network.session.liveliness().declare_token(key).undeclare)

    def _takes_frame(self, topic: str) -> Callable[[zenoh.Sample], None]:
        frame, border = self._inbox.frame, self._border
        kind, defers = keys.kind_of_users(topic), self._defers(topic)
        direct = self._direct and not defers

        def take(sample: zenoh.Sample) -> None:
            payload = sample.payload
            size = len(payload)
            data = payload.to_bytes() if size <= LARGEST else b""
            if kind is not None:
                user = str(sample.key_expr).rpartition("/")[2]
                if not border.frame(kind, user, size, codec.count(data)):
                    return  # without a reply: a reader asks again for a frame that it missed
            if size > LARGEST:
                frame(topic, _too_large(topic, None, size))
            elif not (direct and self._at_once(topic, data)):
                frame(topic, data, rouse=not defers)

        return take

    def _takes_call(self, topic: str) -> Callable[[zenoh.Sample], None]:
        inbox, border, direct = self._inbox, self._border, self._direct

        def take(sample: zenoh.Sample) -> None:
            payload = sample.payload
            key = keys.call_key(str(sample.key_expr))
            size = len(payload)
            if key is None:
                return  # a key without a connection leaves nobody to reply to
            if inbox.crowded(key.connection) or not border.call(key.connection, size):
                if border.refusal(key.connection) and size <= LARGEST:
                    self._refuse(topic, key, payload.to_bytes())
                return
            if size > LARGEST:
                inbox.call(topic, key.connection, _too_large(topic, key.connection, size), 0)
                return
            try:
                message = keys.check_call(codec.decode(payload.to_bytes()), key)
            except NotAMessage as problem:
                malformed = Malformed(topic=topic, connection=key.connection, reason=str(problem))
                inbox.call(topic, key.connection, malformed, 0)
            else:
                if not (direct and isinstance(message, Call) and self._at_once(topic, message)):
                    inbox.call(topic, key.connection, message, size)

        return take

    def _refuse(self, topic: str, key: keys.CallKey, data: bytes) -> None:
        """Have a call refused with the code "flood"; bytes that are no call get no reply."""
        with suppress(NotAMessage):
            message = keys.check_call(codec.decode(data), key)
            number = message.number if isinstance(message, Call) else 0
            self._inbox.refuse(topic, key.connection, number)

    # --- the thread of emergency stops ---------------------------------------------------------------

    def _stop_nodes(self, topic: str, message: Call) -> None:
        """Hand the nodes an emergency stop, before anything that waits."""
        try:
            self._send(self._stopped(topic, message), self._stop_outbox)
        except BaseException as failure:
            self._failure = failure
            self.stop()

    def _stopped(self, topic: str, message: Call) -> list[Send]:
        """Give what the nodes have to say to it. Nobody else takes the nodes meanwhile."""
        self._calm.clear()
        try:
            with self._handling:
                if self._stopping:
                    return []
                effects: list[_Due] = []
                self._deliver(topic, (message,), effects)
                self._settle()
                return self._note_wakes(effects)
        finally:
            self._calm.set()
            self._inbox.rouse()  # a node may want to be woken earlier now

    def _read(self, waiting: Waiting) -> tuple[Message, ...]:
        if not isinstance(waiting.message, bytes):
            return (waiting.message,)
        try:
            messages = codec.decode_all(waiting.message)
            for message in messages:
                keys.check_frame(message, waiting.topic)
                if self._learned is not None and isinstance(message, Tick):
                    self._learned.heard(message.t_ns)
                check_plausible(message, self._time())
        except NotAMessage as problem:
            return (Malformed(topic=waiting.topic, connection=None, reason=str(problem)),)
        return messages


def _takes_stop(topic: str, lane: StopLane, border: Border, *, twice: bool) -> Callable[[zenoh.Sample], None]:
    """Return what takes messages of one session under the right to stop. `twice`: another session brings the
    same, and what is no emergency stop is left to that one."""

    def take(sample: zenoh.Sample) -> None:
        payload = sample.payload
        key = keys.call_key(str(sample.key_expr))
        if key is not None and len(payload) <= LARGEST and border.stop(key.connection, len(payload)):
            lane.put(topic, key, payload.to_bytes(), twice=twice)

    return take


_Subscriber = zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]

_Due = tuple[Node, Effect]
"""An effect, and whose it is."""


def _may_be_large(send: Send) -> bool:
    """Whether this is to be sent by the thread of `run`: it may be larger than the room that a link has at
    once, and must not be dropped. A thread of the network that waited for room would wait for itself."""
    match send.message:
        case Reply(result=result):
            return len(bytes(result)) > SMALL_BYTES
        case message:
            return isinstance(message, (Checkpoint, Notice))


def _too_large(topic: str, connection: str | None, size: int) -> Malformed:
    return Malformed(topic=topic, connection=connection, reason=f"{size} bytes; expected at most {LARGEST}")
