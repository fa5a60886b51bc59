"""A connection and its bridge, as processes, over a fake rclpy: what is sent, stopped and reported."""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from colony.ir.ros2_messages import STANDARD
from colony.ros2.cdr import decode, encode, structure
from colony.ros2.connection import NodeSettings, Ros2Connection, received
from colony.ros2.topics import CommandedTopic
from tests.cli.machine import children_of
from tests.ros2.ros import freeze
from tests.waiting import until

FAKE = Path(__file__).with_name("fake")
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
AHEAD, ZERO = struct.pack("<6d", 0.5, 0, 0, 0, 0, 0), bytes(48)
MS = 1_000_000
TIMEOUT_NS = 250 * MS


class Robot:
    """A robot in files, and the connection to it. Mutable."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.reports: list[str] = []
        self.set(subscribers=[["base", TWIST]])
        self._connections: list[Ros2Connection] = []

    def set(self, **ends: Any) -> None:
        """Set the ends of /cmd_vel in the graph."""
        temporary = self.folder / "graph.new"
        temporary.write_text(
            json.dumps({"/cmd_vel": ends, "/lamp": {"subscribers": [["base", "std_msgs/msg/Bool"]]}})
        )
        temporary.replace(self.folder / "graph.json")

    def connect(self, setup: str = "") -> Ros2Connection:
        """Return a connection with a bridge of its own."""
        node = NodeSettings(python=sys.executable, setup=setup)
        found = Ros2Connection.shared(node, self.reports.append)
        self._connections.append(found)
        return found

    def output(self, connection: Ros2Connection, **options: Any) -> CommandedTopic:
        """Return the drive of the base, ready to be commanded."""
        found = self.adding(connection, **options)
        until(lambda: found.error == "", "it can be commanded")
        return found

    def adding(self, connection: Ros2Connection, **options: Any) -> CommandedTopic:
        """Return the drive of the base."""
        options = {"timeout_ns": TIMEOUT_NS, **options}
        return connection.command(CommandedTopic("cmd_vel", "auto", is_stopped=True, **options))

    def arrive(self, **row: Any) -> None:
        """Have a message arrive."""
        with open(self.folder / "inbox", "a") as inbox:
            inbox.write(json.dumps(row) + "\n")

    @property
    def published(self) -> list[tuple[int, str, bytes]]:
        """The time, type and data of each publication on /cmd_vel."""
        log = self.folder / "log"
        rows = [json.loads(row) for row in log.read_text().splitlines()] if log.exists() else []
        return [(t, type_, bytes.fromhex(data)) for t, topic, type_, data in rows if topic == "/cmd_vel"]

    def stands(self) -> bool:
        """Return True if ten zeros were published last, and nothing for a while."""
        last = self.published[-10:]
        is_zero = len(last) == 10 and all(data.endswith(ZERO) for _, _, data in last)
        return is_zero and time.monotonic_ns() - last[-1][0] > 100 * MS

    def zeros(self) -> int:
        """Return the number of zeros after the last command that moves."""
        data = [data for _, _, data in self.published]
        moving = [i for i, each in enumerate(data) if not each.endswith(ZERO)]
        return len(data) - (moving[-1] + 1 if moving else 0)

    @property
    def bridge(self) -> int:
        """The process id of the bridge."""
        (found,) = [pid for pid in children_of(os.getpid()) if b"ros2/bridge" in _command(pid)]
        return found

    def close(self) -> None:
        for connection in self._connections:
            connection.close()


def _command(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    monkeypatch.setenv("PYTHONPATH", str(FAKE))
    monkeypatch.setenv("FAKE_RCLPY", str(tmp_path))
    found = Robot(tmp_path)
    yield found
    found.close()


def test_a_decision_is_published_and_ten_zeros_when_the_next_one_is_missing(robot: Robot) -> None:
    connection = robot.connect()
    output = robot.output(connection)
    began_ns = time.monotonic_ns()
    connection.decide(output, AHEAD)
    until(robot.stands, "it stands")
    found = robot.published
    assert [(type_, data[4:]) for _, type_, data in found] == [(TWIST, AHEAD)] + [(TWIST, ZERO)] * 10
    assert found[1][0] >= began_ns + TIMEOUT_NS
    assert found[-1][0] >= began_ns + TIMEOUT_NS + 9 * 20 * MS


def test_a_decision_after_the_stop_drives_again(robot: Robot) -> None:
    connection = robot.connect()
    output = robot.output(connection)
    connection.decide(output, AHEAD)
    connection.stop(output)
    until(lambda: output.unreached is None, "the stop is acknowledged")
    connection.decide(output, AHEAD)
    until(robot.stands, "it stands")
    moving = [i for i, (_, _, data) in enumerate(robot.published) if data.endswith(AHEAD)]
    assert len(moving) == 2
    assert robot.zeros() == 10


@pytest.mark.parametrize("is_hanging", [False, True])
def test_the_end_of_colony_stops_whatever_ros_does(robot: Robot, is_hanging: bool) -> None:
    connection = robot.connect()
    output = robot.output(connection, timeout_ns=1000 * TIMEOUT_NS)
    if is_hanging:
        robot.arrive(hang=60.0)
    connection.decide(output, AHEAD)
    until(lambda: robot.published, "it drives")
    robot.close()
    assert robot.zeros() == 10
    robot._connections.clear()


def test_nothing_is_published_at_the_end_by_a_bridge_that_commanded_nothing(robot: Robot) -> None:
    robot.output(robot.connect())
    robot.close()
    robot._connections.clear()
    assert not robot.published


def test_a_bridge_that_is_asked_to_end_stops_first(robot: Robot) -> None:
    connection = robot.connect()
    connection.decide(robot.output(connection), AHEAD)
    until(lambda: robot.published, "it drives")
    os.kill(robot.bridge, signal.SIGTERM)
    until(robot.stands, "it stands")
    assert robot.zeros() == 10
    until(lambda: robot.reports[1:], "another bridge runs")
    assert robot.reports[0].startswith("the bridge has ended with the exit code 0")
    assert robot.reports[1:] == ["the bridge to ROS 2 works again"]


def test_a_frozen_bridge_is_replaced_and_the_next_begins_with_the_stop(robot: Robot) -> None:
    connection = robot.connect()
    output = robot.output(connection)
    connection.decide(output, AHEAD)
    frozen = robot.bridge
    freeze(frozen)
    connection.stop(output)
    assert connection.unreached(output) == "cmd_vel: the bridge has not published it"
    until(lambda: output.unreached is None, "the next bridge has stopped it")
    assert robot.bridge != frozen
    assert robot.reports[0] == "the bridge did not answer, and was killed"


def test_a_frozen_bridge_is_replaced_without_a_stop(robot: Robot) -> None:
    connection = robot.connect()
    robot.output(connection)
    frozen = robot.bridge
    freeze(frozen)
    until(lambda: robot.reports[1:], "another bridge runs")
    assert robot.reports == ["the bridge did not answer, and was killed", "the bridge to ROS 2 works again"]
    assert robot.bridge != frozen


def test_the_type_is_the_one_that_subscribers_expect(robot: Robot) -> None:
    connection = robot.connect()
    robot.set(subscribers=[])
    output = robot.adding(connection, frame="base_link")
    until(lambda: output.error == "no node subscribes to /cmd_vel", "nobody listens")
    with pytest.raises(ConnectionError, match="cmd_vel is not commanded: no node subscribes to /cmd_vel"):
        connection.decide(output, AHEAD)
    robot.set(subscribers=[["base", TWIST_STAMPED]])
    until(lambda: output.error == "", "it can be commanded")
    connection.decide(output, AHEAD)
    until(lambda: robot.published, "it drives")
    _, type_, data = robot.published[0]
    assert type_ == TWIST_STAMPED
    found = decode(connection.structure(TWIST_STAMPED), data)
    assert found["twist"]["linear"]["x"] == 0.5
    assert found["header"]["frame_id"] == "base_link"
    assert abs(found["header"]["stamp"]["sec"] - time.time()) < 60.0
    robot.set(subscribers=[["base", TWIST]])
    until(
        lambda: "is sent" not in (output.problem or "") and _drives_as(robot, connection, output, TWIST),
        "a twist",
    )


def _drives_as(robot: Robot, connection: Ros2Connection, output: CommandedTopic, type_: str) -> bool:
    try:
        connection.decide(output, AHEAD)
    except ConnectionError:
        return False
    return any(found == type_ for _, found, _ in robot.published)


def test_a_stop_that_no_node_hears_is_not_acknowledged_and_sent_again(robot: Robot) -> None:
    connection = robot.connect()
    output = robot.output(connection)
    robot.set(subscribers=[])
    connection.stop(output)
    until(lambda: output.unreached == "cmd_vel: no node subscribes to cmd_vel", "it is not reached")
    robot.set(subscribers=[["base", TWIST]])
    until(lambda: output.unreached is None, "it is")


def test_beside_another_publisher_nothing_is_commanded_alone(robot: Robot) -> None:
    robot.set(subscribers=[["base", TWIST]], publishers=[["mux", TWIST]])
    connection = robot.connect()
    output = robot.adding(connection, alone=True)
    why = f"`/mux` ({TWIST}) publishes /cmd_vel already"
    until(lambda: output.problem == why, "it is refused")
    connection.stop(output)
    until(lambda: output.unreached == f"cmd_vel: {why}", "the stop is refused as well")
    assert not robot.published
    robot.set(subscribers=[["base", TWIST]], publishers=[["colony", TWIST]])  # its own
    until(lambda: output.unreached is None, "it begins once it is alone")
    robot.set(subscribers=[["base", TWIST]], publishers=[["colony", TWIST], ["mux", TWIST]])
    until(lambda: output.problem == f"`/mux` publishes /cmd_vel as well ({TWIST})", "another one is named")
    connection.decide(output, AHEAD)


def test_messages_arrive_and_definitions_of_their_types(robot: Robot) -> None:
    connection = robot.connect()
    found = connection.hear("flag", "std_msgs/msg/Odd")
    assert found.incoming.kind is None
    until(lambda: found.incoming.kind is not None, "the definition is known")
    robot.arrive(topic="flag", data="00010000" + "01000000" + "02000000" + "0100")
    message = until(found.incoming.message, "it arrives")
    assert message.values == {"flag": True, "values": ({"data": True}, {"data": False})}
    until(lambda: found.problem == "no node publishes /flag", "that nobody publishes it is named")


def test_the_stop_of_any_type_is_a_message_of_zeros(robot: Robot) -> None:
    connection = robot.connect()
    output = connection.command(
        CommandedTopic("lamp", "std_msgs/msg/Bool", is_stopped=True, timeout_ns=TIMEOUT_NS)
    )
    connection.stop(output)
    until(lambda: output.unreached is None, "it is stopped")
    assert '"/lamp", "std_msgs/msg/Bool", "' + b"zero".hex() in (robot.folder / "log").read_text()


def test_what_is_without_a_stop_keeps_what_it_was_commanded(robot: Robot) -> None:
    connection = robot.connect()
    output = connection.command(
        CommandedTopic("lamp", "std_msgs/msg/Bool", is_stopped=False, timeout_ns=TIMEOUT_NS)
    )
    connection.stop(output)
    until(lambda: output.unreached is None, "there is nothing to stop")
    assert not (robot.folder / "log").exists()


def test_a_bridge_that_cannot_start_says_why_once_and_is_tried_again(robot: Robot) -> None:
    broken = robot.folder / "broken"
    broken.touch()
    connection = robot.connect()
    until(lambda: connection.problem is not None, "it fails")
    assert connection.problem == f"{sys.executable}: RuntimeError: no middleware"
    assert not connection.is_opening
    broken.unlink()
    until(lambda: connection.problem is None, "it works")
    assert robot.reports == [
        f"{sys.executable}: RuntimeError: no middleware",
        "the bridge to ROS 2 works again",
    ]


def test_a_setup_script_is_sourced_first(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTHONPATH")
    setup = robot.folder / "set up.bash"
    connection = robot.connect(str(setup))
    until(lambda: connection.problem == f"there is no script {setup}", "it is missing")
    setup.write_text(f"export PYTHONPATH={FAKE}\n")
    robot.output(connection)


def test_drivers_of_one_node_share_a_bridge(robot: Robot) -> None:
    first, second = robot.connect(), robot.connect()
    assert first is second
    robot.output(first)
    first.close()
    robot._connections.pop()
    assert robot.bridge


# --- another controller ---------------------------------------------------------------------------


def test_a_twist_of_another_controller_is_heard_in_the_type_that_it_publishes(robot: Robot) -> None:
    robot.set(subscribers=[["base", TWIST]])
    connection = robot.connect()
    heard = connection.hear("cmd_vel", "auto")
    until(lambda: heard.problem == "no node publishes /cmd_vel", "nothing is published")
    for type_, path in ((TWIST, ()), (TWIST_STAMPED, ("twist",))):
        robot.set(publishers=[["teleop", type_]])
        kind = structure(type_, STANDARD)
        until(lambda kind=kind: heard.incoming.kind == kind and heard.problem is None, type_)
        values: dict[str, Any] = {"linear": {"x": 0.5}}
        for name in path:
            values = {name: values}
        robot.arrive(topic="cmd_vel", data=encode(kind, values).hex())
        until(lambda: heard.incoming.message() is not None, "it arrives")
        found = heard.incoming.message()
        assert found is not None
        twist = found.values["twist"] if path else found.values
        assert twist["linear"]["x"] == 0.5
        heard.incoming.put(None)
    assert robot.published == []


def test_another_type_than_a_twist_is_named(robot: Robot) -> None:
    robot.set(publishers=[["joy", "std_msgs/msg/Bool"]])
    heard = robot.connect().hear("cmd_vel", "auto")
    until(lambda: "`/joy` publishes /cmd_vel as std_msgs/msg/Bool" in (heard.problem or ""), "it is named")


def test_the_last_packets_of_a_bridge_that_left_some_unread_are_read() -> None:
    ours, bridge = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        ours.send(b"unread")
        bridge.send(b"why it ends")
        bridge.close()
        assert [received(ours), received(ours)] == [b"why it ends", b""]
