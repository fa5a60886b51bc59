"""The order in which waiting messages are taken, and what is given up when too much waits."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from colony.runtime.protocol.messages import Alive, Call, Malformed, Right
from colony.runtime.transport.live.inbox import (
    MAX_STOPS_PER_CONNECTION,
    DroppedCall,
    MessageQueue,
    QueuedMessage,
)
from tests.kit.calling import plain_call

CALLS = "RServer/call"


def _put(room: MessageQueue, call: Call, size: int = 10) -> None:
    room.add_call(CALLS, call.connection, call, size)


def _all(room: MessageQueue) -> list[object]:
    return [waiting.message for waiting in iter(room.pop, None)]


def test_stops_then_frames_then_calls_by_priority_first_come_first_served() -> None:
    room = MessageQueue()
    low, high_1, high_2 = (
        plain_call("u/low", 1, priority=1),
        plain_call("u/a", 1, priority=5),
        plain_call("u/b", 1, priority=5),
    )
    stop = plain_call("u/low", 2, priority=1, right="stop")
    _put(room, low)
    _put(room, high_1)
    room.add_frame_message("Clock/ticks", b"1")
    _put(room, high_2)
    _put(room, stop)
    room.add_frame_message("Clock/ticks", b"2")
    assert _all(room) == [stop, b"1", b"2", high_1, high_2, low]


def test_signs_of_life_do_not_wait_behind_calls_and_do_not_pile_up() -> None:
    room, alive = MessageQueue(), Alive(connection="u/a")
    call = plain_call("u/b", 1, priority=100)
    _put(room, call)
    for _ in range(5):
        room.add_call(CALLS, "u/a", alive, 3)
    assert _all(room) == [alive, call]
    room.add_call(CALLS, "u/a", alive, 3)
    assert room.pop() == QueuedMessage(CALLS, alive)


def test_who_calls_too_fast_is_refused_further_calls_and_nobody_else_is() -> None:
    room = MessageQueue(max_calls_per_connection=3)
    other = plain_call("u/other", 1)
    _put(room, other)
    flood = [plain_call("u/flood", n) for n in range(1, 6)]
    for call in flood:
        _put(room, call)
    assert list(room.dropped_calls()) == [DroppedCall(CALLS, "u/flood", 4), DroppedCall(CALLS, "u/flood", 5)]
    assert not room.has_dropped_calls
    assert room.is_full_for("u/flood")
    assert not room.is_full_for("u/other")
    assert _all(room) == [other, *flood[:3]]
    assert not room.is_full_for("u/flood")


def test_too_many_bytes_of_one_are_given_up_but_never_the_only_call() -> None:
    room = MessageQueue(max_bytes_per_connection=100, overhead=0)
    first, second = plain_call("u/a", 1), plain_call("u/a", 2)
    _put(room, first, 90)
    _put(room, second, 200)
    assert _all(room) == [second]


def test_when_all_hold_too_much_the_greatest_gives_way() -> None:
    room = MessageQueue(max_call_bytes=100, overhead=0)
    small, large, more = plain_call("u/small", 1), plain_call("u/large", 1), plain_call("u/more", 1)
    _put(room, small, 30)
    _put(room, large, 60)
    _put(room, more, 20)
    assert list(room.dropped_calls()) == [DroppedCall(CALLS, "u/large", 1)]
    assert _all(room) == [small, more]


def test_of_too_many_connections_the_newest_are_given_up() -> None:
    room = MessageQueue(max_connections=2)
    calls = [plain_call(f"u/{n}", n) for n in range(1, 4)]
    for call in calls:
        _put(room, call)
    assert list(room.dropped_calls()) == [DroppedCall(CALLS, "u/3", 3)]
    assert _all(room) == calls[:2]
    _put(room, calls[2])
    assert _all(room) == calls[2:]


def test_emergency_stops_are_kept_apart_from_floods() -> None:
    room = MessageQueue(max_calls_per_connection=2)
    stops = [plain_call("u/a", n, right="stop") for n in range(1, MAX_STOPS_PER_CONNECTION + 3)]
    for stop in stops:
        _put(room, stop)
    for n in range(100, 110):
        _put(room, plain_call("u/a", n))
    taken = _all(room)
    assert taken[:MAX_STOPS_PER_CONNECTION] == stops[:MAX_STOPS_PER_CONNECTION]
    assert [g.number for g in room.dropped_calls()][:2] == [
        MAX_STOPS_PER_CONNECTION + 1,
        MAX_STOPS_PER_CONNECTION + 2,
    ]


def test_what_could_not_be_read_counts_as_a_call_of_its_connection() -> None:
    room = MessageQueue(max_calls_per_connection=2)
    for n in range(4):
        room.add_call(CALLS, "u/a", Malformed(topic=CALLS, connection="u/a", reason=str(n)), 0)
    assert [m.reason for m in _all(room) if isinstance(m, Malformed)] == ["0", "1"]


def test_messages_of_frames_are_given_up_only_when_they_fill_the_memory() -> None:
    room = MessageQueue(max_frame_bytes=10, overhead=0)
    for n in range(5):
        room.add_frame_message("t", bytes([n]) * 4)
    assert room.frames_lost == 3
    assert _all(room) == [b"\x03" * 4, b"\x04" * 4]


@given(
    st.lists(
        st.one_of(
            st.none(),
            st.tuples(st.integers(0, 3), st.integers(-2, 2), st.sampled_from(("read", "command", "stop"))),
            st.binary(max_size=3),
        ),
        max_size=60,
    )
)
def test_every_message_comes_out_once_or_is_told_of_and_in_order(
    steps: list[tuple[int, int, Right] | bytes | None],
) -> None:
    room = MessageQueue(max_calls_per_connection=4)
    put: list[object] = []
    out: list[object] = []
    for number, step in enumerate(steps, start=1):
        if step is None:
            waiting = room.pop()
            if waiting is not None:
                out.append(waiting.message)
        elif isinstance(step, bytes):
            data = b"%d " % number + step
            put.append(data)
            room.add_frame_message("t", data)
        else:
            who, priority, right = step
            call = plain_call(f"u/{who}", number, priority=priority, right=right)
            put.append(call)
            _put(room, call)
    rest = _all(room)
    told = {g.number for g in room.dropped_calls()}
    came = [*out, *rest]
    assert len(came) == len({_name(m) for m in came})
    lost = [m for m in put if _name(m) not in {_name(c) for c in came}]
    assert {m.number for m in lost if isinstance(m, Call)} == told
    assert all(isinstance(m, Call) for m in lost)
    ranks = [_rank(m) for m in rest]
    assert ranks == sorted(ranks)
    assert room.pop() is None


def _name(message: object) -> object:
    return message if isinstance(message, bytes) else message.number  # type: ignore[attr-defined]


def _rank(message: object) -> tuple[int, int, int]:
    """Where it belongs: kind, then priority, then arrival."""
    if isinstance(message, bytes):
        return (1, 0, int(message.split()[0]))
    assert isinstance(message, Call)
    if message.right == "stop":
        return (0, 0, message.number)
    return (2, -message.priority, message.number)
