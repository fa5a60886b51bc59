"""How likely all door number plates of a corridor are read: the automaton of thesis Figures 6.8 and 6.9.

    S start    D a plate was detected    P something else was taken for a plate    M a plate was missed

At most one plate is missed, and at most one false one seen, between two that are detected (section 6.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

PlateState = Literal["S", "D", "P", "M"]
PLATE_STATES: tuple[PlateState, ...] = ("S", "D", "P", "M")
"""In the order of rows and columns."""

PlateMatrix = tuple[tuple[Fraction, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateEvents:
    """The probabilities of the events E1 to E9 of Table 6.6.

    Attributes:
        missed_first, missed: E1, E2, a plate is missed: the first of a corridor, any other.
        read_after_miss: E3, the next one is detected.
        read_first, read: E4, E5, a plate is detected: the first of a corridor, any other.
        missed_after_false: E6, a plate is missed after a false one.
        false_first, false: E7, E9, a false one is seen: before the first plate, before any other.
        read_after_false: E8, a plate is detected after a false one.
    """

    missed_first: Fraction
    missed: Fraction
    read_after_miss: Fraction
    read_first: Fraction
    read: Fraction
    missed_after_false: Fraction
    false_first: Fraction
    read_after_false: Fraction
    false: Fraction

    def matrix(self) -> PlateMatrix:
        """The transition probabilities of Figure 6.9; every row adds up to 1."""
        zero = Fraction(0)
        return (
            (zero, self.read_first, self.false_first, self.missed_first),
            (zero, self.read, self.false, self.missed),
            (zero, self.read_after_false, zero, self.missed_after_false),
            (zero, self.read_after_miss, zero, zero),
        )

    def all_as_printed(self, plates: int) -> Fraction:
        """p5 to the power of `plates`: the thesis's probability that all are detected.

        It takes the first plate for one like the others, and a false one in between for a failure.
        """
        return self.read**plates

    def all_detected(self, plates: int) -> Fraction:
        """The probability, by the matrix, that all are detected, whatever else is taken for a plate."""
        matrix = self.matrix()
        false = PLATE_STATES.index("P")
        row = [Fraction(state == "S") for state in PLATE_STATES]
        for _ in range(plates):
            # A plate is detected at once, or after one false plate; who misses it is out.
            seen = [row[i] for i in range(4)]
            seen[false] = sum((row[i] * matrix[i][false] for i in range(4)), Fraction(0))
            detected = sum((seen[i] * matrix[i][1] for i in range(4)), Fraction(0))
            row = [Fraction(0), detected, Fraction(0), Fraction(0)]
        return row[1] if plates else Fraction(1)

    def none_false(self, plates: int) -> Fraction:
        """The probability, by the matrix, that all are detected and nothing else is taken for one."""
        return self.read_first * self.read ** (plates - 1) if plates else Fraction(1)


TABLE_6_6 = PlateEvents(
    missed_first=Fraction(0, 11),
    missed=Fraction(19, 162),
    read_after_miss=Fraction(1),
    read_first=Fraction(11, 11),
    read=Fraction(132, 162),
    missed_after_false=Fraction(1, 11),
    false_first=Fraction(0, 11),
    read_after_false=Fraction(10, 11),
    false=Fraction(11, 162),
)
"""As published, from the eleven walks of Table 6.3."""
