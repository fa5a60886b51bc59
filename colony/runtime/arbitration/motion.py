"""How a base carries out what it was told: the modes of the Labmate (thesis section 4.6.3), as laws that give
its speeds from its track, one step a frame.

    joystick              nobody told it anything yet: it stands, and whoever has the joystick moves it
    go                    straight on, the heading held with error integration
    proportional go       the same without integration
    continuous turn       so many degrees along an arc of a radius
    point-to-point go     so far, straight, by a trapezoid of speed
    point-to-point turn   so many degrees on the spot, by a trapezoid of speed
    jog                   a turning rate on top of forward motion

What is told in degrees is positive clockwise, as in the thesis, and so lowers the heading, which grows
counterclockwise; the speeds that come out turn counterclockwise where they are positive, as a driver's do.
The trapezoid brakes for the way that is left less what is driven before the next frame, so that it does not
overshoot on a base that brakes as it was told. All that ends, ends standing.

A law is a value: `step` gives the speeds of a frame and the law's next value, which is used only if the
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
"""deg/s of turning for each degree by which the heading is off."""

INTEGRAL_GAIN = 0.5
"""deg/s of turning for each degree and second."""

MOST_INTEGRAL = 20.0
"""Degrees and seconds: what is integrated ends there, so that a base that was held fast does not swing."""

MOST_CORRECTION = 20.0
"""deg/s with which a heading is held at most."""

NEAR_MM = 1.0
NEAR_DEG = 0.2
"""What is left where a motion is done."""

STALLED_S = 2.0
"""After this time without progress a motion is given up."""


class Speeds(NamedTuple):
    """Forward in mm/s, turning in deg/s counterclockwise."""

    velocity: float
    turn: float


STILL = Speeds(0.0, 0.0)


class OdometerPose(NamedTuple):
    """x and y in mm, heading in degrees counterclockwise from north."""

    x: float
    y: float
    heading: float


class Seen(NamedTuple):
    """What a law goes by: the track of the base (None: it gives nothing), the speeds that were sent last, and
    the time since then.
    """

    track: OdometerPose | None
    sent: Speeds
    dt_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantSpeeds:
    """These speeds, whatever comes of them."""

    speeds: Speeds


@dataclass(frozen=True, slots=True, kw_only=True)
class Go:
    """Straight on. `heading` is held once it has begun; `error` is what it was off by, integrated."""

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
    """Stand; at once, or as fast as the accelerations allow."""

    gradual: bool
    acceleration: float
    turn_acceleration: float


class Progress(NamedTuple):
    """Of a motion with an end: where it began, the most that was done of it, and for how long no more."""

    origin: OdometerPose
    done: float = 0.0
    idle_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """`distance` mm straight on, backward where it is negative; `velocity` is a magnitude."""

    distance: float
    velocity: float
    acceleration: float
    progress: Progress | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """`degrees` clockwise on the spot; `velocity` in deg/s is a magnitude."""

    degrees: float
    velocity: float
    acceleration: float
    braking: float
    """mm/s^2 with which forward motion ends before."""
    progress: Progress | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """`degrees` clockwise along an arc of `radius` mm, forward at `velocity` mm/s."""

    degrees: float
    radius: float
    velocity: float
    acceleration: float
    progress: Progress | None = None


Motion = ConstantSpeeds | Go | Jog | Halt | Move | Turn | Arc
Ending = Move | Turn | Arc
"""Those that are done some time."""

End = Literal["done", "stalled"]


class Step(NamedTuple):
    """The speeds of a frame, the law's next value, and whether that was all of it."""

    speeds: Speeds
    motion: Motion
    end: End | None = None


def step(motion: Motion, seen: Seen) -> Step:
    """One frame of a motion."""
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
    """The mode that a base is in while it carries this out; one that was told to stand is in go mode."""
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
    """A motion after a frame that belonged to somebody else: it holds the heading that it then finds.

    One with an end goes on with what is left of it.
    """
    if isinstance(motion, Go):
        return replace(motion, heading=None, error=0.0)
    return motion


def covered(motion: Ending, track: OdometerPose | None) -> float:
    """How much of it was done, in mm or degrees in the direction asked for."""
    if motion.progress is None or track is None:
        return 0.0
    origin = motion.progress.origin
    if isinstance(motion, Move):
        angle = math.radians(origin.heading)
        along = math.cos(angle) * (track.y - origin.y) - math.sin(angle) * (track.x - origin.x)
        return math.copysign(1.0, motion.distance) * along
    return math.copysign(1.0, motion.degrees) * (origin.heading - track.heading)


def approach(present: float, wanted: float, most: float) -> float:
    """`present`, changed toward `wanted` by `most` at most."""
    return present + min(max(wanted - present, -most), most)


def braking_speed(left: float, acceleration: float, dt_s: float) -> float:
    """The speed from which a base that keeps it for `dt_s` and then brakes stops within `left`."""
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
    if track is None:  # what cannot be measured is not begun, and not gone on with
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
    """The next speed: up with the acceleration, along at the velocity, down in time. It is signed as
    `direction` is; a base that still goes the other way is slowed down first.
    """
    sign = math.copysign(1.0, direction)
    fastest = min(motion.velocity, braking_speed(left, motion.acceleration, dt_s))
    return sign * min(fastest, sign * sent + motion.acceleration * dt_s)
