"""Control of the base by connections outside the network: their motions.

The pilot handles the calls of Table 4.1 that move the base, under the rules of `outside_control.py`. In each
frame, it steps the motion of the connection that may act. Arbitration decides, and hands the step back with
the dispatch, so that only a motion that was carried out progresses. The pilot does not use a driver.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple

import msgspec

from colony.ir.servers import OMNIDIRECTIONAL_RSERVER, RSERVER
from colony.ir.types import ScalarValue
from colony.runtime.arbitration import motion
from colony.runtime.arbitration.arbiter import Dispatch
from colony.runtime.arbitration.ballot import LIMITS_UNKNOWN
from colony.runtime.arbitration.motion import STILL, FiniteMotion, Mode, Motion, MotionStep, Speeds
from colony.runtime.arbitration.outside import Commander, OutsideCommanders, lease_end
from colony.runtime.library import robot
from colony.runtime.protocol.calls import (
    LATER,
    CallId,
    Handler,
    Later,
    Method,
    NoArguments,
    RefusedError,
    method,
)
from colony.runtime.protocol.deployment import ActuatorSpec
from colony.runtime.servers import commanding
from colony.runtime.servers.base import Base, Bumper
from colony.runtime.servers.commanding import built_in_actuator
from colony.runtime.servers.drivers import BaseLimits
from colony.runtime.servers.outside_control import ActuatorState, OutsideControl, Proposal

# --- motion commands -----------------------------------------------------------------------------------
#
# Translation of RServer's calls into motions of the base, within the allowed range.
#
# The functions are pure. They return the motion and the new settings: the velocity or acceleration of a
# call becomes the default of later calls (thesis section 4.6.3). Arguments out of range raise
# `RefusedError` with the code "arguments".


class SpeedRange(NamedTuple):
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


def full_range(limits: BaseLimits) -> SpeedRange:
    """Return the full range of a base."""
    return SpeedRange(
        (-limits.velocity, limits.velocity),
        (-limits.turn, limits.turn),
        (0.0 - limits.sideways, limits.sideways),
        limits.acceleration,
        limits.turn_acceleration,
    )


class SpeedSettings(NamedTuple):
    """The magnitudes set by the last commands, for motion along a path and for turns on the spot."""

    velocity: float
    acceleration: float
    turn_velocity: float
    turn_acceleration: float


def initial_settings(limits: BaseLimits) -> SpeedSettings:
    """Return the initial settings, which are slow."""
    return SpeedSettings(
        velocity=min(200.0, limits.velocity),
        acceleration=limits.acceleration / 2.0,
        turn_velocity=min(30.0, limits.turn),
        turn_acceleration=limits.turn_acceleration / 2.0,
    )


class Context(NamedTuple):
    """What the motion of a call depends on; `previous` is the motion of the same connection until now."""

    settings: SpeedSettings
    allowed: SpeedRange
    previous: Motion | None = None


Made = tuple[Motion, SpeedSettings]
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


def go(arguments: robot.GoArguments, context: Context, *, integrating: bool = True) -> Made:
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


def jog(arguments: robot.JogArguments, context: Context) -> Made:
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


def halt(arguments: robot.HaltArguments, context: Context) -> Made:
    """Return a stop, immediate or gradual."""
    settings = context.settings
    new_motion = motion.Halt(
        gradual=arguments.mode == 0,
        acceleration=settings.acceleration,
        turn_acceleration=settings.turn_acceleration,
    )
    return new_motion, settings


def move(arguments: robot.MoveArguments, context: Context) -> Made:
    """Return a motion over a distance."""
    distance = _finite("distance", arguments.distance)
    low, high = context.allowed.velocity
    settings = _path_settings(arguments, context, high if distance > 0.0 else -low)
    new_motion = motion.Move(
        distance=distance, velocity=settings.velocity, acceleration=settings.acceleration
    )
    return new_motion, settings


def turn(arguments: robot.TurnArguments, context: Context) -> Made:
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


def _path_settings(
    arguments: robot.MoveArguments | robot.ContinuousTurn, context: Context, limit: float
) -> SpeedSettings:
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


# --- base actuator -------------------------------------------------------------------------------------
#
# The actuator of the base: the one that a program binds to it or the built-in one, its values and speeds.


DRIVE = RSERVER.commands[0].name
"""Name of the command that drives the base."""

_DRIVE = built_in_actuator(RSERVER.name, RSERVER.commands[0], idle=(0.0, 0.0))
_DRIVE_SIDEWAYS = built_in_actuator(RSERVER.name, OMNIDIRECTIONAL_RSERVER.commands[0], idle=(0.0, 0.0, 0.0))


def base_actuator(limits: BaseLimits) -> ActuatorSpec:
    """Return the built-in actuator of a base."""
    return _DRIVE_SIDEWAYS if limits.sideways > 0.0 else _DRIVE


def values_of(actuator: ActuatorSpec, speeds: Speeds) -> tuple[float, ...]:
    """Return the values of an actuator's fields for these speeds; a speed without a field is dropped."""
    values = [0.0] * len(actuator.fields)
    for i, speed in zip(_indices(actuator), speeds, strict=True):
        if i is not None:
            values[i] = speed
    return tuple(values)


