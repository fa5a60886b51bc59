"""The simulated devices of a robot, as its body describes them.

A pose is that of the device on the robot: x ahead of the center, y to the left of it, and the direction in
which it looks, counterclockwise from ahead. Bearings are those of the interface, which stand there, too;
`colony robot check` compares both.
"""

from colony.body.devices.actuators import BaseSpec, JointSpec, OmnidirectionalBase, Output, RotaryJoint
from colony.body.devices.common import CENTER, MountPoint, MountPose
from colony.body.devices.ranging import (
    CameraSpec,
    CeilingCameraSpec,
    Infrared,
    LidarSpec,
    Proximity,
    RangeFinder,
    Size,
    Sonar,
)
from colony.body.devices.sensors import (
    AccelerationErrors,
    BatterySpec,
    BumperSpec,
    Button,
    CliffSpec,
    CompassSpec,
    DockSensorSpec,
    EncodersSpec,
    ImuSpec,
    TurnErrors,
    ValueField,
    ValuesSpec,
)

Device = (
    BaseSpec
    | Proximity
    | LidarSpec
    | RangeFinder
    | BumperSpec
    | ImuSpec
    | CompassSpec
    | EncodersSpec
    | CameraSpec
    | CeilingCameraSpec
    | CliffSpec
    | DockSensorSpec
    | BatterySpec
    | Button
    | JointSpec
    | RotaryJoint
    | Output
    | ValuesSpec
)

Directed = Proximity | LidarSpec | RangeFinder
"""The devices whose elements look along bearings."""

DEVICES: tuple[tuple[str, type], ...] = (
    ("base", BaseSpec),
    ("proximity", Proximity),
    ("lidar", LidarSpec),
    ("range_finder", RangeFinder),
    ("bumper", BumperSpec),
    ("imu", ImuSpec),
    ("compass", CompassSpec),
    ("encoders", EncodersSpec),
    ("camera", CameraSpec),
    ("ceiling_camera", CeilingCameraSpec),
    ("cliff", CliffSpec),
    ("dock_sensor", DockSensorSpec),
    ("battery", BatterySpec),
    ("button", Button),
    ("joint", JointSpec),
    ("rotary_joint", RotaryJoint),
    ("output", Output),
    ("value", ValuesSpec),
)
"""The devices by their names in a body."""

__all__ = [
    "CENTER",
    "DEVICES",
    "AccelerationErrors",
    "BaseSpec",
    "BatterySpec",
    "BumperSpec",
    "Button",
    "CameraSpec",
    "CeilingCameraSpec",
    "CliffSpec",
    "CompassSpec",
    "Device",
    "Directed",
    "DockSensorSpec",
    "EncodersSpec",
    "ImuSpec",
    "Infrared",
    "JointSpec",
    "LidarSpec",
    "MountPoint",
    "MountPose",
    "OmnidirectionalBase",
    "Output",
    "Proximity",
    "RangeFinder",
    "RotaryJoint",
    "Size",
    "Sonar",
    "TurnErrors",
    "ValueField",
    "ValuesSpec",
]
