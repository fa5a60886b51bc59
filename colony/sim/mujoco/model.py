"""The MuJoCo model of a robot among walls, as MJCF text.

A round hull stands on two wheels and two ball casters, all by contact, and motors turn the wheels: what moves
the robot is the friction of its tires. A body says neither what a robot weighs nor how large its wheels are;
the constants below say what is assumed (docs/physics.md).

Lengths are in m, angles in rad; x is east, y north, z up. In the robot's frame x is ahead, y to the left, and
the origin is on the floor below the middle of the axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from numpy.typing import NDArray

from colony.body.devices import CameraSpec, CeilingCameraSpec, JointSpec, Proximity
from colony.body.model import Body, Omnidirectional, radius_mm

TIMESTEP_S = 0.002
"""Step of the integration, which is explicit.

MuJoCo's contacts do not know of the damping that its implicit integrators add: with these motors the hull
would outrun its wheels.
"""

GRAVITY_M_S2 = 9.81

DENSITY_KG_M3 = 500.0
"""Mass of the hull per volume: 80 kg for `amr`, as warehouse robots of its size weigh."""

MAX_WHEEL_RADIUS_M = 0.075
"""Radius of the wheels; less where the hull is low."""

TREAD_M = 0.02
"""Half the width of a wheel. Wheels are crowned: they touch the floor in a point, a wheel base apart."""

WHEEL_DENSITY_KG_M3 = 2000.0

ROTOR_KG_M2 = 0.04
"""Inertia of a motor at its wheel: that of a rotor of 1e-4 kg m^2 behind a gear of 20 to 1."""

TIRE_SETTLING_S = 0.006
"""Time constant of the contact of tires: firm, so that a wheel rolls on nearly its full radius."""

CASTER_SETTLING_S = 0.1
"""Time constant of the contact of casters: sprung, so that the weight is on the wheels."""

CASTER_RADIUS_M = 0.02

TIRE_FRICTION = 0.9
"""Friction of polyurethane tires on a dry, sealed floor."""

HULL_FRICTION = 0.2
"""Friction of a hull on a wall: bumpers are smooth, so that robots slide along walls."""

TRACTION = 0.8
"""Torque of a motor, as a part of what its tire holds: motors stall before tires slip."""

SETTLING_S = 0.01
"""Time constant with which the speed of the wheels settles: far below a ramp's time, far above the step."""

WALL_M = 0.01
"""Thickness of a wall, behind its face."""

WALL_HEIGHT_M = 2.5

BEAM_HEIGHT_M = 0.05
"""Height of a scanner's beams above the hull."""

BUMPER_SKIN_M = 0.001
"""Distance from the hull that counts as contact, as in `colony.sim.world.base`."""

LIFT_KG = 10.0
LIFT_RAD_S = 200.0
"""Frequency of a platform on its spindle, which is critically damped: it sinks by a quarter of a mm."""

WALLS, ROBOT, FLOOR = range(3)
"""Groups of geoms: rays are cast at walls and floor."""

_ON_FLOOR, _ON_WALLS = 1, 2  # bits of contacts


class Part(NamedTuple):
    """The names of the parts that the simulation asks for."""

    robot: str = "robot"
    hull: str = "hull"
    left: str = "left wheel"
    right: str = "right wheel"


PART = Part()


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotDynamics:
    """The sizes and masses of a robot, from its body; in m, kg, N m and rad.

    Attributes:
        radius: that of the hull.
        height: of the hull's top above the floor.
        clearance: of the hull's bottom.
        wheel_base: distance between the points where the wheels touch the floor.
        wheel_radius: that of the wheels.
        mass: that of the hull, without wheels and lifts.
        torque: the most that a motor does.
        damping: the torque of a motor per rad/s by which its wheel is too slow.
        turn_settling_s: as `SETTLING_S`, for a robot that turns in place.
    """

    radius: float
    height: float
    clearance: float
    wheel_base: float
    wheel_radius: float
    mass: float
    torque: float
    damping: float
    turn_settling_s: float


