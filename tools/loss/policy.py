"""The policy for losses, over random programs and random faults: whatever dies, freezes, comes back or gets
lost on its way, no command is sent that the reference interpreter would not have sent in that frame.

Each seed is a program, a trace, and a plan of faults, in virtual time; clients share a process in every other
one. What the frames were is taken from the
network afterwards: what servers published, and what the Clock said of them. Then

- every command that left arbitration is the interpreter's for that frame, or the idle one;
- every checkpoint, and the memory of every client at the end, is that of one which saw all frames of the
  epoch, in order, each once;
- in an epoch frames follow each other, and the interpreter begins anew with it and only there;
- no frame has two commands, no server publishes two different frames of one number;
- the monitor finds nothing wrong either;
- and when the faults are over, everyone is on time again.

Where a server died while a frame of its was on its way, some saw what others did not, and what the Clock then
declared void. They find out and ask for a new epoch; until then either frame counts as the true one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from itertools import pairwise
from random import Random
from typing import Literal, NamedTuple

from colony.execute.executor import ClientMemory
from colony.ir.frame import Answer, Decision, Frame, Reading
from colony.ir.program import Program
from colony.robots.scripted import SCRIPTED_SERVERS, SentCommand
from colony.runtime.clients.memory import decode_memory
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Message, Tick
from colony.runtime.protocol.topics import module_of
from colony.runtime.transport.faults import FaultRates, Faults
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import frame_in_base_units
from tests.drawn.strategies import run_of_seed
from tests.programs import OneClient
from tools.loss.stage import Robot, Seen

MS = 1_000_000
FAULTY, QUIET = 22, 20
"""Frames with faults, and frames after them in which all must come right again."""

PLANS = 5
"""Plans of faults that each program is run with."""


class Drawn(NamedTuple):
    """A program to be run, with frames."""

    program: Program
    trace: tuple[Frame, ...]


@lru_cache(maxsize=4)
def drawn(number: int, degrade: bool) -> Drawn:
    """Program `number`; every other one is all network."""
    program, trace = run_of_seed(number, network=degrade or number % 2 == 0, max_frames=16)
    on_loss: Literal["degrade", "stop"] = "degrade" if degrade else "stop"
    actuators = tuple(replace(a, on_loss=on_loss) for a in program.robot.actuators)
    program = replace(program, robot=replace(program.robot, actuators=actuators))
    return Drawn(program, trace)


def plan(robot: Robot, random: Random, until_ns: int, often: str | None) -> None:
    """Kill, freeze and revive processes, one of them `often`; at `until_ns` all live."""
    for _ in range(random.choice((0, 1, 1, 2, 3, 5))):
        process = often if often and random.random() < 0.6 else random.choice(robot.processes)
        at = random.randrange(until_ns)
        back = min(until_ns, at + random.choice((0, 30, 200, 600, 1500, 4000)) * MS)
        do = robot.kill if random.random() < 0.6 else robot.freeze
        robot.transport.at(at, partial(do, process))
        robot.transport.at(back, partial(robot.revive, process))
    for process in robot.processes:
        robot.transport.at(until_ns, partial(robot.revive, process))


def link(seed: int, random: Random, until_ns: int, robot: list[Robot]) -> Faults:
    """Faults of the network until then, and none on the way to the observer."""
    share = random.choice((0.0, 0.3, 1.0, 2.0))
    rates = FaultRates(lost=0.02 * share, duplicated=0.02 * share, late=0.03 * share, reordered=0.1 * share)

    def spared(sender: str, receiver: str, message: Message) -> bool:
        return receiver == "Observer" or not robot or robot[0].now_ns >= until_ns

    return Faults(seed, rates, exempt=spared)


def run(seed: int, *, degrade: bool = False, often: str | None = None) -> Counter[str]:
    """One seed; gives what happened in it. The process `often` fails more often than others.

    Raises:
        AssertionError: the policy does not hold; the message begins with the seed.
    """
    random = Random(seed)
    what = drawn(seed // PLANS, degrade)
    frame_ns = random.choice((250, 250, 250, 250, 250, 100)) * MS
    until_ns = FAULTY * frame_ns
    made: list[Robot] = []
    faults = link(seed, random, until_ns, made)
    isolate = seed % 2 == 1
    robot = Robot(what.program, what.trace, frame_ns=frame_ns, seed=seed, link=faults, isolate=isolate)
    made.append(robot)
    plan(robot, random, until_ns, often)
    try:
        robot.run(FAULTY + max(QUIET, 4_500 * MS // frame_ns))
        return check(robot)
    except AssertionError as problem:
        raise AssertionError(f"seed {seed}{', degrade' if degrade else ''}: {problem}") from problem


# --- what should have been -------------------------------------------------------------------------


ANYTHING = (0.0,) * 8
"""The fields of a command that nobody looks at: memory depends on who is active alone."""


class Path(NamedTuple):
    """The frames of an epoch, what the interpreter decides in them, and what modules in Python answer."""

    frames: dict[int, Frame]
    decisions: dict[int, dict[str, Decision]]
    answers: dict[int, dict[str, Answer]]


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


def disputed(seen: Seen, epoch: list[Tick]) -> bool:
    """Whether a frame is void that was published."""
    return any((s, t.k) in seen.void and (s, t.k) in seen.frames for t in epoch for s in SCRIPTED_SERVERS)


def frame_of(robot: Robot, tick: Tick, *, void_counts: bool) -> Frame:
    """The frame as published; or as it is where void frames are "no value"."""
    seen = robot.seen
    readings: dict[str, Reading] = {s.name: None for s in robot.program.robot.sensors if s.sent}
    for server in SCRIPTED_SERVERS:
        at = (server, tick.k)
        if server in tick.down or at not in seen.frames or (void_counts and at in seen.void):
            continue
        readings |= {n: s.value for n, s in seen.frames[at].fields.items() if s is not None}
    return Frame(tick.t_ns, readings, restarted=tick.restarted)


def path_of(robot: Robot, epoch: list[Tick], *, void_counts: bool) -> Path:
    """What the reference does in an epoch."""
    interpreter, path = Interpreter(robot.program), Path({}, {}, {})
    degrading = any(a.on_loss == "degrade" for a in robot.program.robot.actuators)
    for tick in epoch:
        frame = path.frames[tick.k] = frame_of(robot, tick, void_counts=void_counts)
        lost = frozenset(map(module_of, tick.lost)) if degrading else frozenset[str]()
        outcome = interpreter.step(frame, lost)
        path.decisions[tick.k] = {d.actuator: d for d in outcome.decisions}
        path.answers[tick.k] = {
            m: Answer(ANYTHING if interpreter.is_active(m) else None) for m in robot.compiled.python_modules
        }
    return path


# --- the checks ------------------------------------------------------------------------------------


def check(robot: Robot) -> Counter[str]:
    """Hold a run against the reference; gives what happened in it."""
    seen, counts = robot.seen, Counter[str]()
    sent: dict[int, list[SentCommand]] = {}
    for one in seen.sent:
        sent.setdefault(one.k, []).append(one)
    last: Path | None = None
    for epoch in epochs(seen.ticks):
        paths = [path_of(robot, epoch, void_counts=True)]
        if disputed(seen, epoch):
            paths.append(path_of(robot, epoch, void_counts=False))
            counts["epochs with disputed frames"] += 1
        for tick in epoch:
            for one in sent.get(tick.k, ()):
                check_sent(robot, one, [p.decisions[tick.k][one.actuator] for p in paths])
                counts["commands" if one.by else "idle"] += 1
        check_memory(robot, epoch, paths, counts)
        counts["frames"] += len(epoch)
        counts["epochs"] += 1
        counts["gaps"] += sum(t.previous != t.k - 1 for t in epoch)
        last = paths[0]
    for log in robot.log.frames:
        assert not log.disagreements, f"frame {log.tick.k}: the monitor says {log.disagreements}"
    counts["epochs asked for"] += len({start for _, start in seen.restarts})
    counts["clients that recalled memory"] += len(seen.recalled)
    assert last is not None, "the run never began"
    check_recovered(robot, last)
    return counts


def check_sent(robot: Robot, one: SentCommand, due: list[Decision]) -> None:
    """A command is one of those that are due, or idle."""
    if one.by is None:
        idle = next(a.idle for a in robot.program.robot.actuators if a.name == one.actuator)
        factors = [
            f.factor for a in robot.program.robot.actuators if a.name == one.actuator for f in a.fields
        ]
        values = idle and tuple(
            x if isinstance(x, bool) else x / f for x, f in zip(idle, factors, strict=True)
        )
        assert repr(one.values) == repr(values), f"{one} is not idle"
        return
    wanted = [repr((d.by, d.values, d.fault)) for d in due]
    assert repr((one.by, one.values, one.fault)) in wanted, f"{one} was sent, due was {' or '.join(wanted)}"


def check_memory(robot: Robot, epoch: list[Tick], paths: list[Path], counts: Counter[str]) -> None:
    """Checkpoints, and memory at the end, are those of a client that saw every frame of the epoch once.

    Where clients share a process, the first that needs a cell has it in its checkpoint.
    """
    seen, degrading = robot.seen, any(a.on_loss == "degrade" for a in robot.program.robot.actuators)
    for actuator, module, _ in robot.compiled.clients:
        address = topics.client_address(actuator, module)
        node = robot.client(address)
        at_end = node.frontier if node.frontier[0] == epoch[0].start else (-1, -1)
        saved = {t.k: seen.checkpoints[address, t.k] for t in epoch if (address, t.k) in seen.checkpoints}
        if not saved and at_end[1] < epoch[0].k:
            continue
        ends = max([*saved, at_end[1]])
        allowed: dict[int, list[ClientMemory]] = {}
        for path in paths:
            executor = OneClient(robot.compiled, actuator, module)
            for tick in epoch:
                if tick.k > ends:
                    break
                lost = frozenset(map(module_of, tick.lost)) if degrading else frozenset[str]()
                executor.step(
                    frame_in_base_units(robot.program, path.frames[tick.k]), path.answers[tick.k], lost
                )
                if tick.k in saved or tick.k == at_end[1]:
                    allowed.setdefault(tick.k, []).append(executor.memory)
        for k, data in saved.items():
            counts["checkpoints"] += 1
            found = decode_memory(data)
            assert any(is_part(found, due) for due in allowed[k]), (
                f"{address}: checkpoint {k} is {found}, due was {allowed[k]}"
            )
        if at_end[1] in allowed:
            found = decode_memory(node.program.memory(address))
            assert any(is_part(found, due) for due in allowed[at_end[1]]), (
                f"{address}: remembers {found}, due was {allowed[at_end[1]]}"
            )


def is_part(found: ClientMemory, due: ClientMemory) -> bool:
    cells = {name: due.cells[name] for name in found.cells if name in due.cells}
    return repr((found.first_ns, dict(found.cells))) == repr((due.first_ns, cells))


def check_recovered(robot: Robot, last: Path) -> None:
    """In the last frames everyone was on time, and the commands were the reference's."""
    newest = max(last.frames)
    for k in range(newest - 3, newest):
        for actuator, decision in last.decisions[k].items():
            verdict = robot.seen.verdicts.get((k, actuator))
            assert verdict is not None, f"frame {k}: no verdict for {actuator} although all is quiet"
            bad = [f for f in verdict.fates if f[1] in ("late", "lost", "refused", "overruled")]
            assert not bad, f"frame {k}: {bad} although all is quiet"
            found = repr((verdict.by, verdict.values, verdict.fault))
            due = repr((decision.by, decision.values, decision.fault))
            assert found == due, f"frame {k}: {found}, due was {due}"
