"""Variables of a running DServer that a run keeps fresh by setting them repeatedly.

They stay fresh enough for the sensors that read them, as if an operator held a lever. A DServer that the run
itself starts needs no such thread: it pins its variables.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping

from colony.ir.types import Value
from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library import data
from colony.runtime.protocol.fields import DSERVER

SET_INTERVAL_S = 0.1
"""Seconds between two times that the variables are set."""


class PinnedVariables:
    """A thread that sets `values` repeatedly until it is closed."""

    def __init__(self, session: Session, values: Mapping[str, Value]) -> None:
        self._session = session
        self._values = values
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="pinned variables", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop setting the values. Idempotent."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(SET_INTERVAL_S):
            try:
                with self._session.connect(DSERVER.name, name="pinned variables") as connection:
                    while not self._stop.is_set():
                        connection.do(data.set_many(self._values))
                        self._stop.wait(SET_INTERVAL_S)
            except RobotConnectionError:
                continue  # the server is restarting
