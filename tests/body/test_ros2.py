"""Topics of ROS 2 in a body: what is read, what does not fit, and the drivers that follow."""

from __future__ import annotations

import json
from typing import Any

import pytest

from colony.body.disagreements import findings as all_findings
from colony.body.model import Body
from colony.body.reader import body_of_text
from colony.body.servers import in_ros_units, servers_of
from colony.dsl.load import load_text
from colony.ir.program import Robot
from colony.ir.servers import ServerSpec
from colony.runs.ros2_devices import ros2_hardware
from tests.ros2.burger import BODY, GOING, INTERFACE, NAV


def loaded(interface: str = INTERFACE, body: str = BODY) -> tuple[Robot, Body]:
    """Return a robot and its body, which have no errors."""
    file, robot = body_of_text(body, "burger.toml"), load_text(interface).robot
    assert file.body is not None, file.diagnostics
    return robot, file.body


def found(interface: str = INTERFACE, body: str = BODY) -> list[tuple[str, str]]:
    """Return the code and the message of each finding."""
    file = body_of_text(body, "burger.toml")
    return [(d.code, d.message) for d in all_findings(load_text(interface).robot, file)]


def test_interface_and_topics_agree() -> None:
    assert found() == []


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "alone = true",
            "alone = 1",
            ("B006", "`server.RServer.ros2.drive.alone` is 1; expected true or false"),
        ),
        ('topic = "odom", ', "", ("B004", "`server.RServer.ros2.odom` has no `topic`")),
        ("msg/Odometry", "Odometry", ("B006", "expected `PACKAGE/msg/NAME`")),
        ('frame = "laser"', 'qos = "loud"', ("B006", "expected `best_effort`, `reliable` or `latched`")),
        ("ros2.odom ", "ros2.odm ", ("B009", "`RServer` has no topic `odm`")),
        (
            '"nav_msgs/msg/Odometry"',
            '"std_msgs/msg/Bool"',
            ("B009", "`odom` of a base is not std_msgs/msg/Bool"),
        ),
        (
            "[server.Lidar]",
            '[server.Lidar]\nhardware = { driver = "a:b" }',
            ("B009", "`Lidar` has a driver and topics of ROS 2"),
        ),
        ('unit = "number"', 'unit = "furlong"', ("B007", "`furlong` is not a unit")),
        ('unit = "number"', 'unit = "m"', ("R003", "but the command takes mm")),
        ('"sensor_msgs/msg/LaserScan"', '"auto"', ("B009", "a sensor cannot read the type `auto`")),
        ("ros2.mode ", "ros2.modus ", ("B018", "nothing in the interface reads or commands `Panel.modus`")),
        ("[server.Battery]", "[server.Camera]\n[server.Battery]", ("B009", "`Camera` has no device")),
        (
            'unit = "number", stop = "zero"',
            'parameters = { level = "value" }',
            ("B009", "std_msgs/msg/Float64 has no `value`: it has `data`"),
        ),
        (
            '"std_msgs/msg/Float64", unit = "number"',
            '"geometry_msgs/msg/Twist"',
            ("B009", "a twist has no `level`: it has `linear.x`"),
        ),
        (
            '"sensor_msgs/msg/BatteryState"',
            '"sensor_msgs/msg/BatteryState", path = "voltages"',
            ("B009", "sensor_msgs/msg/BatteryState has no `voltages`: did you mean `voltage`?"),
        ),
        (
            "[server.Lidar]",
            'ros2.bumper = { topic = "bump", type = "std_msgs/msg/Bool", path = "on" }\n[server.Lidar]',
            ("B009", "std_msgs/msg/Bool has no `on`: it has `data`"),
        ),
        ('python = "PYTHON"', "domain = 500", ("B008", "`ros2.domain` is 500; expected 0 to 232")),
    ],
)
def test_what_does_not_fit_is_found(old: str, new: str, expected: tuple[str, str]) -> None:
    assert old in BODY
    codes = [(code, message) for code, message in found(body=BODY.replace(old, new)) if code == expected[0]]
    assert any(expected[1] in message for _, message in codes), found(body=BODY.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (": m   bearing -180 deg step 5 deg", ": m", ("B014", "`ranges` has no bearings, and reads a scan")),
        (": m   bearing", ": kg   bearing", ("R003", "`ranges`: Lidar.scan is mm")),
        (
            "{ level : percent range 0 .. 100 }  to Panel.lamp ",
            "{ level : percent }  to Panel.light ",
            ("R004", ""),
        ),
        (
            "Panel.estop ",
            "Panel.lamp ",
            ("B009", "`Panel.lamp` is both read and commanded, and has one topic"),
        ),
    ],
)
def test_what_the_interface_wants_otherwise_is_found(old: str, new: str, expected: tuple[str, str]) -> None:
    assert old in INTERFACE
    messages = found(interface=INTERFACE.replace(old, new))
    assert any(code == expected[0] and expected[1] in message for code, message in messages), messages


def spec(name: str) -> ServerSpec:
    """Return a server as its driver serves it."""
    robot, body = loaded()
    (found_spec,) = [s for s in servers_of(body, robot) if s.name == name]
    return in_ros_units(found_spec, body.servers[name], robot)


