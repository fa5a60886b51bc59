"""The automaton of the plates, against Table 6.6."""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import pytest

from colony.nav.confidence.plates import TABLE_6_6, PlateEvents


def test_every_row_is_a_distribution() -> None:
    assert [sum(row) for row in TABLE_6_6.matrix()] == [1, 1, 1, 1]


def test_the_starts_that_are_impossible() -> None:
    start = TABLE_6_6.matrix()[0]
    assert start[2] == start[3] == 0


def test_all_plates_as_printed() -> None:
    assert round(float(TABLE_6_6.all_as_printed(1)), 4) == 0.8148
    assert TABLE_6_6.all_as_printed(7) == Fraction(132, 162) ** 7


def test_all_plates_by_the_matrix() -> None:
    """The first is always found; each other one at once, or after something that is none."""
    each = Fraction(132, 162) + Fraction(11, 162) * Fraction(10, 11)
    for plates in range(1, 6):
        assert TABLE_6_6.all_detected(plates) == each ** (plates - 1)
        assert TABLE_6_6.none_false(plates) == Fraction(132, 162) ** (plates - 1)
    assert TABLE_6_6.all_detected(0) == TABLE_6_6.none_false(0) == 1
    assert round(float(TABLE_6_6.all_detected(10)), 4) == 0.3055


@pytest.mark.parametrize("plates", [1, 2, 3, 4])
def test_the_matrix_says_what_listing_all_paths_says(plates: int) -> None:
    events = PlateEvents(
        missed_first=Fraction(1, 10),
        read_first=Fraction(7, 10),
        false_first=Fraction(2, 10),
        missed=Fraction(2, 10),
        read=Fraction(5, 10),
        false=Fraction(3, 10),
        missed_after_false=Fraction(1, 4),
        read_after_false=Fraction(3, 4),
        read_after_miss=Fraction(1),
    )
    total = Fraction(0)
    for path in product(("at once", "after a false one"), repeat=plates):
        chance = Fraction(1)
        for i, how in enumerate(path):
            once, false = (events.read_first, events.false_first) if i == 0 else (events.read, events.false)
            chance *= once if how == "at once" else false * events.read_after_false
        total += chance
    assert events.all_detected(plates) == total
