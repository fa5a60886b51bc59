"""An operator at a base that is served in this process: when it commands, and when it gives way."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping
from pathlib import Path

import pytest

from colony.cli.teleop.inputs import GamepadInput, Hand
from colony.cli.teleop.operating import (
    NAME,
    DriverLine,
    Teleoperation,
    driver_line,
    speeds_of,
)
from colony.drivers.gamepad import Gamepad
from colony.runtime.arbitration.motion import Speeds
from colony.runtime.frames.clock import Clock
from colony.runtime.kit.aio import AsyncSession
from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.emergency import StopButton
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.library import robot
from colony.runtime.library.clock import release
from colony.runtime.library.robot import BaseArbitration, BaseOutsideReport
from colony.runtime.protocol.messages import Stopped
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.rserver import RServer
from tests.cli.teleop.test_inputs import LAYOUT
from tests.kit.base import RollingBase
from tests.kit.gamepad import Pad, pad
from tests.runtime.transport.live.stage import ROBOT, hosted, run_directory
from tests.waiting import PATIENCE_S

LOW, HIGH = Speeds(-300.0, -60.0), Speeds(500.0, 60.0)
OURS, THEIRS = "root/1", "root/2"


# --- speeds ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hand", "full", "found"),
    [
        (Hand(1.0, 1.0, 0.0), (None, None), (250.0, 30.0, 0.0)),
        (Hand(-1.0, -0.5, 0.0), (None, None), (-150.0, -15.0, 0.0)),
        (Hand(1.0, 0.0, 0.0, fast=True), (None, None), (500.0, 0.0, 0.0)),
        (Hand(0.5, 1.0, 0.0), (400.0, 45.0), (200.0, 45.0, 0.0)),
        (Hand(-1.0, 1.0, 1.0), (400.0, 90.0), (-300.0, 60.0, 0.0)),
    ],
)
def test_speeds_are_within_what_the_base_takes(
    hand: Hand, full: tuple[float | None, float | None], found: tuple[float, ...]
) -> None:
    assert speeds_of(hand, *full, LOW, HIGH) == found


def test_a_base_that_drives_sideways_does_so_at_its_own_speed() -> None:
    low, high = LOW._replace(sideways=-100.0), HIGH._replace(sideways=100.0)
    assert speeds_of(Hand(0.0, 0.0, -1.0), None, None, low, high) == (0.0, 0.0, -50.0)
    assert speeds_of(Hand(0.0, 0.0, 1.0), 400.0, None, low, high) == (0.0, 0.0, 100.0)


# --- who drives ------------------------------------------------------------------------------------------


def report(acting: str | None, **changes: object) -> BaseArbitration:
    parties = ((OURS, NAME, 50), (THEIRS, "script", 60))
    outside = tuple(
        BaseOutsideReport(connection=connection, name=name, priority=priority, commands=None, lease_s=None)
        for connection, name, priority in parties
    )
    known: dict[str, object] = {
        "run": "r",
        "leader": None,
        "acting": acting,
        "actuators": (),
        "outside": outside,
        "lock_holder": None,
        "lock_waiting": (),
        "stopped": None,
        "sent": Speeds(120.0, 0.0),
        "low": LOW,
        "high": HIGH,
    }
    return BaseArbitration(**(known | changes))  # type: ignore[arg-type]


ASKED = Speeds(250.0, -0.0)


@pytest.mark.parametrize(
    ("found", "asked", "steady", "line"),
    [
        (report(None), None, True, ("nobody drives", "")),
        (report("cruise"), None, True, ("`cruise` drives", "")),
        (report("cruise"), ASKED, True, ("`cruise` drives, above your priority 50", "")),
        (report(THEIRS), ASKED, True, ("script drives, above your priority 50", "")),
        (report(OURS), None, True, ("you let go", "")),
        (report(OURS), ASKED, False, ("you drive", ": 250 mm/s, 0 deg/s")),
        (report(OURS, sent=ASKED), ASKED, True, ("you drive", ": 250 mm/s, 0 deg/s")),
        (
            report(OURS),
            ASKED._replace(sideways=-20.0),
            True,
            ("you drive, limited", ": 120 mm/s, 0 deg/s of 250 mm/s, 0 deg/s, -20 mm/s to the left"),
        ),
        (report(None, lock_holder=THEIRS), ASKED, True, ("locked by script", "")),
        (report(OURS, lock_holder=OURS, sent=ASKED), ASKED, True, ("you drive", ": 250 mm/s, 0 deg/s")),
        (
            report(None, stopped=Stopped(by="ada/1", t_ns=0)),
            ASKED,
            True,
            ("EMERGENCY STOP, by ada/1; release it with `colony stop --release`", ""),
        ),
    ],
)
def test_the_line_says_who_drives(
    found: BaseArbitration, asked: Speeds | None, steady: bool, line: tuple[str, str]
) -> None:
    assert driver_line(found, 50, asked, steady) == DriverLine(*line)


# --- at a base -------------------------------------------------------------------------------------------

OTHER = 111.0
"""The speed that another party, below the operator, commands all the time."""


class Stage:
    """A base that is served, another party that drives it, and a gamepad. Mutable."""

    def __init__(self, session: Session, other: Connection, base: RollingBase, pad: Pad) -> None:
        self.session, self.other, self.base, self.pad = session, other, base, pad
        self.stops = 0

    def stop(self) -> None:
        self.stops += 1
        with StopButton(self.session) as button:
            assert button.press().acknowledged

    def commanding(self) -> list[str]:
        """Return the names of those that command, whether they are let or not."""
        found = self.other.do(robot.arbitration())
        return [each.name for each in found.outside if each.commands is not None]

    async def drives(self, velocity: float, count: int = 3) -> None:
        """Wait until the base gets this velocity in so many frames in a row, from now on."""
        since = len(self.base.told)

        def velocities() -> list[float]:
            return [round(told[1]) for told in self.base.told[since:]]

        await reached(lambda: velocities()[-count:] == [velocity] * count, lambda: f"{velocities()[-20:]}")

    def operate(
        self, script: Callable[[], Awaitable[None]], *, priority: int = 50, lease_s: float = 60.0
    ) -> None:
        """Run an operator, whose lease does not end by itself, beside a script of what its hand does."""
        device = Gamepad(str(self.pad.path))
        source = GamepadInput(device, LAYOUT)
        source.read(time.monotonic())

        async def main() -> None:
            session = AsyncSession(self.session.hub)
            async with session.connect("RServer", name=NAME, priority=priority) as base:
                operation = Teleoperation(base, source, priority, self.stop, lease_s=lease_s, speed=400.0)
                running = asyncio.create_task(operation.run())
                done, _ = await asyncio.wait(
                    {running, asyncio.ensure_future(script())}, return_when=asyncio.FIRST_COMPLETED
                )
                operation.end()
                await running
                for each in done:
                    each.result()

        asyncio.run(main())
        device.close()


async def reached(condition: Callable[[], object], what: Callable[[], str]) -> None:
    async def wait() -> None:
        while not condition():
            await asyncio.sleep(0.002)

    try:
        await asyncio.wait_for(wait(), PATIENCE_S)
    except TimeoutError:
        raise AssertionError(what()) from None


@pytest.fixture(scope="module")
def environment() -> Iterator[Mapping[str, str]]:
    with run_directory() as made:
        yield made


@pytest.fixture
def stage(environment: Mapping[str, str], tmp_path: Path) -> Iterator[Stage]:
    base = RollingBase()
    nodes = [Clock(servers=("RServer",)), DServer(), RServer(base)]
    with (
        hosted(environment, nodes),
        Session.open(ROBOT, environment=environment) as session,
        session.connect("RServer", name="other", priority=5) as other,
        pad(tmp_path) as made,
    ):
        other.do(robot.drive(OTHER, 0.0, lease=60.0))
        yield Stage(session, other, base, made)


def test_the_operator_drives_while_the_deadman_is_held_and_nothing_is_sent_in_between(stage: Stage) -> None:
    async def script() -> None:
        await stage.drives(OTHER)
        since = len(stage.base.told)
        stage.pad.move(y=-1.0)
        stage.pad.press("tl")
        await stage.drives(400.0)
        stage.pad.move(y=1.0)
        await stage.drives(-400.0)
        stage.pad.release("tl")
        await stage.drives(OTHER)
        sent = [round(told[1]) for told in stage.base.told[since:]]
        assert set(sent) == {OTHER, 400.0, -400.0}
        changes = [b for a, b in zip([None, *sent], sent, strict=False) if a != b]
        assert changes[-3:] == [400.0, -400.0, OTHER]

    stage.operate(script)


def test_a_gamepad_that_is_unplugged_gives_way(stage: Stage, capsys: pytest.CaptureFixture[str]) -> None:
    said = ""

    async def script() -> None:
        nonlocal said
        stage.pad.move(y=-1.0)
        stage.pad.press("tl")
        await stage.drives(400.0)
        stage.pad.unplug()
        await stage.drives(OTHER)

        def printed() -> str:
            nonlocal said
            said += capsys.readouterr().out
            return said

        await reached(lambda: "the gamepad is gone: No such device; other drives" in printed(), printed)
        stage.pad.plug()
        await reached(lambda: printed().endswith("\nother drives\n"), printed)
        stage.pad.press("tl")
        await stage.drives(0.0)

    stage.operate(script)


def test_a_command_is_renewed_before_its_lease_ends(stage: Stage) -> None:
    async def script() -> None:
        stage.pad.move(y=-1.0)
        stage.pad.press("tl")
        await stage.drives(400.0, count=30)  # five leases

    stage.operate(script, lease_s=0.3)


def test_below_others_the_operator_drives_when_they_let_it(stage: Stage) -> None:
    async def script() -> None:
        stage.pad.move(y=-1.0)
        stage.pad.press("tl")
        await reached(lambda: NAME in stage.commanding(), lambda: "the operator commands")
        since = len(stage.base.told)
        await stage.drives(OTHER)
        assert {told[1] for told in stage.base.told[since:]} == {OTHER}
        await asyncio.to_thread(stage.other.do, robot.give_way())
        await stage.drives(400.0)

    stage.operate(script, priority=4)


def test_a_priority_that_is_taken_ends_the_operation(stage: Stage) -> None:
    async def script() -> None:
        stage.pad.press("tl")
        await asyncio.sleep(PATIENCE_S)

    with pytest.raises(CallRefusedError, match="priority 5 is taken: other"):
        stage.operate(script, priority=5)


def test_after_an_emergency_stop_the_deadman_is_to_be_pressed_again(stage: Stage) -> None:
    async def script() -> None:
        stage.pad.move(y=-1.0)
        stage.pad.press("tl")
        await stage.drives(400.0)
        stage.pad.press("east")
        await reached(lambda: stage.stops == 1 and stage.base.velocity == 0.0, lambda: "it stands")
        with stage.session.connect("Clock") as clock, stage.session.connect("RServer") as base:
            await asyncio.to_thread(clock.do, release())
            await reached(lambda: base.do(robot.arbitration()).stopped is None, lambda: "released")
        stage.pad.move(y=-0.9)
        since = len(stage.base.told)
        await reached(lambda: len(stage.base.told) > since + 3, lambda: "frames pass")
        assert {told[1] for told in stage.base.told[since:]} == {0.0}
        stage.pad.release("tl")
        stage.pad.press("tl")
        await reached(lambda: stage.base.velocity > 300.0, lambda: "it drives again")

    stage.operate(script)
