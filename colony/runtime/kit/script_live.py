"""A script (`script.py`) over live connections to a robot's processes.

with Session.open("rome") as rome:
    run_script(rome, planner(plan), name="planner")
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from threading import Event, Thread
from typing import Any

from colony.runtime.kit.connection import TIMEOUT_S, Connection, Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.script import Do, Script, Sleep

_CHECK_INTERVAL_S = 0.1
"""Seconds between two checks whether the script has ended by itself."""


def run_script(
    session: Session,
    script: Script,
    *,
    name: str,
    priority: int = 0,
    stop: Event | None = None,
    timeout_s: float = TIMEOUT_S,
) -> bool:
    """Run a script. Return True if it reached its end, False if `stop` was set before.

    A connection to a server opens with the script's first call to it, and all connections are closed at the
    end. A failed call raises its error in the script; an error that the script does not catch is raised here.

    Args:
        session: this process's session with the robot.
        script: a generator that has not been started.
        name: the display name of its connections.
        priority: the priority of its connections.
        stop: the event that ends the script, even while it waits for an answer.
        timeout_s: seconds to wait for an answer, unless the call needs longer.
    """
    end_requested = stop if stop is not None else Event()
    with ExitStack() as resources:
        resources.enter_context(closing(script))
        connections: dict[str, Connection] = {}
        if stop is not None:
            resources.enter_context(_closing_after(stop, connections))

        def connection(server: str) -> Connection:
            if server not in connections:
                opened = session.connect(server, name=name, priority=priority, timeout_s=timeout_s)
                connections[server] = resources.enter_context(opened)
            return connections[server]

        value: Any = None
        problem: RobotConnectionError | None = None
        while not end_requested.is_set():
            try:
                step = script.send(value) if problem is None else script.throw(problem)
            except StopIteration:
                return True
            value = problem = None
            match step:
                case Sleep(seconds=seconds):
                    end_requested.wait(max(0.0, seconds))
                    value = session.time_ns()
                case Do(server=server, call=call):
                    try:
                        value = connection(server).do(call)
                    except RobotConnectionError as error:
                        problem = error
        return False


@contextmanager
def _closing_after(stop: Event, connections: Mapping[str, Connection]) -> Iterator[None]:
    """Close the connections once `stop` is set, which ends any wait for an answer."""
    done = Event()

    def watch() -> None:
        while not done.is_set():
            if stop.wait(_CHECK_INTERVAL_S):
                for connection in tuple(connections.values()):
                    connection.close()
                done.wait(_CHECK_INTERVAL_S)  # also close a connection that was just being opened

    watcher = Thread(target=watch, daemon=True, name="script's end")
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()
