"""The findings of an acceptance test, and the verdict on the robot that follows from them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Any, Literal, NamedTuple

from colony.analysis.report import AuditReport
from colony.text.wording import counted, listed, rounded_ns

# --- memory of processes -----------------------------------------------------------------------------


WARM_UP_S = 10
"""Seconds after its start at which a process has warmed up; growth counts from there."""

STARTED = 0.75
"""Fraction of its last size at which a process counts as started."""

GROWTH = 8 << 20
"""Bytes that a process may gain after its warm-up: servers keep 2000 frames, which take 100 s to come."""

GROWTH_PER_DEATH = 24 << 10
"""Further bytes for each process killed meanwhile: connections that come and go fragment the heap."""

DRIFT = 3 << 20
"""Bytes by which late incarnations of a process may be larger than early ones."""

NEWEST = 3
"""Number of samples, a second apart, of which the largest counts at each end of a curve."""


def resident(pid: int) -> int:
    """Return the bytes of a process that are in memory; 0 if it is gone."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
    except (FileNotFoundError, ProcessLookupError):
        return 0


class Incarnations:
    """Memory of one process, sampled once a second. Mutable: one curve, in bytes, per process id."""

    def __init__(self) -> None:
        self._pid: int | None = None
        self.curves: list[list[int]] = []

    def sample(self, pid: int | None) -> None:
        """Measure the present process; `pid` is None while there is none."""
        if pid is None:
            return
        if pid != self._pid:
            self._pid = pid
            self.curves.append([])
        size = resident(pid)
        if size:
            self.curves[-1].append(size)

    @property
    def lives(self) -> list[tuple[int, int]]:
        """Length in seconds of each incarnation, and the bytes that it has gained after its warm-up."""
        return [(len(curve), _grown(curve)) for curve in self.curves]

    @property
    def drift(self) -> int:
        """Bytes by which late incarnations are larger than early ones of the same age.

        It compares the medians of the first and the last third; 0 for fewer than six incarnations.
        """
        warm = [(curve, _warm_at(curve)) for curve in self.curves]
        sizes = [max(curve[at : at + NEWEST]) for curve, at in warm if len(curve) >= at + NEWEST]
        third = len(sizes) // 3
        return int(median(sizes[-third:]) - median(sizes[:third])) if third >= 2 else 0

    @property
    def largest(self) -> int:
        """The most bytes that an incarnation had."""
        return max((max(curve, default=0) for curve in self.curves), default=0)


def _grown(curve: list[int]) -> int:
    begin = _warm_at(curve)
    if len(curve) < begin + 2 * NEWEST:
        return 0
    return max(curve[-NEWEST:]) - max(curve[begin : begin + NEWEST])


def _warm_at(curve: list[int]) -> int:
    """Return the index at which a process has warmed up; on a busy machine its start may take long."""
    started = next((i for i, size in enumerate(curve) if size >= STARTED * curve[-1]), 0)
    return started + WARM_UP_S


class Census:
    """Memory of all processes of a run, by name. Mutable: the curves."""

    def __init__(self) -> None:
        self.processes: dict[str, Incarnations] = {}

    def take(self, pids: Mapping[str, int]) -> None:
        """Measure every process that lives now."""
        for name, pid in pids.items():
            self.processes.setdefault(name, Incarnations()).sample(pid)

    @property
    def largest(self) -> int:
        """The most bytes that a process had."""
        return max((process.largest for process in self.processes.values()), default=0)

    def problems(self, deaths_per_s: float) -> Iterator[str]:
        """Yield the processes that grow, while so many are killed in a second."""
        for name, process in self.processes.items():
            for seconds, grown in process.lives:
                if grown > GROWTH + GROWTH_PER_DEATH * deaths_per_s * seconds:
                    yield f"{name} grew by {grown / 2**20:.1f} MB in a life of {seconds} s"
            if process.drift > DRIFT:
                yield f"{name} became larger by {process.drift / 2**20:.1f} MB over its restarts"


# --- the findings ------------------------------------------------------------------------------------


STOP_NS = 500_000_000
"""Nanoseconds from an emergency stop in which every actuator has to be held."""

BRAKE_NS = 1_000_000_000
"""Nanoseconds from the death of the base's server, or of the Clock, in which the base has to brake."""

BACK_NS = 20_000_000_000
"""Nanoseconds in which the robot has to recover from a fault, or from the release of a stop."""

COMPARED = 0.5
"""Part of the decisions of which the frames before were observed."""


