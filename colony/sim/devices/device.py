"""Simulated devices: what they measure at their rates, and the commands that they carry out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from enum import Enum, auto
from typing import Generic, Protocol, TypeVar

import numpy as np

from colony.body.model import DeviceFaults
from colony.ir.types import ScalarValue, Value
from colony.runtime.protocol.messages import Sample
from colony.sim.chance import FAULTS, draw_uniforms
from colony.sim.mechanism import Action, Given, Measurement, Mechanism, nothing_given
from colony.sim.physics import Physics

# --- faults -------------------------------------------------------------------------------------------
#
# Faults of devices: times in which readings are missing or frozen.
#
# Faults follow each other without memory: the time from the end of one to the next is exponential, and what
# kind it is and how long it lasts are drawn for each. So the faults of a device depend on its seed alone.


class Fault(Enum):
    """What is wrong with readings: there are none, or no new ones."""

    MISSING = auto()
    FROZEN = auto()


class FaultTimeline:
    """The faults of a device, in order. Stateful: the current or next one, as time goes on.

    Args:
        faults: how often they occur, and how long they last.
        seed: the seed of the device.
    """

    def __init__(self, faults: DeviceFaults, seed: int) -> None:
        share = faults.missing + faults.frozen
        self._missing = faults.missing / share
        self._lasting_ns = faults.lasting_s * 1e9
        self._gap_ns = self._lasting_ns * (1.0 - share) / share
        self._seed = seed
        self._numbers = np.empty(3)
        self._count = 0
        self._begin_ns = self._end_ns = 0.0
        self._fault = Fault.MISSING
        self._draw()

    def at(self, elapsed_ns: int) -> Fault | None:
        """Return the fault at a time, which is not before that of the last call; None if there is none."""
        while elapsed_ns >= self._end_ns:
            self._draw()
        return self._fault if elapsed_ns >= self._begin_ns else None

    def _draw(self) -> None:
        """Draw the next fault."""
        draw_uniforms(self._seed, FAULTS, self._count, self._numbers)
        gap, kind, length = self._numbers.tolist()
        self._begin_ns = self._end_ns - math.log1p(-gap) * self._gap_ns
        self._end_ns = self._begin_ns + (0.5 + length) * self._lasting_ns
        self._fault = Fault.MISSING if kind < self._missing else Fault.FROZEN
        self._count += 1


def faults_of(faults: DeviceFaults | None, seed: int) -> FaultTimeline | None:
    """Return the faults of a device with this seed; None if it has none."""
    if faults is None or faults.missing + faults.frozen == 0.0:
        return None
    return FaultTimeline(faults, seed)


# --- measurements -------------------------------------------------------------------------------------
#
# When the devices of a robot measure, and when their measurements arrive.
#
# What has a period is measured at the end of the first step in each of its periods. What has none is measured
# when it is read or, if readings arrive late or have faults, at the end of each step. A measurement is given
# from the time at which it arrives until the next one arrives. While a device is frozen, it takes none; while
# its readings are missing, what it takes is that there is nothing. None of this depends on when anything was
# read before.

T = TypeVar("T")


class _Schedule:
    """The names that are measured with one period. Mutable: the next one begins at `due_ns`."""

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.names: list[str] = []
        self.due_ns = 0


class TimedMeasurements(Generic[T]):
    """Measurements of a robot in a world, by name. Stateful: keeps those that have arrived or are underway.

    Args:
        take: function that takes a measurement of the world as it is now, by name.
        periods_ns: the period of each name; None for one that is measured whenever it is read.
        world: the world.
        robot: the number of the robot; what is measured arrives after the delay of its readings.
        faults: when nothing is measured, or nothing new; None if there is no such time.

    Attributes:
        scheduled: the names that are measured at the ends of steps, and not when they are read.
        arrived: the newest measurements of these, with the world's times at which they were taken.
    """

    def __init__(
        self,
        take: Callable[[str], Measurement[T]],
        periods_ns: Mapping[str, int | None],
        world: Physics,
        robot: int,
        faults: FaultTimeline | None = None,
    ) -> None:
        self._take = take
        self._world = world
        self._delay_ns = world.configs[robot].reading_delay_ns
        self._faults = faults
        self._underway: deque[tuple[int, dict[str, tuple[Measurement[T], int] | None]]] = deque()
        self.arrived: dict[str, tuple[Measurement[T], int]] = {}
        each_step_ns = 1 if self._delay_ns or faults is not None else None
        schedules: dict[int, _Schedule] = {}
        for name, period_ns in periods_ns.items():
            step_or_period_ns = each_step_ns if period_ns is None else period_ns
            if step_or_period_ns is not None:
                schedules.setdefault(step_or_period_ns, _Schedule(step_or_period_ns)).names.append(name)
        self._schedules = tuple(schedules.values())
        self.scheduled = frozenset(name for schedule in self._schedules for name in schedule.names)
        self._due_ns = 0
        if schedules:
            self._measure()
            world.on_step(self._measure)

    def newest(self, name: str) -> tuple[T, int] | None:
        """Return what was measured last of what has arrived, and its age in ns; None if there is nothing."""
        if name not in self.scheduled:
            return self._take(name)(), 0
        if name not in self.arrived:
            return None
        measurement, taken_ns = self.arrived[name]
        return measurement(), self._world.elapsed_ns - taken_ns

    def _measure(self) -> None:
        """Measure what is due, and receive what has arrived."""
        elapsed_ns = self._world.elapsed_ns
        if elapsed_ns >= self._due_ns:
            fault = None if self._faults is None else self._faults.at(elapsed_ns)
            for schedule in self._schedules:
                if elapsed_ns >= schedule.due_ns:
                    schedule.due_ns = (elapsed_ns // schedule.period_ns + 1) * schedule.period_ns
                    if fault is not Fault.FROZEN:
                        taken = {
                            name: None if fault is Fault.MISSING else (self._take(name), elapsed_ns)
                            for name in schedule.names
                        }
                        self._underway.append((elapsed_ns + self._delay_ns, taken))
            self._due_ns = min(schedule.due_ns for schedule in self._schedules)
        while self._underway and self._underway[0][0] <= elapsed_ns:
            for name, measurement in self._underway.popleft()[1].items():
                if measurement is None:
                    self.arrived.pop(name, None)
                else:
                    self.arrived[name] = measurement


# --- device -------------------------------------------------------------------------------------------


class SimulatedDevice(Protocol):
    """A device of a robot in a world. `now_ns` is the time that the world has reached, on the Clock."""

    def sense(self, now_ns: int) -> Mapping[str, Sample | None]:
        """Return all fields, with the time at which each was measured; None for one without a value."""
        ...

    def command(self, name: str, values: Mapping[str, ScalarValue], now_ns: int) -> None:
        """Carry out a command, with its parameters by name, after the delay of the robot's commands.

        Raises:
            ValueError: the device has no such command, or it cannot be carried out.
        """
        ...

    def safe(self, now_ns: int) -> None:
        """Make the device safe, after the same delay: whatever moves stops where it is."""
        ...


class SimulatedSensor:
    """What mechanisms have in common that measure at once and take no commands."""

    def measure(self, field: str) -> Value | None:
        """Return what a field reads; see `Mechanism`."""
        raise NotImplementedError

    def take(self, field: str) -> Measurement[Value | None]:
        """Take a measurement; see `Mechanism`."""
        value = self.measure(field)
        return lambda: value

    def action(self, name: str, values: Mapping[str, ScalarValue]) -> Action:
        """Raise ValueError: there are no commands."""
        raise ValueError(f"a sensor has no command `{name}`")

    def safe(self) -> None:
        """Do nothing: nothing moves."""


class MeasuringDevice:
    """A mechanism that measures at the rates of its fields. Stateful: the mechanism and its measurements.

    Args:
        server: the name of its server.
        mechanism: what it is.
        periods_ns: its fields, in order, with the period of each; None for one that is measured when it is
            read.
        world: the world.
        robot: the number of the robot.
        given: what fields read in place of what is measured.
        faults: the faults of its readings.
    """

    def __init__(
        self,
        server: str,
        mechanism: Mechanism,
        periods_ns: Mapping[str, int | None],
        world: Physics,
        robot: int,
        given: Given,
        *,
        faults: FaultTimeline | None = None,
    ) -> None:
        self._server = server
        self._mechanism = mechanism
        self._world = world
        self._robot = robot
        self._given = None if given is nothing_given else given
        measured = {field: period for field, period in periods_ns.items() if field in mechanism.fields}
        measurements = TimedMeasurements(mechanism.take, measured, world, robot, faults)
        self._arrived = measurements.arrived
        # With what is measured when it is read.
        self._fields = [
            (field, mechanism.measure if field in measured and field not in measurements.scheduled else None)
            for field in periods_ns
        ]

    def sense(self, now_ns: int) -> Mapping[str, Sample | None]:
        """Return all fields; see `SimulatedDevice`."""
        found: dict[str, Sample | None] = {}
        given, arrived = self._given, self._arrived
        for field, measure in self._fields:
            value = None if given is None else given(self._server, field, now_ns)
            taken_ns = now_ns
            if value is None:
                if measure is not None:
                    value = measure(field)
                elif field in arrived:
                    measurement, elapsed_ns = arrived[field]
                    value, taken_ns = measurement(), now_ns - self._world.elapsed_ns + elapsed_ns
            found[field] = None if value is None or value == "missing" else Sample(value, taken_ns)
        return found

    def command(self, name: str, values: Mapping[str, ScalarValue], now_ns: int) -> None:
        """Carry out a command; see `SimulatedDevice`."""
        self._world.carry_out(self._robot, self._mechanism.action(name, values))

    def safe(self, now_ns: int) -> None:
        """Make the device safe; see `SimulatedDevice`."""
        self._world.carry_out(self._robot, self._mechanism.safe)
