"""What went over the network of a run, and what frames were by it: the oracle that all policies share.

Where a server died while a frame of its was on its way, some saw what others did not, and what the Clock then
declared void. They find out and ask for a new epoch; until then either frame counts as the true one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from random import Random
from typing import Protocol

from colony.ir.frame import MISSED, Decision, Frame, Reading
from colony.ir.program import Program
from colony.ir.servers import DSERVER
from colony.runtime.assembly.scripted import FrameCollector, SentCommand
from colony.runtime.assembly.virtual import VirtualRobot
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.bindings import Bindings
from colony.runtime.protocol.messages import Checkpoint, Message, Restart, ServerFrame, Tick, Verdict
from colony.runtime.transport.faults import FaultRates, LinkFaults

MS = 1_000_000


@dataclass(frozen=True, slots=True)
class Seen:
    """All that went over the network of a run, as far as it matters."""

    ticks: dict[int, Tick] = field(default_factory=dict)
    frames: dict[tuple[str, int], ServerFrame] = field(default_factory=dict)
    void: set[tuple[str, int]] = field(default_factory=set)
    checkpoints: dict[tuple[str, int], bytes] = field(default_factory=dict)
    verdicts: dict[tuple[int, str], Verdict] = field(default_factory=dict)
    sent: list[SentCommand] = field(default_factory=list)
    recalled: set[str] = field(default_factory=set)
    restarts: set[tuple[str, int]] = field(default_factory=set)

    def note(self, sender: str, message: Message) -> None:
        """Take a message in.

        Raises:
            AssertionError: a server published two different frames of one number.
        """
        match message:
            case Tick():
                self.ticks.setdefault(message.k, message)
                self.void.update(message.void)
            case ServerFrame():
                known = self.frames.setdefault((message.server, message.k), message)
                assert known is message or _values(known) == _values(message), (known, message)
            case Checkpoint() if sender != DSERVER.name:
                self.checkpoints[message.client, message.k] = message.memory
            case Checkpoint() if message.k >= 0:
                self.recalled.add(message.client)
            case Restart():
                self.restarts.add((message.client, message.start))
            case Verdict():
                self.verdicts.setdefault((message.k, message.actuator), message)
            case _:
                pass


def _values(frame: ServerFrame) -> str:
    return repr({name: None if s is None else s.value for name, s in frame.fields.items()})


class Run(Protocol):
    """A run that is over: its program, the servers that it reads, and what was seen of it."""

    program: Program
    bindings: Bindings
    servers: tuple[str, ...]
    seen: Seen
    log: FrameCollector


# --- faults ----------------------------------------------------------------------------------------


def plan(
    robot: VirtualRobot,
    random: Random,
    until_ns: int,
    *,
    often: str | None = None,
    counts: tuple[int, ...] = (0, 1, 1, 2, 3, 5),
    kill: Callable[[str], object] | None = None,
) -> None:
    """Kill, freeze and revive processes, one of them `often`; at `until_ns` all live."""
    for _ in range(random.choice(counts)):
        process = often if often and random.random() < 0.6 else random.choice(robot.processes)
        at = random.randrange(until_ns)
        back = min(until_ns, at + random.choice((0, 30, 200, 600, 1500, 4000)) * MS)
        do = (kill or robot.kill) if random.random() < 0.6 else robot.freeze
        robot.transport.at(at, partial(do, process))
        robot.transport.at(back, partial(robot.revive, process))
    for process in robot.processes:
        robot.transport.at(until_ns, partial(robot.revive, process))


def link(seed: int, random: Random, is_quiet: Callable[[], bool]) -> LinkFaults:
    """Return faults of the network until all is quiet, and none on the way to the observer."""
    share = random.choice((0.0, 0.3, 1.0, 2.0))
    rates = FaultRates(lost=0.02 * share, duplicated=0.02 * share, late=0.03 * share, reordered=0.1 * share)

    def spared(sender: str, receiver: str, message: Message) -> bool:
        return receiver == "Observer" or is_quiet()

    return LinkFaults(seed, rates, exempt=spared)


# --- what frames were ------------------------------------------------------------------------------


def epochs(ticks: Mapping[int, Tick]) -> Iterable[list[Tick]]:
    """The ticks of the run, epoch by epoch; they follow each other, and time rises.

    A restarted Clock goes on behind a gap; ticks in it were abandoned.
    """
    by_start: dict[int, list[Tick]] = {}
    for k in sorted(ticks):
        if ticks[k].run:
            by_start.setdefault(ticks[k].start, []).append(ticks[k])
    for start, ticked in by_start.items():
        gaps = {gap for t in ticked for gap in t.gaps}
        found = [t for t in ticked if not any(last < t.k < first for last, first in gaps)]
        assert found[0].k == start, f"epoch {start} begins with frame {found[0].k}"
        assert all(a.k == b.previous for a, b in pairwise(found)), f"epoch {start} has gaps"
        assert all(a.t_ns < b.t_ns for a, b in pairwise(found)), f"time stands in {start}"
        yield found


def possible_frames(run: Run, epoch: list[Tick]) -> list[dict[int, Frame]]:
    """Return the frames of an epoch: void ones as "no value", and also as published if one of them was."""
    seen = run.seen
    disputed = any((s, t.k) in seen.void and (s, t.k) in seen.frames for t in epoch for s in run.servers)
    return [{t.k: _frame(run, t, void_counts=not i) for t in epoch} for i in range(1 + disputed)]


def _frame(run: Run, tick: Tick, *, void_counts: bool) -> Frame:
    readings: dict[str, Reading] = {s.name: None for s in run.program.robot.sensors if s.sent}
    for binding in run.bindings.sensors:
        at = (binding.server, tick.k)
        if binding.server in tick.down or (void_counts and at in run.seen.void) or at not in run.seen.frames:
            continue
        sample = run.seen.frames[at].fields.get(binding.field)
        if sample is not None and binding.is_fresh(sample.t_ns, tick.t_ns):
            readings[binding.sensor] = binding.in_declared_units(sample.value)
    return Frame(tick.t_ns, readings, restarted=tick.restarted)


# --- what must hold in every run -------------------------------------------------------------------


def observed(run: Run) -> Iterator[RunFrame]:
    """Yield the frames as they were observed; the monitor has found nothing wrong in them."""
    for log in run.log.frames:
        assert not log.disagreements, f"frame {log.tick.k}: the monitor says {log.disagreements}"
        yield log


def check_recovered(run: Run, k: int, due: Mapping[str, Decision]) -> None:
    """After the faults everyone is on time, and the commands are those that are due."""
    for actuator, decision in due.items():
        verdict = run.seen.verdicts.get((k, actuator))
        assert verdict is not None, f"frame {k}: no verdict for {actuator} although all is quiet"
        bad = [fate for fate in verdict.fates if fate[1] in MISSED or fate[1] == "overruled"]
        assert not bad, f"frame {k}: {bad} although all is quiet: {verdict}"
        found = repr((verdict.by, verdict.values, verdict.fault))
        wanted = repr((decision.by, decision.values, decision.fault))
        assert found == wanted, f"frame {k}: {found} although all is quiet, due was {wanted}: {verdict}"
