"""Several scripts in parallel over live connections; when the leader ends, all end.

with LiveScripts(session, {"clerk": clerk(), "planner": planner(plan)}, leader="planner") as scripts:
    scripts.wait()
print(scripts.done, scripts.problem)
"""

from __future__ import annotations

from collections.abc import Mapping
from threading import Event, Lock, Thread

from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.script import Script
from colony.runtime.kit.script_live import run_script


class LiveScripts:
    """Scripts, each in a thread with connections of its own. Mutable.

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
