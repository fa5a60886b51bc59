"""The bridge against a genuine ROS 2: what arrives, what is commanded, and what stops when something dies."""

from __future__ import annotations

import ast
import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from colony.ros2.connection import BRIDGE
from colony.ros2.drivers import Ros2Base, Ros2Device
from tests.cli.machine import children_of
from tests.ros2.ros import DRIVE, ODOM, SCAN, Foreign, Ros, freeze
from tests.waiting import until

genuine = pytest.mark.ros2

Topics = dict[str, dict[str, Any]]

STOPPED_NS = 300_000_000
"""Longest time from the death of a process to the first zero."""


STANDARD_LIBRARY = {
    *("__future__", "collections", "contextlib", "errno", "functools", "hashlib", "importlib", "json", "os"),
    *("pathlib", "select", "signal", "socket", "struct", "sys", "threading", "time", "types", "typing"),
}


@pytest.mark.parametrize("path", sorted(BRIDGE.glob("*.py")), ids=lambda path: path.name)
def test_the_bridge_runs_on_old_pythons_without_colony(path: Path) -> None:
    tree = ast.parse(path.read_text(), feature_version=(3, 8))
    names = {name for node in ast.walk(tree) for name in imported(node)}
    own = {name for name in names if name.startswith("colony.ros2.bridge.")}
    assert {name.partition(".")[0] for name in names - own} <= STANDARD_LIBRARY | {"rclpy"}


def imported(node: ast.AST) -> list[str]:
    """Return the modules that a statement imports."""
    match node:
        case ast.Import(names=names):
            return [alias.name for alias in names]
        case ast.ImportFrom(module=str() as module):
            return [module]
        case _:
            return []


def device(
    ros: Ros, reports: list[str], fields: Topics, commands: Topics | None = None, **node: Any
) -> Ros2Device:
    """Return the driver of a device."""
    topics = json.dumps({"in": fields, "out": commands or {}})
    return Ros2Device(ros.node(), topics, connection=ros.connection(reports.append, **node))


def base(ros: Ros, reports: list[str], **drive: Any) -> Ros2Base:
    """Return the driver of a base."""
    topics = json.dumps({"in": {"odom": ODOM}, "out": {"drive": {**DRIVE, **drive}}})
    return Ros2Base(ros.node(), topics, connection=ros.connection(reports.append))


def arrives(driver: Ros2Device, name: str, expected: object) -> None:
    """Wait until a field has a value."""

    def is_there() -> bool:
        reading = driver.fields()[name]
        return reading is not None and reading.value == expected

    until(is_there, f"{name} is {expected}: {driver.fields()}, {driver.problem}", patience_s=30.0)


def fails(driver: Ros2Device | Ros2Base, why: str) -> None:
    """Wait until a driver has a problem."""

    def has_failed() -> bool:
        if isinstance(driver, Ros2Device):
            driver.fields()
        return why in (driver.problem or "")

    until(has_failed, why, patience_s=30.0)


def drive_until(driver: Ros2Base, is_done: Callable[[], bool], what: str) -> None:
    """Drive ahead in frames of 50 ms."""

    def step() -> bool:
        time.sleep(0.05)
        try:
            driver.drive(200.0, 10.0)
        except ConnectionError:
            return False
        return is_done()

    until(step, what, patience_s=30.0)


# --- what arrives ---------------------------------------------------------------------------------

