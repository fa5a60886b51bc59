"""A client asks for the present frame only, gives its memory to DServer, and gets it back when it is started
anew; where that cannot be, it asks for a new epoch."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from colony.compile.pipeline import compile_program
from colony.execute.executor import ClientMemory
from colony.ir.program import Program
from colony.runtime.assembly.nodes import build_clients
from colony.runtime.clients.client import (
    RECALL_NS,
    ClientNode,
    MemoryFormatError,
    decode_memory,
    encode_memory,
)
from colony.runtime.frames.assembler import frames_to_keep
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.messages import (
    Checkpoint,
    Fetch,
    Ready,
    Recall,
    Request,
    Restart,
    Sample,
    SendMessage,
    SentMessage,
    ServerFrame,
    Tick,
)
from tests.kit.node_stage import MS, sent
from tests.robot_servers import ROME_SERVERS
from tests.runtime.assembly.test_virtual import counting, pulsing
from tests.runtime.assembly.test_virtual_faults import latching
from tests.runtime.programs import roam

FRAME = 50 * MS
KEPT = frames_to_keep(FRAME)
ADDRESS = "drive/back_off"
HELD = "back_off recently 0 until"


def back_off(program: Program | None = None, module: str = "back_off") -> ClientNode:
    """Active for a second after the bumper was pressed."""
    program = roam() if program is None else program
    compiled = compile_program(program).compiled
    (node,) = build_clients(compiled, bind(program.robot, ROME_SERVERS), [("drive", module)], "run")
    return node


def tick(k: int, *, start: int = 0, run: str = "run") -> Tick:
    return Tick(k=k, t_ns=k * FRAME, start=start, run=run)


def base(k: int, bumper: bool = False) -> ServerFrame:
    return ServerFrame(server="RServer", k=k, fields={"bumper": Sample(bumper, k * FRAME)})


def only(kind: type, messages: Iterable[SentMessage]) -> list[SentMessage]:
    return [m for m in messages if isinstance(m, kind)]


def run(node: ClientNode, ks: Iterable[int], pressed: int = 3) -> list[SentMessage]:
    """Frames one after the other, in one of which the bumper is pressed."""
    return [m for k in ks for m in sent(node, tick(k), base(k, k == pressed), now_ns=k * FRAME)]


def bids(messages: Iterable[SentMessage]) -> dict[int, str]:
    return {m.k: m.bid for m in messages if isinstance(m, Request)}


# --- requests --------------------------------------------------------------------------------------


def test_one_request_a_frame(node: ClientNode) -> None:
    assert list(node.start(0)) == [SendMessage("Clock/ready", Ready(client=ADDRESS, run="run"))]
    got = bids(run(node, range(30)))
    assert got == {k: "command" if 3 <= k < 23 else "inactive" for k in range(30)}


def test_behind_it_steps_through_what_it_missed_and_asks_for_the_present_only(node: ClientNode) -> None:
    run(node, range(3))
    got = sent(node, tick(3), tick(4), tick(5), base(5), base(4))
    assert [(m.server, m.k) for m in got if isinstance(m, Fetch)] == [
        (("RServer"), 3),
        *(("RServer", k) for k in (3, 4)),
    ]
    assert bids(got) == {}
    assert bids(sent(node, base(3, True))) == {5: "command"}
    assert bids(run(node, range(6, 9))) == dict.fromkeys((6, 7, 8), "command")


def test_doubled_and_late_messages_change_nothing(node: ClientNode) -> None:
    for k in range(30):
        message = (tick(k), base(k, k == 3))
        assert len(bids(sent(node, *message, *message, *(tick(max(0, k - 5)), base(max(0, k - 5)))))) == 1
    assert node.frontier == (0, 29)


def test_with_its_requests_it_tells_the_clock_that_it_lives_but_not_more_often_than_needed(
    node: ClientNode,
) -> None:
    list(node.start(0))
    told = [m for m in run(node, range(10)) if isinstance(m, Ready)]
    assert told == [Ready(client=ADDRESS, run="run", k=k) for k in range(0, 10, 2)]
    quick = [m for k in range(10, 20) for m in sent(node, tick(k), base(k), now_ns=9 * FRAME + k * 10 * MS)]
    assert [m.k for m in quick if isinstance(m, Ready)] == [10, 19]
    assert [m.k for m in only(Request, quick)] == [*range(10, 20)]  # type: ignore[union-attr]
    assert not only(Ready, sent(node, tick(20), tick(21), base(20), now_ns=20 * FRAME)), "it is behind"


# --- epochs ----------------------------------------------------------------------------------------


def test_with_an_epoch_memory_begins_anew(node: ClientNode) -> None:
    assert bids(run(node, range(5)))[4] == "command"
    assert bids(sent(node, tick(5, start=5), base(5))) == {5: "inactive"}
    assert node.frontier == (5, 5)


# --- memory ----------------------------------------------------------------------------------------


def saved(until: int = 60) -> Checkpoint:
    """The newest checkpoint of a client that was pressed in frame 50."""
    found = [m for m in run(back_off(), range(until), pressed=50) if isinstance(m, Checkpoint)]
    return found[-1]


def test_memory_goes_to_dserver_every_half_second() -> None:
    found = [m for m in run(back_off(), range(35)) if isinstance(m, Checkpoint)]
    assert [(m.client, m.k, m.start) for m in found] == [(ADDRESS, k, 0) for k in (10, 20, 30)]
    assert [m.memory for m in found] == [encode_memory(ClientMemory(0, {HELD: 23 * FRAME}))] * 3


def test_one_that_comes_late_into_a_young_epoch_steps_through_all_of_it(node: ClientNode) -> None:
    got = sent(node, tick(10))
    assert not only(Recall, got)
    assert len(only(Fetch, got)) == 20
    messages = [m for k in range(10) for m in (tick(k), base(k, k == 3))]
    assert bids(sent(node, *messages, base(10))) == {10: "command"}


def test_one_that_comes_late_asks_for_its_memory_and_steps_through_what_came_since() -> None:
    node, now = back_off(), 65
    assert sent(node, tick(now)) == [Recall(client=ADDRESS)]
    got = sent(node, saved())
    assert saved().k == 50
    assert {(m.server, m.k) for m in got if isinstance(m, Fetch)} == {
        (server, k) for server in ("Clock", "RServer") for k in range(51, 65)
    }
    assert sent(node, saved()) == []  # the answer comes twice
    messages = [m for k in range(51, 65) for m in (tick(k), base(k))]
    assert bids(sent(node, *messages, base(now))) == {now: "command"}
    assert bids(run(node, range(66, 72))) == {k: "command" if k < 70 else "inactive" for k in range(66, 72)}


def none() -> Checkpoint:
    return Checkpoint(client=ADDRESS, k=-1, start=-1, memory=b"")


@pytest.mark.parametrize(
    "answer",
    [
        none(),
        Checkpoint(client=ADDRESS, k=55, start=0, memory=b"rubbish"),
        Checkpoint(client=ADDRESS, k=55, start=0, memory=b"\x92\x00\x80"),
        Checkpoint(client=ADDRESS, k=55, start=9, memory=saved().memory),
        Checkpoint(client=ADDRESS, k=61, start=0, memory=saved().memory),
        Checkpoint(client=ADDRESS, k=60 - KEPT - 2, start=0, memory=saved().memory),
    ],
)
def test_where_there_is_no_memory_to_be_had_it_asks_for_a_new_epoch_once_a_frame(
    node: ClientNode, answer: Checkpoint
) -> None:
    assert sent(node, tick(60)) == [Recall(client=ADDRESS)]
    assert not only(Restart, sent(node, answer))
    for k in (61, 62):
        assert sent(node, tick(k)) == [Restart(client=ADDRESS, start=0)]
        assert sent(node, base(k)) == []
    assert bids(sent(node, tick(63, start=63), base(63))) == {63: "inactive"}


def test_dserver_is_not_waited_for_forever(node: ClientNode) -> None:
    ks = range(60, 63 + RECALL_NS // FRAME)
    got = [m for k in ks for m in sent(node, tick(k), now_ns=k * FRAME)]
    assert got[0] == got[-3] == Recall(client=ADDRESS)
    assert got[-2:] == [Restart(client=ADDRESS, start=0)] * 2


def test_one_that_fell_behind_too_far_asks_for_a_new_epoch_at_once(node: ClientNode) -> None:
    run(node, range(5))
    got = [m for k in range(6, 6 + KEPT) for m in sent(node, tick(k), base(k))]
    assert only(Restart, got) == [Restart(client=ADDRESS, start=0)]
    assert not only(Recall, got)
    assert bids(got) == {}


def test_the_client_of_a_module_in_python_takes_answers_and_has_memory_as_any_other() -> None:
    late = back_off(pulsing(), "pulse")
    assert sent(late, tick(60)) == [Recall(client="drive/pulse")]
    node = back_off(pulsing(), "pulse")
    for k, command in enumerate((Sample((50.0, 0.0), 0), None)):
        answer = ServerFrame(server="DServer/activity/pulse", k=k, fields={"command": command})
        (request,) = only(Request, sent(node, tick(k), answer))
        assert (request.bid, request.values) == (("command", (50.0, 0.0)) if command else ("silent", None))


# --- a client and its memory at the edges ---


def memory(k: int) -> Checkpoint:
    return Checkpoint(client=ADDRESS, k=k, start=0, memory=saved().memory)


def test_memory_that_was_not_asked_for_is_none(node: ClientNode) -> None:
    sent(node, tick(3))
    assert sent(node, memory(2)) == []
    assert node.frontier == (0, -1)


def test_memory_after_the_newest_frame_will_do(node: ClientNode) -> None:
    assert sent(node, tick(60)) == [Recall(client=ADDRESS)]
    assert sent(node, memory(60)) == []
    assert node.frontier == (0, 60)
    assert len(only(Request, sent(node, tick(61), base(61)))) == 1


def test_memory_after_the_first_frame_will_do_where_the_rest_is_to_be_had(node: ClientNode) -> None:
    assert sent(node, tick(KEPT)) == [Recall(client=ADDRESS)]
    got = sent(node, memory(0))
    assert {m.k for m in got if isinstance(m, Fetch)} == {*range(1, KEPT)}
    assert node.frontier == (0, 0)


def test_with_memory_it_goes_on_at_once_and_says_that_it_lives() -> None:
    node, now = back_off(), 60 * FRAME
    assert sent(node, tick(60), now_ns=now) == [Recall(client=ADDRESS)]
    sent(node, base(60), now_ns=now)
    got = sent(node, memory(59), now_ns=now)
    assert [m.k for m in got if isinstance(m, Request)] == [60]
    assert only(Ready, got) == [Ready(client=ADDRESS, run="run", k=60)]
    assert not only(Ready, sent(node, tick(61), base(61), now_ns=now + 10 * MS))


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
            got = sent(node, tick(k, start=start), base(k))
            assert len(only(Request, got)) == 1
        assert node.frontier == (start, first + 6)


def test_within_an_epoch_memory_is_given_away_and_after_its_end_no_more(node: ClientNode) -> None:
    got = [m for k in range(11) for m in sent(node, tick(k), base(k), now_ns=k * FRAME)]
    assert [m.k for m in got if isinstance(m, Checkpoint)] == [10]
    got = [m for k in range(11, 21) for m in sent(node, tick(k, start=11), base(k), now_ns=k * FRAME)]
    assert not only(Checkpoint, got), "the new epoch is not half a second old"


# --- clients that read the same servers share a node ---


SEEN, CRUISE = BOTH = ("drive/seen", "drive/cruise")
NOW = 62
"""The frame in which a new process comes, of an epoch too old to be stepped through."""


def shared() -> ClientNode:
    """`seen`, active from the frame after the bumper was pressed, and `cruise` below it."""
    program = latching()
    clients = [("drive", "seen"), ("drive", "cruise")]
    (node,) = build_clients(
        compile_program(program).compiled, bind(program.robot, ROME_SERVERS), clients, "run"
    )
    return node


@pytest.fixture
def both() -> ClientNode:
    return shared()


def shared_bids(messages: Iterable[SentMessage]) -> list[tuple[int, str, str]]:
    return [(m.k, m.client, m.bid) for m in messages if isinstance(m, Request)]


def shared_saved() -> dict[tuple[str, int], Checkpoint]:
    """The checkpoints of a process that died, by client and frame; the bumper was pressed in frame 45."""
    return {(m.client, m.k): m for m in run(shared(), range(60), pressed=45) if isinstance(m, Checkpoint)}


def test_each_asks_and_lives_for_itself(both: ClientNode) -> None:
    assert both.address == SEEN
    assert list(both.start(0)) == [SendMessage("Clock/ready", Ready(client=c, run="run")) for c in BOTH]
    got = run(both, range(5))
    silent, active = ("inactive", "command"), ("command", "suppressed")
    assert shared_bids(got) == [
        (k, client, bid)
        for k, all_bids in enumerate((silent, silent, silent, silent, active))
        for client, bid in zip(("seen", "cruise"), all_bids, strict=True)
    ]
    assert only(Ready, got) == [Ready(client=c, run="run", k=k) for k in (0, 2, 4) for c in BOTH]


def test_each_asks_the_server_of_its_actuator() -> None:
    program = counting()
    clients = [("say", "counter"), ("drive", "drive_to")]
    (node,) = build_clients(
        compile_program(program).compiled, bind(program.robot, ROME_SERVERS), clients, "run"
    )
    variables = ServerFrame(server="DServer", k=0, fields={"Goal": Sample(1.0, 0)})
    sends = [e for m in (tick(0), variables) for e in node.handle(m, 0) if isinstance(e, SendMessage)]
    asked = [(s.topic, s.message.client) for s in sends if isinstance(s.message, Request)]
    assert asked == [("DServer/requests", "counter"), ("RServer/requests", "drive_to")]


def test_there_is_a_checkpoint_of_each_and_all_are_of_one_frame() -> None:
    found = shared_saved()
    assert list(found) == [(client, k) for k in (10, 20, 30, 40, 50) for client in BOTH]
    alone = next(iter(decode_memory(found[SEEN, 40].memory).cells))
    assert [decode_memory(found[SEEN, k].memory).cells[alone] for k in (40, 50)] == [False, True]


def test_it_goes_on_when_the_memories_of_all_are_there_and_not_before(both: ClientNode) -> None:
    known = shared_saved()
    assert sent(both, tick(NOW)) == [Recall(client=client) for client in BOTH]
    assert sent(both, known[CRUISE, 50]) == []
    assert both.frontier == (0, -1)
    assert sent(both, tick(NOW + 1)) == [Recall(client=SEEN)], "only for what did not come"
    assert sent(both, known[CRUISE, 50]) == []  # twice
    assert both.frontier == (0, -1)
    assert {m.k for m in sent(both, known[SEEN, 50]) if isinstance(m, Fetch)} == {*range(51, NOW + 1)}
    assert both.frontier == (0, 50)
    missed = [message for k in range(51, NOW + 1) for message in (tick(k), base(k))]
    got = sent(both, *missed, base(NOW + 1))
    assert shared_bids(got) == [(NOW + 1, "seen", "command"), (NOW + 1, "cruise", "suppressed")]


@pytest.mark.parametrize("first", BOTH)
@pytest.mark.parametrize("k", [40, -1])
def test_from_memories_of_different_frames_it_does_not_go_on_and_asks_for_a_new_epoch(
    both: ClientNode, first: str, k: int
) -> None:
    (other,) = {*BOTH} - {first}
    older = shared_saved().get((other, k), Checkpoint(client=other, k=-1, start=-1, memory=b""))
    sent(both, tick(NOW))
    assert sent(both, shared_saved()[first, 50], older) == []
    assert both.frontier == (0, -1)
    assert sent(both, tick(NOW + 1)) == [Restart(client=SEEN, start=0)]
    assert sent(both, shared_saved()[other, 50]) == [], "it is too late for that"
    got = sent(both, tick(NOW + 2, start=NOW + 2), base(NOW + 2))
    assert shared_bids(got) == [(NOW + 2, "seen", "inactive"), (NOW + 2, "cruise", "command")]


def test_memory_of_another_epoch_is_none(both: ClientNode) -> None:
    sent(both, tick(NOW))
    known = shared_saved()
    for client in BOTH:
        sent(both, Checkpoint(client=client, k=55, start=9, memory=known[client, 50].memory))
    assert both.frontier == (0, -1)
    assert sent(both, tick(NOW + 1)) == [Restart(client=SEEN, start=0)]
