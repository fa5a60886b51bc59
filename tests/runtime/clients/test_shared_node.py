"""Clients that read the same servers share a node: each asks, lives and remembers for itself, and all go on
together or not at all."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from colony.compile.pipeline import compile_program
from colony.runtime.assembly.nodes import build_clients
from colony.runtime.clients.client import ClientNode
from colony.runtime.clients.memory import decode_memory
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.messages import (
    Checkpoint,
    Fetch,
    Ready,
    Recall,
    Request,
    Restart,
    Sample,
    Send,
    SentMessage,
    ServerFrame,
)
from tests.robot_servers import ROME_SERVERS
from tests.runtime.assembly.test_virtual import counting
from tests.runtime.assembly.test_virtual_faults import latching
from tests.runtime.clients.test_client import FRAME, base, only, take, tick

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


def run(node: ClientNode, ks: Iterable[int], pressed: int = 3) -> list[SentMessage]:
    """Frames one after the other, in one of which the bumper is pressed."""
    return [m for k in ks for m in take(node, tick(k), base(k, k == pressed), now_ns=k * FRAME)]


def bids(messages: Iterable[SentMessage]) -> list[tuple[int, str, str]]:
    return [(m.k, m.client, m.bid) for m in messages if isinstance(m, Request)]


def saved() -> dict[tuple[str, int], Checkpoint]:
    """The checkpoints of a process that died, by client and frame; the bumper was pressed in frame 45."""
    return {(m.client, m.k): m for m in run(shared(), range(60), pressed=45) if isinstance(m, Checkpoint)}


def test_each_asks_and_lives_for_itself(both: ClientNode) -> None:
    assert both.address == SEEN
    assert list(both.start(0)) == [Send("Clock/ready", Ready(client=c, run="run")) for c in BOTH]
    got = run(both, range(5))
    silent, active = ("inactive", "command"), ("command", "suppressed")
    assert bids(got) == [
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
    sends = [e for m in (tick(0), variables) for e in node.handle(m, 0) if isinstance(e, Send)]
    asked = [(s.topic, s.message.client) for s in sends if isinstance(s.message, Request)]
    assert asked == [("DServer/requests", "counter"), ("RServer/requests", "drive_to")]


def test_there_is_a_checkpoint_of_each_and_all_are_of_one_frame() -> None:
    found = saved()
    assert list(found) == [(client, k) for k in (10, 20, 30, 40, 50) for client in BOTH]
    alone = next(iter(decode_memory(found[SEEN, 40].memory).cells))
    assert [decode_memory(found[SEEN, k].memory).cells[alone] for k in (40, 50)] == [False, True]


def test_it_goes_on_when_the_memories_of_all_are_there_and_not_before(both: ClientNode) -> None:
    known = saved()
    assert take(both, tick(NOW)) == [Recall(client=client) for client in BOTH]
    assert take(both, known[CRUISE, 50]) == []
    assert both.frontier == (0, -1)
    assert take(both, tick(NOW + 1)) == [Recall(client=SEEN)], "only for what did not come"
    assert take(both, known[CRUISE, 50]) == []  # twice
    assert both.frontier == (0, -1)
    assert {m.k for m in take(both, known[SEEN, 50]) if isinstance(m, Fetch)} == {*range(51, NOW + 1)}
    assert both.frontier == (0, 50)
    missed = [message for k in range(51, NOW + 1) for message in (tick(k), base(k))]
    got = take(both, *missed, base(NOW + 1))
    assert bids(got) == [(NOW + 1, "seen", "command"), (NOW + 1, "cruise", "suppressed")]


@pytest.mark.parametrize("first", BOTH)
@pytest.mark.parametrize("k", [40, -1])
def test_from_memories_of_different_frames_it_does_not_go_on_and_asks_for_a_new_epoch(
    both: ClientNode, first: str, k: int
) -> None:
    (other,) = {*BOTH} - {first}
    older = saved().get((other, k), Checkpoint(client=other, k=-1, start=-1, memory=b""))
    take(both, tick(NOW))
    assert take(both, saved()[first, 50], older) == []
    assert both.frontier == (0, -1)
    assert take(both, tick(NOW + 1)) == [Restart(client=SEEN, start=0)]
    assert take(both, saved()[other, 50]) == [], "it is too late for that"
    got = take(both, tick(NOW + 2, start=NOW + 2), base(NOW + 2))
    assert bids(got) == [(NOW + 2, "seen", "inactive"), (NOW + 2, "cruise", "command")]


def test_memory_of_another_epoch_is_none(both: ClientNode) -> None:
    take(both, tick(NOW))
    known = saved()
    for client in BOTH:
        take(both, Checkpoint(client=client, k=55, start=9, memory=known[client, 50].memory))
    assert both.frontier == (0, -1)
    assert take(both, tick(NOW + 1)) == [Restart(client=SEEN, start=0)]
