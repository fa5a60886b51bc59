"""The state of a robot as seen from outside: its servers, their connections, and its run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import msgspec

from colony.ir.servers import DSERVER, PROXIMITY, RSERVER, RUNTIME
from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError
from colony.runtime.library import actuator
from colony.runtime.library.ask import STATUS, CallRequest
from colony.runtime.library.clock import Participants, participants
from colony.runtime.library.leader import LEADER, RunStatus, run_status
from colony.runtime.library.robot import BaseArbitration, arbitration
from colony.runtime.protocol.calls import ConnectionStatus
from colony.runtime.protocol.topics import CLOCK, OBSERVER
from colony.runtime.transport.live.robot_address import Local, RobotAddress

CORE_SERVERS = (CLOCK, DSERVER.name, RUNTIME.name)
"""The servers that every robot has. The Clock knows which others it has."""

_ORDER = (CLOCK, RSERVER.name, PROXIMITY, DSERVER.name, RUNTIME.name)
"""The servers that come first, in order."""

ANSWER_TIMEOUT_S = 1.0

PRESENCE_TIMEOUT_S = 1.0
"""Maximum seconds to wait until this process is linked to all servers that have a socket here.

On a busy computer a link takes longer than `Session.servers` waits, which is short, because emergency stops
wait for it as well.
"""

PRESENCE_INTERVAL_S = 0.02

READER = "colony ps"
"""Name of the connections that read the state of servers, which do not count among theirs."""

UNHEARD = "the Clock does not hear it"

T = TypeVar("T")


class ServerState(msgspec.Struct, frozen=True, kw_only=True):
    """The state of one server.

    `state` is "up", "down" (absent), "silent" (present, but not answering) or "unheard" (answering, but no
    answer to a tick reaches the Clock). `process` is known only on the robot's own machine. `connections` are
    those of its clients; `full` describes the limits that it reached, `failing` the drivers, or functions of
    a user, that fail now; `opening` means that the device is being opened.
    """

    server: str
    state: str
    process: int | None
    connections: tuple[ConnectionStatus, ...] = ()
    malformed: int = 0
    full: tuple[str, ...] = ()
    failing: tuple[str, ...] = ()
    opening: bool = False
    problem: str | None = None


class RobotState(msgspec.Struct, frozen=True, kw_only=True, rename={"participants": "who"}):
    """The state of a robot; `run`, `arbitration`, `participants` are None if their server does not answer.

    `actuators` has the arbitration of servers of users that take commands.
    """

    robot: str
    servers: tuple[ServerState, ...]
    run: RunStatus | None
    arbitration: BaseArbitration | None
    participants: Participants | None
    actuators: dict[str, actuator.Arbitration] = {}


def as_json(states: Sequence[RobotState]) -> str:
    """Return the states as a JSON array, for programs."""
    return msgspec.json.format(msgspec.json.encode(states), indent=2).decode()


def state_of(session: Session, robot_address: RobotAddress) -> RobotState:
    """Ask all servers in parallel, and report those without an answer as silent."""
    processes, linked = dict[str, int](), set[str]()
    if isinstance(robot_address, Local):
        processes = dict(robot_address.directory.running())
        linked = processes.keys() & {*CORE_SERVERS, *robot_address.directory.servers()}
    present = present_nodes(session.servers, linked)
    present_servers = {address for address in present if "/" not in address} - {OBSERVER}
    names = sorted({*CORE_SERVERS, *present_servers, *processes} - {OBSERVER}, key=_order)
    with ThreadPoolExecutor(max_workers=len(names)) as pool:
        futures = {
            name: pool.submit(_query, session, name, name in present_servers, processes.get(name))
            for name in names
        }
        answers = {name: future.result() for name, future in futures.items()}
    known = _details(answers.get(CLOCK), Participants)
    states = {name: state for name, (state, _) in answers.items()}
    if known is not None:
        present_states = {name: state for name, state in states.items() if name in present_servers}
        states |= {state.server: state for state in watched_by_clock(present_states, known, processes)}
    return RobotState(
        robot=robot_address.robot,
        servers=tuple(states[name] for name in sorted(states, key=_order)),
        run=_details(answers.get(LEADER), RunStatus),
        arbitration=_details(answers.get(RSERVER.name), BaseArbitration),
        participants=known,
        actuators={
            name: details
            for name, (_, details) in answers.items()
            if isinstance(details, actuator.Arbitration)
        },
    )


def watched_by_clock(
    present: Mapping[str, ServerState], known: Participants, processes: Mapping[str, int]
) -> Iterator[ServerState]:
    """Yield the states of the Clock's servers that are not present, or that the Clock does not hear."""
    for watched in known.servers:
        name, state = watched.server, present.get(watched.server)
        if "/" in name:
            continue
        if state is None:
            yield ServerState(server=name, state="down", process=processes.get(name))
        elif state.state == "up" and not watched.up:
            yield msgspec.structs.replace(state, state="unheard", problem=UNHEARD)


