"""Translation of RServer's calls into motions of the base, within the allowed range.

The functions are pure. They return the motion and the new settings: the velocity or acceleration of a call
becomes the default of later calls (thesis section 4.6.3). Arguments out of range raise `RefusedError` with
the code "arguments".
"""

from __future__ import annotations

import math
from typing import NamedTuple

from colony.runtime.arbitration import motion
from colony.runtime.arbitration.motion import Motion, Speeds
from colony.runtime.library import robot
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.servers.drivers import BaseLimits


class Range(NamedTuple):
    """The minimum and maximum speeds, as those of `Speeds`, and the maximum accelerations."""

    velocity: tuple[float, float]
    turn: tuple[float, float]
    sideways: tuple[float, float]
    acceleration: float
    turn_acceleration: float

    def clamp(self, speeds: Speeds) -> Speeds:
        """Return the nearest allowed speeds."""
        return Speeds(
            _clamp(speeds.velocity, self.velocity),
            _clamp(speeds.turn, self.turn),
            _clamp(speeds.sideways, self.sideways),
        )


def full_range(limits: BaseLimits) -> Range:
    """Return the full range of a base."""
    return Range(
        (-limits.velocity, limits.velocity),
        (-limits.turn, limits.turn),
        (0.0 - limits.sideways, limits.sideways),
        limits.acceleration,
        limits.turn_acceleration,
    )


class Settings(NamedTuple):
    """The magnitudes set by the last commands, for motion along a path and for turns on the spot."""

    velocity: float
    acceleration: float
    turn_velocity: float
    turn_acceleration: float


def initial_settings(limits: BaseLimits) -> Settings:
    """Return the initial settings, which are slow."""
    return Settings(
        velocity=min(200.0, limits.velocity),
        acceleration=limits.acceleration / 2.0,
        turn_velocity=min(30.0, limits.turn),
        turn_acceleration=limits.turn_acceleration / 2.0,
    )


class Context(NamedTuple):
    """What the motion of a call depends on; `previous` is the motion of the same connection until now."""

    settings: Settings
    allowed: Range
    previous: Motion | None = None


Made = tuple[Motion, Settings]
"""A motion, and the settings after its call."""


def drive(arguments: robot.Drive, context: Context) -> Made:
    """Return a motion at the given speeds."""
    allowed = context.allowed
    velocity = _in_range("velocity", arguments.velocity, allowed.velocity, "mm/s")
    turn = _in_range("turn", arguments.turn, allowed.turn, "deg/s")
    if arguments.sideways and not any(allowed.sideways):
        found = f"sideways is {arguments.sideways:g} mm/s"
        raise RefusedError("arguments", f"{found}; the base does not drive sideways")
    sideways = _in_range("sideways", arguments.sideways, allowed.sideways, "mm/s")
    return motion.ConstantSpeeds(speeds=Speeds(velocity, turn, sideways)), context.settings


def go(arguments: robot.Go, context: Context, *, integrating: bool = True) -> Made:
    """Return a motion straight ahead, with the heading of the `previous` motion if that is straight, too."""
    settings, previous = context.settings, context.previous
    velocity = _in_range("velocity", arguments.velocity, context.allowed.velocity, "mm/s")
    if velocity != 0.0:
        settings = settings._replace(velocity=abs(velocity))
    previous_go = previous if isinstance(previous, motion.Go) else None
    new_motion = motion.Go(
        velocity=velocity,
        acceleration=settings.acceleration,
        integrating=integrating,
        heading=None if previous_go is None else previous_go.heading,
        integral=0.0 if previous_go is None else previous_go.integral,
    )
    return new_motion, settings


def jog(arguments: robot.Jog, context: Context) -> Made:
    """Return a motion that adds a turning rate to the forward speed of the `previous` motion."""
    settings, (low, high) = context.settings, context.allowed.turn
    rate = _in_range("rate", arguments.rate, (-high, -low), "deg/s")
    match context.previous:
        case motion.Go(velocity=velocity) | motion.Jog(velocity=velocity):
            pass
        case motion.ConstantSpeeds(speeds=speeds):
            velocity = speeds.velocity
        case _:
            velocity = 0.0
    new_motion = motion.Jog(
        velocity=velocity,
        rate=rate,
        acceleration=settings.acceleration,
        turn_acceleration=settings.turn_acceleration,
    )
    return new_motion, settings


