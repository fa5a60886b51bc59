"""Every server under fire: random bytes, and messages of every type and method that were tampered with. None
fails, each caller hears what is wrong, nothing moves the base that may not, and no memory is lost for it.

The same over real sockets and processes is in `transport/live/test_fuzz.py`.
"""

from __future__ import annotations

import gc
import math
import os
import sys
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.runtime.frames.clock import IDLE_FRAME_NS
from colony.runtime.protocol.calls import LEASE_NS, MAX_WAITING_PER_CONNECTION, NoArguments, Open
from colony.runtime.protocol.deployment import MAX_FRAME_NS, MIN_FRAME_NS
from colony.runtime.protocol.messages import Request
from colony.runtime.servers.rserver import RServer
from tests.kit.base import CLIENTS, RollingBase, deployed
from tests.kit.node_stage import FRAME_NS
from tests.runtime.servers.fuzz_stage import BUILD, KEEP, USERS, WITH_USERS, Stage, lift, methods_of
from tests.runtime.servers.nonsense import FLOATS, INTEGERS, Grammar, tree_bytes
from tests.sampling import sampled

SEED = 1994
ROUNDS, EACH = 6, 400
"""Servers of each kind, and what each of them gets."""

STOPS = ("emergency_stop", "deploy")
"""After which nobody from outside moves the base, or only by the ticks of another run."""

WATCHED = 17_000
"""What a server gets whose memory is watched: 100,000 for all of them."""


@pytest.mark.parametrize("name", WITH_USERS)
def test_whatever_comes_no_server_fails_and_every_caller_is_answered(name: str) -> None:
    print(f"seed {SEED}")
    refused = answered = malformed = 0
    for round_ in range(ROUNDS):
        stage = Stage(WITH_USERS[name](), Random(f"{SEED}/{name}/{round_}"))
        for _ in range(EACH):
            stage.anything()
        status = stage.do("status", NoArguments())
        assert status["server"] == name
        refused, answered = refused + stage.refused, answered + stage.answered
        malformed += stage.malformed
    assert refused > ROUNDS * EACH // 20, "much of it was nonsense"
    assert answered - refused > ROUNDS * EACH // 50, "and not all of it"
    assert malformed > ROUNDS * EACH // 50


@pytest.mark.thorough
@pytest.mark.parametrize("name", sampled(tuple(BUILD), every=len(BUILD), thorough=True))
def test_a_servers_memory_does_not_grow(name: str) -> None:
    print(f"seed {SEED}")
    stage = Stage(BUILD[name](), Random(f"{SEED}/{name}"), tame=True)
    measured = []
    for _ in range(3):  # the first third warms up
        enough = stage.given + WATCHED // 3 + 1
        while stage.given < enough:
            stage.anything()
        gc.collect()
        measured.append((sys.getallocatedblocks(), _resident()))
    assert stage.given >= WATCHED
    (blocks, size), (blocks_after, size_after) = measured[1:]
    print(f"{name}: {blocks_after - blocks:+} blocks, {(size_after - size) >> 10:+} KiB")
    assert blocks_after - blocks < WATCHED // 12, "a quarter of a block for each message"
    assert size_after - size < 8 << 20
    assert len(stage.wakes) < 100, "nobody asks to be woken again and again"


