"""Connections to servers, for blocking programs (thesis section 4.5.2).

    with connect("RServer", robot="rome", name="joystick", priority=5) as base:
        base.do(robot.go(200))
        speed = base.do(robot.speed_setting())

or, with separate calls to send and to receive:

    base.send(robot.speed_setting())
    speed = base.recv()
"""

from __future__ import annotations

import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import TIMEOUT_MAX, Lock
from typing import Any, Generic, TypeVar

from colony.runtime.kit.channel import Channel
from colony.runtime.kit.conversation import TIMEOUT_S as TIMEOUT_S
from colony.runtime.kit.conversation import Outcome
from colony.runtime.kit.conversation import answer_timeout as answer_timeout
from colony.runtime.kit.conversation import read_result as read_result
from colony.runtime.kit.errors import CallTimeoutError, RobotConnectionError
from colony.runtime.kit.hub import Hub
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.messages import Notice
from colony.runtime.transport.live.network import require_threads
from colony.runtime.transport.live.robot_address import Credentials
from colony.runtime.transport.live.robot_time import time_of

T = TypeVar("T")

SERVER_START_S = 2.0
"""Seconds to wait for a server that may still be starting."""

MAX_NOTICES = 1024
"""Maximum number of unread notices; beyond it, the oldest are dropped."""


class PendingAnswer(Generic[T]):
    """The future answer to a call. Mutable until it arrives."""

    def __init__(self, channel: Channel, call: CallRequest[T], timeout_s: float) -> None:
        self._channel = channel
        self._call = call
        self._due = time.monotonic() + timeout_s
        self._timeout_s = timeout_s
        self._ready = Lock()
        self._ready.acquire()
        self._outcome: Outcome | None = None
        self._pending = channel.submit(call, self._resolve)

    def result(self) -> T:
        """Wait for the answer, and return the result.

        Raises:
            CallRefusedError, ConnectionLostError, CallTimeoutError: the call has no result.
            ForkedError: this process was forked after the call was sent.
        """
        require_threads()
        left_s = min(max(0.0, self._due - time.monotonic()), TIMEOUT_MAX)  # the timeout may be unlimited
        if self._outcome is None and not self._ready.acquire(timeout=left_s):
            self._channel.forget(self._pending)
            if self._outcome is None:
                raise timeout_error(self._channel, self._call, self._timeout_s)
        assert self._outcome is not None
        return read_result(self._channel.server, self._call, self._outcome)

    def _resolve(self, outcome: Outcome) -> None:
        self._outcome = outcome
        self._ready.release()


class Connection:
    """A connection between this program and one server. Threads may share it. Mutable."""

    def __init__(self, hub: Hub, server: str, *, name: str, priority: int, timeout_s: float) -> None:
        """Open the connection; see `connect`."""
        self.server = server
        self._hub = hub
        self._timeout_s = timeout_s
        self._unreceived: deque[PendingAnswer[Any]] = deque()
        self._notices: deque[Notice] = deque(maxlen=MAX_NOTICES)
        self._notice_signals: SimpleQueue[None] = SimpleQueue()
        self._resources = ExitStack()
        self._channel = hub.channel(server, name=name, priority=priority, notify=self._notify)
        self._resources.callback(hub.release, self._channel)
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def do(self, call: CallRequest[T], *, timeout_s: float | None = None) -> T:
        """Make a call to the server, and wait for the result.

        Raises:
            CallRefusedError: the server refuses; `code` and message give the reason.
            ConnectionLostError: the server went away before it answered, and the call may not be repeated
                automatically.
            CallTimeoutError: no answer came within `timeout_s`, by default that of the connection or call.
        """
        return self._answer(call, timeout_s).result()

    def send(self, call: CallRequest[T], *, timeout_s: float | None = None) -> PendingAnswer[T]:
        """Make a call without waiting; `result` of the answer, or `recv`, waits."""
        answer = self._answer(call, timeout_s)
        self._unreceived.append(answer)
        return answer

    def recv(self) -> Any:
        """Wait for the result of the oldest call that was sent and not received yet.

        Raises:
            LookupError: every sent call was received already.
            CallRefusedError, ConnectionLostError, CallTimeoutError: as for `do`.
        """
        if not self._unreceived:
            raise LookupError(f"every call sent to {self.server} was received already")
        return self._unreceived.popleft().result()

    def keep(self, call: CallRequest[T]) -> T:
        """Make a call, such as a watch, immediately and each time the connection is reopened."""
        result = self.do(call)
        self._channel.repeat_on_reopen(call)
        return result

    def notices(self, *, timeout_s: float | None = None) -> Iterator[Notice]:
        """Yield the notices of the server, which come for a `watch` or another subscription.

        The iterator ends when no notice has come for `timeout_s`.

        Raises:
            ForkedError: this process was forked after the connection was opened.
        """
        require_threads()
        while True:
            try:
                self._notice_signals.get(timeout=timeout_s)
            except Empty:
                return
            if self._notices:
                yield self._notices.popleft()

    @property
    def openings(self) -> int:
        """The number of times that the connection was opened; if above 1, the server has lost its state."""
        return self._channel.openings

    def close(self) -> None:
        """Close the connection. Idempotent."""
        self._resources.close()

    def close_with(self, resources: ExitStack) -> None:
        """Close `resources` too, after the connection."""
        resources.push(self._resources)
        self._resources = resources

    def __enter__(self) -> Connection:
        """Return the connection."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the connection."""
        self.close()

    def _answer(self, call: CallRequest[T], timeout_s: float | None) -> PendingAnswer[T]:
        return PendingAnswer(self._channel, call, answer_timeout(call, timeout_s, self._timeout_s))

    def _open(self) -> None:
        ready: SimpleQueue[Outcome] = SimpleQueue()
        self._channel.open(ready.put)
        for wait_s in opening_timeouts(self._timeout_s):
            with suppress(Empty):
                outcome = ready.get(timeout=wait_s)
                if isinstance(outcome, RobotConnectionError):
                    raise outcome
                return
            if self.server not in self._hub.network.alive():
                break
        raise self._hub.not_found(self.server)

    def _notify(self, notice: Notice) -> None:
        self._notices.append(notice)
        self._notice_signals.put(None)


