"""SIGKILL at any moment, with SQLite below: nothing that was acknowledged is lost, nothing is done twice."""

from __future__ import annotations

import random
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import pytest

from colony.runtime.library import data
from colony.runtime.library.ask import Ask
from colony.runtime.protocol import codec
from colony.runtime.protocol.calls import Open
from colony.runtime.protocol.messages import Call, Reply
from tests.paths import ROOT
from tests.runtime.servers.data_child import framed, split

SEED = 1994
ROUNDS = 12
CONNECTIONS = tuple(f"ada/{i}" for i in range(4))


class Child:
    """The server's process."""

    def __init__(self, store: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.runtime.servers.data_child", str(store)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=ROOT,
        )
        self.rest = b""

    def send(self, *calls: Call) -> None:
        self.process.stdin.write(b"".join(framed(codec.encode(call)) for call in calls))
        self.process.stdin.flush()

    def receive(self) -> list[Reply]:
        """What it answered since, at least one reply; nothing where it is dead and all was read."""
        assert self.process.stdout is not None
        found: list[bytes] = []
        while not found and (more := self.process.stdout.read1(65536)):  # type: ignore[attr-defined]
            found, self.rest = split(self.rest + more)
        return [reply for one in found if isinstance(reply := codec.decode(one), Reply)]

    def do(self, call: Call) -> Any:
        """The result of one call; whatever is answered to others in the meantime is passed over."""
        self.send(call)
        while replies := self.receive():
            for reply in replies:
                if (reply.connection, reply.number) == (call.connection, call.number):
                    assert reply.problem is None, reply.problem
                    return msgspec.msgpack.decode(reply.result)
        raise AssertionError("the server died")

    def kill(self) -> list[Reply]:
        """SIGKILL; gives what it still had answered."""
        self.process.kill()
        late = []
        while replies := self.receive():
            late += replies
        self.close()
        return late

    def close(self) -> None:
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            with suppress(BrokenPipeError):
                pipe.close()
        assert self.process.wait(30) is not None


class Writers:
    """Connections that count: each call sets the variable of its connection to the number of the call, and
    every other one signals instead. `sent` has the calls without an answer."""

    def __init__(self) -> None:
        self.numbers = dict.fromkeys(CONNECTIONS, 1)
        self.sent: dict[tuple[str, int], Call] = {}
        self.acknowledged = dict.fromkeys(CONNECTIONS, 0)
        self.signals = 0

    def opening(self) -> list[Call]:
        return [call(c, 1, Ask("open", Open(name=c), None, "read")) for c in CONNECTIONS]

    def more(self, count: int) -> list[Call]:
        calls = []
        for _ in range(count):
            for connection in CONNECTIONS:
                self.numbers[connection] += 1
                number = self.numbers[connection]
                ask = data.set(connection, number) if number % 2 else data.signal("count")
                self.signals += ask.method == "signal"
                calls.append(call(connection, number, ask))
        self.sent |= {(c.connection, c.number): c for c in calls}
        return calls

    def take(self, replies: list[Reply]) -> None:
        for reply in replies:
            assert reply.problem is None, reply.problem
            done = self.sent.pop((reply.connection, reply.number), None)
            if done is not None and done.method == "set":
                self.acknowledged[reply.connection] = reply.number


def call(connection: str, number: int, ask: Ask[Any]) -> Call:
    raw = msgspec.Raw(msgspec.msgpack.encode(ask.arguments))
    return Call(connection=connection, number=number, method=ask.method, arguments=raw, right=ask.right)


@pytest.mark.long
def test_sigkill_loses_nothing_and_does_nothing_twice(tmp_path: Path) -> None:
    draw = random.Random(SEED)
    print(f"seed {SEED}")
    store, writers = tmp_path / "state.db", Writers()
    child = Child(store)
    child.do(call("eve/1", 1, Ask("open", Open(name="eve"), None, "read")))
    child.do(call("eve/1", 2, data.create_semaphore("count", 0)))
    killed_with_calls_on_their_way = 0
    for round_ in range(ROUNDS):
        child.send(*writers.opening(), *writers.sent.values())
        answers = draw.randrange(20, 300)
        while answers > 0:
            if len(writers.sent) < 60:
                child.send(*writers.more(5))
            replies = child.receive()
            writers.take(replies)
            answers -= len(replies)
        child.send(*writers.more(20))
        writers.take(child.kill())
        killed_with_calls_on_their_way += bool(writers.sent)
        child = Child(store)
        eve = f"eve/{round_ + 2}"
        child.do(call(eve, 1, Ask("open", Open(name="eve"), None, "read")))
        for number, connection in enumerate(CONNECTIONS):
            found = child.do(call(eve, number + 2, data.get(connection)))
            assert writers.acknowledged[connection] <= found <= writers.numbers[connection]
    child.send(*writers.opening(), *writers.sent.values())
    while writers.sent:
        writers.take(child.receive())
    assert child.do(call(eve, 10, data.semaphore("count")))["value"] == writers.signals
    for number, connection in enumerate(CONNECTIONS):
        newest = writers.numbers[connection] - (writers.numbers[connection] % 2 == 0)
        assert child.do(call(eve, 11 + number, data.get(connection))) == newest
    child.close()
    assert killed_with_calls_on_their_way > 0
