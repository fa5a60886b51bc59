"""The Clock's file on disks that are full or read-only: a real disk, real processes, SIGKILL."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library import clock
from colony.runtime.library.clock import Participants
from colony.runtime.protocol.topics import CLOCK
from tests.cli.machine import ROBOT, Machine, Started
from tests.sampling import long
from tests.small_disk import SmallDisk, small_disk
from tests.waiting import until


class Robot:
    """A robot with a Clock and no more, whose state is on a disk of its own. Mutable: which Clock runs."""

    def __init__(self, machine: Machine, disk: SmallDisk) -> None:
        self.machine, self.disk = machine, disk
        machine.environment["XDG_STATE_HOME"] = str(disk.path)
        self.state = disk.seen / "colony" / ROBOT
        self.state.mkdir(parents=True, mode=0o700)

    def start(self) -> Started:
        """Start its Clock, which is ready to be called when it ticks."""
        started = self.machine.start("serve", CLOCK, "--robot", ROBOT, enter=self.disk.inside)
        until(lambda: started.ended() or "listens at" in started.err, "the Clock listens")
        assert not started.ended(), started.err
        until(self.who, "the Clock answers")
        return started

    def kill(self, started: Started) -> None:
        started.tell(signal.SIGKILL)
        started.process.wait()

    def who(self) -> Participants | None:
        try:
            with self.machine.session() as session, session.connect(CLOCK, timeout_s=1.0) as connection:
                return connection.do(clock.participants())
        except RobotConnectionError:
            return None

    def run(self, *arguments: str) -> tuple[int, str]:
        """A command, to its end: the exit code, and all that it printed."""
        done = self.machine.run(*arguments, "--robot", ROBOT)
        return done.wait(), done.out + done.err

    def until_shown(self, text: str) -> None:
        """Wait until `colony ps` has found the Clock, and shows this of it."""
        until(lambda: text in self.run("ps")[1], f"`colony ps` shows {text}")


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    machine = Machine(tmp_path)
    with small_disk(tmp_path / "disk", "64k") as disk:
        yield Robot(machine, disk)
        machine.close()


@pytest.mark.long
def test_a_stop_is_kept_on_a_disk_that_became_full(robot: Robot) -> None:
    first = robot.start()
    robot.disk.fill()
    code, said = robot.run("stop")
    assert code == 0, said
    robot.kill(first)
    second = robot.start()
    robot.until_shown("EMERGENCY STOP, by ")
    assert robot.run("stop", "--release")[0] == 0
    robot.kill(second)
    robot.start()
    found = robot.who()
    assert (found.stopped, found.trouble) == (None, None)


@pytest.mark.long
def test_a_clock_that_has_no_room_for_a_stop_says_so_and_keeps_trying(robot: Robot) -> None:
    robot.disk.fill()
    first = robot.start()
    trouble = f"{robot.disk.path}/colony/{ROBOT}/Clock.stop: No space left on device"
    assert first.err.splitlines().count(f"an emergency stop cannot be saved: {trouble}") == 1
    assert not (robot.state / "Clock.stop").exists(), "half a file would stop the next Clock"
    robot.until_shown(f"trouble: {trouble}")
    code, said = robot.run("stop")
    assert code == 1
    assert "stopped, but a restart of the Clock may lose the stop: " in said
    found = robot.who()
    assert found.stopped is not None, "the robot is stopped all the same"
    robot.disk.clear()
    until(lambda: (w := robot.who()) and w.trouble is None, "the stop is kept")
    robot.kill(first)
    robot.start()
    again = robot.who()
    assert again.stopped == found.stopped


@pytest.mark.parametrize("has_file", [False, long(True)], ids=["no file", "a file"])
def test_a_stop_on_a_disk_that_may_only_be_read_is_refused_as_not_kept(robot: Robot, has_file: bool) -> None:
    if has_file:
        robot.kill(robot.start())
    robot.disk.remount("ro")
    started = robot.start()
    assert "an emergency stop cannot be saved: " in started.err
    before = robot.who()
    assert before.stopped is None, "what the file says is known"
    code, said = robot.run("stop")
    assert code == 1
    assert "Read-only file system" in said
    robot.until_shown("EMERGENCY STOP, by ")
    robot.until_shown("Clock.stop: Read-only file system")
    assert not started.ended()