def speeds_of(actuator: ActuatorSpec, values: tuple[ScalarValue, ...], proposed: Speeds = STILL) -> Speeds:
    """Return the speeds of a command in base units; a speed without a field is the proposed one."""
    pairs = zip(_indices(actuator), proposed, strict=True)
    return Speeds(*[speed if i is None else float(values[i]) for i, speed in pairs])


def allowed_range(actuator: ActuatorSpec, limits: BaseLimits) -> SpeedRange:
    """Return an actuator's range within the base's limits; a speed without a field has the base's limits."""
    full = full_range(limits)
    velocity, turn, sideways = _indices(actuator)
    return full._replace(
        velocity=_narrow(full.velocity, actuator, velocity),
        turn=_narrow(full.turn, actuator, turn),
        sideways=_narrow(full.sideways, actuator, sideways),
    )


def mismatch(specs: Sequence[ActuatorSpec], limits: BaseLimits) -> str | None:
    """Return the reason why a program's actuators do not fit the base with these limits, or None.

    A program for a base that drives sideways fits any other one if it does not declare that speed, and a
    program for any other base fits this one.
    """
    is_wide = any(len(spec.field_indices) == len(_DRIVE_SIDEWAYS.fields) for spec in specs)
    wrong = commanding.mismatch(RSERVER.name, {DRIVE: _DRIVE_SIDEWAYS if is_wide else _DRIVE}, specs)
    if wrong is None and limits.sideways == 0.0 and any(_indices(spec)[2] is not None for spec in specs):
        return f"`{specs[0].name}`: it drives sideways, which this base cannot"
    return wrong


def _indices(spec: ActuatorSpec) -> tuple[int | None, int | None, int | None]:
    """Return the indices of the fields of velocity, turn and sideways speed; None for one without a field.

    An actuator that was bound to a base that cannot drive sideways has no index for it.
    """
    velocity, turn, sideways = (*spec.field_indices, None)[: len(_DRIVE_SIDEWAYS.fields)]
    return velocity, turn, sideways


def _narrow(full: tuple[float, float], spec: ActuatorSpec, index: int | None) -> tuple[float, float]:
    if index is None:
        return full
    field = spec.fields[index]
    low = full[0] if field.low is None else max(full[0], field.low)
    high = full[1] if field.high is None else min(full[1], field.high)
    return (low, high)


# --- piloting ------------------------------------------------------------------------------------------


MakeMotion = Callable[[Any, Context], Made]
"""A function that returns the motion of a call with these arguments."""

_MOTIONS: tuple[tuple[str, type[msgspec.Struct], MakeMotion], ...] = (
    ("drive", robot.Drive, drive),
    ("go", robot.GoArguments, go),
    ("proportional_go", robot.GoArguments, partial(go, integrating=False)),
    ("jog", robot.JogArguments, jog),
    ("stop", robot.HaltArguments, halt),
    ("move", robot.MoveArguments, move),
    ("turn", robot.TurnArguments, turn),
    ("continuous_turn", robot.ContinuousTurn, continuous_turn),
)


