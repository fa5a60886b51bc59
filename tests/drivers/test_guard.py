"""The guard on a pseudoterminal: the base stops when what drives it dies, stands still, or loses its line."""

from __future__ import annotations

import fcntl
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import takewhile
from pathlib import Path

import pytest

from colony.drivers import guarded
from colony.drivers import line as line_module
from colony.drivers.dialect import Readings
from colony.drivers.guarded import (
    GuardConnection,
    GuardedCommand,
    GuardError,
    PortLost,
    SendOutcome,
    Up,
    connect,
)
from colony.drivers.link import LinkError
from colony.drivers.serial_base import SerialBase, SerialFields
from colony.runtime.transport.live.run_directory import RunDirectory
from tests.drivers.tiny import GOODBYE, HELLO, JAW, SPEEDS, Tiny, base, battery, encoded, gripper
from tests.drivers.tiny_robot import TinyRobot
from tests.paths import ROOT
from tests.waiting import until

PATIENCE_S = 30.0
"""Seconds after which a loaded machine counts as broken."""

DRIVER = """
import sys, time
from tests.drivers.tiny import base
driver = base(sys.argv[1])
while True:
    try:
        driver.drive(300.0, 0.0)
    except OSError:
        pass
    time.sleep(0.02)
"""

FAILING = """
import sys
from colony.drivers.guard import Guard
from colony.drivers.guard import claimed
guard = Guard(claimed(sys.argv[1]), sys.argv[2], 0, bytes.fromhex(sys.argv[3]))
guard._due_ns = lambda: 1 // 0
guard.run()
"""


STOP = Tiny.stop_bytes[2:-1]
"""The data of the frame that stops."""


class Apart(Tiny):
    """A dialect like the other, as in another process: of another class, it has a line of its own."""


def wait_for(condition: Callable[[], object]) -> None:
    """Wait until something holds."""
    until(condition, "the guard and its drivers", patience_s=PATIENCE_S)


def guard_socket(robot: TinyRobot) -> Path:
    return RunDirectory.find(os.environ).guard(robot.port)


def guard_pid(robot: TinyRobot) -> int:
    path = Path(f"{guard_socket(robot)}.lock")
    wait_for(path.read_text)  # it has just begun
    return int(path.read_text())


def guard_runs(robot: TinyRobot) -> bool:
    lock = Path(f"{guard_socket(robot)}.lock")
    if not lock.exists():
        return False
    with lock.open() as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def await_successor(robot: TinyRobot, first: int) -> None:
    """Wait until another guard runs than the first."""
    wait_for(lambda: guard_runs(robot) and guard_pid(robot) != first)


def replace_guard(robot: TinyRobot) -> None:
    """Kill the guard, and wait for its successor."""
    first = guard_pid(robot)
    os.kill(first, signal.SIGKILL)
    await_successor(robot, first)


def await_up(connection: GuardConnection) -> None:
    """Wait until the line is up."""
    while not isinstance(connection.receive(PATIENCE_S), Up):
        pass


def await_refusal(connection: GuardConnection) -> str:
    """Wait until the guard refuses a connection; return why."""
    while True:
        try:
            connection.receive(PATIENCE_S)
        except LinkError as refusal:
            return str(refusal)


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[TinyRobot]:
    robot = TinyRobot(tmp_path / "port")
    yield robot
    if guard_runs(robot):
        os.kill(guard_pid(robot), signal.SIGTERM)
        os.kill(guard_pid(robot), signal.SIGCONT)
        wait_for(lambda: not guard_runs(robot))
    robot.close()
    own = [process for process in guarded._guards if robot.port in list(process.args)]
    for process in own:
        process.wait(PATIENCE_S)
        guarded._guards.remove(process)
    for path in guard_socket(robot).parent.glob(f"{guard_socket(robot).name}*"):
        path.unlink()


