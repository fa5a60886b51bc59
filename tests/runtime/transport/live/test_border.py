"""Rates at the border: who is over one is kept out, and nobody else is."""

from __future__ import annotations

import pytest

from colony.runtime.transport.live.border import CALLS, FETCHES, STOPS, Border
from colony.runtime.transport.live.meter import BYTES_A_TOKEN, SENDERS, Meter, Rate

S = 1_000_000_000


def test_a_burst_passes_and_then_the_rate() -> None:
    meter = Meter(Rate(per_s=10.0, burst=3.0))
    assert [meter.take("ada", 0, 0) for _ in range(4)] == [True, True, True, False]
    assert not meter.take("ada", 0, S // 20)
    assert meter.take("ada", 0, S // 10)
    assert not meter.take("ada", 0, S // 10)
    assert [meter.take("ada", 0, 100 * S) for _ in range(4)] == [True, True, True, False]


def test_everybody_has_a_rate_of_their_own() -> None:
    meter = Meter(Rate(per_s=1.0, burst=1.0))
    assert meter.take("ada", 0, 0)
    assert not meter.take("ada", 0, 0)
    assert meter.take("bob", 0, 0)


def test_bytes_cost_too() -> None:
    meter = Meter(Rate(per_s=1.0, burst=4.0))
    assert not meter.take("ada", 4 * BYTES_A_TOKEN, 0)
    assert meter.take("ada", 3 * BYTES_A_TOKEN, 0)
    assert not meter.take("ada", 0, 0)


def test_of_many_senders_those_are_forgotten_who_were_silent_for_longest() -> None:
    meter = Meter(Rate(per_s=0.0, burst=1.0))
    assert meter.take("ada", 0, 0)
    for n in range(SENDERS - 1):
        meter.take(f"u{n}", 0, 0)
    assert not meter.take("ada", 0, 0), "remembered"
    for n in range(SENDERS):
        meter.take(f"v{n}", 0, 0)
    assert meter.take("ada", 0, 0), "forgotten, and new again"
    assert len(meter._buckets) == SENDERS


@pytest.fixture
def border() -> Border:
    return Border("here", monotonic=lambda: 7 * S)


def test_users_are_counted_over_all_of_their_connections(border: Border) -> None:
    let_in = sum(border.call(f"ada/{n}", 100) for n in range(int(CALLS.burst) + 50))
    assert let_in == CALLS.burst
    assert border.call("bob/1", 100)
    assert border.stop("ada/1", 100), "a flood of calls is none of stops"


def test_programs_of_this_machine_are_not_counted(border: Border) -> None:
    assert all(border.call("here/1", 100) for _ in range(10 * int(CALLS.burst)))
    assert all(border.frame("fetches", "here", 50) for _ in range(10 * int(FETCHES.burst)))


def test_fetches_and_stops_have_rates_of_their_own(border: Border) -> None:
    assert sum(border.frame("fetches", "ada", 50) for _ in range(2000)) == FETCHES.burst
    assert border.frame("requests", "ada", 50)
    assert sum(border.stop("ada/1", 50) for _ in range(500)) == STOPS.burst
    assert border.stop("bob/1", 50)


def test_a_program_of_this_machine_that_stops_without_end_keeps_no_other_from_stopping(
    border: Border,
) -> None:
    assert sum(border.stop("here/1", 50) for _ in range(500)) == STOPS.burst
    assert border.stop("here/2", 50)
