"""Connections to servers for asyncio programs; they use the same asks as the blocking ones.

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
    NOTICES_KEPT,
    TIMEOUT_S,
    opening_times,
    program_name,
    read_result,
    timed_out,
    waiting_time,
)
from colony.runtime.kit.conversation import Outcome
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.hub import Hub
from colony.runtime.library.ask import Ask
from colony.runtime.protocol.messages import Notice
from colony.runtime.transport.live.place import Credentials

T = TypeVar("T")


class Connection:
    """A channel between this program and one server, for the tasks of one event loop.

    Mutable: the calls on their way. Created by `connect` and `Session.connect`.
    """

    def __init__(self, hub: Hub, server: str, *, name: str, priority: int, timeout_s: float) -> None:
        self.server = server
        self._hub = hub
        self._timeout_s = timeout_s
        self._loop = asyncio.get_running_loop()
        self._notices: asyncio.Queue[Notice] = asyncio.Queue()
        self._wire = hub.wire(server, name=name, priority=priority, notify=self._notify)

    async def do(self, ask: Ask[T], *, timeout_s: float | None = None) -> T:
        """Make a call to the server, and wait for the result.

        Raises:
            CallRefusedError: the server refuses; `code` and message give the reason.
            ConnectionLostError: the server went away in the meantime, and the call must not be repeated
                blindly.
            CallTimeoutError: no answer came in `timeout_s`, by default that of the connection, or of the
                call.
        """
        wait_s = waiting_time(ask, timeout_s, self._timeout_s)
        outcome: asyncio.Future[Outcome] = self._loop.create_future()
        pending = self._wire.submit(ask, lambda came: self._settle(outcome, came))
        try:
            async with asyncio.timeout(wait_s):
                return read_result(self.server, ask, await outcome)
        except TimeoutError:
            raise timed_out(self._wire, ask, wait_s) from None
        finally:
            self._wire.forget(pending)

    async def keep(self, ask: Ask[T]) -> T:
        """Make a call now, and again whenever the connection is reopened: a watch, a subscription."""
        result = await self.do(ask)
        self._wire.keep(ask)
        return result

    async def notices(self) -> AsyncIterator[Notice]:
        """Yield the notices that the server sends because of a `watch` or the like."""
        while True:
            yield await self._notices.get()

    @property
    def openings(self) -> int:
        """The number of times the connection was opened; above 1, its state at the server was lost."""
        return self._wire.openings

    async def open(self) -> None:
        """Open the connection; see `connect`."""
        opened: asyncio.Future[Outcome] = self._loop.create_future()
        self._wire.open(lambda came: self._settle(opened, came))
        for wait_s in opening_times(self._timeout_s):
            done, _ = await asyncio.wait([opened], timeout=wait_s)
            if done:
                outcome = opened.result()
                if isinstance(outcome, RobotConnectionError):
                    raise outcome
                return
            if self.server not in await asyncio.to_thread(self._hub.network.alive):
                break
        raise await asyncio.to_thread(self._hub.not_found, self.server)

    async def close(self) -> None:
        """Close the connection."""
        await asyncio.to_thread(self._hub.release, self._wire)

    def _settle(self, future: asyncio.Future[Outcome], outcome: Outcome) -> None:
        def settle() -> None:
            if not future.done():
                future.set_result(outcome)

        self._soon(settle)

    def _notify(self, notice: Notice) -> None:
        def put() -> None:
            if self._notices.qsize() >= NOTICES_KEPT:
                self._notices.get_nowait()
            self._notices.put_nowait(notice)

        self._soon(put)

    def _soon(self, work: Callable[[], None]) -> None:
        """Run `work` in the event loop, from a network thread; do nothing if the loop has ended."""
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(work)


class Session:
    """A process's session with a robot, which its connections share. Mutable: the connections."""

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
    ) -> AsyncIterator[Session]:
        """Join the processes of a robot, until the end of the `async with`.

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
    ) -> AsyncIterator[Connection]:
        """Connect to a server of the robot until the end of the `async with`; see `connect`."""
        connection = Connection(
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
) -> AsyncIterator[Connection]:
    """Connect to a server of a robot until the end of the `async with`.

    Arguments and errors are those of `connection.connect`.
    """
    opened = Session.open(robot, gateway=gateway, credentials=credentials, environment=environment)
    async with (
        opened as session,
        session.connect(server, name=name, priority=priority, timeout_s=timeout_s) as connection,
    ):
        yield connection
