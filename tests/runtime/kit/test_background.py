"""A driver over a device that blocks: a thread waits for the device, and the server never does."""

from __future__ import annotations

import os
import re
import threading
import tty
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, suppress

import pytest

from colony.ir.servers import FieldSpec, ServerSpec
from colony.ir.types import DIMENSIONLESS, ScalarValue
from colony.runtime.kit.background import (
    FIRST_PAUSE_S,
    LONGEST_PAUSE_S,
    STABLE_S,
    STUCK_S,
    Background,
    BlockingDevice,
    DeviceBackoff,
)
from colony.runtime.kit.devices import DeviceReader
from colony.runtime.servers.drivers import Reading
from tests.kit.node_stage import MS
from tests.waiting import PATIENCE_S, until


class Line:
    """A serial line with a device at its far end. Mutable: it may be pulled out and plugged in again."""

    def __init__(self) -> None:
        self.plug()

    def plug(self) -> None:
        self.far, self._near = os.openpty()
        tty.setraw(self._near)

    def open(self) -> int:
        if self._near < 0:
            raise FileNotFoundError("no such port")
        return os.dup(self._near)

    def says(self, text: str) -> None:
        os.write(self.far, text.encode() + b"\n")

    def hears(self) -> str:
        return os.read(self.far, 1000).decode().strip()

    def pull(self) -> None:
        near, self._near = self._near, -1
        os.close(self.far)
        os.close(near)


class Port(BlockingDevice):
    """A device at a line, read line by line; `set` is its command."""

    def __init__(self, line: Line) -> None:
        self._file = os.fdopen(line.open(), "rb+", buffering=0)

    def read(self) -> Mapping[str, float]:
        text = self._file.readline()
        if not text:
            raise ConnectionError("the line is gone")
        name, _, value = text.decode().partition("=")
        return {name: float(value)}

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        self._file.write(f"{name} {values['to']:g}\n".encode())

    def safe(self) -> None:
        self._file.write(b"safe\n")

    def close(self) -> None:
        self._file.close()


class Stage:
    """A driver over a line, a clock that the test moves, and what was reported. Mutable."""

    def __init__(self, make: Callable[[], BlockingDevice] | None = None, *, delay_ns: int = 0) -> None:
        self.line, self.now_ns, self.reports = Line(), 1_000 * MS, list[str]()
        self.driver = Background(
            make or (lambda: Port(self.line)),
            delay_ns=delay_ns,
            report=self.reports.append,
            clock=lambda: self.now_ns,
        )

    def has(self, name: str, value: float) -> Reading:
        """Wait for a reading."""

        def found() -> Reading | None:
            reading = self.driver.fields().get(name)
            return reading if reading is not None and reading.value == value else None

        got = until(found, f"{name} is {value}")
        assert got is not None
        return got

    def close(self) -> None:
        with suppress(OSError):
            os.write(self.line.far, b"\n")  # a pty does not end the read of a file that is closed
        self.driver.close()


@pytest.fixture
def stage() -> Iterator[Stage]:
    with closing(Stage(delay_ns=20 * MS)) as made:
        assert until(made.line.hears, "it is made safe") == "safe"
        yield made


def test_the_newest_reading_gets_older_while_the_device_is_silent(stage: Stage) -> None:
    assert stage.driver.fields() == {}
    stage.line.says("level=0.5")
    assert stage.has("level", 0.5) == Reading(0.5, 20 * MS)
    stage.now_ns += 300 * MS
    assert stage.driver.fields() == {"level": Reading(0.5, 320 * MS)}
    stage.line.says("load=7")
    assert stage.has("load", 7.0) == Reading(7.0, 20 * MS)
    assert stage.driver.fields()["level"] == Reading(0.5, 320 * MS)  # each field has its own age
    assert stage.reports == []


def test_what_a_device_raises_ends_its_readings_until_it_works_again(stage: Stage) -> None:
    stage.line.says("level=0.5")
    stage.has("level", 0.5)
    assert stage.driver.problem is None
    stage.line.says("level=half")
    until(lambda: stage.driver.fields() == {}, "no value")
    assert until(stage.line.hears, "it is opened again, and made safe") == "safe"
    assert stage.driver.problem == "ValueError: could not convert string to float: 'half\\n'"
    stage.line.says("level=0.75")
    stage.has("level", 0.75)
    until(lambda: len(stage.reports) == 2, "both are reported")
    assert stage.reports[0].startswith("the device, which is opened again, failed:\nTraceback")
    assert stage.reports[0].endswith("ValueError: could not convert string to float: 'half\\n'")
    assert stage.reports[1] == "the device works again"
    assert stage.driver.problem is None


def test_a_command_that_is_sent_ends_an_outage_too(stage: Stage) -> None:
    stage.line.says("level=half")
    until(lambda: stage.reports, "it is lost")
    assert until(stage.line.hears, "it is opened again, and made safe") == "safe"
    until(lambda: _sends(stage, 3.0), "the command is taken")
    assert stage.line.hears() == "set 3"
    until(lambda: stage.driver.problem is None, "it works again")
    assert stage.reports[1:] == ["the device works again"]


