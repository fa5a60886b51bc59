"""Motions of a base: the modes of the Labmate (thesis section 4.6.3), as control laws stepped once per frame.

    joystick              no command yet: the base stands still, and the joystick moves it
    go                    straight ahead, the heading held by a PI controller
    proportional go       the same by a P controller
    continuous turn       a number of degrees along an arc of a radius
    point-to-point go     a distance, straight, with a trapezoidal speed profile
    point-to-point turn   a number of degrees on the spot, with a trapezoidal speed profile
    jog                   a turning rate on top of forward motion

Commands in degrees are positive clockwise, as in the thesis, and so decrease the heading, which
is counterclockwise; the resulting speeds are positive counterclockwise, as drivers of bases expect. The
trapezoid brakes early by the distance that is driven until the next frame, so that a base that brakes as
commanded does not overshoot. Every finite motion ends at standstill. Only constant speeds move a base
sideways, if it can; a gradual halt brakes such motion, and all others command sideways speed 0.

A law is a value: `step` returns the speeds of a frame and the law's next value, which replaces the law only
if the speeds are used. Pure.
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

MAX_INTEGRAL = 20.0
"""Anti-windup limit of the integral, in degree-seconds, so that a base does not swing after being blocked."""

MAX_CORRECTION = 20.0
"""Maximum turning rate, in deg/s, that the heading controller adds."""

DISTANCE_TOLERANCE_MM = 1.0
ANGLE_TOLERANCE_DEG = 0.2
"""Remaining distance and angle at which a motion is done."""

STALL_TIMEOUT_S = 2.0
"""Seconds without progress after which a motion is abandoned as stalled."""


class Speeds(NamedTuple):
    """Forward speed in mm/s, turning rate in deg/s counterclockwise, sideways speed in mm/s to the left."""

    velocity: float
    turn: float
    sideways: float = 0.0


STILL = Speeds(0.0, 0.0)


class OdometerPose(NamedTuple):
    """x and y in mm, heading in degrees counterclockwise from north."""

    x: float
    y: float
    heading: float


class BaseObservation(NamedTuple):
    """The input of a law: the pose of the base, the speeds sent last, and the seconds since then.

    The pose is None while the base publishes no value.
    """

    pose: OdometerPose | None
    sent: Speeds
    dt_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantSpeeds:
    """Constant speeds, without feedback."""

    speeds: Speeds


@dataclass(frozen=True, slots=True, kw_only=True)
class Go:
    """Motion straight ahead.

    `heading` is the heading to hold, None until it is measured; `integral` is the integrated heading error.
    """

    velocity: float
    acceleration: float
    integrating: bool = True
    heading: float | None = None
    integral: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Jog:
    """Forward motion and a turning rate, positive clockwise."""

    velocity: float
    rate: float
    acceleration: float
    turn_acceleration: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Halt:
    """Standstill; reached immediately, or at the given accelerations if `gradual`."""

    gradual: bool
    acceleration: float
    turn_acceleration: float


class MotionProgress(NamedTuple):
    """Progress of a motion with an end: its origin, the maximum covered, and the time without progress."""

    origin: OdometerPose
    done: float = 0.0
    stalled_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """Motion of `distance` mm straight ahead, backward if negative; `velocity` is a magnitude."""

    distance: float
    velocity: float
    acceleration: float
    progress: MotionProgress | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """Turn of `degrees` clockwise on the spot; `velocity` in deg/s is a magnitude."""

    degrees: float
    velocity: float
    acceleration: float
    braking: float
    """Deceleration, in mm/s^2, that ends forward motion."""
    progress: MotionProgress | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """Turn of `degrees` clockwise along an arc of `radius` mm, forward at `velocity` mm/s."""

    degrees: float
    radius: float
    velocity: float
    acceleration: float
    progress: MotionProgress | None = None


Motion = ConstantSpeeds | Go | Jog | Halt | Move | Turn | Arc
FiniteMotion = Move | Turn | Arc
"""Motions that end on their own."""

End = Literal["done", "stalled"]


class MotionStep(NamedTuple):
    """The speeds of a frame, the law's next value, and the end of the motion if it has ended."""

    speeds: Speeds
    motion: Motion
    end: End | None = None


