"""A client and its memory at the edges: the newest frame, the oldest that will do, what nobody asked for."""

from __future__ import annotations

import pytest

from colony.execute.executor import ClientMemory
from colony.runtime.clients.client import ClientNode
from colony.runtime.clients.memory import MemoryFormatError, decode_memory, encode_memory
from colony.runtime.protocol.messages import Checkpoint, Fetch, Ready, Recall, Request
from tests.runtime.clients.test_client import (
    ADDRESS,
    FRAME,
    KEPT,
    MS,
    back_off,
    base,
    only,
    saved,
    take,
    tick,
)


def memory(k: int) -> Checkpoint:
    return Checkpoint(client=ADDRESS, k=k, start=0, memory=saved().memory)


def test_memory_that_was_not_asked_for_is_none(node: ClientNode) -> None:
    take(node, tick(3))
    assert take(node, memory(2)) == []
    assert node.frontier == (0, -1)


def test_memory_after_the_newest_frame_will_do(node: ClientNode) -> None:
    assert take(node, tick(60)) == [Recall(client=ADDRESS)]
    assert take(node, memory(60)) == []
    assert node.frontier == (0, 60)
    assert len(only(Request, take(node, tick(61), base(61)))) == 1


def test_memory_after_the_first_frame_will_do_where_the_rest_is_to_be_had(node: ClientNode) -> None:
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


def test_what_is_no_memory_says_what_is_wrong_with_it() -> None:
    for data, text in (
        (b"", "truncated"),
        (b"\x01", "Expected `array`"),
        (b"\x92\xa1x\x80", "Expected `int | null`"),
    ):
        with pytest.raises(MemoryFormatError, match=text):
            decode_memory(data)
    assert encode_memory(ClientMemory(5, {"a": 1.0})) == b"\x92\x05\x81\xa1a\xcb?\xf0\x00\x00\x00\x00\x00\x00"


def test_an_epoch_is_begun_once(node: ClientNode) -> None:
    for start, first in ((0, 0), (7, 7)):
        for k in range(first, first + 7):
            got = take(node, tick(k, start=start), base(k))
            assert len(only(Request, got)) == 1
        assert node.frontier == (start, first + 6)


def test_within_an_epoch_memory_is_given_away_and_after_its_end_no_more(node: ClientNode) -> None:
    got = [m for k in range(11) for m in take(node, tick(k), base(k), now_ns=k * FRAME)]
    assert [m.k for m in got if isinstance(m, Checkpoint)] == [10]
    got = [m for k in range(11, 21) for m in take(node, tick(k, start=11), base(k), now_ns=k * FRAME)]
    assert not only(Checkpoint, got), "the new epoch is not half a second old"