OTHERS = {
    "imu": ["sensor_msgs/msg/Imu", {"angular_velocity": {"z": 0.5}}, "best_effort"],
    "battery": ["sensor_msgs/msg/BatteryState", {"percentage": 0.75, "voltage": 12.5}, "reliable"],
    "joy": ["sensor_msgs/msg/Joy", {"axes": [0.0, 0.5], "buttons": [0, 1]}, "reliable"],
    "estop": ["std_msgs/msg/Bool", {"data": True}, "latched"],
    "level": ["std_msgs/msg/Int32", {"data": -3}, "reliable"],
    "mode": ["std_msgs/msg/String", {"data": "manual"}, "reliable"],
    "sonar": ["sensor_msgs/msg/Range", {"min_range": 0.125, "max_range": 4.0, "range": 1.5}, "best_effort"],
    "goal": ["geometry_msgs/msg/PointStamped", {"point": {"y": 2.5}}, "reliable"],
    "status": ["diagnostic_msgs/msg/DiagnosticStatus", {"message": "bad"}, "reliable"],
    "nested": ["test_msgs/msg/Nested", {"basic_types_value": {"uint16_value": 77}}, "reliable"],
}
READ: list[tuple[str, dict[str, Any], object]] = [
    ("imu", {"path": "orientation.yaw"}, 0.0),
    ("imu", {"path": "angular_velocity.z"}, 0.5),
    ("battery", {}, 0.75),
    ("battery", {"path": "voltage"}, 12.5),
    ("joy", {"path": "axes[1]"}, 0.5),
    ("joy", {"path": "buttons[1]", "bool": True}, True),
    ("estop", {"bool": True, "qos": "latched"}, True),
    ("level", {}, -3.0),
    ("mode", {"members": {"auto": 0.0, "manual": 1.0}}, 1.0),
    ("sonar", {}, 1.5),
    ("goal", {"path": "point.y"}, 2.5),
    ("status", {"path": "message", "members": {"good": 0.0, "bad": 2.0}}, 2.0),
    ("nested", {"path": "basic_types_value.uint16_value"}, 77.0),
]


@genuine
def test_messages_of_many_types_arrive(ros: Ros) -> None:
    reports: list[str] = []
    ros.foreign(others=OTHERS)
    fields = {
        f"f{i}": {"topic": name, "type": OTHERS[name][0], **options}
        for i, (name, options, _) in enumerate(READ)
    }
    driver = device(ros, reports, {**fields, "scan": SCAN})
    for i, (_, _, expected) in enumerate(READ):
        arrives(driver, f"f{i}", expected)
    arrives(driver, "scan", (3.0, 3.0, 3.0, 3.0))
    until(lambda: not driver.is_opening and driver.problem is None, "the graph is known")
    assert not reports
    scan = driver.fields()["scan"]
    assert scan is not None
    assert scan.age_ns < 100_000_000


@genuine
def test_a_base_is_driven_and_reports_where_it_is(ros: Ros) -> None:
    driver, robot = base(ros, [], frame="base_link"), ros.foreign()

    def has_come_far() -> bool:
        state = driver.state()
        return state is not None and state.x > 20.0

    drive_until(driver, has_come_far, "the base has driven")
    state = driver.state()
    assert state is not None
    assert state.speed == pytest.approx(200.0)
    assert state.turn_rate == pytest.approx(10.0)
    assert 270.0 < state.heading < 350.0  # yaw 0 is east, and it turns to the left
    robot.set(twist="TwistStamped")
    drive_until(driver, lambda: bool(robot.heard) and robot.heard[-1]["age"] is not None, "stamped twists")
    drive_until(driver, robot.drives, "it drives")
    assert abs(robot.heard[-1]["age"]) < 0.2
    assert robot.heard[-1]["frame"] == "base_link"
    assert driver.problem is None
    driver.stop()
    until(lambda: driver.unreached is None, "the stop is acknowledged")
    until(robot.stands, "ten zeros, and silence")


@genuine
def test_commands_of_any_type_are_heard(ros: Ros) -> None:
    types = {"lamp": "std_msgs/msg/Bool", "level": "std_msgs/msg/Float64", "mode": "std_msgs/msg/String"}
    types |= {"goal": "geometry_msgs/msg/PointStamped", "nested": "test_msgs/msg/Nested"}
    robot = ros.foreign(hears=types)
    commands: dict[str, dict[str, Any]] = {
        name: {"topic": name, "type": type_} for name, type_ in types.items()
    }
    commands["mode"]["members"] = {"auto": 0.0, "manual": 1.0}
    commands["level"]["stop"] = "zero"
    commands["goal"]["parameters"] = {"x": "point.x", "y": "point.y"}
    commands["nested"]["parameters"] = {"n": "basic_types_value.int16_value"}
    driver = device(ros, [], {}, commands)
    until(lambda: not driver.is_opening and driver.problem is None, "the topics are found", patience_s=30.0)
    driver.command("lamp", {"on": True})
    driver.command("level", {"level": 0.5})
    driver.command("mode", {"mode": 1.0})
    driver.command("goal", {"x": 1.5, "y": -2.0})
    driver.command("nested", {"n": 7.0})
    until(lambda: types.keys() <= robot.others.keys(), "all are heard")
    assert robot.others["lamp"][-1] == {"data": True}
    assert robot.others["level"][0] == {"data": 0.5}
    assert robot.others["mode"][-1] == {"data": "manual"}
    assert robot.others["goal"][-1]["point"] == {"x": 1.5, "y": -2.0, "z": 0.0}
    assert robot.others["nested"][-1]["basic_types_value"]["int16_value"] == 7
    until(lambda: len(robot.others["level"]) == 11, "the level is stopped")
    assert robot.others["level"][1:] == [{"data": 0.0}] * 10
    assert robot.others["lamp"] == [{"data": True}]


