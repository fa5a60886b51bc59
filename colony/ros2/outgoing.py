"""Messages and goals that are sent to ROS 2: values by the paths of their parts, and what they lack.

An orientation may be given by its `yaw` or its `heading` in rad, and is the identity without either. Each
header has the frame of the topic.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from time import monotonic_ns
from typing import Any

from colony.ir.ros2_messages import HEADER, QUATERNION
from colony.ir.types import ScalarValue
from colony.ros2.cdr import Kind, MessageError, Structure
from colony.ros2.incoming import Message
from colony.ros2.topics import CommandedAction

_ANGLES = {"yaw": 0.0, "heading": math.pi / 2.0}
"""Angles of an orientation, and what is added to them for the yaw."""

_NUMBER = struct.Struct("<I")


def completed(kind: Structure, values: Mapping[str, ScalarValue | str], frame: str = "") -> dict[str, Any]:
    """Return the values of a message by field, with the frame of its headers and valid orientations.

    Args:
        kind: the structure of the message.
        values: the values by path: `pose.position.x`, `pose.orientation.heading`.
        frame: the frame of headers.

    Raises:
        MessageError: a path leads into a value.
    """
    message: dict[str, Any] = {}
    for path, value in values.items():
        *steps, last = path.split(".")
        inner = message
        for step in steps:
            inner = inner.setdefault(step, {})
            if not isinstance(inner, dict):
                raise MessageError(f"`{path}` is part of a value that is set as well")
        inner[last] = value
    return {**message, **_parts(kind, message, frame)}


def _parts(kind: Structure, message: Mapping[str, Any], frame: str) -> dict[str, Any]:
    """Return the structures in a message."""
    parts = {name: of for name, of in kind.fields if isinstance(of, Structure)}
    return {name: _part(of, message.get(name, {}), frame) for name, of in parts.items()}


def _part(kind: Kind, given: Any, frame: str) -> Any:
    if not isinstance(kind, Structure) or not isinstance(given, Mapping):
        return given
    if kind.name == QUATERNION:
        return _orientation(given)
    if kind.name == HEADER:
        return {"frame_id": frame, **given}
    return {**given, **_parts(kind, given, frame)}


def _orientation(given: Mapping[str, Any]) -> Mapping[str, Any]:
    angle = next((name for name in _ANGLES if name in given), None)
    if angle is None:
        return given or {"w": 1.0}
    half = (float(given[angle]) + _ANGLES[angle]) / 2.0
    return {"z": math.sin(half), "w": math.cos(half)}


class ActionGoals:
    """The goals of an action. Mutable: has the one that is decided, by number.

    A goal that is decided again after a pause is another goal. What the bridge reports of another number than
    that of the newest goal is not about it.

    Args:
        output: the action, as it is commanded.
        timeout_ns: the time without a decision after which no goal is decided.
        clock: the monotonic clock in nanoseconds.
    """

    def __init__(
        self, output: CommandedAction, timeout_ns: int, clock: Callable[[], int] = monotonic_ns
    ) -> None:
        self.output = output
        self._timeout_ns, self._clock = timeout_ns, clock
        self._number = 0
        self._message: bytes | None = None
        self._decided_ns = 0

    def payload(self, message: bytes) -> bytes:
        """Return the payload of a decided goal: its number and its message."""
        if message != self._message or not self._is_decided:
            self._number += 1
        self._message, self._decided_ns = message, self._clock()
        return _NUMBER.pack(self._number) + message

    def clear(self) -> None:
        """Note that no goal is decided any more."""
        self._message = None

    @property
    def state(self) -> str | None:
        """The state of the newest goal; None while it is not known, as the bridge does not run."""
        goal = self.output.goal
        if goal is None:
            return None
        if not self._is_decided:
            return "idle"
        return goal.state if self._is_newest and goal.state != "idle" else "sent"

    def feedback(self) -> Message | None:
        """Return the newest feedback on the newest goal; None without one."""
        return self.output.feedback.incoming.message() if self._is_decided and self._is_newest else None

    @property
    def _is_decided(self) -> bool:
        return self._message is not None and self._clock() - self._decided_ns < self._timeout_ns

    @property
    def _is_newest(self) -> bool:
        return self.output.goal is not None and self.output.goal.number == self._number