def step(motion: Motion, observation: BaseObservation) -> MotionStep:
    """Return one frame of a motion."""
    match motion:
        case ConstantSpeeds():
            return MotionStep(motion.speeds, motion)
        case Go():
            return _go(motion, observation)
        case Jog():
            velocity = approach(
                observation.sent.velocity, motion.velocity, motion.acceleration * observation.dt_s
            )
            turn = approach(observation.sent.turn, -motion.rate, motion.turn_acceleration * observation.dt_s)
            return MotionStep(Speeds(velocity, turn), motion)
        case Halt():
            return MotionStep(_halt(motion, observation), motion)
        case Move() | Turn() | Arc():
            return _step_finite(motion, observation)
        case _:
            assert_never(motion)


def is_immediate_halt(motion: Motion) -> bool:
    """Return True for a stop without a ramp, which the base performs by its own emergency stop."""
    return isinstance(motion, Halt) and not motion.gradual


def mode(motion: Motion) -> Mode:
    """Return the mode of a base that carries out this motion; a halted base is in go mode."""
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


MotionCall = Literal["drive", "go", "proportional_go", "jog", "stop", "move", "turn", "continuous_turn"]
"""The name of a call of RServer that moves the base."""


def call_of(motion: Motion) -> MotionCall:
    """Return the name of the call that asks for a motion."""
    match motion:
        case Go():
            return "go" if motion.integrating else "proportional_go"
        case Jog():
            return "jog"
        case ConstantSpeeds():
            return "drive"
        case Halt():
            return "stop"
        case Move():
            return "move"
        case Turn():
            return "turn"
        case Arc():
            return "continuous_turn"
        case _:
            assert_never(motion)


def interrupt(motion: Motion) -> Motion:
    """Return a motion after a frame in which another party acted: `Go` then holds a new heading.

    A finite motion continues with the remaining distance or angle.
    """
    if isinstance(motion, Go):
        return replace(motion, heading=None, integral=0.0)
    return motion


def measure_progress(motion: FiniteMotion, pose: OdometerPose | None) -> float:
    """Return the distance or angle covered so far, in mm or degrees in the commanded direction."""
    if motion.progress is None or pose is None:
        return 0.0
    origin = motion.progress.origin
    if isinstance(motion, Move):
        angle = math.radians(origin.heading)
        distance = math.cos(angle) * (pose.y - origin.y) - math.sin(angle) * (pose.x - origin.x)
        return math.copysign(1.0, motion.distance) * distance
    return math.copysign(1.0, motion.degrees) * (origin.heading - pose.heading)


def is_stalling(motion: Motion) -> bool:
    """Return True if a motion with an end made no progress in its last step."""
    return (
        isinstance(motion, FiniteMotion) and motion.progress is not None and motion.progress.stalled_s > 0.0
    )


def is_held_at_rest(motion: Motion, proposed: Speeds, sent: Speeds | None) -> bool:
    """Return True if what was sent does not move a base toward the end of a motion, and its law does.

    A command that is merely slower than the proposed one is no reason for a base to stand.

    Args:
        motion: motion of a connection.
        proposed: speeds of its law in a frame.
        sent: speeds that were sent in that frame; None if the actuator was idle in their place.
    """
    if not isinstance(motion, FiniteMotion):
        return False
    i = 0 if isinstance(motion, Move) else 1
    return proposed[i] != 0.0 and (sent is None or sent[i] * proposed[i] <= 0.0)


def approach(current: float, target: float, max_change: float) -> float:
    """Return `current`, changed toward `target` by at most `max_change`."""
    return current + min(max(target - current, -max_change), max_change)


def braking_speed(distance: float, acceleration: float, dt_s: float) -> float:
    """Return the speed at which a base that keeps it for `dt_s` and then brakes stops within `distance`."""
    if distance <= 0.0:
        return 0.0
    lag = acceleration * dt_s
    return math.sqrt(lag * lag + 2.0 * acceleration * distance) - lag


