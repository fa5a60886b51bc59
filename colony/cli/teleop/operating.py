"""An operator at a robot's base: commands while something is held, gives way when it is released.

One call is under way at a time, so that none can overtake a later one on a network that drops messages. Only
giving way waits for nothing: it is sent at once, and once more when a command that was under way is answered.
If this process dies or freezes, the lease of its last command ends.
"""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from shutil import get_terminal_size
from typing import NamedTuple

import click

from colony.cli.teleop.inputs import GamepadInput, Hand, Keyboard
from colony.runtime.arbitration.motion import Speeds
from colony.runtime.kit.aio import AsyncConnection
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library import robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.robot import BaseArbitration
from colony.text.wording import printable

STATUS_INTERVAL_S = 0.25
"""Seconds between two reports of who drives, and between two looks for a gamepad that is gone."""

ANSWER_TIMEOUT_S = 1.0
"""Seconds to wait for the answer to a call."""

PART = 0.5
"""The part of the range of a speed that full deflection asks for, if nothing else is said."""

FAST = 2.0
"""Factor of the speeds while the button or key for fast driving is held."""

NAME = "colony teleop"


def speeds_of(hand: Hand, speed: float | None, turn: float | None, low: Speeds, high: Speeds) -> Speeds:
    """Return the speeds that a hand asks for, within what the base takes.

    Args:
        hand: what it asks for.
        speed: the speed in mm/s that full deflection asks for; None for a part of what the base takes.
        turn: the same of the turn rate, in deg/s.
        low: the least speeds that the base takes.
        high: the greatest ones.
    """

    def fitted(part: float, most: float | None, least: float, greatest: float) -> float:
        most = PART * (greatest if part > 0.0 else -least) if most is None else most
        return min(max(part * most * (FAST if hand.fast else 1.0), least), greatest) + 0.0  # never -0.0

    most = (speed, turn, speed)
    return Speeds(*map(fitted, hand[:3], most, low, high))


class DriverLine(NamedTuple):
    """A line that says who drives: the party, and what changes from one moment to the next."""

    party: str
    details: str = ""


def driver_line(report: BaseArbitration, priority: int, asked: Speeds | None, is_steady: bool) -> DriverLine:
    """Return who drives.

    Args:
        report: the arbitration of the base.
        priority: the operator's.
        asked: the speeds that the operator commands, None if none.
        is_steady: True if these are the same as in the report before, so that they were sent if they could.
    """
    names = {each.connection: each.name for each in report.outside}
    ours = next((each.connection for each in report.outside if each.priority == priority), None)
    if report.stopped is not None:
        by = report.stopped.by
        return DriverLine(f"EMERGENCY STOP, by {by}; release it with `colony stop --release`")
    holder, acting = report.lock_holder, report.acting
    if holder is not None and holder != ours:
        return DriverLine(f"locked by {names.get(holder, holder)}")
    if asked is not None and acting is not None and acting == ours:
        if not is_steady or all(abs(a - b) < 0.5 for a, b in zip(asked, report.sent, strict=True)):
            return DriverLine("you drive", f": {_text(asked)}")
        return DriverLine("you drive, limited", f": {_text(report.sent)} of {_text(asked)}")
    above = "" if asked is None else f", above your priority {priority}"
    if acting is None:
        return DriverLine("nobody drives")
    if acting == ours:  # the frame that was decided before the operator let go
        return DriverLine("you let go")
    return DriverLine(f"{names[acting]} drives{above}" if acting in names else f"`{acting}` drives{above}")


def _text(speeds: Speeds) -> str:
    aside = f", {round(speeds.sideways)} mm/s to the left" if speeds.sideways else ""
    return f"{round(speeds.velocity)} mm/s, {round(speeds.turn)} deg/s{aside}"


