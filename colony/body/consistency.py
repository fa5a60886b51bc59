"""Contradictions within a body, which has otherwise been read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Protocol

from colony.body.devices import Base, Camera, CeilingCamera, Lidar, Proximity
from colony.body.model import Body, Circle, Polygon
from colony.ir.bearings import Bearings
from colony.text.diagnostics import Diagnostic, error
from colony.text.source import Span

COMMON_SERVERS = ("DServer", "Runtime")
"""The servers that every robot has; they are no part of a body."""


class Located(Protocol):
    """The places of a body's keys and values."""

    def key(self, *keys: str) -> Span:
        """Return the span of a key."""
        ...

    def value(self, *keys: str) -> Span:
        """Return the span of a value."""
        ...


def contradictions(body: Body, places: Located) -> Iterator[Diagnostic]:
    """Yield an error for each part of a body that contradicts another."""
    yield from _footprint(body, places)
    for name, server in body.servers.items():
        keys = ("server", name)
        if name in COMMON_SERVERS:
            hint = "its variables need no table"
            yield error("B009", places.key(*keys), f"every robot has `{name}`; a body does not say so", hint)
        elif server.simulated is None and server.hardware is None:
            hint = 'write `simulated = { device = "..." }` or `hardware = { driver = "module:Class" }`'
            yield error(
                "B009", places.key(*keys), f"`{name}` has no device: neither simulated nor real", hint
            )
        match server.simulated:
            case Proximity() as ring:
                yield from _proximity(ring, body, places, (*keys, "simulated"))
            case Lidar() as lidar:
                yield from _turn(lidar.bearings(), lidar.count, places, (*keys, "simulated"))
            case Base() | Camera() | CeilingCamera() | None:
                pass
        for field, of_field in server.fields.items():
            if of_field.blocked and of_field.no_echo_mm is None:
                where = (*keys, "fields", field, "blocked")
                message = f"`{name}.{field}` has blocked bearings and no `no_echo`, which their elements read"
                yield error("B009", places.key(*where), message, 'give `no_echo`, such as `no_echo = "12 m"`')


def _footprint(body: Body, places: Located) -> Iterator[Diagnostic]:
    footprint = body.chassis.footprint
    if isinstance(footprint, Circle):
        return
    where = places.value("body", "footprint", "corners")
    sides = _sides(footprint)
    pairs = zip(sides, (*sides[1:], sides[0]), strict=True)
    turns = [x * next_y - y * next_x for (x, y), (next_x, next_y) in pairs]
    if area_mm2(footprint) <= 0.0:
        hint = "list them in the order in which one passes them to the left"
        yield error("B009", where, "the corners do not go around the footprint counterclockwise", hint)
    elif min(turns) < 0.0:
        yield error("B009", where, "the footprint is not convex", "leave out the corners that are inside")
    elif _turned_deg(sides) > 540.0:
        hint = "list each of them once"
        yield error("B009", where, "the corners go around the footprint more than once", hint)


def _turned_deg(sides: list[tuple[float, float]]) -> float:
    """Return by how much the sides of a convex polygon turn in all: 360 deg for each time around."""
    directions = [math.atan2(y, x) for x, y in sides if x or y]
    pairs = zip(directions, (*directions[1:], directions[0]), strict=True)
    return math.degrees(sum((after - before) % math.tau for before, after in pairs))


def _sides(polygon: Polygon) -> list[tuple[float, float]]:
    """Return the sides of a polygon, from each corner to the next, in mm."""
    corners = polygon.corners
    pairs = zip(corners, (*corners[1:], corners[0]), strict=True)
    return [(b.x_mm - a.x_mm, b.y_mm - a.y_mm) for a, b in pairs]


def area_mm2(polygon: Polygon) -> float:
    """Return the area that corners enclose, positive where they go counterclockwise."""
    corners = polygon.corners
    pairs = zip(corners, (*corners[1:], corners[0]), strict=True)
    return sum(a.x_mm * b.y_mm - b.x_mm * a.y_mm for a, b in pairs) / 2.0


def _proximity(ring: Proximity, body: Body, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    yield from _turn(ring.bearings(), ring.count, places, keys)
    footprint = body.chassis.footprint
    if isinstance(footprint, Circle) and ring.ring_mm > footprint.radius_mm:
        message = (
            f"the ring of {ring.ring_mm:g} mm is outside the footprint, whose radius is "
            f"{footprint.radius_mm:g} mm"
        )
        yield error("B009", places.value(*keys, "ring"), message)
    if ring.sonar.nearest_mm >= ring.sonar.range_mm:
        message = f"the smallest reading, {ring.sonar.nearest_mm:g} mm, is not below the one without an echo"
        yield error("B009", places.value(*keys, "sonar", "nearest"), message)
    beyond = [k for k in ring.infrared.wired or () if k >= ring.count]
    if beyond:
        message = f"`wired` has element {beyond[0]}; the ring has elements 0 to {ring.count - 1}"
        yield error("B009", places.value(*keys, "infrared", "wired"), message)


def _turn(
    bearings: Bearings | None, count: int, places: Located, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    if bearings is None:
        message = f"{count} elements take more than a turn"
        yield error("B009", places.value(*keys, "step"), message, f"the step is at most {360 / count:g} deg")


def radius_mm(body: Body) -> float:
    """Return the radius of the circle around the robot's center that contains its footprint."""
    match body.chassis.footprint:
        case Circle(radius_mm=radius):
            return radius
        case Polygon(corners=corners):
            return max(math.hypot(*corner) for corner in corners)