def present_nodes(nodes: Callable[[], Iterable[str]], expected: Set[str]) -> set[str]:
    """Return the nodes that are present, as soon as all expected ones are, or after `PRESENCE_TIMEOUT_S`.

    Args:
        nodes: function that returns the addresses of the nodes that have been found.
        expected: addresses of nodes whose processes run on this machine.
    """
    give_up_at_s = time.monotonic() + PRESENCE_TIMEOUT_S
    while not expected <= (found := set(nodes())) and time.monotonic() < give_up_at_s:
        time.sleep(PRESENCE_INTERVAL_S)
    return found


def _order(name: str) -> tuple[int, str]:
    return (_ORDER.index(name) if name in _ORDER else len(_ORDER), name)


_DETAIL_CALLS: dict[str, Callable[[], CallRequest[Any]]] = {
    CLOCK: participants,
    RSERVER.name: arbitration,
    LEADER: run_status,
}
"""Additional calls to some servers."""


def _query(session: Session, name: str, is_present: bool, process: int | None) -> tuple[ServerState, object]:
    if not is_present:
        # a process without a node, such as the plant, is not a server and takes no calls
        state = "down" if process is None or name in CORE_SERVERS else "up"
        return ServerState(server=name, state=state, process=process), None
    try:
        with session.connect(name, name=READER, timeout_s=ANSWER_TIMEOUT_S) as connection:
            status = connection.do(STATUS)
            details = _ask_details(connection, name)
    except RobotConnectionError as problem:
        return ServerState(server=name, state="silent", process=process, problem=str(problem)), None
    server_state = ServerState(
        server=name,
        state="up",
        process=process,
        connections=tuple(c for c in status.connections if c.name != READER),
        malformed=status.malformed,
        full=status.full,
        failing=status.failing,
        opening=status.opening,
    )
    return server_state, details


def failing_parts(session: Session, server: str) -> tuple[str, ...] | None:
    """Return a line for each part of a server that fails now.

    None if the server does not answer, or if its device is being opened and has not failed.
    """
    try:
        with session.connect(server, name=READER, timeout_s=ANSWER_TIMEOUT_S) as connection:
            status = connection.do(STATUS)
            return None if status.opening and not status.failing else status.failing
    except RobotConnectionError:
        return None


def stopped_by(session: Session) -> str | None:
    """Return the connection that has stopped the robot, "" if none has; None if the Clock does not answer."""
    try:
        with session.connect(CLOCK, name=READER, timeout_s=ANSWER_TIMEOUT_S) as connection:
            stopped = connection.do(participants()).stopped
            return "" if stopped is None else stopped.by
    except RobotConnectionError:
        return None


def _ask_details(connection: Connection, name: str) -> object:
    """Return what a server reports besides its status; None for one that has no more to report.

    Servers of devices and of users tell who commands their actuators, if they take commands.
    """
    if name in CORE_SERVERS and name not in _DETAIL_CALLS:
        return None
    details: Callable[[], CallRequest[Any]] = _DETAIL_CALLS.get(name, actuator.arbitration)
    try:
        return connection.do(details())
    except CallRefusedError:  # a base over the driver of a user, for example, is a device like others
        return None


def _details(answer: tuple[ServerState, object] | None, type_: type[T]) -> T | None:
    return answer[1] if answer is not None and isinstance(answer[1], type_) else None
