"""The newest measurements of a device, each with its time. Pure: times are given."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from colony.drivers.dialect import ImplausibleError, Readings
from colony.ir.types import ScalarValue, Value
from colony.runtime.servers.drivers import BaseState, Reading


class Measurements:
    """What was measured last. Mutable.

    Args:
        rings: number of elements of each ring.
        bounds: least and greatest value of fields and elements.
        max_speed: greatest possible speed of the base, in mm/s, in any direction.
        max_turn: its greatest possible turn rate, in deg/s.
    """

    def __init__(
        self,
        *,
        rings: Mapping[str, int],
        bounds: Mapping[str, tuple[float, float]],
        max_speed: float,
        max_turn: float,
    ) -> None:
        self._rings = rings
        self._bounds = bounds
        self._max_speed = max_speed
        self._max_turn = max_turn
        self._fields: dict[str, tuple[Value, int]] = {}
        self._elements: dict[str, dict[int, tuple[ScalarValue, int]]] = {name: {} for name in rings}
        self.base: BaseState | None = None

    def take(self, readings: Readings, t_ns: int) -> None:
        """Take what a packet measured at `t_ns`, all of it or nothing.

        Raises:
            ImplausibleError: a value is outside the device's physics.
        """
        self._check(readings)
        self.base = readings.base or self.base
        for name, value in readings.fields.items():
            self._fields[name] = value, t_ns
        for name, elements in readings.elements.items():
            self._elements[name].update({i: (value, t_ns) for i, value in elements.items()})

    def clear(self) -> None:
        """Forget everything: the line is lost."""
        self.base = None
        self._fields.clear()
        for elements in self._elements.values():
            elements.clear()

    def readings(self, now_ns: int, names: Collection[str] | None = None) -> Mapping[str, Reading]:
        """Return the fields, and the rings of which each element was heard: as old as the oldest of them.

        With `names`, only those.
        """
        wanted = (*self._fields, *self._rings) if names is None else names
        fields = ((name, self._fields[name]) for name in wanted if name in self._fields)
        found = {name: Reading(value, max(0, now_ns - t_ns)) for name, (value, t_ns) in fields}
        for name in wanted:
            if (size := self._rings.get(name)) is None:
                continue
            elements = self._elements[name]
            if len(elements) == size:
                values = tuple(elements[i][0] for i in range(size))
                found[name] = Reading(values, max(0, now_ns - min(t_ns for _, t_ns in elements.values())))
        return found

    def _check(self, readings: Readings) -> None:
        for name, value in readings.fields.items():
            if not isinstance(value, (tuple, list)):
                self._check_value(name, value)
                continue
            for element in value:
                self._check_element(name, element)
        for name, elements in readings.elements.items():
            for i, value in elements.items():
                if not 0 <= i < self._rings[name]:
                    raise ImplausibleError(f"{name}[{i}]: the ring has {self._rings[name]} elements")
                self._check_element(name, value)
        if (base := readings.base) is not None:
            speed = max(math.hypot(base.speed, base.sideways_speed), abs(base.wheel_speed))
            if not speed <= self._max_speed:
                raise ImplausibleError(
                    f"the base drives at {speed:g} mm/s; at most {self._max_speed:g} is possible"
                )
            if not abs(base.turn_rate) <= self._max_turn:
                text = f"the base turns at {base.turn_rate:g} deg/s; at most {self._max_turn:g} is possible"
                raise ImplausibleError(text)

    def _check_element(self, name: str, value: ScalarValue | None) -> None:
        if value is not None and value != math.inf:
            self._check_value(name, value)

    def _check_value(self, name: str, value: ScalarValue) -> None:
        low, high = self._bounds.get(name, (-math.inf, math.inf))
        if not low <= value <= high:
            raise ImplausibleError(f"{name} is {value}; from {low:g} to {high:g} is possible")
