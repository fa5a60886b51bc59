"""The servers of a robot that are on topics of ROS 2, as the drivers that serve them.

All of them share a process, and in it a bridge. The drivers are found by name, as those of users are.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import Any

from colony.body.devices import BaseSpec
from colony.body.model import Body
from colony.body.ros2 import DRIVE, Ros2Topic, action_of, field_topic, is_scan, parameter_path
from colony.ir.program import DEFAULT_FRAME_NS, Actuator, Robot, Sensor
from colony.ir.types import BOOL, Enum, bearings_of, element_type
from colony.runtime.assembly.processes.spec import HardwareDriver

BASE, DEVICE = "colony.ros2.drivers:Ros2Base", "colony.ros2.drivers:Ros2Device"

PROCESS = "ros2"
"""Name of the process that the drivers share."""


def ros2_hardware(server: str, body: Body, interface: Robot | None) -> HardwareDriver:
    """Return the driver of a server on topics."""
    sensors: dict[str, Sensor] = {}
    actuators: dict[str, Actuator] = {}
    if interface is not None:
        read = (s for s in reversed(interface.sensors) if s.server == server and s.sent is None)
        sensors = {s.field: s for s in read}
        actuators = {a.command: a for a in interface.actuators if a.server == server}
    is_base = isinstance(body.device(server), BaseSpec)
    topics: dict[str, dict[str, Any]] = {"in": {}, "out": {}}
    given = dict(body.servers[server].ros2)
    if action_of(given) is not None:  # fields without a topic are parts of its feedback
        given |= {name: t for name in sensors if (t := field_topic(given, name)) is not None}
    for name, topic in given.items():
        if name == DRIVE if is_base else name in actuators:
            topics["out"][name] = _command(topic, actuators.get(name))
        else:
            topics["in"][name] = _field(topic, None if is_base else sensors.get(name))
    node = replace(body.ros2, name=body.ros2.name or body.robot.name)
    return HardwareDriver(
        driver=BASE if is_base else DEVICE,
        options={"node": json.dumps(asdict(node)), "topics": json.dumps(topics)},
        process=PROCESS,
        origin=f"server.{server}.ros2",
        frame_ns=DEFAULT_FRAME_NS if interface is None else interface.frame_ns,
    )


def commanded_topics(body: Body) -> dict[tuple[str, str], str]:
    """Return the full names of the topics that a robot commands, by server and command."""
    from colony.ros2.bags import resolved

    return {
        (server, command): resolved(topic.topic, body.ros2.name, body.ros2.namespace)
        for server, table in body.servers.items()
        for command, topic in table.ros2.items()
    }


def is_on_topics(driver: HardwareDriver) -> bool:
    """Return True for a driver over topics of ROS 2."""
    return driver.driver in (BASE, DEVICE)


def _field(topic: Ros2Topic, sensor: Sensor | None) -> dict[str, Any]:
    """Return the options of a field: its topic, and what the interface says of its values."""
    found: dict[str, Any] = {
        "topic": topic.name,
        "type": topic.type,
        "path": topic.path,
        "qos": topic.qos,
        "frame": topic.frame,
        "zero": topic.zero,
    }
    if sensor is None:
        return found
    element = element_type(sensor.type)
    if element == BOOL:
        found["bool"] = True
    elif isinstance(element, Enum):
        found["members"] = dict(element.members)
    bearings = bearings_of(sensor.type)
    if is_scan(topic) and bearings is not None:
        found |= {
            "bearings_deg": bearings.angles,
            "spacing_deg": bearings.spacing,
            "mounted_deg": topic.pose.bearing_deg,
            "upside_down": topic.upside_down,
        }
    return found


def _command(topic: Ros2Topic, actuator: Actuator | None) -> dict[str, Any]:
    """Return the options of a command: its topic, and the parts of its message."""
    found: dict[str, Any] = {
        "topic": topic.name,
        "type": topic.type,
        "qos": topic.qos,
        "frame": topic.frame or ("map" if topic.action else ""),
        "alone": topic.alone,
        "timeout_ns": None if topic.timeout_s is None else round(topic.timeout_s * 1e9),
        "parameters": dict(topic.parameters),
        "names": [] if actuator is None else [field.name for field in actuator.fields],
    }
    if topic.action and actuator is not None:
        found["parameters"] = {f.name: parameter_path(topic, f.name) for f in actuator.fields}
    if topic.stop is not None:
        found["stop"] = topic.stop
    types = [] if actuator is None else [field.type for field in actuator.fields]
    members = next((dict(e.members) for e in types if isinstance(e, Enum)), None)
    return found if members is None else found | {"members": members}
