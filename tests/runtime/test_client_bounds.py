"""A client and its memory at the edges: the newest frame, the oldest that will do, what nobody asked for."""

from __future__ import annotations

from colony.runtime.messages import Checkpoint, Fetch, Ready, Recall, Request
from tests.runtime.test_client import ADDRESS, FRAME, KEPT, MS, back_off, base, only, saved, take, tick


def memory(k: int) -> Checkpoint:
    return Checkpoint(client=ADDRESS, k=k, start=0, memory=saved().memory)


def test_memory_that_was_not_asked_for_is_none() -> None:
    node = back_off()
    take(node, tick(3))
    assert take(node, memory(2)) == []
    assert node.frontier == (0, -1)


def test_memory_after_the_newest_frame_will_do() -> None:
    node = back_off()
    assert take(node, tick(60)) == [Recall(client=ADDRESS)]
    assert take(node, memory(60)) == []
    assert node.frontier == (0, 60)
    assert len(only(Request, take(node, tick(61), base(61)))) == 1


def test_memory_after_the_first_frame_will_do_where_the_rest_is_to_be_had() -> None:
    node = back_off()
    assert take(node, tick(KEPT)) == [Recall(client=ADDRESS)]
    got = take(node, memory(0))
    assert {m.k for m in got if isinstance(m, Fetch)} == {*range(1, KEPT)}
    assert node.frontier == (0, 0)


def test_with_memory_it_goes_on_at_once_and_says_that_it_lives() -> None:
    node, now = back_off(), 60 * FRAME
    assert take(node, tick(60), now_ns=now) == [Recall(client=ADDRESS)]
    take(node, base(60), now_ns=now)
    got = take(node, memory(59), now_ns=now)
    assert [m.k for m in got if isinstance(m, Request)] == [60]
    assert only(Ready, got) == [Ready(client=ADDRESS, run="run", k=60)]
    assert not only(Ready, take(node, tick(61), base(61), now_ns=now + 10 * MS))
