"""Messages between the sessions of one process, counted, so that a stage knows when all of them are handled.

Hosts run in threads, over real sessions. A host's threads each take their work from a queue, and what arrives
over the network comes from a publisher. So all is quiet if each thread waits for its queue, and each
subscriber has handled what was published for it: nothing more happens until the time advances.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from queue import SimpleQueue
from threading import Event, Lock, Thread, current_thread
from typing import Any
from unittest.mock import patch

import zenoh

from colony.runtime.transport.live import inbox, network, reception
from colony.runtime.transport.live.network import ZenohSession
from tests.waiting import PATIENCE_S


class StuckError(Exception):
    """The hosts do not come to rest; the message names what is on its way."""


class _WatchedQueue(SimpleQueue):  # type: ignore[type-arg]
    """A queue with one consumer, that knows if the consumer has handled all of it. Mutable."""

    def __init__(self, changed: Event) -> None:
        self.maker = current_thread()
        self._changed = changed
        self._counting = Lock()
        self._waits = False
        self.put_count = self._taken = 0

    @property
    def is_idle(self) -> bool:
        """True if the consumer waits, and nothing is there for it."""
        return self._waits and self._taken == self.put_count

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        """Put an item."""
        with self._counting:
            self.put_count += 1
        super().put(item)

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Wait for an item."""
        self._waits = True
        self._changed.set()
        try:
            item = super().get(block, timeout)
        finally:
            self._waits = False
        self._taken += 1
        return item

    def get_nowait(self) -> Any:
        """Take an item, if there is one."""
        item = super().get_nowait()
        self._taken += 1
        return item


class _Subscription:
    """A subscriber, and what was published for it and is not handled. Mutable."""

    def __init__(self, key: str, session: _MeteredSession, *, own: bool) -> None:
        self.key = zenoh.KeyExpr(key)
        self.session = session
        self.own = own
        self.on_its_way = 0


