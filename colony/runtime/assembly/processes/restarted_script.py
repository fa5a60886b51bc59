"""A script in a thread of a run's leader that outlives its servers, such as one that sets variables."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress

from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.script import Script
from colony.runtime.kit.script_live import run_script

RETRY_INTERVAL_S = 0.1
"""Seconds from the failure of a call until the next script begins."""


class RestartedScript:
    """A thread that runs a script until it is closed; after a failed call it begins the next one.

    Args:
        session: the session with the robot.
        script: function that returns the script.
        name: the display name of its connections.
    """

    def __init__(self, session: Session, script: Callable[[], Script], *, name: str) -> None:
        self._session, self._script, self._name = session, script, name
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
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
