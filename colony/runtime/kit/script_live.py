"""Scripts (`script.py`) over live connections to a robot's processes.

with Session.open("rome") as rome:
    run_script(rome, planner(plan), name="planner")

with LiveScripts(session, {"clerk": clerk(), "planner": planner(plan)}, leader="planner") as scripts:
    scripts.wait()
print(scripts.done, scripts.problem)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from threading import Event, Lock, Thread

from colony.runtime.kit.connection import TIMEOUT_S, Connection, Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.script import Do, RunningScript, Script, Sleep

RETRY_INTERVAL_S = 0.1
"""Seconds from the end of a restarted script until the next one begins."""

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

        running = RunningScript(name=name, script=script)
        value: object = None
        problem: RobotConnectionError | None = None
        while not end_requested.is_set():
            step, problem = running.next(value, problem), None
            match step:
                case None:
                    return True
                case Sleep(seconds=seconds):
                    end_requested.wait(max(0.0, seconds))
                    value = session.time_ns()
                case Do(server=server, call=call):
                    try:
                        value = connection(server).do(call)
                    except RobotConnectionError as error:
                        value, problem = None, error
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


class RestartedScript:
    """A thread that runs a script until it is closed; after its end or a failed call it begins the next one.

    Args:
        session: the session with the robot.
        script: function that returns the script.
        name: the display name of its connections.
    """

    def __init__(self, session: Session, script: Callable[[], Script], *, name: str) -> None:
        self._session, self._script, self._name = session, script, name
        self._stop = Event()
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the script. Idempotent."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.is_set():
            with suppress(RobotConnectionError):  # the server is restarting
                run_script(self._session, self._script(), name=self._name, stop=self._stop)
            self._stop.wait(RETRY_INTERVAL_S)


class LiveScripts:
    """Scripts, each in a thread with connections of its own; when the leader ends, all end. Mutable.

    Args:
        session: this process's session with the robot.
        scripts: generators that have not been started, by name.
        leader: the script whose end ends all of them. The failure of any script ends them too, because they
            depend on each other.
    """

    def __init__(self, session: Session, scripts: Mapping[str, Script], *, leader: str) -> None:
        if leader not in scripts:
            raise ValueError(
                f"the leader `{leader}` is not among the scripts; expected one of {', '.join(scripts)}"
            )
        self._session, self._leader = session, leader
        self._stop = Event()
        self._lock = Lock()
        self._threads = [
            Thread(target=self._run, args=(name, script), name=name, daemon=True)
            for name, script in scripts.items()
        ]
        self.done = False
        self.problem = ""

    @property
    def over(self) -> bool:
        """True if the leader has ended, a script has failed, or `close` was called."""
        return self._stop.is_set()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until the scripts are over, or for `timeout_s`; return True if they are."""
        return self._stop.wait(timeout_s)

    def close(self) -> None:
        """End all scripts. Idempotent.

        Then `done` is True if the leader reached its end, and `problem` is the first error, "" for none.
        """
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def __enter__(self) -> LiveScripts:
        """Start all scripts."""
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *raised: object) -> None:
        """End all scripts."""
        self.close()

    def _run(self, name: str, script: Script) -> None:
        try:
            ended = run_script(self._session, script, name=name, stop=self._stop)
        except Exception as problem:
            # `_fail` reports only the first failure, and none after the end
            self._fail(name, problem)
        else:
            if ended and name == self._leader:
                self.done = True
                self._stop.set()

    def _fail(self, name: str, problem: Exception) -> None:
        with self._lock:
            if not self._stop.is_set():
                kind = "" if isinstance(problem, RobotConnectionError) else f"{type(problem).__name__}: "
                self.problem = f"{name}: {kind}{problem}"
            self._stop.set()
