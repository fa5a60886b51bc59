"""The simulated devices of a robot, as its body describes them.

A pose is that of the device on the robot: x ahead of the center, y to the left of it, and the direction in
which it looks, counterclockwise from ahead. Bearings are those of the interface, which stand there, too;
`colony robot check` compares both.
"""

from colony.body.devices.base import Base, OmnidirectionalBase
from colony.body.devices.battery import Battery
from colony.body.devices.bumper import Bumper
from colony.body.devices.button import Button
from colony.body.devices.cameras import Camera, CeilingCamera, Size
from colony.body.devices.cliff import Cliff
from colony.body.devices.common import CENTER, Place, Pose
from colony.body.devices.compass import Compass
from colony.body.devices.dock_sensor import DockSensor
from colony.body.devices.encoders import Encoders
from colony.body.devices.imu import AccelerationErrors, Imu, TurnErrors
from colony.body.devices.joint import Joint, RotaryJoint
from colony.body.devices.lidar import Lidar
from colony.body.devices.output import Output
from colony.body.devices.proximity import Infrared, Proximity, Sonar
from colony.body.devices.range_finder import RangeFinder
from colony.body.devices.value import ValueField, Values

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
