"""Connections to servers for asyncio programs, with the same calls as the blocking ones.

async with connect("RServer", robot="rome", priority=5) as base:
    await base.do(robot.go(200))
    async for notice in base.notices():
        ...
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from typing import TypeVar

from colony.runtime.kit.connection import (
    MAX_NOTICES,
    TIMEOUT_S,
    answer_timeout,
    opening_timeouts,
    program_name,
    read_result,
    timeout_error,
)
from colony.runtime.kit.conversation import Outcome
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.hub import Hub
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.messages import Notice
from colony.runtime.transport.live.network import require_threads
from colony.runtime.transport.live.robot_address import Credentials

T = TypeVar("T")


class AsyncConnection:
    """A connection between this program and one server, for the tasks of one event loop.

    Mutable. Created by `connect` and `AsyncSession.connect`.
    """

    def __init__(self, hub: Hub, server: str, *, name: str, priority: int, timeout_s: float) -> None:
        self.server = server
        self._hub = hub
        self._timeout_s = timeout_s
        self._loop = asyncio.get_running_loop()
        self._notices: asyncio.Queue[Notice] = asyncio.Queue()
        self._channel = hub.channel(server, name=name, priority=priority, notify=self._notify)

    async def do(self, call: CallRequest[T], *, timeout_s: float | None = None) -> T:
        """Make a call to the server, and wait for the result.

        Raises:
            CallRefusedError: the server refuses; `code` and message give the reason.
            ConnectionLostError: the server went away before it answered, and the call may not be repeated
                automatically.
            CallTimeoutError: no answer came within `timeout_s`, by default that of the connection or call.
        """
        wait_s = answer_timeout(call, timeout_s, self._timeout_s)
        future: asyncio.Future[Outcome] = self._loop.create_future()
        pending = self._channel.submit(call, lambda outcome: self._settle(future, outcome))
        try:
            async with asyncio.timeout(wait_s):
                return read_result(self.server, call, await future)
        except TimeoutError:
            raise timeout_error(self._channel, call, wait_s) from None
        finally:
            self._channel.forget(pending)

    async def keep(self, call: CallRequest[T]) -> T:
        """Make a call, such as a watch, immediately and each time the connection is reopened."""
        result = await self.do(call)
        self._channel.repeat_on_reopen(call)
        return result

    async def notices(self) -> AsyncIterator[Notice]:
        """Yield the notices of the server, which come for a `watch` or another subscription.

        Raises:
            ForkedError: this process was forked after the connection was opened.
        """
        require_threads()
        while True:
            yield await self._notices.get()

    @property
    def openings(self) -> int:
        """The number of times that the connection was opened; if above 1, the server has lost its state."""
        return self._channel.openings

    async def open(self) -> None:
        """Open the connection; see `connect`."""
        opening: asyncio.Future[Outcome] = self._loop.create_future()
        self._channel.open(lambda outcome: self._settle(opening, outcome))
        for wait_s in opening_timeouts(self._timeout_s):
            done, _ = await asyncio.wait([opening], timeout=wait_s)
            if done:
                outcome = opening.result()
                if isinstance(outcome, RobotConnectionError):
                    raise outcome
                return
            if self.server not in await asyncio.to_thread(self._hub.network.alive):
                break
        raise await asyncio.to_thread(self._hub.not_found, self.server)

    async def close(self) -> None:
        """Close the connection."""
        await asyncio.to_thread(self._hub.release, self._channel)

    def _settle(self, future: asyncio.Future[Outcome], outcome: Outcome) -> None:
        def settle() -> None:
            if not future.done():
                future.set_result(outcome)

        self._call_soon(settle)

    def _notify(self, notice: Notice) -> None:
        def put() -> None:
            if self._notices.qsize() >= MAX_NOTICES:
                self._notices.get_nowait()
            self._notices.put_nowait(notice)

        self._call_soon(put)

    def _call_soon(self, work: Callable[[], None]) -> None:
        """Run `work` in the event loop, from a network thread; do nothing if the loop has ended."""
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(work)


class AsyncSession:
    """A process's session with a robot, shared by its connections. Mutable."""

    def __init__(self, hub: Hub) -> None:
        self.hub = hub

    @classmethod
    @asynccontextmanager
    async def open(
        cls,
        robot: str,
        *,
        gateway: str | None = None,
        credentials: Credentials | None = None,
        environment: Mapping[str, str] = os.environ,
    ) -> AsyncIterator[AsyncSession]:
        """Open a session with a robot until the end of the `async with`.

        Raises:
            ServerNotFoundError: this machine has no such robot.
            UnreachableError: the gateway cannot be reached, or refuses the login.
        """
        hub = await asyncio.to_thread(
            Hub.open, robot, gateway=gateway, credentials=credentials, environment=environment
        )
        try:
            yield cls(hub)
        finally:
            await asyncio.to_thread(hub.close)

    @asynccontextmanager
    async def connect(
        self, server: str, *, name: str | None = None, priority: int = 0, timeout_s: float = TIMEOUT_S
    ) -> AsyncIterator[AsyncConnection]:
        """Connect to a server of the robot until the end of the `async with`; see `connect`."""
        connection = AsyncConnection(
            self.hub, server, name=name or program_name(), priority=priority, timeout_s=timeout_s
        )
        try:
            await connection.open()
            yield connection
        finally:
            await connection.close()


@asynccontextmanager
async def connect(
    server: str,
    *,
    robot: str,
    name: str | None = None,
    priority: int = 0,
    timeout_s: float = TIMEOUT_S,
    gateway: str | None = None,
    credentials: Credentials | None = None,
    environment: Mapping[str, str] = os.environ,
) -> AsyncIterator[AsyncConnection]:
    """Connect to a server of a robot until the end of the `async with`.

    Arguments and errors are those of `connection.connect`.
    """
    opening_session = AsyncSession.open(
        robot, gateway=gateway, credentials=credentials, environment=environment
    )
    async with (
        opening_session as session,
        session.connect(server, name=name, priority=priority, timeout_s=timeout_s) as connection,
    ):
        yield connection
