"""The keeper of a robot: it gets the corridor for its robot, and gives it back.

    python examples/two_robots/keeper.py --robot ada

It stands between two data servers. At that of its robot it watches where the robot is, as the behavior tells
it (`Place`), and says whether it may enter (`MayEnter`). At the one that all robots share, that of `fleet`,
are

    Corridor             a semaphore: whose turn it is, first come first served
    Corridor.in.NAME     a variable: robot NAME is in there, or about to be

The semaphore is taken with `hold`: when the keeper dies, the next in line has it within a second. The
variable stays, as a robot that lost its keeper in the corridor stays in there too. Who has the turn sets its
own variable, sees to it that no other one is set, and only then lets its robot in. So two robots are never
let in at once, even if a keeper freezes, wakes up when its turn has long gone to another one, and goes on.

Started again, a keeper goes on where it left off.
"""

from __future__ import annotations

import argparse
import asyncio
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from enum import IntEnum

from colony.runtime.kit.aio import AsyncConnection, AsyncSession
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library import data

FLEET = "fleet"
CORRIDOR = "Corridor"
INSIDE = "Corridor.in."

SILENCE_S = 0.5
"""A robot that tells nothing for so long loses its turn."""

PERMISSION_S = 0.3
"""For how long a permission counts: that of `within` in passage.colony."""

AGAIN_S = 0.3
"""After which time servers are looked for again that were not there."""


class Place(IntEnum):
    """Where the robot is; the numbers are those of the enum in passage.colony."""

    AWAY = 0
    NEAR = 1
    LINE = 2
    INSIDE = 3


class Keeper:
    """Of one robot, by name. Mutable: where the robot was last.

    Args:
        own: a connection to the robot's own DServer.
        fleet: one to the DServer that all robots share.
    """

    def __init__(self, robot: str, own: AsyncConnection, fleet: AsyncConnection) -> None:
        self.robot = robot
        self._own = own
        self._fleet = fleet
        self._mine = INSIDE + robot
        self._place: float | None = None
        self._news = asyncio.Condition()
        self._changes = fleet.notices()

    async def keep(self) -> None:
        """Get the robot through the corridor, again and again."""
        await self._fleet.do(data.create_semaphore(CORRIDOR))
        await self._fleet.keep(data.watch(prefixes=[INSIDE]))
        await asyncio.sleep(PERMISSION_S)  # what a keeper before this one permitted has run out
        await self._own.keep(data.watch("Place"))
        say(f"the keeper of {self.robot} is there")
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._listen())
            await self._until(*Place, patient=True)
            if self._place == Place.INSIDE:
                await self._until(Place.AWAY, patient=True)
            await self._fleet.do(data.set(self._mine, False))
            while True:
                await self._until(Place.NEAR, Place.LINE, patient=True)
                await self._take_turn()

    async def _take_turn(self) -> None:
        await self._fleet.do(data.wait(CORRIDOR, hold=True))
        try:
            say(f"{self.robot} has its turn")
            await self._until(Place.LINE)
            await self._claim()
            say(f"{self.robot} may enter")
            async with self._permitting():
                await self._until(Place.AWAY, patient=True)
            await self._fleet.do(data.set(self._mine, False))
            say(f"{self.robot} is out of the corridor")
        except TimeoutError:
            say(f"{self.robot} is silent: its turn is over")
        finally:
            with suppress(RobotConnectionError):  # not held any more: the connection was lost in between
                await self._fleet.do(data.release(CORRIDOR))

    # --- the robot -----------------------------------------------------------------------------------

    async def _listen(self) -> None:
        async for notice in self._own.notices():
            async with self._news:
                present = data.change(notice).present
                self._place = None if present is None else present.read(float)
                self._news.notify_all()

    async def _until(self, *places: Place, patient: bool = False) -> None:
        """Wait until the robot tells that it is at one of these places.

        Raises:
            TimeoutError: it tells nothing at all; unless one is patient.
        """
        async with self._news:
            while True:
                await asyncio.wait_for(self._news.wait(), None if patient else SILENCE_S)
                if self._place in places:
                    return

    @asynccontextmanager
    async def _permitting(self) -> AsyncIterator[None]:
        """Tell the robot all the time that it may enter."""

        async def permit() -> None:
            while True:
                with suppress(RobotConnectionError):
                    await self._own.do(data.set("MayEnter", True))
                await asyncio.sleep(PERMISSION_S / 3)

        telling = asyncio.create_task(permit())
        try:
            yield
        finally:
            telling.cancel()

    # --- the others ----------------------------------------------------------------------------------

    async def _claim(self) -> None:
        """Be the one that is in the corridor. Who finds another one there takes back that it is, too: were
        both to insist, nobody would ever get in."""
        while True:
            await self._fleet.do(data.set(self._mine, True))
            if not await self._others_inside():
                return
            await self._fleet.do(data.set(self._mine, False))
            while await self._others_inside():
                await anext(self._changes)

    async def _others_inside(self) -> bool:
        names = await self._fleet.do(data.names(INSIDE))
        others = await self._fleet.do(data.get_many(name for name in names if name != self._mine))
        return any(others.values())


def say(text: str) -> None:
    """A line for people."""
    print(text, flush=True)


async def keep(robot: str) -> None:
    """Be the keeper of a robot, as long as the connections last.

    Raises:
        ServerNotFoundError: a server does not run (yet).
        ExceptionGroup: of connections that ended.
    """
    async with (
        AsyncSession.open(robot) as here,
        AsyncSession.open(FLEET) as there,
        here.connect("DServer", name="keeper") as own,
        there.connect("DServer", name=f"keeper of {robot}") as fleet,
    ):
        await Keeper(robot, own, fleet).keep()


async def main() -> None:
    """The entry of the program: it begins anew whenever a connection could not be had, or ended.

    Ctrl-C cancels it, as often as it is pressed: a KeyboardInterrupt in the middle of asyncio's loop could
    leave tasks that never end.
    """
    task = asyncio.current_task()
    assert task is not None
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        asyncio.get_running_loop().add_signal_handler(signal.SIGINT, task.cancel)
    parser = argparse.ArgumentParser(description="The keeper of a robot: it gets the corridor for it.")
    parser.add_argument("--robot", required=True, help="the robot's name")
    robot = parser.parse_args().robot
    said = ""
    while True:
        try:
            await keep(robot)
        except* RobotConnectionError as problems:
            why = str(problems.exceptions[0])
            if why != said:
                say(f"waiting: {why}")
            said = why
        await asyncio.sleep(AGAIN_S)


if __name__ == "__main__":
    with suppress(asyncio.CancelledError):
        asyncio.run(main())
