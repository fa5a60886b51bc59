"""Resources shared by all connections from a process to a robot.

These are the network session, the thread that keeps the connections alive, and the presence of servers.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from functools import partial
from queue import Empty, SimpleQueue
from secrets import randbelow
from threading import Lock, Thread
from uuid import uuid4

import msgspec
import zenoh

from colony.runtime.kit.channel import Channel
from colony.runtime.kit.conversation import Outcome
from colony.runtime.kit.errors import RobotConnectionError, ServerNotFoundError
from colony.runtime.protocol import codec
from colony.runtime.protocol.codec import MessageFormatError
from colony.runtime.protocol.messages import Notice, Reply, Right
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.configuration import parse_endpoint
from colony.runtime.transport.live.gateway import GATEWAY, UserIdentity, whoami
from colony.runtime.transport.live.network import ZenohSession, is_forked, require_threads
from colony.runtime.transport.live.robot_address import Credentials, Local, Remote, RobotAddress, local
from colony.runtime.transport.live.run_directory import RobotDirectory, RunDirectory, UnreachableError
from colony.runtime.transport.live.security import check_credentials, rights

LOGIN_TIMEOUT_S = 2.0
"""Timeout in seconds for a gateway to report a user's rights."""

REPLY_BUCKETS = 256
"""Number of key expressions on which the processes of one user subscribe to replies.

Each process draws one for all of its connections, because zenoh never frees the memory of a declared key
during the life of a link.
"""

POLL_INTERVAL_S = 0.1
"""Seconds between two rounds of sending signs of life and resending calls."""


class Hub:
    """The network session of a process, and the connections over it. Mutable. Threads may share it."""

    def __init__(self, network: ZenohSession, *, rights: tuple[Right, ...] = keys.RIGHTS) -> None:
        """Use an open network that the caller owns; see also `on_network` and `open`.

        `rights` are those that connections claim; the user must have them.
        """
        self.network = network
        self._rights = rights
        self._channels: set[Channel] = set()
        self._channels_by_connection: dict[str, Channel] = {}
        self._bucket = f"{randbelow(REPLY_BUCKETS):02x}"
        self._lock = Lock()
        self._deferred: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._resources = ExitStack()
        key = keys.replies_to_process(network.robot, network.user, self._bucket)
        handler = zenoh.handlers.Callback(self._on_reply, indirect=False)
        self._resources.callback(network.session.declare_subscriber(key, handler).undeclare)
        network.watch(self._on_presence)
        self._resources.callback(network.unwatch, self._on_presence)
        poller = Thread(target=self._poll, name="colony connections", daemon=True)
        poller.start()
        self._resources.callback(poller.join)
        self._resources.callback(self._deferred.put, None)

    @classmethod
    def on_network(cls, network: ZenohSession) -> Hub:
        """Return a hub on an open network that the caller owns, with the user's rights.

        Raises:
            UnreachableError: the gateway does not admit the user.
        """
        return cls(network, rights=_rights(network))

    @classmethod
    def open(
        cls,
        robot: str,
        *,
        gateway: str | None = None,
        credentials: Credentials | None = None,
        environment: Mapping[str, str] = os.environ,
    ) -> Hub:
        """Open a session with a robot on this machine or behind a gateway (`tls/HOST:PORT`).

        Raises:
            ServerNotFoundError: this machine has no such robot.
            UnreachableError: the gateway cannot be reached, or refuses the login.
            SecurityError: the address is not one for TLS, or the credentials cannot be used.
        """
        robot_address: RobotAddress
        if gateway is None:
            robot_address = local(robot, environment)
            _check_directory(robot_address)
        else:
            if credentials is None:
                raise ValueError(f"no credentials for the gateway {gateway}: give `credentials`")
            parse_endpoint(gateway)
            check_credentials(credentials)
            robot_address = Remote(robot=robot, endpoint=gateway, credentials=credentials)
        with ExitStack() as resources:
            network = resources.enter_context(ZenohSession.open(robot_address))
            hub = cls.on_network(network)
            hub._resources = _nested(hub._resources, resources.pop_all())
            return hub

    def channel(
        self,
        server: str,
        *,
        name: str,
        priority: int,
        notify: Callable[[Notice], None],
        rights: tuple[Right, ...] | None = None,
    ) -> Channel:
        """Return a channel to a server that is not open yet; pass it to `release` at the end.

        Raises:
            TypeError: the name or the priority cannot be sent.
            ForkedError: this process was forked after its session was opened.
        """
        require_threads()
        if not isinstance(name, str):
            raise TypeError(f"the name of a connection is {name!r}; expected text")
        if not isinstance(priority, int):
            raise TypeError(
                f"the priority of a connection is {priority!r}; expected a whole number, such as 50"
            )
        channel = Channel(
            self.network,
            server,
            name=name,
            priority=priority,
            rights=self._rights if rights is None else rights,
            new_id=lambda: f"{self._bucket}-{uuid4().hex[:16]}",
            register=self._register,
            notify=notify,
            defer=self._deferred.put,
        )
        with self._lock:
            self._channels.add(channel)
        return channel

    def release(self, channel: Channel) -> None:
        """Close a channel."""
        if is_forked():
            return
        with self._lock:
            self._channels.discard(channel)
        channel.close()
        with self._lock:
            self._channels_by_connection = {
                connection: c for connection, c in self._channels_by_connection.items() if c is not channel
            }

    def running(self) -> Collection[str]:
        """Return the servers with a process on this machine, even a frozen one; none for a remote robot."""
        robot_address = self.network.robot_address
        return robot_address.directory.running() if isinstance(robot_address, Local) else ()

    def not_found(self, server: str) -> ServerNotFoundError:
        """Return the error for a name under which no server answers, with the likely reason."""
        robot, servers = self.network.robot, self.network.alive()
        if server in servers or server in self.running():
            text = f"{server} of {robot} is up but does not answer: is it busy or frozen?"
        elif servers:
            text = f"{robot} has no {server}: found {', '.join(servers)}"
        else:
            where = _where(self.network.robot_address)
            text = f"no process of {robot} runs {where}: start it with `colony serve`"
        return ServerNotFoundError(text)

    def close(self) -> None:
        """Close all connections and leave the network. Idempotent."""
        if is_forked():
            return
        with self._lock:
            channels, self._channels = self._channels, set()
        for channel in channels:
            channel.close()
        self._resources.close()

    # --- internals -----------------------------------------------------------------------------------

    def _poll(self) -> None:
        """Keep the connections alive, in a thread of its own, whose sends never block."""
        due = time.monotonic() + POLL_INTERVAL_S
        while True:
            try:
                work = self._deferred.get(timeout=max(0.0, due - time.monotonic()))
            except Empty:
                due = time.monotonic() + POLL_INTERVAL_S
                for channel in self._open_channels():
                    channel.poll()
            else:
                if work is None:
                    return
                work()

    def _register(self, channel: Channel, connection: str) -> None:
        with self._lock:
            self._channels_by_connection[connection] = channel

    def _on_reply(self, sample: zenoh.Sample) -> None:
        """Pass a reply or notice to its channel; ignore those for other processes of this user.

        Called in a network thread.
        """
        try:
            message = codec.decode(sample.payload.to_bytes())
        except MessageFormatError:
            return
        if (
            isinstance(message, (Reply, Notice))
            and (channel := self._channels_by_connection.get(message.connection)) is not None
        ):
            channel.receive(message)

    def _on_presence(self, address: str, present: bool) -> None:
        """Handle the appearance or loss of a node, in a network thread."""
        for channel in self._open_channels():
            if channel.server == address:
                self._deferred.put(partial(channel.on_presence, present))

    def _open_channels(self) -> tuple[Channel, ...]:
        with self._lock:
            return tuple(self._channels)


