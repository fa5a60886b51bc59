"""DServer's calls at their limits: what the largest message of each method costs.

Of each method there is the largest message that gets through the limits, and one of four megabytes that does
not, made of the tiny values that cost most. A server that has thousands of variables, semaphores and watches
takes the bytes, handles and commits (SQLite, `synchronous=NORMAL`), and answers in bytes; the figure is the
time from bytes to bytes, the median of some rounds, and the slowest of them in the note. While it takes that
time DServer answers nobody else.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from statistics import median
from time import perf_counter_ns, thread_time_ns
from typing import NamedTuple

import msgspec

from colony.ir.servers import DSERVER
from colony.runtime.library import data
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol import codec
from colony.runtime.protocol.calls import NoArguments, Open
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.messages import Alive, Call, Effect, Fetch, Reply, SendMessage, Tick, Wake
from colony.runtime.servers.data_methods import MAX_NAMES_PER_CALL, MAX_NAMES_PER_REPLY, MAX_VALUES_PER_REPLY
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.semaphores import MAX_HOLDS, MAX_SEMAPHORES, MAX_WAITING_CALLS
from colony.runtime.servers.variables import MAX_HISTORY_LENGTH, MAX_VALUE_BYTES
from colony.runtime.store.sqlite import SqliteStore

Row = dict[str, object]

MOST_MS = 25.0
ROUNDS = 7
VARIABLES = 15_000
ADA, BOB = "ada/1", "bob/1"


class Case(NamedTuple):
    """A message to be timed, and what is to be done before each time and after."""

    name: str
    message: Callable[[int], bytes]
    before: Callable[[int], None] = lambda i: None
    after: Callable[[int], None] = lambda i: None


class Stage:
    """A DServer with a store, and its calls by number. Mutable."""

    def __init__(self, path: Path) -> None:
        self.server = DServer(store=SqliteStore(path), frames_kept=2000)
        self.number = 0
        self.now = 10**9
        self.k = 0
        list(self.server.start(self.now))

    def bytes_of(self, method: str, arguments: object, connection: str = ADA) -> bytes:
        """The message of a call; arguments that are a `Raw` are those."""
        self.number += 1
        packed = (
            arguments
            if isinstance(arguments, msgspec.Raw)
            else msgspec.Raw(msgspec.msgpack.encode(arguments))
        )
        return codec.encode(Call(connection=connection, number=self.number, method=method, arguments=packed))

    def call(self, ask: CallRequest[object], connection: str = ADA) -> bytes:
        return self.bytes_of(ask.method, ask.arguments, connection)

    def take(self, message: bytes) -> list[bytes]:
        """From bytes to bytes: decode, handle, commit, encode."""
        effects = list(self.server.handle(codec.decode(message), self.now))
        self.server.settle()
        return [codec.encode(e.message) for e in effects if isinstance(e, SendMessage)]

    def do(self, ask: CallRequest[object], connection: str = ADA) -> Reply:
        """Make a call that is answered at once, and take all that is to be told."""
        answer = self.take(self.call(ask, connection))
        self.rest()
        reply = codec.decode(answer[0])
        assert isinstance(reply, Reply)
        assert reply.problem is None, reply.problem
        return reply

    def rest(self) -> None:
        """Let time go by until there is nothing to be told any more; connections live."""
        for _ in range(400):
            self.now += 10_000_000
            for connection in (ADA, BOB):
                self.take(codec.encode(Alive(connection=connection)))
            effects: list[Effect] = list(self.server.handle(Wake(), self.now))
            self.server.settle()
            if not any(isinstance(e, SendMessage) for e in effects):
                return

    def tick(self) -> bytes:
        self.k += 1
        return codec.encode(Tick(k=self.k, t_ns=self.now))


def run() -> list[Row]:
    """One row a figure: name, value, unit, target, ok, note."""
    folder = Path(tempfile.mkdtemp(prefix="colony-", dir="/tmp"))
    try:
        stage = Stage(folder / "state.db")
        _fill(stage)
        rows = [_row(stage, case) for case in (*_largest(stage), *_refused(stage), *_frames(stage))]
        stage.server.close()
        return rows
    finally:
        shutil.rmtree(folder)


# --- what there is -------------------------------------------------------------------------------


def _fill(stage: Stage) -> None:
    for connection in (ADA, BOB):
        stage.take(stage.bytes_of("open", Open(name=connection), connection))
    for begin in range(0, VARIABLES, MAX_NAMES_PER_CALL):
        stage.do(data.set_many({f"V{i:05}": float(i) for i in range(begin, begin + MAX_NAMES_PER_CALL)}))
    for i in range(MAX_SEMAPHORES - 10):
        stage.take(stage.call(data.create_semaphore(f"S{i:05}")))
    stage.do(data.create_semaphore("Held", MAX_HOLDS))
    stage.do(data.watch(prefixes=[f"{i:03}" for i in range(48)]), BOB)
    stage.do(data.watch(prefixes=["", "V"]), BOB)


# --- the messages --------------------------------------------------------------------------------


def _largest(stage: Stage) -> Iterator[Case]:
    """What gets through the limits."""
    tiny_lists = msgspec.Raw(
        b"\xdd" + (MAX_VALUE_BYTES - 5).to_bytes(4, "big") + b"\x90" * (MAX_VALUE_BYTES - 5)
    )
    blob = b"\x00" * (MAX_VALUE_BYTES - 5)

    def ask(name: str, made: Callable[[int], CallRequest[object]], **more: Callable[[int], None]) -> Case:
        return Case(name, lambda i: stage.call(made(i)), after=more.get("after", lambda i: stage.rest()),
                    before=more.get("before", lambda i: None))  # fmt: skip

    names = [f"V{i:05}" for i in range(MAX_NAMES_PER_CALL)]
    yield ask("set, 1 MiB of bytes", lambda i: data.set("Blob", blob))
    yield Case(
        "set, 1 MiB of empty lists",
        lambda i: stage.bytes_of("set", data.Set(name="Lists", value=tiny_lists)),
        after=lambda i: stage.rest(),
    )
    yield ask("set, 64 KiB of empty lists", lambda i: data.set("Lists", [[]] * 65_000))
    yield ask("set, 7,000 numbers", lambda i: data.set("Numbers", [1] * 7_000))
    yield ask("set_many, 1,000 numbers", lambda i: data.set_many(dict.fromkeys(names, float(i))))
    yield ask(
        "set_many, 1,000 new ones of 1 kB",
        lambda i: data.set_many({f"N{j}": b"a" * 1000 for j in range(1000)}),
        before=lambda i: [stage.take(stage.call(data.delete(f"N{j}"))) for j in range(1000)] and None,
    )
    yield ask(
        "set_many, 140 lists of 7,000 numbers",
        lambda i: data.set_many({f"L{j}": [1] * 7_000 for j in range(140)}),
    )
    yield ask("get, 1 MiB", lambda i: data.get("Blob"))
    yield ask("get_many, 1,000 numbers", lambda i: data.get_many(names))
    yield ask("names, 5,000", lambda i: data.names(limit=MAX_NAMES_PER_REPLY))
    yield ask("semaphores, 5,000", lambda i: data.semaphores(limit=MAX_NAMES_PER_REPLY))
    yield ask("watch, 1,000 names", lambda i: data.watch(*names), after=lambda i: _unwatch(stage))
    yield ask("watch, all variables", lambda i: data.watch(prefixes=[""]), after=lambda i: _unwatch(stage))
    yield ask(
        "unwatch, 1,000 names",
        lambda i: data.unwatch(*names),
        before=lambda i: stage.do(data.watch(*names)) and None,
    )
    yield ask("publish, 1,000 names", lambda i: data.publish(names), after=lambda i: _reopen(stage))
    yield from _histories(stage, ask)
    yield from _semaphores(stage, ask)
    yield Case("deploy, 10,000 variables read", lambda i: stage.bytes_of("deploy", _deployment(f"r{i}")))


def _deployment(run: str) -> Deployment:
    reads = tuple(f"Reads{j:05}" for j in range(10_000))
    return Deployment(run=run, program="p", frame_ns=10**8, seed=1, actuators=(), reads=reads)


def _histories(stage: Stage, ask: Callable[..., Case]) -> Iterator[Case]:
    def fill(i: int) -> None:
        stage.do(data.delete("H"))
        stage.do(data.set_history("H", MAX_HISTORY_LENGTH))
        for _ in range(MAX_HISTORY_LENGTH):
            stage.take(stage.call(data.set("H", 1.5)))

    fill(0)
    yield ask("history, 2,000 values", lambda i: data.history("H", limit=MAX_VALUES_PER_REPLY))
    yield ask("set_history, 10,000 to 9,999 - i", lambda i: data.set_history("H", MAX_HISTORY_LENGTH - 1 - i))
    yield ask("set_history, 10,000 to 1", lambda i: data.set_history("H", 1), before=fill)
    yield ask("delete, 10,000 values", lambda i: data.delete("H"), before=fill)


def _semaphores(stage: Stage, ask: Callable[..., Case]) -> Iterator[Case]:
    def hold(i: int) -> None:
        for _ in range(MAX_HOLDS):
            stage.take(stage.call(data.wait("Held", hold=True)))

    def again(i: int) -> None:
        _reopen(stage)
        stage.take(stage.call(data.create_semaphore("Held", MAX_HOLDS)))

    yield ask("semaphore, 2,000 holds", lambda i: data.semaphore("Held"), before=lambda i: i or hold(i))
    yield ask("close, 2,000 holds", lambda i: CallRequest("close", NoArguments(), None, "read"),
              before=lambda i: None if i == 0 else hold(i), after=again)  # fmt: skip
    yield ask("delete_semaphore, 2,000 holds", lambda i: data.delete_semaphore("Held"),
              before=hold, after=again)  # fmt: skip
    yield ask(
        f"delete_semaphore, {MAX_WAITING_CALLS} wait",
        lambda i: data.delete_semaphore("Queue"),
        before=lambda i: _queue(stage),
    )


def _queue(stage: Stage) -> None:
    stage.do(data.create_semaphore("Queue", 0))
    for c in range(4):
        name = f"ada/w{c}"
        stage.take(stage.bytes_of("open", Open(name=name), name))
        for _ in range(250):
            stage.take(stage.call(data.wait("Queue"), name))


def _refused(stage: Stage) -> Iterator[Case]:
    """What does not get through: four megabytes of arguments, made of what costs most to decode."""
    size = codec.MAX_MESSAGE_BYTES - 200

    def filled(head: bytes, count_of: int, item: bytes) -> msgspec.Raw:
        count = count_of // len(item)
        return msgspec.Raw(head + b"\xdd" + count.to_bytes(4, "big") + item * count)

    for name in ("set", "set_many", "get", "get_many", "history", "set_history", "delete", "names", "publish",
                 "create_semaphore", "wait", "signal", "release", "semaphore", "semaphores",
                 "delete_semaphore", "watch", "unwatch", "deploy"):  # fmt: skip
        lists = filled(b"\x81\xa5names", size - 100, b"\x90")
        yield Case(f"{name}, 4 MiB, refused", lambda i, n=name, a=lists: stage.bytes_of(n, a))
    pairs = 520_000
    many = b"\x81\xa6values\xdf" + pairs.to_bytes(4, "big") + b"\xa0\x90" * pairs
    yield Case("set_many, 520,000 entries, refused", lambda i: stage.bytes_of("set_many", msgspec.Raw(many)))


def _frames(stage: Stage) -> Iterator[Case]:
    yield Case("tick, frames of 1,000 numbers", lambda i: stage.tick(), before=lambda i: _show(stage))
    yield Case("fetch", lambda i: codec.encode(Fetch(server=DSERVER.name, k=stage.k)))


def _show(stage: Stage) -> None:
    stage.do(data.publish([f"V{i:05}" for i in range(1000)]))
    stage.do(data.set("V00001", 1.0))


def _unwatch(stage: Stage) -> None:
    stage.rest()
    stage.do(data.unwatch())


def _reopen(stage: Stage) -> None:
    stage.take(stage.call(CallRequest("close", NoArguments(), None, "read")))
    stage.take(stage.bytes_of("open", Open(name=ADA)))


# --- timing --------------------------------------------------------------------------------------


def _row(stage: Stage, case: Case) -> Row:
    took, cpu, sizes, answer = [], [], 0, ""
    for i in range(ROUNDS):
        case.before(i)
        message = case.message(i)
        begin, begin_cpu = perf_counter_ns(), thread_time_ns()
        answers = stage.take(message)
        took.append((perf_counter_ns() - begin) / 1e6)
        cpu.append((thread_time_ns() - begin_cpu) / 1e6)
        sizes, answer = len(message), _outcome(answers)
        case.after(i)
    value = median(took)
    note = f"slowest {max(took):.1f} ms, of the processor {median(cpu):.1f} ms; {sizes:,} bytes{answer}"
    ok = value <= MOST_MS
    return {"name": case.name, "value": value, "unit": "ms", "target": MOST_MS, "ok": ok, "note": note}


def _outcome(answers: Iterable[bytes]) -> str:
    replies = [m for a in answers if isinstance(m := codec.decode(a), Reply)]
    problems = [reply.problem.code for reply in replies if reply.problem is not None]
    return f"; {problems[0]}" if problems else ""


def main() -> None:
    """Print the table."""
    for row in run():
        verdict = "ok" if row["ok"] else "MISS"
        print(f"{row['name']:40} {row['value']:>8.2f} {row['unit']} {verdict:4} {row['note']}")


if __name__ == "__main__":
    main()
