"""What a picture of a robot shows, as data: its footprint, and where each element of its sensors looks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from colony.body.devices import (
    BumperSpec,
    CameraSpec,
    CeilingCameraSpec,
    CliffSpec,
    Device,
    Directed,
    DockSensorSpec,
    LidarSpec,
    MountPoint,
    MountPose,
    Proximity,
    RangeFinder,
)
from colony.body.model import Body, Circle, Drive, FieldTable, Omnidirectional, Polygon, radius_mm
from colony.ir.bearings import Bearings, between, sweep
from colony.ir.program import Robot, Sensor
from colony.ir.types import Array, bearings_of
from colony.view.polar import PicturePoint, Sector, outline, point, sectors

WIDEST_BEAM_DEG = 15.0
"""The largest width of an element whose device does not say how wide it is."""

BUMPER_REACH = 1.08
"""Reach of the sectors of a bumper in a picture, in radii of the hull."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Beam:
    """The field of view of an element, on the floor.

    Attributes:
        origin: where it begins, in mm.
        sector: the bearings, seen from there.
        reach_mm: how far it reaches from there; None for as far as the picture, 0 for one that looks down.
    """

    origin: PicturePoint
    sector: Sector
    reach_mm: float | None

    def outline(self, farthest_mm: float) -> list[PicturePoint]:
        """Return the corners, in mm; one that reaches as far as the picture ends at `farthest_mm`."""
        reach = farthest_mm if self.reach_mm is None else min(self.reach_mm, farthest_mm)
        return [
            PicturePoint(self.origin.x + corner.x, self.origin.y + corner.y)
            for corner in outline(self.sector, 0.0, reach)
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorView:
    """A sensor: its name, a note for the legend, and its elements."""

    name: str
    note: str
    beams: tuple[Beam, ...]


class Wheel(NamedTuple):
    """A driven wheel: its place in mm, and the bearing in degrees along which it rolls."""

    place: PicturePoint
    bearing_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotScene:
    """A robot seen from above, ahead up: x to the right and y ahead, in mm.

    Attributes:
        title: what the picture is called.
        footprint: the corners of the outline.
        radius_mm: the radius of the circle around it.
        wheels: the driven wheels.
        sensors: the arrays that look along bearings, then the sensors of docks and the cameras.
        lines: what is not drawn.
    """

    title: str
    footprint: tuple[PicturePoint, ...]
    radius_mm: float
    wheels: tuple[Wheel, ...]
    sensors: tuple[SensorView, ...]
    lines: tuple[str, ...]

    @property
    def farthest_mm(self) -> float:
        """The farthest reach of a sensor, or twice the robot's radius if it has none."""
        reaches = [beam.reach_mm or 0.0 for sensor in self.sensors for beam in sensor.beams]
        return max([2.0 * self.radius_mm, *reaches])


def robot_scene(robot: Robot, body: Body) -> RobotScene:
    """Return the scene of a robot, from its interface and its body."""
    return RobotScene(
        title=robot.name,
        footprint=_footprint(body),
        radius_mm=radius_mm(body),
        wheels=tuple(_wheels(body.chassis.drive)),
        sensors=(*_sensors(robot, body), *_dock_sensors(body), *_cameras(body)),
        lines=tuple(_lines(body)),
    )


def _wheels(drive: Drive) -> Iterator[Wheel]:
    """Yield the driven wheels that are described, from left to right on each axle."""
    wheel_distance = drive.wheel_distance_mm if isinstance(drive, Omnidirectional) else 0.0
    if drive.wheel_base_mm is not None and wheel_distance is not None:
        for y in dict.fromkeys((wheel_distance / 2.0, -wheel_distance / 2.0)):
            for x in (-drive.wheel_base_mm / 2.0, drive.wheel_base_mm / 2.0):
                yield Wheel(PicturePoint(x, y), 0.0)
    for wheel in drive.wheels if isinstance(drive, Omnidirectional) else ():
        yield Wheel(PicturePoint(-wheel.y_mm, wheel.x_mm), wheel.bearing_deg)


def _footprint(body: Body) -> tuple[PicturePoint, ...]:
    match body.chassis.footprint:
        case Circle(radius_mm=radius):
            return tuple(point(bearing, radius) for bearing in range(0, 360, 5))
        case Polygon(corners=corners):
            return tuple(PicturePoint(-corner.y_mm, corner.x_mm) for corner in corners)


def _sensors(robot: Robot, body: Body) -> Iterator[SensorView]:
    """Yield the arrays with bearings, and those whose device has bearings, places or sectors."""
    for sensor in robot.sensors:
        server = body.servers.get(sensor.server)
        if server is None or not isinstance(sensor.type, Array):
            continue
        device = server.simulated
        if device is not None and sensor.field not in {f.name for f in device.fields}:
            device = None
        if isinstance(device, CliffSpec):
            down = tuple(Beam(origin=_place(p), sector=Sector(0.0, 0.0), reach_mm=0.0) for p in device.places)
            yield SensorView(name=sensor.name, note=f"{len(down)} elements, downward", beams=down)
            continue
        if isinstance(device, BumperSpec):
            felt = tuple(_felt(device, radius_mm(body)))
            yield SensorView(name=sensor.name, note=f"{len(felt)} sectors", beams=felt)
            continue
        bearings = _bearings(device) or bearings_of(sensor.type)
        if bearings is None:
            continue
        beams = tuple(_beams(sensor, device, bearings, server.fields.get(sensor.field)))
        reach = beams[0].reach_mm if beams else None
        note = f"{len(beams)} of {sensor.type.size} elements" if len(beams) < sensor.type.size else ""
        note = note or f"{sensor.type.size} elements"
        note += "" if reach is None else f", {reach / 1000.0:g} m"
        yield SensorView(name=sensor.name, note=note, beams=beams)


def _felt(bumper: BumperSpec, radius: float) -> Iterator[Beam]:
    """Yield the sectors of a bumper, which stand out of the hull a little."""
    for first, last in bumper.sectors:
        sector = Sector(first, first + float(sweep(first, last)))
        yield Beam(origin=PicturePoint(0.0, 0.0), sector=sector, reach_mm=BUMPER_REACH * radius)


def _bearings(device: Device | None) -> Bearings | None:
    return device.bearings() if isinstance(device, Directed) else None


def _beams(
    sensor: Sensor, device: Device | None, bearings: Bearings, field: FieldTable | None
) -> Iterator[Beam]:
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
            case LidarSpec():
                yield Beam(origin=_place(device.pose), sector=wedges[i], reach_mm=device.range_mm)
            case RangeFinder(poses=poses, half_beam_deg=half):
                cone = Sector(angle - half, angle + half)
                yield Beam(origin=_place(poses[i]), sector=cone, reach_mm=device.range_mm)
            case _:
                yield Beam(origin=PicturePoint(0.0, 0.0), sector=wedges[i], reach_mm=sensor.high)


def _cameras(body: Body) -> Iterator[SensorView]:
    for name, server in body.servers.items():
        if isinstance(camera := server.simulated, CameraSpec):
            bearing, half = camera.pose.bearing_deg, camera.view_deg / 2.0
            sector = Sector(bearing - half, bearing + half)
            beam = Beam(origin=_place(camera.pose), sector=sector, reach_mm=None)
            yield SensorView(name=name, note=f"camera, {camera.view_deg:g}°", beams=(beam,))


def _dock_sensors(body: Body) -> Iterator[SensorView]:
    for name, server in body.servers.items():
        if isinstance(sensor := server.simulated, DockSensorSpec):
            bearing, half = sensor.pose.bearing_deg, sensor.view_deg / 2.0
            sector = Sector(bearing - half, bearing + half)
            beam = Beam(origin=_place(sensor.pose), sector=sector, reach_mm=sensor.range_mm)
            note = f"docks, {sensor.view_deg:g}°, {sensor.range_mm / 1000.0:g} m"
            yield SensorView(name=name, note=note, beams=(beam,))


def _place(place: MountPose | MountPoint) -> PicturePoint:
    return PicturePoint(-place.y_mm, place.x_mm)


def _lines(body: Body) -> Iterator[str]:
    upward = [n for n, server in body.servers.items() if isinstance(server.simulated, CeilingCameraSpec)]
    if upward:
        yield f"looks up: {', '.join(upward)}"
