"""The watch over a served robot: a line when a driver fails or works again, or the robot is stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing

from colony.runtime.kit.connection import Session
from colony.runtime.kit.discovery import session_with
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.robot_state import failing_parts, stopped_by
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.runtime.transport.live.run_directory import LiveError
from colony.text.wording import listed

WATCH_INTERVAL_S = 1.0
"""Seconds between two looks at the drivers."""


MAX_REASONS = 5
"""Maximum number of reasons that are reported in one outage of a server."""


class DriverReports:
    """Reports which servers have a driver that fails, and emergency stops. Mutable: remembers which do.

    Each reason is reported once in an outage. Servers that fail for one reason, such as those of one port,
    share a line, and so does the end of their outage.

    Attributes:
        first: the first line about each server whose driver has failed, in order.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._reasons: dict[str, list[str]] = {}  # of each server that fails, the newest one last
        self._recovered: dict[str, str] = {}  # the last reason of servers that work again
        self.first: dict[str, str] = {}
        self._stopped_by = ""

    def stopped(self, by: str | None) -> None:
        """Take the connection that has stopped the robot, "" for none; None, if unknown, changes nothing."""
        if by is None or by == self._stopped_by:
            return
        self._stopped_by = by
        release = f"EMERGENCY STOP, by {by}: nothing moves until `colony stop --release`"
        self._report(release if by else "the emergency stop was released")

    def update(self, found: Mapping[str, tuple[str, ...] | None]) -> None:
        """Take the parts of servers that fail; None, which changes nothing, for one that does not answer."""
        fresh: dict[str, list[str]] = {}
        known = self._known()
        for server, failing in found.items():
            if failing:
                self._note(server, failing[0])
                if failing[0] in self._reasons[server] and failing[0] not in known:
                    fresh.setdefault(failing[0], []).append(server)
            elif failing is not None and server in self._reasons:
                self._recovered[server] = self._reasons.pop(server)[-1]
        for reason, servers in fresh.items():
            self._report(f"{listed(servers, 'and')} {'fail' if len(servers) > 1 else 'fails'}: {reason}")
        for reason in set(self._recovered.values()) - self._known():
            servers = [server for server, last in self._recovered.items() if last == reason]
            self._report(f"{listed(servers, 'and')} {'work' if len(servers) > 1 else 'works'} again")
            self._recovered = {s: last for s, last in self._recovered.items() if last != reason}

    def _known(self) -> set[str]:
        return {reason for reasons in self._reasons.values() for reason in reasons}

    def _note(self, server: str, reason: str) -> None:
        self.first.setdefault(server, reason)
        self._recovered.pop(server, None)
        reasons = self._reasons.setdefault(server, [])
        if reason not in reasons and len(reasons) < MAX_REASONS:
            reasons.append(reason)


class DriverWatch:
    """A thread that asks once a second for failing drivers and an emergency stop, and reports changes.

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
            found: dict[str, tuple[str, ...] | None] = {}
            for server in self._servers:
                found[server] = failing_parts(session, server)
                if self._closed.is_set():
                    return
            self._reports.stopped(stopped_by(session))
            self._reports.update(found)
