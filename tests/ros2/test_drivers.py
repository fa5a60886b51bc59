"""The drivers over a connection that is no process: values in, payloads out."""

from __future__ import annotations

import json
import math
import struct
import time
from collections.abc import Mapping
from typing import Any

import pytest

from colony.ir.ros2_messages import STANDARD, is_action
from colony.ros2.cdr import decode, encode, structure
from colony.ros2.connection import NodeSettings
from colony.ros2.drivers import Ros2Base, Ros2Device
from colony.ros2.incoming import ArrivedMessage, Incoming
from colony.ros2.topics import CommandedAction, CommandedTopic, GoalState, HeardTopic

NODE = json.dumps({"name": "colony"})
BOOL, STRING = "std_msgs/msg/Bool", "std_msgs/msg/String"
ODOM = {"topic": "odom", "type": "nav_msgs/msg/Odometry"}
TURNED = {"z": math.sin(math.pi / 4), "w": math.cos(math.pi / 4)}


class Stage:
    """A connection without a bridge. Mutable: what is heard and commanded.

    `decided` are the payloads by topic, `stopped` the topics in order.
    """

    problem: str | None = None
    is_opening = False
    is_paused = False

    def __init__(self) -> None:
        self.inputs: dict[str, HeardTopic] = {}
        self.decided: dict[str, bytes] = {}
        self.stopped: list[str] = []
        self.at_ns: int | None = None
        self.actions: list[CommandedAction] = []

    def hear(self, topic: str, type_: str, *, quality: str = "", frame: str = "") -> HeardTopic:
        found = HeardTopic(Incoming(topic, self.structure(type_), frame), type_, quality)
        self.inputs[topic] = found
        return found

    def now_ns(self) -> int:
        return time.monotonic_ns() if self.at_ns is None else self.at_ns

    def command(self, output: CommandedTopic) -> CommandedTopic:
        if isinstance(output, CommandedAction):
            self.actions.append(output)
        return output

    def structure(self, type_: str) -> Any:
        return structure(BOOL if is_action(type_) else type_, STANDARD)

    def decide(self, output: CommandedTopic, payload: bytes) -> None:
        self.decided[output.topic] = payload

    def stop(self, output: CommandedTopic) -> None:
        self.stopped.append(output.topic)

    def unreached(self, output: CommandedTopic) -> str | None:
        return output.unreached

    def close(self) -> None:
        pass

    def arrive(self, topic: str, values: Mapping[str, Any], t_ns: int = 0) -> None:
        """Have a message arrive."""
        found = self.inputs[topic]
        assert found.incoming.kind is not None
        found.incoming.put(ArrivedMessage(t_ns, 0, encode(found.incoming.kind, values)))


def base(stage: Stage, **topics: Any) -> Ros2Base:
    out = {"drive": {"topic": "cmd_vel", "type": "auto"}}
    return Ros2Base(NODE, json.dumps({"in": topics, "out": out}), connection=stage)  # type: ignore[arg-type]


def device(stage: Stage, fields: Any, commands: Any = None) -> Ros2Device:
    topics = json.dumps({"in": fields, "out": commands or {}})
    return Ros2Device(NODE, topics, connection=stage)  # type: ignore[arg-type]


def moving(**pose: Any) -> dict[str, Any]:
    """Return an odometry."""
    return {
        "pose": {"pose": {"position": {"x": 1.5, "y": -2.0}, "orientation": TURNED, **pose}},
        "twist": {"twist": {"linear": {"x": 0.3, "y": 0.4}, "angular": {"z": math.pi}}},
    }


def test_a_base_reports_in_mm_and_degrees_from_north() -> None:
    stage = Stage()
    driver = base(stage, odom=ODOM)
    assert driver.state() is None
    stage.arrive("odom", moving(), 77)
    state = driver.state()
    assert state is not None
    assert (state.t_ns, state.x, state.y) == (77, 1500.0, -2000.0)
    assert state.heading == pytest.approx(0.0, abs=1e-9)
    assert (state.speed, state.sideways_speed, state.wheel_speed) == (300.0, 400.0, 500.0)
    assert state.turn_rate == pytest.approx(180.0)
    assert not state.front_bumper
    assert driver.state() is state
    stage.arrive("odom", moving())
    assert driver.state() is not state