def build_of(body: Body) -> RobotDynamics:
    """Return the build of a robot.

    Raises:
        ValueError: it has sonars, cameras or other wheels, none of which is simulated, or its wheels do not
            fit.
    """
    for server, described in body.servers.items():
        if isinstance(described.simulated, Proximity | CameraSpec | CeilingCameraSpec):
            raise ValueError(f"MuJoCo simulates no sonars and no cameras, such as that of {server}")
    if isinstance(body.chassis.drive, Omnidirectional) or body.chassis.drive.wheel_base_mm is None:
        raise ValueError(
            "MuJoCo simulates two driven wheels, with the `wheel_base` of the body, and no others"
        )
    radius, height = radius_mm(body) / 1e3, body.chassis.height_mm / 1e3
    wheel_base = body.chassis.drive.wheel_base_mm / 1e3
    wheel_radius = min(MAX_WHEEL_RADIUS_M, 0.4 * height)
    if math.hypot(wheel_base / 2.0 + TREAD_M, wheel_radius) > radius:
        raise ValueError(f"wheels {wheel_base:g} m apart are not under a hull with a radius of {radius:g} m")
    clearance = 0.4 * wheel_radius
    mass = DENSITY_KG_M3 * math.pi * radius**2 * (height - clearance)
    inertia = mass / 2.0 * wheel_radius**2 + ROTOR_KG_M2
    turn_inertia = mass * (radius * wheel_radius / wheel_base) ** 2 + ROTOR_KG_M2
    damping = inertia / SETTLING_S
    return RobotDynamics(
        radius=radius,
        height=height,
        clearance=clearance,
        wheel_base=wheel_base,
        wheel_radius=wheel_radius,
        mass=mass,
        torque=TRACTION * TIRE_FRICTION * mass * GRAVITY_M_S2 / 2.0 * wheel_radius,
        damping=damping,
        turn_settling_s=turn_inertia / damping,
    )


def lifts_of(body: Body) -> dict[str, JointSpec]:
    """Return the joints along a line, by the names of their servers: MuJoCo moves them."""
    devices = {name: server.simulated for name, server in body.servers.items()}
    return {name: device for name, device in devices.items() if isinstance(device, JointSpec)}


def mjcf(body: Body, walls: NDArray[np.float64], pose: tuple[float, float, float]) -> str:
    """Return the model of a robot among walls, as MJCF.

    Args:
        body: the robot's body.
        walls: (n, 4), x0, y0, x1, y1 in mm, with the free space to the right, as `walls_of` gives them.
        pose: where the robot begins: x and y in mm, heading in degrees.

    Raises:
        ValueError: the robot cannot be simulated; see `build_of`.
    """
    build = build_of(body)
    root = Element("mujoco", model=body.robot.name)
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(
        root,
        "option",
        timestep=_text(TIMESTEP_S),
        gravity=_text(0.0, 0.0, -GRAVITY_M_S2),
        integrator="Euler",
        cone="elliptic",
        impratio="10",
    )
    world = SubElement(root, "worldbody")
    _geom(world, type="plane", size="0 0 1", group=FLOOR, contype=_ON_FLOOR, conaffinity=0)
    for wall in walls:
        _add_wall(world, wall)
    actuators = Element("actuator")
    _add_robot(world, actuators, build, pose)
    robot = world[-1]
    for name, lift in lifts_of(body).items():
        _add_lift(robot, actuators, build, name, lift)
    root.append(actuators)
    return tostring(root, encoding="unicode")


def _add_wall(world: Element, wall: NDArray[np.float64]) -> None:
    """Add a box whose face is the wall."""
    x0, y0, x1, y1 = (float(value) / 1e3 for value in wall)
    length, angle = math.hypot(x1 - x0, y1 - y0), math.atan2(y1 - y0, x1 - x0)
    left_x, left_y = -math.sin(angle) * WALL_M / 2.0, math.cos(angle) * WALL_M / 2.0
    _geom(
        world,
        type="box",
        size=_text(length / 2.0, WALL_M / 2.0, WALL_HEIGHT_M / 2.0),
        pos=_text((x0 + x1) / 2.0 + left_x, (y0 + y1) / 2.0 + left_y, WALL_HEIGHT_M / 2.0),
        euler=_text(0.0, 0.0, angle),
        group=WALLS,
        contype=_ON_WALLS,
        conaffinity=0,
    )