# --- who dies -------------------------------------------------------------------------------------


def bridge_of(driver: subprocess.Popen[bytes]) -> int:
    """Return the process id of the bridge of a driver."""
    (bridge,) = children_of(driver.pid)
    return int(bridge)


def driven(ros: Ros) -> tuple[Foreign, subprocess.Popen[bytes]]:
    """Return a foreign robot, and the process that drives it."""
    robot, driver = ros.foreign(), ros.driver_process()
    until(robot.drives, "the robot drives", patience_s=60.0)
    return robot, driver


@genuine
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM])
def test_a_driver_that_dies_or_freezes_is_followed_by_ten_zeros(ros: Ros, number: signal.Signals) -> None:
    robot, driver = driven(ros)
    began_ns = time.monotonic_ns()
    driver.send_signal(number)
    until(robot.stands, "ten zeros, and silence")
    zeros = [row for row in robot.since(began_ns) if row["v"] == 0.0]
    assert zeros[0]["t"] - began_ns < STOPPED_NS
    assert len(zeros) == 10
    assert zeros[-1]["t"] - zeros[0]["t"] > 150_000_000
    if number == signal.SIGSTOP:
        driver.send_signal(signal.SIGCONT)
        until(robot.drives, "it drives again")


@genuine
def test_a_bridge_that_is_asked_to_end_stops_first(ros: Ros) -> None:
    robot, driver = driven(ros)
    began_ns = time.monotonic_ns()
    os.kill(bridge_of(driver), signal.SIGTERM)
    until(lambda: any(row["v"] == 0.0 for row in robot.since(began_ns)), "a zero")
    until(robot.drives, "the next bridge drives", patience_s=30.0)


@genuine
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_bridge_that_is_killed_or_frozen_has_a_successor(ros: Ros, number: signal.Signals) -> None:
    robot, driver = driven(ros)
    first = bridge_of(driver)
    os.kill(first, number)
    began_ns = time.monotonic_ns()
    later_ns = began_ns + 500_000_000
    until(lambda: any(row["v"] for row in robot.since(later_ns)), "it drives again", patience_s=60.0)
    assert bridge_of(driver) != first
    print(f"driven again after {(robot.since(later_ns)[0]['t'] - began_ns) / 1e9:.1f} s")


@genuine
def test_a_frozen_bridge_acknowledges_no_stop(ros: Ros) -> None:
    reports: list[str] = []
    driver, robot = base(ros, reports), ros.foreign()
    drive_until(driver, robot.drives, "it drives")
    (bridge,) = [int(pid) for pid in children_of(os.getpid()) if is_bridge(int(pid))]
    freeze(bridge)
    driver.stop()
    assert driver.unreached is not None
    until(lambda: driver.unreached is None, "the successor has stopped it", patience_s=60.0)
    assert reports[0] == "the bridge did not answer, and was killed"
    until(lambda: robot.heard[-1]["v"] == 0.0, "it stands")


def is_bridge(pid: int) -> bool:
    with open(f"/proc/{pid}/cmdline", "rb") as file:
        return str(BRIDGE).encode() in file.read()


# --- what is wrong --------------------------------------------------------------------------------