class FailureReason(NamedTuple):
    """A reason why the robot fails; `at_s` is the second of the recording, None for the whole test."""

    at_s: float | None
    text: str

    def __str__(self) -> str:
        """Return it as a line for people."""
        return self.text if self.at_s is None else f"at {self.at_s:.2f} s: {self.text}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StopFinding:
    """An emergency stop. Times are nanoseconds of the robot.

    Attributes:
        at_ns: the time at which the button was pressed.
        acknowledged: the servers that acknowledged it.
        problems: why others did not.
        stopped_ns: the time from the button until every actuator was held; None if one never was.
        slip: the first command that was sent in spite of the stop, with its time; None if it was held.
        resumed_ns: the time from the release until the network decided again; None if it never did.
    """

    at_ns: int
    acknowledged: tuple[str, ...]
    problems: tuple[str, ...] = ()
    stopped_ns: int | None
    slip: tuple[int, str] | None = None
    resumed_ns: int | None

    def failures(self) -> Iterator[tuple[int, str]]:
        """Yield what was wrong, each with its time."""
        yield from ((self.at_ns, f"emergency stop: {problem}") for problem in self.problems)
        if self.stopped_ns is None:
            yield self.at_ns, "emergency stop: not every actuator was held"
        elif self.stopped_ns > STOP_NS:
            yield self.at_ns, f"emergency stop: held only after {_time(self.stopped_ns)}"
        if self.slip is not None:
            yield self.slip[0], f"emergency stop: not held: {self.slip[1]}"
        if self.resumed_ns is None and self.stopped_ns is not None:
            yield self.at_ns, f"no decision within {_time(BACK_NS)} of the release of an emergency stop"


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultFinding:
    """Processes that were killed or frozen. Times are nanoseconds of the robot.

    Attributes:
        kind: what was done to them.
        at_ns: the time of the fault.
        processes: their names.
        back_ns: the time from the fault, or from the end of the freeze, until the robot had recovered; None
            if it did not.
        missing: what was still missing then.
        braked_ns: the time for which the moving base did not brake; None if that was not measured.
    """

    kind: Literal["kill", "freeze"]
    at_ns: int
    processes: tuple[str, ...]
    back_ns: int | None
    missing: tuple[str, ...] = ()
    braked_ns: int | None = None

    def failures(self) -> Iterator[tuple[int, str]]:
        """Yield what was wrong, each with its time."""
        what = f"{listed(self.processes)} {'killed' if self.kind == 'kill' else 'frozen'}"
        if self.back_ns is None:
            missing = f": {', '.join(self.missing)}" if self.missing else ""
            yield self.at_ns, f"{what}: not recovered within {_time(BACK_NS)}{missing}"
        if self.braked_ns is not None and self.braked_ns > BRAKE_NS:
            yield self.at_ns, f"{what}: the base did not brake for {_time(self.braked_ns)}"