def test_a_device_that_is_pulled_out_comes_back(stage: Stage) -> None:
    stage.line.says("level=0.5")
    stage.has("level", 0.5)
    stage.line.pull()
    until(lambda: stage.driver.fields() == {}, "no value")
    [report] = until(lambda: stage.reports, "it is reported")
    assert re.fullmatch(r"the device, which is opened again, failed: OSError: .*", report)
    with pytest.raises(ConnectionError, match="the device does not work: "):
        until(lambda: stage.driver.command("set", {"to": 1.0}), "a command fails")
    stage.line.plug()
    assert until(stage.line.hears, "it is made safe") == "safe"
    stage.line.says("level=0.25")
    stage.has("level", 0.25)
    assert "OSError: [Errno 5]" in stage.reports[0]


def test_a_device_that_does_not_open_is_tried_again() -> None:
    tried = threading.Semaphore(0)

    def make() -> BlockingDevice:
        tried.release()
        raise SystemExit("no such port")

    with closing(Stage(make)) as stage:
        for _ in range(3):
            assert tried.acquire(timeout=PATIENCE_S)
        assert stage.driver.fields() == {}
        with pytest.raises(ConnectionError, match="does not work: SystemExit: no such port"):
            stage.driver.command("set", {"to": 1.0})
        assert len(stage.reports) == 1  # in one outage


def test_pauses_grow_until_a_device_has_worked_for_a_while() -> None:
    backoff = DeviceBackoff()
    pauses = [backoff.after(0.01) for _ in range(8)]
    assert pauses[:3] == [FIRST_PAUSE_S, 2 * FIRST_PAUSE_S, 4 * FIRST_PAUSE_S]
    assert pauses[-1] == LONGEST_PAUSE_S
    assert backoff.after(STABLE_S) == FIRST_PAUSE_S


# --- commands --------------------------------------------------------------------------------------------


def test_commands_are_sent_and_the_end_makes_the_device_safe(stage: Stage) -> None:
    until(lambda: _sends(stage, 3.0), "the command is taken")
    assert until(stage.line.hears, "the command") == "set 3"
    stage.driver.safe()
    stage.driver.close()
    assert stage.line.hears() == "safe"


class Slow(BlockingDevice):
    """A device that is as slow as the test wants. Mutable: notes what it was sent."""

    def __init__(self) -> None:
        self.sent: list[str] = []
        self.busy, self.free, self.ended = threading.Event(), threading.Event(), threading.Event()

    def read(self) -> None:
        assert self.ended.wait(PATIENCE_S)
        raise ConnectionError("closed")

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        self.sent.append(f"{name} {values['to']:g}")
        self.busy.set()
        assert self.free.wait(PATIENCE_S)

    def safe(self) -> None:
        self.sent.append("safe")

    def close(self) -> None:
        self.ended.set()
        self.free.set()


def _sends(stage: Stage, to: float) -> bool:
    with suppress(ConnectionError):
        stage.driver.command("set", {"to": to})
        return True
    return False


def test_a_slow_device_gets_the_newest_command_and_safe_in_place_of_what_waits() -> None:
    device = Slow()
    with closing(Stage(lambda: device)) as stage:
        until(lambda: _sends(stage, 1.0), "it is open")
        assert device.busy.wait(PATIENCE_S)
        stage.driver.command("set", {"to": 2.0})
        stage.driver.command("set", {"to": 3.0})
        stage.driver.safe()
        stage.driver.command("set", {"to": 4.0})
        assert stage.driver.unreached == "the device has not taken what it was sent"
        device.free.set()
        until(lambda: len(device.sent) == 4, "all is sent")
        assert device.sent == ["safe", "set 1", "safe", "set 4"]
        until(lambda: stage.driver.unreached is None, "all is taken")


def test_commands_for_a_stuck_device_count_as_not_sent_and_closing_does_not_wait() -> None:
    device = Slow()
    stage = Stage(lambda: device)
    until(lambda: _sends(stage, 1.0), "it is open")
    assert device.busy.wait(PATIENCE_S)
    stage.driver.command("set", {"to": 2.0})
    stage.now_ns += int(STUCK_S * 1e9) + 1
    with pytest.raises(TimeoutError, match="has not taken the last command in 1 s"):
        stage.driver.command("set", {"to": 3.0})
    assert stage.driver.fields() == {}
    stage.close()
    assert device.ended.is_set()
    assert stage.reports == []


def test_a_failing_command_opens_the_device_again() -> None:
    made: list[Failing] = []

    class Failing(Slow):
        def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
            raise OSError("port is gone")

    def make() -> BlockingDevice:
        made.append(Failing())
        return made[-1]

    with closing(Stage(make)) as stage:
        until(lambda: _sends(stage, 1.0), "it is open")
        until(lambda: len(made) == 2, "it is opened again")
        assert made[0].ended.is_set()
        [report] = stage.reports
        assert report.endswith("OSError: port is gone")


# --- in a server -----------------------------------------------------------------------------------------


def test_its_readings_are_those_of_a_server(stage: Stage) -> None:
    spec = ServerSpec("Battery", fields=(FieldSpec("level", DIMENSIONLESS, ""),))
    reader = DeviceReader(spec, stage.driver, stage.reports.append)
    stage.line.says("level=0.5")
    stage.has("level", 0.5)
    stage.now_ns += 80 * MS
    sample = reader.read(5_000 * MS)["level"]
    assert (sample.value, sample.t_ns) == (0.5, 4_900 * MS)
