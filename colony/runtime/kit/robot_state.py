"""The state of a robot as seen from outside: its servers, their connections, and its run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import msgspec

from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library.ask import STATUS, Ask
from colony.runtime.library.clock import Who, who
from colony.runtime.library.leader import LEADER, RunStatus, run_status
from colony.runtime.library.robot import Arbitration, arbitration
from colony.runtime.protocol.calls import ConnectionStatus
from colony.runtime.protocol.fields import DSERVER, PSERVER, RSERVER, RUNTIME
from colony.runtime.protocol.topics import CLOCK, OBSERVER
from colony.runtime.transport.live.place import Local, Place

ALWAYS = (CLOCK, RSERVER.name, PSERVER.name, DSERVER.name, RUNTIME.name)
"""The servers that every robot has."""

PATIENCE_S = 1.0

T = TypeVar("T")


class ServerState(msgspec.Struct, frozen=True, kw_only=True):
    """The state of one server.

    `state` is "up", "down" (absent) or "silent" (present without an answer). `process` is known on the
    robot's own machine. `connections` are its clients, `full` the limits that are reached.
    """

    server: str
    state: str
    process: int | None
    connections: tuple[ConnectionStatus, ...] = ()
    malformed: int = 0
    full: tuple[str, ...] = ()
    problem: str | None = None


class RobotState(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a robot. `run`, `arbitration` and `who` are None if their servers do not answer."""

    robot: str
    servers: tuple[ServerState, ...]
    run: RunStatus | None
    arbitration: Arbitration | None
    who: Who | None


def as_json(states: Sequence[RobotState]) -> str:
    """Return the states as a JSON array, for programs."""
    return msgspec.json.format(msgspec.json.encode(states), indent=2).decode()


def state_of(session: Session, place: Place) -> RobotState:
    """Ask all servers in parallel; those that do not answer soon are reported as silent."""
    processes = dict(place.directory.running()) if isinstance(place, Local) else {}
    there = {address for address in session.servers() if "/" not in address} - {OBSERVER}
    names = sorted({*ALWAYS, *there, *processes} - {OBSERVER}, key=_order)
    with ThreadPoolExecutor(max_workers=len(names)) as pool:
        asked = {name: pool.submit(_ask, session, name, name in there, processes.get(name)) for name in names}
        found = {name: future.result() for name, future in asked.items()}
    return RobotState(
        robot=place.robot,
        servers=tuple(state for state, _ in found.values()),
        run=_answer(found.get(LEADER), RunStatus),
        arbitration=_answer(found.get(RSERVER.name), Arbitration),
        who=_answer(found.get(CLOCK), Who),
    )


def _order(name: str) -> tuple[int, str]:
    return (ALWAYS.index(name) if name in ALWAYS else len(ALWAYS), name)


_MORE: dict[str, Callable[[], Ask[Any]]] = {
    CLOCK: who,
    RSERVER.name: arbitration,
    LEADER: run_status,
}
"""Additional calls to some servers."""


def _ask(session: Session, name: str, there: bool, process: int | None) -> tuple[ServerState, object]:
    if not there:
        # a process without a node, such as the plant, is not a server and cannot be asked
        state = "down" if process is None or name in ALWAYS else "up"
        return ServerState(server=name, state=state, process=process), None
    try:
        with session.connect(name, name="colony ps", timeout_s=PATIENCE_S) as connection:
            status = connection.do(STATUS)
            more = connection.do(_MORE[name]()) if name in _MORE else None
    except RobotConnectionError as problem:
        return ServerState(server=name, state="silent", process=process, problem=str(problem)), None
    others = tuple(c for c in status.connections if c.name != "colony ps")
    found = ServerState(
        server=name,
        state="up",
        process=process,
        connections=others,
        malformed=status.malformed,
        full=status.full,
    )
    return found, more


def _answer(found: tuple[ServerState, object] | None, kind: type[T]) -> T | None:
    return found[1] if found is not None and isinstance(found[1], kind) else None
