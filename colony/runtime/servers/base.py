"""The base behind RServer: its state, virtual position, bumpers and speeds."""

from __future__ import annotations

import math
from typing import Literal, cast

from colony.ir.servers import RSERVER
from colony.runtime.arbitration.motion import STILL, BaseObservation, OdometerPose, Speeds
from colony.runtime.frames.publishing import Fields
from colony.runtime.library import robot
from colony.runtime.protocol.calls import CallId, Method, NoArguments, RefusedError, method
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import (
    BaseDriver,
    BaseLimits,
    BaseState,
    OmnidirectionalDriver,
    problems_of,
)

# --- virtual position ----------------------------------------------------------------------------------
#
# The virtual position of a base: extended beyond the range of its registers, and settable by users.
#
# It is the "Virtual X-Y Coordinate" of thesis section 4.6.3. A Labmate keeps x and y in 16-bit registers,
# so they jump by 65536 mm when one overflows. An overflow is a change of sign (0 counts as positive) by
# more than half of that range. It is recognized reliably if the robot moves less than 32768 mm between two
# readings of the registers; RServer reads them in every frame. Positions that users set are kept here and
# not in the registers: setting one drops the overflows counted so far.


class VirtualAxis:
    """Extends a register of `bits` bits beyond its range; with None, it never overflows.

    Stateful: remembers the last value, and the number of overflows so far.
    """

    def __init__(self, bits: int | None) -> None:
        self._half_range = None if bits is None else float(1 << (bits - 1))
        self._last: float | None = None
        self._overflows = 0

    def extend(self, register: float) -> float:
        """Return the position for a value of the register."""
        if self._half_range is None:
            return register
        last, self._last = self._last, register
        if (
            last is not None
            and abs(register - last) > self._half_range
            and (last >= 0.0) != (register >= 0.0)
        ):
            self._overflows += 1 if last >= 0.0 else -1
        return register + 2.0 * self._half_range * self._overflows

    def reset(self) -> None:
        """Forget the last value and the overflows, so that the next value counts as it is."""
        self._last, self._overflows = None, 0


class Odometer:
    """Both axes of a base and its heading. Mutable.

    `continuous_pose` is the pose of the base without jumps, by which motions are measured. Its heading
    continues beyond 360, and its position is in the axes of the base's dead reckoning, regardless of the
    poses that users set.
    """

    def __init__(self, register_bits: int | None) -> None:
        self._axes = (VirtualAxis(register_bits), VirtualAxis(register_bits))
        self._reading: OdometerPose | None = None
        self._anchor = (OdometerPose(0.0, 0.0, 0.0), OdometerPose(0.0, 0.0, 0.0))
        self.continuous_pose: OdometerPose | None = None

    def observe(self, state: BaseState) -> OdometerPose:
        """Observe a snapshot of the base; return the pose relative to the one that users set.

        Its heading is in [0, 360).
        """
        x, y = self._axes[0].extend(state.x), self._axes[1].extend(state.y)
        before, self._reading = self._reading, OdometerPose(x, y, state.heading)
        if self.continuous_pose is None or before is None:
            self.continuous_pose = self._reading
        else:
            turned = math.remainder(state.heading - before.heading, 360.0)
            previous = self.continuous_pose
            self.continuous_pose = OdometerPose(
                previous.x + x - before.x, previous.y + y - before.y, previous.heading + turned
            )
        return self._user_pose(self._reading)

    def set(self, state: BaseState, pose: OdometerPose) -> None:
        """Set the pose of the base in this state; dead reckoning continues along the new heading."""
        self.observe(state)
        for axis in self._axes:
            axis.reset()
        measured = OdometerPose(self._axes[0].extend(state.x), self._axes[1].extend(state.y), state.heading)
        self._reading = measured
        self._anchor = (measured, pose)

    def adjust(self, state: BaseState, delta: OdometerPose) -> None:
        """Add `delta` to the pose of the base in this state."""
        pose = self.observe(state)
        self.set(state, OdometerPose(pose.x + delta.x, pose.y + delta.y, pose.heading + delta.heading))

    def _user_pose(self, measured: OdometerPose) -> OdometerPose:
        measured_anchor, user_anchor = self._anchor
        turned = user_anchor.heading - measured_anchor.heading
        angle = math.radians(turned)
        dx, dy = measured.x - measured_anchor.x, measured.y - measured_anchor.y
        cos, sin = (1.0, 0.0) if turned == 0.0 else (math.cos(angle), math.sin(angle))
        return OdometerPose(
            user_anchor.x + cos * dx - sin * dy,
            user_anchor.y + sin * dx + cos * dy,
            (measured.heading + turned) % 360.0,
        )


