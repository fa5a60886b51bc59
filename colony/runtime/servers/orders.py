"""Translation of calls of RServer into motions of the base, checked against the allowed range.

The functions return the motion, and most of them the new settings: a velocity or acceleration in a call is
the default of later calls that give none (thesis section 4.6.3). Pure; impossible requests are `RefusedError`
with the code "arguments".
"""

from __future__ import annotations

import math
from typing import NamedTuple

from colony.runtime.arbitration import motion
from colony.runtime.arbitration.motion import Ending, Motion, Speeds
from colony.runtime.library import robot
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.servers.drivers import BaseLimits


class Range(NamedTuple):
    """The allowed speeds, lowest and highest, in mm/s and deg/s counterclockwise, and the accelerations."""

    velocity: tuple[float, float]
    turn: tuple[float, float]
    acceleration: float
    turn_acceleration: float

    def clamp(self, speeds: Speeds) -> Speeds:
        """Return the nearest allowed speeds."""
        return Speeds(_within(speeds.velocity, self.velocity), _within(speeds.turn, self.turn))


def whole_range(limits: BaseLimits) -> Range:
    """Return the whole range of a base."""
    return Range(
        (-limits.velocity, limits.velocity),
        (-limits.turn, limits.turn),
        limits.acceleration,
        limits.turn_acceleration,
    )


class Settings(NamedTuple):
    """The settings of the last commands, in magnitudes: along the way, and turning on the spot."""

    velocity: float
    acceleration: float
    turn_velocity: float
    turn_acceleration: float


def first_settings(limits: BaseLimits) -> Settings:
    """Return the initial, unhurried settings."""
    return Settings(
        velocity=min(200.0, limits.velocity),
        acceleration=limits.acceleration / 2.0,
        turn_velocity=min(30.0, limits.turn),
        turn_acceleration=limits.turn_acceleration / 2.0,
    )


def drive(asked: robot.Drive, allowed: Range) -> Motion:
    """Return a motion at both speeds as they are given."""
    velocity = _checked("velocity", asked.velocity, allowed.velocity, "mm/s")
    turn = _checked("turn", asked.turn, allowed.turn, "deg/s")
    return motion.ConstantSpeeds(speeds=Speeds(velocity, turn))


def go(
    asked: robot.Go, settings: Settings, allowed: Range, before: Motion | None, *, integrating: bool
) -> tuple[Motion, Settings]:
    """Return a motion straight ahead; when repeated, it holds the heading that it held `before`."""
    velocity = _checked("velocity", asked.velocity, allowed.velocity, "mm/s")
    if velocity != 0.0:
        settings = settings._replace(velocity=abs(velocity))
    held = before if isinstance(before, motion.Go) else None
    wanted = motion.Go(
        velocity=velocity,
        acceleration=settings.acceleration,
        integrating=integrating,
        heading=None if held is None else held.heading,
        error=0.0 if held is None else held.error,
    )
    return wanted, settings


def jog(asked: robot.Jog, settings: Settings, allowed: Range, before: Motion | None) -> Motion:
    """Return a turning rate on top of the forward motion `before`."""
    low, high = allowed.turn
    rate = _checked("rate", asked.rate, (-high, -low), "deg/s")
    match before:
        case motion.Go(velocity=velocity) | motion.Jog(velocity=velocity):
            pass
        case motion.ConstantSpeeds(speeds=speeds):
            velocity = speeds.velocity
        case _:
            velocity = 0.0
    return motion.Jog(
        velocity=velocity,
        rate=rate,
        acceleration=settings.acceleration,
        turn_acceleration=settings.turn_acceleration,
    )


def halt(asked: robot.Halt, settings: Settings) -> Motion:
    """Return a stop, immediate or gradual."""
    return motion.Halt(
        gradual=asked.mode == 0,
        acceleration=settings.acceleration,
        turn_acceleration=settings.turn_acceleration,
    )


def move(asked: robot.Move, settings: Settings, allowed: Range) -> tuple[Ending, Settings]:
    """Return a motion over a distance."""
    distance = _finite("distance", asked.distance)
    low, high = allowed.velocity
    settings = _along(asked, settings, allowed, high if distance > 0.0 else -low)
    wanted = motion.Move(distance=distance, velocity=settings.velocity, acceleration=settings.acceleration)
    return wanted, settings


def turn(asked: robot.Turn, settings: Settings, allowed: Range) -> tuple[Ending, Settings]:
    """Return a turn by degrees on the spot."""
    degrees = _finite("degrees", asked.degrees)
    most = -allowed.turn[0] if degrees > 0.0 else allowed.turn[1]
    settings = settings._replace(
        turn_velocity=_magnitude("velocity", asked.velocity, settings.turn_velocity, most, "deg/s"),
        turn_acceleration=_magnitude(
            "acceleration",
            asked.acceleration,
            settings.turn_acceleration,
            allowed.turn_acceleration,
            "deg/s^2",
        ),
    )
    wanted = motion.Turn(
        degrees=degrees,
        velocity=settings.turn_velocity,
        acceleration=settings.turn_acceleration,
        braking=settings.acceleration,
    )
    return wanted, settings


def continuous_turn(
    asked: robot.ContinuousTurn, settings: Settings, allowed: Range
) -> tuple[Ending, Settings]:
    """Return a turn by degrees along an arc, no faster than the base may turn."""
    degrees, radius = _finite("degrees", asked.degrees), _finite("radius", asked.radius)
    if radius <= 0.0:
        raise RefusedError("arguments", f"radius is {radius:g} mm; expected more than 0")
    most = -allowed.turn[0] if degrees > 0.0 else allowed.turn[1]
    settings = _along(asked, settings, allowed, allowed.velocity[1])
    wanted = motion.Arc(
        degrees=degrees,
        radius=radius,
        velocity=min(settings.velocity, math.radians(most) * radius),
        acceleration=settings.acceleration,
    )
    return wanted, settings


def _along(
    asked: robot.Move | robot.ContinuousTurn, settings: Settings, allowed: Range, most: float
) -> Settings:
    return settings._replace(
        velocity=_magnitude("velocity", asked.velocity, settings.velocity, most, "mm/s"),
        acceleration=_magnitude(
            "acceleration", asked.acceleration, settings.acceleration, allowed.acceleration, "mm/s^2"
        ),
    )


def _within(value: float, allowed: tuple[float, float]) -> float:
    return min(max(value, allowed[0]), allowed[1])


def _finite(name: str, value: float) -> float:
    if not math.isfinite(value):
        raise RefusedError("arguments", f"{name} is {value}; expected a finite number")
    return value


def _checked(name: str, value: float, allowed: tuple[float, float], unit: str) -> float:
    if not (math.isfinite(value) and allowed[0] <= value <= allowed[1]):
        expected = f"expected {allowed[0]:g} to {allowed[1]:g} {unit}"
        raise RefusedError("arguments", f"{name} is {value:g} {unit}; {expected}")
    return value


def _magnitude(name: str, value: float, kept: float, most: float, unit: str) -> float:
    """Return a given magnitude or, if it is negative, the kept one."""
    if most <= 0.0:
        raise RefusedError("arguments", f"{name}: the program's range leaves no motion that way")
    if value < 0.0:
        return min(kept, most)
    if value == 0.0:
        raise RefusedError("arguments", f"{name} is 0 {unit}; expected more, or less to keep the setting")
    return _checked(name, value, (0.0, most), unit)
