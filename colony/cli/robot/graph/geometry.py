"""The geometry of a robot from its URDF and its static transforms: hull, wheels, places of frames.

A transform maps from the axes of a child frame to those of its parent; x ahead, y to the left, z up, in m.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple
from xml.etree import ElementTree

MAX_CHARACTERS = 5_000_000
"""Maximum number of characters of a URDF."""

MAX_FRAMES = 1000
"""Maximum number of frames from a frame to the root of its tree."""

CIRCLE_POINTS = 24
"""Number of points that stand for the rim of a cylinder or a sphere."""

Vector = tuple[float, float, float]


class Transform(NamedTuple):
    """A rotation, as the rows of its matrix, and then a translation."""

    rows: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    place: Vector = (0.0, 0.0, 0.0)

    def apply(self, point: Vector) -> Vector:
        """Return a point of the child in the axes of the parent."""
        x, y, z = [_dot(row, point) + offset for row, offset in zip(self.rows, self.place, strict=True)]
        return x, y, z

    def after(self, inner: Transform) -> Transform:
        """Return the transform that applies `inner` first."""
        columns = [tuple(row[i] for row in inner.rows) for i in range(3)]
        rows = [tuple(_dot(row, column) for column in columns) for row in self.rows]
        return Transform(_rows(rows), self.apply(inner.place))

    def inverse(self) -> Transform:
        """Return the transform from the parent to the child."""
        turned = Transform(_rows([tuple(row[i] for row in self.rows) for i in range(3)]))
        x, y, z = turned.apply(self.place)
        return Transform(turned.rows, (-x, -y, -z))


def _dot(a: Iterable[float], b: Iterable[float]) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))


def _rows(rows: Iterable[Iterable[float]]) -> tuple[Vector, Vector, Vector]:
    first, second, third = [(x, y, z) for x, y, z in rows]
    return first, second, third


def of_angles(roll: float, pitch: float, yaw: float, place: Vector = (0.0, 0.0, 0.0)) -> Transform:
    """Return the transform of roll, pitch and yaw, about fixed axes, in rad."""
    (a, b), (c, d), (e, f) = [(math.cos(angle), math.sin(angle)) for angle in (roll, pitch, yaw)]
    rows = (
        (e * c, e * d * b - f * a, e * d * a + f * b),
        (f * c, f * d * b + e * a, f * d * a - e * b),
        (-d, c * b, c * a),
    )
    return Transform(rows, place)


def of_message(transform: Mapping[str, Any]) -> Transform:
    """Return the transform of a message; without a turn if its quaternion is no rotation."""
    x, y, z, w = [float(transform["rotation"][key]) for key in "xyzw"]
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    place = tuple(float(transform["translation"][key]) for key in "xyz")
    if not 0.5 <= norm <= 2.0:
        return Transform(place=(place[0], place[1], place[2]))
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return Transform(rows, (place[0], place[1], place[2]))


# --- frames ---------------------------------------------------------------------------------------


class Frames:
    """The frames of a robot as a tree. Mutable: joints are added."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Transform]] = {}

    def add(self, parent: str, child: str, transform: Transform) -> None:
        """Add a joint, unless the place of the child is known already."""
        self._parents.setdefault(child.lstrip("/"), (parent.lstrip("/"), transform))

    def add_messages(self, messages: Iterable[Mapping[str, Any]]) -> None:
        """Add the transforms of messages of /tf_static, of which the newest is the last."""
        for message in reversed(list(messages)):
            for each in message["transforms"]:
                parent, child = each["header"]["frame_id"], each["child_frame_id"]
                self.add(parent, child, of_message(each["transform"]))

    def between(self, base: str, frame: str) -> Transform | None:
        """Return the transform from `frame` to `base`; None if they are not connected."""
        (base_root, to_base), (frame_root, to_frame) = self._from_root(base), self._from_root(frame)
        return to_base.inverse().after(to_frame) if base_root == frame_root else None

    def _from_root(self, frame: str) -> tuple[str, Transform]:
        name, found = frame.lstrip("/"), Transform()
        for _ in range(MAX_FRAMES):
            if name not in self._parents:
                break
            name, transform = self._parents[name]
            found = transform.after(found)
        return name, found


