"""Bags of rosbag2, written for tests."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

from colony.ir.ros2_messages import STANDARD
from colony.ros2.bags import CLOCK_DEFINITION
from colony.ros2.cdr import Definition, encode, structure

START_NS = 1_700_000_000_000_000_000
SCAN, ODOM = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"


class Written(NamedTuple):
    """A message that the recorder received `t_s` after the beginning."""

    t_s: float
    topic: str
    type: str
    values: Mapping[str, Any]


def write(
    path: Path,
    messages: Iterable[Written],
    *,
    storage: Literal["mcap", "sqlite3"] = "mcap",
    compression: Literal["none", "file", "message", "storage"] = "none",
    others: Mapping[str, Definition] | None = None,
    definition: str = "uint8 placeholder",
) -> Path:
    """Write a bag into a new folder, and return it."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    definitions = {**STANDARD, **CLOCK_DEFINITION, **(others or {})}
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    connections: dict[tuple[str, str], Any] = {}
    with writer:
        for message in messages:
            key = message.topic, message.type
            if key not in connections:
                connections[key] = writer.add_connection(*key, msgdef=definition, rihs01="RIHS01_0")
            data = encode(structure(message.type, definitions), message.values)
            writer.write(connections[key], START_NS + round(message.t_s * 1e9), data)
    return path


def stamp(t_s: float, frame: str = "") -> dict[str, Any]:
    """Return the header of a message that was measured at a time of the bag."""
    ns = START_NS + round(t_s * 1e9)
    return {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": frame}


def scan(t_s: float, ahead_m: float = 3.0, *, beams: int = 360, header: Any = None) -> Written:
    """Return a scan in which all is `ahead_m` away."""
    values = {
        "header": stamp(t_s, "laser") if header is None else header,
        "angle_min": -math.pi,
        "angle_max": math.pi,
        "angle_increment": math.tau / beams,
        "range_min": 0.1,
        "range_max": 12.0,
        "ranges": [ahead_m] * beams,
    }
    return Written(t_s, "/scan", SCAN, values)


def odom(t_s: float, x_m: float = 0.0) -> Written:
    """Return an odometry."""
    pose = {"position": {"x": x_m}, "orientation": {"w": 1.0}}
    return Written(t_s, "/odom", ODOM, {"header": stamp(t_s), "pose": {"pose": pose}})


def twist(t_s: float, velocity: float, turn: float = 0.0) -> Written:
    """Return a command of the controller, in m/s and rad/s."""
    values = {"linear": {"x": velocity}, "angular": {"z": turn}}
    return Written(t_s, "/cmd_vel", TWIST, values)


def hall(seconds: float, rate: float = 20.0, *, beams: int = 360) -> Iterator[Written]:
    """Yield a robot's messages: a controller drives ahead, whatever the scan says.

    Each 10 s begin with 2 s in which something is 0.4 m away.
    """
    battery = {"percentage": 0.75}
    for i in range(round(seconds * rate)):
        t_s = i / rate
        if i % rate == 0:
            yield Written(t_s, "/battery", "sensor_msgs/msg/BatteryState", battery)
            yield Written(t_s, "/mode", "std_msgs/msg/String", {"data": "automatic"})
            yield Written(t_s, "/estop", "std_msgs/msg/Bool", {"data": False})
        yield scan(t_s + 0.001, 0.4 if t_s % 10.0 < 2.0 else 3.0, beams=beams)
        yield odom(t_s + 0.002, 0.2 * t_s)
        yield twist(t_s + 0.01, 0.2)


def corridor() -> Iterator[Written]:
    """Yield the messages of docs/ros2.md: somebody drives up to a wall, too near, and turns away."""
    for i in range(800):
        t_s = i / 20
        ahead_m = max(0.2, 3.0 - 0.1 * t_s) if t_s < 30.0 else 3.0
        if i % 20 == 0:
            battery = {"percentage": 0.8}
            yield Written(t_s, "/battery_state", "sensor_msgs/msg/BatteryState", battery)
        yield scan(t_s + 0.001, ahead_m, header=stamp(t_s, "base_scan"))
        yield odom(t_s + 0.002, 0.1 * t_s)
        yield twist(t_s + 0.01, 0.1) if t_s < 28.0 or t_s >= 30.0 else twist(t_s + 0.01, 0.0, 0.8)


if __name__ == "__main__":
    write(Path(sys.argv[1]), corridor())