@pytest.mark.parametrize(
    "pose", [{"position": {"x": math.nan}}, {"position": {"x": math.inf}}, {"orientation": {}}]
)
def test_an_odometry_that_is_none_is_refused(pose: Any) -> None:
    stage = Stage()
    driver = base(stage, odom=ODOM)
    stage.arrive("odom", moving(**pose))
    assert driver.state() is None
    assert driver.problem is not None
    assert driver.problem.startswith("odom: ")
    stage.arrive("odom", moving())
    assert driver.state() is not None
    assert driver.problem is None


def test_bumpers_are_as_old_as_their_messages() -> None:
    stage = Stage()
    touch = {"topic": "touch", "type": BOOL}
    driver = base(stage, odom=ODOM, front_bumper=touch)
    stage.arrive("odom", moving(), 77)
    assert driver.state() is None
    stage.arrive("touch", {"data": True}, 33)
    state = driver.state()
    assert state is not None
    assert (state.t_ns, state.front_bumper, state.rear_bumper) == (33, True, False)


def test_a_base_at_rest_is_stopped_once_until_it_is_driven_again() -> None:
    stage = Stage()
    rover = base(stage)
    for _ in range(3):
        rover.rest()
    assert stage.stopped == ["cmd_vel"]
    rover.drive(100.0, 0.0)
    rover.stop()
    rover.rest()
    assert stage.stopped == ["cmd_vel"] * 2
    rover.drive(0.0, 0.0)
    rover.rest()
    assert stage.stopped == ["cmd_vel"] * 3


def test_a_base_drives_in_m_and_rad() -> None:
    stage = Stage()
    driver = base(stage)
    driver.drive(250.0, 180.0, -500.0)
    assert struct.unpack("<6d", stage.decided["cmd_vel"]) == (0.25, -0.5, 0.0, 0.0, 0.0, math.pi)
    assert driver.state() is None
    driver.stop()
    assert stage.stopped == ["cmd_vel"]


FIELDS: list[tuple[str, dict[str, Any], dict[str, Any], Any]] = [
    ("std_msgs/msg/Float64", {}, {"data": 1.5}, 1.5),
    ("std_msgs/msg/Float64", {}, {"data": math.nan}, None),
    ("std_msgs/msg/Int32", {}, {"data": 3}, 3.0),
    (BOOL, {"bool": True}, {"data": True}, True),
    ("sensor_msgs/msg/Joy", {"path": "buttons[0]", "bool": True}, {"buttons": [2]}, True),
    ("sensor_msgs/msg/Joy", {"path": "axes"}, {"axes": [0.5, math.nan]}, (0.5, None)),
    ("sensor_msgs/msg/Joy", {"path": "buttons", "bool": True}, {"buttons": [0, 1]}, (False, True)),
    (STRING, {"members": {"a": 0.0, "b": 7.0}}, {"data": "b"}, 7.0),
    ("sensor_msgs/msg/BatteryState", {}, {"percentage": 0.5}, 0.5),
    ("sensor_msgs/msg/Range", {}, {"min_range": 0.5, "max_range": 4.0, "range": 1.5}, 1.5),
    ("sensor_msgs/msg/Range", {}, {"min_range": 0.5, "max_range": 4.0, "range": math.inf}, math.inf),
    ("sensor_msgs/msg/Range", {}, {"min_range": 0.5, "max_range": 4.0, "range": -math.inf}, 0.0),
    ("sensor_msgs/msg/Range", {}, {"min_range": 0.5, "max_range": 4.0}, None),
    ("sensor_msgs/msg/Range", {"zero": "no_echo"}, {"min_range": 0.5, "max_range": 4.0}, math.inf),
    ("geometry_msgs/msg/TwistStamped", {"path": "twist.linear.x"}, {"twist": {"linear": {"x": 0.5}}}, 0.5),
    (
        "sensor_msgs/msg/Imu",
        {"path": "orientation.yaw"},
        {"orientation_covariance": [-1.0] * 9},
        None,
    ),
]


