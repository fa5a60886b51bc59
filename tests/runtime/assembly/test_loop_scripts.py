"""Scripts among the servers of one process."""

from __future__ import annotations

import pytest

from colony.runtime.kit.errors import CallRefusedError, ServerNotFoundError
from colony.runtime.kit.script import Script, ScriptError, do, sleep
from colony.runtime.library import data, robot
from tests.kit.script_stage import FRAME_NS, ScriptStage


def test_a_script_goes_on_in_the_first_frame_after_its_time() -> None:
    times: list[int] = []

    def script() -> Script:
        for seconds in (0.0, 0.05, 0.12, 0.001):
            now_ns = yield from sleep(seconds)
            times.append(now_ns // FRAME_NS)

    stage = ScriptStage({"one": script()})
    stage.run(0.5)
    assert times == [0, 1, 4, 5]
    assert stage.scripts.has_ended("one")


def test_who_waits_goes_on_in_the_moment_of_the_signal_in_the_order_of_the_queue() -> None:
    order: list[tuple[str, int]] = []

    def waiter(name: str) -> Script:
        yield from do("DServer", data.create_semaphore("$S", 0))
        yield from do("DServer", data.wait("$S"))
        order.append((name, (yield from sleep(0.0)) // FRAME_NS))

    def signaler() -> Script:
        yield from sleep(0.2)
        for _ in range(2):
            yield from do("DServer", data.signal("$S"))
        order.append(("signaler", 4))

    stage = ScriptStage({"a": waiter("a"), "b": waiter("b"), "s": signaler()})
    stage.run(0.5)
    assert order == [("signaler", 4), ("a", 4), ("b", 4)]


def test_patience_ends_in_the_first_frame_at_or_after_its_time() -> None:
    found: list[object] = []

    def script() -> Script:
        yield from do("DServer", data.create_semaphore("$S", 0))
        for patience in (0.0, 0.12, 0.05):
            try:
                yield from do("DServer", data.wait("$S", timeout_s=patience))
            except CallRefusedError as refused:
                found.append((refused.code, (yield from sleep(0.0)) // FRAME_NS))

    stage = ScriptStage({"one": script()})
    stage.run(0.5)
    assert found == [("timeout", 0), ("timeout", 3), ("timeout", 4)]


def test_strange_servers_and_methods_are_refused() -> None:
    found: list[str] = []

    def script() -> Script:
        try:
            yield from do("RServer", robot.position())
        except ServerNotFoundError as problem:
            found.append(str(problem))
        try:
            yield from do("DServer", data.publish(("X",)))
        except CallRefusedError as refused:
            found.append(refused.code)

    ScriptStage({"one": script()}).run(0.05)
    assert found == ["there is no server `RServer` in this run; it has DServer", "method"]


def test_a_script_that_raises_or_never_rests_is_named() -> None:
    def raises() -> Script:
        yield from sleep(0.05)
        raise ValueError("no such light")

    def spins() -> Script:
        while True:
            yield from do("DServer", data.set("X", 1))

    with pytest.raises(ScriptError, match="the script `bad` raised ValueError: no such light"):
        ScriptStage({"bad": raises()}).run(0.15)
    with pytest.raises(ScriptError, match="20000 calls without a `sleep`"):
        ScriptStage({"spinner": spins()}).run(0.05)


def test_closing_ends_all_scripts() -> None:
    ends: list[str] = []

    def script(name: str) -> Script:
        try:
            yield from sleep(9.0)
        finally:
            ends.append(name)

    stage = ScriptStage({"a": script("a"), "b": script("b")})
    stage.run(0.1)
    stage.scripts.close()
    assert ends == ["a", "b"]