def test_numbers_of_drivers_are_in_the_units_of_ros() -> None:
    assert [f.factor for f in spec("Lidar").fields] == [1000.0]
    assert [f.factor for f in spec("Battery").fields] == [1.0]  # a fraction, although declared in percent
    assert [p.factor for c in spec("Panel").commands for p in c.parameters] == [1.0]
    robot, body = loaded(body=BODY.replace('unit = "number", ', ""))
    panel = next(s for s in servers_of(body, robot) if s.name == "Panel")
    declared = in_ros_units(panel, body.servers["Panel"], robot)
    assert [p.factor for c in declared.commands for p in c.parameters] == [0.01]


def options(server: str, body: str = BODY) -> Any:
    """Return the topics that a driver gets."""
    robot, read = loaded(body=body)
    hardware = ros2_hardware(server, read, robot)
    assert hardware.process == "ros2"
    assert json.loads(str(hardware.options["node"]))["python"] == "PYTHON"
    return hardware.driver, json.loads(str(hardware.options["topics"]))


def test_the_node_has_the_name_that_is_given_or_that_of_the_robot() -> None:
    for body, name in ((BODY, "burger"), (BODY.replace("[ros2]", '[ros2]\nname = "other"'), "other")):
        robot, read = loaded(body=body)
        assert json.loads(str(ros2_hardware("Lidar", read, robot).options["node"]))["name"] == name


def test_drivers_get_their_topics_and_what_the_interface_says_of_them() -> None:
    driver, topics = options("RServer", BODY.replace("alone = true", 'alone = true, timeout = "0.1 s"'))
    assert driver == "colony.ros2.drivers:Ros2Base"
    assert topics["in"].keys() == {"odom"}
    drive = topics["out"]["drive"]
    assert (drive["topic"], drive["type"], drive["alone"], drive["timeout_ns"]) == (
        "cmd_vel",
        "auto",
        True,
        10**8,
    )
    driver, topics = options("Lidar", BODY.replace('"laser"', '"laser", pose = ["1 mm", "0 mm", "90 deg"]'))
    assert driver == "colony.ros2.drivers:Ros2Device"
    scan = topics["in"]["scan"]
    assert scan["bearings_deg"][:3] == [-180.0, -175.0, -170.0]
    assert (scan["spacing_deg"], scan["mounted_deg"], scan["frame"]) == (5.0, 90.0, "laser")
    _, topics = options("Panel")
    assert topics["in"]["mode"]["members"] == {"manual": 0.0, "automatic": 1.0}
    assert topics["in"]["estop"]["bool"]
    assert topics["out"]["lamp"]["stop"] == "zero"


# --- actions --------------------------------------------------------------------------------------


def test_an_action_is_a_command_and_its_feedback_are_fields() -> None:
    assert found(GOING, BODY + NAV) == []
    robot, body = loaded(GOING, BODY + NAV)
    (nav,) = [s for s in servers_of(body, robot) if s.name == "Nav"]
    nav = in_ros_units(nav, body.servers["Nav"], robot)
    assert {f.name: f.factor for f in nav.fields} == {
        "status": 1.0,
        "distance_remaining": 1000.0,
        "tries": 1.0,
    }
    (goto,) = nav.commands
    assert [(p.name, round(p.factor, 2)) for p in goto.parameters] == [
        ("x", 1000),
        ("y", 1000),
        ("heading", 57.3),
    ]
    topics = json.loads(str(ros2_hardware("Nav", body, robot).options["topics"]))
    assert topics["out"]["goto"]["topic"] == "navigate_to_pose"
    assert topics["out"]["goto"]["frame"] == "map"
    assert topics["out"]["goto"]["parameters"] == {
        "x": "pose.pose.position.x",
        "y": "pose.pose.position.y",
        "heading": "pose.pose.orientation.heading",
    }
    paths = {name: topic["path"] for name, topic in topics["in"].items()}
    assert paths == {
        "status": "status",
        "distance_remaining": "distance_remaining",
        "tries": "number_of_recoveries",
    }
    assert topics["in"]["status"]["members"]["lost"] == 7.0


@pytest.mark.parametrize(
    ("old", "new", "code", "message"),
    [
        (
            "ros2.goto.action",
            'ros2.goto.topic = "t"\nros2.goto.action',
            "B009",
            "`goto` is both a topic and an action",
        ),
        ("ros2.goto.action ", "ros2.goto.topic ", "B009", "which is not that of a topic"),
        ("nav2_msgs/action", "nav2_msgs/msg", "B009", "which is not that of an action"),
        (
            "[server.Nav]",
            '[server.Nav]\nros2.other = { action = "b", type = "b/action/B" }',
            "B009",
            "`other` and `goto` are actions: a server has one",
        ),
        ("[server.Nav]\n", "", "B009", "a base has no actions"),
    ],
)
def test_a_key_is_a_topic_or_an_action(old: str, new: str, code: str, message: str) -> None:
    body = BODY + NAV.replace(old, new)
    if not new:
        bumper = NAV.partition("]\n")[2].replace("goto", "bumper")
        body = BODY.replace("ros2.odom ", f"{bumper}ros2.odom ")
    messages = found(GOING, body)
    assert any(found_code == code and message in text for found_code, text in messages), messages


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "idle hold",
            "idle goto(x = 0, y = 0, heading = 0)",
            "`goto` is the goal of an action, and is idle without one",
        ),
        (", lost = 7", "", "`journey` is the state of a goal, and lacks `lost`"),
        ("journey : goal", "journey : number", "`journey` is the state of a goal, and lacks `idle`, "),
    ],
)
def test_a_goal_and_its_state_are_declared_as_such(old: str, new: str, message: str) -> None:
    messages = found(GOING.replace(old, new), BODY + NAV)
    assert any(code == "B009" and message in text for code, text in messages), messages
