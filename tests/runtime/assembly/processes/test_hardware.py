"""Drivers of users: what cannot be imported or made says why and where; what fails later ends nothing."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from colony.runtime.assembly.processes.hardware import HardwareBase, close_driver, device_driver, load_driver
from colony.runtime.assembly.processes.restarts import MAX_PAUSE_NS, MAX_QUICK_DEATHS, Restarts
from colony.runtime.assembly.processes.spec import DriverError, HardwareDriver
from colony.runtime.kit.once import RECOVERED_AFTER
from colony.runtime.servers.commanding import NotSentError
from colony.runtime.servers.drivers import BaseState
from tests.runtime.scripted import LIMITS

GOOD = """
class Scanner:
    def __init__(self, port, baud=9600):
        self.port, self.baud = port, baud
    def fields(self): return {}
    def command(self, name, values): pass
    def safe(self): pass
    def close(self): pass
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder of modules, which this process forgets again."""
    path, modules = list(sys.path), set(sys.modules)
    yield tmp_path
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        del sys.modules[name]


def hardware(folder: Path, driver: str, **options: str | int | float | bool) -> HardwareDriver:
    origin = "scout.toml: server.Lidar.hardware"
    return HardwareDriver(driver=driver, options=options, search_path=(str(folder),), origin=origin)


def test_a_class_beside_the_body_is_made_with_the_options(folder: Path) -> None:
    (folder / "good_drivers.py").write_text(GOOD)
    of = hardware(folder, "good_drivers:Scanner", port="/dev/x", baud=115200)
    driver = device_driver(load_driver(of), of)
    assert (driver.port, driver.baud) == ("/dev/x", 115200)  # type: ignore[attr-defined]


def test_a_driver_that_lacks_a_command_of_the_interface_is_refused(folder: Path) -> None:
    (folder / "few_drivers.py").write_text(f"{GOOD}\nScanner.commands = {{'scan'}}\n")
    of = hardware(folder, "few_drivers:Scanner", port="/dev/x")
    device_driver(load_driver(of), of, ["scan"])
    with pytest.raises(DriverError, match="does not fit the interface: it has no command `lift`"):
        device_driver(load_driver(of), of, ["scan", "lift"])


FRAMED = GOOD.replace("baud=9600", "frame_ns").replace("baud", "frame_ns")


def test_a_driver_that_asks_for_the_frame_period_gets_it(folder: Path) -> None:
    (folder / "framed_drivers.py").write_text(FRAMED)
    of = structs.replace(hardware(folder, "framed_drivers:Scanner", port="/dev/x"), frame_ns=7)
    assert load_driver(of).frame_ns == 7
    assert load_driver(of.with_options({"frame_ns": 8})).frame_ns == 8


WRONG: list[tuple[str, str, bool, str]] = [
    ("nowhere_drivers:Scanner", "", True, "cannot be imported: ModuleNotFoundError: No module named"),
    ("bad:Scaner", GOOD, True, "bad.py` has no class `Scaner`; did you mean `Scanner`?"),
    ("bad:Scanner", "import no_such_package\n", True, "bad.py:1: ModuleNotFoundError: No module named 'no_s"),
    ("bad:Scanner", "\nclass Scanner\n", True, "bad.py:2: SyntaxError: expected ':'"),
    ("bad:Scanner", "raise SystemExit(3)\n", True, "bad.py:1: SystemExit: 3"),
    ("bad:Scanner", "class Scanner:\n    pass\n", False, "made: TypeError: Scanner() takes no arguments"),
    (
        "bad:Scanner",
        "import os\nclass Scanner:\n    def __init__(self, port):\n        os.open(port, 0)\n",
        False,
        "cannot be made: {folder}/bad.py:4: FileNotFoundError: [Errno 2] No such file or directory: '/dev/x'",
    ),
    (
        "bad:Scanner",
        "def Scanner(port): return 7\n",
        True,
        "it has no `fields`, `command`, `safe` and `close`",
    ),
]


@pytest.mark.parametrize(("driver", "text", "is_final", "message"), WRONG)
def test_what_cannot_be_made_says_why_and_where(
    folder: Path, driver: str, text: str, is_final: bool, message: str
) -> None:
    (folder / "bad.py").write_text(text)
    of = hardware(folder, driver, port="/dev/x")
    with pytest.raises(DriverError) as raised:
        device_driver(load_driver(of), of)
    assert raised.value.is_final == is_final
    assert str(raised.value).startswith(f"scout.toml: server.Lidar.hardware: the driver `{driver}` ")
    assert message.format(folder=folder) in str(raised.value)


def test_a_driver_that_cannot_be_closed_is_reported() -> None:
    class Stubborn:
        def close(self) -> None:
            raise OSError("busy")

    reports: list[str] = []
    close_driver(Stubborn(), reports.append)
    close_driver(object(), reports.append)
    assert reports == ["close of the driver failed: OSError: busy"]


# --- the base --------------------------------------------------------------------------------------------

NOW_NS, ORIGIN_NS = 9_000_000, 1_000_000


def state(**changes: Any) -> BaseState:
    numbers = {"x": 0.0, "y": 0.0, "heading": 0.0, "speed": 1.0, "turn_rate": 0.0, "wheel_speed": 1.0}
    rest = {"t_ns": 8_000_000, "front_bumper": False, "rear_bumper": True}
    return BaseState(**(numbers | rest | changes))


class Motors:
    def __init__(self, found: object = None) -> None:
        self.found, self.sent = found, list[object]()
        self.failing: set[str] = set()

    def _do(self, name: str, *values: float) -> None:
        self.sent.append((name, *values))
        if name in self.failing:
            raise OSError(f"{name} failed")

    def drive(self, velocity: float, turn: float) -> None:
        self._do("drive", velocity, turn)

    def stop(self) -> None:
        self._do("stop")

    def state(self) -> object:
        if isinstance(self.found, Exception):
            raise self.found
        return self.found


def base(driver: Motors) -> tuple[HardwareBase, list[str]]:
    reports: list[str] = []
    of = HardwareDriver(driver="d:Motors")
    made = HardwareBase(driver, LIMITS, of, origin_ns=ORIGIN_NS, report=reports.append, clock=lambda: NOW_NS)
    return made, reports


def test_a_base_has_the_times_of_the_robot_and_the_limits_of_its_body() -> None:
    made, reports = base(Motors(state()))
    assert made.state() == state(t_ns=7_000_000)
    assert (made.limits, made.register_bits, reports) == (LIMITS, None, [])


GARBAGE = [
    (7, "TypeError: returned a int; expected a BaseState or None"),
    (state(x=math.nan), "TypeError: x is nan; expected a finite number"),
    (state(speed="fast"), "TypeError: speed is 'fast'; expected a finite number"),
    (state(front_bumper=1), "TypeError: front_bumper is 1; expected True or False"),
    (state(t_ns=1.5), "TypeError: t_ns is 1.5; expected whole nanoseconds"),
    (state(t_ns=NOW_NS + 1), "ValueError: a snapshot from the future, by 1 ns"),
    (OSError("port is gone"), "OSError: port is gone"),
]


@pytest.mark.parametrize(("found", "problem"), GARBAGE)
def test_a_state_that_is_none_is_no_value_and_is_reported_once(found: object, problem: str) -> None:
    driver = Motors(found)
    made, reports = base(driver)
    assert [made.state() for _ in range(3)] == [None] * 3
    [report] = reports
    separator = " " if isinstance(found, OSError) else "\nTraceback"
    assert report.startswith(f"state of d:Motors failed:{separator}")
    assert problem in report
    driver.found = None
    assert made.state() is None
    driver.found = state()
    assert made.state() is not None


def test_a_command_that_fails_was_not_sent_and_is_reported_once() -> None:
    driver = Motors()
    made, reports = base(driver)
    driver.failing = {"drive", "stop"}
    for _ in range(2):
        with pytest.raises(NotSentError, match="d:Motors failed to drive: OSError: 'drive failed'"):
            made.drive(100.0, 5.0)
        made.stop()
    assert made.unreached == "d:Motors failed to stop: stop failed"
    driver.failing = set()
    made.stop()
    assert made.unreached is None
    assert driver.sent == [("drive", 100.0, 5.0), ("stop",)] * 2 + [("stop",)]
    assert reports == [
        "drive of d:Motors failed: OSError: drive failed",
        "stop of d:Motors failed: OSError: stop failed",
    ]


class SidewaysMotors(Motors):
    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> None:
        self._do("drive", velocity, turn, sideways)


def test_a_base_that_drives_sideways_is_given_that_speed_too() -> None:
    driver, limits = SidewaysMotors(state(sideways_speed=20.0)), replace(LIMITS, sideways=400.0)
    made = HardwareBase(driver, limits, HardwareDriver(driver="d:M"), origin_ns=ORIGIN_NS, report=print)
    made.drive(100.0, 5.0, -30.0)
    assert driver.sent == [("drive", 100.0, 5.0, -30.0)]
    found = made.state()
    assert found.sideways_speed == 20.0


def test_a_base_says_what_fails_until_it_works_again() -> None:
    motors = Motors(OSError("port is gone"))
    made, _ = base(motors)
    assert made.problem is None
    made.state()
    assert made.problem == "state of d:Motors failed: OSError: port is gone"
    motors.found = state()
    for _ in range(RECOVERED_AFTER + 1):
        made.state()
    assert made.problem is None
    motors.problem = "OSError: no power"  # type: ignore[attr-defined]
    assert made.problem == "OSError: no power"


def test_a_base_without_its_methods_is_none() -> None:
    with pytest.raises(DriverError, match="it has no `drive`, `stop` and `state`") as raised:
        HardwareBase(object(), LIMITS, HardwareDriver(driver="d:M"), origin_ns=0, report=print)
    assert raised.value.is_final


# --- restarts --------------------------------------------------------------------------------------------


def test_what_waits_for_its_device_is_started_again_for_ever() -> None:
    restarts = Restarts(gives_up=False)
    starts = [restarts.next_start(0, 0) for _ in range(5 * MAX_QUICK_DEATHS)]
    assert starts[0] == 0
    assert starts[-1] == MAX_PAUSE_NS
    assert None not in starts