def _add_robot(
    world: Element, actuators: Element, build: RobotDynamics, pose: tuple[float, float, float]
) -> None:
    """Add the hull with its wheels, motors and casters."""
    x, y, heading_deg = pose
    robot = SubElement(
        world,
        "body",
        name=PART.robot,
        pos=_text(x / 1e3, y / 1e3, 0.0),
        euler=_text(0.0, 0.0, math.radians(heading_deg + 90.0)),
    )
    SubElement(robot, "freejoint")
    half = (build.height - build.clearance) / 2.0
    _geom(
        robot,
        name=PART.hull,
        type="cylinder",
        size=_text(build.radius, half),
        pos=_text(0.0, 0.0, build.clearance + half),
        mass=_text(build.mass),
        group=ROBOT,
        contype=0,
        conaffinity=_ON_WALLS,
        priority=1,
        friction=_text(HULL_FRICTION, 0.0, 0.0),
        margin=_text(BUMPER_SKIN_M),
        gap=_text(BUMPER_SKIN_M),
    )
    for ahead in (-1.0, 1.0):
        _geom(
            robot,
            type="sphere",
            size=_text(CASTER_RADIUS_M),
            pos=_text(ahead * (build.radius - 2.0 * CASTER_RADIUS_M), 0.0, CASTER_RADIUS_M),
            mass=_text(0.0),
            group=ROBOT,
            contype=0,
            conaffinity=_ON_FLOOR,
            priority=1,
            condim=1,
            solref=_text(CASTER_SETTLING_S, 1.0),
        )
    for name, left in ((PART.left, 1.0), (PART.right, -1.0)):
        _add_wheel(robot, build, name, left)
        SubElement(
            actuators,
            "velocity",
            name=name,
            joint=name,
            kv=_text(build.damping),
            forcerange=_text(-build.torque, build.torque),
        )


def _add_wheel(robot: Element, build: RobotDynamics, name: str, left: float) -> None:
    place = _text(0.0, left * build.wheel_base / 2.0, build.wheel_radius)
    wheel = SubElement(robot, "body", name=name, pos=place)
    SubElement(wheel, "joint", name=name, type="hinge", axis="0 1 0", armature=_text(ROTOR_KG_M2))
    _geom(
        wheel,
        type="ellipsoid",
        size=_text(build.wheel_radius, TREAD_M, build.wheel_radius),
        density=_text(WHEEL_DENSITY_KG_M3),
        group=ROBOT,
        contype=0,
        conaffinity=_ON_FLOOR,
        priority=1,
        condim=3,
        friction=_text(TIRE_FRICTION, 0.0, 0.0),
        solref=_text(TIRE_SETTLING_S, 1.0),
    )


def _add_lift(robot: Element, actuators: Element, build: RobotDynamics, name: str, lift: JointSpec) -> None:
    """Add a platform on the hull, which carries its load up and down."""
    low, high = (end / 1e3 for end in lift.ends)
    platform = SubElement(robot, "body", name=name, pos=_text(0.0, 0.0, build.height))
    mass = LIFT_KG + lift.load
    SubElement(platform, "joint", name=name, type="slide", axis="0 0 1", ref=_text(low))
    _geom(
        platform,
        type="box",
        size=_text(build.radius / 2.0, build.radius / 2.0, 0.01),
        mass=_text(mass),
        group=ROBOT,
        contype=0,
        conaffinity=0,
    )
    SubElement(
        actuators,
        "position",
        name=name,
        joint=name,
        kp=_text(mass * LIFT_RAD_S**2),
        kv=_text(2.0 * mass * LIFT_RAD_S),
        ctrlrange=_text(low, high),
    )


def _geom(parent: Element, **attributes: str | int) -> None:
    SubElement(parent, "geom", {name: str(value) for name, value in attributes.items()})


def _text(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)
