"""The virtual position of a base: extended beyond the range of its registers, and settable by users.

It is the "Virtual X-Y Coordinate" of thesis section 4.6.3. A Labmate keeps x and y in 16-bit registers, so
they jump by 65536 mm when one overflows. A jump is recognized by a change of sign over more than half of that
range, the sign of 0 counting as plus; it is recognized reliably if the robot goes less than 32768 mm between
two readings of the registers. RServer reads them in every frame. Positions that users set are kept here and
not in the registers: setting one drops the overflows counted so far.
"""

from __future__ import annotations

import math

from colony.runtime.arbitration.motion import OdometerPose
from colony.runtime.servers.drivers import BaseState


class VirtualAxis:
    """The extension of one register of `bits` bits beyond its range; None: it never overflows.

    Mutable: the last value, and the number of overflows since.
    """

    def __init__(self, bits: int | None) -> None:
        self._half = None if bits is None else float(1 << (bits - 1))
        self._last: float | None = None
        self._overflows = 0

    def extend(self, register: float) -> float:
        """Return the position that a register's value stands for."""
        if self._half is None:
            return register
        last, self._last = self._last, register
        if last is not None and abs(register - last) > self._half and (last >= 0.0) != (register >= 0.0):
            self._overflows += 1 if last >= 0.0 else -1
        return register + 2.0 * self._half * self._overflows

    def reset(self) -> None:
        """Forget the last value and the overflows: the next value is taken as it is."""
        self._last, self._overflows = None, 0


class Odometer:
    """Both axes of a base and its heading. Mutable: the last state, and the pose that users set.

    `track` is the motion of the base since the first reading, without jumps: its heading continues beyond
    360, and its position is in the axes of the base's dead reckoning, whatever users set. Motions are
    measured on it.
    """

    def __init__(self, register_bits: int | None) -> None:
        self._axes = (VirtualAxis(register_bits), VirtualAxis(register_bits))
        self._reading: OdometerPose | None = None
        self._anchor = (OdometerPose(0.0, 0.0, 0.0), OdometerPose(0.0, 0.0, 0.0))
        self.track: OdometerPose | None = None

    def observe(self, state: BaseState) -> OdometerPose:
        """Observe a snapshot of the base; return the pose as users know it, with its heading in [0, 360)."""
        x, y = self._axes[0].extend(state.x), self._axes[1].extend(state.y)
        before, self._reading = self._reading, OdometerPose(x, y, state.heading)
        if self.track is None or before is None:
            self.track = self._reading
        else:
            turned = math.remainder(state.heading - before.heading, 360.0)
            track = self.track
            self.track = OdometerPose(track.x + x - before.x, track.y + y - before.y, track.heading + turned)
        return self._as_users_set(self._reading)

    def set(self, state: BaseState, pose: OdometerPose) -> None:
        """Set the pose of the base in this state; dead reckoning continues along the new heading."""
        self.observe(state)
        for axis in self._axes:
            axis.reset()
        here = OdometerPose(self._axes[0].extend(state.x), self._axes[1].extend(state.y), state.heading)
        self._reading = here
        self._anchor = (here, pose)

    def adjust(self, state: BaseState, by: OdometerPose) -> None:
        """Correct the pose of the base in this state by x, y and heading."""
        at = self.observe(state)
        self.set(state, OdometerPose(at.x + by.x, at.y + by.y, at.heading + by.heading))

    def _as_users_set(self, seen: OdometerPose) -> OdometerPose:
        here, there = self._anchor
        turned = there.heading - here.heading
        angle = math.radians(turned)
        dx, dy = seen.x - here.x, seen.y - here.y
        cos, sin = (1.0, 0.0) if turned == 0.0 else (math.cos(angle), math.sin(angle))
        return OdometerPose(
            there.x + cos * dx - sin * dy,
            there.y + sin * dx + cos * dy,
            (seen.heading + turned) % 360.0,
        )
