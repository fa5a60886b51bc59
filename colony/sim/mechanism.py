"""What a simulated device is, apart from when it measures and over what it is asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol, TypeVar

from colony.ir.types import ScalarValue, Value

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
