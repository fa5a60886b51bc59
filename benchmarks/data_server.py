"""DServer over the network: durable sets from four processes, and reading against a bare zenoh querier.

Every process is one of its own, joined by unix sockets as the processes of a robot are. DServer keeps its
state with SQLite (`synchronous=NORMAL`), and answers a set when it is committed. Four clients set as fast as
they can, each with up to eight sets on their way (`send` and `recv`), and then, to compare, each waiting for
every answer; the figure is the time of all sets by their number.

The bare querier asks a queryable in another Python process, which replies with the same bytes: what anybody
would write first. Both ask in turns, so that the machine treats them alike.
"""

from __future__ import annotations

import multiprocessing
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.context import SpawnContext
from multiprocessing.synchronize import Barrier
from pathlib import Path
from statistics import median, quantiles
from time import monotonic, perf_counter, perf_counter_ns, sleep
from typing import Any

import msgspec
import zenoh

from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library import data
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.robot_address import Local, local

Row = dict[str, object]

ROBOT = "bench"
CLIENTS = 4
ON_THEIR_WAY = 8
SETS = 4_000
"""Of each client."""

GETS = 4_000
WARM = 300
MOST_US_A_SET = 200.0
"""Five thousand a second."""

MOST_TIMES_BARE = 1.5
BARE = f"colony/{ROBOT}/bare"
STARTING_S = 20.0
MEASURING_S = 60.0


def run() -> list[Row]:
    """One row a figure: name, value, unit, target (None: only told), ok, note."""
    folder = Path(tempfile.mkdtemp(prefix="colony-", dir="/tmp"))
    try:
        with _servers(folder):
            seconds, _ = _at_once(_set, folder)
            waiting_seconds, most_ns = _at_once(_set_and_wait, folder)
            bare_seconds, _ = _at_once(_ask_bare, folder)
            colony_ns, bare_ns = _gets(folder)
    finally:
        shutil.rmtree(folder)
    each = CLIENTS * SETS
    us, waiting_us, bare_us = (s / each * 1e6 for s in (seconds, waiting_seconds, bare_seconds))
    slowest = f"; slowest {most_ns / 1e6:.1f} ms"
    colony, bare = median(colony_ns) / 1e3, median(bare_ns) / 1e3
    return [
        _row(f"durable set, {CLIENTS} clients", us, MOST_US_A_SET, "us", _rate(us)),
        _row("the same, each waiting for every answer", waiting_us, None, "us", _rate(waiting_us) + slowest),
        _row(f"bare querier, {CLIENTS} clients", bare_us, None, "us", _rate(bare_us)),
        _row("get / bare querier, medians", colony / bare, MOST_TIMES_BARE, "times"),
        _row("get, median", colony, None, "us", _p99(colony_ns)),
        _row("bare querier, median", bare, None, "us", _p99(bare_ns)),
    ]


# --- processes -----------------------------------------------------------------------------------


def _place(folder: Path) -> Local:
    return local(ROBOT, {"COLONY_RUN_DIR": str(folder)})


def _session(folder: Path) -> Session:
    return Session.open(ROBOT, environment={"COLONY_RUN_DIR": str(folder)})


@contextmanager
def _servers(folder: Path) -> Iterator[None]:
    """DServer and the bare queryable, each in its process."""
    context = multiprocessing.get_context("spawn")
    started = [_start(context, _serve_data, folder), _start(context, _serve_bare, folder)]
    try:
        _wait_for_both(folder)
        yield
    finally:
        for process in started:
            process.terminate()
            process.join(STARTING_S)


def _start(context: SpawnContext, target: Any, *arguments: Any) -> Any:
    process = context.Process(target=target, args=arguments)
    process.start()
    return process


def _serve_data(folder: Path) -> None:
    from colony.runtime.servers.dserver import DServer
    from colony.runtime.store.sqlite import SqliteStore
    from colony.runtime.transport.live.host import Host

    server = DServer(store=SqliteStore(folder / "state.db"))
    with Host.open(_place(folder), [server], serves=True) as host:
        signal.signal(signal.SIGTERM, lambda *_: host.stop())
        host.run()


def _serve_bare(folder: Path) -> None:
    reply = msgspec.msgpack.encode(1.5)

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, reply)

    with ZenohSession.open(_place(folder), server_names=("Bare",)) as network:
        handler = zenoh.handlers.Callback(answer, indirect=False)
        queryable = network.session.declare_queryable(BARE, handler)
        signal.sigwait({signal.SIGTERM})
        queryable.undeclare()


def _wait_for_both(folder: Path) -> None:
    end = monotonic() + STARTING_S
    while True:
        try:
            with _session(folder) as session, session.connect("DServer", timeout_s=1.0) as server:
                server.do(data.set("X", 1.5))
                _querier(session)
                return
        except RobotConnectionError:
            _expect_before(end)