@pytest.mark.parametrize(("type_", "options", "values", "expected"), FIELDS)
def test_a_field_is_a_part_of_the_newest_message(
    type_: str, options: dict[str, Any], values: dict[str, Any], expected: Any
) -> None:
    stage = Stage()
    driver = device(stage, {"f": {"topic": "t", "type": type_, **options}})
    assert driver.fields() == {"f": None}
    stage.arrive("t", values)
    found = driver.fields()["f"]
    assert (None if found is None else found.value) == expected
    assert driver.problem is None
    stage.is_paused = True
    assert driver.fields() == {"f": None}


@pytest.mark.parametrize(
    ("type_", "options", "values", "why"),
    [
        (STRING, {"members": {"a": 0.0}}, {"data": "b"}, 't: "b" is no member of the enum'),
        (STRING, {}, {"data": "b"}, 't: "b" is no member of the enum'),
        (BOOL, {"path": "level"}, {}, "t: it has no `level`"),
        ("sensor_msgs/msg/Joy", {"path": "axes[3]"}, {}, "t: it has no `axes[3]`"),
        (
            "geometry_msgs/msg/Twist",
            {"path": "linear"},
            {},
            "t: `linear` is a message; name one of its fields",
        ),
        (
            "sensor_msgs/msg/LaserScan",
            {"bearings_deg": [0], "spacing_deg": 1},
            {"ranges": [1.0], "range_max": 0.0},
            "t: ranges from 0 to 0 m",
        ),
    ],
)
def test_a_field_that_the_message_has_not_is_a_problem(
    type_: str, options: dict[str, Any], values: dict[str, Any], why: str
) -> None:
    stage = Stage()
    driver = device(stage, {"f": {"topic": "t", "type": type_, **options}})
    stage.arrive("t", values)
    assert driver.fields() == {"f": None}
    assert driver.problem == why


@pytest.mark.parametrize(
    ("type_", "options", "values", "expected"),
    [
        (BOOL, {}, {"on": True}, {"data": True}),
        ("std_msgs/msg/Int32", {}, {"level": 3.0}, {"data": 3}),
        (STRING, {"members": {"a": 0.0, "b": 7.0}}, {"mode": 7.0}, {"data": "b"}),
        ("geometry_msgs/msg/Vector3", {}, {"x": 1.0, "z": 2.0}, {"x": 1.0, "y": 0.0, "z": 2.0}),
    ],
)
def test_a_command_is_a_message(type_: str, options: Any, values: Any, expected: Any) -> None:
    stage = Stage()
    driver = device(stage, {}, {"c": {"topic": "t", "type": type_, **options}})
    assert driver.commands == {"c"}
    driver.command("c", values)
    assert decode(structure(type_, STANDARD), stage.decided["t"]) == expected


def test_a_command_of_a_device_may_be_a_twist() -> None:
    stage = Stage()
    driver = device(stage, {}, {"c": {"topic": "t", "type": "auto", "parameters": {"up": "linear.z"}}})
    driver.command("c", {"velocity": 0.5, "up": 0.25})
    assert struct.unpack("<6d", stage.decided["t"]) == (0.5, 0.0, 0.25, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="a twist has no `down`"):
        driver.command("c", {"down": 1.0})
    driver.safe()
    assert stage.stopped == ["t"]


GOTO = {"topic": "go", "type": "a/action/Go", "parameters": {"on": "data"}}
GOAL = {**GOTO, "members": {"idle": 0.0, "sent": 1.0, "executing": 2.0}}


def test_an_action_is_a_command_with_the_state_of_its_goal_and_feedback() -> None:
    stage = Stage()
    fields = {"state": {**GOAL, "path": "status"}, "flag": {**GOTO, "path": "data", "bool": True}}
    driver = device(stage, fields, {"go": GOTO})
    assert driver.fields() == {"state": None, "flag": None}
    (action,) = stage.actions
    action.note(GoalState(0, "idle"))
    driver.command("go", {"on": True})
    driver.command("go", {"on": True})
    assert stage.decided["go"] == (1).to_bytes(4, "little") + encode(
        structure(BOOL, STANDARD), {"data": True}
    )
    action.note(GoalState(1, "executing"))
    stage.arrive("go", {"data": True})
    found = {name: None if reading is None else reading.value for name, reading in driver.fields().items()}
    assert found == {"state": 2.0, "flag": True}
    action.note(GoalState(1, "lost"))
    assert driver.fields()["state"] is None
    assert driver.problem == 'go: "lost" is no member of the enum'
    driver.safe()
    assert stage.stopped == ["go"]
    state = driver.fields()["state"]
    assert state is not None
    assert state.value == 0.0
    assert driver.fields()["flag"] is None


