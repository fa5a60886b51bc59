"""Ticks come at whole frame periods and say who has not been heard of within the lease."""

from __future__ import annotations

from colony.runtime.clock import Clock
from colony.runtime.liveness import Liveness, lease
from colony.runtime.messages import Fetch, Request, Send, ServerFrame, Tick, Wake, WakeAt

MS = 1_000_000


def clock() -> Clock:
    return Clock(
        frame_ns=50 * MS,
        servers=("PServer", "RServer"),
        clients=(("drive/avoid", "RServer"),),
        lease_ns=100 * MS,
        keep=3,
    )


def tick_of(one: Clock, now_ns: int) -> Tick:
    sent, wake = one.handle(Wake(), now_ns)
    assert isinstance(sent, Send)
    assert isinstance(wake, WakeAt)
    assert isinstance(sent.message, Tick)
    return sent.message


def test_ticks_are_at_whole_periods_even_when_woken_late() -> None:
    one = clock()
    assert list(one.start(1000)) == [WakeAt(1000)]
    assert tick_of(one, 1000).t_ns == 1000
    assert list(one.handle(Wake(), 2000)) == [WakeAt(1000 + 50 * MS)]
    late = tick_of(one, 50 * MS + 7777)
    assert (late.k, late.t_ns) == (1, 1000 + 50 * MS)


def test_who_is_not_heard_of_is_down_or_lost_and_may_come_back() -> None:
    one = clock()
    one.start(0)
    for k in range(3):
        tick = tick_of(one, k * 50 * MS)
        assert (tick.down, tick.lost) == ((), ())
        one.handle(ServerFrame(server="RServer", k=k, fields={}), tick.t_ns)
    tick = tick_of(one, 150 * MS)
    assert (tick.down, tick.lost) == (("PServer",), ("drive/avoid",))
    one.handle(ServerFrame(server="PServer", k=3, fields={}), 150 * MS)
    one.handle(Request(k=3, actuator="drive", client="avoid", bid="silent"), 150 * MS)
    tick = tick_of(one, 200 * MS)
    assert (tick.down, tick.lost) == ((), ())


def test_it_keeps_the_last_ticks() -> None:
    one = clock()
    one.start(0)
    ticks = [tick_of(one, k * 50 * MS) for k in range(5)]
    assert list(one.handle(Fetch(server="Clock", k=4), 0)) == [Send("Clock/ticks", ticks[4])]
    assert list(one.handle(Fetch(server="Clock", k=1), 0)) == []
    assert one.listens == ("Clock/fetches", "PServer/frames", "RServer/frames", "RServer/requests")


def test_liveness_ignores_strangers() -> None:
    liveness = Liveness(("a",), lease_ns=10, now_ns=0)
    liveness.heard("b", 100)
    assert liveness.missing(10) == ()
    assert liveness.missing(11) == ("a",)


def test_the_lease_is_at_least_three_frames() -> None:
    assert lease(50 * MS) == 250 * MS
    assert lease(1000 * MS) == 3000 * MS
