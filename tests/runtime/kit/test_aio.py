"""Connections that await answers; they do the same asks."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Mapping
from typing import Any

import msgspec
import pytest

from colony.runtime.kit import aio
from colony.runtime.kit.errors import (
    CallRefusedError,
    CallTimeoutError,
    ConnectionLostError,
    ServerNotFoundError,
)
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import NoArguments
from tests.runtime.kit.stage import BATTERY, battery_thread, charge, level, plain
from tests.runtime.kit.test_connection import _Telling
from tests.runtime.transport.live.stage import ROBOT, hosted


def _run(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, 60))


def test_many_calls_at_once(environment: Mapping[str, str]) -> None:
    async def work() -> None:
        async with aio.connect(BATTERY, robot=ROBOT, environment=environment) as battery:
            levels = await asyncio.gather(*(battery.do(level()) for _ in range(50)))
            assert levels == [0.5] * 50
            with pytest.raises(CallRefusedError, match="expected 0 or more"):
                await battery.do(charge(-1.0))

    with battery_thread(environment):
        _run(work())


def test_an_answer_that_does_not_come_in_time(environment: Mapping[str, str]) -> None:
    with battery_thread(environment) as server:

        async def work() -> None:
            async with aio.connect(BATTERY, robot=ROBOT, environment=environment) as battery:
                server.wait.clear()
                with pytest.raises(CallTimeoutError, match="did not answer `wait`"):
                    await battery.do(plain("wait"), timeout_s=0.05)
                waiting = asyncio.create_task(battery.do(plain("wait")))
                await asyncio.sleep(0)
                waiting.cancel()
                server.wait.set()
                assert await battery.do(level()) == 0.5

        _run(work())


def test_nobody_there(environment: Mapping[str, str]) -> None:
    async def work() -> None:
        with pytest.raises(ServerNotFoundError, match="no robot `siena`"):
            async with aio.connect(BATTERY, robot="siena", environment=environment):
                pass
        async with aio.AsyncSession.open(ROBOT, environment=environment) as session:
            with pytest.raises(ServerNotFoundError, match="rome has no Radio"):
                async with session.connect("Radio", timeout_s=0.2):
                    pass

    with battery_thread(environment):
        _run(work())


def test_notices(environment: Mapping[str, str]) -> None:
    async def work() -> None:
        async with aio.connect("Telling", robot=ROBOT, environment=environment) as connection:
            await connection.keep(CallRequest("watch", NoArguments(), None, "read"))
            came: list[object] = []
            async for notice in connection.notices():
                came.append(msgspec.msgpack.decode(notice.body))
                if len(came) == 3:
                    break
            assert came == [0, 1, 2]

    with hosted(environment, [_Telling()]):
        _run(work())


def test_closing_ends_what_is_awaited(environment: Mapping[str, str]) -> None:
    with battery_thread(environment) as server:

        async def work() -> None:
            server.wait.clear()
            async with aio.connect(BATTERY, robot=ROBOT, environment=environment) as battery:
                waiting = asyncio.create_task(battery.do(plain("wait")))
                await asyncio.sleep(0)
            with pytest.raises(ConnectionLostError, match="was closed before the answer"):
                await waiting
            server.wait.set()

        _run(work())