class Session:
    """A process's session with a robot, shared by its connections.

        with Session.open("rome") as rome:
            base, data = rome.connect("RServer", priority=5), rome.connect("DServer")

    Mutable. Threads may share it.
    """

    def __init__(self, hub: Hub) -> None:
        self.hub = hub
        self._time: Callable[[], int] | None = None

    @classmethod
    def open(
        cls,
        robot: str,
        *,
        gateway: str | None = None,
        credentials: Credentials | None = None,
        environment: Mapping[str, str] = os.environ,
    ) -> Session:
        """Open a session with a robot on this machine or behind a gateway (`tls/HOST:PORT`).

        Raises:
            ServerNotFoundError: this machine has no such robot.
            UnreachableError: the gateway cannot be reached, or refuses the login.
        """
        return cls(Hub.open(robot, gateway=gateway, credentials=credentials, environment=environment))

    def connect(
        self, server: str, *, name: str | None = None, priority: int = 0, timeout_s: float = TIMEOUT_S
    ) -> Connection:
        """Open a connection to a server of the robot; see `connect`."""
        return Connection(
            self.hub, server, name=name or program_name(), priority=priority, timeout_s=timeout_s
        )

    def servers(self) -> tuple[str, ...]:
        """Return the addresses of all nodes of the robot that are up."""
        return self.hub.network.alive()

    def time_ns(self) -> int:
        """Return the robot's time, in nanoseconds.

        Raises:
            UnreachableError: the robot is on another machine, and no tick of its Clock has arrived.
        """
        if self._time is None:
            self._time = time_of(self.hub.network)
        return self._time()

    def close(self) -> None:
        """Close all connections and leave the network. Idempotent."""
        self.hub.close()

    def __enter__(self) -> Session:
        """Return the session."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the session."""
        self.close()


def connect(
    server: str,
    *,
    robot: str,
    name: str | None = None,
    priority: int = 0,
    timeout_s: float = TIMEOUT_S,
    gateway: str | None = None,
    credentials: Credentials | None = None,
    environment: Mapping[str, str] = os.environ,
) -> Connection:
    """Open a connection to a server of a robot.

    Args:
        server: the name of the server.
        robot: the name of the robot.
        name: the display name of the connection; by default, the name of the program.
        priority: the priority of its calls; the server serves higher ones first.
        timeout_s: the maximum time to wait for an answer.
        gateway: the address of a gateway, for a robot on another machine; see `Session.open`.
        credentials: the user's credentials at the gateway.
        environment: the environment variables that locate the run directory of this machine's robots.

    Raises:
        ServerNotFoundError: no server answers under these names.
        CallRefusedError: the server does not accept the connection.
        UnreachableError: the gateway cannot be reached, or refuses the login.
    """
    with ExitStack() as resources:
        session = Session.open(robot, gateway=gateway, credentials=credentials, environment=environment)
        resources.enter_context(session)
        connection = session.connect(server, name=name, priority=priority, timeout_s=timeout_s)
        connection.close_with(resources.pop_all())
        return connection


def opening_timeouts(timeout_s: float) -> tuple[float, ...]:
    """Return the two timeouts in seconds for a server to open the connection, which add up to `timeout_s`.

    The first applies to any server, as it may still be starting; the second only to one that is up.
    """
    first = min(timeout_s, SERVER_START_S)
    return (first, timeout_s - first)


def timeout_error(channel: Channel, call: CallRequest[Any], timeout_s: float) -> CallTimeoutError:
    """Return the error for a call that timed out."""
    text = f"{channel.server} did not answer `{call.method}` in {timeout_s:g} s"
    if not channel.is_open:
        text += "; the connection was lost, and is not open again yet"
    if channel.server_error:
        text += f" (the server reported: {channel.server_error})"
    return CallTimeoutError(text)


def program_name() -> str:
    """Return the name of this program, as shown among a server's connections."""
    return Path(sys.argv[0]).name or "python"
