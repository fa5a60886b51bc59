"""The virtual position of a base: extended beyond the range of its registers, and settable by users.

It is the "Virtual X-Y Coordinate" of thesis section 4.6.3. A Labmate keeps x and y in 16-bit registers, so
they jump by 65536 mm when one overflows. An overflow is a change of sign (0 counts as positive) by more than
half of that range. It is recognized reliably if the robot moves less than 32768 mm between two readings of
the registers; RServer reads them in every frame. Positions that users set are kept here and not in the
registers: setting one drops the overflows counted so far.
"""

from __future__ import annotations

import math

from colony.runtime.arbitration.motion import OdometerPose
from colony.runtime.servers.drivers import BaseState


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