class Teleoperation:
    """An operator at the base. Mutable.

    Args:
        base: the connection to RServer.
        source: what the operator holds.
        priority: that of the connection.
        stop: stops the robot in an emergency; it may block.
        lease_s: seconds for which a command holds if it is not repeated.
        speed: the speed in mm/s at full deflection; None for a part of what the base takes.
        turn: the same of the turn rate, in deg/s.
    """

    def __init__(
        self,
        base: AsyncConnection,
        source: GamepadInput | Keyboard,
        priority: int,
        stop: Callable[[], object],
        *,
        lease_s: float,
        speed: float | None = None,
        turn: float | None = None,
    ) -> None:
        self._base, self._source, self._priority, self._lease_s = base, source, priority, lease_s
        self._stop, self._speed, self._turn = stop, speed, turn
        self._changed, self._ended = asyncio.Event(), asyncio.Event()
        self._is_commanding = self._is_busy = False
        self._asked: Speeds | None = None
        self._file: int | None = None
        self._tasks: set[asyncio.Task[object]] = set()
        self._problem = self._printed = ""

    async def run(self) -> None:
        """Operate until `end`, or until the operator quits.

        Raises:
            RobotConnectionError: the base does not answer at the beginning.
            CallRefusedError: the priority is taken, or this user may not command.
        """
        self._report = await self._base.do(robot.arbitration())
        self._listen(self._source.fileno())
        try:
            async with asyncio.TaskGroup() as group:
                parts = [group.create_task(part()) for part in (self._command, self._show)]
                await self._ended.wait()
                for part in parts:
                    part.cancel()
        except ExceptionGroup as failed:
            raise failed.exceptions[0] from None
        finally:
            self._listen(None)
            self._end_line()
            if self._tasks:
                await asyncio.wait(self._tasks)

    def end(self) -> None:
        """End the operation."""
        self._ended.set()

    # --- the hand ------------------------------------------------------------------------------------

    def _listen(self, file: int | None) -> None:
        """Wait for input at this descriptor from now on, if there is any."""
        before, self._file = self._file, file
        if file != before and before is not None:
            asyncio.get_running_loop().remove_reader(before)
        if file != before and file is not None:
            asyncio.get_running_loop().add_reader(file, self._on_input)

    def _on_input(self) -> None:
        now_s = time.monotonic()
        wish = self._source.read(now_s)
        self._listen(self._source.fileno())
        if self._is_commanding and self._is_busy and self._source.hand(now_s) is None:
            self._start(self._do(robot.give_way()))
        if wish == "quit":
            self.end()
        elif wish == "stop":
            self._source.release()
            self._end_line()
            self._start(asyncio.to_thread(self._stop))
        self._changed.set()

    def _start(self, work: Coroutine[object, object, object]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    # --- commands ------------------------------------------------------------------------------------

    async def _command(self) -> None:
        while True:
            self._changed.clear()
            hand, wait_s, self._asked = self._source.hand(time.monotonic()), None, None
            if hand is not None:
                low, high = self._report.low, self._report.high
                self._asked = speeds_of(hand, self._speed, self._turn, low, high)
                velocity, turn, sideways = self._asked
                self._is_commanding = self._is_busy = True
                await self._do(robot.drive(velocity, turn, self._lease_s, sideways=sideways))
                self._is_busy = False
                wait_s = min(self._lease_s / 3.0, self._source.holds_s(time.monotonic()))
            elif self._is_commanding:
                self._is_commanding = not await self._do(robot.give_way())
                wait_s = self._lease_s if self._is_commanding else None
            else:
                self._problem = ""
            with suppress(TimeoutError):
                await asyncio.wait_for(self._changed.wait(), wait_s)

    async def _do(self, call: CallRequest[None]) -> bool:
        """Make a call; return True if it was done.

        Raises:
            CallRefusedError: it would be refused for ever.
        """
        self._problem, code = "", ""
        try:
            await self._base.do(call, timeout_s=ANSWER_TIMEOUT_S)
        except RobotConnectionError as problem:
            self._problem, code = str(problem), getattr(problem, "code", "")
            if code in ("tie", "right"):
                raise
        if code == "stopped":  # the release of the stop must not move the robot
            self._source.release()
        return not self._problem

    # --- who drives ----------------------------------------------------------------------------------

    async def _show(self) -> None:
        before: Speeds | None = None
        while True:
            try:
                self._report = await self._base.do(robot.arbitration(), timeout_s=ANSWER_TIMEOUT_S)
            except RobotConnectionError as problem:
                self._print(DriverLine(str(problem)))
            else:
                asked = self._asked
                self._print(driver_line(self._report, self._priority, asked, asked == before))
                before = asked
            if self._file is None:
                self._on_input()
            await asyncio.sleep(STATUS_INTERVAL_S)

    def _print(self, line: DriverLine) -> None:
        """Print a line: on a terminal over the last one, elsewhere if the party has changed."""
        party = "; ".join(filter(None, (self._source.problem, self._problem, line.party)))
        text = printable(f"{party}{line.details}")
        if sys.stdout.isatty() and self._tasks:
            return  # a stop prints a line of its own
        if sys.stdout.isatty():
            click.echo(f"\r\x1b[K{text[: get_terminal_size().columns - 1]}", nl=False)
        elif party != self._printed:
            click.echo(text)
        self._printed = party

    def _end_line(self) -> None:
        if self._printed and sys.stdout.isatty():
            click.echo()
