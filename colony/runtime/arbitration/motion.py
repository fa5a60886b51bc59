"""Motions of a base: the modes of the Labmate (thesis section 4.6.3), as control laws stepped once a frame.

    joystick              no command yet: the base stands, and the joystick moves it
    go                    straight ahead, the heading held with error integration
    proportional go       the same without integration
    continuous turn       a number of degrees along an arc of a radius
    point-to-point go     a distance, straight, by a trapezoid of speed
    point-to-point turn   a number of degrees on the spot, by a trapezoid of speed
    jog                   a turning rate on top of forward motion

Commands in degrees are positive clockwise, as in the thesis, and so lower the heading, which grows
counterclockwise; the resulting speeds are positive counterclockwise, as a driver's are. The trapezoid brakes
for the remaining distance less what is driven before the next frame, so that it does not overshoot on a base
that brakes as commanded. Every motion with an end ends standing.

A law is a value: `step` returns the speeds of a frame and the law's next value, which is used only if the
speeds were. Pure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, assert_never

Mode = Literal[
    "joystick",
    "go",
    "proportional go",
    "continuous turn",
    "point-to-point go",
    "point-to-point turn",
    "jog",
]

HEADING_GAIN = 2.0
"""Turning rate in deg/s for each degree of heading error."""

INTEGRAL_GAIN = 0.5
"""Turning rate in deg/s for each degree-second of integrated heading error."""

MOST_INTEGRAL = 20.0
"""Limit of the integral, in degree-seconds, so that a base that was blocked does not swing."""

MOST_CORRECTION = 20.0
"""Largest turning rate, in deg/s, that holds a heading."""

NEAR_MM = 1.0
NEAR_DEG = 0.2
"""Tolerances within which a motion is done, in mm and degrees."""

STALLED_S = 2.0
"""Seconds without progress after which a motion is given up."""


class Speeds(NamedTuple):
    """Forward speed in mm/s, turning rate in deg/s counterclockwise."""

    velocity: float
    turn: float


STILL = Speeds(0.0, 0.0)


class OdometerPose(NamedTuple):
    """x and y in mm, heading in degrees counterclockwise from north."""

    x: float
    y: float
    heading: float


class Seen(NamedTuple):
    """The input of a law: the track of the base, the speeds sent last, and the seconds since then.

    The track is None while the base has no value.
    """

    track: OdometerPose | None
    sent: Speeds
    dt_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantSpeeds:
    """Constant speeds, without feedback."""

    speeds: Speeds


@dataclass(frozen=True, slots=True, kw_only=True)
class Go:
    """Motion straight ahead. `heading` is held once it has begun; `error` is the integrated heading error."""

    velocity: float
    acceleration: float
    integrating: bool = True
    heading: float | None = None
    error: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Jog:
    """Forward motion and a turning rate, positive clockwise."""

    velocity: float
    rate: float
    acceleration: float
    turn_acceleration: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Halt:
    """Standstill; reached immediately, or within the accelerations if `gradual`."""

    gradual: bool
    acceleration: float
    turn_acceleration: float


class Progress(NamedTuple):
    """Progress of a motion with an end: its origin, the most covered, and the time without progress."""

    origin: OdometerPose
    done: float = 0.0
    idle_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """Motion of `distance` mm straight ahead, backward if negative; `velocity` is a magnitude."""

    distance: float
    velocity: float
    acceleration: float
    progress: Progress | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """Turn of `degrees` clockwise on the spot; `velocity` in deg/s is a magnitude."""

    degrees: float
    velocity: float
    acceleration: float
    braking: float
    """Deceleration, in mm/s^2, that ends forward motion."""
    progress: Progress | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """Turn of `degrees` clockwise along an arc of `radius` mm, forward at `velocity` mm/s."""

    degrees: float
    radius: float
    velocity: float
    acceleration: float
    progress: Progress | None = None


Motion = ConstantSpeeds | Go | Jog | Halt | Move | Turn | Arc
Ending = Move | Turn | Arc
"""Motions that end by themselves."""

End = Literal["done", "stalled"]


class Step(NamedTuple):
    """The speeds of a frame, the law's next value, and the end of the motion if it has ended."""

    speeds: Speeds
    motion: Motion
    end: End | None = None


def step(motion: Motion, seen: Seen) -> Step:
    """Return one frame of a motion."""
    match motion:
        case ConstantSpeeds():
            return Step(motion.speeds, motion)
        case Go():
            return _go(motion, seen)
        case Jog():
            velocity = approach(seen.sent.velocity, motion.velocity, motion.acceleration * seen.dt_s)
            turn = approach(seen.sent.turn, -motion.rate, motion.turn_acceleration * seen.dt_s)
            return Step(Speeds(velocity, turn), motion)
        case Halt():
            return Step(_halt(motion, seen), motion)
        case Move() | Turn() | Arc():
            return _ending(motion, seen)
        case _:
            assert_never(motion)


