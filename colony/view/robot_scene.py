"""What a picture of a robot shows, as data: its footprint, and where each element of its sensors looks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import assert_never

from colony.body.consistency import radius_mm
from colony.body.devices import Base, Camera, CeilingCamera, Device, Lidar, Pose, Proximity
from colony.body.model import Body, Circle, Field, Polygon
from colony.ir.bearings import Bearings, between
from colony.ir.program import Robot, Sensor
from colony.ir.types import Array, bearings_of
from colony.view.polar import Point, Sector, outline, point, sectors

WIDEST_BEAM_DEG = 15.0
"""The largest width of an element whose device does not say how wide it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Beam:
    """The field of view of an element, on the floor.

    Attributes:
        origin: where it begins, in mm.
        sector: the bearings, seen from there.
        reach_mm: how far it reaches from there; None for as far as the picture.
    """

    origin: Point
    sector: Sector
    reach_mm: float | None

    def outline(self, farthest_mm: float) -> list[Point]:
        """Return the corners, in mm; one that reaches as far as the picture ends at `farthest_mm`."""
        reach = farthest_mm if self.reach_mm is None else min(self.reach_mm, farthest_mm)
        return [
            Point(self.origin.x + corner.x, self.origin.y + corner.y)
            for corner in outline(self.sector, 0.0, reach)
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorView:
    """A sensor: its name, a note for the legend, and its elements."""

    name: str
    note: str
    beams: tuple[Beam, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotScene:
    """A robot seen from above, ahead up: x to the right and y ahead, in mm.

    Attributes:
        title: what the picture is called.
        footprint: the corners of the outline.
        radius_mm: the radius of the circle around it.
        wheels: the places of the driven wheels.
        sensors: the arrays that look along bearings, then the cameras.
        lines: what is not drawn.
    """

    title: str
    footprint: tuple[Point, ...]
    radius_mm: float
    wheels: tuple[Point, ...]
    sensors: tuple[SensorView, ...]
    lines: tuple[str, ...]

    @property
    def farthest_mm(self) -> float:
        """The farthest reach of a sensor, or twice the robot's radius if it has none."""
        reaches = [beam.reach_mm or 0.0 for sensor in self.sensors for beam in sensor.beams]
        return max([2.0 * self.radius_mm, *reaches])


def robot_scene(robot: Robot, body: Body) -> RobotScene:
    """Return the scene of a robot, from its interface and its body."""
    half_base = body.chassis.drive.wheel_base_mm / 2.0
    return RobotScene(
        title=robot.name,
        footprint=_footprint(body),
        radius_mm=radius_mm(body),
        wheels=(Point(-half_base, 0.0), Point(half_base, 0.0)),
        sensors=(*_sensors(robot, body), *_cameras(body)),
        lines=tuple(_lines(body)),
    )


def _footprint(body: Body) -> tuple[Point, ...]:
    match body.chassis.footprint:
        case Circle(radius_mm=radius):
            return tuple(point(bearing, radius) for bearing in range(0, 360, 5))
        case Polygon(corners=corners):
            return tuple(Point(-corner.y_mm, corner.x_mm) for corner in corners)


def _sensors(robot: Robot, body: Body) -> Iterator[SensorView]:
    """Yield the arrays with bearings, and those whose device has them."""
    for sensor in robot.sensors:
        server = body.servers.get(sensor.server)
        if server is None or not isinstance(sensor.type, Array):
            continue
        device = server.simulated
        if device is not None and sensor.field not in device.fields:
            device = None
        bearings = _bearings(device) or bearings_of(sensor.type)
        if bearings is None:
            continue
        beams = tuple(_beams(sensor, device, bearings, server.fields.get(sensor.field)))
        reach = beams[0].reach_mm if beams else None
        note = f"{len(beams)} of {sensor.type.size} elements" if len(beams) < sensor.type.size else ""
        note = note or f"{sensor.type.size} elements"
        note += "" if reach is None else f", {reach / 1000.0:g} m"
        yield SensorView(name=sensor.name, note=note, beams=beams)


def _bearings(device: Device | None) -> Bearings | None:
    return device.bearings() if isinstance(device, Proximity | Lidar) else None


def _beams(sensor: Sensor, device: Device | None, bearings: Bearings, field: Field | None) -> Iterator[Beam]:
    """Yield the elements that the robot's body does not block."""
    blocked = {
        i for low, high in (() if field is None else field.blocked) for i in between(bearings, low, high)
    }
    wedges = sectors(bearings, WIDEST_BEAM_DEG)
    for i, angle in enumerate(bearings.angles):
        if i in blocked:
            continue
        match device:
            case Proximity() if sensor.field == "sonar":
                half = device.sonar.half_beam_deg
                yield Beam(
                    origin=point(angle, device.ring_mm),
                    sector=Sector(angle - half, angle + half),
                    reach_mm=device.sonar.range_mm,
                )
            case Proximity():
                if device.infrared.wired is None or i in device.infrared.wired:
                    where = point(angle, device.ring_mm)
                    yield Beam(origin=where, sector=Sector(angle, angle), reach_mm=device.infrared.range_mm)
            case Lidar():
                yield Beam(origin=_place(device.pose), sector=wedges[i], reach_mm=device.range_mm)
            case Base() | Camera() | CeilingCamera() | None:
                yield Beam(origin=Point(0.0, 0.0), sector=wedges[i], reach_mm=sensor.high)
            case _:
                assert_never(device)


def _cameras(body: Body) -> Iterator[SensorView]:
    for name, server in body.servers.items():
        if isinstance(camera := server.simulated, Camera):
            bearing, half = camera.pose.bearing_deg, camera.view_deg / 2.0
            sector = Sector(bearing - half, bearing + half)
            beam = Beam(origin=_place(camera.pose), sector=sector, reach_mm=None)
            yield SensorView(name=name, note=f"camera, {camera.view_deg:g}°", beams=(beam,))


def _place(pose: Pose) -> Point:
    return Point(-pose.y_mm, pose.x_mm)


def _lines(body: Body) -> Iterator[str]:
    upward = [n for n, server in body.servers.items() if isinstance(server.simulated, CeilingCamera)]
    if upward:
        yield f"looks up: {', '.join(upward)}"