@pytest.fixture
def driving(robot: TinyRobot) -> Iterator[subprocess.Popen[bytes]]:
    """A process that drives the robot."""
    command = [sys.executable, "-c", DRIVER, robot.port]
    process = subprocess.Popen(command, start_new_session=True, cwd=ROOT)
    try:
        wait_for(lambda: robot.speeds == (300, 0))
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def reports() -> list[str]:
    """What the driver of the base reports."""
    return []


@pytest.fixture
def driver(robot: TinyRobot, reports: list[str]) -> Iterator[SerialBase[bytes]]:
    """The driver of the base, once it has the state of it."""
    with closing(SerialBase(Tiny(), robot.port, report=reports.append)) as driver:
        wait_for(driver.state)
        yield driver


def stopped_after(robot: TinyRobot) -> float:
    """Return the seconds from the last command until the stop."""
    wait_for(lambda: robot.speeds == (0, 0))
    moved = [t for data, t in robot.heard if data[0] == SPEEDS and any(data[1:])]
    return next(t for data, t in robot.heard if t > moved[-1] and data == STOP) - moved[-1]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_base_stops_when_its_driver_does(
    robot: TinyRobot, driving: subprocess.Popen[bytes], number: signal.Signals
) -> None:
    os.killpg(driving.pid, number)  # the guard is in no group of it
    after_s = stopped_after(robot)
    assert after_s < 5.0
    if number == signal.SIGSTOP:
        assert after_s > 0.1  # the deadline, less the way to the robot
    wait_for(lambda: sum(data == STOP for data, _ in robot.heard[-8:]) > 1)  # repeated


def test_a_driver_that_goes_on_after_a_pause_drives_again(
    robot: TinyRobot, driving: subprocess.Popen[bytes]
) -> None:
    driving.send_signal(signal.SIGSTOP)
    stopped_after(robot)
    driving.send_signal(signal.SIGCONT)
    wait_for(lambda: robot.speeds == (300, 0))


def test_a_killed_guard_has_a_successor(robot: TinyRobot, driving: subprocess.Popen[bytes]) -> None:
    replace_guard(robot)
    robot.speeds = (0, 0)
    wait_for(lambda: robot.speeds == (300, 0))


def test_each_successor_of_a_killed_guard_is_started_at_once(
    robot: TinyRobot, driver: SerialBase[bytes], reports: list[str]
) -> None:
    pauses: list[float] = []
    driver._line._closed.wait = lambda s: bool(pauses.append(s))  # type: ignore[method-assign]
    for _ in range(5):
        replace_guard(robot)
        wait_for(driver.state)
    assert len(pauses) >= 5
    assert max(pauses) < 0.5  # pauses that double would be 1.6 s long by now
    assert reports[0] == f"the guard of {robot.port} has ended"


