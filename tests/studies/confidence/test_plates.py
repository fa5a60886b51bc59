"""The automaton of the plates, against Table 6.6, and its events, counted from walks."""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import pytest

from studies.confidence.estimate import Count
from studies.confidence.plates import (
    EVENT_NAMES,
    TABLE_6_6,
    TABLE_6_6_COUNTS,
    PlateEvent,
    PlateEvents,
    all_detected,
    all_detected_as_printed,
    plate_counts,
    plate_events,
)

ROWS: tuple[tuple[PlateEvent, ...], ...] = (("E4", "E7", "E1"), ("E5", "E9", "E2"), ("E8", "E6"), ("E3",))
"""The arcs of Figure 6.9 that leave S, D, P and M."""


def row_sums(events: PlateEvents) -> list[Fraction]:
    return [sum((events[event] for event in row), Fraction(0)) for row in ROWS]


def test_every_row_is_a_distribution() -> None:
    assert row_sums(TABLE_6_6) == [1, 1, 1, 1]


def test_the_starts_that_are_impossible() -> None:
    assert TABLE_6_6["E1"] == TABLE_6_6["E7"] == 0


def test_all_plates_as_printed() -> None:
    assert round(float(all_detected_as_printed(TABLE_6_6, 1)), 4) == 0.8148
    assert all_detected_as_printed(TABLE_6_6, 7) == Fraction(132, 162) ** 7


def test_all_plates_by_the_matrix() -> None:
    """The first is always found; each other one at once, or after something that is none."""
    each = Fraction(132, 162) + Fraction(11, 162) * Fraction(10, 11)
    for plates in range(1, 6):
        assert all_detected(TABLE_6_6, plates) == each ** (plates - 1)
    assert all_detected(TABLE_6_6, 0) == 1
    assert round(float(all_detected(TABLE_6_6, 10)), 4) == 0.3055


@pytest.mark.parametrize("plates", [1, 2, 3, 4])
def test_the_matrix_says_what_listing_all_paths_says(plates: int) -> None:
    events: PlateEvents = {
        "E1": Fraction(1, 10),
        "E4": Fraction(7, 10),
        "E7": Fraction(2, 10),
        "E2": Fraction(2, 10),
        "E5": Fraction(5, 10),
        "E9": Fraction(3, 10),
        "E6": Fraction(1, 4),
        "E8": Fraction(3, 4),
        "E3": Fraction(1),
    }
    total = Fraction(0)
    for path in product(("at once", "after a false one"), repeat=plates):
        chance = Fraction(1)
        for i, how in enumerate(path):
            once, false = (events["E4"], events["E7"]) if i == 0 else (events["E5"], events["E9"])
            chance *= once if how == "at once" else false * events["E8"]
        total += chance
    assert all_detected(events, plates) == total


def test_events_of_two_walks() -> None:
    counts = plate_counts(["DMDPPPDPM", "PDD"])
    assert counts == {
        "E1": Count(0, 2),
        "E2": Count(2, 8),  # D|M D P D P M and P|D D
        "E3": Count(1, 1),
        "E4": Count(1, 2),
        "E5": Count(4, 8),
        "E6": Count(1, 3),
        "E7": Count(1, 2),
        "E8": Count(2, 3),
        "E9": Count(2, 8),
    }


def test_published_totals_come_out_of_walks_with_these_totals() -> None:
    walks = ["DPD" + 122 * "D", "DPD" + 18 * "M", *(8 * ["DPD"]), "DPM"]
    counts = plate_counts(walks)
    assert {event: counts[event] for event in counts if event != "E3"} == {
        event: count for event, count in TABLE_6_6_COUNTS.items() if count is not None
    }
    assert plate_events(counts) == TABLE_6_6


def test_nothing_seen_is_taken_for_sure() -> None:
    events = plate_events(plate_counts([]))
    assert events["E4"] == events["E5"] == events["E8"] == 1
    assert all_detected(events, 20) == 1
    assert all(total in (0, 1) for total in row_sums(events))


def test_rows_of_the_matrix_add_up_to_one() -> None:
    assert row_sums(plate_events(plate_counts(["DMDPDPM", "PDD", "MD", "D"]))) == [1, 1, 1, 1]


def test_strange_letters_are_refused() -> None:
    with pytest.raises(ValueError, match="the walk `DX`; expected letters D, M and P"):
        plate_counts(["DX"])


def test_every_event_has_a_name() -> None:
    assert list(EVENT_NAMES) == list(TABLE_6_6_COUNTS) == [f"E{i}" for i in range(1, 10)]