# --- URDF -----------------------------------------------------------------------------------------


class Urdf:
    """A URDF that was read.

    `name` is that of the robot, `frames` has its joints, movable ones as they are at 0.
    """

    def __init__(self, text: str) -> None:
        """Read a URDF.

        Raises:
            ValueError: it is none, or has a document type, which could define entities.
        """
        if len(text) > MAX_CHARACTERS or "<!DOCTYPE" in text:
            raise ValueError("it is larger than a URDF, or has a document type")
        try:
            root = ElementTree.fromstring(text)
        except ElementTree.ParseError as problem:
            raise ValueError(f"it is not XML: {problem}") from None
        self.name = root.get("name", "")
        self.frames = Frames()
        self._root = root
        self._joints = [
            (joint, _link(joint, "parent"), _link(joint, "child")) for joint in root.findall("joint")
        ]
        for joint, parent, child in self._joints:
            self.frames.add(parent, child, _origin(joint))

    def hull(self, base: str) -> tuple[float, float] | None:
        """Return the radius of the hull around a frame, and its height above it, in m.

        The hull is that of the collision geometry, of its boxes, cylinders and spheres; None without any.
        """
        points = [point for link in self._root.findall("link") for point in self._points(link, base)]
        if not points:
            return None
        return max(math.hypot(x, y) for x, y, _ in points), max(z for _, _, z in points)

    def wheel_base(self, base: str) -> float | None:
        """Return the distance between left and right wheels in m, or None."""
        places = [
            place.place[1]
            for joint, _, child in self._joints
            if _is_wheel(joint, child) and (place := self.frames.between(base, child)) is not None
        ]
        width = max(places, default=0.0) - min(places, default=0.0)
        return width or None

    def _points(self, link: ElementTree.Element, base: str) -> Iterator[Vector]:
        place = self.frames.between(base, link.get("name", ""))
        for collision in link.findall("collision") if place is not None else ():
            geometry = collision.find("geometry")
            shape = None if geometry is None else next(iter(geometry), None)
            if shape is not None and place is not None:
                inner = place.after(_origin(collision))
                yield from map(inner.apply, _corners(shape))


def _is_wheel(joint: ElementTree.Element, child: str) -> bool:
    names = f"{joint.get('name', '')} {child}".lower()
    return joint.get("type") == "continuous" and "wheel" in names and "caster" not in names


def _link(joint: ElementTree.Element, tag: str) -> str:
    found = joint.find(tag)
    return "" if found is None else found.get("link", "")


def _origin(element: ElementTree.Element) -> Transform:
    origin = element.find("origin")
    if origin is None:
        return Transform()
    roll, pitch, yaw = _numbers(origin.get("rpy", "0 0 0"))
    return of_angles(roll, pitch, yaw, _numbers(origin.get("xyz", "0 0 0")))


def _numbers(text: str) -> Vector:
    try:
        x, y, z = [float(word) for word in text.split()]
    except ValueError:
        raise ValueError(f"`{text[:40]}` is not three numbers") from None
    return x, y, z


def _corners(shape: ElementTree.Element) -> list[Vector]:
    """Return points that a shape is the hull of; none for a mesh."""
    try:
        if shape.tag == "box":
            x, y, z = [side / 2.0 for side in _numbers(shape.get("size", ""))]
            return [(a * x, b * y, c * z) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
        if shape.tag not in ("cylinder", "sphere"):
            return []
        radius = float(shape.get("radius", ""))
        half = float(shape.get("length", "")) / 2.0 if shape.tag == "cylinder" else radius
    except ValueError:
        return []
    angles = [math.tau * i / CIRCLE_POINTS for i in range(CIRCLE_POINTS)]
    rims = (-half, half) if shape.tag == "cylinder" else (0.0,)
    ends = [] if shape.tag == "cylinder" else [(0.0, 0.0, -half), (0.0, 0.0, half)]
    return [(radius * math.cos(a), radius * math.sin(a), z) for a in angles for z in rims] + ends