class Traffic:
    """What is on its way between the sessions and in the queues of this process. Mutable.

    `delay_s` returns the seconds for which a message that arrives is held up.
    """

    def __init__(self, delay_s: Callable[[], float] = lambda: 0.0) -> None:
        self.delay_s = delay_s
        self._lock = Lock()
        self._changed = Event()
        self._queues: dict[_WatchedQueue, None] = {}
        self._subscriptions: dict[_Subscription, None] = {}
        self._reached: dict[tuple[str, _MeteredSession, bool], tuple[_Subscription, ...]] = {}
        self.published = 0

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watch the queues of all hosts that are made inside the `with`.

        A session that closes slowly must not shut down the links of this process: other hosts have them.
        """
        with ExitStack() as patches:
            patches.enter_context(patch.object(network, "CLOSE_S", PATIENCE_S))
            for module in (inbox, inbox, reception):
                patches.enter_context(patch.object(module, "SimpleQueue", self._queue))
            yield

    def _queue(self) -> _WatchedQueue:
        queue = _WatchedQueue(self._changed)
        with self._lock:
            self._queues[queue] = None
        return queue

    def take_newest(self) -> _WatchedQueue:
        """Return the queue that was made last, and do not watch it yet: its thread does not run."""
        with self._lock:
            return self._queues.popitem()[0]

    def watch(self, queue: _WatchedQueue) -> None:
        """Watch a queue whose thread runs from now on."""
        with self._lock:
            self._queues[queue] = None

    def forget(self, thread: Thread, queue: _WatchedQueue) -> None:
        """Forget a queue, and all that were made in a thread, because the host that reads them has ended."""
        with self._lock:
            self._queues = {q: None for q in self._queues if q is not queue and q.maker is not thread}
        self._changed.set()

    def meter(self, joined: ZenohSession, *, listens: bool) -> None:
        """Count what goes through a session, which others can dial if it `listens`."""
        joined.session = _MeteredSession(joined.session, self, listens=listens)  # type: ignore[assignment]

    def settle(self) -> None:
        """Wait until all threads wait for work, and all that was published is handled.

        Raises:
            StuckError: that takes too long.
        """
        end = time.monotonic() + PATIENCE_S
        while True:
            self._changed.clear()
            before = self._count()
            if self._is_quiet() and self._count() == before:
                return
            if time.monotonic() > end:
                raise StuckError(f"on its way: {self._on_its_way()}; busy: {len(self._busy())}")
            self._changed.wait(0.005)

    def _count(self) -> int:
        with self._lock:
            return self.published + sum(queue.put_count for queue in self._queues)

    def _is_quiet(self) -> bool:
        return not self._on_its_way() and not self._busy()

    def _busy(self) -> list[_WatchedQueue]:
        with self._lock:
            return [queue for queue in self._queues if not queue.is_idle]

    def _on_its_way(self) -> list[str]:
        with self._lock:
            return [str(s.key) for s in self._subscriptions if s.on_its_way]

    # --- publishers and subscribers ------------------------------------------------------------------

    def publish(self, key: str, session: _MeteredSession, *, own: bool) -> None:
        """Count a message for all that it reaches."""
        with self._lock:
            reached = self._reached.get((key, session, own))
            if reached is None:
                expression = zenoh.KeyExpr(key)
                reached = tuple(
                    s
                    for s in self._subscriptions
                    if s.key.intersects(expression)
                    and ((own and s.own) if s.session is session else s.session.listens or session.listens)
                )
                self._reached[key, session, own] = reached
            for subscription in reached:
                subscription.on_its_way += 1
            self.published += 1

    def handled(self, subscription: _Subscription) -> None:
        """Count a message as handled."""
        with self._lock:
            subscription.on_its_way -= 1
        self._changed.set()

    def subscribe(self, subscription: _Subscription) -> None:
        """Expect messages for a subscriber."""
        with self._lock:
            self._subscriptions[subscription] = None
            self._reached.clear()

    def unsubscribe(self, subscription: _Subscription) -> None:
        """Expect no more messages for a subscriber."""
        with self._lock:
            self._subscriptions.pop(subscription, None)
            self._reached.clear()
        self._changed.set()


class _MeteredSession:
    """A session whose publishers and subscribers are counted."""

    def __init__(self, session: zenoh.Session, traffic: Traffic, *, listens: bool) -> None:
        self._session = session
        self._traffic = traffic
        self.listens = listens

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def declare_publisher(self, key: str, **settings: Any) -> _MeteredPublisher:
        """Declare a publisher."""
        own = settings.get("allowed_destination") != zenoh.Locality.REMOTE
        publish = lambda: self._traffic.publish(key, self, own=own)  # noqa: E731
        return _MeteredPublisher(self._session.declare_publisher(key, **settings), publish)

    def declare_subscriber(self, key: str, handler: Any, **settings: Any) -> _MeteredSubscriber:
        """Declare a subscriber."""
        own = settings.get("allowed_origin") != zenoh.Locality.REMOTE
        subscription, traffic = _Subscription(key, self, own=own), self._traffic

        def handle(sample: zenoh.Sample) -> None:
            try:
                if (delay_s := traffic.delay_s()) > 0.0:
                    time.sleep(delay_s)
                handler.callback(sample)
            finally:
                traffic.handled(subscription)

        traffic.subscribe(subscription)
        counted = zenoh.handlers.Callback(handle, indirect=False)
        return _MeteredSubscriber(
            self._session.declare_subscriber(key, counted, **settings),
            lambda: traffic.unsubscribe(subscription),
        )


class _MeteredPublisher:
    """A publisher that counts what it publishes."""

    def __init__(self, publisher: zenoh.Publisher, publish: Callable[[], None]) -> None:
        self._publisher = publisher
        self._publish = publish

    def __getattr__(self, name: str) -> Any:
        return getattr(self._publisher, name)

    def put(self, data: bytes) -> None:
        """Publish."""
        self._publish()
        self._publisher.put(data)


class _MeteredSubscriber:
    """A subscriber that expects nothing more once it is undeclared."""

    def __init__(self, subscriber: Any, unsubscribe: Callable[[], None]) -> None:
        self._subscriber = subscriber
        self._unsubscribe = unsubscribe

    def undeclare(self) -> None:
        """Stop receiving."""
        self._unsubscribe()
        self._subscriber.undeclare()
