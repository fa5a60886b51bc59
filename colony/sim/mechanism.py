"""What a simulated device is, apart from when it measures and over what it is asked."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping
from typing import Literal, Protocol, TypeVar

from colony.ir.types import ScalarValue, Value

# --- given ---------------------------------------------------------------------------------------------
#
# What fields of simulated devices read because it is given, in place of what is measured.


GivenValue = Value | Literal["missing"] | None
"""A given value of a field, in base units; `missing` if it is to have none, None if nothing is given."""

Given = Callable[[str, str, int], GivenValue]
"""A function that returns what is given: server, field, time in ns."""


def nothing_given(server: str, field: str, now_ns: int) -> GivenValue:
    """Return None: no field is given."""
    return None


class GivenTimeline:
    """What is given for fields over time; a value holds until the next one. Mutable."""

    def __init__(self) -> None:
        self._times: dict[tuple[str, str], list[int]] = {}
        self._values: dict[tuple[str, str], list[GivenValue]] = {}
        self.size = 0
        """The number of changes."""

    def add(self, server: str, field: str, t_ns: int, value: GivenValue) -> None:
        """Give a field a value from a time on; of several at one time the last one counts."""
        times = self._times.setdefault((server, field), [])
        values = self._values.setdefault((server, field), [])
        i = bisect_right(times, t_ns)
        times.insert(i, t_ns)
        values.insert(i, value)
        self.size += 1

    def value_at(self, server: str, field: str, t_ns: int) -> GivenValue:
        """Return what is given for a field at a time; None if nothing is given yet."""
        times = self._times.get((server, field))
        if times is None:
            return None
        i = bisect_right(times, t_ns)
        return self._values[server, field][i - 1] if i else None


# --- mechanism -----------------------------------------------------------------------------------------


T = TypeVar("T")

Measurement = Callable[[], T]
"""A measurement that was taken; its value is computed when it is needed."""

Action = Callable[[], None]
"""A function that carries out a command."""


class Mechanism(Protocol):
    """What a device is, apart from when it measures."""

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of the fields that it measures."""
        ...

    def measure(self, field: str) -> Value | None:
        """Return what a field reads in the world as it is now; None if there is nothing to measure."""
        ...

    def take(self, field: str) -> Measurement[Value | None]:
        """Take a measurement of the world as it is now, which `measure` would return."""
        ...

    def action(self, name: str, values: Mapping[str, ScalarValue]) -> Action:
        """Return what carries out a command when it is called; raise as `SimulatedDevice.command` does."""
        ...

    def safe(self) -> None:
        """Make the device safe now."""
        ...