def mode(motion: Motion) -> Mode:
    """Return the mode of a base that carries out a motion; a halted base is in go mode."""
    match motion:
        case Go():
            return "go" if motion.integrating else "proportional go"
        case Jog() | ConstantSpeeds():
            return "jog"
        case Halt():
            return "go"
        case Move():
            return "point-to-point go"
        case Turn():
            return "point-to-point turn"
        case Arc():
            return "continuous turn"
        case _:
            assert_never(motion)


def interrupted(motion: Motion) -> Motion:
    """Return a motion after a frame of another party: it holds the heading that it then finds.

    A motion with an end continues with the rest of it.
    """
    if isinstance(motion, Go):
        return replace(motion, heading=None, error=0.0)
    return motion


def covered(motion: Ending, track: OdometerPose | None) -> float:
    """Return how much of a motion is covered, in mm or degrees in the direction commanded."""
    if motion.progress is None or track is None:
        return 0.0
    origin = motion.progress.origin
    if isinstance(motion, Move):
        angle = math.radians(origin.heading)
        along = math.cos(angle) * (track.y - origin.y) - math.sin(angle) * (track.x - origin.x)
        return math.copysign(1.0, motion.distance) * along
    return math.copysign(1.0, motion.degrees) * (origin.heading - track.heading)


def approach(present: float, wanted: float, most: float) -> float:
    """Return `present`, changed toward `wanted` by `most` at most."""
    return present + min(max(wanted - present, -most), most)


def braking_speed(left: float, acceleration: float, dt_s: float) -> float:
    """Return the speed from which a base that keeps it for `dt_s` and then brakes stops within `left`."""
    if left <= 0.0:
        return 0.0
    lag = acceleration * dt_s
    return math.sqrt(lag * lag + 2.0 * acceleration * left) - lag


def _halt(motion: Halt, seen: Seen) -> Speeds:
    if not motion.gradual:
        return STILL
    return Speeds(
        approach(seen.sent.velocity, 0.0, motion.acceleration * seen.dt_s),
        approach(seen.sent.turn, 0.0, motion.turn_acceleration * seen.dt_s),
    )


def _go(motion: Go, seen: Seen) -> Step:
    velocity = approach(seen.sent.velocity, motion.velocity, motion.acceleration * seen.dt_s)
    track = seen.track
    if track is None or velocity == 0.0:
        return Step(Speeds(velocity, 0.0), interrupted(motion))
    heading = track.heading if motion.heading is None else motion.heading
    off = heading - track.heading
    error = 0.0
    if motion.integrating:
        error = min(max(motion.error + off * seen.dt_s, -MOST_INTEGRAL), MOST_INTEGRAL)
    return Step(Speeds(velocity, _correction(off, error)), replace(motion, heading=heading, error=error))


def _correction(off: float, error: float) -> float:
    wanted = HEADING_GAIN * off + INTEGRAL_GAIN * error
    return min(max(wanted, -MOST_CORRECTION), MOST_CORRECTION)


def _ending(motion: Ending, seen: Seen) -> Step:
    track = seen.track
    if track is None:  # a motion that cannot be measured is neither begun nor continued
        return Step(STILL, motion)
    progress = motion.progress or Progress(track)
    motion = replace(motion, progress=progress)
    whole, near = (abs(motion.distance), NEAR_MM) if isinstance(motion, Move) else _degrees(motion)
    done = covered(motion, track)
    left = whole - done
    if left <= near:
        return Step(STILL, motion, "done")
    if done > progress.done + near:
        progress = progress._replace(done=done, idle_s=0.0)
    else:
        progress = progress._replace(idle_s=progress.idle_s + seen.dt_s)
    motion = replace(motion, progress=progress)
    if progress.idle_s > STALLED_S:
        return Step(STILL, motion, "stalled")
    return Step(_speeds(motion, left, track, seen), motion)


def _degrees(motion: Turn | Arc) -> tuple[float, float]:
    return abs(motion.degrees), NEAR_DEG


def _speeds(motion: Ending, left: float, track: OdometerPose, seen: Seen) -> Speeds:
    sent, dt_s = seen.sent, seen.dt_s
    match motion:
        case Move():
            assert motion.progress is not None
            speed = _trapezoid(sent.velocity, motion.distance, left, motion, dt_s)
            return Speeds(speed, _correction(motion.progress.origin.heading - track.heading, 0.0))
        case Turn():
            speed = _trapezoid(sent.turn, -motion.degrees, left, motion, dt_s)
            return Speeds(approach(sent.velocity, 0.0, motion.braking * dt_s), speed)
        case Arc():
            way = math.radians(left) * motion.radius
            speed = _trapezoid(sent.velocity, 1.0, way, motion, dt_s)
            turn = math.degrees(speed / motion.radius)
            return Speeds(speed, -math.copysign(turn, motion.degrees))
        case _:
            assert_never(motion)


def _trapezoid(sent: float, direction: float, left: float, motion: Ending, dt_s: float) -> float:
    """Return the next speed of a trapezoid: accelerate, keep the velocity, brake in time.

    It is signed as `direction` is; a base that still goes the other way is slowed down first.
    """
    sign = math.copysign(1.0, direction)
    fastest = min(motion.velocity, braking_speed(left, motion.acceleration, dt_s))
    return sign * min(fastest, sign * sent + motion.acceleration * dt_s)
