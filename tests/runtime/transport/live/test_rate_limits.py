"""Rates at the border: who is over one is kept out, and nobody else is."""

from __future__ import annotations

import pytest

from colony.runtime.transport.live.limits import (
    BYTES_PER_TOKEN,
    CALL_RATE,
    FETCH_RATE,
    MAX_SENDERS,
    STOP_RATE,
    Meter,
    Rate,
    RateLimits,
)

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
    assert not meter.take("ada", 4 * BYTES_PER_TOKEN, 0)
    assert meter.take("ada", 3 * BYTES_PER_TOKEN, 0)
    assert not meter.take("ada", 0, 0)


def test_of_many_senders_those_are_forgotten_who_were_silent_for_longest() -> None:
    meter = Meter(Rate(per_s=0.0, burst=1.0))
    assert meter.take("ada", 0, 0)
    for n in range(MAX_SENDERS - 1):
        meter.take(f"u{n}", 0, 0)
    assert not meter.take("ada", 0, 0), "remembered"
    for n in range(MAX_SENDERS):
        meter.take(f"v{n}", 0, 0)
    assert meter.take("ada", 0, 0), "forgotten, and new again"
    assert len(meter._buckets) == MAX_SENDERS


@pytest.fixture
def limits() -> RateLimits:
    return RateLimits("here", monotonic=lambda: 7 * S)


def test_users_are_counted_over_all_of_their_connections(limits: RateLimits) -> None:
    let_in = sum(limits.admit_call(f"ada/{n}", 100) for n in range(int(CALL_RATE.burst) + 50))
    assert let_in == CALL_RATE.burst
    assert limits.admit_call("bob/1", 100)
    assert limits.admit_stop("ada/1", 100), "a flood of calls is none of stops"


def test_programs_of_this_machine_are_not_counted(limits: RateLimits) -> None:
    assert all(limits.admit_call("here/1", 100) for _ in range(10 * int(CALL_RATE.burst)))
    assert all(limits.admit_frame("fetches", "here", 50) for _ in range(10 * int(FETCH_RATE.burst)))


def test_fetches_and_stops_have_rates_of_their_own(limits: RateLimits) -> None:
    assert sum(limits.admit_frame("fetches", "ada", 50) for _ in range(2000)) == FETCH_RATE.burst
    assert limits.admit_frame("requests", "ada", 50)
    assert sum(limits.admit_stop("ada/1", 50) for _ in range(500)) == STOP_RATE.burst
    assert limits.admit_stop("bob/1", 50)


def test_a_program_of_this_machine_that_stops_without_end_keeps_no_other_from_stopping(
    limits: RateLimits,
) -> None:
    assert sum(limits.admit_stop("here/1", 50) for _ in range(500)) == STOP_RATE.burst
    assert limits.admit_stop("here/2", 50)
