"""Contradictions within the devices of a body, and between each and the robot's shape."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Protocol

from colony.body.devices import (
    Battery,
    Bumper,
    Button,
    Camera,
    Cliff,
    Device,
    DockSensor,
    Encoders,
    Joint,
    Lidar,
    Output,
    Proximity,
    RangeFinder,
    RotaryJoint,
)
from colony.body.footprint import radius_mm
from colony.body.model import Body, Circle, Omnidirectional
from colony.ir.bearings import TURN, too_many_hint, uniform
from colony.text.diagnostics import Diagnostic, Label, error
from colony.text.source import Span
from colony.text.wording import degrees_text

MAX_POSITIONS = 100
"""Maximum number of positions of a joint."""

MAX_OUTPUTS = 100
"""Maximum number of outputs of a device."""

REACH_MM = 2000.0
"""Distance beyond the footprint up to which a device can be on a robot; farther off, a unit is wrong."""


class Located(Protocol):
    """The places of a body's keys and values."""

    def key(self, *keys: str) -> Span:
        """Return the span of a key."""
        ...

    def value(self, *keys: str) -> Span:
        """Return the span of a value."""
        ...


def device_contradictions(
    device: Device | None, body: Body, places: Located, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    """Yield an error for each part of a device that contradicts another part or the body."""
    match device:
        case Proximity() as ring:
            yield from _proximity(ring, body, places, keys)
        case Lidar() as lidar:
            yield from _turn(lidar.step_deg, lidar.count, places, keys)
            yield from _place(lidar.pose[:2], "pose", body, places, keys)
        case RangeFinder() as finder:
            yield from _range_finder(finder, body, places, keys)
        case Bumper() as bumper:
            yield from _bumper(bumper, places, keys)
        case Camera(pose=pose) | DockSensor(pose=pose):
            yield from _place(pose[:2], "pose", body, places, keys)
        case Cliff() as cliff:
            for place in cliff.places:
                yield from _place(place, "places", body, places, keys)
        case Joint() as joint:
            yield from _joint(joint, "mm", places, keys)
        case RotaryJoint() as joint:
            yield from _joint(joint, "deg", places, keys)
        case Encoders() as encoders:
            yield from _encoders(encoders, body, places, keys)
        case Output(outputs=outputs) if not 0 < len(outputs) <= MAX_OUTPUTS:
            message = f"{len(outputs)} outputs; expected 1 to {MAX_OUTPUTS}"
            yield error("B009", places.value(*keys, "outputs"), message)
        case Battery() as battery:
            yield from _battery(battery, places, keys)
        case Button(names=names) if len(set(names)) < len(names):
            twice = next(name for i, name in enumerate(names) if name in names[:i])
            yield error("B009", places.value(*keys, "fields"), f"two buttons have the field `{twice}`")
        case _:
            pass


def _place(
    place: tuple[float, ...], key: str, body: Body, places: Located, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    """Yield an error for a place that is not on the robot, nor near it."""
    away, reach = math.hypot(*place), radius_mm(body) + REACH_MM
    if away > reach:
        message = f"a place {away:g} mm from the center of the robot; expected at most {reach:g} mm"
        hint = f"it is more than {REACH_MM:g} mm outside of the footprint: are the units right?"
        yield error("B009", places.value(*keys, key), message, hint)


def _joint(
    joint: Joint | RotaryJoint, unit: str, places: Located, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    low, high = joint.ends
    if low >= high:
        message = f"the range begins at {low:g} {unit}, which is not below its end, {high:g} {unit}"
        yield error("B009", places.value(*keys, "range"), message, "write the lower end first")
        return
    where = places.value(*keys, "positions")
    if joint.positions and joint.control == "velocity":
        message = "a joint that runs at a velocity is not sent to positions"
        hint = 'leave out `positions`, or `control = "velocity"`'
        yield error("B009", where, message, hint)
    if len(joint.positions) > MAX_POSITIONS:
        message = f"{len(joint.positions)} positions; expected at most {MAX_POSITIONS}"
        yield error("B009", where, message)
    for name, position in joint.positions.items():
        if not low <= position <= high:
            message = (
                f"the position `{name}` is at {position:g} {unit}, outside of the range, "
                f"{low:g} to {high:g} {unit}"
            )
            label = Label(places.value(*keys, "range"), "the range of the joint")
            yield error("B009", places.value(*keys, "positions", name), message, None, label)


def _encoders(encoders: Encoders, body: Body, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    wheels = 4 if isinstance(body.chassis.drive, Omnidirectional) else 2
    if encoders.wheels != wheels:
        message = f"encoders of {encoders.wheels} wheels; the drive has {wheels}"
        where = places.value(*keys, "device" if encoders.wheels == 2 else "wheels")
        yield error("B009", where, message, f"write `wheels = {wheels}`")


def _battery(battery: Battery, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    if 0.0 < battery.charger_w <= battery.standing_w:
        message = (
            f"the charger gives {battery.charger_w:g} W, and the robot takes {battery.standing_w:g} W: "
            "it is never charged"
        )
        yield error("B009", places.value(*keys, "charger"), message, "leave it out if there is none")


def _proximity(ring: Proximity, body: Body, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    yield from _turn(ring.step_deg, ring.count, places, keys)
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


def _turn(step_deg: float | None, count: int, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    if step_deg is not None and uniform(0.0, step_deg, count) is None:
        message = f"{count} elements that are {degrees_text(step_deg)} apart take more than a full turn"
        yield error("B009", places.value(*keys, "step"), message, too_many_hint(step_deg, count))


def _range_finder(
    finder: RangeFinder, body: Body, places: Located, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    for pose in finder.poses:
        yield from _place(pose[:2], "poses", body, places, keys)
    if finder.nearest_mm >= finder.range_mm:
        message = f"the smallest reading, {finder.nearest_mm:g} mm, is not below the longest range"
        label = Label(places.value(*keys, "range"), "the longest range")
        yield error("B009", places.value(*keys, "nearest"), message, None, label)


def _bumper(bumper: Bumper, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    """Yield an error for each sector that is none."""
    for first, last in bumper.sectors:
        text = f"`{degrees_text(first)} .. {degrees_text(last)}`"
        if max(abs(first), abs(last)) > TURN:
            message, hint = (
                f"the sector {text} has a bearing of more than a turn",
                "bearings are within 360 deg",
            )
        elif first == last:
            message, hint = f"the sector {text} has no width", "write all bearings as `-180 deg .. 180 deg`"
        else:
            continue
        yield error("B009", places.value(*keys, "sectors"), message, hint)
