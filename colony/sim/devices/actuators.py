"""Simulated actuators: joints, and outputs that stay as they are set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from colony.body import devices
from colony.ir.types import ScalarValue, Value
from colony.sim.devices.device import SimulatedSensor
from colony.sim.mechanism import Action
from colony.sim.physics import Physics

# --- output -------------------------------------------------------------------------------------------
#
# Outputs, which stay as they are set.


class Outputs(SimulatedSensor):
    """The outputs of a server, off at first. Stateful: holds what they were set to."""

    def __init__(self, output: devices.Output) -> None:
        self._off: dict[str, ScalarValue] = {
            name: False if kind == "on" else 0.0 for name, kind in output.outputs.items()
        }
        self._now = dict(self._off)
        self.fields = tuple(self._off)

    def measure(self, field: str) -> ScalarValue:
        """Return what an output is set to."""
        return self._now[field]

    def action(self, name: str, values: Mapping[str, ScalarValue]) -> Action:
        """Return what sets all outputs: those without a value are switched off, levels are within 0 and 1.

        Raises:
            ValueError: the command is not `set`, or there is no such output.
        """
        if name != "set":
            raise ValueError(f"outputs have no command `{name}`; they have `set`")
        unknown = next((value for value in values if value not in self._off), None)
        if unknown is not None:
            raise ValueError(f"there is no output `{unknown}`; there are {', '.join(self._off)}")
        return partial(self._set, {output: self._valid(output, values) for output in self._off})

    def safe(self) -> None:
        """Switch everything off."""
        self._set(self._off)

    def _valid(self, output: str, values: Mapping[str, ScalarValue]) -> ScalarValue:
        """Return the value of an output in a command, of its kind."""
        value = values.get(output, 0.0)
        return bool(value) if self._off[output] is False else min(max(float(value), 0.0), 1.0)

    def _set(self, values: Mapping[str, ScalarValue]) -> None:
        self._now = dict(values)


# --- joint --------------------------------------------------------------------------------------------
#
# Joints, along a line or around an axis, which go where they are sent, or run to an end.


@dataclass(frozen=True, slots=True)
class _Motion:
    """A motion from a position, which began at `elapsed_ns`, to `goal`."""

    start: float
    goal: float
    elapsed_ns: int
    speed: float

    def position(self, elapsed_ns: int) -> float:
        """Return where the joint is."""
        if self.start == self.goal:
            return self.goal
        way = self.speed * (elapsed_ns - self.elapsed_ns) / 1e9
        if self.goal >= self.start:
            return min(self.start + way, self.goal)
        return max(self.start - way, self.goal)


class Joint(SimulatedSensor):
    """A joint of a robot, which nothing blocks. Stateful: holds its motion.

    Positions that have names are commanded, and acknowledged, by their numbers.
    """

    def __init__(self, joint: devices.JointSpec | devices.RotaryJoint, world: Physics) -> None:
        self.fields = tuple(field.name for field in joint.fields)
        self._is_run = joint.control == "velocity"
        self._low, self._high = joint.ends
        self._speed = joint.speed
        self._load = joint.load
        self._named = tuple(joint.positions.values())
        self._world = world
        start = self._low if isinstance(joint, devices.JointSpec) else self._within(0.0)
        self._motion = _Motion(start, start, world.elapsed_ns, 0.0)
        self._target = self._target_at(start)

    def measure(self, field: str) -> Value | None:
        """Return what a field reads; no target is known before the first if the joint begins at none."""
        if field == "position":
            return self._position()
        if field == "target":
            return self._target
        if field == "velocity":
            return self._velocity()
        if field == "moving":
            return self._position() != self._motion.goal
        if field == "lower_end":
            return self.measure("position") == self._low
        if field == "upper_end":
            return self.measure("position") == self._high
        return self._load

    def action(self, name: str, values: Mapping[str, ScalarValue]) -> Action:
        """Return what goes to a position, or runs at a velocity, within the range.

        Raises:
            ValueError: the joint has no such command, or there is no position of this number.
        """
        if self._is_run:
            if name != "run":
                raise ValueError(f"this joint has no command `{name}`; it has `run`")
            return partial(self._run, float(values.get("velocity", 0.0)))
        if name != "move":
            raise ValueError(f"a joint has no command `{name}`; it has `move`")
        target = float(values.get("position", 0.0))
        goal = target
        if self._named:
            if target not in range(len(self._named)):
                raise ValueError(f"position {target:g}; expected a number from 0 to {len(self._named) - 1}")
            goal = self._named[int(target)]
        return partial(self._move, target, self._within(goal))

    def safe(self) -> None:
        """Stop where it is."""
        self._go_to(self._position())

    def _move(self, target: float, goal: float) -> None:
        self._target = target
        self._go_to(goal)

    def _run(self, velocity: float) -> None:
        """Run at a velocity, at most the joint's speed, until an end."""
        end = self._position() if velocity == 0.0 else self._high if velocity > 0.0 else self._low
        self._go_to(end, min(abs(velocity), self._speed))

    def _position(self) -> float:
        return self._motion.position(self._world.elapsed_ns)

    def _velocity(self) -> float:
        if self._position() == self._motion.goal:
            return 0.0
        return self._motion.speed if self._motion.goal > self._motion.start else -self._motion.speed

    def _go_to(self, goal: float, speed: float | None = None) -> None:
        speed = self._speed if speed is None else speed
        self._motion = _Motion(self._position(), goal, self._world.elapsed_ns, speed)

    def _within(self, position: float) -> float:
        return min(max(position, self._low), self._high)

    def _target_at(self, position: float) -> float | None:
        """Return the target by which the joint would be sent to where it is; None if there is none."""
        if not self._named:
            return position
        return float(self._named.index(position)) if position in self._named else None