# --- base ----------------------------------------------------------------------------------------------


Bumper = Literal["front", "rear"]

MAX_COORDINATE_MM = 1e7
"""Maximum magnitude of x and y in a call that sets the position: 10 km.

With much larger numbers, rounding would cancel each step of dead reckoning: the position would not change
while the base moves.
"""

MAX_HEADING_DEG = 36_000.0
"""Maximum magnitude of a heading that a call may set, for the same reason."""


class Base:
    """A base: its newest state, its virtual position, and the speeds sent last. Mutable."""

    def __init__(self, driver: BaseDriver) -> None:
        self._driver = driver
        self._drives_sideways = driver.limits.sideways > 0.0
        self._odometer = Odometer(driver.register_bits)
        self._pose = OdometerPose(0.0, 0.0, 0.0)
        self._state: BaseState | None = None
        self._bumpers_watched = True
        self.setting = STILL
        """The speeds that were sent last."""
        self.commanded_ns: int | None = None
        """Time at which speeds were sent last; None while the base is stopped."""

    @property
    def limits(self) -> BaseLimits:
        """The limits of the base's speeds."""
        return self._driver.limits

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods that read the state of the base and correct its position."""
        return (
            method("bumper", NoArguments, self._bumper, right="read"),
            method("position", NoArguments, self._position, right="read"),
            method("speed_setting", NoArguments, lambda *_: self.setting.velocity, right="read"),
            method("wheel_speed", NoArguments, lambda *_: self.require_state().wheel_speed, right="read"),
            method("set_bumper", robot.SetBumper, self._set_bumper),
            method("set_position", robot.PoseArguments, self._set_position),
            method("adjust_position", robot.PoseArguments, self._adjust_position),
        )

    @property
    def pose(self) -> OdometerPose:
        """The virtual position at the last `refresh`."""
        return self._pose

    @property
    def continuous_pose(self) -> OdometerPose | None:
        """The pose without jumps at the last `refresh`, by which motions are measured; None without one."""
        return self._odometer.continuous_pose

    def refresh(self) -> BaseState | None:
        """Read the newest state of the base, and pass a new one to the odometer."""
        before, self._state = self._state, self._driver.state()
        if self._state is not None and self._state is not before:
            self._pose = self._odometer.observe(self._state)
        return self._state

    def require_state(self) -> BaseState:
        """Return the newest state of the base, read now.

        Raises:
            RefusedError: "no value": the device is absent, or has not reported a state yet.
        """
        state = self.refresh()
        if state is None:
            raise RefusedError("no value", f"{RSERVER.name}: the base does not report its state{self._why()}")
        return state

    def fields(self, t_ns: int) -> Fields:
        """Return the fields of the base in a frame of `t_ns`, as of the last `refresh`."""
        settings = {
            "speed_setting": Sample(self.setting.velocity, t_ns),
            "turn_setting": Sample(self.setting.turn, t_ns),
        }
        if self._drives_sideways:
            settings["sideways_setting"] = Sample(self.setting.sideways, t_ns)
        state = self._state
        if state is None:
            return settings
        t = state.t_ns
        if self._drives_sideways:
            settings["sideways_speed"] = Sample(state.sideways_speed, t)
        return {
            "bumper": Sample(state.front_bumper or state.rear_bumper, t),
            "front_bumper": Sample(state.front_bumper, t),
            "rear_bumper": Sample(state.rear_bumper, t),
            "x": Sample(self._pose.x, t),
            "y": Sample(self._pose.y, t),
            "heading": Sample(self._pose.heading, t),
            "speed": Sample(state.speed, t),
            "turn_rate": Sample(state.turn_rate, t),
            "wheel_speed": Sample(state.wheel_speed, t),
            **settings,
        }

    def observation(self, now_ns: int, frame_ns: int) -> BaseObservation:
        """Return the input of the motion laws, for frames of `frame_ns`."""
        elapsed_ns = frame_ns if self.commanded_ns is None else now_ns - self.commanded_ns
        elapsed_s = min(max(elapsed_ns, 0), 2 * frame_ns) / 1e9
        return BaseObservation(self._odometer.continuous_pose, self.setting, elapsed_s)

    def drive(self, speeds: Speeds, now_ns: int) -> Bumper | None:
        """Send these speeds to the base; a pressed bumper blocks the velocity toward it.

        Returns:
            The bumper that blocks the motion, as of the last `refresh`; None if there is none, or if bumpers
            are ignored.
        """
        bumper = self._blocking_bumper(speeds.velocity)
        setting = self.setting = speeds if bumper is None else speeds._replace(velocity=0.0)
        if self._drives_sideways:
            cast(OmnidirectionalDriver, self._driver).drive(*setting)
        else:
            self._driver.drive(setting.velocity, setting.turn)
        self.commanded_ns = now_ns
        return bumper

    def stop(self, commanded_ns: int | None = None) -> None:
        """Stop the base, at a command of this time or without one."""
        self.setting, self.commanded_ns = STILL, commanded_ns
        self._driver.stop()

    def rest(self) -> bool:
        """Leave the base to others, if its driver has a method for that; return True if it has."""
        rest = getattr(self._driver, "rest", None)
        if rest is None:
            return False
        self.setting, self.commanded_ns = STILL, None
        rest()
        return True

    def _why(self) -> str:
        problems = problems_of(self._driver)
        return f" ({'; '.join(problems)})" if problems else ""

    def _blocking_bumper(self, velocity: float) -> Bumper | None:
        state = self._state
        if state is None or not velocity or not self._bumpers_watched:
            return None
        if not (state.front_bumper if velocity > 0.0 else state.rear_bumper):
            return None
        return "front" if velocity > 0.0 else "rear"

    # --- calls ---------------------------------------------------------------------------------------

    def _bumper(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> robot.Bumpers:
        state = self.require_state()
        return robot.Bumpers(front=state.front_bumper, rear=state.rear_bumper)

    def _position(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> robot.Position:
        state = self.require_state()
        return robot.Position(x=self._pose.x, y=self._pose.y, heading=self._pose.heading, t_ns=state.t_ns)

    def _set_bumper(self, call_id: CallId, arguments: robot.SetBumper, now_ns: int) -> None:
        self.require_state()
        self._bumpers_watched = arguments.setting != 0
        watch = getattr(self._driver, "watch_bumpers", None)  # a base may stop by itself at a bumper
        if watch is not None:
            watch(self._bumpers_watched)

    def _set_position(self, call_id: CallId, arguments: robot.PoseArguments, now_ns: int) -> None:
        state = self.require_state()
        self._odometer.set(state, _pose(arguments))
        self._pose = self._odometer.observe(state)

    def _adjust_position(self, call_id: CallId, arguments: robot.PoseArguments, now_ns: int) -> None:
        delta = _pose(arguments)
        _check_pose(OdometerPose(self._pose.x + delta.x, self._pose.y + delta.y, delta.heading))
        state = self.require_state()
        self._odometer.adjust(state, delta)
        self._pose = self._odometer.observe(state)


def _pose(arguments: robot.PoseArguments) -> OdometerPose:
    pose = OdometerPose(arguments.x, arguments.y, arguments.heading)
    _check_pose(pose)
    return pose


def _check_pose(pose: OdometerPose) -> None:
    if not all(map(math.isfinite, pose)):
        raise RefusedError("arguments", f"the pose is {tuple(pose)}; expected finite numbers")
    if max(abs(pose.x), abs(pose.y)) > MAX_COORDINATE_MM or abs(pose.heading) > MAX_HEADING_DEG:
        expected = f"at most {MAX_COORDINATE_MM:g} mm from the origin, and {MAX_HEADING_DEG:g} deg"
        raise RefusedError("arguments", f"the pose is {tuple(pose)}; expected {expected}")