def _rights(network: ZenohSession) -> tuple[Right, ...]:
    """Return this user's rights: all on this machine, elsewhere those that the gateway reports.

    The gateway answers `whoami` under any right that the user has, so every right is tried.
    """
    robot_address = network.robot_address
    if isinstance(robot_address, Local):
        return keys.RIGHTS
    outcomes: SimpleQueue[Outcome] = SimpleQueue()
    hub = Hub(network)
    try:
        channels = [
            hub.channel(GATEWAY, name="login", priority=0, notify=_ignore, rights=(r,)) for r in keys.RIGHTS
        ]
        for channel in channels:
            channel.open(_ignore)
            channel.submit(whoami(), outcomes.put)
        outcome = outcomes.get(timeout=LOGIN_TIMEOUT_S)
    except Empty:
        raise UnreachableError(
            f"{robot_address.endpoint} does not admit {network.user}: the user's name must be that in "
            f"{robot_address.credentials.certificate}, and in the gateway's table of users for "
            f"{robot_address.robot}"
        ) from None
    finally:
        hub.close()
    if isinstance(outcome, RobotConnectionError):
        raise outcome
    return rights(msgspec.msgpack.decode(outcome, type=UserIdentity).may)


def _ignore(anything: object) -> None:
    """Ignore the argument."""


def _nested(inner: ExitStack, outer: ExitStack) -> ExitStack:
    """Return a stack that closes both, the inner one first."""
    outer.push(inner)
    return outer


def _check_directory(robot_address: Local) -> None:
    directory = robot_address.directory
    if directory.path.is_dir():
        return
    robots = ", ".join(_running_robots(directory)) or "none"
    raise ServerNotFoundError(
        f"no robot `{directory.robot}` on this machine: {directory.path} does not exist "
        f"(robots found: {robots}); start it with `colony serve`"
    )


def _running_robots(directory: RobotDirectory) -> tuple[str, ...]:
    """Return this user's robots on this machine that have a running process."""
    parent = RunDirectory(directory.path.parent)
    return tuple(name for name in parent.robots() if RobotDirectory(parent.path / name, name).running())


def _where(robot_address: RobotAddress) -> str:
    match robot_address:
        case Local(directory=directory):
            return f"on this machine (looked in {directory.path})"
        case Remote(endpoint=endpoint):
            return f"behind {endpoint}"
