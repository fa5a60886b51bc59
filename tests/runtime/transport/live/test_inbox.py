"""Whoever sleeps over an inbox is roused by what comes."""

from __future__ import annotations

import pytest

from colony.runtime.protocol import topics
from colony.runtime.transport.live.inbox import Inbox, MessageQueue
from tests.kit.calling import plain_call

TOPIC = topics.TICKS


@pytest.fixture
def inbox() -> Inbox:
    """One whose taker is about to sleep."""
    made = Inbox(MessageQueue())
    assert made.pop() is None
    return made


def roused(inbox: Inbox) -> bool:
    """Whether the sleep would end at once."""
    return not inbox._wakeups.empty()


def test_what_comes_rouses_a_sleeper_once_and_is_taken_in_its_order(inbox: Inbox) -> None:
    for data in (b"1", b"2"):
        inbox.add_frame_message(TOPIC, data)
        assert roused(inbox)
    inbox.sleep(20.0)
    assert [waiting.message for waiting in iter(inbox.pop, None)] == [b"1", b"2"]
    assert not roused(inbox), "once is enough"


def test_a_call_rouses_a_sleeper(inbox: Inbox) -> None:
    inbox.add_call("RServer/call", "ada/1", plain_call("ada/1", 1), 10)
    assert roused(inbox)
