"""Messages that arrive from ROS 2, as values with the time of their measurement.

A measurement is as old as its message, counted from the arrival. The stamp adds to that while it is up to 1 s
old; an older one is that of another clock. A stamp of 0 is none.
"""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from colony.ir.ros2_messages import ANGLES
from colony.ros2.cdr import MessageError, Structure, decode
from colony.ros2.scan import UnusableError

OLD_NS = 1_000_000_000
"""Age of a stamp in ns beyond which it is that of another clock."""

AHEAD_NS = 50_000_000
"""Time in ns by which a stamp may be ahead of the clock."""

PAUSED_NS = 500_000_000
"""Time in ns for which a simulated clock may stand still."""


class ArrivedMessage(NamedTuple):
    """A message that arrived at `t_ns` of `time.monotonic_ns`, when the time of ROS was `ros_ns`."""

    t_ns: int
    ros_ns: int
    data: bytes


class Message(NamedTuple):
    """The values of a message, measured at `t_ns` of `time.monotonic_ns`."""

    values: Mapping[str, Any]
    t_ns: int


def measured_ns(arrived: ArrivedMessage, stamp_ns: int) -> int:
    """Return when a message that arrived was measured, by `time.monotonic_ns`.

    Raises:
        UnusableError: it is stamped in the future.
    """
    age_ns = arrived.ros_ns - stamp_ns
    if stamp_ns == 0:
        return arrived.t_ns
    if age_ns < -AHEAD_NS:
        ahead_s = -age_ns / 1e9
        raise UnusableError(
            f"stamped {ahead_s:.3g} s ahead of the clock: synchronize the clocks, or set `use_sim_time`"
        )
    return arrived.t_ns - age_ns if 0 <= age_ns <= OLD_NS else arrived.t_ns


class SimulatedClock:
    """Judges whether the clock of a simulation stands still. Mutable: remembers when it changed."""

    def __init__(self) -> None:
        self._ros_ns = 0
        self._changed_ns: int | None = None
        self._seen_ns = 0

    def note(self, t_ns: int, ros_ns: int) -> None:
        """Take the time of ROS at `t_ns`."""
        if self._changed_ns is None or ros_ns != self._ros_ns:
            self._ros_ns, self._changed_ns = ros_ns, t_ns
        self._seen_ns = t_ns

    @property
    def is_paused(self) -> bool:
        """True if the clock was seen to stand still."""
        return self._changed_ns is not None and self._seen_ns - self._changed_ns >= PAUSED_NS


class Incoming:
    """A topic that is heard. Mutable: has its newest message; `put` is called by another thread.

    Args:
        topic: its name.
        kind: the structure of its messages; None until the bridge gives their definition.
        frame: the frame that they have to be in; "" for any.
    """

    def __init__(self, topic: str, kind: Structure | None, frame: str = "") -> None:
        self.topic, self.kind, self._frame = topic, kind, frame
        self.fault: str | None = None
        """Why the newest message is unusable; None if it is not."""
        self._lock = threading.Lock()
        self._arrived: ArrivedMessage | None = None
        self._read: ArrivedMessage | None = None
        self._message: Message | None = None

    def put(self, arrived: ArrivedMessage | None) -> None:
        """Take the newest message; None if there is none any more."""
        with self._lock:
            self._arrived = arrived

    def message(self) -> Message | None:
        """Return the newest message, the same object until the next; None if there is no usable one."""
        with self._lock:
            arrived, kind = self._arrived, self.kind
        if arrived is not self._read:
            self._read, self._message, self.fault = arrived, None, None
            try:
                if arrived is not None and kind is not None:
                    self._message = self._decoded(arrived, kind)
            except (MessageError, UnusableError) as problem:
                self.refuse(problem)
        return self._message

    def refuse(self, problem: Exception) -> None:
        """Discard the newest message, and note why."""
        self._message, self.fault = None, f"{self.topic}: {problem}"

    def _decoded(self, arrived: ArrivedMessage, kind: Structure) -> Message:
        values = decode(kind, arrived.data)
        header = values.get("header")
        if not isinstance(header, Mapping) or "stamp" not in header:
            return Message(values, arrived.t_ns)
        if self._frame and header["frame_id"] != self._frame:
            raise UnusableError(f"the frame is `{header['frame_id']}`; expected `{self._frame}`")
        stamp = header["stamp"]
        return Message(values, measured_ns(arrived, stamp["sec"] * 1_000_000_000 + stamp["nanosec"]))


# --- parts of a message ---------------------------------------------------------------------------

_STEP = re.compile(r"(\w+)(?:\[(\d+)\])?")


def part(values: Mapping[str, Any], path: str) -> Any:
    """Return a part of a message: `header.stamp.sec`, `axes[1]`, `pose.orientation.yaw`.

    An orientation has the angles `yaw`, `pitch` and `roll` in rad, and its `heading`: 0 north, along the y
    axis of ROS, counterclockwise, in [0, tau).

    None stands for a value that the message declares unknown, by a covariance of -1.

    Raises:
        UnusableError: the message has no such part.
    """
    found: Any = values
    for step in path.split("."):
        match = _STEP.fullmatch(step)
        name, index = (match[1], match[2]) if match is not None else (step, None)
        if not isinstance(found, Mapping):
            raise UnusableError(f"it has no `{path}`")
        if name in found:
            covariance = found.get(f"{name}_covariance")
            if covariance is not None and len(covariance) and covariance[0] == -1.0:
                return None
            found = found[name]
        elif name in ANGLES and found.keys() == {"x", "y", "z", "w"}:
            found = angle(found, name)
        else:
            raise UnusableError(f"it has no `{path}`")
        if index is not None:
            if not isinstance(found, Sequence) or int(index) >= len(found):
                raise UnusableError(f"it has no `{path}`")
            found = found[int(index)]
    return found


def angle(rotation: Mapping[str, float], name: str) -> float:
    """Return an angle of a rotation in rad: `yaw`, `pitch`, `roll` or `heading`.

    Raises:
        UnusableError: the quaternion is no rotation.
    """
    x, y, z, w = (rotation[key] for key in "xyzw")
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not 0.5 <= norm <= 2.0:
        raise UnusableError(f"the quaternion ({x:g}, {y:g}, {z:g}, {w:g}) is no rotation")
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    if name == "roll":
        return math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    if name == "pitch":
        return math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return yaw if name == "yaw" else (yaw - math.pi / 2.0) % math.tau % math.tau
