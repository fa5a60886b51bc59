"""Scripts as nodes, among real servers in virtual time."""

from __future__ import annotations

import pytest

from colony.runtime.kit.errors import CallRefusedError, CallTimeoutError, ServerNotFoundError
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.library import data
from colony.runtime.servers.dserver import DServer
from colony.runtime.store.store import MemoryStore
from colony.runtime.transport.virtual import VirtualClock, VirtualTransport
from tests.kit.node_stage import S


class Stage:
    """A DServer, and scripts that know it. Mutable."""

    def __init__(self, seed: int = 1) -> None:
        self.clock = VirtualClock()
        self.transport = VirtualTransport(self.clock, seed=seed)
        self.store = MemoryStore()
        self.transport.add(DServer(store=self.store))

    def add(self, name: str, script: Script, *servers: str) -> ScriptNode:
        node = ScriptNode(name, script, servers or ("DServer",))
        self.transport.add(node)
        return node


@pytest.mark.parametrize("seed", range(5))
def test_two_scripts_hand_each_other_numbers(seed: int) -> None:
    stage, got = Stage(seed), []

    def giver() -> Script:
        for name in ("$Full", "$Empty"):
            yield from do("DServer", data.create_semaphore(name, 0))
        for number in range(5):
            yield from do("DServer", data.set("Number", number))
            yield from do("DServer", data.signal("$Full"))
            yield from do("DServer", data.wait("$Empty"))
            yield from sleep(0.3)

    def taker() -> Script:
        yield from sleep(0.1)
        while True:
            yield from do("DServer", data.wait("$Full"))
            got.append(((yield from do("DServer", data.get("Number"))), (yield from sleep(0.0))))
            yield from do("DServer", data.signal("$Empty"))

    first, second = stage.add("giver", giver()), stage.add("taker", taker())
    stage.transport.run_until(10 * S)
    assert got == [(0, 100_000_000)] + [(n, 100_000_000 + n * 300_000_000) for n in range(1, 5)]
    assert first.ended
    assert first.problem is None
    assert not second.ended


def test_refusals_and_strangers_are_raised_in_the_script() -> None:
    stage = Stage()
    codes: list[object] = []

    def script() -> Script:
        for ask in (data.get("Nothing"), data.wait("$Nothing")):
            try:
                yield from do("DServer", ask)
            except CallRefusedError as refused:
                codes.append(refused.code)
        yield from do("DServer", data.create_semaphore("$Slow", 0))
        try:
            yield from do("DServer", data.wait("$Slow", timeout_s=7.5))
        except CallRefusedError as refused:
            codes.append((refused.code, (yield from sleep(0.0))))
        yield from do("RServer", data.get("Nothing"))

    node = stage.add("asker", script())
    stage.transport.run_until(20 * S)
    assert codes == ["unknown", "unknown", ("timeout", 7_500_000_000)]
    assert node.ended
    assert isinstance(node.problem, ServerNotFoundError)
    assert "DServer" in str(node.problem)


def test_a_server_that_is_not_there_is_waited_for_and_then_given_up() -> None:
    stage, times = Stage(), []

    def script() -> Script:
        try:
            yield from do("Later", data.get("X"))
        except CallTimeoutError as problem:
            times.append((str(problem), (yield from sleep(0.0))))

    stage.add("asker", script(), "Later")
    stage.transport.run_until(20 * S)
    [(text, at)] = times
    assert "Later did not answer `get` in 5 s" in text
    assert 5 * S <= at <= 5.2 * S


def test_what_was_set_survives_the_server_and_the_script_goes_on() -> None:
    stage, read = Stage(), []

    def script() -> Script:
        yield from do("DServer", data.set("Kept", "yes"))
        yield from sleep(1.0)
        read.append((yield from do("DServer", data.get("Kept"))))

    node = stage.add("asker", script())
    stage.transport.at(S // 2, lambda: stage.transport.kill("DServer"))
    stage.transport.at(S // 2 + 1, lambda: stage.transport.add(DServer(store=stage.store)))
    stage.transport.run_until(20 * S)
    assert read == ["yes"]
    assert node.ended
    assert node.problem is None


def test_closing_a_node_ends_the_script_where_it_is() -> None:
    stage, ends = Stage(), []

    def script() -> Script:
        try:
            while True:
                yield from sleep(1.0)
        finally:
            ends.append("cleaned")

    node = stage.add("idler", script())
    stage.transport.run_until(3 * S)
    assert not ends
    node.close()
    assert ends == ["cleaned"]