@dataclass(frozen=False, slots=True, kw_only=True)
class AcceptanceFindings:
    """The findings of a test so far. Mutable.

    Attributes:
        robot: the name of the robot.
        actuators: the number of its actuators.
        stops: the emergency stops.
        faults: the deaths and freezes.
        losses: what ended by itself, with the time, or without one if it is unknown.
        memory: that of the processes.
        disagreements: what the leader of the run found different from the program, as text.
        audit: the audit of the recording; None if there is none.
        seconds: the length of the test.
        interrupted: True if the user ended it.
        driven_mm: the length of the base's path; None if it is unknown.
    """

    robot: str
    actuators: int
    stops: list[StopFinding] = field(default_factory=list)
    faults: list[FaultFinding] = field(default_factory=list)
    losses: list[tuple[int | None, str]] = field(default_factory=list)
    memory: Census = field(default_factory=Census)
    disagreements: tuple[str, ...] = ()
    audit: AuditReport | None = None
    seconds: float = 0.0
    interrupted: bool = False
    driven_mm: float | None = None

    def failures(self) -> list[FailureReason]:
        """Return the reasons why the robot fails, those with a time in order; none if it passes."""
        steps: list[StopFinding | FaultFinding] = [*self.stops, *self.faults]
        timed = [*(failure for step in steps for failure in step.failures()), *self._audited()]
        untimed = [text for at_ns, text in self.losses if at_ns is None]
        timed += [(at_ns, text) for at_ns, text in self.losses if at_ns is not None]
        untimed += [f"the leader: {text}" for text in self.disagreements]
        untimed += self._memory_problems()
        if self.audit is None:
            untimed += [] if self.interrupted else ["there is no recording to audit"]
        elif self.audit.damaged:
            untimed.append("the recording is damaged")
        elif self.audit.compared <= COMPARED * (self.audit.compared + self._unknown):
            untimed.append(f"only {self.audit.compared:,} decisions could be compared")
        return [
            *(FailureReason(self._second(at_ns), text) for at_ns, text in sorted(timed)),
            *(FailureReason(None, text) for text in untimed),
        ]

    def _second(self, t_ns: int) -> float | None:
        """Return a time of the robot as a second of the recording; None if there is none."""
        return None if self.audit is None else rounded_ns(t_ns - self.audit.first_ns) / 1e9

    def _audited(self) -> Iterator[tuple[int, str]]:
        if self.audit is None:
            return
        if (first := self.audit.first) is not None:
            yield first.t_ns, f"the interpreter decides differently: {first.message}"
        for contract in (c for c in self.audit.contracts if not c.assumed):
            text = f"contract {contract.contract} broken in {counted(contract.frames, 'frame')}"
            yield contract.first_ns, text

    @property
    def _unknown(self) -> int:
        """The number of decisions that were not compared because a frame before them was not observed."""
        audit = self.audit
        return 0 if audit is None else self.actuators * (audit.unknown + audit.forgotten) + audit.undecided

    def _memory_problems(self) -> list[str]:
        deaths = sum(len(fault.processes) for fault in self.faults if fault.kind == "kill")
        return list(self.memory.problems(deaths / max(self.seconds, 1.0)))

    # --- as text and data ----------------------------------------------------------------------------

    def lines(self) -> Iterator[str]:
        """Yield the table for people, without the verdict."""
        yield f"stops        {self._stops_text()}"
        for kind, label in (("kill", "kills"), ("freeze", "freezes")):
            yield f"{label:<12} {self._faults_text([fault for fault in self.faults if fault.kind == kind])}"
        if self.audit is not None:
            yield f"decisions    {self._decisions_text(self.audit)}"
        if self.driven_mm is not None:
            yield f"distance     {self.driven_mm / 1000:.1f} m"
        growing = "growing" if self._memory_problems() else "not growing"
        yield f"memory       at most {self.memory.largest / 2**20:.0f} MB a process, {growing}"

    def _stops_text(self) -> str:
        good = [stop for stop in self.stops if not any(True for _ in stop.failures())]
        times = [stop.stopped_ns for stop in self.stops if stop.stopped_ns is not None]
        most = f", at most {_time(max(times))}" if times else ""
        return f"{len(good)} of {len(self.stops)} acknowledged and held{most}"

    def _faults_text(self, faults: Sequence[FaultFinding]) -> str:
        back = [(fault.back_ns, fault.processes) for fault in faults if fault.back_ns is not None]
        text = f"{len(back)} of {len(faults)} came back"
        if back:
            longest_ns, processes = max(back)
            text += f", at most {_time(longest_ns)} ({', '.join(processes)})"
        braked = [fault.braked_ns for fault in faults if fault.braked_ns is not None]
        return f"{text}; the base braked within {_time(max(braked))}" if braked else text

    def _decisions_text(self, audit: AuditReport) -> str:
        total = self.actuators * audit.frames
        counts = {
            "while stopped": total - audit.compared - audit.unheard - self._unknown,
            "without a verdict": audit.unheard,
            "after a frame that was not observed": self._unknown,
        }
        why = ", ".join(f"{count:,} {reason}" for reason, count in counts.items() if count > 0)
        agree = "as the interpreter decides" if audit.agrees else "compared: DIFFERENT"
        idle = f", {audit.idled:,} of them idle for want of a client" if audit.idled else ""
        return f"{audit.compared:,} of {total:,} {agree}{idle}{'; not compared: ' if why else ''}{why}"

    def as_json(self) -> dict[str, object]:
        """Return all of it as plain dicts and lists; times are nanoseconds of the robot."""
        failures: list[Any] = [failure._asdict() for failure in self.failures()]
        memory = {name: process.largest for name, process in self.memory.processes.items()}
        audit = None if self.audit is None else self.audit.as_json()
        return {"passes": not failures, "failures": failures} | asdict(
            replace(self, memory=memory, audit=audit)  # type: ignore[arg-type]
        )


def _time(ns: int) -> str:
    return f"{ns / 1e9:.1f} s" if ns >= 1_000_000_000 else f"{ns / 1e6:.0f} ms"
