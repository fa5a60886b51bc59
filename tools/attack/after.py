"""How a robot is after an attack: whether everything answers, and how large its processes are."""

from __future__ import annotations

import time
from typing import NamedTuple

from colony.runtime.kit.connection import Session
from colony.runtime.library.ask import STATUS
from colony.runtime.transport.live.run_directory import UnreachableError
from tools.attack.lab import Lab, memory_mb

SERVERS = ("Clock", "RServer", "DServer", "PServer")
RECOVERED_S = 10.0
"""Time within which a robot is to be itself again."""

ANSWER_S = 0.1
MEMORY_MB = 150.0
_ROUNDS = 10


class After(NamedTuple):
    """Seconds until everything answered in time again, the slowest answer then, and the largest process."""

    seconds: float
    slowest_s: float
    largest: str
    megabytes: float

    @property
    def well(self) -> bool:
        """Whether the robot is itself again."""
        return self.seconds <= RECOVERED_S and self.megabytes <= MEMORY_MB


def after(robot: Lab) -> After:
    """Ask every server, at home and through the gateway, until all answer in time."""
    begin = time.monotonic()
    while True:
        slowest_s = max(_slowest(robot, home=True), _slowest(robot, home=False))
        seconds = time.monotonic() - begin
        if slowest_s <= ANSWER_S or seconds > 2 * RECOVERED_S:
            break
    sizes = {
        name: memory_mb(pid) for name, pid in robot.machine.directory.running().items() if name != "Simulator"
    }
    largest = max(sizes, key=lambda name: sizes[name])
    return After(seconds, slowest_s, largest, sizes[largest])


def _slowest(robot: Lab, *, home: bool) -> float:
    """The slowest answer of all servers, on connections that were opened just now."""
    try:
        with robot.machine.session() if home else robot.session("ada") as session:
            return max(_answered(session, server) for server in SERVERS)
    except UnreachableError:
        return float("inf")


def _answered(session: Session, server: str) -> float:
    with session.connect(server, timeout_s=2 * RECOVERED_S) as connection:
        times = []
        for _ in range(_ROUNDS):
            begin = time.monotonic()
            connection.do(STATUS)
            times.append(time.monotonic() - begin)
        return max(times)
