"""The robot's time on another machine."""

from __future__ import annotations

import random

from colony.runtime.transport.live.robot_time import DRIFT, LearnedTime

MS = 1_000_000


def test_before_the_first_tick_it_is_nothing() -> None:
    learned = LearnedTime(lambda: 5)
    assert (learned.has_ticked, learned()) == (False, 0)


def test_the_least_delayed_tick_counts_and_time_never_goes_back() -> None:
    now = [0]
    learned = LearnedTime(lambda: now[0])
    draw = random.Random(1)
    offset, last = 123_456_789, 0
    for k in range(200):
        due = k * 50 * MS
        late = draw.choice((2 * MS, 5 * MS, 40 * MS)) if k != 100 else MS
        now[0] = due - offset + late
        learned.on_tick(due)
        assert learned() >= last
        last = learned()
        assert learned.has_ticked
    truth = now[0] + offset
    assert 0 <= truth - learned() <= MS + int(DRIFT * 100 * 50 * MS)


def test_it_follows_a_clock_that_drifts() -> None:
    now = [0]
    learned = LearnedTime(lambda: now[0])
    for k in range(20_000):
        due = k * 50 * MS
        now[0] = int(due * (1 + DRIFT / 2)) + MS  # this machine's clock is fast
        learned.on_tick(due)
    assert abs(learned() - 19_999 * 50 * MS) <= 2 * MS
