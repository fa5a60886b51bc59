"""A run of twenty clients in which every process but the leader is frozen and killed again and again: the one
that they share or, with `--isolate`, that of each.

No process may grow, and every decision has to be the interpreter's.

    python -m tools.soak --seconds 60 --seed 1

From the seed, clients and servers are stopped for a moment, sometimes for longer than the liveness lease, and
killed, so that the leader starts them again (`chaos.py`). In the end the run has to be well again, and the
interpreter audits the recording. The figures tell, for each process, its faults and its memory over time.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from colony.runtime.protocol.messages import Verdict
from tests.cli.machine import Machine
from tests.runtime.assembly.processes.fault_stage import UNHEARD, Run
from tests.waiting import until
from tools.chaos import Chaos, schedule
from tools.process_sizes import Census, Incarnations

CLIENTS = 20
SERVERS = ("Clock", "RServer", "PServer", "DServer", "Simulator")
NAMES = ("cruise", *(f"m{i}" for i in range(1, CLIENTS)))
LEADER = "Leader"
CLIENT_FREEZES_PER_S, SERVER_FREEZES_PER_S = 0.4, 0.1
"""Freezes per second of each process."""

UNHEARD_PER_FRAME = 0.5
"""Clients that have to be late or lost in a frame, on average: fewer would not be much of a test."""

DECIDING = ("Clock", "RServer")
"""Servers without which there are no verdicts."""

OUTAGE_S = 3.0
"""Seconds without verdicts that each of their deaths may cost."""

GAP_S = 0.5
"""Seconds without verdicts that count as an outage."""

GROWTH = 8 << 20
"""Bytes that a process may gain after its warm-up: servers keep 2000 frames, which take 100 s to come."""

KILLED = 24 << 10
"""Further bytes for each process killed meanwhile: connections that come and go fragment the heap."""

PATIENCE_S = 60.0
"""Seconds in which a run has to recover, on a machine that runs many other tests."""

COMPARED = 0.8
"""Fraction of the verdicts that the audit has to compare: after a frame that the leader could not observe,
there is nothing to compare."""

AUDITED = ("frames", "compared", "late", "lost", "idled", "unheard", "unknown", "restarts")
"""Counts of the audit to print."""

DRIFT = 3 << 20
"""Bytes by which late incarnations of a process may be larger than early ones."""

_STRANGE = re.compile(
    r"^\S+(?: \(with .*\))? (?:(?:ended with|was killed by (?!SIGKILL)).*|.*given up)$", re.MULTILINE
)
"""A death, as the leader reports it, that the stage did not cause, or one too many."""


def program() -> str:
    """A behavior of twenty modules with memory, wired through suppressors and, here and there, inhibitors.

    Chance, which is the same for all of them in a frame, activates this one or that.
    """
    lines = [
        "robot rome {",
        "  frame 50 ms",
        "  sensor sonar[24] : mm range 0 .. 10000 from PServer.sonar within 500 ms",
        "  sensor bumper : bool from RServer.bumper",
        "  sensor goal : deg range 0 deg .. 360 deg from DServer.Goal within 500 ms",
        "  sensor chance : number range 0 .. 1 from Runtime.random",
        "  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }",
        "           to RServer.drive idle drive(velocity = 0, turn = 0)",
        "}",
        "module cruise { when min(sonar[10 .. 14]) > 0 mm  do drive(velocity = 50 mm/s, turn = 10 deg/s) }",
    ]
    wire = "cruise"
    for i in range(1, CLIENTS):
        drawn = f"chance > {0.05 * i:.2f} and chance < {0.05 * i + 0.03:.2f}"
        turn = f"if chance > 0.5 then {i} deg/s else -{i} deg/s"
        if i % 5 == 0:
            drawn += " and goal < 180 deg"
        lines.append(
            f"module m{i} {{ when recently({drawn}, {50 * (i % 7 + 1)} ms) or (bumper and chance > 0.9)"
        )
        lines.append(f"  do drive(velocity = if bumper then -60 mm/s else {20 + i} mm/s, turn = {turn}) }}")
        if i % 6 == 0:
            lines.append(f"module quiet{i} {{ when recently(chance > 0.97, {20 * i} ms) }}")
            wire = f"(quiet{i} inhibits {wire})"
        wire = f"(m{i} suppresses {wire})"
    return "\n".join([*lines, f"network {{ drive = {wire} }}", ""])


@dataclass(frozen=False, slots=True, kw_only=True)
class Figures:
    """Measurements of a soak. `stage` is the memory of the process of the soak itself."""

    seconds: float
    seen: Seen = field(default_factory=lambda: Seen())
    kills: Counter[str] = field(default_factory=Counter)
    freezes: Counter[str] = field(default_factory=Counter)
    strange: tuple[str, ...] = ()
    disagreements: int = 0
    well_again_s: float = 0.0
    audit: dict[str, Any] = field(default_factory=dict)
    census: Census = field(default_factory=Census)
    stage: Incarnations = field(default_factory=Incarnations)

    def problems(self) -> list[str]:
        """Return the failures of the soak, a line each."""
        found = [f"died by itself: {line}" for line in self.strange]
        kills_per_s = self.kills.total() / self.seconds
        for name, process in self.census.processes.items():
            found += [
                f"{name} grew by {grown >> 10} KiB in a life of {seconds} s"
                for seconds, grown in process.lives
                if grown > GROWTH + KILLED * kills_per_s * seconds
            ]
            if process.drift > DRIFT:
                found.append(f"later incarnations of {name} are larger by {process.drift >> 10} KiB")
        if self.seen.frames < self.expected_frames:
            found.append(f"{self.seen.frames} frames; expected {self.expected_frames:.0f}")
        if self.seen.unheard < UNHEARD_PER_FRAME * self.seen.frames:
            found.append(f"only {self.seen.unheard} client-frames were late or lost")
        if self.seen.violations:
            found.append(f"{self.seen.violations} verdicts with two active clients")
        if self.disagreements:
            found.append(f"{self.disagreements} disagreements")
        if not self.audit["agrees"]:
            found.append(f"the audit differs: {self.audit['first']}")
        if self.audit["compared"] < COMPARED * self.seen.frames:
            found.append(f"only {self.audit['compared']} decisions could be audited")
        return found

    @property
    def expected_frames(self) -> float:
        """Fewest frames: half of those that there is time for, outages not counted."""
        outages_s = OUTAGE_S * sum(self.kills[name] for name in DECIDING)
        return 10 * max(0.0, self.seconds - outages_s)

    def __str__(self) -> str:
        seen = self.seen
        lines = [
            f"{self.seconds:.0f} s, {seen.frames} frames, {seen.commanded} of them commanded",
            f"{seen.gaps} outages of {seen.outage_s:.1f} s in all, the longest {seen.longest_s:.1f} s",
            f"{self.freezes.total()} freezes, {self.kills.total()} kills",
            f"{seen.unheard} client-frames late or lost ({seen.unheard / max(1, seen.frames):.1f} a frame)",
            f"well again {self.well_again_s:.1f} s after the last fault",
            ", ".join(f"{n} {self.audit[n]}" for n in AUDITED),
            "process      kills freezes  growth   drift  (KiB); the longest life in MiB",
        ]
        processes = self.census.processes
        lines += [self._line(name, processes[name]) for name in sorted(processes, key=_in_order)]
        return "\n".join([*lines, self._line("(stage)", self.stage)])

    def _line(self, name: str, process: Incarnations) -> str:
        counts = f"{self.kills[name]:5} {self.freezes[name]:7}"
        return f"{name:12} {counts} {process.growth >> 10:7} {process.drift >> 10:7}  {process}"


def _in_order(name: str) -> tuple[bool, int, str]:
    """Sort the leader first, then servers, then clients."""
    return name.startswith("drive."), len(name) if name.startswith("drive.") else 0, name


@dataclass(frozen=False, slots=True, kw_only=True)
class Seen:
    """Counts of the verdicts that came. `gaps` are times of more than `GAP_S` without any."""

    frames: int = 0
    commanded: int = 0
    unheard: int = 0
    violations: int = 0
    gaps: int = 0
    outage_s: float = 0.0
    longest_s: float = 0.0
    last_ns: int | None = None

    def take(self, verdict: Verdict) -> None:
        """Count one more."""
        self.frames += 1
        self.commanded += verdict.by is not None
        self.unheard += sum(fate in UNHEARD for _, fate in verdict.fates)
        self.violations += verdict.violation
        gap_s = 0.0 if self.last_ns is None else (verdict.t_ns - self.last_ns) / 1e9
        self.last_ns = verdict.t_ns
        if gap_s > GAP_S:
            self.gaps += 1
            self.outage_s += gap_s
            self.longest_s = max(self.longest_s, gap_s)


def soak(folder: Path, *, seconds: float, seed: int, isolate: bool) -> Figures:
    """Soak a robot for so long; if `isolate`, each of its clients is a process of its own.

    Raises:
        AssertionError: the run does not begin, does not go on to the end, or is not well in the end.
    """
    machine, figures = Machine(folder), Figures(seconds=seconds)
    try:
        path = folder / "soak.colony"
        path.write_text(program())
        options = ("--record", "run.mcap", "--format", "json", "--set", "Goal=90")
        run = Run(
            machine,
            *options,
            seed=seed,
            isolate=isolate,
            program=str(path),
            keep=100,
            on_verdict=figures.seen.take,
        )
        try:
            _soak(run, figures, seed)
            assert run.started.interrupt() == 130, run.started.err
        finally:
            run.close()
        figures.strange = tuple(_STRANGE.findall(run.started.err))
        figures.disagreements = len(json.loads(run.started.out)["disagreements"])
        recording = str(run.started.folder / "run.mcap")
        audit = machine.run("audit", recording, "--format", "json", patience_s=max(60.0, seconds))
        assert audit.process.returncode in (0, 1), audit.err
        figures.audit = json.loads(audit.out)
    finally:
        machine.close()
    return figures


def _soak(run: Run, figures: Figures, seed: int) -> None:
    since = run.now()
    until(lambda: run.ended() or run.well(since), "all clients are there", patience_s=PATIENCE_S)
    assert not run.ended(), run.started.err
    clients = {run.process_of(name): CLIENT_FREEZES_PER_S for name in NAMES}
    servers = dict.fromkeys(SERVERS, SERVER_FREEZES_PER_S)
    if len(clients) == 1:  # their one process dies as early as a server, so that a short run sees it
        servers, clients = servers | clients, {}
    chaos = Chaos(schedule(seed, servers, clients, figures.seconds), run.pid)
    try:
        _strike(run, figures, chaos)
    finally:
        chaos.end()
    figures.kills, figures.freezes = chaos.kills, chaos.freezes
    ended = run.now()
    until(lambda: run.ended() or run.well(ended), "all clients are there again", patience_s=PATIENCE_S)
    until(lambda: run.ended() or run.machine.moves(), "the robot is driven again", patience_s=PATIENCE_S)
    figures.well_again_s = (run.now() - ended) / 1e9
    assert not run.ended(), run.started.err


def _strike(run: Run, figures: Figures, chaos: Chaos) -> None:
    """Execute the schedule, and measure every process once a second."""
    began, measured = time.monotonic(), 0.0
    while (now := time.monotonic() - began) < figures.seconds:
        assert not run.ended(), run.started.err
        chaos.turn(now)
        if now >= measured:
            measured += 1.0
            figures.census.take(run.pids() | {LEADER: run.started.pid})
            figures.stage.sample(os.getpid())
        time.sleep(0.005)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--isolate", action="store_true", help="one process for each client")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        figures = soak(Path(folder), seconds=options.seconds, seed=options.seed, isolate=options.isolate)
    print(f"seed {options.seed}: {figures}")
    for problem in figures.problems():
        print(problem, file=sys.stderr)
    return 1 if figures.problems() else 0


if __name__ == "__main__":
    sys.exit(main())
