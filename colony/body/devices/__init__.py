"""The simulated devices of a robot, as its body describes them.

A pose is that of the device on the robot: x ahead of the center, y to the left of it, and the direction in
which it looks, counterclockwise from ahead. Bearings are those of the interface, which stand there, too;
`colony robot check` compares both.
"""

from colony.body.devices.actuators import Base, Joint, OmnidirectionalBase, Output, RotaryJoint
from colony.body.devices.cameras import Camera, CeilingCamera, Size
from colony.body.devices.common import CENTER, Place, Pose
from colony.body.devices.ranging import Infrared, Lidar, Proximity, RangeFinder, Sonar
from colony.body.devices.sensors import (
    AccelerationErrors,
    Battery,
    Bumper,
    Button,
    Cliff,
    Compass,
    DockSensor,
    Encoders,
    Imu,
    TurnErrors,
    ValueField,
    Values,
)

Device = (
    Base
    | Proximity
    | Lidar
    | RangeFinder
    | Bumper
    | Imu
    | Compass
    | Encoders
    | Camera
    | CeilingCamera
    | Cliff
    | DockSensor
    | Battery
    | Button
    | Joint
    | RotaryJoint
    | Output
    | Values
)

Directed = Proximity | Lidar | RangeFinder
"""The devices whose elements look along bearings."""

DEVICES: tuple[tuple[str, type], ...] = (
    ("base", Base),
    ("proximity", Proximity),
    ("lidar", Lidar),
    ("range_finder", RangeFinder),
    ("bumper", Bumper),
    ("imu", Imu),
    ("compass", Compass),
    ("encoders", Encoders),
    ("camera", Camera),
    ("ceiling_camera", CeilingCamera),
    ("cliff", Cliff),
    ("dock_sensor", DockSensor),
    ("battery", Battery),
    ("button", Button),
    ("joint", Joint),
    ("rotary_joint", RotaryJoint),
    ("output", Output),
    ("value", Values),
)
"""The devices by their names in a body."""

__all__ = [
    "CENTER",
    "DEVICES",
    "AccelerationErrors",
    "Base",
    "Battery",
    "Bumper",
    "Button",
    "Camera",
    "CeilingCamera",
    "Cliff",
    "Compass",
    "Device",
    "Directed",
    "DockSensor",
    "Encoders",
    "Imu",
    "Infrared",
    "Joint",
    "Lidar",
    "OmnidirectionalBase",
    "Output",
    "Place",
    "Pose",
    "Proximity",
    "RangeFinder",
    "RotaryJoint",
    "Size",
    "Sonar",
    "TurnErrors",
    "ValueField",
    "Values",
]