def _halt(motion: Halt, observation: BaseObservation) -> Speeds:
    if not motion.gradual:
        return STILL
    return Speeds(
        approach(observation.sent.velocity, 0.0, motion.acceleration * observation.dt_s),
        approach(observation.sent.turn, 0.0, motion.turn_acceleration * observation.dt_s),
        approach(observation.sent.sideways, 0.0, motion.acceleration * observation.dt_s),
    )


def _go(motion: Go, observation: BaseObservation) -> MotionStep:
    velocity = approach(observation.sent.velocity, motion.velocity, motion.acceleration * observation.dt_s)
    pose = observation.pose
    if pose is None or velocity == 0.0:
        return MotionStep(Speeds(velocity, 0.0), interrupt(motion))
    heading = pose.heading if motion.heading is None else motion.heading
    heading_error = heading - pose.heading
    integral = 0.0
    if motion.integrating:
        integral = min(max(motion.integral + heading_error * observation.dt_s, -MAX_INTEGRAL), MAX_INTEGRAL)
    return MotionStep(
        Speeds(velocity, _correction(heading_error, integral)),
        replace(motion, heading=heading, integral=integral),
    )


def _correction(heading_error: float, integral: float) -> float:
    rate = HEADING_GAIN * heading_error + INTEGRAL_GAIN * integral
    return min(max(rate, -MAX_CORRECTION), MAX_CORRECTION)


def _step_finite(motion: FiniteMotion, observation: BaseObservation) -> MotionStep:
    pose = observation.pose
    if pose is None:  # a motion that cannot be measured is neither begun nor continued
        return MotionStep(STILL, motion)
    progress = motion.progress or MotionProgress(pose)
    motion = replace(motion, progress=progress)
    if isinstance(motion, Move):
        total, tolerance = abs(motion.distance), DISTANCE_TOLERANCE_MM
    else:
        total, tolerance = abs(motion.degrees), ANGLE_TOLERANCE_DEG
    done = measure_progress(motion, pose)
    remaining = total - done
    if remaining <= tolerance:
        return MotionStep(STILL, motion, "done")
    if done > progress.done + tolerance:
        progress = progress._replace(done=done, stalled_s=0.0)
    else:
        progress = progress._replace(stalled_s=progress.stalled_s + observation.dt_s)
    motion = replace(motion, progress=progress)
    if progress.stalled_s > STALL_TIMEOUT_S:
        return MotionStep(STILL, motion, "stalled")
    return MotionStep(_speeds(motion, remaining, pose, observation), motion)


def _speeds(
    motion: FiniteMotion, remaining: float, pose: OdometerPose, observation: BaseObservation
) -> Speeds:
    sent, dt_s = observation.sent, observation.dt_s
    match motion:
        case Move():
            assert motion.progress is not None
            speed = _trapezoid(sent.velocity, motion.distance, remaining, motion, dt_s)
            return Speeds(speed, _correction(motion.progress.origin.heading - pose.heading, 0.0))
        case Turn():
            speed = _trapezoid(sent.turn, -motion.degrees, remaining, motion, dt_s)
            return Speeds(approach(sent.velocity, 0.0, motion.braking * dt_s), speed)
        case Arc():
            arc_mm = math.radians(remaining) * motion.radius
            speed = _trapezoid(sent.velocity, 1.0, arc_mm, motion, dt_s)
            turn = math.degrees(speed / motion.radius)
            return Speeds(speed, -math.copysign(turn, motion.degrees))
        case _:
            assert_never(motion)


def _trapezoid(sent: float, direction: float, remaining: float, motion: FiniteMotion, dt_s: float) -> float:
    """Return the next speed of a trapezoidal profile: accelerate, keep the velocity, brake in time.

    It has the sign of `direction`; a base that still moves in the opposite direction is slowed down first.
    """
    sign = math.copysign(1.0, direction)
    max_speed = min(motion.velocity, braking_speed(remaining, motion.acceleration, dt_s))
    return sign * min(max_speed, sign * sent + motion.acceleration * dt_s)
