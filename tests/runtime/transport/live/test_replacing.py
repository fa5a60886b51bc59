"""A node that fails in a host of several: what takes its place, and what the others notice."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import msgspec

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.calls import EMERGENCY_STOP
from colony.runtime.protocol.messages import Effect, Message, Tick
from colony.runtime.transport.live.host import Host, Replacement
from tests.kit.calling import plain_call
from tests.runtime.transport.live.outside import CALLS, SERVER, Outside
from tests.runtime.transport.live.stage import Recorder, robot_address, running
from tests.waiting import until


def _fails_at(k: int) -> Recorder:
    def fail(message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, Tick) and message.k == k:
            raise ArithmeticError("on purpose")
        return ()

    return Recorder(SERVER, topics.TICKS, on=fail)


def _tick(outside: Outside, k: int) -> None:
    outside.put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))


def test_a_node_that_fails_is_replaced_with_its_part_and_the_others_go_on(
    environment: Mapping[str, str], outside: Outside
) -> None:
    failing, sibling, other = _fails_at(1), Recorder("Sibling", topics.TICKS), Recorder("Other", topics.TICKS)
    again = [Recorder(SERVER, topics.TICKS), Recorder("Sibling", topics.TICKS)]
    problems: list[tuple[str, Exception]] = []

    def replace(address: str, problem: Exception) -> Replacement:
        problems.append((address, problem))
        return Replacement((SERVER, "Sibling"), 0, lambda: again)

    went: list[tuple[str, bool]] = []
    nodes = [failing, sibling, other]
    with (
        Host.open(robot_address(environment), nodes, serves=True, on_failure=replace) as host,
        running(host),
    ):
        until(lambda: {SERVER, "Sibling", "Other"} <= set(outside.network.alive()), "all are there")
        outside.network.watch(lambda address, present: went.append((address, present)))
        for k in range(3):
            _tick(outside, k)
        until(lambda: len(other.got) == 3 and again[0].got, "the others and the new one go on")
    assert [(address, str(problem)) for address, problem in problems] == [(SERVER, "on purpose")]
    assert failing.closed == sibling.closed == 1
    assert again[0].got[-1] == again[1].got[-1] == Tick(k=2, t_ns=0)
    assert went[:1] != [(SERVER, False)], "nobody thinks that it left"


def test_a_node_that_fails_at_a_stop_or_while_it_starts_is_replaced_like_any_other(
    environment: Mapping[str, str], outside: Outside
) -> None:
    def fail(*_: object) -> Iterable[Effect]:
        raise ArithmeticError("on purpose")

    last = Recorder(SERVER, CALLS)
    made = iter([[Recorder(SERVER, CALLS, begin=fail)], [last]])
    nodes = [Recorder(SERVER, CALLS, on=fail)]

    def replace(address: str, problem: Exception) -> Replacement:
        return Replacement((SERVER,), 0, lambda: next(made))

    stop = msgspec.structs.replace(plain_call("u/stop", 1, right="stop"), method=EMERGENCY_STOP)
    with (
        Host.open(robot_address(environment), nodes, serves=True, on_failure=replace) as host,
        running(host),
    ):
        until(lambda: SERVER in outside.network.alive(), "it is there")
        outside.call(stop)
        until(
            lambda: host._exchange.member(SERVER) is not None and host._exchange.members[0].node is last, ""
        )
        outside.call(stop)
        until(lambda: last.got == [stop], "the last one gets the stop that is sent again")