def _expect_before(end: float) -> None:
    sleep(0.01)
    if monotonic() > end:
        raise TimeoutError(f"the servers did not start in {STARTING_S:g} s")


# --- what is measured ----------------------------------------------------------------------------


def _at_once(client: Any, folder: Path) -> tuple[float, int]:
    """Seconds for all that several clients do, and the slowest in nanoseconds."""
    context = multiprocessing.get_context("spawn")
    ready, results = context.Barrier(CLIENTS), context.Queue()
    clients = [_start(context, client, folder, i, ready, results) for i in range(CLIENTS)]
    try:
        found = [results.get(timeout=MEASURING_S) for _ in clients]
    finally:
        for process in clients:
            process.join(STARTING_S)
            process.terminate()
    begins, ends, slowest = zip(*found, strict=True)
    return max(ends) - min(begins), max(slowest)


def _set(folder: Path, client: int, ready: Barrier, results: Any) -> None:
    """One client: sets a variable of its own, some on their way at a time, and looks whether the last value
    is there."""
    name = f"Pos{client}"
    with _session(folder) as session, session.connect("DServer") as server:
        for i in range(WARM):
            server.do(data.set(name, i))
        ready.wait(STARTING_S)
        begin = perf_counter()
        for i in range(SETS):
            server.send(data.set(name, i))
            if i >= ON_THEIR_WAY - 1:
                server.recv()
        for _ in range(ON_THEIR_WAY - 1):
            server.recv()
        results.put((begin, perf_counter(), 0))
        assert server.do(data.get(name)) == SETS - 1


def _set_and_wait(folder: Path, client: int, ready: Barrier, results: Any) -> None:
    """One client that waits for the answer to a set before it makes the next."""
    name = f"Pos{client}"
    with _session(folder) as session, session.connect("DServer") as server:
        results.put(_timed(lambda i: server.do(data.set(name, i)), ready))
        assert server.do(data.get(name)) == SETS - 1


def _ask_bare(folder: Path, client: int, ready: Barrier, results: Any) -> None:
    """One client of the bare queryable."""
    with _session(folder) as session:
        querier = _querier(session)
        results.put(_timed(lambda i: next(iter(querier.get())), ready))


def _timed(do: Callable[[int], object], ready: Barrier) -> tuple[float, float, int]:
    """Begin and end of doing it many times, and the slowest in nanoseconds."""
    slowest = 0
    for i in range(WARM):
        do(i)
    ready.wait(STARTING_S)
    begin = perf_counter()
    for i in range(SETS):
        before = perf_counter_ns()
        do(i)
        slowest = max(slowest, perf_counter_ns() - before)
    return begin, perf_counter(), slowest


def _querier(session: Session) -> zenoh.Querier:
    """A bare querier, once it has found whom to ask."""
    querier = session.hub.network.session.declare_querier(
        BARE, consolidation=zenoh.ConsolidationMode.NONE, target=zenoh.QueryTarget.BEST_MATCHING
    )
    end = monotonic() + STARTING_S
    while not querier.matching_status.matching:
        _expect_before(end)
    return querier


def _gets(folder: Path) -> tuple[list[int], list[int]]:
    """Nanoseconds of single gets: by a connection, and by a bare querier."""
    colony: list[int] = []
    bare: list[int] = []
    with _session(folder) as session, session.connect("DServer") as server:
        querier = _querier(session)
        for i in range(-WARM, GETS):
            before = perf_counter_ns()
            value = server.do(data.get("X"))
            between = perf_counter_ns()
            (answer,) = querier.get()
            after = perf_counter_ns()
            assert answer.ok is not None
            assert msgspec.msgpack.decode(answer.ok.payload.to_bytes()) == value
            if i >= 0:
                colony.append(between - before)
                bare.append(after - between)
    return colony, bare


def _rate(us: float) -> str:
    return f"{1e6 / us:,.0f} a second"


def _p99(ns: list[int]) -> str:
    return f"99th percentile {quantiles(ns, n=100)[98] / 1e3:.0f} us"


def _row(name: str, value: float, target: float | None, unit: str, note: str = "") -> Row:
    ok = target is None or value <= target
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": ok, "note": note}


def main() -> None:
    """Print the table."""
    for row in run():
        target = "" if row["target"] is None else f"{row['target']:g}"
        verdict = "" if row["target"] is None else "ok" if row["ok"] else "MISS"
        print(
            f"{row['name']:36} {row['value']:>12,.4g} {row['unit']:5} {target:>4} {verdict:4} {row['note']}"
        )


if __name__ == "__main__":
    main()