def test_a_bridge_is_started_in_the_environment_of_the_robot() -> None:
    given = {"LD_LIBRARY_PATH": "x", "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1", "HOME": "h"}
    setup = NodeSettings(setup="/opt/my ros/setup.bash")
    assert setup.command(7)[:2] == ["bash", "-c"]
    assert setup.command(7)[2].startswith("source '/opt/my ros/setup.bash' && exec python3 ")
    assert setup.environment(given) == {"HOME": "h"}
    assert NodeSettings(python="/p").command(7)[0] == "/p"
    assert NodeSettings(python="/p").environment(given) == {"HOME": "h"}
    assert NodeSettings().command(7)[0] == "/usr/bin/python3"
    assert NodeSettings().environment({"LD_LIBRARY_PATH": "x"}) == {"LD_LIBRARY_PATH": "x"}


# --- another controller ---------------------------------------------------------------------------

TWIST = "geometry_msgs/msg/Twist"


def listening(stage: Stage) -> tuple[Ros2Base, Ros2Device]:
    """Return a base and a device that command nothing."""
    drive = {"topic": "cmd_vel", "type": TWIST, "names": ["velocity", "turn"]}
    lamp = {"topic": "lamp", "type": STRING, "names": ["colour"], "members": {"red": 1.0}}
    found = [
        driver(NODE, json.dumps({"in": {}, "out": out}), listen=True, connection=stage)  # type: ignore[operator]
        for driver, out in ((Ros2Base, {"drive": drive}), (Ros2Device, {"lamp": lamp}))
    ]
    return found[0], found[1]


def test_a_driver_that_listens_commands_nothing() -> None:
    stage = Stage()
    for driver in listening(stage):
        driver.stop() if isinstance(driver, Ros2Base) else driver.safe()
        assert driver.unreached is None
    assert (stage.decided, stage.stopped) == ({}, [])
    with pytest.raises(ConnectionError):
        listening(stage)[0].drive(100.0, 0.0)


def test_a_driver_that_listens_has_no_client_of_an_action_since_that_cancels_goals() -> None:
    stage = Stage()
    goto = {"topic": "fibonacci", "type": "test_msgs/action/Fibonacci"}
    given = {"in": {"status": {**goto, "path": "status"}}, "out": {"goto": goto}}
    device = Ros2Device(NODE, json.dumps(given), listen=True, connection=stage)  # type: ignore[arg-type]
    assert device.fields() == {"status": None}
    device.safe()
    assert (stage.actions, stage.decided, stage.stopped) == ([], {}, [])


def test_commands_are_heard_in_the_units_of_commands_until_their_timeout() -> None:
    stage = Stage()
    base, lamp = listening(stage)
    assert base.overheard() == {"drive": None}
    stage.arrive("cmd_vel", {"linear": {"x": 0.25}, "angular": {"z": math.pi}}, 100)
    stage.arrive("lamp", {"data": "red"}, 100)
    stage.at_ns = 250_000_100
    assert base.overheard() == {"drive": ({"velocity": 250.0, "turn": pytest.approx(180.0)}, 250_000_000)}
    assert lamp.overheard() == {"lamp": ({"colour": 1.0}, 250_000_000)}
    stage.at_ns += 1
    assert base.overheard() == {"drive": None}
    assert lamp.overheard() == {"lamp": ({"colour": 1.0}, 250_000_001)}  # its stop is to stay as it is
    stage.at_ns = 100
    stage.is_paused = True
    assert base.overheard() == {"drive": None}


@pytest.mark.parametrize("values", [{"data": "blue"}, {"data": ""}])
def test_a_command_that_is_none_is_named(values: Any) -> None:
    stage = Stage()
    _, lamp = listening(stage)
    stage.at_ns = 0
    stage.arrive("lamp", values)
    assert lamp.overheard() == {"lamp": None}
    assert lamp.problem is not None
    assert "is no member of the enum" in lamp.problem
