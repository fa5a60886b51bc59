"""A robot whose body is topics alone, and a behavior that drives it in its room."""

from __future__ import annotations

from pathlib import Path

from colony.body.ros2 import GOAL_STATES

INTERFACE = """
language 1

enum work { manual = 0, automatic = 1 }

robot burger {
  frame    50 ms
  sensor   ranges[72] : m   bearing -180 deg step 5 deg  range 0 .. 12  from Lidar.scan  within 300 ms
  sensor   x : m                                    from RServer.x      within 300 ms
  sensor   battery : percent                        from Battery.charge within 3 s
  sensor   estop : bool                             from Panel.estop    within 3 s
  sensor   mode : work                              from Panel.mode     within 3 s
  actuator drive { velocity : m/s range -0.2 .. 0.2, turn : rad/s range -1.5 .. 1.5 }
           to RServer.drive    idle drive(velocity = 0, turn = 0)
  actuator lamp { level : percent range 0 .. 100 }  to Panel.lamp       idle lamp(level = 0)
}
"""

BODY = """
[robot]
name = "burger"

[body]
footprint = { shape = "circle", radius = "110 mm" }
drive     = { kind = "differential", wheel_base = "160 mm" }

[body.limits]
velocity          = "0.22 m/s"
turn              = "2.8 rad/s"
acceleration      = "1 m/s^2"
turn_acceleration = "6 rad/s^2"

[ros2]
python = "PYTHON"

[server.RServer]
ros2.odom  = { topic = "odom", type = "nav_msgs/msg/Odometry" }
ros2.drive = { topic = "cmd_vel", type = "auto", alone = true }

[server.Lidar]
fields.scan = { no_echo = "12 m", invalid = "hold" }
ros2.scan   = { topic = "scan", type = "sensor_msgs/msg/LaserScan", frame = "laser" }

[server.Battery]
ros2.charge = { topic = "battery", type = "sensor_msgs/msg/BatteryState" }

[server.Panel]
ros2.estop = { topic = "estop", type = "std_msgs/msg/Bool" }
ros2.mode  = { topic = "mode", type = "std_msgs/msg/String" }
ros2.lamp  = { topic = "lamp", type = "std_msgs/msg/Float64", unit = "number", stop = "zero" }
"""

BEHAVIOR = """
language 1
import robot

param clearance = 0.6 m
tunable param reach = 0.5 m in 0.3 m .. 1 m

let is_clear = min(ranges[-30 deg .. 30 deg]) >= clearance
let is_on    = battery > 20 percent and mode == work.automatic

module ahead { when is_on and is_clear  do drive(velocity = 0.2 m/s, turn = 0) }
module avoid { when not is_clear        do drive(velocity = 0, turn = 1 rad/s) }
module halt  { when estop               do drive(velocity = 0, turn = 0) }
module shine { when x > reach           do lamp(level = 50 percent) }
network {
  drive = halt suppresses (avoid suppresses ahead)
  lamp = shine
}
contract clear: not is_clear implies drive.velocity <= 0 m/s
"""

OTHERS = {
    "battery": ["sensor_msgs/msg/BatteryState", {"percentage": 0.75}, "reliable"],
    "estop": ["std_msgs/msg/Bool", {"data": False}, "reliable"],
    "mode": ["std_msgs/msg/String", {"data": "automatic"}, "reliable"],
}
"""Topics of the foreign robot, besides scan and odometry."""


GOALS = f"enum goal {{ {', '.join(f'{state} = {i}' for i, state in enumerate(GOAL_STATES))} }}"
GOING = INTERFACE.replace("enum work", f"{GOALS}\nenum work").replace(
    "  actuator lamp",
    "  sensor   journey : goal  from Nav.status\n"
    "  sensor   left : mm       from Nav.distance_remaining  within 2 s\n"
    "  sensor   tries : number  from Nav.tries               within 2 s\n"
    "  actuator goto { x : m, y : m, heading : deg } to Nav.goto idle hold\n"
    "  actuator lamp",
)
NAV = """
[server.Nav]
ros2.goto.action   = "navigate_to_pose"
ros2.goto.type     = "nav2_msgs/action/NavigateToPose"
ros2.goto.feedback = { tries = "number_of_recoveries" }
"""
"""The robot with Nav2 besides, and what its body adds."""

WALKING = (
    INTERFACE.replace("enum work", f"{GOALS}\nenum work").replace(
        "  actuator lamp",
        "  sensor   journey : goal  from Walk.status  within 1 s\n"
        "  actuator walk { order : number } to Walk.walk idle hold\n"
        "  actuator lamp",
    ),
    BODY + '\n[server.Walk]\nros2.walk = { action = "walk", type = "test_msgs/action/Fibonacci" }\n',
    BEHAVIOR.replace(
        "network {",
        """state arrived = false
next  arrived = arrived or journey == goal.succeeded
module first  { when true                   do walk(order = 1) }
module second { when arrived                do walk(order = 2) }
module rest   { when mode == work.manual }
network {
  walk = rest inhibits (second suppresses first)""",
    ),
)
"""The robot with an action besides, and a behavior with two goals for it."""


def write(folder: Path, python: Path, *, walks: bool = False) -> Path:
    """Write the robot and the behavior into a folder, and return the path of the behavior."""
    interface, body, behavior = WALKING if walks else (INTERFACE, BODY, BEHAVIOR)
    robot = folder / "robots" / "burger"
    robot.mkdir(parents=True)
    (robot / "burger.colony").write_text(interface)
    (robot / "burger.toml").write_text(body.replace("PYTHON", str(python)))
    program = folder / "roam.colony"
    program.write_text(behavior)
    return program
