"""Trials: does a test fail when a mutant is planted? Each one in a process of its own, forked for it.

Tests are tried in the order in which they are likely to be quick about it: those that have killed mutants of
the module before, then the short ones. Property tests do not shrink what they find.
"""

from __future__ import annotations

import os
import resource
import select
import signal
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Literal, NoReturn

import pytest
from hypothesis import Phase, settings

from tools.mutants.baseline import Baseline
from tools.mutants.scope import SEEING_MOST

Tell = Callable[[str], object]
"""Is called with the name of a test that fails, and does not come back."""

Status = Literal["killed", "timeout", "survived", "untested"]

MEMORY = 4 << 30
"""Bytes that a mutant may take beyond what is there already."""

LONGEST_S = 240
"""A trial that takes longer hangs."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """`by` is the test that failed, if the process lived to tell."""

    status: Status
    by: str = ""


@dataclass(slots=True)
class Order:
    """The order of tests for the mutants of one module. Mutable: which tests have killed so far."""

    baseline: Baseline
    budget_s: float
    kills: Counter[str] = field(default_factory=Counter)

    def of(self, tests: Iterable[str]) -> list[str]:
        """Those that see most, and short ones as far as the budget goes; who kills most a second first."""
        seconds, left = self.baseline.seconds, self.budget_s
        kept: list[str] = []
        for test in sorted(tests, key=lambda t: (not t.startswith(SEEING_MOST), seconds[t], t)):
            left -= 0.0 if test.startswith(SEEING_MOST) else seconds[test]
            if left < 0 and kept:
                break
            kept.append(test)
        return sorted(kept, key=lambda t: (-self.kills[t] / (seconds[t] + 0.01), seconds[t], t))


def forked(work: Callable[[Tell], None]) -> Verdict:
    """Do `work` in a process of its own; it calls what it is given with the name of a test that fails."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        _limit()
        _work(work, writing)
    os.close(writing)
    told = b""
    while select.select([reading], [], [], LONGEST_S)[0]:
        more = os.read(reading, 4096)
        if not more:
            break
        told += more
    else:
        os.kill(child, signal.SIGKILL)
    os.close(reading)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if code in (-signal.SIGPROF, -signal.SIGKILL):
        return Verdict("timeout")
    if code == 0 and told == b"survived":
        return Verdict("survived")
    return Verdict("killed", told.decode())


def _limit() -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _work(work: Callable[[Tell], None], writing: int) -> NoReturn:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)

    def failed(test: str) -> NoReturn:
        os.write(writing, test.encode())
        os._exit(1)

    try:
        work(failed)
    except BaseException as raised:
        os.write(writing, f"{type(raised).__name__}: {raised}"[:200].encode(errors="replace"))
        os._exit(1)
    os.write(writing, b"survived")
    os._exit(0)


def at_most(seconds: float) -> None:
    """End this process when it has computed for so long from now (0: no more limit)."""
    signal.setitimer(signal.ITIMER_PROF, seconds)


def run(items: Sequence[pytest.Item], baseline: Baseline) -> None:
    """Run these tests, in this order; `Failing` tells when one fails."""
    for item, following in pairwise([*items, None]):
        assert item is not None
        at_most(2.0 + 10 * baseline.seconds[item.nodeid])
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
    at_most(0)


class Failing:
    """A plugin: tells of the first test that fails, and has property tests not shrink."""

    def __init__(self, tell: Tell | None = None) -> None:
        self.tell = tell

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self) -> None:
        quick = tuple(phase for phase in settings().phases if phase is not Phase.shrink)
        settings.register_profile("mutants", settings(), phases=quick)
        settings.load_profile("mutants")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and self.tell is not None:
            self.tell(report.nodeid)
