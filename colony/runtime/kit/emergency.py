"""The emergency stop of a whole robot: sent to all actuator servers, and kept by the Clock.

    with Session.open("rome") as session, StopButton(session) as button:
        report = button.press()
        assert report.kept

A button opens its connections beforehand, so that pressing it takes one message to each server.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Set
from dataclasses import dataclass
from queue import Empty, SimpleQueue

from colony.ir.servers import PROXIMITY, RUNTIME
from colony.runtime.kit.channel import Channel
from colony.runtime.kit.connection import Session
from colony.runtime.kit.conversation import Outcome, Pending, read_result
from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError
from colony.runtime.library import emergency
from colony.runtime.library.leader import LEADER
from colony.runtime.protocol.topics import CLOCK, OBSERVER
from colony.runtime.transport.live.gateway import GATEWAY

RESEND_INTERVAL_S = 0.03
"""Seconds after which a stop without an acknowledgement is resent.

A congested link may drop the first one. Servers recognize a repeated stop.
"""

ACKNOWLEDGE_TIMEOUT_S = 2.0
"""Seconds to wait for acknowledgements."""

INSIST_S = 10.0
"""Seconds for which a stop is sent again and again to servers that have not answered.

They may be frozen, or be started again just now, and would drive on afterwards.
"""

SERVERS = (CLOCK, *emergency.ACTUATOR_SERVERS)
"""The servers of every robot that accept an emergency stop."""

WITHOUT_ACTUATORS = frozenset({PROXIMITY, RUNTIME.name, LEADER, OBSERVER, GATEWAY, "Simulator", "Supervisor"})
"""Servers and processes without actuators.

Any other server that is up gets the stop, and may answer that it has none, too.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class StopReport:
    """The result of an emergency stop: the servers that acknowledged it, and the problems of the others.

    `unanswered` are those among them that have not answered; a Clock that is down is one.
    """

    acknowledged: tuple[str, ...]
    problems: Mapping[str, str]
    unanswered: tuple[str, ...] = ()

    @property
    def kept(self) -> bool:
        """True if the Clock and every actuator server that was up have acknowledged the stop."""
        return CLOCK in self.acknowledged and not self.problems


class StopButton:
    """A button that stops a robot. Mutable.

    Args:
        session: the session with the robot, which stays open.
        name: the display name of the connections.
        timeout_s: seconds to wait for the acknowledgements.
    """

    def __init__(
        self, session: Session, *, name: str = "stop button", timeout_s: float = ACKNOWLEDGE_TIMEOUT_S
    ) -> None:
        self._session = session
        self._name = name
        self._timeout_s = timeout_s
        self._channels: dict[str, Channel] = {}
        for server in SERVERS:
            self._open(server)

    def press(self) -> StopReport:
        """Stop the robot, and wait until every actuator server that is up has acknowledged it.

        The servers of every robot are sent the stop first, then servers of users. The Clock, and the
        successor of a server that ends before it has acknowledged, are waited for while the button waits.
        What is in `unanswered` has not got this stop, and never will: press again.

        Raises:
            CallRefusedError: this user may not stop the robot.
        """
        outcomes: SimpleQueue[tuple[str, Outcome]] = SimpleQueue()
        stop, due = emergency.stop(), time.monotonic() + self._timeout_s
        pending_calls: dict[str, Pending] = {}

        def send(server: str) -> None:
            def put(outcome: Outcome) -> None:
                outcomes.put((server, outcome))

            pending_calls[server] = self._channels[server].submit(stop, put)

        try:
            for server in self._channels:
                send(server)
            present = self._present()
            for server in sorted(present):
                if server not in self._channels and server not in WITHOUT_ACTUATORS and "/" not in server:
                    self._open(server)
                    send(server)
            return self._collect(outcomes, due, pending_calls, present)
        finally:
            for server, pending in pending_calls.items():
                self._channels[server].forget(pending)

    def insist(self, pressed: StopReport) -> StopReport:
        """Press again while servers have not answered, for at most `INSIST_S`; return the last report."""
        until = time.monotonic() + INSIST_S
        while pressed.unanswered and time.monotonic() < until:
            pressed = self.press()
        return pressed

    def _collect(
        self,
        outcomes: SimpleQueue[tuple[str, Outcome]],
        due: float,
        pending_calls: Mapping[str, Pending],
        present: Set[str],
    ) -> StopReport:
        """Wait for the answers; a server of `present` that ends before its answer may be started again."""
        answers: dict[str, Outcome] = {}
        while (missing := self._unanswered(answers, present | {CLOCK})) and (
            left_s := due - time.monotonic()
        ) > 0.0:
            try:
                server, outcome = outcomes.get(timeout=min(left_s, RESEND_INTERVAL_S))
                answers[server] = outcome
            except Empty:
                for server in missing:
                    self._channels[server].resend(pending_calls[server])
        problems: dict[str, str] = {}
        acknowledged: list[str] = []
        for server in [server for server in self._channels if server in answers]:
            try:
                read_result(server, emergency.stop(), answers[server])
            except RobotConnectionError as problem:
                if server in SERVERS or not _has_no_actuators(problem):
                    problems[server] = str(problem)
            else:
                acknowledged.append(server)
        for server in self._unanswered(answers, present):
            problems[server] = f"{server} did not acknowledge the stop in {self._timeout_s:g} s"
        if CLOCK not in answers and CLOCK not in problems:
            problems[CLOCK] = "the Clock is down, so a server that restarts will not know of the stop"
        unanswered = tuple(server for server in problems if server not in answers)
        return StopReport(acknowledged=tuple(acknowledged), problems=problems, unanswered=unanswered)

    def _open(self, server: str) -> None:
        channel = self._session.hub.channel(server, name=self._name, priority=0, notify=lambda _: None)
        channel.open(lambda _: None)
        self._channels[server] = channel

    def _unanswered(self, answers: Mapping[str, Outcome], present: Set[str]) -> list[str]:
        """Return the servers that are up, or were when they were sent the stop, and have not answered."""
        missing = [server for server in self._channels if server not in answers]
        up = present | self._present() if missing else present
        return [server for server in missing if server in up]

    def _present(self) -> Set[str]:
        """Return the servers that are up; on this machine also those whose process is frozen."""
        return {*self._session.servers(), *self._session.hub.running()}

    def close(self) -> None:
        """Close the connections. Idempotent."""
        channels, self._channels = self._channels, {}
        for channel in channels.values():
            self._session.hub.release(channel)

    def __enter__(self) -> StopButton:
        """Return the button."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the connections."""
        self.close()


def _has_no_actuators(problem: RobotConnectionError) -> bool:
    """Return True if a server refuses the stop because it has no such method."""
    return isinstance(problem, CallRefusedError) and problem.code == "method"