@genuine
def test_a_second_publisher_is_named(ros: Ros) -> None:
    driver, robot = base(ros, []), ros.foreign()
    drive_until(driver, robot.drives, "it drives")
    assert driver.problem is None
    robot.set(second="Twist")
    fails(driver, "`/foreign` publishes /cmd_vel as well (geometry_msgs/msg/Twist)")
    robot.set(second=None)
    until(lambda: driver.problem is None, "it is alone again")


@genuine
def test_a_base_that_wants_to_be_alone_publishes_nothing_beside_another(ros: Ros) -> None:
    robot = ros.foreign(second="Twist")
    driver = base(ros, [], alone=True)
    fails(driver, "`/foreign` (geometry_msgs/msg/Twist) publishes /cmd_vel already")
    driver.stop()
    with pytest.raises(ConnectionError, match="publishes /cmd_vel already"):
        driver.drive(200.0, 0.0)
    until(lambda: "already" in (driver.unreached or ""), "the stop is not published either")
    assert not robot.heard
    robot.set(second=None)
    drive_until(driver, robot.drives, "it drives once it is alone")
    robot.set(second="Twist")
    fails(driver, "publishes /cmd_vel as well")
    drive_until(driver, robot.drives, "it goes on")


@genuine
def test_what_does_not_fit_is_named(ros: Ros) -> None:
    robot = ros.foreign(frame="base_scan", others={"level": OTHERS["level"]})
    driver = device(
        ros,
        [],
        {
            "scan": SCAN,
            "type": {"topic": "level", "type": "std_msgs/msg/Bool"},
            "quality": {**SCAN, "qos": "reliable"},
            "nobody": {"topic": "nowhere", "type": "std_msgs/msg/Bool"},
            "unknown": {"topic": "level", "type": "no_msgs/msg/No"},
        },
    )
    fails(driver, "scan: the frame is `base_scan`; expected `laser`")
    fails(driver, "`/foreign` publishes /level as std_msgs/msg/Int32; expected std_msgs/msg/Bool")
    fails(driver, '`/foreign` publishes /scan as best effort, and `qos` is "reliable": nothing arrives')
    fails(driver, "no node publishes /nowhere")
    fails(driver, "/level: this ROS environment has no type `no_msgs/msg/No`")
    assert driver.fields()["scan"] is None
    robot.set(frame="laser")
    arrives(driver, "scan", (3.0, 3.0, 3.0, 3.0))
    robot.set(stamp_s=0.5)
    fails(driver, "s ahead of the clock: synchronize the clocks, or set `use_sim_time`")
    assert driver.fields()["scan"] is None
    robot.set(stamp_s=-0.5)
    until(lambda: scan_age_s(driver) > 0.4, "the stamp adds to its age")
    robot.set(stamp_s=-5.0)
    until(lambda: 0.0 <= scan_age_s(driver) < 0.3, "the stamp of another clock does not")
    robot.set(unstamped=True)
    arrives(driver, "scan", (3.0, 3.0, 3.0, 3.0))


def scan_age_s(driver: Ros2Device) -> float:
    """Return the age of the scan; below 0 if there is none."""
    scan = driver.fields()["scan"]
    return -1.0 if scan is None else scan.age_ns / 1e9


@genuine
def test_a_simulated_clock_is_the_measure(ros: Ros) -> None:
    robot = ros.foreign(clock=1.0)
    driver = device(ros, [], {"scan": SCAN}, use_sim_time=True)
    arrives(driver, "scan", (3.0, 3.0, 3.0, 3.0))
    robot.set(clock=0.0)
    fails(driver, "/clock stands still")
    assert driver.fields()["scan"] is None
    robot.set(clock=0.5)
    arrives(driver, "scan", (3.0, 3.0, 3.0, 3.0))


@genuine
@pytest.mark.parametrize(
    ("python", "why"),
    [("/no/such/python", "/no/such/python cannot be started: No such file"), ("/usr/bin/python3", "rclpy")],
)
def test_a_python_without_ros_is_named(ros: Ros, python: str, why: str) -> None:
    reports: list[str] = []
    driver = device(ros, reports, {"scan": SCAN}, python=python)
    fails(driver, why)
    assert not driver.is_opening
    assert len(reports) == 1
