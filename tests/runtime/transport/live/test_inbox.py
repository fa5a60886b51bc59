"""Whoever sleeps over an inbox is roused by what comes, except by what may wait for others."""

from __future__ import annotations

import pytest

from colony.runtime.protocol import topics
from colony.runtime.transport.live.inbox import Inbox
from colony.runtime.transport.live.message_queue import MessageQueue
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


def test_what_may_wait_rouses_nobody_and_is_taken_in_its_order_with_what_rouses(inbox: Inbox) -> None:
    inbox.add_frame_message(TOPIC, b"1", rouse=False)
    assert not roused(inbox)
    inbox.add_frame_message(TOPIC, b"2")
    assert roused(inbox)
    inbox.add_frame_message(TOPIC, b"3", rouse=False)
    inbox.sleep(20.0)
    taken = [waiting.message for waiting in iter(inbox.pop, None)]
    assert taken == [b"1", b"2", b"3"]
    assert not roused(inbox), "once is enough"


def test_a_call_rouses_who_slept_over_what_may_wait(inbox: Inbox) -> None:
    inbox.add_frame_message(TOPIC, b"1", rouse=False)
    inbox.add_call("RServer/call", "ada/1", plain_call("ada/1", 1), 10)
    assert roused(inbox)


def test_while_something_waits_nobody_overtakes_it(inbox: Inbox) -> None:
    inbox.add_frame_message(TOPIC, b"1", rouse=False)
    assert not inbox.claim()
    assert inbox.pop() is not None
    assert inbox.claim()
