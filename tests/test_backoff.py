"""Growing pauses."""

from __future__ import annotations

from colony.backoff import Backoff


def test_backoff_doubles_up_to_the_longest_pause_and_begins_again_after_a_reset() -> None:
    backoff = Backoff(2, 9)
    assert [backoff.next() for _ in range(4)] == [2, 4, 8, 9]
    assert backoff.pause == 9
    backoff.reset()
    assert [backoff.next(), backoff.pause] == [2, 4]