def _resident() -> int:
    """Bytes of this process in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")


# --- the base --------------------------------------------------------------------------------------


def test_nothing_from_who_may_not_command_moves_the_base() -> None:
    print(f"seed {SEED}")
    for round_ in range(ROUNDS):
        base = RollingBase()
        stage = Stage(
            RServer(base, frames_kept=KEEP),
            Random(f"{SEED}/{round_}"),
            rights=("read", "stop"),
            tame=round_ % 2 == 0,
        )
        for _ in range(EACH):
            stage.anything()
        assert {(velocity, turn) for _, velocity, turn in base.told} <= {(0.0, 0.0)}
        assert (base.x, base.y, base.heading) == (0.0, 0.0, 0.0)
        assert base.stops


def test_nothing_moves_a_lift_for_which_no_program_was_deployed() -> None:
    print(f"seed {SEED}")
    for round_ in range(ROUNDS):
        done: list[tuple[float, bool]] = []
        stage = Stage(lift(done), Random(f"{SEED}/{round_}"), rights=("read", "stop"), tame=round_ % 2 == 0)
        for _ in range(EACH):
            stage.anything()
        assert done == []


def test_what_is_malformed_does_not_move_a_base_whose_program_is_silent() -> None:
    """Its clients say that they have nothing to say, and somebody tampers with what they send."""
    print(f"seed {SEED}")
    got_through = 0
    for round_ in range(2 * ROUNDS):
        base, random = RollingBase(), Random(f"{SEED}/{round_}")
        node = RServer(base, deployment=deployed("r1"), frames_kept=KEEP)
        stage = Stage(node, random, rights=("read", "stop"), tame=True, run="r1", without=STOPS)
        sane: set[tuple[float, float]] = {(0.0, 0.0)}
        _listen(stage, sane)
        for _ in range(EACH):
            stage.anything()
        told = {(velocity, turn) for _, velocity, turn in base.told}
        assert told <= sane, f"round {round_}: {told - sane} was never asked for in a well-formed request"
        got_through += len(told) - 1
    assert got_through > 0, "some of it was well-formed in spite of all"


def _listen(stage: Stage, sane: set[tuple[float, float]]) -> None:
    """Collect the commands that are well formed in spite of all: two finite numbers, in range, of a client of
    the program. What the arbiter does not take for one must never reach the base."""
    give = stage.give

    def hear(message: Any) -> Any:
        match message:
            case Request(actuator="drive", client=client, bid="command", values=(a, b), fault=None):
                finite = all(not isinstance(v, bool) and math.isfinite(v) for v in (a, b))
                if finite and client in dict(CLIENTS) and -300.0 <= a <= 500.0 and -60.0 <= b <= 60.0:
                    sane.add((float(a), float(b)))
            case _:
                pass
        return give(message)

    stage.give = hear  # type: ignore[method-assign]


# --- who wants too much ----------------------------------------------------------------------------


def _call(stage: Stage, connection: str, number: int, method: str, arguments: Any) -> None:
    priority = USERS.index(connection)
    tree = ["Call", connection, number, method, arguments, priority, "command"]
    stage.call("command", connection, tree_bytes(tree))


@pytest.mark.parametrize(
    ("name", "method", "arguments"),
    [
        ("RServer", "lock", {"wait_ns": 2**64 - 1}),
        ("CServer", "lock", {"wait_ns": 2**64 - 1}),
        ("DServer", "wait", {"name": "mutex", "wait_ns": 2**64 - 1}),
    ],
)
def test_who_waits_a_thousand_times_is_refused(name: str, method: str, arguments: dict[str, Any]) -> None:
    stage = Stage(BUILD[name](), Random(SEED))
    for connection in ("ada/1", "bob/1"):
        _call(stage, connection, 1, "open", {"name": connection})
    _call(stage, "ada/1", 2, "create_semaphore", {"name": "mutex", "value": 1})
    _call(stage, "ada/1", 3, method, arguments)
    for number in range(2, 1002):
        _call(stage, "bob/1", number, method, arguments)
    assert stage.refused == 1000 - MAX_WAITING_PER_CONNECTION + (name != "DServer"), (
        "all but those that may wait"
    )
    assert stage.do("status", NoArguments())["server"] == name
    stage.pass_time(10_000_000_000)
    assert len(stage.do("status", NoArguments())["connections"]) == 1


@pytest.mark.parametrize("frame_ns", [0, 1, -5, MIN_FRAME_NS - 1, MAX_FRAME_NS + 1, 2**63 - 1])
@pytest.mark.parametrize("name", ["Clock", "RServer", "DServer", "Runtime"])
def test_frames_that_no_clock_can_keep_are_refused(name: str, frame_ns: int) -> None:
    stage = Stage(BUILD[name](), Random(SEED))
    _call(stage, "ada/1", 1, "open", {"name": "ada"})
    arguments = {**msgspec.to_builtins(deployed()), "frame_ns": frame_ns}
    _call(stage, "ada/1", 2, "deploy", arguments)
    assert stage.refused == 1


def test_a_robot_ticks_again_soon_after_a_run_of_slow_frames() -> None:
    stage = Stage(BUILD["Clock"](), Random(SEED))
    _call(stage, "ada/1", 1, "open", {"name": "ada"})
    arguments = {**msgspec.to_builtins(deployed()), "frame_ns": MAX_FRAME_NS, "actuators": []}
    _call(stage, "ada/1", 2, "deploy", arguments)
    stage.pass_time(100_000_000)
    assert stage.ticks[-1].run == "r1"
    stage.pass_time(2 * LEASE_NS)
    assert stage.ticks[-1].run == "", "its leader is gone"
    assert stage.now_ns - stage.ticks[-1].t_ns < 2 * IDLE_FRAME_NS


# --- drawn, and shrunk where it fails --------------------------------------------------------------

_leaves = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.sampled_from(INTEGERS)
    | st.floats()
    | st.sampled_from(FLOATS)
    | st.text(max_size=8)
    | st.binary(max_size=8)
)
_trees = st.recursive(
    _leaves,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=8,
)


def _calls(name: str) -> st.SearchStrategy[list[tuple[str, Any]]]:
    """Calls of a server: a method, and a field of its arguments with what stands there instead."""
    methods = methods_of(BUILD[name]())
    grammar = Grammar(Random(SEED), {})

    def arguments(method: str) -> st.SearchStrategy[tuple[str, Any]]:
        valid = grammar.draw(methods[method].arguments)
        assert isinstance(valid, dict)
        fields = st.sampled_from([*valid, "unknown"])
        changed = st.builds(lambda field, value: valid | {field: value}, fields, _trees)
        return st.tuples(st.just(method), changed | _trees)

    return st.lists(st.sampled_from([*methods]).flatmap(arguments), min_size=1, max_size=6)


@pytest.mark.parametrize("name", BUILD)
def test_any_arguments_of_any_methods_in_any_order(name: str) -> None:
    build = BUILD[name]

    @given(_calls(name))
    def check(calls: list[tuple[str, Any]]) -> None:
        stage = Stage(build(), Random(0))
        opening = msgspec.to_builtins(Open(name="ada"))
        for number, (method, arguments) in enumerate([("open", opening), *calls], 1):
            tree = ["Call", "ada/1", number, method, arguments, 0, "command"]
            stage.call("command", "ada/1", tree_bytes(tree))
            stage.tick()
            stage.pass_time(FRAME_NS)

    check()


# --- what came of it -------------------------------------------------------------------------------


def test_the_grammar_knows_every_method_of_every_server() -> None:
    for name, build in BUILD.items():
        methods = methods_of(build())
        assert {"open", "close", "status"} < set(methods), name
        grammar = Grammar(Random(SEED), {})
        for method in methods.values():
            for _ in range(10):
                data = msgspec.msgpack.encode(grammar.draw(method.arguments))
                msgspec.msgpack.decode(data, type=method.arguments)
