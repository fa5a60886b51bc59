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
from colony.runtime.servers.virtual_position import Odometer

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
        self._setting = STILL
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
            method("speed_setting", NoArguments, lambda *_: self._setting.velocity, right="read"),
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
            "speed_setting": Sample(self._setting.velocity, t_ns),
            "turn_setting": Sample(self._setting.turn, t_ns),
        }
        if self._drives_sideways:
            settings["sideways_setting"] = Sample(self._setting.sideways, t_ns)
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
        return BaseObservation(self._odometer.continuous_pose, self._setting, elapsed_s)

    def drive(self, speeds: Speeds, now_ns: int) -> Bumper | None:
        """Send these speeds to the base; a pressed bumper blocks the velocity toward it.

        Returns:
            The bumper that blocks the motion, as of the last `refresh`; None if there is none, or if bumpers
            are ignored.
        """
        bumper = self._blocking_bumper(speeds.velocity)
        setting = self._setting = speeds if bumper is None else speeds._replace(velocity=0.0)
        if self._drives_sideways:
            cast(OmnidirectionalDriver, self._driver).drive(*setting)
        else:
            self._driver.drive(setting.velocity, setting.turn)
        self.commanded_ns = now_ns
        return bumper

    def stop(self, commanded_ns: int | None = None) -> None:
        """Stop the base, at a command of this time or without one."""
        self._setting, self.commanded_ns = STILL, commanded_ns
        self._driver.stop()

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
