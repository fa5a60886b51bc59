"""A lock's token: one holder, the rest by priority and then in turn, and nobody waits for ever."""

from __future__ import annotations

import pytest

from colony.runtime.arbitration.outside import LockQueue
from colony.runtime.protocol.calls import CallId, RefusedError
from colony.runtime.protocol.connections import Caller
from tests.kit.node_stage import S


def asked(name: str, number: int = 1, priority: int = 0) -> CallId:
    return CallId(Caller(f"user/{name}", name, priority, "user"), number)


def names(calls: tuple[CallId, ...]) -> list[str]:
    return [call.caller.name for call in calls]


def test_the_first_who_asks_gets_it_and_may_ask_again(lock: LockQueue) -> None:
    assert lock.acquire(asked("ann"), 0, wait_ns=0)
    assert lock.acquire(asked("ann", 2), 0, wait_ns=0)
    assert lock.holder == asked("ann").caller
    assert lock.release(asked("ann").caller) == ()
    assert lock.holder is None


def test_those_who_wait_are_served_by_priority_and_then_in_turn(lock: LockQueue) -> None:
    lock.acquire(asked("ann"), 0, wait_ns=0)
    for name, priority in (("low", 1), ("high", 5), ("later", 5), ("lowest", -1)):
        assert not lock.acquire(asked(name, priority=priority), 0, wait_ns=S)
    assert [c.name for c in lock.queue] == ["high", "later", "low", "lowest"]
    order = []
    holder = asked("ann").caller
    while (granted := lock.release(holder)) != ():
        order += names(granted)
        holder = granted[0].caller
        assert lock.holder == holder
    assert order == ["high", "later", "low", "lowest"]


def test_all_calls_of_a_connection_that_wait_are_granted_together(lock: LockQueue) -> None:
    lock.acquire(asked("ann"), 0, wait_ns=0)
    for name, number in (("bob", 1), ("cy", 1), ("bob", 2)):
        lock.acquire(asked(name, number), 0, wait_ns=S)
    assert lock.release(asked("ann").caller) == (asked("bob", 1), asked("bob", 2))
    assert lock.release(asked("bob").caller) == (asked("cy"),)


def test_the_dead_neither_hold_nor_wait(lock: LockQueue) -> None:
    lock.acquire(asked("ann"), 0, wait_ns=0)
    lock.acquire(asked("bob"), 0, wait_ns=S)
    lock.acquire(asked("cy"), 0, wait_ns=S)
    assert lock.drop(asked("bob").caller) == ()
    assert lock.drop(asked("ann").caller) == (asked("cy"),)
    assert lock.drop(asked("cy").caller) == ()
    assert lock.holder is None


def test_nobody_waits_for_longer_than_asked(lock: LockQueue) -> None:
    assert lock.wake_at is None
    lock.acquire(asked("ann"), 0, wait_ns=0)
    lock.acquire(asked("bob"), 0, wait_ns=2 * S)
    lock.acquire(asked("cy"), 0, wait_ns=S)
    assert lock.wake_at == S
    assert lock.expire(S - 1) == ()
    assert lock.expire(S) == (asked("cy"),)
    assert lock.wake_at == 2 * S
    assert lock.release(asked("ann").caller) == (asked("bob"),)
    assert lock.expire(5 * S) == ()


@pytest.mark.parametrize(("wait_ns", "waits"), [(-1, False), (0, False), (1, True)])
def test_who_waits_for_a_moment_waits(lock: LockQueue, wait_ns: int, waits: bool) -> None:
    lock.acquire(asked("ann"), 0, wait_ns=0)
    if waits:
        assert not lock.acquire(asked("bob"), 7, wait_ns=wait_ns)
        assert lock.wake_at == 7 + wait_ns
    else:
        with pytest.raises(RefusedError) as refused:
            lock.acquire(asked("bob"), 7, wait_ns=wait_ns)
        assert (refused.value.problem.code, refused.value.problem.message) == ("locked", "ann holds the lock")


def test_who_asked_first_is_served_first_however_long_anybody_waits(lock: LockQueue) -> None:
    lock.acquire(asked("ann"), 0, wait_ns=0)
    for name, wait in (("patient", 9 * S), ("hasty", S), ("other", 5 * S)):
        lock.acquire(asked(name), 0, wait_ns=wait)
    assert [c.name for c in lock.queue] == ["patient", "hasty", "other"]


@pytest.mark.parametrize("holder", [None, asked("bob").caller])
def test_only_the_holder_gives_it_back(lock: LockQueue, holder: Caller | None) -> None:
    assert lock.refusal().problem.message == "nobody holds the lock"
    if holder is not None:
        lock.acquire(asked("bob"), 0, wait_ns=0)
    with pytest.raises(RefusedError) as refused:
        lock.release(asked("ann").caller)
    found = refused.value.problem
    assert (found.code, found.message) == ("unlocked", "ann does not hold the lock")
    assert lock.drop(asked("ann").caller) == ()
    assert lock.holder == holder


def test_who_gives_up_several_calls_is_out_of_all(lock: LockQueue) -> None:
    lock.acquire(asked("ann"), 0, wait_ns=0)
    for name, number, wait in (("bob", 1, S), ("cy", 1, 3 * S), ("bob", 2, 2 * S)):
        lock.acquire(asked(name, number), 0, wait_ns=wait)
    assert lock.drop(asked("bob").caller) == ()
    assert [c.name for c in lock.queue] == ["cy"]
    assert lock.holder == asked("ann").caller
    assert names(lock.release(asked("ann").caller)) == ["cy"]
    assert lock.queue == ()


def test_those_who_are_late_are_told_in_the_order_in_which_they_were_to_be_served(lock: LockQueue) -> None:
    lock.acquire(asked("ann"), 0, wait_ns=0)
    for name, priority in (("low", 1), ("high", 5), ("patient", 9)):
        lock.acquire(asked(name, priority=priority), 0, wait_ns=9 * S if name == "patient" else S)
    assert names(lock.expire(S)) == ["high", "low"]
    assert [c.name for c in lock.queue] == ["patient"]