def test_guards_that_end_before_they_said_anything_have_successors_without_growing_pauses(
    robot: TinyRobot, driver: SerialBase[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[float] = []
    with monkeypatch.context() as patched:
        patched.setattr(driver._line._closed, "wait", lambda s: bool(pauses.append(s)))
        patched.setattr(line_module, "connect", lambda *_: _EndedGuard())
        os.kill(guard_pid(robot), signal.SIGKILL)
        wait_for(lambda: len(pauses) > 5)
    assert set(pauses[1:]) == {line_module.SUCCESSOR_PAUSE_S}
    wait_for(driver.state)


class _EndedGuard:
    """A connection to a guard that was killed as soon as it was accepted."""

    def receive(self, timeout_s: float) -> None:
        raise GuardError("it has ended")

    def close(self) -> None: ...


def test_another_guard_is_started_as_soon_as_the_first_has_ended(
    robot: TinyRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    reports: list[str] = []
    start, paths = guarded._start, list[Path]()

    def end_or_start(path: Path, port: str, baud: int, stop: bytes) -> subprocess.Popen[bytes]:
        paths.append(path)
        return subprocess.Popen(["true"]) if len(paths) == 1 else start(path, port, baud, stop)

    monkeypatch.setattr(guarded, "_start", end_or_start)
    monkeypatch.setattr(guarded, "START_AGAIN_S", 2 * guarded.START_S)
    with closing(SerialBase(Tiny(), robot.port, report=reports.append)) as driver:
        wait_for(driver.state)
        assert not reports


def test_a_stop_is_reached_once_it_is_on_the_wire(robot: TinyRobot, driver: SerialBase[bytes]) -> None:
    driver.drive(100.0, 0.0)
    wait_for(lambda: robot.speeds == (100, 0))
    driver.stop()
    wait_for(lambda: driver.unreached is None)
    wait_for(lambda: robot.speeds == (0, 0))
    robot.pull_out()
    wait_for(lambda: "there is no port" in (driver.problem or ""))
    driver.stop()
    wait_for(lambda: "there is no port" in (driver.unreached or ""))
    robot.plug_in()
    wait_for(lambda: driver.unreached is None)


@pytest.mark.parametrize("is_stopped", [True, False])
def test_a_frozen_guard_is_killed_and_its_successor_stops_the_base(
    robot: TinyRobot, driver: SerialBase[bytes], reports: list[str], is_stopped: bool
) -> None:
    driver.drive(100.0, 0.0)
    wait_for(lambda: robot.speeds == (100, 0))
    first = guard_pid(robot)
    os.kill(first, signal.SIGSTOP)
    if is_stopped:
        driver.stop()
        assert driver.unreached
    await_successor(robot, first)
    wait_for(lambda: robot.speeds == (0, 0))
    wait_for(driver.state)
    assert driver.unreached is None
    assert reports[0] == f"the guard of {robot.port} did not answer, and was killed"


def test_the_successor_of_a_killed_guard_stops_the_base_for_one_that_only_listens(
    robot: TinyRobot, driving: subprocess.Popen[bytes]
) -> None:
    with closing(battery(robot.port)) as listener:
        wait_for(lambda: listener.fields()["level"])
        driving.send_signal(signal.SIGSTOP)  # it starts no other
        replace_guard(robot)
        stopped_after(robot)


def test_a_guard_that_is_ended_stops_the_base_and_the_session(
    robot: TinyRobot, driving: subprocess.Popen[bytes]
) -> None:
    driving.send_signal(signal.SIGSTOP)
    os.kill(guard_pid(robot), signal.SIGTERM)
    wait_for(lambda: not guard_runs(robot))
    stopped_after(robot)
    wait_for(lambda: robot.count(GOODBYE))


def test_a_guard_whose_log_cannot_be_written_stops_the_base_and_lets_it_drive(robot: TinyRobot) -> None:
    Path(f"{guard_socket(robot)}.log").symlink_to("/dev/full")
    with closing(base(robot.port)) as driver:
        wait_for(driver.state)
        assert robot.heard[0][0] == STOP
        robot.pull_out()
        wait_for(lambda: "there is no port" in (driver.problem or ""))
        robot.heard.clear()
        robot.plug_in()
        wait_for(driver.state)
        assert robot.heard[0][0] == STOP


def test_a_guard_that_fails_stops_the_base_first(robot: TinyRobot) -> None:
    arguments = [os.fspath(guard_socket(robot)), robot.port, Tiny.stop_bytes.hex()]
    ran = subprocess.run([sys.executable, "-c", FAILING, *arguments], capture_output=True, text=True)
    assert "ZeroDivisionError" in ran.stderr
    wait_for(lambda: robot.count(SPEEDS) > 2)  # the first was sent when the port was opened


def test_a_guard_without_drivers_ends(robot: TinyRobot, driver: SerialBase[bytes]) -> None:
    driver.close()
    wait_for(lambda: not guard_runs(robot))
    wait_for(lambda: robot.count(GOODBYE) == 1)


def test_two_drivers_have_one_guard(robot: TinyRobot) -> None:
    with closing(battery(robot.port)) as listener, closing(base(robot.port)) as driver:
        reading = until(lambda: listener.fields()["level"], "a reading", patience_s=PATIENCE_S)
        wait_for(driver.state)
        assert reading.value == 12.4
        assert reading.age_ns >= Tiny.delay_ns
        assert listener.problem is driver.problem is None
        driver.drive(100.0, 20.0)
        wait_for(lambda: robot.speeds == (100, 20))
        driver.stop()
        wait_for(lambda: robot.speeds == (0, 0))
        with pytest.raises(ValueError, match="700, 0 mm/s; at most 600"):
            driver.drive(700.0, 0.0)


def test_drivers_of_one_dialect_share_a_line_until_the_last_is_closed(robot: TinyRobot) -> None:
    port = robot.port
    apart = SerialFields(Apart(), port, {"level": "volts"})
    driver, *others = base(port), battery(port), battery(port), apart
    try:
        assert [other._line is driver._line for other in others] == [True, True, False]
        wait_for(lambda: all(other.fields()["level"] for other in others))
        driver.close()
        others[1].close()
        level = others[0].fields()["level"]
        later_ns = time.monotonic_ns() - level.age_ns + 10_000_000
        wait_for(
            lambda: (newer := others[0].fields()["level"]) and time.monotonic_ns() - newer.age_ns > later_ns
        )
        others[0].close()
        assert battery(port)._line is not driver._line
    finally:
        for line in list(line_module._lines.values()):
            line.drivers = 1
            line.close()


def test_each_channel_is_stopped_by_its_own_deadline_and_all_when_the_driver_ends(robot: TinyRobot) -> None:
    patient = GuardedCommand(stop=Tiny.stop_bytes, goodbye=Tiny.goodbye, deadline_ns=600_000_000_000)
    hasty = GuardedCommand(stop=Tiny.jaw_stop, goodbye=Tiny.goodbye, deadline_ns=150_000_000)
    connection, dialect = connect(robot.port, 0, b"", patient, hasty), Tiny()

    def jaw_closes() -> bool:
        connection.decide(dialect.jaw(5.0), time.monotonic_ns(), 1)
        return robot.jaw == 5

    try:
        await_up(connection)
        connection.decide(dialect.drive(200.0, 0.0), time.monotonic_ns())
        wait_for(lambda: robot.speeds == (200, 0))
        wait_for(jaw_closes)
        wait_for(lambda: robot.jaw == 0)
        connection.ask_sent(7, 1, stops=True)
        while (event := connection.receive(PATIENCE_S)) != SendOutcome(7, ""):
            assert not isinstance(event, SendOutcome)
        assert robot.speeds == (200, 0)
        connection.ask_sent(8, 9, stops=True)  # there is no such channel
        wait_for(jaw_closes)
    finally:
        connection.close()
    wait_for(lambda: robot.speeds == (0, 0) and robot.jaw == 0)
    wait_for(lambda: not guard_runs(robot))
    wait_for(lambda: robot.count(GOODBYE) == 1)


def test_a_base_and_a_gripper_command_over_one_line(robot: TinyRobot) -> None:
    port = robot.port
    jaw, driver = gripper(port), base(port)
    drivers: list[SerialBase[bytes] | SerialFields[bytes]] = [jaw, driver]

    def both_move() -> bool:
        driver.drive(100.0, 0.0)
        jaw.command("jaw", {"speed": 5.0})
        return robot.speeds == (100, 0) and robot.jaw == 5

    try:
        assert jaw._line is driver._line
        wait_for(lambda: driver.state() and driver._line._greeted == 2)
        wait_for(both_move)
        wait_for(lambda: jaw.unreached is None)
        drivers += [base(port), gripper(port)]
        refusal = f"another driver commands {port} already; end it first"
        for second in drivers[2:]:
            wait_for(lambda second=second: second.problem == refusal)
            second.close()
        jaw.safe()
        wait_for(lambda: jaw.unreached is None)
        wait_for(lambda: robot.jaw == 0)
        robot.heard.clear()
        replace_guard(robot)
        wait_for(lambda: robot.count(HELLO))
        assert _first(robot) == {SPEEDS, JAW}
        robot.pull_out()
        wait_for(lambda: "there is no port" in (jaw.problem or ""))
        jaw.safe()
        wait_for(lambda: "there is no port" in (jaw.unreached or ""))
        assert driver.unreached is None
        robot.heard.clear()
        robot.plug_in()
        wait_for(lambda: driver.state() and jaw.unreached is None)
        assert _first(robot) == {SPEEDS, JAW}
        with pytest.raises(ValueError, match="the device has no command `lift`"):
            jaw.command("lift", {})
    finally:
        for each in drivers:
            each.close()


def _first(robot: TinyRobot) -> set[int]:
    """What the robot heard before anything else than stops, of which each may be repeated."""
    return {data[0] for data, _ in takewhile(lambda heard: heard[0][0] in (SPEEDS, JAW), [*robot.heard])}


def test_one_driver_alone_commands(robot: TinyRobot) -> None:
    command = GuardedCommand(stop=b"", goodbye=b"", deadline_ns=150_000_000)
    first = connect(robot.port, 0, b"", command)
    os.kill(guard_pid(robot), signal.SIGSTOP)
    second = connect(robot.port, 0, b"", command)
    second.ask_sent(1, stops=True)  # the guard refuses before it has read this, which would lose what it said
    os.kill(guard_pid(robot), signal.SIGCONT)
    try:
        assert await_refusal(second) == f"another driver commands {robot.port} already; end it first"
    finally:
        first.close()
        second.close()


def test_a_second_driver_says_that_another_one_commands(robot: TinyRobot, driver: SerialBase[bytes]) -> None:
    reports: list[str] = []
    with closing(SerialBase(Tiny(), robot.port, report=reports.append)) as second:
        wait_for(lambda: second.problem)
        assert reports == [f"another driver commands {robot.port} already; end it first"]


def test_a_pulled_cable(robot: TinyRobot, driver: SerialBase[bytes]) -> None:
    robot.pull_out()
    wait_for(lambda: driver.state() is None)
    wait_for(lambda: "there is no port" in (driver.problem or ""))
    with pytest.raises(ConnectionError, match="the device is not ready: there is no port"):
        driver.drive(100.0, 0.0)
    robot.heard.clear()
    robot.plug_in()
    wait_for(driver.state)
    assert robot.heard[0][0] == STOP  # it may have driven all the time
    driver.drive(100.0, 0.0)
    wait_for(lambda: robot.speeds == (100, 0))


def test_a_robot_that_falls_silent_is_opened_again(robot: TinyRobot, driver: SerialBase[bytes]) -> None:
    with closing(SerialFields(Apart(), robot.port, {"level": "volts"})) as listener:
        wait_for(lambda: listener.fields()["level"])
        robot.is_on = False
        wait_for(lambda: driver.problem == "nothing was heard for 1 s: the device is opened again")
        wait_for(lambda: "does RServer run" in (listener.problem or ""))
        assert driver.state() is listener.fields()["level"] is None
        robot.is_on = True
        wait_for(driver.state)
        wait_for(lambda: listener.fields()["level"])
        assert driver.problem is listener.problem is None


def test_a_server_that_stops_in_each_frame_does_not_disturb_the_opening(robot: TinyRobot) -> None:
    robot.greets = False
    with closing(base(robot.port)) as driver:
        wait_for(lambda: robot.count(HELLO))
        for _ in range(100):
            driver.stop()
            time.sleep(0.005)
        asked = robot.count(HELLO)
        wait_for(lambda: robot.count(HELLO) > asked)
        assert robot.count(SPEEDS) <= 16  # those of the guard, which knows nothing yet
        robot.greets = True
        wait_for(driver.state)


def test_a_wrong_baud_rate(robot: TinyRobot) -> None:
    robot.is_on = False
    with closing(base(robot.port)) as driver:

        def is_noticed() -> bool:
            if driver.problem:  # the port is open
                robot.write(b"\x00\xe0\x00")
            return "bytes arrive, and no packet is among them: it may not" in (driver.problem or "")

        wait_for(is_noticed)
        robot.is_on = True
        wait_for(driver.state)
        wait_for(lambda: driver.problem is None)


def test_a_busy_port(robot: TinyRobot) -> None:
    with open(robot.port, "rb", buffering=0) as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with closing(connect(robot.port, 0, b"")) as connection:
            event = connection.receive(PATIENCE_S)
            while event == PortLost("the port is not open yet"):
                event = connection.receive(PATIENCE_S)
            assert isinstance(event, PortLost)
            assert f"is busy: process {os.getpid()} (" in event.why
            fcntl.flock(other, fcntl.LOCK_UN)
            await_up(connection)


def test_decisions_that_are_too_old_move_nothing(robot: TinyRobot) -> None:
    command = GuardedCommand(stop=Tiny.stop_bytes, goodbye=b"", deadline_ns=150_000_000)
    with closing(connect(robot.port, 0, b"", command)) as connection:
        await_up(connection)
        dialect = Tiny()
        connection.decide(dialect.drive(200.0, 0.0), time.monotonic_ns() - 200_000_000)
        connection.send(dialect.goodbye)
        wait_for(lambda: robot.count(GOODBYE))
        assert all(data == STOP for data, _ in robot.heard if data[0] == SPEEDS)


def test_garbage_from_the_line_moves_nothing_and_costs_no_line(
    robot: TinyRobot, driver: SerialBase[bytes], reports: list[str]
) -> None:
    robot.write(encoded(b"\x01\x02") + random.Random(1).randbytes(3000))
    refusal = "a packet was refused: error: unpack_from requires a buffer of at least 7 bytes"
    wait_for(lambda: any(text.startswith(refusal) for text in reports))
    wait_for(lambda: driver.problem is None and driver.state())
    assert not any(data[0] == SPEEDS and any(data[1:]) for data, _ in robot.heard)


class Text(Tiny):
    """A dialect with packets of text: `05 text`, the charge."""

    def read(self, packet: bytes, t_ns: int) -> Readings:
        if packet[0] != 5:
            return super().read(packet, t_ns)
        number, divisor = packet[1:].decode().split(",")
        return Readings(fields={"charge": float(number) / int(divisor)})


def test_packets_that_cannot_be_read_are_counted_and_cost_no_line(robot: TinyRobot) -> None:
    said: list[str] = []
    with (
        closing(SerialBase(Text(), robot.port, report=said.append)) as base,
        closing(SerialFields(Text(), robot.port, {"charge": "charge"})) as driver,
    ):
        wait_for(base.state)
        damaged = (b"\x05abc,1", b"\x05\xff,1", b"\x051,0", b"\x05nan,1", *[b"\x02\xff"] * 10)
        robot.write(b"".join(map(encoded, damaged)) + encoded(b"\x0542,2"))
        wait_for(lambda: driver.fields()["charge"])
        assert sorted(said) == [
            "10 packets were refused: volts is 25.5; from 0 to 20 is possible",
            "a packet was refused: UnicodeDecodeError: 'utf-8' codec can't decode byte 0xff in position 0: "
            "invalid start byte",
            "a packet was refused: ValueError: could not convert string to float: 'abc'",
            "a packet was refused: ZeroDivisionError: float division by zero",
            "a packet was refused: charge is nan; from -inf to inf is possible",
            "a packet was refused: volts is 25.5; from 0 to 20 is possible",
        ]
        assert (driver.problem, base.problem) == (None, None)


def test_garbage_from_a_driver_is_ignored(robot: TinyRobot) -> None:
    with closing(connect(robot.port, 0, b"")) as connection:
        raw: socket.socket = connection._socket
        for packet in (b"H", b"D", b"?", b"H" + bytes(3), b"D" + struct.pack("<BQ", 0, 0) + b"x"):
            raw.send(packet)
        rng = random.Random(1)
        for _ in range(200):  # the first hello among them makes it command
            raw.send(bytes([rng.choice(b"HDA")]) + rng.randbytes(rng.randrange(20)))
        await_up(connection)
