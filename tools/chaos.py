"""Chaos from a seed: a schedule of SIGSTOP and SIGKILL for the processes of a run, and its execution.

Each process draws its own faults, so that they do not depend on how fast the machine is. Lifetimes are spread
over orders of magnitude: processes that die soon after they came back meet others that have run for long, and
whose memory is worth measuring.
"""

from __future__ import annotations

import math
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from heapq import heappop, heappush
from random import Random
from typing import NamedTuple

FREEZE_S = (0.01, 0.6)
"""Shortest and longest freeze: from a fifth of a frame to more than twice the liveness lease."""

LIFETIME_S = (6.0, 240.0)
"""Shortest and longest lifetime of a process. Its supervisor gives up a process that dies again and again
within 5 s (`restarts.py`)."""

FIRST_DEATH_S = (2.0, 25.0)
"""Range of the first death of a server, so that a short run sees each of them die."""


class Fault(NamedTuple):
    """A signal at a time since the beginning: SIGKILL if `freeze_s` is None, else SIGSTOP for so long."""

    at_s: float
    name: str
    freeze_s: float | None


def schedule(
    seed: int, servers: Mapping[str, float], clients: Mapping[str, float], seconds: float
) -> list[Fault]:
    """Draw the faults of all processes, ordered by time.

    Args:
        seed: Seed of all that is drawn.
        servers: Names of servers, each with its freezes per second; their first deaths come early.
        clients: Names of clients, likewise, whose first deaths may come late.
        seconds: Length of the schedule.
    """
    faults: list[Fault] = []
    for name, freezes_per_s in (*servers.items(), *clients.items()):
        random = Random(f"kill {seed} {name}")
        first = random.uniform(*FIRST_DEATH_S) if name in servers else _between(random, LIFETIME_S)
        faults += _kills(random, name, first, seconds)
        faults += _freezes(Random(f"freeze {seed} {name}"), name, freezes_per_s, seconds)
    return sorted(faults)


def _kills(random: Random, name: str, at_s: float, seconds: float) -> Iterator[Fault]:
    while at_s < seconds:
        yield Fault(at_s, name, None)
        at_s += _between(random, LIFETIME_S)


def _freezes(random: Random, name: str, per_s: float, seconds: float) -> Iterator[Fault]:
    at_s = random.expovariate(per_s)
    while at_s < seconds:
        yield Fault(at_s, name, _between(random, FREEZE_S))
        at_s += random.expovariate(per_s)


def _between(random: Random, limits: tuple[float, float]) -> float:
    """Draw from a log-uniform distribution."""
    return math.exp(random.uniform(*map(math.log, limits)))


class Chaos:
    """The execution of a schedule. Mutable: the faults that are due, and the processes that are frozen.

    Args:
        faults: Ordered by time.
        pid: Returns the process of a name, None while there is none.
    """

    def __init__(self, faults: Iterable[Fault], pid: Callable[[str], int | None]) -> None:
        self._faults = list(faults)[::-1]
        self._pid = pid
        self._frozen: list[tuple[float, int]] = []
        self.kills: Counter[str] = Counter()
        self.freezes: Counter[str] = Counter()

    def turn(self, now_s: float) -> None:
        """Do what is due."""
        while self._frozen and self._frozen[0][0] <= now_s:
            _send(heappop(self._frozen)[1], signal.SIGCONT)
        while self._faults and self._faults[-1].at_s <= now_s:
            self._strike(self._faults.pop(), now_s)

    def end(self) -> None:
        """Thaw every process; no fault comes after this."""
        self._faults.clear()
        while self._frozen:
            _send(heappop(self._frozen)[1], signal.SIGCONT)

    def _strike(self, fault: Fault, now_s: float) -> None:
        pid = self._pid(fault.name)
        if pid is None:  # it is being started again
            return
        if fault.freeze_s is None:
            self.kills[fault.name] += _send(pid, signal.SIGKILL)
        elif _send(pid, signal.SIGSTOP):
            self.freezes[fault.name] += 1
            heappush(self._frozen, (now_s + fault.freeze_s, pid))


def _send(pid: int, number: signal.Signals) -> bool:
    try:
        os.kill(pid, number)
    except ProcessLookupError:  # it was killed while it was frozen
        return False
    return True
