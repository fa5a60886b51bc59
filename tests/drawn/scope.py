"""The leaves of drawn expressions: literals of each dimension, and names in scope."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from colony.ir.types import Array, Enum, Type
from colony.text.units import ANGLE, LENGTH, NUMBER, TIME, Dimension

SPEED = LENGTH.over(TIME)
TURN_RATE = ANGLE.over(TIME)

LITERALS: dict[Dimension, tuple[str, ...]] = {
    NUMBER: ("1", "2", "2.5", "0.5", "0.1", "7", "100", "1e9", "1e300"),
    LENGTH: ("1 mm", "0.5 mm", "100 mm", "0 mm", "50 cm", "1 m", "2.5 m", "1 inch", "0.1 ft", "1e300 m"),
    TIME: ("1 s", "50 ms", "0 s", "150 ms", "0.1 s", "1 min", "2 s"),
    ANGLE: ("10 deg", "90 deg", "0 deg", "180 deg", "1 rad", "359.5 deg", "720 deg"),
    SPEED: ("100 mm/s", "0 mm/s", "0.3 m/s", "600 mm/s", "1 ft/s", "7 inch/min"),
    TURN_RATE: ("30 deg/s", "0 deg/s", "1 rad/s", "90 deg/s", "600 deg/min"),
}
"""Literals of a few magnitudes, so that values are often equal; some overflow when multiplied."""

ODD_NUMBERS = ("sqrt(-1)", "(1 / 0)", "(-1 / 0)", "(-1 / (1 / 0))", "(sqrt(-1) + 1)")
"""NaN (twice, as most mistakes concern it), the infinities, and -0.0."""

DURATIONS_MS = (100, 50, 150, 20, 1000)


@dataclass(frozen=True, slots=True, kw_only=True)
class Named:
    """A value that an expression may read; `fresh` is true if `fresh(...)` accepts it."""

    text: str
    type: Type
    fresh: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedArray:
    """An array that an expression may read; its type has bearings if they are known."""

    text: str
    type: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Scope:
    """The names that an expression may use.

    `contract_conditions` may be used only in contracts. `loops` is the number of enclosing reductions, and
    `rounds` that of their rounds together.
    """

    names: tuple[Named, ...] = ()
    enums: tuple[Enum, ...] = ()
    memory: bool = True
    contract_conditions: tuple[str, ...] = ()
    loops: int = 0
    rounds: int = 1
    constants: dict[Dimension, tuple[str, ...]] = field(default_factory=dict)  # params

    def of(self, type_: Type) -> list[str]:
        """Return the names of this type."""
        return [n.text for n in self.names if n.type == type_]

    def with_names(self, *names: Named) -> Scope:
        """Return the scope with more names."""
        return replace(self, names=(*self.names, *names))
