"""The watch over drivers of real devices: a line when one begins to fail, and one when it works again."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from contextlib import closing

from colony.robots.discovery import session_with
from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.robot_state import failing_parts
from colony.runtime.servers.drivers import BEING_OPENED
from colony.runtime.transport.live.errors import LiveError
from colony.runtime.transport.live.robot_address import RobotAddress

WATCH_INTERVAL_S = 1.0
"""Seconds between two looks at the drivers."""


MAX_REASONS = 5
"""Maximum number of reasons that are reported in one outage of a server."""


class DriverReports:
    """Reports which servers have a driver that fails. Mutable: remembers which do.

    Each reason is reported once in an outage. Of servers that fail for one reason, such as those of one port,
    only the first has it spelled out. A device that is being opened has not failed.

    Attributes:
        first: the first line about each server whose driver has failed, in order.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._reasons: dict[str, list[str]] = {}  # of each outage that lasts, the newest one last
        self.first: dict[str, str] = {}

    def update(self, server: str, failing: tuple[str, ...] | None) -> None:
        """Take the parts of a server that fail; None, which changes nothing, if it does not answer."""
        if failing:
            if failing[0] != BEING_OPENED:
                self.first.setdefault(server, failing[0])
            self._note(server, failing[0])
        elif failing is not None and (reasons := self._reasons.pop(server, None)) is not None:
            self._report(f"{server} works" if reasons == [BEING_OPENED] else f"{server} works again")

    def _note(self, server: str, reason: str) -> None:
        reported = self._reasons.setdefault(server, [])
        if reason in reported or len(reported) >= MAX_REASONS:
            return
        others = (s for s, reasons in self._reasons.items() if s != server and reasons[-1:] == [reason])
        likewise = next(others, None)
        reported.append(reason)
        if reason == BEING_OPENED:
            self._report(f"{server}: {reason}")
        else:
            self._report(f"{server} fails: {reason if likewise is None else f'as {likewise} does'}")


class DriverWatch:
    """A thread that asks servers once a second which of their drivers fail, and reports changes.

    Args:
        robot_address: the robot, some of whose processes may not run yet.
        servers: names of the servers with drivers.
        report: callback for a line, called in the thread.
    """

    def __init__(
        self, robot_address: RobotAddress, servers: Iterable[str], report: Callable[[str], None]
    ) -> None:
        self._robot_address = robot_address
        self._servers = tuple(servers)
        self._reports = DriverReports(report)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="drivers", daemon=True)
        self._thread.start()

    @property
    def failures(self) -> tuple[str, ...]:
        """One line for each server whose driver has failed."""
        return tuple(f"{server} failed: {line}" for server, line in dict(self._reports.first).items())

    def close(self) -> None:
        """End the watch. Idempotent."""
        self._closed.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closed.wait(WATCH_INTERVAL_S):
            try:
                session = session_with(self._robot_address)
            except (LiveError, RobotConnectionError):  # no process runs yet
                continue
            with closing(session):
                self._watch(session)

    def _watch(self, session: Session) -> None:
        while not self._closed.wait(WATCH_INTERVAL_S):
            for server in self._servers:
                failing = failing_parts(session, server)
                if self._closed.is_set():
                    return
                self._reports.update(server, failing)