class _Stepped(NamedTuple):
    """A frame of a motion: its step, and its speeds within the allowed range."""

    commander: Commander[Motion]
    step: MotionStep
    speeds: Speeds


class Pilot(OutsideControl[Motion]):
    """The motions of outside connections. Mutable.

    `speeds` are those that the connection that acts commands, None if none acts. `stops_immediately` is True
    if it stops the base by its emergency stop.

    Args:
        state: the base's actuator.
        base: the base. While it does not report a state, motions are refused.
    """

    def __init__(self, state: ActuatorState, base: Base) -> None:
        super().__init__(state)
        self._commanders[DRIVE] = OutsideCommanders()
        self._base = base
        self._settings = initial_settings(base.limits)
        self._range: tuple[ActuatorSpec | None, SpeedRange] = (None, full_range(base.limits))
        self.mode: Mode = "joystick"
        self.speeds: Speeds | None = None
        self.stops_immediately = False

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods of the pilot."""
        motions = (method(name, kind, self._handler(make)) for name, kind, make in _MOTIONS)
        mode = method("mode", NoArguments, lambda *_: self.mode, right="read")
        return (*motions, mode, *super().methods)

    # --- frames --------------------------------------------------------------------------------------

    def _propose(
        self, spec: ActuatorSpec, commander: Commander[Motion], may_act: bool, now_ns: int
    ) -> Proposal | None:
        assert commander.command is not None
        if not may_act:
            return Proposal(())
        step = motion.step(commander.command, self._base.observation(now_ns, self.state.frame_ns))
        held_since_ns = commander.held_since_ns
        if held_since_ns is not None and now_ns - held_since_ns > motion.STALL_TIMEOUT_S * 1e9:
            step = step._replace(end=step.end or "stalled")
        if step.end is not None:
            self._end(commander, step.end)
            return None
        speeds = self._allowed(spec).clamp(step.speeds)
        return Proposal(values_of(spec, speeds), _Stepped(commander, step, speeds))

    def on_dispatch(self, spec: ActuatorSpec, dispatch: Dispatch, now_ns: int) -> None:
        """Advance the motion of the connection that acts in the frame, if any; interrupt all others."""
        stepped = dispatch.source if isinstance(dispatch.source, _Stepped) else None
        for commander in self._drivers.commanding:
            if commander.command is not None and (stepped is None or commander is not stepped.commander):
                commander.command = motion.interrupt(commander.command)
        self.speeds, self.stops_immediately = None, False
        if stepped is not None:
            self._advance(stepped, spec, dispatch, now_ns)
        elif dispatch.hold != "stopped":
            self._on_network_dispatch(is_active=dispatch.by is not None)

    def _advance(self, stepped: _Stepped, spec: ActuatorSpec, dispatch: Dispatch, now_ns: int) -> None:
        commander, step, proposed = stepped
        sent = None
        if dispatch.fault is None and dispatch.values is not None:
            sent = speeds_of(spec, dispatch.values, proposed)
        self.speeds, self.stops_immediately = sent, motion.is_immediate_halt(step.motion)
        if commander.command is None:  # it ended before the frame was decided
            return
        commander.command = step.motion if sent else motion.interrupt(step.motion)
        commander.fault = dispatch.fault
        commander.held_at_rest = motion.is_held_at_rest(step.motion, proposed, sent)
        if not (commander.held_at_rest and motion.is_stalling(step.motion)):
            commander.held_since_ns = None
        elif commander.held_since_ns is None:
            commander.held_since_ns = now_ns
        self.mode = motion.mode(step.motion)

    def _on_network_dispatch(self, *, is_active: bool) -> None:
        """Set the mode for a frame without an outside command; `is_active` is True if a client won."""
        if is_active:
            self.mode = "jog"
        elif self.mode in ("continuous turn", "point-to-point go", "point-to-point turn"):
            self.mode = "go"

    def on_bumper(self, connection: str | None, bumper: Bumper) -> None:
        """End the move or arc of a connection, because a bumper stopped it."""
        for commander in self._drivers.commanding:
            moving = isinstance(commander.command, motion.Move | motion.Arc)
            if moving and commander.caller.connection == connection:
                self._end(commander, bumper)

    def _end(self, commander: Commander[Motion], reason: Literal["done", "stalled", "front", "rear"]) -> None:
        ended, call_id = commander.command, commander.call_id
        commander.end()
        self.mode = "go"
        if call_id is None or not isinstance(ended, FiniteMotion):
            return
        unit = "mm" if isinstance(ended, motion.Move) else "deg"
        progress = motion.measure_progress(ended, self._base.continuous_pose)
        match reason:
            case "done":
                self.answers.append((call_id, progress))
            case "stalled":
                self.answers.append((call_id, _stalled(f"{progress:.4g} {unit}", commander)))
            case "front" | "rear":
                text = f"the {reason} bumper is pressed, after {progress:.4g} {unit}"
                self.answers.append((call_id, RefusedError("bumper", text)))

    @property
    def ends(self) -> tuple[Speeds, Speeds]:
        """The least and the greatest speeds that connections may command now."""
        allowed = self._allowed(self.state.actuators[DRIVE])
        low, high = zip(allowed.velocity, allowed.turn, allowed.sideways, strict=True)
        return Speeds(*low), Speeds(*high)

    def report(self, now_ns: int) -> tuple[robot.BaseOutsideReport, ...]:
        """Return the connections that have commanded, and their current commands."""
        return tuple(
            robot.BaseOutsideReport(commands=None if command is None else motion.call_of(command), **common)
            for _, command, common in self._reported(now_ns)
        )

    def stop(self) -> None:
        """Cancel all commands because of the emergency stop."""
        super().stop()
        self.mode = "joystick"

    # --- calls ---------------------------------------------------------------------------------------

    @property
    def _drivers(self) -> OutsideCommanders[Motion]:
        return self._commanders[DRIVE]

    def _allowed(self, spec: ActuatorSpec) -> SpeedRange:
        if self._range[0] is not spec:
            self._range = spec, allowed_range(spec, self._base.limits)
        return self._range[1]

    def _handler(self, make: MakeMotion) -> Handler:
        """Return the handler of a call that moves the base.

        Most motions stay in force until the lease of the call ends; those with an end of their own until they
        are done, and may wait for it. Stopping needs neither ticks nor the state of the base.
        """

        def handle(call_id: CallId, arguments: Any, now_ns: int) -> Later | None:
            spec, caller = self.state.actuators[DRIVE], call_id.caller
            contest, commander = self.contest(spec), self._drivers.find(caller)
            previous = None if commander is None else commander.command
            context = Context(self._settings, self._allowed(spec), previous)
            new_motion, settings = make(arguments, context)
            is_finite = isinstance(new_motion, FiniteMotion)
            lease_end_ns = None if is_finite else lease_end(arguments.lease_s, now_ns)
            if isinstance(new_motion, motion.Halt):
                commander = self.admit(caller, contest)
            else:
                commander = self.admit_while_ticking(caller, contest, now_ns)
                self._base.require_state()
            waiting = call_id if is_finite and arguments.wait else None
            self.begin(commander, new_motion, lease_end_ns=lease_end_ns, call_id=waiting)
            self._settings = settings
            return None if waiting is None else LATER

        return handle


def _stalled(progress: str, commander: Commander[Motion]) -> RefusedError:
    """Return the refusal of a connection's motion without progress."""
    seconds = f"{motion.STALL_TIMEOUT_S:g} s"
    if commander.held_at_rest and commander.fault == LIMITS_UNKNOWN:
        found = f"the program's limits were unknown for {seconds}, after {progress}"
        return RefusedError("limits", f"{found}: its clients are late or lost")
    if commander.held_at_rest:
        return RefusedError("limits", f"the program's limits held the base for {seconds}, after {progress}")
    return RefusedError("stalled", f"no progress for {seconds}, after {progress}")
