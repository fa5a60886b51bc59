"""Calls of a server in another process: through the kit, and through a bare querier and queryable of zenoh.

Both ask a process on the same machine for 64 bytes, over the same kind of unix socket, and wait for the
answer. The kit's call is opened, numbered, typed, checked against its key, queued by priority and answered
once; the bare one is only answered. Figures are medians of rounds that take turns: for one client of the
round trip, for eight client processes at once of the time in which all of them have made their calls.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median, quantiles
from time import perf_counter_ns

import msgspec
import zenoh

from colony.runtime.kit.connection import connect
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import CallDispatcher, method
from colony.runtime.protocol.messages import Effect, Message
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.robot_address import local

ROUNDS = 5
CALLS = 1500
WARM_UP = 200
CLIENTS = 8
CALLS_OF_MANY = 1000
MOST_TIMES_ALONE = 1.5
LEAST_THROUGHPUT = 0.6

ROBOT, SERVER, BARE = "bench", "Echo", "bench/echo"
DATA = b"x" * 64

Row = dict[str, object]


def run() -> list[Row]:
    """One row a figure: name, value, unit, target (None: only told), ok, note."""
    alone: dict[str, list[float]] = {"kit": [], "bare": []}
    slow: dict[str, list[float]] = {"kit": [], "bare": []}
    many: dict[str, list[float]] = {"kit": [], "bare": []}
    with _server() as environment:
        for _ in range(ROUNDS):
            for kind, times in alone.items():
                measured = _clients(kind, 1, CALLS, environment)[0]
                times.append(median(measured))
                slow[kind].append(quantiles(measured, n=100)[98])
            for kind, times in many.items():
                spent = [sum(each) for each in _clients(kind, CLIENTS, CALLS_OF_MANY, environment)]
                times.append(max(spent) / (CLIENTS * CALLS_OF_MANY))
    one = {kind: median(times) for kind, times in alone.items()}
    worst = {kind: median(times) for kind, times in slow.items()}
    each = {kind: median(times) for kind, times in many.items()}
    rows = [
        _row("round trip, kit / bare", one["kit"] / one["bare"], MOST_TIMES_ALONE),
        _row(f"time a call, {CLIENTS} clients, kit / bare", each["kit"] / each["bare"], 1 / LEAST_THROUGHPUT),
    ]
    for kind in ("kit", "bare"):
        note = f"99 of 100 within {worst[kind] / 1000:.0f} us"
        rows.append(_row(f"round trip, {kind}", one[kind] / 1000, None, "us", note))
        note = f"{1e9 / each[kind]:,.0f} calls/s"
        rows.append(_row(f"time a call, {CLIENTS} clients, {kind}", each[kind] / 1000, None, "us", note))
    return rows


def _row(name: str, value: float, target: float | None, unit: str = "times", note: str = "") -> Row:
    ok = target is None or value <= target
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": ok, "note": note}


# --- processes -------------------------------------------------------------------------------------


@contextlib.contextmanager
def _server() -> Iterator[dict[str, str]]:
    """The server of both, as a process; gives the environment in which clients find it."""
    folder = Path(tempfile.mkdtemp(prefix="colony-bench-", dir="/tmp"))
    root = str(Path(__file__).parent.parent)
    environment = {**os.environ, "COLONY_RUN_DIR": str(folder), "PYTHONPATH": root}
    process = subprocess.Popen(_command("serve"), env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield environment
    finally:
        process.terminate()
        process.communicate()
        shutil.rmtree(folder)


def _clients(kind: str, count: int, calls: int, environment: dict[str, str]) -> list[list[float]]:
    """What so many clients at once measured: the nanoseconds of each call. They begin when all are ready."""
    processes = [
        subprocess.Popen(
            _command(kind, str(calls)),
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(count)
    ]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    return [json.loads(process.communicate()[0]) for process in processes]


def _command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "benchmarks.transport", *arguments]


class _Echo(msgspec.Struct, frozen=True, kw_only=True):
    data: bytes


class _EchoServer:
    """Gives back what it is sent."""

    address = SERVER

    def __init__(self) -> None:
        echo = method("echo", _Echo, lambda asked, given, now_ns: given.data, right="read")
        self._desk = CallDispatcher(SERVER, (echo,))
        self.listens = self._desk.listens

    def start(self, now_ns: int) -> tuple[Effect, ...]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        return self._desk.handle(message, now_ns)

    def close(self) -> None:
        """It holds nothing."""


def _serve() -> None:
    with Host.open(local(ROBOT, os.environ), [_EchoServer()], serves=True) as host:
        signal.signal(signal.SIGTERM, lambda *_: host.stop())
        handler = zenoh.handlers.Callback(lambda q: q.reply(BARE, q.payload.to_bytes()), indirect=False)
        host.network.session.declare_queryable(BARE, handler)
        print("ready", flush=True)
        host.run()


def _call_by_kit(calls: int) -> None:
    ask = CallRequest("echo", _Echo(data=DATA), bytes, "read", repeatable=True)
    with connect(SERVER, robot=ROBOT) as connection:
        _measure(lambda: connection.do(ask), calls)


def _call_bare(calls: int) -> None:
    with ZenohSession.open(local(ROBOT, os.environ)) as network:
        querier = network.session.declare_querier(BARE, timeout=5.0)
        while not querier.matching_status.matching:  # type: ignore[attr-defined]
            pass

        def call() -> bytes:
            for reply in querier.get(payload=DATA):
                return reply.ok.payload.to_bytes()
            raise AssertionError("no answer")

        _measure(call, calls)


def _measure(call: object, calls: int) -> None:
    assert callable(call)
    times: list[int] = []
    for _ in range(WARM_UP):
        assert call() == DATA
    print("ready", flush=True)
    sys.stdin.readline()
    for _ in range(calls):
        begun = perf_counter_ns()
        call()
        times.append(perf_counter_ns() - begun)
    json.dump(times, sys.stdout)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["serve"]:
            _serve()
        case ["kit", count]:
            _call_by_kit(int(count))
        case ["bare", count]:
            _call_bare(int(count))
        case _:
            for row in run():
                print(f"{row['name']}: {row['value']:.3g} {row['unit']} {row['note']}")
