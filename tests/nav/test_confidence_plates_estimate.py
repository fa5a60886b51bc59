"""Events of the plate automaton, counted from walks."""

from __future__ import annotations

from fractions import Fraction

import pytest

from colony.nav.confidence.estimate import Count
from colony.nav.confidence.plates import TABLE_6_6
from colony.nav.confidence.plates_estimate import EVENT_NAMES, TABLE_6_6_COUNTS, plate_counts, plate_events


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
    assert events.read_first == events.read == events.read_after_false == 1
    assert events.all_detected(20) == events.none_false(20) == 1
    assert all(sum(row) in (0, 1) for row in events.matrix())


def test_rows_of_the_matrix_add_up_to_one() -> None:
    matrix = plate_events(plate_counts(["DMDPDPM", "PDD", "MD", "D"])).matrix()
    assert [sum(row) for row in matrix] == [Fraction(1)] * 4


def test_strange_letters_are_refused() -> None:
    with pytest.raises(ValueError, match="the walk `DX`; expected letters D, M and P"):
        plate_counts(["DX"])


def test_every_event_has_a_name() -> None:
    assert list(EVENT_NAMES) == list(TABLE_6_6_COUNTS) == [f"E{i}" for i in range(1, 10)]