def halt(arguments: robot.Halt, context: Context) -> Made:
    """Return a stop, immediate or gradual."""
    settings = context.settings
    new_motion = motion.Halt(
        gradual=arguments.mode == 0,
        acceleration=settings.acceleration,
        turn_acceleration=settings.turn_acceleration,
    )
    return new_motion, settings


def move(arguments: robot.Move, context: Context) -> Made:
    """Return a motion over a distance."""
    distance = _finite("distance", arguments.distance)
    low, high = context.allowed.velocity
    settings = _path_settings(arguments, context, high if distance > 0.0 else -low)
    new_motion = motion.Move(
        distance=distance, velocity=settings.velocity, acceleration=settings.acceleration
    )
    return new_motion, settings


def turn(arguments: robot.Turn, context: Context) -> Made:
    """Return a turn by degrees on the spot."""
    degrees, (settings, allowed, _) = _finite("degrees", arguments.degrees), context
    velocity, acceleration = arguments.velocity, arguments.acceleration
    limit = -allowed.turn[0] if degrees > 0.0 else allowed.turn[1]
    settings = settings._replace(
        turn_velocity=_magnitude("velocity", velocity, settings.turn_velocity, limit, "deg/s"),
        turn_acceleration=_magnitude(
            "acceleration", acceleration, settings.turn_acceleration, allowed.turn_acceleration, "deg/s^2"
        ),
    )
    new_motion = motion.Turn(
        degrees=degrees,
        velocity=settings.turn_velocity,
        acceleration=settings.turn_acceleration,
        braking=settings.acceleration,
    )
    return new_motion, settings


def continuous_turn(arguments: robot.ContinuousTurn, context: Context) -> Made:
    """Return a turn by degrees along an arc, slow enough for the allowed turning speed."""
    degrees, radius = _finite("degrees", arguments.degrees), _finite("radius", arguments.radius)
    if radius <= 0.0:
        raise RefusedError("arguments", f"radius is {radius:g} mm; expected more than 0")
    allowed = context.allowed
    limit = -allowed.turn[0] if degrees > 0.0 else allowed.turn[1]
    settings = _path_settings(arguments, context, allowed.velocity[1])
    new_motion = motion.Arc(
        degrees=degrees,
        radius=radius,
        velocity=min(settings.velocity, math.radians(limit) * radius),
        acceleration=settings.acceleration,
    )
    return new_motion, settings


def _path_settings(arguments: robot.Move | robot.ContinuousTurn, context: Context, limit: float) -> Settings:
    settings, most = context.settings, context.allowed.acceleration
    velocity, acceleration = arguments.velocity, arguments.acceleration
    return settings._replace(
        velocity=_magnitude("velocity", velocity, settings.velocity, limit, "mm/s"),
        acceleration=_magnitude("acceleration", acceleration, settings.acceleration, most, "mm/s^2"),
    )


def _clamp(value: float, allowed: tuple[float, float]) -> float:
    return min(max(value, allowed[0]), allowed[1])


def _finite(name: str, value: float) -> float:
    if not math.isfinite(value):
        raise RefusedError("arguments", f"{name} is {value}; expected a finite number")
    return value


def _in_range(name: str, value: float, allowed: tuple[float, float], unit: str) -> float:
    if not (math.isfinite(value) and allowed[0] <= value <= allowed[1]):
        expected = f"expected {allowed[0]:g} to {allowed[1]:g} {unit}"
        raise RefusedError("arguments", f"{name} is {value:g} {unit}; {expected}")
    return value


def _magnitude(name: str, value: float, setting: float, limit: float, unit: str) -> float:
    """Return a call's magnitude or, if it is negative, the setting."""
    if limit <= 0.0:
        raise RefusedError("arguments", f"{name}: the program's range allows no motion in that direction")
    if value < 0.0:
        return min(setting, limit)
    if value == 0.0:
        raise RefusedError(
            "arguments", f"{name} is 0 {unit}; expected above 0, or below 0 to keep the last one"
        )
    return _in_range(name, value, (0.0, limit), unit)
