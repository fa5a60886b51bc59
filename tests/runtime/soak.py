"""A run of twenty clients, each a process, of which some are late or dead all the time: do the servers keep
their memory, and is every decision the interpreter's all the same?

    python -m tests.runtime.soak --seconds 60 --seed 1

From the seed clients are frozen for a moment, so that their requests are delayed or late, and killed, so that
they are started again and recall their memory. In the end the recording is audited by the interpreter. It
prints how many client-frames were late or lost, and the memory of each server over time.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from dataclasses import dataclass, field
from heapq import heappop, heappush
from pathlib import Path
from random import Random

from tests.cli.machine import Machine, until
from tests.runtime.fault_stage import UNHEARD, Run

CLIENTS = 20
SERVERS = ("Clock", "RServer", "PServer", "DServer", "Simulator")
FREEZES_EACH_S, KILLS_EACH_S = 8.0, 0.4
UNHEARD_EACH_S = 10
"""Client-frames that are to be late or lost, on average."""

SPARED_S = 6.0
"""For how long nobody is killed again: its supervisor would give it up."""

WARM_UP_S = 10.0
GROWTH = 6 << 20
"""Bytes by which a server may be larger in the end than after it has warmed up: it keeps 2000 frames, which
take a hundred seconds to come together."""

KILLED = 24 << 10
"""And for each client that was killed: the network keeps some 10 KB of a process that came and went."""


def program() -> str:
    """A behavior of twenty modules with memory, wired through suppressors and, here and there, inhibitors.

    Chance, which is the same for all of them in a frame, activates this one or that.
    """
    lines = [
        "robot rome {",
        "  frame 50 ms",
        "  sensor sonar[24] : mm range 0 .. 10000 from PServer.sonar within 500 ms",
        "  sensor bumper : bool from RServer.bumper",
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
        lines.append(f"module m{i} {{ when held({drawn}, {50 * (i % 7 + 1)} ms) or (bumper and chance > 0.9)")
        lines.append(f"  do drive(velocity = {20 + i} mm/s, turn = {turn}) }}")
        if i % 6 == 0:
            lines.append(f"module quiet{i} {{ when held(chance > 0.97, {20 * i} ms) }}")
            wire = f"(quiet{i} inhibits {wire})"
        wire = f"(m{i} suppresses {wire})"
    return "\n".join([*lines, f"network {{ drive = {wire} }}", ""])


@dataclass(frozen=False, slots=True, kw_only=True)
class Figures:
    """What was measured. `sizes` are bytes in memory of each process, about once a second."""

    seconds: float
    frames: int = 0
    unheard: int = 0
    commanded: int = 0
    kills: int = 0
    freezes: int = 0
    died: tuple[str, ...] = ()
    disagreements: int = 0
    audit: str = ""
    sizes: dict[str, list[int]] = field(default_factory=dict)

    def grown(self, name: str) -> int:
        """By how many bytes a process is larger in the end than after it has warmed up."""
        sizes = self.sizes[name]
        begin = min(int(WARM_UP_S), len(sizes) // 2)
        return max(sizes[-3:]) - max(sizes[begin : begin + 3])

    def problems(self) -> list[str]:
        """What should not be."""
        found = [f"{name} died" for name in self.died]
        most = GROWTH + self.kills * KILLED
        found += [f"{n} grew by {self.grown(n) >> 10} KiB" for n in self.sizes if self.grown(n) > most]
        if self.frames < 10 * self.seconds:  # some are left out where the machine is busy
            found.append(f"{self.frames} frames in {self.seconds:.0f} s; expected 20 a second")
        if self.unheard < UNHEARD_EACH_S * self.seconds:
            found.append(f"only {self.unheard} client-frames were late or lost")
        if self.disagreements:
            found.append(f"{self.disagreements} disagreements")
        return found + ([self.audit] if self.audit else [])

    def __str__(self) -> str:
        each = self.unheard / self.seconds
        lines = [
            f"{self.seconds:.0f} s, {self.frames} frames, {self.commanded} of them commanded",
            f"{self.freezes} freezes, {self.kills} kills",
            f"{self.unheard} client-frames late or lost ({each:.0f}/s)",
        ]
        for name, sizes in self.sizes.items():
            curve = " ".join(f"{size / 2**20:.1f}" for size in sizes[:: max(1, len(sizes) // 12)])
            lines.append(f"{name:>10}: {curve} MiB, {self.grown(name) >> 10:+} KiB after the warm-up")
        return "\n".join(lines)


class Trouble:
    """Freezes and kills clients. Mutable: who is frozen, and who was killed when."""

    def __init__(self, run: Run, random: Random, figures: Figures) -> None:
        self._run, self._random, self._figures = run, random, figures
        self._names = ["cruise", *(f"m{i}" for i in range(1, CLIENTS))]
        self._thaw: list[tuple[float, int]] = []
        self._killed: dict[str, float] = {}
        self._next = {"freeze": 0.0, "kill": 0.0}

    def turn(self, now: float) -> None:
        """Do what is due."""
        while self._thaw and self._thaw[0][0] <= now:
            _send(heappop(self._thaw)[1], signal.SIGCONT)
        for what, each_s in (("freeze", FREEZES_EACH_S), ("kill", KILLS_EACH_S)):
            if now >= self._next[what]:
                self._next[what] = now + self._random.expovariate(each_s)
                self._freeze(now) if what == "freeze" else self._kill(now)

    def end(self) -> None:
        """Let everybody go on."""
        for _, pid in self._thaw:
            _send(pid, signal.SIGCONT)

    def _freeze(self, now: float) -> None:
        pid = self._run.pid(f"drive.{self._random.choice(self._names)}")
        for_s = self._random.choice((0.01, 0.03, 0.08, 0.15, 0.3))
        if pid is not None and _send(pid, signal.SIGSTOP):
            self._figures.freezes += 1
            heappush(self._thaw, (now + for_s, pid))

    def _kill(self, now: float) -> None:
        name = self._random.choice(self._names)
        pid = self._run.pid(f"drive.{name}")
        if pid is not None and now - self._killed.get(name, -SPARED_S) >= SPARED_S:
            self._killed[name] = now
            self._figures.kills += _send(pid, signal.SIGKILL)


def _send(pid: int, number: signal.Signals) -> bool:
    try:
        os.kill(pid, number)
    except ProcessLookupError:  # it was killed while it was frozen
        return False
    return True


def soak(folder: Path, *, seconds: float, seed: int) -> Figures:
    """Soak a robot for so long.

    Raises:
        AssertionError: the run does not begin, or does not go on to the end.
    """
    machine, figures = Machine(folder), Figures(seconds=seconds)
    try:
        path = folder / "soak.colony"
        path.write_text(program())
        options = ("--record", "run.mcap", "--format", "json")
        run = Run(machine, *options, seed=seed, program=str(path))
        try:
            _soak(run, figures, seed)
            run.started.tell(signal.SIGINT)
            assert run.started.wait() == 130, run.started.err
        finally:
            run.close()
        figures.disagreements = len(json.loads(run.started.out)["disagreements"])
        audit = machine.run("audit", str(run.started.folder / "run.mcap"))
        figures.audit = "" if audit.process.returncode == 0 else audit.out + audit.err
    finally:
        machine.close()
    return figures


def _soak(run: Run, figures: Figures, seed: int) -> None:
    since = run.now()
    until(lambda: run.ended() or run.well(since), "all clients are there")
    assert not run.ended(), run.started.err
    pids = {name: run.pid(name) for name in SERVERS} | {"Leader": run.started.pid}
    figures.sizes = {name: [] for name in pids}
    trouble, began, begun_ns = Trouble(run, Random(seed), figures), time.monotonic(), run.now()
    measured = 0.0
    while (now := time.monotonic() - began) < figures.seconds:
        trouble.turn(now)
        if now >= measured:
            measured += 1.0
            for name, pid in pids.items():
                figures.sizes[name].append(_resident(pid) if pid is not None else 0)
        time.sleep(0.005)
    trouble.end()
    verdicts = run.since(begun_ns)
    figures.frames = len(verdicts)
    figures.commanded = sum(v.by is not None for v in verdicts)
    figures.unheard = sum(fate in UNHEARD for v in verdicts for _, fate in v.fates)
    figures.died = tuple(name for name in SERVERS if run.pid(name) != pids[name])
    ended = run.now()
    until(lambda: run.ended() or run.well(ended), "all clients are there in the end")


def _resident(pid: int) -> int:
    """Bytes of a process in memory; 0 where it is gone."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
    except (FileNotFoundError, ProcessLookupError):
        return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        figures = soak(Path(folder), seconds=options.seconds, seed=options.seed)
    print(f"seed {options.seed}: {figures}")
    for problem in figures.problems():
        print(problem, file=sys.stderr)
    return 1 if figures.problems() else 0


if __name__ == "__main__":
    sys.exit(main())
